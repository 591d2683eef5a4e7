"""Cost of searches for limit loads over the size of the structure: processor time and memory, with their exponents.

    python tools/bench_scale.py [--quick | --large]

Every scene runs in a process of its own, after the kernels are compiled. Times are processor times, so a busy machine
adds little: ``build`` reads the scenario and builds blocks and joints, ``search`` is everything else (stiffness,
analysis of the equations, dead-load equilibrium, path). ``GB`` is the greatest memory of the process, Python included.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time

TILT = ["control.quasi_static=true"]
WALLS = {n: ("wall_tilt", [f"walls.0.courses={n}", f"walls.0.blocks={n}"]) for n in (10, 30, 50, 70, 100, 316)}
CONVEX = ("wall_tilt", ["walls.0.courses=30", "walls.0.blocks=30", "joint.formulation=convex"])
DOME = ("dome", ["domes.0.rings=50", "domes.0.blocks=100"])
CORNER = (
    "wall_corner",
    ["walls.0.courses=50", "walls.0.blocks=60", "walls.0.returns.0.blocks=22", "walls.0.returns.1.blocks=22"],
)


def with_pushes(assembly, step_factor: float) -> None:
    """Run a search with driven relaxation from the start, to compile its kernels as well."""
    from dembrick.simulation.statics import limit_load
    from dembrick.simulation.statics.paths import path_following

    patience = path_following.WASTED, path_following.LEAST_WASTED
    path_following.WASTED, path_following.LEAST_WASTED = -1e12, -1
    limit_load.find_limit_load(assembly, 0.1)
    path_following.WASTED, path_following.LEAST_WASTED = patience


def case(stem: str, changes: list[str]) -> dict[str, object]:
    """One search, measured in this process."""
    from dembrick.assembly import build
    from dembrick.errors import DembrickError
    from dembrick.scenario import shipped, toml
    from dembrick.simulation.statics import limit_load

    path = shipped.folder() / f"{stem}.toml"

    def scene(changes):
        scenario = toml.load(path, changes)
        return build.assemble(scenario), scenario

    small = [c for c in changes if "formulation" in c]
    assembly, scenario = scene([*small, *TILT])
    limit_load.find_limit_load(assembly, 0.1)  # compiles, or loads the cache
    with_pushes(assembly, scenario.solver.step_factor)
    began = time.process_time()
    assembly, scenario = scene([*changes, *TILT])
    built = time.process_time()
    found = {"blocks": len(assembly.names), "joints": len(assembly.joints), "build": built - began}
    try:
        replay = limit_load.find_limit_load(assembly, scenario.control.tolerance)
        found |= {"V": replay.yield_point.V, "iterations": replay.steps, "phases": replay.phases}
    except DembrickError as error:
        found["failed"] = str(error).split(".")[0]
    found["search"] = time.process_time() - built
    found["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    return found


def measured(stem: str, changes: list[str]) -> dict:
    """`case` in a process of its own."""
    command = [sys.executable, __file__, "--case", json.dumps([stem, changes])]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{stem} {' '.join(changes)}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout)


def row(name: str, now: dict, before: dict | None = None) -> None:
    """Print one line of the table, with exponents relative to the scene ``before``."""
    line = f"{name:22}{now['blocks']:8}{now['joints']:8}{now['build']:8.2f}{now['search']:9.2f}{now['memory']:9.2f}"
    if before is not None:
        size = math.log(now["blocks"] / before["blocks"])
        line += "".join(f"{math.log(now[key] / before[key]) / size:8.2f}" for key in ("search", "memory"))
    else:
        line += 16 * " "
    answer = now.get("failed") or f"{now['iterations']:4} iterations, V = {now['V']:.6g}"
    print(f"{line}  {answer}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="up to 50 x 50")
    parser.add_argument("--large", action="store_true", help="316 x 316 too: minutes, and gigabytes")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.case:
        print(json.dumps(case(*json.loads(given.case))))
        return
    print(f"{'scene':22}{'blocks':>8}{'joints':>8}{'build s':>8}{'search s':>9}{'GB':>9}{'exponents':>14}")
    before = {}
    sizes = [n for n in WALLS if n <= (50 if given.quick else 316 if given.large else 100)]
    for n in sizes:
        now = measured(*WALLS[n])
        row(f"wall {n} x {n}", now, before.get(10 if n == 30 else 30 if n > 30 else None))
        before[n] = now
    now = measured(*CONVEX)
    row("wall 30 x 30, convex", now)
    print(f"{'':22}{now['search'] / before[30]['search']:.2f} times concave")
    if not given.quick:
        row("dome", measured(*DOME))
        row("wall with returns", measured(*CORNER))


if __name__ == "__main__":
    main()
