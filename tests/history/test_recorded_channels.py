"""Recorded channels: each against the value it must equal, and no channel that was not requested."""

import dataclasses

import numpy as np
import pytest

from dembrick.assembly import build as assemblies
from dembrick.errors import ScenarioError
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
from dembrick.scenario import model, toml
from dembrick.simulation.session import Session
from dembrick.simulation.statics import recorder
from dembrick.simulation.statics.state import initial_state
from helpers.places import SCENARIOS

POINTS = ("concave", "corrected", "corrected-shear", "distributed")


def recorded(name, formulation, **output):
    given = lab_scenario(name, formulation, 1e-2)
    if given.control.kind == "displacement":
        given = dataclasses.replace(given, control=model.DisplacementControl(1e-3, 1.5e-5))
    return simulate(dataclasses.replace(given, output=model.Output(model.CHANNELS, **output)))


@pytest.mark.parametrize("formulation", POINTS)
def test_contact_forces_add_up_to_the_joint_resultants(formulation):
    """In every frame of a search: force, bending (about the normal points) and torsion (about the shear points)."""
    result = recorded("set4a_mid", formulation)
    points = result.assembly.contact_points[0]
    axes = result.assembly.joints[0].axes
    rows, force = result.rows["joint"][:, 0], result.frames["contact_force"] @ axes.T
    assert len(force) == len(rows) > 10
    (x, y), (xs, ys) = points.normal_arm.T, points.shear_arm.T
    scale = rows[:, 0].max()
    n, v1, v2 = force[:, :, 2], -force[:, :, 0], -force[:, :, 1]
    for got, column in (
        (n.sum(axis=1), 0),
        (v1.sum(axis=1), 1),
        (v2.sum(axis=1), 2),
        (v2 @ xs - v1 @ ys, 3),
        (-(n @ y), 4),
        (n @ x, 5),
    ):
        np.testing.assert_allclose(got, rows[:, column], rtol=0, atol=1e-12 * scale)
    assert (np.hypot(v1, v2) <= 0.64 * n * (1 + 1e-12)).all()


@pytest.mark.parametrize("name", ["set4a", "set4a_curve"])
def test_velocity_and_spin_are_the_motion_between_steps(name):
    """For frames one step apart, the velocity of a frame is the displacement since the frame before over the step."""
    result = recorded(name, "concave", rows=10_000, frames=10_000)
    frames, dt = result.frames, result.run.time_step
    np.testing.assert_allclose(np.diff(frames["time"]), dt, rtol=1e-6)
    moved = np.diff(frames["displacement"][:, 1], axis=0)
    speed = np.abs(frames["velocity"]).max()
    assert speed > 0.0 and not frames["velocity"][:, 0].any()
    np.testing.assert_allclose(moved / dt, frames["velocity"][1:, 1], rtol=0, atol=1e-9 * speed)
    # small rotations: twice the vector part of q is the rotation vector
    turned = 2.0 * np.diff(frames["orientation"][:, 1, 1:], axis=0)
    spin = np.abs(frames["spin"]).max()
    assert spin > 0.0
    np.testing.assert_allclose(turned / dt, frames["spin"][1:, 1], rtol=0, atol=1e-5 * spin)


def test_convex_joints_have_no_contact_forces():
    result = recorded("set4a", "convex")
    assert result.frames["contact_force"].shape == (len(result.frames["time"]), 0, 3)


def test_only_what_was_asked_for():
    given = dataclasses.replace(lab_scenario("set4a", "concave"), output=model.Output(()))
    result = simulate(given)
    assert result.frames == {} and "joint" not in result.rows and len(result.rows["load"]) > 5
    whole = simulate(lab_scenario("set4a", "concave"))
    np.testing.assert_array_equal(result.rows["load"], whole.rows["load"])
    assert set(whole.frames) == {"time", "displacement", "orientation", "velocity", "spin"}


def test_the_number_of_rows_and_frames_is_followed():
    result = recorded("set4a_curve", "concave", rows=20, frames=5)
    assert result.run.steps > 100
    assert 20 <= len(result.rows["time"]) <= 22 and 5 <= len(result.frames["time"]) <= 6
    assert set(result.frames["time"]) <= set(result.rows["time"])


def test_frames_are_every_so_many_rows_and_at_least_as_many_as_asked_for():
    """150 frames of 1000 rows mean every sixth row, 167 frames, as the manual says."""
    result = simulate(toml.load("set4a_curve", ["output.rows=1000", "output.frames=150"]))
    rows, frames = result.rows["time"], result.frames["time"]
    assert 1000 <= len(rows) <= 1010 and 167 <= len(frames) <= 168
    numbers = np.searchsorted(rows, frames)
    np.testing.assert_array_equal(rows[numbers], frames)
    assert set(np.diff(numbers[1:-1])) == {6}


def test_a_short_buffer_loses_nothing(monkeypatch):
    """Chunks get shorter, not the record: rows and frames are the same whatever the buffer holds."""
    cases = (("set4a_curve", "concave"), ("set4b_mid", "convex"))
    whole = [recorded(*case, rows=50, frames=25) for case in cases]
    monkeypatch.setattr(recorder, "BUFFER_BYTES", 100)
    for first, case in zip(whole, cases, strict=True):
        second = recorded(*case, rows=50, frames=25)
        assert first.yield_point == second.yield_point
        for kind in ("rows", "frames"):
            one, other = getattr(first, kind), getattr(second, kind)
            for name in set(one) - {"energy"}:
                np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_the_buffer_of_a_big_scene_is_bounded():
    state = initial_state(assemblies.assemble(lab_scenario("set4a", "concave")))
    blocks = state.blocks._replace(displacement=np.zeros((10_000, 3)))
    session = Session(lambda rows, frames: None, model.Output(rows=10_000, frames=10_000))
    record = recorder.Recorder(state._replace(blocks=blocks), session, 1 << 16).record
    assert len(record.frame_time) >= 3
    assert sum(array.nbytes for array in record) < 2 * recorder.BUFFER_BYTES


@pytest.mark.parametrize(
    "text, words",
    [
        ('channels = ["frame"]', "did you mean 'frames'"),
        ('channels = ["velocity"]', '"frames" must be there'),
        ('channels = ["contacts", "joints"]', '"frames" must be there'),
        ("channels = 3", "list of str"),
        ("rows = 0", "between 1 and"),
        ("rows = 1.5", "whole number"),
        ("frames = true", "whole number"),
        ("rows = 100\nframes = 101", "it must be at most rows = 100, as frames are taken at rows"),
        ("row = 3", "did you mean 'rows'"),
    ],
)
def test_what_cannot_be_recorded_is_refused(text, words):
    whole = (SCENARIOS / "set4a.toml").read_text() + f"\n[output]\n{text}\n"
    with pytest.raises(ScenarioError, match=words):
        toml.loads(whole)


def test_the_output_table_comes_back():
    text = (SCENARIOS / "set4a.toml").read_text() + '\n[output]\nchannels = ["frames", "contacts"]\nframes = 12\n'
    found = toml.loads(text)
    assert found.output == model.Output(("frames", "contacts"), frames=12)
    assert toml.loads(toml.dumps(found)) == found
