"""Stress test of the numerics: do failures give an error; a fixed matrix of runs, each judged by theory.

    python tools/stress.py [--axes step mu ...] [--short] [--long] [--random 1000] [--seed 1] [--csv F] [--plot F]

Every cell is one run with one extreme parameter: the time step (0.1 to 2.5 of the critical one, the guard overridden),
stiffness and mass ratios of neighbours, slender joints, tall towers, friction, tolerance, load rate, size, a million
steps at rest, and random joints from the seed. The outcome of a cell is

right    agrees with theory (statics and limit analysis of the undeformed blocks, independent of the run) within the
         tolerance, and theory is inside the bracket if that is certified
near     an indicator that misses its tolerance by less than a factor of three
stopped  no answer, with an error class as the reason
refused  the scenario is rejected before it runs; not a valid cell
WRONG    an incorrect answer without an error

The exit code is 1 if any cell is WRONG. Limit loads are searched for as in a batch, without the energy audit; if one is
wrong, the audit is run afterwards and its result listed. Constant-rate tests are recorded and audited, as by the
command line. ``stress_judge`` defines the right answer of each kind of run, the cells are in ``stress_matrix``, their
scenes in ``stress_scenes``.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from stress_judge import STATUSES, VALID_STEP, Outcome
from stress_matrix import AXES, Cell, cells


def run_all(chosen, progress: Callable[[str], None] | None = None) -> list[tuple[Cell, Outcome]]:
    """Run the cells one after the other."""
    results, axis, began = [], None, 0.0
    for cell in chosen:
        if progress and cell.axis != axis:
            if axis is not None:
                progress(f"{axis}: {time.perf_counter() - began:.1f} s")
            axis, began = cell.axis, time.perf_counter()
        results.append((cell, cell.run()))
    if progress and axis is not None:
        progress(f"{axis}: {time.perf_counter() - began:.1f} s")
    return results


def share_right(results) -> tuple[int, int]:
    """Numbers of right cells and of valid cells with a step factor up to VALID_STEP."""
    valid = [o for c, o in results if c.step_factor <= VALID_STEP and o.status != "refused"]
    return sum(o.status == "right" for o in valid), len(valid)


def report(results) -> str:
    """Counts by axis, overshoot by rate, and every cell that is not right with its reason."""
    lines = [f"{'axis':<12}" + "".join(f"{s:>9}" for s in STATUSES)]
    for axis in [*dict.fromkeys(c.axis for c, _ in results), "all"]:
        count = Counter(o.status for c, o in results if axis in (c.axis, "all"))
        lines.append(f"{axis:<12}" + "".join(f"{count[s]:>9}" for s in STATUSES))
    rates = sorted({c.value for c, _ in results if c.axis == "rate"})
    if rates:
        lines += ["", "overshoot of V_peak by rate (elastic slips per critical time step), least and most:"]
    for rate in rates:
        seen = [o.overshoot for c, o in results if c.axis == "rate" and c.value == rate and math.isfinite(o.overshoot)]
        lines.append(f"  {rate:<8g}" + (f"{min(seen):>12.3g}{max(seen):>12.3g}" if seen else "  no answer"))
    lines.append("")
    for cell, outcome in results:
        if outcome.status != "right":
            lines.append(f"{outcome.status:<8} {cell.axis} {cell.value:g} (step {cell.step_factor:.3g}) {cell.variant}")
            lines.append(f"         {outcome.reason}")
    good, valid = share_right(results)
    if valid:
        lines.append(f"right: {good} of {valid} valid cells with a step factor up to {VALID_STEP} ({good / valid:.2%})")
    lines.append(f"WRONG: {sum(o.status == 'WRONG' for _, o in results)}")
    return "\n".join(lines)


def write_csv(path: Path, results) -> None:
    """Write one line per cell."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["axis", "value", "step_factor", "variant", "status", "error", "overshoot", "reason"])
        for c, o in results:
            writer.writerow([c.axis, c.value, c.step_factor, c.variant, o.status, o.error, o.overshoot, o.reason])


