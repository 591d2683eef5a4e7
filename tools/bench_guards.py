"""Cost of the guards of the time loop and of the energy balance: the same steps with and without them, alternating.

    python tools/bench_guards.py [--steps 2000000] [--points 18 12] [--formulation ...]

Every variant pushes a copy of set 4a at a constant rate along its plateau, where all points slide and the energy terms
cost most. The variants take turns of a few thousand steps; one turn of all variants is one sample. Two ratios are
printed: that of the best turns, and the median of the ratios of each turn. All variants record rows, as a run does.
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import time

from dembrick.assembly import build as assemblies
from dembrick.kernels.statics.loop import RUNNING, advance
from dembrick.runs.lab import lab_scenario
from dembrick.scenario.model import FORMULATIONS
from dembrick.simulation.session import Session
from dembrick.simulation.statics import constant_rate, load_system
from dembrick.simulation.statics.guards import new_guard
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import for_kernels, new_energy

TURN = 4096  # steps
ROWS_EVERY = 64  # steps: about 1000 rows in a test of 1e5 steps or less
RATE = 1e-4  # m/s
PLATEAU = 1e-5  # m, travel before the measurement starts


class Variant:
    """A run that can be continued step by step, with or without guards and energy balance."""

    def __init__(self, scenario, guarded: bool, audited: bool):
        built = assemblies.assemble(scenario)
        setup = load_system.Setup(built, tolerance=0.0)
        damping = setup.dashpots()
        self.dt = 0.9 * damping.critical_time_step
        self.state = setup.state
        self.state.joints.damping[:] = damping.joints / self.dt
        self.inertia = constant_rate.physical_inertia(built)
        constant_rate.to_finite_motion(self.state)
        self.drive = load_system.steady_drive(RATE, self.dt, setup.actuator_stiffness)._replace(
            viscous_n=1.0, viscous_s=1.0
        )
        self.guard = new_guard(built, self.state) if guarded else None
        self.certificate = setup.certificate._replace(every=ROWS_EVERY)
        self.recorder = Recorder(self.state, Session(lambda rows, frames: None), TURN, ROWS_EVERY, 1 << 20)
        self.energy = new_energy(self.state) if audited else None
        self.done = 0
        self.advance(0)
        self.advance(int(PLATEAU / (RATE * self.dt)))

    def advance(self, steps: int) -> float:
        """Run ``steps`` more; return the seconds that they take."""
        spent = 0.0
        while True:
            n = min(steps, TURN)
            began = time.perf_counter()
            status, self.done = advance(
                self.done, n, self.dt, for_kernels(self.state), None, self.inertia, self.drive,
                self.certificate, self.recorder.record, self.energy, self.guard,
            )  # fmt: skip
            spent += time.perf_counter() - began
            if status != RUNNING:
                raise RuntimeError(f"stopped with status {status}")
            self.recorder.drain()
            steps -= n
            if steps <= 0:
                return spent


def compare(scenario, steps: int) -> tuple[list[float], list[float], list[float]]:
    """Time (ns) per step in the best turn of each variant, and cost (%) above the bare loop by both ratios."""
    variants = [Variant(scenario, *flags) for flags in ((False, False), (True, False), (True, True))]
    turns = [[variant.advance(TURN) for variant in variants] for _ in range(max(2, steps // TURN))]
    best = [min(column) for column in zip(*turns, strict=True)]
    bare, guarded, audited = range(3)
    pairs = ((guarded, bare), (audited, guarded))
    by_best = [100.0 * (best[a] / best[b] - 1.0) for a, b in pairs]
    by_turn = [100.0 * (statistics.median(turn[a] / turn[b] for turn in turns) - 1.0) for a, b in pairs]
    return [1e9 * seconds / TURN for seconds in best], by_best, by_turn


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=2_000_000, help="steps of every variant")
    parser.add_argument("--points", nargs=2, type=int, default=(18, 12), help="of the distributed joint")
    parser.add_argument("--formulation", nargs="+", choices=FORMULATIONS, default=FORMULATIONS)
    options = parser.parse_args()
    print(f"{'formulation':<16}{'ns a step':>10}{'guards %':>18}{'energy terms %':>18}  (best turns / median)")
    for formulation in options.formulation:
        scenario = lab_scenario("set4a_curve", formulation)
        if formulation == "distributed":
            law = dataclasses.replace(scenario.joint, points=tuple(options.points))
            scenario = dataclasses.replace(scenario, joint=law)
        best, by_best, by_turn = compare(scenario, options.steps)
        cells = "".join(f"{a:>10.2f} /{b:>6.2f}" for a, b in zip(by_best, by_turn, strict=True))
        print(f"{formulation:<16}{best[0]:>10.1f}{cells}", flush=True)


if __name__ == "__main__":
    main()
