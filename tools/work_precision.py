"""Error against time for the four lab tests: every formulation over tolerance, points, time step and stiffness.

    python tools/work_precision.py [--repeats 9] [--quick] [--no-process] [--csv FILE] [--plot FILE]

Every case is replayed from rest ``repeats`` times in one warm process, round after round, so that busy moments of the
machine affect all cases alike; times are medians. Only the geometry is built once per case. The loop time is reported
by the program (dead-load equilibrium, forces, bracket), without history. Process seconds are those of one
`python -m dembrick run` each, start-up and history file included.

Parameters, all combined with the tolerances 1e-2 to 1e-6:

- step factor 0.3 to 0.95 of the critical time step;
- contact stiffness, both kinds, 0.1 and 10 times that of the scenario;
- points of the distributed joint: a lattice of 3 x 2 to 48 x 32 in place of rays from the torsion centre.

Error is |V / theory - 1|; for `distributed` theory is the continuum, so the discretisation error of the points counts
too. A setting is judged over all four sets: its error is their worst, its time and steps their mean. A setting lies on
the Pareto front of its formulation unless another is at least as accurate and 5 % faster (the scatter of the times).

The figure (`--plot`) has three panels, all with the relative error as ordinate: above over loop seconds, below left
over time steps, below right over process seconds (set 4a only). Our lines vary the tolerance at the default step
factor and stiffness; small markers are all other settings; the ring is the default. Numbered grey points are other
engines (tools/peers.csv): their worst set against the theory of their formulation; crosses follow neither theory and
are compared with the nearer one. They ran once, on a machine of the same kind: compare orders of magnitude.

The last tables compare rules for points by their error per point (0.3 m x 0.2 m, uniform pressure): in the friction
moment in pure torsion, and for the worst of some 2,500 torsion centres; then rays from the torsion centre itself.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import statistics
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bench_lab import wall

from dembrick.assembly import build as assemblies
from dembrick.assembly import quadrature, ray_quadrature
from dembrick.errors import NotConvergedError
from dembrick.geometry import polygons
from dembrick.runs import theory_check
from dembrick.runs.lab import lab_scenario
from dembrick.scenario import shipped
from dembrick.scenario.model import FORMULATIONS
from dembrick.simulation.statics import limit_load
from dembrick.theory.paper_tables import SETS
from dembrick.views.plot import style

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
STEP_FACTORS = (0.3, 0.5, 0.7, 0.9, 0.95)
STIFFNESSES = (0.1, 1.0, 10.0)
POINTS = ((3, 2), (6, 4), (12, 8), (24, 16), (48, 32))
SCATTER = 0.05  # of a median time: smaller differences are not significant
BURST, LONG = 3, 2e-3  # successive replays of a case in a round; only one if it takes longer than LONG (s)
PEERS = Path(__file__).with_name("peers.csv")


class Setting(NamedTuple):
    """A choice of numerical parameters; with ``points`` None the tolerance sets their number."""

    formulation: str
    tolerance: float = 1e-3
    step_factor: float = 0.9
    stiffness: float = 1.0
    points: tuple[int, int] | None = None

    def is_plain(self) -> bool:
        """Whether nothing but possibly the tolerance differs from the default."""
        return self == Setting(self.formulation, self.tolerance)

    def is_default(self) -> bool:
        """Whether nothing differs from the default."""
        return self == Setting(self.formulation)


@dataclasses.dataclass
class Case:
    """One setting on one set: its prepared geometry, the value of theory, and the results of the replays."""

    setting: Setting
    set_name: str
    assembly: assemblies.Assembly
    V_theory: float
    V: float = float("nan")
    bar: float = float("nan")
    steps: int = 0
    loops: list[float] = dataclasses.field(default_factory=list)
    process: float | None = None

    @property
    def error(self) -> float:
        """Absolute value of the relative error."""
        return abs(self.V / self.V_theory - 1.0)

    @property
    def loop(self) -> float:
        """Median loop time (s)."""
        return statistics.median(self.loops)


class Mark(NamedTuple):
    """A setting over all sets: worst error, mean steps, mean loop time (s), slowest set (s), whether on the front."""

    setting: Setting
    error: float
    steps: float
    loop: float
    slowest: float
    front: bool = False


def settings_of(formulation: str, tolerances: tuple) -> list[Setting]:
    """All settings of a formulation."""
    variants = [{"step_factor": f} for f in STEP_FACTORS] + [{"stiffness": k} for k in STIFFNESSES if k != 1.0]
    if formulation == "distributed":
        variants += [{"points": p} for p in POINTS]
    return [Setting(formulation, t, **variant) for t in tolerances for variant in variants]


def prepare(setting: Setting, set_name: str) -> Case:
    """Geometry and theory of a case."""
    scenario = lab_scenario(f"set{set_name}", setting.formulation, setting.tolerance)
    law = dataclasses.replace(
        scenario.joint,
        normal_stiffness=scenario.joint.normal_stiffness * setting.stiffness,
        shear_stiffness=scenario.joint.shear_stiffness * setting.stiffness,
        points=setting.points,
    )
    assembly = assemblies.assemble(dataclasses.replace(scenario, joint=law))
    theory = theory_check.theory_of(assembly)
    return Case(setting, set_name, assembly, theory.V / (1.0 + (theory.discretisation_error or 0.0)))


def measure_loops(cases: list[Case], repeats: int) -> list[Case]:
    """Replay all cases ``repeats`` times; returns those that converged."""
    failed = set()
    for done in range(0, repeats, BURST):
        for i, case in enumerate(cases):
            burst = 1 if case.loops and case.loops[0] > LONG else min(BURST, repeats - done)
            for _ in range(0 if i in failed else burst):
                try:
                    placed, seconds = limit_load.place_points(case.assembly, case.setting.tolerance)
                    run = limit_load.find_limit_load(placed, case.setting.tolerance)
                except NotConvergedError as error:
                    print(f"not converged: set {case.set_name}, {case.setting}: {error}")
                    failed.add(i)
                    break
                case.loops.append(run.loop_seconds + seconds)
            else:
                if i not in failed:
                    point = run.yield_point
                    case.V, case.bar, case.steps = point.V, 0.5 * (point.V_upper - point.V_lower) / point.V, run.steps
    return [case for i, case in enumerate(cases) if i not in failed]


def measure_process(case: Case, folder: str) -> None:
    """Wall time of one fresh process for a plain setting, history included."""
    file = (shipped.folder() / f"set{case.set_name}.toml").resolve()
    change = f"joint.formulation={case.setting.formulation}"
    command = ["-m", "dembrick", "run", str(file), "--quiet", "--set", change]
    case.process = wall([*command, "--tolerance", repr(case.setting.tolerance)], folder)


def marks_of(cases: list[Case]) -> list[Mark]:
    """The settings over all sets, with the Pareto front of each formulation marked."""
    groups: dict[Setting, list[Case]] = {}
    for case in cases:
        groups.setdefault(case.setting, []).append(case)
    marks = [
        Mark(
            setting,
            error=max(case.error for case in group),
            steps=statistics.mean(case.steps for case in group),
            loop=statistics.mean(case.loop for case in group),
            slowest=max(case.loop for case in group),
        )
        for setting, group in groups.items()
    ]
    return [mark._replace(front=not any(beats(other, mark) for other in marks)) for mark in marks]


def beats(other: Mark, mark: Mark) -> bool:
    """Whether ``other``, of the same formulation, is at least as accurate and faster by more than the scatter."""
    same = other.setting.formulation == mark.setting.formulation
    return same and other.error <= mark.error and other.loop < (1.0 - SCATTER) * mark.loop


def rules(polygon: np.ndarray, n: int, m: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points (k, 2) and weights (k,) of n x m points by each rule, on a rectangle about O."""
    size = np.ptp(polygon, axis=0)

    def product(one, other):
        (x, u), (y, v) = one, other
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2) * size, np.outer(u, v).ravel()

    def cells(count):
        return (np.arange(count) + 0.5) / count - 0.5, np.full(count, 1.0 / count)

    def gauss(count):
        x, weight = np.polynomial.legendre.leggauss(count)
        return 0.5 * x, 0.5 * weight

    def vertices(count):
        weight = np.full(count, 1.0 / (count - 1))
        weight[[0, -1]] *= 0.5
        return np.linspace(-0.5, 0.5, count), weight

    return {
        "vertices": product(vertices(n), vertices(m)),
        "cells": product(cells(n), cells(m)),
        "Gauss": product(gauss(n), gauss(m)),
        "paired cells": quadrature.distributed_points(polygon, 1e-3, (n, m)),
    }


