"""The record of new contacts: with the joints' contact points and gravity it accounts for the motion of the blocks."""

import dataclasses

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import CHANNELS, Block, Output
from dembrick.simulation.channels import NEW_CONTACTS
from dembrick.views.export.layers import Contacts, Picture
from dembrick.views.motion.joints import JointMotion
from helpers.key_lines import words
from helpers.restart_cases import stop_at_look
from helpers.stone_scenes import law, of_stone

G = 9.81
FLOOR = Block("floor", "stone", (4.0, 4.0, 0.1), (0.0, 0.0, -0.05), fixed=True)
BOX = (0.3, 0.2, 0.1)
OBLIQUE = tuple(np.array([0.92, 0.1, 0.3, 0.23]) / np.linalg.norm([0.92, 0.1, 0.3, 0.23]))


def scene(*blocks, duration, rows=100_000, formulation="concave", gravity=(0.0, 0.0, -G), **output):
    return of_stone(
        law(formulation, 0.5, 2e8),
        DynamicControl(duration, 0.3),
        blocks,
        gravity=gravity,
        output=Output(CHANNELS, rows=rows, frames=rows, **output),
    )


def thrown(**more):
    """A block that rotates off another, which lies on the floor, while a third one falls on both: joints are handed
    over to new contacts, and two of these exist at once."""
    lower = Block("lower", "stone", BOX, (0.0, 0.0, 0.05))
    upper = Block("upper", "stone", BOX, (0.0, 0.0, 0.15), velocity=(0.3, 0.0, 0.1), angular_velocity=(0.5, 6.0, 1.0))
    third = Block("third", "stone", BOX, (0.1, 0.05, 0.36), OBLIQUE, velocity=(0.0, 0.0, -2.0))
    return scene(FLOOR, lower, upper, third, **({"duration": 0.08} | more))


def forces_on_blocks(result):
    """Sum of all recorded forces but gravity on every block in every frame, and that of new contacts; (F, n, 3) N."""
    frames, joints = result.frames, result.assembly.joints
    count = len(frames["time"])
    new = np.zeros((count, len(result.assembly.names), 3))
    met = frames["new_contacts"]
    of = np.repeat(np.arange(count), met["count"])
    np.add.at(new, (of, met["blocks"][:, 1]), met["force"])
    np.add.at(new, (of, met["blocks"][:, 0]), -met["force"])
    on_b = frames["contact_force"]
    own = np.repeat(np.arange(len(joints)), [len(points.area) for points in result.assembly.contact_points])
    a, b = (np.array([getattr(joint, side) for joint in joints])[own] for side in ("block_a", "block_b"))
    both = new.copy()
    np.add.at(both, (slice(None), b), on_b)
    np.add.at(both, (slice(None), a), -on_b)
    return both, new


def test_recorded_forces_change_the_momentum_of_every_block():
    """With a frame every step, m (v - v before) / dt is the mean of the recorded forces of both frames plus the weight;
    to rounding, except in steps in which polygons are cut or contacts are found, which a frame does not include yet."""
    result = simulate(thrown())
    frames, mass, dt = result.frames, result.assembly.mass, result.run.motion.time_step
    np.testing.assert_allclose(np.diff(frames["time"]), dt, rtol=1e-9)
    force, new = forces_on_blocks(result)
    change = mass[1:, None] * np.diff(frames["velocity"], axis=0)[:, 1:] / dt
    weight = mass[1:, None] * [0.0, 0.0, -G]
    size = np.abs(force).max()
    # the forces of a frame are those of the step before
    error = np.abs(0.5 * (force[1:-1, 1:] + force[2:, 1:]) + weight - change[:-1]).max(axis=(1, 2)) / size
    assert (error < 1e-9).mean() > 0.75 and error.max() < 0.02
    met = frames["new_contacts"]
    assert size > 25.0 * np.abs(weight).max() and met["count"].max() >= 2
    # joints and new contacts alternate, and both act on a pair of blocks while it is handed over
    both = (np.abs(new).max(axis=(1, 2)) > 1.0) & (np.abs(force - new).max(axis=(1, 2)) > 1.0)
    assert both.sum() > 100
    # the normal leads from the first block to the second; friction is orthogonal to it, except for a contact over an
    # edge, whose pressure is not all along the mean normal
    along = (met["force"] * met["normal"]).sum(axis=1)
    across = np.linalg.norm(met["force"] - along[:, None] * met["normal"], axis=1)
    np.testing.assert_allclose(np.linalg.norm(met["normal"], axis=1), 1.0, rtol=1e-12)
    assert (along > 0.0).all() and (across < 0.75 * along).all() and (across <= 0.5 * along).mean() > 0.2
    assert (met["area"] > 0.0).all() and (met["slip"] >= 0.0).all() and met["slip"].max() > 1e-3


