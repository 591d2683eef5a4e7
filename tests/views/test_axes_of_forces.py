"""Axes of forces: those of the start in the undeformed geometry, otherwise axes that turn with the blocks.

The reference is the equilibrium of every block under the forces that are exported, drawn and listed.
"""

import re

import numpy as np
import pytest

import dembrick
from dembrick import theory
from dembrick.geometry.rotations import rotation_matrix
from dembrick.history import read
from dembrick.scenario import shipped
from dembrick.views import export
from dembrick.views.motion.blocks import Poses
from dembrick.views.motion.joint_frames import CHANNELS
from dembrick.views.motion.joints import JointMotion
from dembrick.views.motion.table import joint_table
from dembrick.views.plot.joint_plane import joint_plane
from dembrick.views.render.force_arrows import DrawnForces
from helpers.exported import vtk_steps
from helpers.scenario_text import header

ALL = 'channels = ["joints", "energy", "frames", "contacts"]'
PUSH = """
[[arches]]
name = "arch"
material = "stone"
radius = 1.3
thickness = 0.3
depth = 0.4
voussoirs = 5
position = [10.0, 5.0, 2.0]
heading = 33.0
[[loads]]
block = "arch.3"
force = [100.0, 50.0, -700.0]
[output]
CHANNELS
[control]
kind = "pushover"
direction = [1.0, 0.2, 0.0]
"""
NEAR = 1e-4
POINTS = ["concave", "corrected", "distributed"]


@pytest.fixture
def pushed(tmp_path):
    """A function that runs the pushover of an arch that is oblique to the axes."""

    def run(formulation, control="", channels=ALL, name="run.h5"):
        text = header(formulation) + PUSH.replace("CHANNELS", channels) + control
        dembrick.simulate(dembrick.loads(text), tmp_path / name)
        return read(tmp_path / name)

    return run


def equilibria(found):
    """(frame, its row) of all frames that are equilibria, without those where a block has turned by more than 1 rad."""
    motion = JointMotion(found)
    rows = motion.rows(range(found.n_frames))
    turns = np.abs(found.frame_values("orientation", 0, found.n_frames) - found.orientation0).max(axis=(1, 2))
    return [(k, int(r)) for k, r in enumerate(rows) if found.time[r] == found.frame_time[k] and turns[k] < 0.5]


def loads_on(found, row):
    """(n, 3) N: weight, dead loads and actuators on every block."""
    force = found.block_mass[:, None] * [0.0, 0.0, -9.81]
    for load in found.loads:
        force[load["block"]] += load["force"]
    for actuator, size in zip(found.actuators, found.series("actuator_force", row, row + 1)[0], strict=True):
        force[actuator["block"]] += size * actuator["direction"]
    return force


def unbalanced(found, row, joints, forces):
    """Largest out-of-balance force on a free block over the largest load; ``forces`` act on block b of ``joints``."""
    loads = loads_on(found, row)
    total = loads.copy()
    for j, force in zip(joints, forces, strict=True):
        total[found.joints[j]["block_b"]] += force
        total[found.joints[j]["block_a"]] -= force
    return np.abs(total[~found.block_fixed]).max() / np.abs(loads).max()


def twisted(found, frame, row, centroid, points, joints, forces):
    """Largest out-of-balance moment about ``centroid`` (n, 3), over the largest load times the size of a block, from
    ``forces`` at ``points`` and the torsion of joints without contact points."""
    loads, total = loads_on(found, row), np.zeros((found.n_block, 3))
    turn = rotation_matrix(found.orientation0 if found.small_displacements else found.frame("orientation", frame))
    for actuator, size in zip(found.actuators, found.series("actuator_force", row, row + 1)[0], strict=True):
        i = actuator["block"]
        arm = turn[i] @ rotation_matrix(found.orientation0)[i].T @ (actuator["point"] - found.position0[i])
        total[i] += np.cross(arm, size * actuator["direction"])
    for j, point, force in zip(joints, points, forces, strict=True):
        a, b = found.joints[j]["block_a"], found.joints[j]["block_b"]
        own = np.zeros(3)
        if not len(found.joints[j]["areas"]):
            N, V_1, V_2, M_T, M_1, M_2 = (found.joint(name)[row, j] for name in CHANNELS[:6])
            axis = turn[a] @ rotation_matrix(found.orientation0)[a].T @ found.joints[j]["axes"][2]
            own = -(M_T - (M_2 * V_2 + M_1 * V_1) / N) * axis  # about the centre of pressure, on b
        total[b] += np.cross(point - centroid[b], force) + own
        total[a] -= np.cross(point - centroid[a], force) + own
    return np.abs(total[~found.block_fixed]).max() / (0.3 * np.abs(loads).max())


def turned(found):
    """Largest rotation of a block in the equilibria (rad), which is the error that wrong axes would cause."""
    last = equilibria(found)[-1][0]
    return 2.0 * np.abs(found.frame("orientation", last) - found.orientation0).max()


