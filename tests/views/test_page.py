"""The page of a run: its contents, and that nothing in a history is executed in it."""

import re

import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.errors import HistoryError, OutputError
from dembrick.scenario.controls import YieldControl
from dembrick.views import page
from dembrick.views.motion.joints import JointMotion
from dembrick.views.page import content
from helpers import history_cases as cases
from helpers.pages import data_of, evil_history, unpacked, written


def test_motion_is_that_of_the_history(tmp_path):
    path = written(tmp_path / "run.h5")
    with history.read(path) as run:
        data = data_of(page.document(run))
        shown = unpacked(data["blocks"]["displacement"]).reshape(4, 2, 3)
        turned = unpacked(data["blocks"]["rotation"]).reshape(4, 2, 3)
        for k in range(4):
            np.testing.assert_allclose(shown[k], run.frame("displacement", k), rtol=1e-6)
            np.testing.assert_allclose(turned[k, 1], 0.01 * k * np.array([1.0, 2.0, -2.0]) / 3.0, rtol=1e-6)
        assert data["time"] == pytest.approx(run.frame_time)
        corners = unpacked(data["blocks"]["vertices"]).reshape(-1, 3)
        np.testing.assert_allclose(corners, np.vstack([run.block_vertices(0), run.block_vertices(1)]), rtol=1e-6)
        assert data["blocks"]["fixed"] == [True, False]
        assert data["load"] == pytest.approx(run.load[[0, 10, 20, 30]])
        (jack,) = data["actuators"]
        assert jack["point"] == pytest.approx([0.075, 0.0, 0.0]) and jack["direction"] == [0.0, 1.0, 0.0]
        assert jack["block"] == 1 and jack["ends"] == [[pytest.approx(-0.1), False]] * 2
        # the farthest corner, by Rodrigues' formula
        axis, body = np.array([1.0, 2.0, -2.0]) / 3.0, run.block_vertices(1)
        moved = (
            body * np.cos(0.03)
            + np.cross(axis, body) * np.sin(0.03)
            + np.outer(body @ axis, axis) * (1.0 - np.cos(0.03))
        )
        moved += run.frame("displacement", 3)[1] - body
        assert data["most"] == pytest.approx(np.linalg.norm(moved, axis=1).max(), rel=1e-9)


def test_faces_name_corners_through_all_blocks(tmp_path):
    with history.read(written(tmp_path / "run.h5", assembly=cases.mixed_assembly())) as run:
        data = data_of(page.document(run))
    faces, at, found = unpacked(data["blocks"]["faces"], "<u4").tolist(), 0, []
    while at < len(faces):
        found.append(tuple(faces[at + 1 : at + 1 + faces[at]]))
        at += 1 + faces[at]
    assert found[:6] == list(cases.FACES) and len(found) == 6 + 6 + 5
    assert found[12:] == [tuple(16 + corner for corner in face) for face in cases.wedge().faces]


def test_diagrams_follow_the_record(tmp_path):
    with history.read(written(tmp_path / "run.h5")) as run:
        data = data_of(page.document(run))
        line = data["curve"]["lines"][0]
        assert line["x"] == pytest.approx(1e6 * run.displacement) and line["y"] == pytest.approx(run.load)
        assert data["curve"]["band"] == [215.0, 217.0] and "216.0 ± 1.0 N" in data["curve"]["bandName"]
        # frames are 10 rows apart
        assert data["curve"]["y"] == pytest.approx(run.load[[0, 10, 20, 30]])
        *sections, path = data["path"]["lines"]
        # N grows from row to row, so each row is divided by its own strength mu N; the joint is open in the first row,
        # and four equal points, pressed in the middle, resist torsion at their distance from O
        assert [line["look"] for line in sections] == ["concave", "convex"]
        size = np.hypot(run.joint("V_1")[:, 0], run.joint("V_2")[:, 0])
        direction = np.array([run.joint("V_1")[-1, 0], run.joint("V_2")[-1, 0]]) / size[-1]
        along = np.column_stack([run.joint("V_1")[:, 0], run.joint("V_2")[:, 0]]) @ direction
        N, radius = run.joint("N")[:, 0], 0.93 * np.hypot(0.15, 0.1)
        assert N[0] == 0.0 and path["x"] == pytest.approx(along[1:] / (0.64 * N[1:]), rel=1e-6)
        assert path["y"] == pytest.approx(run.joint("M_T")[1:, 0] / (0.64 * N[1:] * radius), rel=1e-6)


