"""Check the statements of searches on other load paths, for random structures with different loading histories.

    python tools/drawn_histories.py --count 60 --seed 1

Walls, stacks between side walls, blocks beside curbs, towers and arches, pushed by a jack. Each is searched without a
solver for limit analysis, so that only the mechanism shows whether another path may bear more; then by limit analysis,
with other stiffness ratios and locked-in forces (``--refine``), and after random loads were applied and removed. Errors
are: "no path above" although limit analysis or a path bears more, and a limit reported as independent of the path
although another path differs by more than the error bars. Exits with 1 if there is an error.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from dembrick import limit, simulate
from dembrick.assembly.build import assemble
from dembrick.errors import DembrickError
from dembrick.scenario.controls import StaticsControl, YieldControl
from dembrick.scenario.generators import Arch
from dembrick.scenario.model import Actuator, Block, JointLaw, Load, Material, Scenario

SLACK = 1e-3  # of V: the tolerance of a search
DENSITY, G = 2000.0, 9.81


def box(name: str, size, position, fixed: bool = False) -> Block:
    """A block with sides along the axes."""
    return Block(name, "stone", box=tuple(map(float, size)), position=tuple(map(float, position)), fixed=fixed)


def wall(rng) -> tuple[list[Block], str, tuple]:
    """A wall of 2 to 4 courses in running bond on a floor, between side walls or free; and the pushed block."""
    courses, columns, blocks = int(rng.integers(2, 5)), int(rng.integers(1, 4)), []
    a, b, h = 0.4, float(rng.uniform(0.2, 0.5)), 0.2
    for i in range(courses):
        left = 0.0 if i % 2 == 0 else -0.5 * a
        edges = np.clip(left + a * np.arange(columns + 2), 0.0, a * columns)
        for j, (x, y) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            if y - x > 1e-9:
                blocks.append(box(f"w{i}.{j}", (y - x, b, h), (0.5 * (x + y), 0.0, h * (i + 0.5))))
    return blocks, blocks[-1].name, (blocks[-1].position[0], 0.0, h * courses)


def tower(rng) -> tuple[list[Block], str, tuple]:
    """A stack of blocks of different widths."""
    blocks, z = [], 0.0
    for i in range(int(rng.integers(1, 5))):
        size = rng.uniform(0.3, 0.6, 3)
        blocks.append(box(f"t{i}", size, (rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), z + 0.5 * size[2])))
        z += size[2]
    top = blocks[-1]
    return blocks, top.name, (top.position[0], top.position[1], z - rng.uniform(0.0, 0.2))


def between(rng) -> tuple[list[Block], str, tuple]:
    """Stacks side by side between two walls, with a bar across them."""
    blocks = [box(name, (4.0, 0.2, 0.4), (0.0, y, 0.2), True) for name, y in (("left", -0.6), ("right", 0.6))]
    length = float(rng.uniform(0.6, 1.5))
    blocks += [box(f"s{i}", (length, 0.5, 0.4), (0.0, y, 0.2)) for i, y in enumerate((-0.25, 0.25))]
    width, height = rng.uniform(0.3, 0.5), rng.uniform(0.5, 1.2)
    blocks.append(box("bar", (width, 1.0, height), (0.0, 0.0, 0.4 + 0.5 * height)))
    return blocks, "bar", (-0.5 * width, 0.0, 0.4 + height * rng.uniform(0.3, 1.0))


def curb(rng) -> tuple[list[Block], str, tuple]:
    """A block beside a curb, possibly with another block on top."""
    height, low = rng.uniform(0.4, 1.2), rng.uniform(0.05, 0.3)
    blocks = [box("curb", (0.2, 0.4, low), (-0.3, 0.0, 0.5 * low), True)]
    blocks.append(box("block", (0.4, 0.4, height), (0.0, 0.0, 0.5 * height)))
    if rng.random() < 0.5:
        blocks.append(box("top", (0.3, 0.4, 0.3), (0.0, 0.0, height + 0.15)))
    return blocks, "block", (-0.2, 0.0, height * rng.uniform(0.3, 1.0))


def drawn(rng) -> tuple[str, Scenario]:
    """Kind and scenario of a random structure."""
    friction, ratio = float(rng.uniform(0.1, 0.9)), float(rng.choice([0.1, 0.4, 1.0, 4.0]))
    law = JointLaw(str(rng.choice(["concave", "convex"])), friction, 1e10, ratio * 1e10)
    kind = str(rng.choice([*KINDS, "arch"]))
    away = rng.normal(size=3) * (1.0, 0.3, 0.2)
    direction = tuple((away / np.linalg.norm(away)).tolist())
    given = kind, (0.0, 0.0, -G), law, {"stone": Material(DENSITY)}
    if kind == "arch":
        number, thick = 2 * int(rng.integers(3, 7)) + 1, float(rng.uniform(0.2, 0.4))
        stone = number // 3
        angle = np.pi * (1.0 - (stone - 0.5) / number)
        point = (float(np.cos(angle)), 0.0, float(np.sin(angle)))
        arch = Arch("arch", "stone", radius=1.0, thickness=thick, depth=0.5, voussoirs=number)
        push = Actuator("jack", f"arch.{stone}", point, (0.0, 0.0, -1.0))
        return kind, Scenario(*given, (), YieldControl(), actuators=(push,), arches=(arch,))
    blocks, block, point = KINDS[kind](rng)
    blocks.insert(0, box("floor", (6.0, 4.0, 0.2), (0.0, 0.0, -0.1), True))
    push = Actuator("jack", block, tuple(map(float, point)), direction)
    return kind, Scenario(*given, tuple(blocks), YieldControl(), actuators=(push,))


KINDS: dict[str, Callable] = {"wall": wall, "tower": tower, "between": between, "curb": curb}


def loaded_before(rng, scenario: Scenario) -> Scenario:
    """The same structure after loads of half their weight in a random direction acted on its free blocks."""
    assembly = assemble(scenario)
    loads = []
    for name, force, fixed in zip(assembly.names, assembly.dead_force, assembly.fixed, strict=True):
        if not fixed:
            pushed = rng.normal(size=3) * (1.0, 1.0, 0.2) * rng.uniform(0.0, 2.0) * np.linalg.norm(force)
            loads.append(Load(name, tuple(pushed.tolist()), stages=(1,)))
    return replace(scenario, loads=tuple(loads), stages=(StaticsControl(), StaticsControl()))


def judged(rng, scenario: Scenario) -> tuple[str, list[str]]:
    """Statement proven for a structure (above, below) with the numbers found; and a list of errors."""
    with patch("dembrick.simulation.limit_analysis.solver.installed", lambda: False):
        plain = simulate(scenario, record=False)
    if plain.unlimited:
        return "unlimited", []
    answer, point = plain.as_dict(), plain.yield_point
    V, high = [], max(point.V, point.V_upper or point.V) * (1.0 + SLACK)
    if plain.path is not None and len(plain.assembly.joints) > 1:
        V += simulate(scenario, record=False, refine=True).path["path_range"]
    for _ in range(3):
        with contextlib.suppress(DembrickError):
            V.append(simulate(loaded_before(rng, scenario), record=False).yield_point.V)
    V = [value for value in V if value is not None]
    bound, alone = limit(scenario), len(plain.assembly.joints) == 1 or not answer["path_dependent"]
    wrong = []
    if answer["no_path_above"] and bound.lower > high and not alone:
        wrong.append("limit analysis shows more")
    if answer["no_path_above"] and max(V, default=0.0) > high:
        wrong.append("a path bears more")
    if not answer["path_dependent"] and min(V, default=high) < point.V_lower * (1.0 - SLACK):
        wrong.append("a path bears less")
    if max(V, default=0.0) > bound.upper * (1.0 + 1e-3) or point.V > bound.upper * (1.0 + 1e-3):
        wrong.append("a path ends above the bound")
    proven = f"{'above' if answer['no_path_above'] else '-':5} {'-' if answer['path_dependent'] else 'below':5}"
    reached = f"paths {min(V, default=point.V):.6g} to {max(V, default=point.V):.6g}, at most {bound.upper:.6g}"
    return f"{proven} V {point.V:.6g}, {reached}", wrong


def main() -> int:
    """Draw random structures, run them, count outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    failed, left_out = 0, 0
    for number in range(options.count):
        rng = np.random.default_rng([options.seed, number])
        kind, scenario = drawn(rng)
        try:
            said, wrong = judged(rng, scenario)
        except DembrickError as error:
            left_out, said, wrong = left_out + 1, f"no answer: {str(error)[:90]}", []
        failed += bool(wrong)
        print(
            f"{number:4} {kind:8} {scenario.joint.formulation:8} {said} {'WRONG: ' if wrong else ''}{', '.join(wrong)}"
        )
        sys.stdout.flush()
    print(f"{failed} of {options.count} are wrong, {left_out} have no answer")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
