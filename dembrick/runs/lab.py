"""The lab replay: every test of the paper for every formulation, in the joint plane and at mid-height.

``replay_lab`` runs and collects rows; ``table_3`` and ``table_1`` lay them out as text. Each row comes from a replay of
its own, from rest, with a history file of its own. The figures are drawn from the history files: layouts, curves,
domains, the turning block.
"""

from __future__ import annotations

import csv
import dataclasses
import os
import time
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

from dembrick import history
from dembrick._ahead import compile_ahead
from dembrick.errors import HistoryError, MissingDependency, OutputError, ScenarioError
from dembrick.history import check_output, read, replacing
from dembrick.history.files import writing
from dembrick.runs.outcomes.result import Result
from dembrick.runs.simulate import simulate
from dembrick.scenario import shipped
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import present
from dembrick.scenario.model import FORMULATIONS, Scenario, YieldControl
from dembrick.theory.paper_tables import FRICTION, MID_HEIGHT, SETS, TABLE_1
from dembrick.views import plot
from dembrick.views.export import export
from dembrick.views.plot import style
from dembrick.views.summary import bar_to

TABLE_1_FORMULATIONS = ("convex", "concave")
# Compiled by a second process during the first replays, which have concave joints: all of convex joints, as kernels of
# one family share most of their parts, which a process compiles once; then the slowest of the rest.
AHEAD = (("set2a", "convex"), ("set2a_curve", "convex"), ("set2a_curve", "concave"))


@lru_cache(maxsize=64)
def _base(name: str) -> Scenario:
    return scenarios.load(shipped.folder() / f"{name}.toml")


def refuse_foreign_folder(folder: str | os.PathLike) -> None:
    """Raise OutputError if a folder is not empty and holds no history of an earlier lab replay."""
    found = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
    for name in found:
        if name.startswith("set") and name.endswith(".h5"):
            try:
                with read(os.path.join(folder, name)) as there:
                    named = str(there.settings.get("scenario"))
            except HistoryError:
                continue
            if os.path.dirname(named) == str(shipped.folder()) or os.path.basename(named)[:3] == "set":
                return
    if found:
        raise OutputError(
            f"{folder}: {found[0]} in this folder is not part of a lab replay; choose a new one, or use --force"
        )


def lab_scenario(name: str, formulation: str, tolerance: float | None = None) -> Scenario:
    """The scenario file ``name`` (without ending) with another formulation and tolerance."""
    base = _base(name)
    control = base.control
    if tolerance is not None and isinstance(control, YieldControl):
        control = YieldControl(tolerance)
    law = dataclasses.replace(base.joint, formulation=formulation)
    return dataclasses.replace(base, joint=law, control=control)


