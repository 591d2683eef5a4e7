"""Cost of each optional feature: time of a step with and without it, in one interleaved run.

    python tools/bench_switches.py [--rounds 15] [--steps 200000]

Set 4a at a constant rate, physical inertia, moving geometry. A line gives the best of all rounds, in ns per step, and
its ratio to the line above that it extends; every round runs all lines once, so that a busy machine slows all alike.
The last lines are processes: the cost to a command of imports that only other commands need.
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import tempfile

from bench_lab import wall

from dembrick.assembly import build as assemblies
from dembrick.runs.lab import lab_scenario
from dembrick.scenario.model import DisplacementControl, Output
from dembrick.scenario.protocols import Protocol
from dembrick.simulation.session import Session
from dembrick.simulation.statics import constant_rate

ROWS = 1000  # rows of the record
SWITCHES = {
    "loop alone (bracket at 1000 instants)": None,
    "+ rows of history, energy audit": ("joints", "energy"),
    "+ frames of motion": ("joints", "energy", "frames"),
    "+ velocity": ("joints", "energy", "frames", "velocity"),
    "+ contact forces": ("joints", "energy", "frames", "velocity", "contacts"),
}
FORMULATIONS = ("concave", "convex", "distributed")
PROCESSES = {
    "numpy, numba, h5py": "import numpy, numba, h5py",
    "+ matplotlib": "import numpy, numba, h5py, matplotlib.figure",
    "+ pyvista": "import numpy, numba, h5py, pyvista",
    "+ meshio": "import numpy, numba, h5py, meshio",
}


def step_time(assembly, control, channels) -> float:
    """Loop time (s) per step of one run."""
    session = None
    if channels is not None:
        session = Session(observe=lambda rows, frames: None, output=Output(channels=channels, rows=ROWS, frames=ROWS))
    run = constant_rate.push_at_constant_rate(assembly, Protocol.one_way(control.travel, control.rate), 0.9, session)
    return run.loop_seconds / run.steps


def prepared(formulation: str, steps: int):
    """The assembly, and a rate at which the travel takes about ``steps`` steps."""
    scenario = lab_scenario("set4a_curve", formulation)
    if formulation == "distributed":
        scenario = dataclasses.replace(scenario, joint=dataclasses.replace(scenario.joint, points=(18, 12)))
    assembly = assemblies.assemble(scenario)
    control = scenario.control
    protocol = Protocol.one_way(control.travel, control.rate)
    plan = constant_rate.plan(assembly, control, protocol, 0.9, scenario.output)
    return assembly, DisplacementControl(control.rate * plan.steps / steps, control.travel)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What each switch saves.")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--steps", type=int, default=200_000)
    options = parser.parse_args()
    scenes = {name: prepared(name, options.steps) for name in FORMULATIONS}
    times: dict = {}
    for _ in range(options.rounds + 1):  # the first round compiles
        for formulation, scene in scenes.items():
            for label, channels in SWITCHES.items():
                times.setdefault((label, formulation), []).append(step_time(*scene, channels))
    print(f"{'ns a step':40}" + "".join(f"{name:>24}" for name in FORMULATIONS))
    for label in SWITCHES:
        line = f"{label:40}"
        for formulation in FORMULATIONS:
            best = min(times[label, formulation][1:])
            bare = min(times[next(iter(SWITCHES)), formulation][1:])
            line += f"{1e9 * best:14.1f} ({best / bare:5.3f})"
        print(line)
    walls: dict = {name: [] for name in PROCESSES}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(options.rounds):
            for name, code in PROCESSES.items():
                walls[name].append(wall(["-c", code], folder))
    first = statistics.median(walls[next(iter(PROCESSES))])
    for name, values in walls.items():
        print(f"{name:40}{1e3 * statistics.median(values):11.0f} ms ({statistics.median(values) / first:5.3f})")


if __name__ == "__main__":
    main()
