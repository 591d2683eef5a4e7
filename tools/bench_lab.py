"""Error against time: cost of the lab replay per set, formulation and tolerance.

    python tools/bench_lab.py [--quick] [--sets 4a ...] [--repeats 20] [--rounds 3] [--no-process] [--csv FILE]

Columns of the table:

error       |V / theory - 1| of the replay; bar is the half-width of its bracket over V, which bounds the error.
steps       iterations of Newton's method.
loop        best and median over the repeats of the loop time that the program reports (dead-load equilibrium, forces,
            bracket), in one warm process without a history.
x plain     best loop time over that of the plain four-point loop (tools/plain_loop.py) for as many steps as there are
            iterations: cost of an iteration relative to a step of a bare explicit program.
eval/step   evaluations of the exact limit surface per step (convex only).
process     median wall time of fresh `python -m dembrick run` processes, start-up and history file included, and the
            same over the median of `python -c "import numpy, numba, h5py"` (x import). Each round runs the references
            and all rows once, so that a busy machine slows them all.

Above the table: cost of a step of the plain loop; below it: `dembrick --help` over a bare interpreter.
Times depend on the machine and its load; run this on a quiet core and compare ratios.
"""

from __future__ import annotations

import argparse
import csv
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import plain_loop

import dembrick
from dembrick.runs.lab import lab_scenario
from dembrick.scenario import shipped
from dembrick.scenario.model import FORMULATIONS
from dembrick.theory.paper_tables import SETS

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
COLUMNS = [
    "set",
    "formulation",
    "tolerance",
    "error",
    "bar",
    "steps",
    "loop_best",
    "loop_median",
    "x_plain",
    "evaluations_per_step",
    "process",
    "x_import",
]


def measure_loop(set_name: str, formulation: str, tolerance: float, repeats: int) -> dict:
    """Error, steps and loop times of one row."""
    scenario = lab_scenario(f"set{set_name}", formulation, tolerance)
    dembrick.simulate(scenario, record=False)  # compiles
    loops = []
    for _ in range(repeats):
        result = dembrick.simulate(scenario, record=False)
        loops.append(result.wall["loop"])
    point, areas, steps = result.yield_point, result.run.state.areas, result.run.steps
    plain = plain_loop.seconds(steps, 8)
    return {
        "set": set_name,
        "formulation": formulation,
        "tolerance": tolerance,
        "error": abs(result.theory.error),
        "bar": 0.5 * (point.V_upper - point.V_lower) / point.V,
        "steps": steps,
        "loop_best": min(loops),
        "loop_median": statistics.median(loops),
        "x_plain": min(loops) / plain,
        "evaluations_per_step": None if areas is None else float(areas.evaluations.sum()) / steps,
        "process": None,
        "x_import": None,
    }


def wall(command: list[str], folder: str) -> float:
    """Wall time of a process (s)."""
    root = str(Path(dembrick.__file__).parent.parent)
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, *command], cwd=folder, env=os.environ | {"PYTHONPATH": path}, check=True, capture_output=True
    )
    return time.perf_counter() - began


def measure_processes(rows: list[dict], rounds: int) -> str:
    """Fill in the process columns, interleaved with the references; returns the line on start-up."""
    references = {
        "bare": ["-c", "pass"],
        "import": ["-c", "import numpy, numba, h5py"],
        "help": ["-m", "dembrick", "--help"],
    }
    times: dict = {name: [] for name in references} | {i: [] for i in range(len(rows))}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(rounds):
            for name, command in references.items():
                times[name].append(wall(command, folder))
            for i, row in enumerate(rows):
                file = shipped.folder() / f"set{row['set']}.toml"
                change = f"joint.formulation={row['formulation']}"
                command = ["-m", "dembrick", "run", str(file.resolve()), "--set", change, "--quiet"]
                times[i].append(wall([*command, "--tolerance", repr(row["tolerance"])], folder))
    median = {name: statistics.median(values) for name, values in times.items()}
    for i, row in enumerate(rows):
        row["process"], row["x_import"] = median[i], median[i] / median["import"]
    return (
        f"start-up: --help {1e3 * median['help']:.0f} ms = {median['help'] / median['bare']:.2f} x bare interpreter "
        f"({1e3 * median['bare']:.0f} ms); import numpy, numba, h5py {1e3 * median['import']:.0f} ms"
    )


def line(row: dict) -> str:
    """A row of the table."""

    def shown(value: float | None, form: str, width: int) -> str:
        return f"{'-' if value is None else format(value, form):>{width}}"

    process = None if row["process"] is None else 1e3 * row["process"]
    return (
        f"{row['set']:4}{row['formulation']:16}{row['tolerance']:8.0e}{row['error']:10.1e}{row['bar']:10.1e}"
        f"{row['steps']:7}{1e3 * row['loop_best']:11.4f}{1e3 * row['loop_median']:11.4f}{row['x_plain']:9.1f}"
        f"{shown(row['evaluations_per_step'], '.1f', 11)}{shown(process, '.0f', 12)}{shown(row['x_import'], '.2f', 10)}"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Error against time of the lab replay.")
    parser.add_argument("--repeats", type=int, default=20, help="replays a row, for the loop time")
    parser.add_argument("--rounds", type=int, default=3, help="fresh processes a row")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--formulation", nargs="+", choices=FORMULATIONS, default=list(FORMULATIONS))
    parser.add_argument("--quick", action="store_true", help="set 4a, tolerances 1e-3 and 1e-5, 5 repeats, 1 round")
    parser.add_argument("--no-process", action="store_true", help="loop times only")
    parser.add_argument("--csv", metavar="FILE", help="write the table")
    options = parser.parse_args()
    sets, tolerances, repeats, rounds = options.sets, TOLERANCES, options.repeats, options.rounds
    if options.quick:
        sets, tolerances, repeats, rounds = ["4a"], (1e-3, 1e-5), 5, 1
    plain_loop.run(1, 1.0)
    print(f"plain loop: {plain_loop.step_nanoseconds():.1f} ns a joint and step")
    rows = [measure_loop(s, f, t, repeats) for s in sets for f in options.formulation for t in tolerances]
    start_up = None if options.no_process else measure_processes(rows, rounds)
    print(
        f"{'set':4}{'formulation':16}{'tol.':>8}{'error':>10}{'bar':>10}{'steps':>7}{'loop best':>11}{'median ms':>11}"
        f"{'x plain':>9}{'eval/step':>11}{'process ms':>12}{'x import':>10}"
    )
    print("\n".join(map(line, rows)))
    if start_up:
        print(start_up)
    if options.csv:
        with open(options.csv, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
