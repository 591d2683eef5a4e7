"""Stiffness of joints and of assemblies, computed for all joints at once, against closed forms and plain loops."""

import dataclasses

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.scenario.blocks import Block, Prism
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import JointLaw, JointOverride, Material, YieldControl
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.state import initial_state
from dembrick.simulation.statics.stiffness import (
    assembled_stiffness,
    block_stiffness,
    couplings,
    to_joint,
)
from helpers.stone_scenes import law, of_stone

KN, KS, A, B = 1.0e10, 4.0e9, 0.3, 0.2


def scene(formulation="convex", **parts):
    return of_stone(law(formulation), YieldControl(), materials={"tuff": Material(1500.0)}, **parts)


def lab(formulation):
    blocks = (
        Block("lower", "tuff", (A, B, 0.1), (0, 0, -0.05), fixed=True),
        Block("upper", "tuff", (A, B, 0.1), (0, 0, 0.05)),
    )
    return initial_state(assemble(scene(formulation, blocks=blocks)))


@pytest.mark.parametrize(("formulation", "rotation", "torsion"), [
    ("convex", 1.0, 1.0),
    ("concave", 3.0, 3.0),  # four corners are exactly three times stiffer in rotation than the area
    ("corrected-shear", 3.0, 3.0 * (0.09681061 / 0.18027756) ** 2),  # shrunk by c_T / c
])  # fmt: skip
def test_a_rectangle_in_closed_form(formulation, rotation, torsion):
    (k,) = joint_families.stiffness(lab(formulation))
    area, j = A * B, A * B * (A**2 + B**2) / 12.0
    bending = (rotation * KN * A * B**3 / 12.0, rotation * KN * A**3 * B / 12.0)
    expected = np.diag([KS * area, KS * area, KN * area, *bending, torsion * KS * j])
    assert k == pytest.approx(expected, rel=1e-7, abs=1e-6 * KS * j)


def test_a_triangle_couples_its_two_bendings():
    corners = np.array([(0.0, 0.0), (0.4, 0.0), (0.1, 0.3)])
    blocks = (
        Block("floor", "tuff", (2, 2, 0.1), (0, 0, -0.05), fixed=True),
        Block("wedge", "tuff", prism=Prism(corners, 0.2), position=(0, 0, 0.1)),
    )
    (k,) = joint_families.stiffness(initial_state(assemble(scene(blocks=blocks))))
    about = corners - corners.mean(axis=0)
    area = 0.06
    moments = area / 12.0 * about.T @ about  # of a triangle: a twelfth of the sum over its corners
    assert k[3:5, 3:5] == pytest.approx(
        KN * np.array([[moments[1, 1], -moments[0, 1]], [-moments[0, 1], moments[0, 0]]])
    )
    assert k[5, 5] == pytest.approx(KS * np.trace(moments))


def plain_lever(arm):
    x, y, z = arm
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@pytest.mark.parametrize("formulation", ["convex", "concave", "distributed"])
def test_walls_against_plain_loops(formulation):
    other = JointLaw("concave", 0.3, 3 * KN, KS)
    wall = Wall("w", "tuff", (0.3, 0.2, 0.1), courses=3, blocks=3, base=0.1, heading=25.0)
    parts = scene(formulation, walls=(wall,), joints=(JointOverride(("w.1", "w.2"), other),))
    law = parts.joint if formulation != "distributed" else dataclasses.replace(parts.joint, points=(4, 3))
    state = initial_state(assemble(dataclasses.replace(parts, joint=law)))
    joints, n = state.joints, len(state.blocks.displacement)
    free = np.isin(np.arange(n), state.blocks.free)
    number = np.cumsum(free) - 1
    k = joint_families.stiffness(state)
    whole = np.zeros((6 * free.sum(), 6 * free.sum()))
    single = np.zeros((n, 6, 6))
    off = []
    for j in range(len(k)):
        ends = []
        for block, arm, sign in ((joints.block_a[j], joints.arm_a[j], -1.0), (joints.block_b[j], joints.arm_b[j], 1.0)):
            t = np.zeros((6, 6))
            t[:3, :3] = t[3:, 3:] = joints.axes[j]
            t[:3, 3:] = -joints.axes[j] @ plain_lever(arm)
            assert to_joint(joints.axes[j], arm) == pytest.approx(t, abs=1e-15)
            if free[block]:
                ends.append((block, sign * t))
        for block, t in ends:
            single[block] += (2.0 if len(ends) == 2 else 1.0) * t.T @ k[j] @ t
            for b, u in ends:
                where = np.ix_(6 * number[block] + np.arange(6), 6 * number[b] + np.arange(6))
                whole[where] += t.T @ k[j] @ u
        if len(ends) == 2:
            off.append(ends[0][1].T @ k[j] @ ends[1][1])
    size = np.abs(whole).max()
    assert assembled_stiffness(state) == pytest.approx(whole, abs=1e-12 * size)
    assert block_stiffness(state, 2.0) == pytest.approx(single, abs=1e-12 * size)
    assert np.concatenate([blocks for _, blocks in couplings(state)]) == pytest.approx(np.array(off), abs=1e-12 * size)
    # a wall that moves as one rigid body on a free base would store nothing: here only the base resists
    assert np.linalg.eigvalsh(assembled_stiffness(state))[0] > 0.0
