"""Records of runs in real time: resultants of the joints, forces at contact points, distance from equilibrium."""

import dataclasses

import numpy as np
import pytest

from dembrick import history
from dembrick.kernels.dynamics.loop import Limits
from dembrick.kernels.dynamics.record import unbalanced_ratio
from dembrick.kernels.dynamics.tiles import WRENCHES
from dembrick.runs.simulate import simulate
from dembrick.scenario import model, shipped, toml
from dembrick.scenario.controls import DynamicControl, PushoverControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Output
from dembrick.simulation.dynamics.integrator import advance, joint_forces, present_velocities
from dembrick.simulation.dynamics.state import contact_forces, joint_resultants, out_of_balance, with_contact_forces
from dembrick.views.export.layers import Contacts, Picture
from dembrick.views.motion.joints import JointMotion
from helpers.resting_blocks import FORMULATIONS, about, place, resting
from helpers.stone_scenes import law, of_stone

POINTS = ("concave", "corrected", "corrected-shear", "distributed")
ALL = model.CHANNELS


def lever(links, host, j):
    """Lever from the centroid of the host, with the axes ``host`` (3, 3), to O of joint ``j`` in the world."""
    tangents = links.axes[links.tangents[j]] @ host.T
    return links.lever[j] @ [*tangents, np.cross(*tangents)]


def naive_resultants(state):
    """`write_resultants` once more, joint by joint."""
    bodies, links = state.bodies, state.links
    rows = []
    for j in range(len(links.host)):
        other, host = bodies.rotation[links.other[j]], bodies.rotation[links.host[j]]
        u = links.axes[links.plane[j]] @ other.T
        normal = np.cross(*u)
        t1 = host @ links.axes[links.tangents[j], 0]
        t1 -= t1 @ normal * normal
        t1 /= np.linalg.norm(t1)
        axes = np.array([t1, np.cross(normal, t1), normal])
        force, moment = links.wrench[j, :3], links.wrench[j, 3:6] - np.cross(lever(links, host, j), links.wrench[j, :3])
        f, m = links.sense[j] * (axes @ force), links.sense[j] * (axes @ moment)
        slip = 0.0
        if state.corners is not None:
            slip = sum(state.corners.slip[state.corners.joint == j])
        if state.faces is not None:
            slip = sum(state.faces.slip[state.faces.joint == j])
        rows.append([f[2], -f[0], -f[1], -m[2], -m[0], -m[1], slip])
    return np.array(rows)


def rubbing(formulation):
    """A block on a floor, unevenly pressed, that has slipped and rotated."""
    moving, driving = resting(formulation, floor=(2.0, 2.0, 0.1), turn=(0.8, 0.0, 0.36, -0.48), friction=0.3)
    moving.state = with_contact_forces(moving.state)
    for _ in range(3):
        place(moving, moving.state.bodies.rotation[1] @ [1e-7, 2e-7, -1e-8], about((0.3, -0.2, 0.9), 3e-6))
        joint_forces(moving, driving)
    return moving


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_resultants_of_joints_one_by_one(formulation):
    state = rubbing(formulation).state
    found, expected = joint_resultants(state), naive_resultants(state)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-9 * np.abs(expected).max())
    assert (np.abs(expected) > 1e-12).all() and found[0, 0] > 10.0


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_out_of_balance_against_sums_by_block(formulation):
    state, gravity = rubbing(formulation).state, np.array([1.0, 2.0, -9.0])
    force, _ = out_of_balance(state, gravity)
    largest = np.linalg.norm(state.links.wrench[:, :3], axis=1).max()
    expected = np.linalg.norm(force[state.bodies.free], axis=1).max() / largest
    assert unbalanced_ratio(state.bodies, state.links, *gravity) == pytest.approx(expected, rel=1e-12)
    assert unbalanced_ratio(state.bodies, state.links._replace(wrenches=np.zeros(WRENCHES)), *gravity) == 1.0