@pytest.mark.parametrize("formulation", ["convex", *POINTS])
def test_forces_of_a_search_are_in_balance(tmp_path, pushed, formulation):
    """Contact forces as exported, joint forces along their initial axes, and the arrows are in equilibrium."""
    with pushed(formulation) as found:
        assert found.small_displacements
        motion, normals = JointMotion(found), np.array([joint["axes"][2] for joint in found.joints])
        _, steps = vtk_steps(export.to_vtkhdf(found, tmp_path / "out.vtkhdf", only=["contacts"])[0])
        drawn = DrawnForces(found, motion, 1.0, False)
        for k, row in equilibria(found):
            joint, force = steps[k]["cells"]["joint"], steps[k]["at_points"]["force"]
            assert unbalanced(found, row, joint, force) < 1e-3
            if formulation in ("concave", "distributed"):  # other points have different places for shear and pressure
                places = np.concatenate([one["origin"] + one["normal_arms"] @ one["axes"][:2] for one in found.joints])
                assert twisted(found, k, row, found.position0, places, joint, force) < 1e-3
            _, arrows = drawn.of_joints(k, Poses.read(found, k, k + 1))
            assert unbalanced(found, row, range(len(arrows)), arrows) < 1e-3
            across = (force * normals[joint]).sum(axis=1)
            largest = across.max()
            np.testing.assert_allclose(steps[k]["at_points"]["normal_force"], across, atol=1e-5 * largest)
            N = np.bincount(joint, steps[k]["at_points"]["normal_force"])
            np.testing.assert_allclose(N, found.joint("N")[row], atol=1e-4 * N.max())


@pytest.mark.parametrize("formulation", POINTS)
def test_utilisation_of_a_search_is_that_of_the_forces_along_the_axes_of_the_start(pushed, formulation):
    """Utilisation equals the friction limit under the normal forces of the points along the initial normals."""
    with pushed(formulation) as found:
        motion = JointMotion(found)
        number, row = equilibria(found)[-1]
        starts, used = motion.point_start, motion.at([number]).friction_utilisation[0]
        forces = found.frame("contact_force", number)
        for j, joint in enumerate(found.joints):
            own = np.maximum(forces[starts[j] : starts[j + 1]] @ joint["axes"][2], 0.0)
            carried = [found.joint(name)[row, j] for name in ("V_1", "V_2", "M_T")]
            law = theory.points(joint["shear_arms"], joint["friction"] * own, 1.0)
            assert used[j] == pytest.approx(1.0 / theory.limit_load(law, carried).V, rel=2e-3)
        assert max(one["utilisation"] for one in joint_table(found, number)) < 1.002


def test_friction_in_the_plane_of_a_joint_is_what_it_carries(pushed):
    """Friction on b along t1 and t2, summed over the contact points, is opposite to V_1 and V_2 of the row."""
    with pushed("concave") as found:
        number, row = equilibria(found)[-1]
        for j in range(found.n_joint):
            (stage,) = joint_plane(found, j, frames=[number])
            V = [found.joint(name)[row, j] for name in ("V_1", "V_2")]
            np.testing.assert_allclose(stage.friction.sum(axis=0), [-v for v in V], atol=1e-3 * np.abs(V).max())


@pytest.mark.parametrize("formulation", ["convex", pytest.param("concave", marks=pytest.mark.slow)])
def test_forces_in_the_deformed_geometry_turn_with_the_blocks(tmp_path, pushed, formulation):
    with pushed(formulation, "large_displacements = true\ntolerance = 1e-2") as found:
        in_balance(tmp_path, found)


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_forces_at_a_constant_rate_turn_with_the_blocks(tmp_path, formulation):
    """A block pushed off its centroid turns, and its contact forces stay in balance."""
    text = (shipped.folder() / "set4b_curve.toml").read_text(encoding="utf-8").replace('"convex"', f'"{formulation}"')
    text = re.sub(r"(?m)^rate .*", "rate = 2e-2", text)
    text = re.sub(r"(?m)^travel .*", "travel = 8e-3", text)
    dembrick.simulate(dembrick.loads(f"{text}\n[output]\n{ALL}\n"), tmp_path / "run.h5")
    with read(tmp_path / "run.h5") as found:
        in_balance(tmp_path, found)


def in_balance(folder, found):
    """Assert the balance of contact forces, moments and arrows within far less than the error of wrong axes."""
    assert not found.small_displacements and turned(found) > 20.0 * NEAR
    _, steps = vtk_steps(export.to_vtkhdf(found, folder / "out.vtkhdf", only=["contacts"])[0])
    drawn = DrawnForces(found, JointMotion(found), 1.0, False)
    frames = equilibria(found)
    for k, row in frames[len(frames) // 2 :]:  # at a constant rate blocks accelerate at first
        step, centroid = steps[k], found.position0 + found.frame("displacement", k)
        joint, force = step["cells"]["joint"], step["at_points"]["force"]
        assert unbalanced(found, row, joint, force) < NEAR
        assert twisted(found, k, row, centroid, step["points"], joint, force) < 1e-3
        _, arrows = drawn.of_joints(k, Poses.read(found, k, k + 1))
        assert unbalanced(found, row, range(len(arrows)), arrows) < NEAR
