"""Pictures of blocks: geometry of the meshes, files, and messages if nothing can be drawn."""

from contextlib import nullcontext

import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.errors import HistoryError, MissingDependency, OutputError, ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.views import render
from dembrick.views.motion.frames import frame_number
from dembrick.views.motion.joints import JointMotion
from dembrick.views.page import content
from dembrick.views.render import images, scene, screen
from dembrick.views.render.look import VIEWS
from helpers import history_cases as cases
from helpers.places import SCENARIOS
from helpers.scenes import drawn, in_picture, rodrigues

pyvista = pytest.importorskip("pyvista")


def pixels(path):
    image = pyvista.read(path)
    return image["PNGImage"].reshape(image.dimensions[1], image.dimensions[0], -1)[..., :3]


@pytest.mark.parametrize("factor", [0.0, 1.0, 10.0])
def test_meshes_are_the_moved_blocks(run, factor):
    blocks = render.meshes(run, 3, factor)
    assert blocks.keys() == ["lower", "upper"] and blocks["upper"].n_cells == 6
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turned = rodrigues(run.block_vertices(1), axis, factor * 0.03)
    expected = run.position0[1] + factor * run.frame("displacement", 3)[1] + turned
    np.testing.assert_allclose(blocks["upper"].points, expected, atol=1e-7)
    moved = rodrigues(run.block_vertices(1), axis, 0.03) + run.frame("displacement", 3)[1] - run.block_vertices(1)
    np.testing.assert_allclose(blocks["upper"]["displacement"], np.linalg.norm(moved, axis=1), rtol=1e-9)
    np.testing.assert_allclose(blocks["lower"]["displacement"], 0.0)


def test_magnification_makes_motion_visible_and_never_shrinks_it(run):
    assert render.automatic_magnification(run, 0) == 1.0
    factor = render.automatic_magnification(run, 3)
    assert factor == 2.0  # rounded down from 0.12 x 0.3 m / 10.2 mm = 3.5
    assert frame_number(run, time=2.1e-4) == 2


def test_what_comes_back_is_magnified_by_its_greatest_motion_in_the_frames_that_are_drawn(tmp_path, drawing):
    """The largest displacements 10.2, 1.02 and 0.0102 mm give 3.5, 35 and 3,500 up to 0.12 x 0.3 m, rounded down."""
    rows, poses = cases.record(0, 5), cases.to_and_fro()
    with cases.written(tmp_path / "run.h5", rows, poses, status="yield") as found:
        expected = {(0, 1, 2, 3): 2.0, (0, 2, 3): 20.0, (3,): 2000.0, (0,): 1.0}
        for frames, factor in expected.items():
            with drawn(found, frames=frames) as shown:
                assert ("true scale" if factor == 1.0 else f"motion x {factor:g}\n") in shown._text.input
            assert render.automatic_magnification(found, frames) == factor
        with render._scenes([found] * 2, render.Look(), [[0, 1], [2, 3]], (320, 240), smooth=False) as scenes:
            assert all("motion x 2\n" in own._text.input for own in scenes)
        assert content.collect(found)["magnification"]["start"] == pytest.approx(np.log10(2.0))


def test_frames_that_are_not_finite_are_not_magnified(tmp_path):
    time, displacement, orientation = cases.to_and_fro()
    displacement[3, 1] = np.nan
    rows, poses = cases.record(0, 5), (time, displacement, orientation)
    with cases.written(tmp_path / "run.h5", rows, poses, status="yield") as found:
        assert render.automatic_magnification(found, range(4)) == 2.0


def test_joints_are_not_shown_compressed_by_more_than_a_quarter_of_a_block(tmp_path):
    """Slabs 0.1 m thick on a slope of 3 m, whose motion at the limit is mostly compression of the joints."""
    path = tmp_path / "slope.h5"
    simulate(toml.load(SCENARIOS / "slope_weak_joints.toml"), path)
    with history.read(path) as found:
        limit = frame_number(found)
        factor = render.automatic_magnification(found, limit)
        sunk = -JointMotion(found).at([limit]).relative.plane[0, :, 0].min()
    assert 0.01 < factor * sunk <= 0.025


@pytest.mark.parametrize("view", list(VIEWS))
def test_pictures_are_written_and_not_blank(run, tmp_path, view, drawing):
    path = tmp_path / f"{view}.png"
    assert render.picture(run, path, view=view, size=(400, 300)) == str(path)
    image = pixels(path)
    inked = (image < 200).any(axis=2).mean()
    assert image.shape == (300, 400, 3) and (image[0, 0] == 255).all() and 0.05 < inked < 0.9
    assert not [p.name for p in tmp_path.iterdir() if p.name.endswith(".part")]


