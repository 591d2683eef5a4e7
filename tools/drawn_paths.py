"""Limits of random sliding slopes and walls: does the range of --refine contain the results for other stiffnesses.

    python tools/drawn_paths.py [--count 40] [--seed 1]

Each structure is searched with ks/kn of .1, .4, 1 and 4, every time with its range. It passes if the four ranges
overlap, each contains the load factors of the others, and none exceeds the associative bound by more than the
tolerance. Prints a line per structure and counts, also of the limits that no path exceeds; exits with 1 if fewer than
38 of 40 pass.
"""

from __future__ import annotations

import argparse

import numpy as np

from dembrick.errors import DembrickError
from dembrick.runs.limit import limit
from dembrick.runs.outcomes.error_estimate import RATIOS, with_ratio
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import PushoverControl, TiltControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Block, JointLaw, Material, Scenario

GRAVITY, STONE = (0.0, 0.0, -9.81), {"stone": Material(2000.0)}
ROUNDING = 1e-6
ENOUGH = 0.95  # share of the structures that must pass


def drawn(rng: np.random.Generator) -> tuple[str, Scenario]:
    """A random slope or wall that may slide."""
    return ("slope", slope(rng)) if rng.random() < 0.5 else ("wall", wall(rng))


def slope(rng: np.random.Generator) -> Scenario:
    """Columns side by side on the steps of a slope, on a tilting table."""
    steep = float(np.radians(rng.uniform(12.0, 28.0)))
    along, up = (np.array([np.cos(a), np.sin(a)]) for a in (steep, steep + 0.5 * np.pi))
    rise, friction = float(rng.uniform(0.05, 0.3)), float(rng.uniform(1.2 * np.tan(steep), 1.0))
    count = int(rng.integers(4, 9))
    heights = 0.6 + rng.uniform(1.0, 3.5) * np.sin(np.linspace(0.2, 3.0, count)) + rng.uniform(0.0, 0.4, count)

    def block(name: str, corner: np.ndarray, height: float, fixed: bool) -> Block:
        ring = [corner, corner + along, corner + along + height * up, corner + height * up]
        corners = tuple((float(x), y, float(z)) for y in (-0.5, 0.5) for x, z in ring)
        return Block(name, "stone", vertices=corners, fixed=fixed)

    blocks = []
    for i, height in enumerate(heights):
        corner = i * (along + rise * up)
        blocks += [block(f"column {i}", corner, float(height), False), block(f"step {i}", corner - 0.5 * up, 0.5, True)]
    law = JointLaw("concave", friction, 1e9, 4e8)
    return Scenario("slope", GRAVITY, law, STONE, tuple(blocks), TiltControl((0.0, -1.0, 0.0)))


def wall(rng: np.random.Generator) -> Scenario:
    """A wall in running bond, pushed mostly along its plane."""
    angle = float(rng.choice([0.0, rng.uniform(0.0, 0.5), rng.uniform(0.0, 1.5)]))
    law = JointLaw("concave", float(rng.uniform(0.2, 0.9)), 1e10, 4e9)
    block = (float(rng.uniform(0.2, 0.6)), 0.2, float(rng.uniform(0.1, 0.3)))
    courses, blocks = int(rng.integers(3, 8)), int(rng.integers(2, 5))
    part = Wall("wall", "stone", block, courses, blocks, base=0.2, ends="half")
    control = PushoverControl((float(np.cos(angle)), float(np.sin(angle)), 0.0))
    return Scenario("wall", GRAVITY, law, STONE, (), control, walls=(part,))


def judged(scenario: Scenario) -> tuple[bool, str] | None:
    """Whether a structure passes, and its numbers; None if it does not slide or has no dead-load equilibrium."""
    tolerance = scenario.control.tolerance
    first = simulate(scenario, record=False)
    if first.collapse is None or not first.collapse["slides"]:
        return None
    bound = limit(scenario).upper
    found = [simulate(with_ratio(scenario, ratio), record=False, refine=True) for ratio in RATIOS]
    bars = np.array([[one.yield_point.V_lower, one.yield_point.V_upper] for one in found])
    V = np.array([one.yield_point.V for one in found])
    overlap = bars[:, 0].max() <= bars[:, 1].min() * (1.0 + ROUNDING)
    holds = bool(((bars[:, :1] <= V * (1.0 + ROUNDING)) & (V <= bars[:, 1:] * (1.0 + ROUNDING))).all())
    below = bool((V <= bound * (1.0 + tolerance)).all())
    unique = first.collapse["no_path_above"]
    numbers = (
        f"V {V.min():.5g} to {V.max():.5g}, bars {bars[:, 0].min():.5g} to {bars[:, 1].max():.5g}, at most {bound:.5g}"
    )
    words = [word for word, good in (("no overlap", overlap), ("V outside", holds), ("above", below)) if not good]
    if unique:
        same = np.ptp(V) <= 2.0 * tolerance * V.max()
        words.append("no path above" if same else "no path above, but other paths differ")
    return overlap and holds and below, f"{numbers} {' '.join(words)}".rstrip()


def main() -> int:
    """Draw random structures, run them, count outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    passed = tried = number = 0
    left_out, unique, wrong = [], 0, 0
    while tried < options.count:
        kind, scenario = drawn(np.random.default_rng([options.seed, number]))
        number += 1
        try:
            said = judged(scenario)
        except DembrickError as error:
            left_out.append(f"{number} ({kind}): {str(error)[:110]}")
            continue
        if said is None:
            continue
        tried, passed = tried + 1, passed + said[0]
        unique, wrong = unique + ("no path above" in said[1]), wrong + ("but other paths" in said[1])
        print(f"{number:4} {kind:6} {'passes' if said[0] else 'FAILS':7} {said[1]}", flush=True)
    print(f"{passed} of {tried} structures that slide pass, of {number} drawn")
    print(f"{unique} of them reach what bounds all paths, and in {wrong} others differ")
    print(f"{len(left_out)} have no answer", *left_out, sep="\n  ")
    return 0 if passed >= ENOUGH * tried else 1


if __name__ == "__main__":
    raise SystemExit(main())