def test_recorded_contacts_turn_the_blocks():
    """Three blocks collide in free flight, without joints: the torques about the centroids, from the recorded points,
    forces and couples, equal the change of the angular momenta."""
    one = Block("one", "stone", BOX, (0.0, 0.0, 0.0), angular_velocity=(3.0, 0.0, 2.0))
    two = Block("two", "stone", BOX, (0.05, 0.02, 0.31), OBLIQUE, velocity=(0.0, 0.1, -2.0))
    far = Block("far", "stone", BOX, (0.0, 0.0, -9.0), fixed=True)
    result = simulate(scene(far, one, two, duration=0.12, gravity=(0.0, 0.0, 0.0)))
    frames, dt = result.frames, result.run.motion.time_step
    met, count = frames["new_contacts"], len(frames["time"])
    of = np.repeat(np.arange(count), met["count"])
    place = result.assembly.position + frames["displacement"]
    torque = np.zeros((count, 3, 3))
    # forces belong to the positions of the step before
    for side, sign in ((0, -1.0), (1, 1.0)):
        block = met["blocks"][:, side]
        arm = met["point"] - place[of - 1, block]
        np.add.at(torque, (of, block), sign * (np.cross(arm, met["force"]) + met["torque"]))
    turn = rotation_matrix(frames["orientation"])
    inertia = turn @ result.assembly.inertia @ np.swapaxes(turn, 2, 3)
    momentum = np.einsum("fnij,fnj->fni", inertia, frames["spin"])
    first, last = met["count"].nonzero()[0][[0, -1]] + [-2, 2]
    given = np.cumsum(0.5 * (torque[first + 1 : last] + torque[first + 2 : last + 1]), axis=0) * dt
    change = momentum[first + 1 : last] - momentum[first]
    size = np.abs(change[:, 1:]).max()
    assert met["count"].sum() > 50 and size > 0.1
    np.testing.assert_allclose(given[:, 1:], change[:, 1:], atol=2e-3 * size)
    assert np.abs(met["torque"]).max() * dt > 0.0


def test_what_a_landed_block_stands_on_carries_its_weight(tmp_path, capsys):
    """The new contact of a block that came to rest on a fixed plate carries its weight, as read from the file."""
    dropped = Block("block", "stone", BOX, (0.1, 0.0, 0.06))
    result = simulate(scene(FLOOR, dropped, duration=0.6, rows=60), tmp_path / "run.h5")
    weight = G * result.assembly.mass[1]
    with history.read(tmp_path / "run.h5") as found:
        starts, met = found.frame_new_contacts(found.n_frames - 1, found.n_frames)
        assert starts.tolist() == [0, 1] and met["blocks"].tolist() == [[0, 1]]
        np.testing.assert_allclose(met["force"], [[0.0, 0.0, weight]], atol=1e-6 * weight)
        # the middle of the overlap, whose depth is the compression of springs of this stiffness
        np.testing.assert_allclose(met["point"], [[0.1, 0.0, -0.5 * weight / (0.06 * 2e8)]], atol=1e-9)
        np.testing.assert_allclose(met["normal"], [[0.0, 0.0, 1.0]], atol=1e-9)
        assert met["area"][0] == pytest.approx(0.06, rel=1e-4)
        all_starts, _ = found.frame_new_contacts(0, found.n_frames)
        counts = np.diff(all_starts)
        at_rows = found.new_contacts[np.searchsorted(found.time, found.frame_time)]
        np.testing.assert_array_equal(counts, at_rows)
        assert counts[0] == 0 and counts[-1] == 1
    assert main(["info", str(tmp_path / "run.h5")]) == 0
    assert f"new contacts {counts.sum()} in all frames" in words(capsys.readouterr().out)


def test_a_run_that_was_stopped_records_the_same_contacts(tmp_path):
    given = thrown(rows=400, checkpoint=1e9)
    whole = simulate(given, tmp_path / "whole.h5")
    stop_at_look(given, tmp_path / "parts.h5", 300)
    with history.read(tmp_path / "parts.h5") as found:
        assert 0 < found.n_frames < len(whole.frames["time"]) and found.new_contacts_before(found.n_frames) > 0
    restart(tmp_path / "parts.h5")
    with h5py.File(tmp_path / "whole.h5") as one, h5py.File(tmp_path / "parts.h5") as other:
        names = list(one["frames/new_contacts"])
        assert set(names) == {"end", *NEW_CONTACTS}
        for name in names:
            value = one[f"frames/new_contacts/{name}"][()]
            assert len(value) and value.tobytes() == other[f"frames/new_contacts/{name}"][()].tobytes()
    memory = simulate(given).frames["new_contacts"]
    for name, values in whole.frames["new_contacts"].items():
        np.testing.assert_array_equal(values, memory[name])


