"""Check that the support motion of random arches and walls can be identified from their cracks.

    python tools/drawn_causes.py [--count 20] [--seed 1] [--fast]

An arch, or a wall with a door on two strips, follows a random motion of one support from equilibrium to equilibrium in
the deformed geometry. The joints that are open at the end are the target of a study, which does not know the motion and
uses limit analysis, or for a wall its own paths of equilibria (``--fast``: limit analysis as well). The motion is found
if a likely cause has a motion of the same support within 46 degrees of it, or the opposite one of the other support.
Prints a line per structure and counts; exits with 1 if fewer than 19 of 20 are found.
"""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs import causes
from dembrick.runs.simulate import simulate
from dembrick.runs.study.target import Target
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.generators import Opening
from dembrick.scenario.model import Arch, Block, JointLaw, Material, Output, Scenario, Wall

NEAR = math.cos(math.radians(46.0))
G = 9.81


def drawn(rng, wall: bool) -> tuple[Scenario, str, np.ndarray]:
    """A structure cracked by the motion of a support, that support, and the direction (3,) of its motion."""
    angle = math.radians(float(rng.uniform(-150.0, -30.0) if wall else rng.uniform(0.0, 360.0)))
    way = np.array([math.cos(angle), 0.0, math.sin(angle)])
    if wall:
        courses, height = int(rng.integers(6, 10)), 0.2
        strips = tuple(
            Block(name, "stone", (1.0, 0.4, 0.3), (x, 0.0, -0.15), fixed=True)
            for name, x in (("left", 0.4), ("right", 2.0))
        )
        own = Wall("wall", "stone", (0.4, 0.2, height), courses, 6, ends="half",
                   openings=(Opening((0.8, 1.6), (1, courses - 2), lintel=0.2),))  # fmt: skip
        parts, size = {"blocks": strips, "walls": (own,)}, 2.4
        support = str(rng.choice(["left", "right"]))
    else:
        radius, thickness = 1.5, float(rng.uniform(0.15, 0.25))
        own = Arch("arch", "stone", radius, thickness * radius, 0.5, int(rng.integers(10, 25)))
        parts, size = {"arches": (own,)}, 2.0 * radius
        support = str(rng.choice(["arch.left", "arch.right"]))
    control = SettlementControl((support,), tuple((0.002 * size * way).tolist()))
    scenario = Scenario(
        title="cracked", gravity=(0.0, 0.0, -G), joint=JointLaw("concave", float(rng.uniform(0.6, 0.8)), 5e10, 2e10),
        materials={"stone": Material(2000.0)}, control=control, output=Output(("frames",)), **parts,
    )  # fmt: skip
    return scenario, support, way


def open_joints(result) -> list[tuple[str, str]]:
    """Pairs of blocks whose joint is open at the end of a run, by more than 1/50 of the widest opening."""
    assembly, joints, names = result.assembly, result.assembly.joints, result.assembly.names
    turn = rotation_matrix(result.frames["orientation"][-1]) @ np.swapaxes(assembly.rotation, 1, 2)
    moved, gaps = result.frames["displacement"][-1], np.zeros(len(joints))

    def placed(block: int, points: np.ndarray) -> np.ndarray:
        return assembly.position[block] + moved[block] + (points - assembly.position[block]) @ turn[block].T

    for j in range(len(joints)):
        a, b = int(joints.block_a[j]), int(joints.block_b[j])
        corners = joints.origin[j] + joints[j].polygon @ joints.axes[j, :2]
        gaps[j] = ((placed(b, corners) - placed(a, corners)) @ (turn[a] @ joints.axes[j, 2])).max()
    return [(names[joints.block_a[j]], names[joints.block_b[j]]) for j in np.flatnonzero(gaps > 0.02 * gaps.max())]


def found(answer: causes.Causes, support: str, way: np.ndarray) -> bool:
    """Whether the motion, or the opposite one of another support, is among the likely causes."""
    for motion in (motion for cause in answer.likely for motion in cause.motions):
        moved = motion.velocity[:3] * (1.0 if motion.support == support else -1.0)
        if not motion.velocity[3:].any() and moved @ way >= NEAR * np.linalg.norm(moved):
            return True
    return False


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fast", action="store_true", help="judge walls by limit analysis too")
    asked = parser.parse_args()
    right = ambiguous = 0
    for k in range(asked.count):
        scenario, support, way = drawn(np.random.default_rng([asked.seed, k]), wall=k % 2 == 1)
        opened = tuple(open_joints(simulate(scenario, progress=False)))
        target = Target("cracks", scenario, opened, paths=k % 2 == 1 and not asked.fast)
        answer = causes.find(target)
        right += (hit := found(answer, support, way))
        ambiguous += answer.ambiguous
        best = answer.causes[0]
        wrong = len(best.misses) + len(best.false_alarms)
        kind = "wall" if k % 2 else "arch"
        print(f"{k}: {kind}, {support} along {way[[0, 2]].round(2).tolist()}: {'found' if hit else 'NOT FOUND'}, "
              f"{best.motions[0].said()}, {best.hits} hits, {wrong} wrong, share {best.share:.2f}",
              flush=True)  # fmt: skip
    print(f"{right} of {asked.count} found, {ambiguous} said to be ambiguous")
    return 0 if right >= 0.95 * asked.count else 1


if __name__ == "__main__":
    sys.exit(main())