def test_many_frames_are_thinned_to_a_bounded_size(tmp_path, monkeypatch):
    monkeypatch.setattr(content, "MOST_BYTES", 24 * 2 * 10)
    with history.read(written(tmp_path / "run.h5", frames=100, rows=5)) as run:
        chosen = content.chosen_frames(run)
        assert chosen.number.tolist() == [0, 11, 22, 33, 44, 55, 66, 77, 88, 99]
        assert "10 of 100 recorded frames" in page.document(run)


def test_a_run_that_diverged_is_shown_up_to_there(tmp_path):
    poses, results = cases.frames(0, 5), {"error": "the run diverged", "yield_point": None}
    poses[1][3:] = np.nan
    with cases.written(tmp_path / "run.h5", cases.record(0, 9), poses, status="failed", results=results) as run:
        text = page.document(run)
    assert len(data_of(text)["time"]) == 3 and "the run diverged" in text


def test_key_results_stand_in_the_page_with_error_bars(lab_page):
    run, path = lab_page
    text = path.read_text(encoding="utf-8")
    point = run.yield_point
    (shown,) = re.findall(r'<th scope="row">limit load V</th><td>([\d.]+) ± ([\d.]+) N', text)
    V, bar = map(float, shown)
    assert V == pytest.approx(point.V, abs=0.05 * point.half_width) and bar < 1.15 * point.half_width
    assert V - bar <= point.V_lower and point.V_upper <= V + bar
    assert "certified" in text and run.scenario.title in text
    told = re.sub(r'"[A-Za-z0-9+/]{16,}=*"', "", text.replace("http://www.w3.org/2000/svg", ""))  # no packed data
    assert not re.findall(r"(?:https?:)?//[a-z]", told), "an outside address"


def test_torsion_centre_moves_from_the_elastic_to_the_plastic_one(lab_page):
    """The elastic centre is at -(sum k r^2 / sum k) / e = -c^2 / e for four corners at c and a force at e = 0.135 m."""
    run, path = lab_page
    data = data_of(path.read_text(encoding="utf-8"))
    x = np.array([place[0] for place in data["centre"]["places"] if place])
    assert x[1] == pytest.approx(-(0.15**2 + 0.1**2) / 0.135, rel=1e-4)
    assert x[-1] == pytest.approx(run.yield_point.torsion_centre[0], rel=2e-2)


def test_torsion_centres_are_those_between_the_frames_shown(lab_page, monkeypatch):
    run, _ = lab_page
    monkeypatch.setattr(content, "MOST_FRAMES", 7)
    with history.read(run.history) as found:
        data, motion = data_of(page.document(found)), JointMotion(found)
        frames = content.chosen_frames(found).number.tolist()
        assert len(frames) == 7 and max(np.diff(frames)) > 1
        places = data["centre"]["places"]
        assert places[0] is None and len(places) == 7
        for k, since, place in zip(frames[1:], frames[:-1], places[1:], strict=True):
            # the joint lies in the plane z = 0 with its centre at the origin of the scene
            assert place == pytest.approx([*motion.torsion_centre(k, since)[0], 0.0], rel=1e-9, abs=1e-12)


def test_text_of_a_history_is_escaped(tmp_path):
    path = evil_history(tmp_path / "evil.h5")
    page.write(path, tmp_path / "evil.html")
    text = (tmp_path / "evil.html").read_text(encoding="utf-8")
    assert text.count("<script") == text.count("</script") == 2
    assert "<img" not in text and "<!--" not in text
    assert "$title ${data}" in text  # shown literally, not substituted
    data_of(text)