def slid_over_the_edge(formulation, speed):
    """A plate that slides over the edge of its floor: at the end 42 % hang over at 1.15 m/s, 26 % at 1, 16 % at 0.9."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    plate = Block("plate", "stone", (0.2, 0.16, 0.02), (0.35, 0.0, 0.01), velocity=(speed, 0.0, 0.0))
    return scene(floor, plate, duration=0.25, rows=60, formulation=formulation)


@pytest.mark.parametrize(
    "formulation, speed",
    # points of `distributed` joints carry until the edge has passed through their cells, which takes a longer slide
    [("concave", 1.0), ("corrected", 1.0), ("corrected-shear", 1.0), ("distributed", 1.15), ("convex", 1.0)],
)
def test_contacts_of_a_plate_over_the_edge_stay_on_both_faces(tmp_path, formulation, speed):
    """In every frame the exported points lie on the floor and under the plate, and the forces at them have the same
    moment about the centroid as the resultants of the joint."""
    result = simulate(slid_over_the_edge(formulation, speed), tmp_path / "run.h5")
    over = result.frames["displacement"][:, 1, 0] + 0.35 + 0.1 - 0.5
    assert over[-1] == pytest.approx(speed**2 / G - 0.05, abs=5e-4)
    with history.read(tmp_path / "run.h5") as found:
        joints, count = JointMotion(found), found.n_frames
        shown = Contacts(found, joints, True).frames(Picture(found).span(0, count))
        # polygons are cut only after they have moved a little, and forces are of the step before the frame
        slack = 2e-4 * 0.16 + 2.0 * speed * result.run.motion.time_step
        if formulation == "distributed":  # a point carries until the edge has passed through its cell
            slack += 0.6 * np.sqrt(joints.points[2].max())  # cells are longer than wide
        points, force = shown.points, shown.at_points["force"].astype(float)
        pressed = shown.at_points["normal_force"] > 0.0
        assert points[pressed][:, 0].max() <= 0.5 + slack and np.abs(points[pressed][:, 2]).max() < 5e-5
        aside = points - found.frame_values("position", 0, count)[:, 1:]
        assert np.abs(aside[..., 0]).max() <= 0.1 + 1e-6 and np.abs(aside[..., 1]).max() <= 0.08 + 1e-6
        assert over[-1] > 10.0 * slack  # the points of the start would lie this far beyond the edge
        acting = joints.at(range(count)).acting_origin[:, 0]
        if formulation != "distributed":
            expected = found.frame_values("position", 0, count)[:, 1, 0] + np.where(over > 0.0, -0.5 * over, 0.0)
            np.testing.assert_allclose(acting[:, 0], expected, atol=slack)
        moment = np.cross(aside, force).sum(axis=1)
        rows = joints.at(range(count)).resultants[:, 0]
        lever = acting - found.frame_values("position", 0, count)[:, 1]
        if formulation != "corrected-shear":  # friction of `corrected-shear` acts nearer to O than its pressure
            now = joints.at(range(count)).acting_axes[:, 0]
            carried = np.einsum("fi,fij->fj", np.stack([-rows[:, 1], -rows[:, 2], rows[:, 0]], axis=1), now)
            couple = -np.einsum("fi,fij->fj", rows[:, [4, 5, 3]], now)
            whole = np.cross(lever, carried) + couple
            # friction acts in the plane of the floor, which lies above its points by the penetration
            np.testing.assert_allclose(moment[:, :2], whole[:, :2], atol=2e-3 * np.abs(whole).max())


@pytest.mark.parametrize("cohesion", [0.0, pytest.param(100.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("formulation", ["concave", "corrected", "corrected-shear", "distributed", "convex"])
def test_utilisation_of_a_plate_that_slides_and_spins_over_the_edge(tmp_path, formulation, cohesion):
    """While every point slides, the joint is on the limit of the yield domain of its points at their present positions,
    with a cohesion that acts on their present area."""
    given = slid_over_the_edge(formulation, 0.9 + 0.1 * (cohesion > 0.0))
    floor, plate = given.blocks
    plate = dataclasses.replace(plate, angular_velocity=(0.0, 0.0, 6.0))
    law = dataclasses.replace(given.joint, cohesion=cohesion, residual_cohesion=cohesion) if cohesion else given.joint
    simulate(dataclasses.replace(given, blocks=(floor, plate), joint=law), tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as found:
        joints = JointMotion(found)
        now = joints.at(range(found.n_frames))
        used, cut = now.utilisation[:, 0], now.shift[:, 0].any(axis=1)
        spin = np.abs(found.frame_values("spin", 0, found.n_frames)[:, 1, 2])
        sliding = np.arange(found.n_frames) > 3
        sliding &= spin > 0.5
        speed = np.linalg.norm(found.frame_values("velocity", 0, found.n_frames)[:, 1], axis=1)
        sliding &= speed > 0.2
        if formulation == "convex":
            assert cut.sum() > 10 and np.isnan(used[cut]).all()
            np.testing.assert_allclose(used[sliding & ~cut], 1.0, atol=2e-3)
        else:
            assert formulation == "distributed" or (sliding & cut).sum() > 5
            np.testing.assert_allclose(used[sliding], 1.0, atol=2e-3)
