"""Cost of assemblies in motion, compared with a plain loop in the same process and with the memory bandwidth.

    python tools/bench_assembly.py [--quick]

Costs per joint are processor time, the best of many short chunks that alternate with the plain loop, so that a busy
machine slows all alike: judge the ratios. The last columns give the memory touched per joint and step, and its share of
the machine's copy bandwidth (more than 100 % if a scene fits the caches).
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import platform
import time
from functools import partial

import numba
import numpy as np
import plain_wall

import dembrick
from dembrick.assembly import build
from dembrick.kernels.dynamics.loop import Limits
from dembrick.runs.simulate import simulate
from dembrick.scenario import shipped
from dembrick.scenario import toml as scenarios
from dembrick.simulation.dynamics import chunks, integrator, run
from dembrick.simulation.dynamics.energy import MotionEnergy
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.state import seen

WRITTEN = ("wrenches", "position", "orientation", "velocity", "spin", "momentum", "seen_tiles", "sheared")
SHARED = ("tiles", "points")
IDLE = {  # arrays that no step of sticking joints without loads touches
    "Bodies": ("rotation", "applied"),
    "Links": ("host", "other", "tangents", "plane", "axes", "place", "kept", "reach", "slack", "glide"),
    "Corners": ("joint", "lane", "start", "place", "law", "slip"),
    "Faces": ("joint", "lane", "outline", "place", "twist", "slip", "count", "x", "y", "far"),
}
CALM = Limits(displacement=1.0, longest=1.0)


def wall(courses: int, blocks: int, formulation: str = "concave", balanced: bool = False):
    """A wall in equilibrium, with or without energy balance, and its loading: gravity tilting slowly out of plane."""
    changes = [f"walls.0.courses={courses}", f"walls.0.blocks={blocks}", f"joint.formulation={formulation}"]
    scenario = scenarios.load(shipped.folder() / "wall_tilt.toml", changes)
    moving = run.prepare(build.assemble(scenario), scenario.control, scenario.solver.step_factor)
    moving.energy = MotionEnergy(moving.state, wanted=balanced)
    gravity = np.array(scenario.gravity)
    bodies, links = moving.state.bodies, moving.state.links
    bodies.position[:, 2] -= plain_wall.sunk(bodies.position[:, 2] + moving.state.middle[2], courses)
    links.put_seen(seen(bodies, links))
    return moving, Driving(gravity, tilt=(np.array([1.0, 0.0, 0.0]), np.radians))


def chunk(moving, driving, steps: int) -> float:
    """Time of this thread (ns) per joint and step in one call of the loop."""
    times = (moving.steps + np.arange(steps)) * moving.time_step
    began = time.thread_time()
    chunks.advance_chunk(moving, moving.state.bodies, driving, times, CALM, 0.0, moving.time_step)
    took = time.thread_time() - began
    moving.steps += steps
    return 1e9 * took / steps / len(moving.assembly.joints)


def state_bytes(moving) -> int:
    """Memory (bytes) of all arrays that the loop uses."""
    return sum(array.nbytes for array in moving.state.arrays)


def touched_bytes(moving) -> float:
    """Memory (bytes) that a step reads and writes at least once; data shared by tiles stays in the cache."""
    total = 0.0
    for part in (moving.state.bodies, moving.state.links, moving.state.corners, moving.state.faces):
        arrays = {} if part is None else part._asdict()
        kinds = len(np.unique(arrays["like"])) / len(arrays["like"]) if "like" in arrays else 1.0
        idle = IDLE.get(type(part).__name__, ())
        for name, array in arrays.items():
            if isinstance(array, np.ndarray) and name not in idle:
                total += array.nbytes * (kinds if name in SHARED else 2.0 if name in WRITTEN else 1.0)
    return total


def bandwidth() -> float:
    """Copy bandwidth of one core (bytes/s, reads and writes counted), best of ten."""
    source, target = np.ones(1 << 25), np.empty(1 << 25)
    best = np.inf
    for _ in range(10):
        began = time.perf_counter()
        np.copyto(target, source)
        best = min(best, time.perf_counter() - began)
    return 2 * source.nbytes / best


def interleaved(calls: dict, rounds: int) -> dict:
    """The best result of each call; the calls alternate."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            best[name] = min(best[name], call())
    return best


def joint_costs(sizes, rounds: int, speed: float) -> None:
    """Time (ns) per joint and step by size and formulation, one thread."""
    numba.set_num_threads(1)
    print(f"{'blocks':>8}{'joints':>8}{'plain':>8}{'concave':>9}{'ratio':>7}{'energy':>8}{'convex':>8}{'/ concave':>10}"
          f"{'energy':>8}{'bytes/block':>13}{'convex':>8}{'bytes/joint step':>18}{'of bandwidth':>14}")  # fmt: skip
    for courses, blocks, steps in sizes:
        gc.collect()
        calls, size = {}, {}
        for formulation in ("concave", "convex"):
            for balanced in (False, True):
                moving, driving = wall(courses, blocks, formulation, balanced)
                calls[formulation, balanced] = partial(chunk, moving, driving, steps)
            size[formulation] = state_bytes(moving)
            if formulation == "concave":
                touched = touched_bytes(moving)
        calls["plain"] = partial(plain_wall.nanoseconds, plain_wall.at_rest(courses, blocks), steps)
        best = interleaved(calls, rounds)
        n, j = len(moving.assembly.names), len(moving.assembly.joints)
        yardstick, concave, convex = best["plain"], best["concave", False], best["convex", False]
        print(f"{n:8}{j:8}{yardstick:8.1f}{concave:9.1f}{concave / yardstick:7.2f}{best['concave', True]:8.1f}"
              f"{convex:8.1f}{convex / concave:10.2f}{best['convex', True]:8.1f}{size['concave'] / n:13.0f}"
              f"{size['convex'] / n:8.0f}{touched / j:18.0f}"
              f"{100 * touched / j / (concave * 1e-9) / speed:12.0f} %", flush=True)  # fmt: skip