@pytest.mark.parametrize(
    "results",
    [{}, {"yield_point": [1]}, {"yield_point": {"V": "x", "torsion_centre": [None, 1]}}, {"yield_point": {"V": 1e999}}],
)
def test_results_of_any_kind_give_a_page(tmp_path, results):
    with history.read(written(tmp_path / "run.h5", results)) as run:
        data_of(page.document(run))


def test_what_cannot_be_shown_is_said(tmp_path):
    with pytest.raises(OutputError, match=r"end in \.html"):
        page.write(written(tmp_path / "run.h5"), tmp_path / "page.xml")
    with pytest.raises(OutputError, match="does not exist"):
        page.write(tmp_path / "run.h5", tmp_path / "nowhere" / "no" / "page.html")
    with pytest.raises(HistoryError, match="no frames"):
        page.write(written(tmp_path / "bare.h5", frames=0), tmp_path / "page.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bare.h5", "run.h5"]


def test_scenes_without_jacks_or_rows(tmp_path):
    moving = written(tmp_path / "run.h5", {}, assembly=cases.mixed_assembly(), control=cases.MOTION)
    with history.read(moving) as run:
        data = data_of(page.document(run))
    assert data["curve"]["title"] == "Displacement over time" and data["actuators"] == [] and data["load"] is None
    with history.read(written(tmp_path / "bare.h5", {}, rows=0)) as run:
        data = data_of(page.document(run))
    assert data["path"] is None and data["curve"]["y"][-1] > 0.0


def test_the_command_writes_it(tmp_path, capsys):
    path = written(tmp_path / "run.h5")
    assert main(["render", str(path), "--to", str(tmp_path / "page.html")]) == 0
    assert "page.html" in capsys.readouterr().out
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_the_slider_of_the_magnification_reaches_what_comes_before_a_limit(tmp_path):
    """For 10 um before the limit and 10 mm at it, the slider starts at a factor of 2 and reaches more than 2000."""
    displacement, turns = np.zeros((3, 2, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (3, 2, 1))
    displacement[1, 1, 0], displacement[2, 1, 0] = 1e-5, 1e-2
    poses = np.arange(3.0), displacement, turns
    rows = cases.record(0, 3) | {"time": np.arange(3.0)}
    for control, most in ((YieldControl(), 4.0), (cases.CONSTANT_RATE, 1.0)):
        with cases.written(tmp_path / f"{control.kind}.h5", rows, poses, control=control) as found:
            told = content.collect(found)["magnification"]
        assert told["start"] == pytest.approx(np.log10(2.0)) and told["most"] == most


def test_torsion_that_is_rounding_is_not_read_out(tmp_path):
    rows = cases.record(0, 5)
    rows["joint"][:, 0, :4] = [1e4, 0.0, 5e3, 1e-4]
    rows["joint"][-1, 0, 3] = 2e-2
    with cases.written(tmp_path / "run.h5", rows, cases.frames(0, 4)) as found:
        (torsion,) = (one for one in content.collect(found)["readout"] if one["name"] == "torsion")
        assert torsion["values"][0] == 0.0 and set(torsion["values"]) <= {0.0, 0.02}


def test_torsion_is_read_out_with_the_sign_it_was_recorded_with(tmp_path):
    rows = cases.record(0, 5)
    rows["joint"][:, 0, :4] = [1e4, 0.0, 5e3, 0.0]
    rows["joint"][:, 0, 3] = -20.0 * np.arange(5.0)
    with cases.written(tmp_path / "run.h5", rows, cases.frames(0, 4)) as found:
        told = content.collect(found)
    (torsion,) = (one for one in told["readout"] if one["name"] == "torsion")
    assert min(torsion["values"]) < 0.0 == max(torsion["values"])
    assert told["path"]["yName"] == "torsion -M_T [N m]"