@pytest.mark.parametrize("formulation", POINTS)
def test_contact_forces_sum_up_to_the_joint(formulation):
    """Contact forces sum up to the joint's force and moment about the host's centroid; friction acts at points of its
    own, in the plane below them."""
    state = rubbing(formulation).state
    links, corners, force = state.links, state.corners, contact_forces(state, np.ones(1)) * state.links.sense[0]
    scale = np.abs(links.wrench[0, :3]).max()
    np.testing.assert_allclose(force.sum(axis=0), links.wrench[0, :3], rtol=1e-12, atol=1e-12 * scale)
    host = state.bodies.rotation[links.host[0]]
    tangents = links.axes[links.tangents[0]] @ host.T
    to_origin = lever(links, host, 0)
    arm = to_origin + corners.x[:, None] * tangents[0] + corners.y[:, None] * tangents[1]
    normal = np.cross(*(links.axes[links.plane[0]] @ state.bodies.rotation[links.other[0]].T))
    pressed = (force @ normal)[:, None] * normal
    friction_arm = to_origin + corners.shear_arm[0] * (arm - to_origin)
    apart = state.bodies.position[links.host[0]] - state.bodies.position[links.other[0]]
    friction_arm -= ((friction_arm + apart) @ normal - links.offset[0])[:, None] * normal
    moment = np.cross(arm, pressed).sum(axis=0) + np.cross(friction_arm, force - pressed).sum(axis=0)
    np.testing.assert_allclose(moment, links.wrench[0, 3:6], rtol=1e-11, atol=1e-12 * scale)
    assert np.ptp(force @ normal) > 0.01 * scale and np.abs(force - pressed).max() > 0.01 * scale


def wall(formulation, control, **output):
    """A small wall at rest, with everything recorded."""
    return of_stone(
        law(formulation, 0.7, 1e9),
        control,
        walls=(Wall("wall", "stone", (0.3, 0.2, 0.1), courses=3, blocks=2, base=0.1),),
        output=Output(ALL, **output),
    )


@pytest.mark.parametrize("formulation", ["concave", "corrected"])
def test_a_wall_at_rest_against_its_equilibrium(formulation):
    """The forces at every point equal those of the static search for equilibria."""
    still = simulate(wall(formulation, DynamicControl(duration=2e-3), rows=4, frames=2))
    found, expected = still.frames["contact_force"][-1], simulate(
        wall(formulation, PushoverControl((1.0, 0.0, 0.0)))
    ).frames["contact_force"][0]  # fmt: skip
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())
    assert expected[:, 2].max() > 50.0


@pytest.mark.parametrize("formulation", POINTS)
def test_frames_of_a_tilting_wall_carry_what_its_rows_say(tmp_path, formulation):
    """In every frame of the history the contact forces of a joint sum up to its N and V; open joints carry none."""
    given = toml.load(shipped.folder() / "wall_tilt.toml", [f'joint.formulation="{formulation}"'])
    changes = ["walls.0.courses=3", "walls.0.blocks=2", "control.rate=10.0", "control.displacement=0.25"]
    changes += ["joint.normal_stiffness=1e9", "joint.shear_stiffness=4e8"]
    given = toml.loads(toml.text_of(given), None, changes)
    given = dataclasses.replace(given, output=Output(ALL, rows=80, frames=40))
    result = simulate(given, tmp_path / "wall.h5")
    with history.read(tmp_path / "wall.h5") as found:
        joints = JointMotion(found)
        forces, N = found.frame_values("contact_force", 0, found.n_frames), joints.at(range(found.n_frames)).resultants
        own = np.repeat(np.arange(joints.n_joint), np.diff(joints.point_start))
        summed = np.zeros((found.n_frames, joints.n_joint, 3))
        np.add.at(summed, (slice(None), own), forces)
        size = np.sqrt((N[..., :3] ** 2).sum(axis=2))
        np.testing.assert_allclose(np.linalg.norm(summed, axis=2), size, rtol=1e-9, atol=1e-9 * size.max())
        np.testing.assert_array_equal(summed[N[..., 0] == 0.0], 0.0)
        assert (N[..., 0] == 0.0).any()
        meetings = result.run.motion.contact_detection
        assert meetings.touching is not None and (meetings.left_to_joints() < 1.0).any()
        shown = Contacts(found, joints, True).frames(Picture(found).span(0, found.n_frames)).at_points
        np.testing.assert_allclose(shown["force"], forces, rtol=1e-6, atol=1e-3)
        assert (shown["normal_force"] > -1e-3 * size.max()).all()
    assert result.frames["contact_force"].tobytes() == forces.tobytes()


def test_without_the_channel_nothing_is_written_down():
    moving, driving = resting("concave")
    advance(moving, driving, 3, Limits(displacement=1.0, longest=1.0))
    assert moving.state.corners.force is None


def test_compiling_for_a_frame_counts_as_compiling():
    """A frame with velocities may be the first to need a variant of the loop; its compilation counts as such."""
    moving, driving = resting()
    moving.forms.clear()
    before = moving.compile_seconds
    present_velocities(moving, driving)
    assert len(moving.forms) == 1 and moving.compile_seconds > before