def test_errors(run, tmp_path, monkeypatch):
    with pytest.raises(OutputError, match="PNG"):
        render.picture(run, tmp_path / "a.bmp")
    with pytest.raises(OutputError, match="does not exist"):
        render.picture(run, tmp_path / "nowhere" / "no" / "a.png")
    with pytest.raises(ScenarioError, match="iso, front, back, iso-back, side, top"):
        render.picture(run, tmp_path / "a.png", view="below")
    with pytest.raises(ScenarioError, match="frames 0 to 3"):
        render.picture(run, tmp_path / "a.png", frame=4)
    with pytest.raises(ScenarioError, match="runs from 0 to 0.0003 s"):
        render.picture(run, tmp_path / "a.png", time=0.01)
    with pytest.raises(ScenarioError, match="64 to 8192"):
        render.picture(run, tmp_path / "a.png", size=(10, 100))
    monkeypatch.setattr(screen, "PROBE", "import os; os.abort()")
    screen.require_drawing.cache_clear()
    with pytest.raises(MissingDependency, match="libegl1 libgl1-mesa-dri"):
        render.picture(run, tmp_path / "a.png")
    screen.require_drawing.cache_clear()
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("probe, works", [("import os; os.abort()", False), ("pass", True)])
def test_a_trial_that_was_begun_ahead_is_the_one_that_counts(monkeypatch, probe, works):
    monkeypatch.setattr(screen, "PROBE", probe)
    screen.require_drawing.cache_clear()
    screen.expect_drawing()
    monkeypatch.setattr(screen, "PROBE", "pass" if not works else "import os; os.abort()")  # outcome of a second trial
    with nullcontext() if works else pytest.raises(MissingDependency, match="libegl1 libgl1-mesa-dri"):
        screen.require_drawing()
    screen.require_drawing.cache_clear()


def test_a_history_without_frames_is_said(tmp_path):
    written = cases.written(tmp_path / "bare.h5", cases.record(0, 3), channels=("joints",))
    with written as bare, pytest.raises(HistoryError, match="no frames"):
        render.picture(bare, tmp_path / "a.png")