def rule_table() -> list[str]:
    """Relative error of the friction moment by each rule, in pure torsion and for the worst centre."""
    corners = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
    quarter = np.stack(np.meshgrid(np.linspace(0, 0.2, 61), np.linspace(0, 0.14, 41)), axis=-1).reshape(-1, 2)
    lines = [
        "Which rule of points: error of the friction moment of 0.3 m x 0.2 m, in pure torsion / for the worst centre",
        f"{'points':>14}" + "".join(f"{name:>22}" for name in rules(corners, 2, 2)),
    ]
    worst_of: dict[str, list[float]] = {}
    for n, m in POINTS:
        line = f"{n:>4} x{m:>3} ={n * m:5}"
        for name, (arms, weights) in rules(corners, n, m).items():
            share = weights / weights.sum()
            # the lattice, and the points themselves, where the error at the tip of the cone |r - C| is greatest
            centres = np.concatenate([np.zeros((1, 2)), quarter, arms[(arms >= -1e-12).all(axis=1)]])
            exact = polygons.mean_distance(corners, centres)
            gaps = [float(np.hypot(*(arms - c).T) @ share) / e - 1.0 for c, e in zip(centres, exact, strict=True)]
            worst = max(map(abs, gaps))
            worst_of.setdefault(name, []).append(worst)
            line += f"{gaps[0]:+12.1e} /{worst:8.1e}"
        lines.append(line)
    best = min(worst_of, key=lambda name: worst_of[name][2:])
    ratios = ", ".join(f"{w[2] / worst_of[best][2]:.1f} x for {name}" for name, w in worst_of.items() if name != best)
    lines.append(f"Best lattice: {best}. At 96 points the worst centre misses {worst_of[best][2]:.1e}; {ratios}.")
    lines += ["", "Rays from the torsion centre: points (least and most), worst centre"]
    centres = np.concatenate([np.zeros((1, 2)), quarter[::7], 1.7 * quarter[::7]])
    exact = polygons.mean_distance(corners, centres)
    for counts in limit_load.COUNTS:
        sets = [ray_quadrature.rays(corners, c, *counts) for c in centres]
        found = [ray_quadrature.friction_moment(*s, c, (1 / 0.06, 0, 0)) for s, c in zip(sets, centres, strict=True)]
        sizes = [len(areas) for _, areas in sets]
        lines.append(f"{counts}: {min(sizes):5} to {max(sizes):5} {np.abs(found / exact - 1.0).max():10.1e}")
    return lines