@dataclasses.dataclass
class LabReplay:
    """Rows of Table 3 and Table 1 as in ``lab --json``, and the wall time by part (s)."""

    rows: list[dict]
    rows_table_1: list[dict]
    wall: dict
    agrees: bool
    curves: list[str] = dataclasses.field(default_factory=list)

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick lab --json``."""
        return {"rows": self.rows, "rows_table_1": self.rows_table_1, "wall": self.wall}


def replay_lab(
    sets: Sequence[str] = tuple(SETS),
    formulations: Sequence[str] = FORMULATIONS,
    tolerance: float | None = None,
    folder: str | os.PathLike | None = None,
    curves: bool = False,
    progress: Callable[[int, int, str], None] | None = None,
    told: Callable[[LabReplay], None] | None = None,
) -> LabReplay:
    """Replay the lab tests; histories go to ``folder``, and with ``curves`` the constant-rate tests too.

    ``told`` is called with the rows once all are done, before the constant-rate tests. An interrupt carries the rows
    done so far as its ``answer``, the object of ``lab --json``.
    """
    for name in sets:
        if name not in SETS:
            raise ScenarioError(f"unknown set {name!r}: use {', '.join(SETS)}")
    for name in formulations:
        if name not in FORMULATIONS:
            raise ScenarioError(f"unknown formulation {name!r}: use {', '.join(FORMULATIONS)}")
    cases = [(s, f, h) for s in sets for f in formulations for h in (0.0, MID_HEIGHT)]
    joints = [(joint, f) for joint in TABLE_1 for f in TABLE_1_FORMULATIONS if f in formulations]
    total = len(cases) + len(joints) + (len(sets) * len(formulations) if curves else 0)
    done = 0
    wall = dict.fromkeys(("build", "compile", "loop", "write", "total"), 0.0)
    began = time.perf_counter()

    def run(name: str, formulation: str, stem: str) -> Result:
        nonlocal done
        if progress:
            progress(done, total, stem)
        path = None if folder is None else os.path.join(folder, f"{stem}.h5")
        result = simulate(lab_scenario(name, formulation, tolerance), path, force=True)
        assert isinstance(result, Result)
        for part in ("build", "compile", "loop", "write"):
            wall[part] += result.wall[part]
        done += 1
        return result

    rows: list[dict] = []
    rows_table_1: list[dict] = []
    files: list[str] = []
    agrees = True
    try:
        ahead = [scene for scene in AHEAD if scene[1] in formulations and (curves or not scene[0].endswith("_curve"))]
        with compile_ahead(lambda: [(_rehearse, ahead)]):
            for set_name, formulation, height in cases:
                name = f"set{set_name}" + ("_mid" if height else "")
                result = run(name, formulation, f"{name}_{formulation}")
                agrees &= result.agrees()
                rows.append(_row(set_name, formulation, height, result))
            for joint, formulation in joints:
                result = run(joint.scenario, formulation, f"{joint.scenario}_{formulation}")
                agrees &= result.agrees()
                rows_table_1.append(_row_table_1(joint, formulation, result))
            if told:
                paused = time.perf_counter()
                told(LabReplay(rows, rows_table_1, wall, agrees))
                began += time.perf_counter() - paused  # the time of told is no part of the replay
            for set_name in sets if curves else ():
                for formulation in formulations:
                    stem = f"set{set_name}_curve_{formulation}"
                    curve = run(f"set{set_name}_curve", formulation, stem).history
                    files += [] if curve is None else [curve]
    except KeyboardInterrupt as stopped:
        wall["total"] = time.perf_counter() - began
        partial = LabReplay(rows, rows_table_1, wall, agrees, files).as_dict() | {"status": "interrupted"}
        stopped.answer = partial  # type: ignore[attr-defined]
        raise
    if progress:
        progress(total, total, "")
    wall["total"] = time.perf_counter() - began
    return LabReplay(rows, rows_table_1, wall, agrees, files)


def _rehearse(wanted: Sequence[tuple[str, str]]) -> None:
    """Run scenarios in these formulations to compile their kernels; results are not kept."""
    for name, formulation in wanted:
        simulate(lab_scenario(name, formulation))


def _row(set_name: str, formulation: str, height: float, result: Result) -> dict:
    point, expected, test = result.yield_point, result.theory, SETS[set_name]
    return {
        "set": set_name,
        "formulation": formulation,
        "load_height": height,
        **{name: getattr(point, name) for name in ("V", "V_lower", "V_upper", "bracket", "V_peak")},
        "theory": expected.V if expected else None,
        "error_vs_theory": expected.error if expected else None,
        "discretisation_error": expected.discretisation_error if expected else None,
        "printed": test.printed.get(formulation),
        "experiment": test.experiment,
        "difference_vs_experiment_percent": 100.0 * (present(point.V) / test.experiment - 1.0),
        **{name: getattr(point, name) for name in ("V_1", "V_2", "M_T", "N", "torsion_centre", "mechanism")},
        "steps": result.run.steps,
        "loop": result.wall["loop"],
        "history": result.history,
    }


def _row_table_1(joint, formulation: str, result: Result) -> dict:
    """Row of Table 1: the torsion strength is V of the couple times its arm."""
    actuators = result.assembly.actuators
    arm = abs(float((actuators.at.arm[:, 0] * actuators.direction[:, 1] * actuators.weight).sum()))
    point, expected = result.yield_point, present(result.theory)
    return {
        "a_over_b": joint.a_over_b,
        "formulation": formulation,
        "M_T0": present(point.V) * arm,
        "M_T0_lower": point.V_lower * arm,
        "M_T0_upper": present(point.V_upper) * arm,
        "bracket": point.bracket,
        "theory": expected.V * arm,
        "error_vs_theory": expected.error,
        "printed": getattr(joint, formulation),
        "loop": result.wall["loop"],
        "history": result.history,
    }


def write_csv(rows: Iterable[dict], path: str | os.PathLike) -> None:
    """Write rows as comma-separated text in SI units, with one header line."""
    rows = list(rows)
    target = check_output(path)
    with writing(path, "table"), replacing(target) as part, open(part, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def table_3(rows: Sequence[dict]) -> str:
    """Table 3 with theory, replay and error bar, mid-height and the differences, as text."""
    lines = [
        "Table 3: limit shear force V of one actuator [N], mu = %g, N = 467 N" % FRICTION,
        "",
        f"{'set':4}{'formulation':17}{'experiment':>11}{'printed':>9}{'theory':>11}{'DEM':>11}{'+-':>8}"
        f"{'DEM-theory':>12}{'DEM-exp.':>10} |{'actuator at mid-height':>22}{'+-':>8}{'gap':>8}",
        "-" * 132,
    ]
    middle = {(r["set"], r["formulation"]): r for r in rows if r["load_height"]}
    last = None
    for row in (r for r in rows if not r["load_height"]):
        if last not in (None, row["set"]):
            lines.append("")
        last = row["set"]
        other = middle.get((row["set"], row["formulation"]))
        printed = f"{row['printed']:.0f}" if row["printed"] is not None else "-"
        half = 0.5 * (row["V_upper"] - row["V_lower"])
        bar = bar_to(3, row["V"], half)
        text = (
            f"{row['set']:4}{row['formulation']:17}{row['experiment']:11.0f}{printed:>9}{row['theory']:11.3f}"
            f"{row['V']:11.3f}{bar:>8}{100 * row['error_vs_theory']:+z10.4f} %"
            f"{row['difference_vs_experiment_percent']:+z8.1f} % |"
        )
        if other is not None:
            half = 0.5 * (other["V_upper"] - other["V_lower"])
            mark = " " if other["bracket"] == "certified" else "*"
            text += (
                f"{other['V']:21.3f}{mark}{bar_to(3, other['V'], half):>8}{100 * (other['V'] / row['V'] - 1):+z6.1f} %"
            )
        lines.append(text)
    return "\n".join(lines)


def notes(rows: Sequence[dict]) -> str:
    """Notes on what the table does and does not show: mid-height, where mu comes from, what each experiment implies."""
    gaps = [
        100.0 * (m["V"] / r["V"] - 1.0)
        for r in rows
        for m in rows
        if not r["load_height"] and m["load_height"] and (r["set"], r["formulation"]) == (m["set"], m["formulation"])
    ]
    lines = [
        "+- is half the width of the bracket of V plus the rounding of the printed digits; * marks an indicator, "
        "where the normal forces change with the load.",
    ]
    if gaps:
        lines.append(
            "Mid-height: the rig pushes 0.05 m above the joint, the paper's formulas assume the joint plane; the "
            f"overturning that comes with it changes V by {min(gaps):+z.1f} to {max(gaps):+z.1f} % (nothing for "
            "couples and for the full-pressure convex joint)."
        )
    lines.append(
        f"mu = {FRICTION} is not printed in the paper. It was inferred from its own analytical columns, so meeting "
        "those columns shows that the equations are right; only the experimental column is evidence. V is proportional "
        "to mu: dV/V = dmu/mu."
    )
    lines.append("Friction that each experiment implies, joint plane:")
    for set_name in dict.fromkeys(r["set"] for r in rows):
        implied = [
            f"{r['formulation']} {FRICTION * r['experiment'] / r['V']:.3f}"
            for r in rows
            if r["set"] == set_name and not r["load_height"]
        ]
        lines.append(f"  {set_name}: " + ", ".join(implied))
    return "\n".join(lines)


def table_1(rows: Sequence[dict]) -> str:
    """Table 1 by theory and replay, as text."""
    lines = [
        "Table 1: torsion strength M_T0 [N m], b = 0.3 m, N = 1 kN, mu = 0.7",
        "",
        f"{'a/b':>5}  {'formulation':13}{'printed':>9}{'theory':>11}{'DEM':>11}{'+-':>8}{'DEM-theory':>12}",
        "-" * 70,
    ]
    for row in rows:
        half = 0.5 * (row["M_T0_upper"] - row["M_T0_lower"])
        lines.append(
            f"{row['a_over_b']:5.2f}  {row['formulation']:13}{row['printed']:9.2f}{row['theory']:11.4f}"
            f"{row['M_T0']:11.4f}{bar_to(4, row['M_T0'], half):>8}{100 * row['error_vs_theory']:+z10.4f} %"
        )
    return "\n".join(lines)


ENDINGS = (".png", ".pdf")
TURNING = ("4b", "convex")  # the replay whose block is shown turning


def draw_rows(replayed: LabReplay, folder: str) -> list[str]:
    """Draw yield points and layouts into ``folder``; returns the files."""
    plane = [row for row in replayed.rows if not row["load_height"]]
    layouts = {row["set"]: row for row in replayed.rows if row["load_height"]}  # that of the rig
    points = [history.read(row["history"]) for row in plane]
    interaction = plot.interaction(points, approximations=("ellipse", "parabola", "bi-linear"))
    return [
        *_saved(interaction, folder, "fig4_interaction"),
        *_saved(plot.domains(points), folder, "fig5_domains"),
        *_saved(plot.layout([history.read(row["history"]) for row in layouts.values()]), folder, "layouts"),
    ]


def _saved(figure, folder: str, name: str) -> list[str]:
    style.settle(figure)
    return [plot.save(figure, os.path.join(folder, name + ending)) for ending in ENDINGS]


def draw_curves(replayed: LabReplay, folder: str, console) -> tuple[list[str], list[str]]:
    """Draw the constant-rate tests into ``folder``; returns the figures and the exports for ParaView. A 3D picture that
    cannot be drawn is left out, with a remark."""
    from dembrick.views import render
    from dembrick.views.render import screen

    turning = [path for path in replayed.curves if TURNING[1] in os.path.basename(path)]
    if turning:
        screen.expect_drawing()
    figures, exported = _saved(_curves(replayed), folder, "curves"), []
    if turning:
        motion = history.read(turning[-1])
        exported += export(motion, os.path.join(folder, "turning_block.vtkhdf"))
        path = os.path.join(folder, "turning_block.png")
        try:
            render.picture(motion, path)
            figures.append(path)
        except MissingDependency as error:
            console.remark(f"no picture of the block: {error}")
    return figures, exported


def _curves(replayed: LabReplay):
    """Force-displacement curves of the constant-rate tests, a panel per set, with experiment and printed values."""
    panels = []
    for name, test in SETS.items():
        files = [path for path in replayed.curves if f"set{name}_curve" in os.path.basename(path)]
        if files:
            curves = [history.read(path) for path in files]
            labels = [curve.results["formulation"] for curve in curves]
            panels.append(plot.CurvePanel(f"Set {name}", curves, labels, test.experiment))
    return plot.curve_panels(panels)