def test_a_scene_is_moved_in_place(run, drawing):
    with drawn(run, frames=range(4), magnification=10.0) as found:
        mesh = found._meshes[0]
        for k in (3, 0, 2):
            found.show(k)
            assert found._meshes[0] is mesh
            expected = np.concatenate([m.points for m in render.meshes(run, k, 10.0)])
            np.testing.assert_allclose(mesh.points, expected, rtol=0, atol=1e-12)
            moved = np.concatenate([m["displacement"] for m in render.meshes(run, k)])
            np.testing.assert_allclose(mesh["shown"], 1e3 * moved, rtol=1e-9, atol=1e-12)  # in mm
            load = run.load[np.argmin(np.abs(run.time - run.frame_time[k]))]
            assert f"\ntime {1e-4 * k:.4g} s, V {load:.4g} N, motion x 10\n" in found._text.input
            assert found._plotter.scalar_bars.keys() == {found._scale.title + "\n"}
        assert found._scale.title == "displacement\nof each point [mm]"
        top = np.concatenate([m["displacement"] for m in render.meshes(run, 3)]).max()
        assert found._scale.top == pytest.approx(1e3 * top)
        (bar,) = found._plotter.scalar_bars.values()
        assert bar.GetLookupTable().GetTableRange() == pytest.approx((0.0, 1e3 * top), rel=1e-12)
        # the jack pushes along y at a point in the joint that moves with the upper block: the arrow ends where its
        # line of action meets the block, 0.1 m before that point
        turned = rodrigues(np.array([[0.075, 0.0, -0.05]]), np.array([1.0, 2.0, -2.0]) / 3.0, 10.0 * 0.02)[0]
        tip = np.array([0.0, 0.0, 0.05]) + 10.0 * run.frame("displacement", 2)[1] + turned
        arrows = found._loads.driven.arrows
        np.testing.assert_allclose(arrows.points[0] + arrows["vector"][0], tip - [0.0, 0.1, 0.0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(arrows["vector"][0] / arrows["length"][0], [0.0, 1.0, 0.0], atol=1e-12)


def test_colours_by_block(run, drawing):
    motion = JointMotion(run)
    with drawn(run, color="utilisation") as found:
        np.testing.assert_allclose(found._meshes[0].cell_data["shown"], motion.at([3]).utilisation[0][0], rtol=1e-12)
        assert found._scale.top == 1.0
    with drawn(run, color="slip") as found:
        slip = motion.at([3]).resultants[0][0, 6]
        np.testing.assert_allclose(found._meshes[0].cell_data["shown"], found._scale.factor * slip, rtol=1e-12)
    with drawn(run, color="energy") as found:
        # between frames 2 and 3: 2 mm in 0.1 ms, 0.01 rad in 0.1 ms about (1, 2, -2)/3
        spin = 0.5 * 1e4 * (0.0375 + 4 * 0.075 + 4 * 0.0975) / 9
        expected = 0.5 * 9.0 * (400 + 9e-4 + 1e-10) + spin
        np.testing.assert_allclose(found._meshes[0].cell_data["shown"], found._scale.factor * expected, rtol=1e-6)
        assert found._scale.title == "kinetic energy [J]"


def test_units_follow_the_size(run, drawing):
    with drawn(run) as found:
        titles = [found._colouring.scale(size).title for size in (3.0, 0.1, 0.0999, 2e-5, 1.1e-7, 9e-8, 0.0)]
    units = ["m", "mm", "mm", "µm", "µm", "nm", "m"]
    assert titles == [f"displacement\nof each point [{unit}]" for unit in units]


@pytest.mark.parametrize(
    "view, right, up",
    [
        ("front", (1, 0, 0), (0, 0, 1)),  # from negative y
        ("side", (0, 1, 0), (0, 0, 1)),  # from positive x
        ("top", (1, 0, 0), (0, 1, 0)),
        ("iso", (1.5, 1, 0), None),  # from positive x, negative y and above
        ("iso-back", (-1.5, 1, 0), None),
    ],
)
def test_the_camera_stands_where_its_name_says(run, view, right, up, drawing):
    with drawn(run, view=view) as found:
        x, y = in_picture(found._plotter, np.vstack([np.zeros(3), np.eye(3)]))
        x, y = x[1:] - x[0], y[1:] - y[0]
        np.testing.assert_allclose(x / np.linalg.norm(x), np.array(right) / np.linalg.norm(right), atol=1e-12)
        if up is None:
            assert y[2] > 0.0 > y[0] and y[1] * right[0] > 0.0  # x comes nearer, y goes away or comes nearer too
        else:
            np.testing.assert_allclose(y / np.linalg.norm(y), up, atol=1e-12)


def test_a_png_holds_the_pixels_it_was_given(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    images.write_png(image, str(tmp_path / "a.png"))
    found = pytest.importorskip("PIL.Image").open(tmp_path / "a.png")
    np.testing.assert_array_equal(np.asarray(found), image)


@pytest.mark.parametrize("view", list(VIEWS))
def test_the_motion_fits_into_the_picture(run, view, drawing):
    """All corners, at the start and in every frame, lie in the part of the picture reserved for them."""
    with drawn(run, frames=range(4), view=view, magnification=20.0) as found:
        corner = np.concatenate([np.concatenate([m.points for m in render.meshes(run, k, 20.0)]) for k in range(4)])
        x, y = in_picture(found._plotter, corner)
        assert scene._LEFT - 1e-9 <= x.min() < x.max() <= scene._RIGHT + 1e-9
        assert scene._BOTTOM - 1e-9 <= y.min() < y.max() <= scene._TOP + 1e-9


def test_what_was_not_recorded_cannot_be_shown(tmp_path, drawing):
    with cases.written(tmp_path / "few.h5", cases.record(0, 5), cases.frames(0, 4), channels=("frames",)) as few:
        for look in ({"color": "utilisation"}, {"color": "slip"}, {"forces": True}):
            with pytest.raises(HistoryError, match="joints.*output.channels"):
                render.picture(few, tmp_path / "a.png", **look)


def test_command_line(run, tmp_path, capsys, drawing):
    small = ["--size", "160", "120"]
    assert main(["render", run.path, "--to", str(tmp_path / "a.png"), "--time", "2e-4", "--color", "slip", *small]) == 0
    assert main(["render", run.path, "--to", str(tmp_path / "a.gif"), "--camera", "top", "--magnify", "5", *small]) == 0
    for name, moment in (("b", {"time": 2e-4}), ("c", {"frame": 3})):
        render.picture(run, tmp_path / f"{name}.png", color="slip", size=(160, 120), **moment)
    assert (pixels(tmp_path / "a.png") == pixels(tmp_path / "b.png")).all()
    assert (pixels(tmp_path / "a.png") != pixels(tmp_path / "c.png")).any()
    assert capsys.readouterr().out.split() == ["picture:", str(tmp_path / "a.png"), "movie:", str(tmp_path / "a.gif")]


def test_view_without_a_display_says_so(run, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert main(["view", run.path]) == 4
    assert "no display" in capsys.readouterr().err
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.setattr(screen, "PROBE", "import os; os.abort()")
    assert main(["view", run.path]) == 4
    assert "libgl1" in capsys.readouterr().err


@pytest.mark.parametrize("written", [False, True])
def test_meshes_of_a_result_in_one_call(tmp_path, written):
    """The upper block of set 4a turns about a centre at negative x, so corners at positive x move more."""
    path = tmp_path / "set4a.h5" if written else None
    result = simulate(SCENARIOS / "set4a.toml", path)
    blocks = result.meshes()
    assert blocks.keys() == ["lower", "upper"]
    upper = blocks["upper"]
    start = result.assembly.position[1] + result.assembly.shapes[1].vertices
    moved = result.frames["displacement"][-1, 1] if not written else upper.points.mean(axis=0) - [0, 0, 0.05]
    np.testing.assert_allclose(upper.points.mean(axis=0) - start.mean(axis=0), moved, atol=1e-9)
    size = upper["displacement"]
    np.testing.assert_allclose(np.linalg.norm(upper.points - start, axis=1), size, atol=1e-12)
    assert size[start[:, 0] > 0].min() > 2 * size[start[:, 0] < 0].max() > 0
    assert result.meshes(time=0.0)["upper"]["displacement"].max() < 0.5 * size.max()


def test_a_result_without_a_record_has_no_meshes():
    result = simulate(SCENARIOS / "set4a.toml", record=False)
    with pytest.raises(HistoryError, match="record=True"):
        result.meshes()