def peers() -> list[dict]:
    """Rows of peers.csv with the worst error over their sets added."""
    theory = {(f, s): prepare(Setting(f), s).V_theory for f in ("convex", "concave") for s in SETS}
    with open(PEERS, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        known = {s: float(row[f"V_{s}"]) for s in SETS if row[f"V_{s}"]}
        errors = {f: max(abs(V / theory[f, s] - 1.0) for s, V in known.items()) for f in ("convex", "concave")}
        row["error"] = errors.get(row["stands_for"], min(errors.values()))
    return rows


def described(setting: Setting) -> str:
    """Differences of a setting from the default, in words."""
    parts = [f"tolerance {setting.tolerance:.0e}"]
    parts += [f"step factor {setting.step_factor}"] if setting.step_factor != 0.9 else []
    parts += [f"stiffness x {setting.stiffness:g}"] if setting.stiffness != 1.0 else []
    parts += ["points %d x %d" % setting.points] if setting.points else []
    return ", ".join(parts) + (" (default)" if setting.is_default() else "")


def report(cases: list[Case], marks: list[Mark]) -> list[str]:
    """The printed tables on time: plain settings, cost of a digit, fronts, and the position of the default."""
    lines = ["Over tolerance, default step factor and stiffness"]
    lines.append(
        f"{'formulation':16}{'set':4}{'tol.':>7}{'error':>9}{'bar':>9}{'steps':>7}{'loop ms':>10}{'process s':>11}"
    )
    for case in (case for case in cases if case.setting.is_plain()):
        process = "-" if case.process is None else f"{case.process:.2f}"
        lines.append(
            f"{case.setting.formulation:16}{case.set_name:4}{case.setting.tolerance:7.0e}{case.error:9.1e}"
            f"{case.bar:9.1e}{case.steps:7}{1e3 * case.loop:10.4f}{process:>11}"
        )
    for formulation in dict.fromkeys(mark.setting.formulation for mark in marks):
        own = [mark for mark in marks if mark.setting.formulation == formulation]
        plain = [mark for mark in own if mark.setting.is_plain()]
        costs = [b.loop / a.loop for a, b in zip(plain, plain[1:], strict=False)]
        fine = next((mark for mark in plain if mark.setting.tolerance == 1e-4), None)
        lines += ["", formulation]
        if fine:
            lines.append(f"  1e-4: loop {1e3 * fine.loop:.3f} ms, slowest set {1e3 * fine.slowest:.3f} ms")
        lines.append("  a further digit costs x " + ", ".join(f"{cost:.2f}" for cost in costs))
        lines.append("  Pareto front (worst error, mean steps, mean loop):")
        for mark in sorted((mark for mark in own if mark.front), key=lambda mark: mark.loop):
            lines.append(f"    {mark.error:8.1e}{mark.steps:8.1f}{1e3 * mark.loop:10.4f} ms  {described(mark.setting)}")
        default = next(mark for mark in own if mark.setting.is_default())
        text = f"  default: error {default.error:.1e}, loop {1e3 * default.loop:.4f} ms: "
        better = sorted((mark for mark in own if beats(mark, default)), key=lambda mark: mark.loop)
        text += "on the front" if default.front else f"NOT on the front, beaten by {len(better)} settings"
        lines.append(text + (f", fastest: {described(better[0].setting)}" if better else ""))
    return lines


def write_csv(path: str, cases: list[Case], marks: list[Mark]) -> None:
    """One line per set and setting, SI units."""
    front = {mark.setting for mark in marks if mark.front}
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(
            [*Setting._fields, "set", "theory", "V", "error", "bar", "steps", "loop_s", "process_s", "front"]
        )
        for case in cases:
            setting = case.setting
            points = "" if setting.points is None else "%d x %d" % setting.points
            measured = [case.V_theory, case.V, case.error, case.bar, case.steps, case.loop, case.process]
            writer.writerow([*setting[:4], points, case.set_name, *measured, int(setting in front)])


def draw(path: str, cases: list[Case], marks: list[Mark]) -> None:
    """Draw the figure described in the docstring of this module."""
    ring = {"color": style.BLACK, "marker": "o", "markersize": 11, "fillstyle": "none", "linestyle": "none"}
    with style.settings():
        figure = style.new_figure((7.2, 8.0))
        grid = figure.add_gridspec(2, 2, height_ratios=(1.5, 1.0))
        top, left, right = (figure.add_subplot(part) for part in (grid[0, :], grid[1, 0], grid[1, 1]))
        for formulation in FORMULATIONS:
            color, line, marker = style.FORMULATION[formulation]
            own = [mark for mark in marks if mark.setting.formulation == formulation]
            timed = [case for case in cases if case.process and case.setting.formulation == formulation]
            for ax, quantity, some in ((top, "loop", own), (left, "steps", own), (right, "process", timed)):
                xy = [(getattr(one, quantity), one.error, one.setting) for one in some]
                ax.plot(*zip(*(p[:2] for p in xy), strict=True), marker, color=color, ms=2.5, alpha=0.4, mew=0)
                plain = [p[:2] for p in xy if p[2].is_plain()]
                ax.plot(*zip(*plain, strict=True), color=color, linestyle=line, marker=marker, ms=5, label=formulation)
                ax.plot(*next(p[:2] for p in xy if p[2].is_default()), **ring)
        key = ["Other engines, worst set:"]
        for number, row in enumerate(peers(), 1):
            key.append(f"{number}  {row['engine']}: {row['setting']}")
            for ax, time in ((top, row["loop_s"]), (right, row["process_s"])):
                if time:
                    x, symbol = float(time), "x" if row["stands_for"] == "other" else "o"
                    ax.plot(x, row["error"], symbol, color=style.GREY, markersize=4)
                    ax.annotate(
                        str(number),
                        (x, row["error"]),
                        (-9 if number == 9 else 3, 2),
                        textcoords="offset points",
                        fontsize=7,
                    )
        top.text(0.995, 0.01, "\n".join(key), transform=top.transAxes, fontsize=6.5, ha="right", va="bottom", ma="left")
        labels = (
            "loop time [s], mean of the four sets",
            "time steps, mean of the four sets",
            "process time [s], set 4a",
        )
        for ax, label in zip((top, left, right), labels, strict=True):
            ax.set(xscale="log", yscale="log", xlabel=label, ylabel="relative error")
        for ax, ticks in ((left, (10, 20, 50, 100, 200, 500)), (right, (0.1, 0.2, 0.5, 1, 2))):
            ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            ax.set_xticks([], minor=True)
        top.plot([], [], **ring, label="default")
        figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=6, columnspacing=1.0)
        style.save(figure, path)