def read_csv(path: Path) -> list[tuple[Cell, Outcome]]:
    """Read cells written by `write_csv`; they cannot be run again."""
    results = []
    with path.open(newline="") as file:
        for row in csv.DictReader(file):
            cell = Cell(row["axis"], float(row["value"]), row["variant"], None, float(row["step_factor"]))
            results.append((cell, Outcome(row["status"], row["reason"], float(row["error"]), float(row["overshoot"]))))
    return results


COLOURS = {"right": "#009e73", "near": "#f0e442", "stopped": "#56b4e9", "refused": "#d9d9d9", "WRONG": "#d55e00"}
HATCHES = {"stopped": "....", "WRONG": "xxxx"}
TITLES = {
    "step": "time step over the critical one",
    "stiffness": "stiffness of the upper joint over the lower one's",
    "mass": "mass of the upper block over the lower one's",
    "slenderness": "length of a joint over its width",
    "tower": "blocks in a tower",
    "friction": "friction coefficient",
    "tolerance": "tolerance",
    "rate": "elastic slips per critical time step",
    "size": "size of the blocks over that of the lab's",
    "rest": "steps at rest",
    "random": "random joints, by formulation",
}


def draw_map(path: Path, results) -> None:
    """Draw a panel per axis: shares of the outcomes at each value, with the number of cells above."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    axes = list(dict.fromkeys(c.axis for c, _ in results))
    rows = -(-len(axes) // 2)
    figure, plots = plt.subplots(rows, 2, figsize=(9.0, 1.45 * rows + 0.4), layout="constrained", squeeze=False)
    for axis, plot in itertools.zip_longest(axes, plots.flat):
        if axis is None:
            plot.set_visible(False)
            continue
        mine = [(c, o) for c, o in results if c.axis == axis]
        # random scenes have no order: one bar per formulation
        keys = [c.variant.split()[1] if axis == "random" else f"{c.value:g}" for c, _ in mine]
        total = Counter(keys)
        labels = list(total)
        left = np.zeros(len(labels))
        for status in STATUSES:
            count = Counter(k for k, (_, o) in zip(keys, mine, strict=True) if o.status == status)
            share = np.array([count[k] / total[k] for k in labels])
            style = {"color": COLOURS[status], "edgecolor": "white", "hatch": HATCHES.get(status), "linewidth": 0.5}
            plot.bar(labels, share, bottom=left, width=0.9, label=status, **style)
            left += share
        for i, label in enumerate(labels):
            plot.text(i, 1.03, str(total[label]), ha="center", va="bottom", fontsize=6.5, color="#555555")
        plot.set_title(TITLES[axis], fontsize=8.5, pad=13)
        plot.set_yticks([])
        plot.set_ylim(0.0, 1.0)
        plot.tick_params(axis="x", labelsize=7, length=0)
        for side in plot.spines.values():
            side.set_visible(False)
    handles, names = plots[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(STATUSES), frameon=False, fontsize=9)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(arguments=None) -> int:
    """Run the matrix from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--axes", nargs="+", choices=AXES, default=AXES)
    parser.add_argument("--short", action="store_true", help="only the ends of every axis")
    parser.add_argument("--long", action="store_true", help="ten million steps at rest in place of a million")
    parser.add_argument("--random", type=int, default=1000, help="number of random scenes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--read", type=Path, nargs="+", help="CSV files of earlier runs, instead of running anything")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args(arguments)
    if options.read:
        results = [result for path in options.read for result in read_csv(path)]
    else:
        rest_steps = 10_000_000 if options.long else 20_000 if options.short else 1_000_000
        chosen = cells(options.axes, options.short, rest_steps, options.random, options.seed)
        results = run_all(chosen, progress=lambda line: print(line, file=sys.stderr, flush=True))
    print(report(results))
    if options.csv:
        write_csv(options.csv, results)
    if options.plot:
        draw_map(options.plot, results)
    return 1 if any(o.status == "WRONG" for _, o in results) else 0


if __name__ == "__main__":
    sys.exit(main())