def thread_gain(courses: int, rounds: int) -> None:
    """Speed of two threads over one, and whether their results agree to the last bit.

    Wall-clock time of short calls, since on a shared machine only these find both cores free. All calls use the same
    state, so that it stays in the caches.
    """
    integrator.Pace.choose = lambda _, loops: (loops - 1, integrator.LONGEST_CHUNK)  # no trial
    moving, driving = wall(courses, courses)
    joints = len(moving.assembly.joints)
    steps = max(4, 60_000 // joints)

    def call(threads: int) -> float:
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
        best = np.inf
        for _ in range(6):  # the first call after a change waits for threads that still spin
            before = moving.loop_seconds
            chunk(moving, driving, steps)
            best = min(best, moving.loop_seconds - before)
        return 1e9 * best / steps / joints

    best = interleaved({threads: partial(call, threads) for threads in (1, 2)}, rounds)
    ends = []
    for threads in (1, 2):
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
        end, driving = wall(courses, courses)
        integrator.advance(end, driving, 50, CALM)
        ends.append(end.state.bodies)
    same = all(np.array_equal(a, b) for a, b in zip(*ends, strict=True))
    print(f"{len(moving.assembly.names)} blocks: one thread {best[1]:.1f} ns, two {best[2]:.1f} ns, "
          f"gain {best[1] / best[2]:.2f}, bit-identical: {'yes' if same else 'NO'}", flush=True)  # fmt: skip


def tilted_walls(cases) -> None:
    """Angle at 20 mm, and cost of a simulated second: processor time on one thread, wall-clock time on two."""
    numba.set_num_threads(1)
    for n, rigid, changes in cases:
        changes = [f"walls.0.courses={n}", f"walls.0.blocks={n}", *changes]
        scenario = scenarios.load(shipped.folder() / "wall_tilt.toml", changes)
        simulate(dataclasses.replace(scenario, control=dataclasses.replace(scenario.control, displacement=1e-5)))
        began = time.thread_time()
        result = simulate(scenario)
        took = time.thread_time() - began
        motion, angle = result.run.motion, result.collapse["angle"]
        joints, stiffness = len(result.assembly.joints), result.scenario.joint.normal_stiffness
        balance = "with" if "energy" in result.scenario.output.channels else "without"
        shared = ""
        if joints >= chunks.MANY:
            numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
            two = simulate(scenario).run
            numba.set_num_threads(1)
            shared = f"; its loop on two threads {two.loop_seconds / two.motion.time:.2f} s of the clock"
        plain = plain_wall.at_rest(n)
        yardstick = min(plain_wall.nanoseconds(plain) for _ in range(10))
        bare = 1e-9 * yardstick * joints / motion.time_step
        print(f"{n} x {n}, kn = {stiffness:g} Pa/m, steps of {motion.time_step:.3g} s: 20 mm at {angle:.4f} deg "
              f"(rigid {rigid}: {100 * (angle / rigid - 1):+.2f} %), {took / motion.time:.2f} s a simulated second, "
              f"{balance} an energy balance, all counted; a plain loop with that step {bare:.2f} s{shared}",
              flush=True)  # fmt: skip


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="no scene above 1,000 blocks, and no run to its end")
    options = parser.parse_args()
    speed = bandwidth()
    print(f"dembrick {dembrick.__version__}, python {platform.python_version()}, numpy {np.__version__}, numba "
          f"{numba.__version__}, {platform.machine()}, {numba.config.NUMBA_NUM_THREADS} threads, copy bandwidth of one "
          f"core {speed / 1e9:.1f} GB/s\n")  # fmt: skip
    print("ns a joint and step, one thread, joints stick")
    sizes = [(10, 10, 500), (30, 30, 50)]
    if not options.quick:
        sizes += [(100, 100, 5), (100, 1000, 2)]
    joint_costs(sizes, 20 if options.quick else 40, speed)
    if options.quick:
        return
    print()
    for courses in (30, 100):
        thread_gain(courses, 80)
    print()
    tall = ["joint.normal_stiffness=1.74e10", "joint.shear_stiffness=6e9", "control.damping=0.01",
            "solver.step_factor=0.98"]  # fmt: skip
    without = ['output.channels=["joints", "frames", "velocity"]']
    tilted_walls([(10, 12.015, []), (10, 12.015, ["joint.normal_stiffness=4e9", "joint.shear_stiffness=1.6e9"]),
                  (30, 4.560, tall), (30, 4.560, tall + without)])  # fmt: skip


if __name__ == "__main__":
    main()