def main() -> None:
    """Measure, print, and write the requested files."""
    parser = argparse.ArgumentParser(description="Error against time of the lab replay.")
    parser.add_argument("--repeats", type=int, default=9, help="replays of each case")
    parser.add_argument("--quick", action="store_true", help="tolerances 1e-3 and 1e-5, 3 repeats")
    parser.add_argument("--no-process", action="store_true", help="no fresh processes")
    parser.add_argument("--csv", metavar="FILE", help="write every case")
    parser.add_argument("--plot", metavar="FILE", help="draw the figure")
    options = parser.parse_args()
    tolerances, repeats = ((1e-3, 1e-5), 3) if options.quick else (TOLERANCES, options.repeats)
    cases = [prepare(setting, s) for f in FORMULATIONS for setting in settings_of(f, tolerances) for s in SETS]
    cases = measure_loops(cases, repeats)
    if not options.no_process:
        with tempfile.TemporaryDirectory() as folder:
            for case in cases:
                if case.set_name == "4a" and case.setting.is_plain():
                    measure_process(case, folder)
    marks = marks_of(cases)
    print("\n".join([*report(cases, marks), "", *rule_table()]))
    if options.csv:
        write_csv(options.csv, cases, marks)
    if options.plot:
        draw(options.plot, cases, marks)


if __name__ == "__main__":
    main()
