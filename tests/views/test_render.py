"""Pictures of blocks: geometry of the meshes, files, and what is said where nothing can be drawn."""

from contextlib import contextmanager
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.errors import HistoryError, MissingDependency, OutputError, ScenarioError
from dembrick.geometry.shapes import box
from dembrick.runs.simulate import simulate
from dembrick.scenario.model import CHANNELS
from dembrick.views import export, plot, render
from dembrick.views.motion.joints import JointMotion
from dembrick.views.render import images, scene, screen
from helpers import history_cases as cases
from helpers.places import SCENARIOS

pyvista = pytest.importorskip("pyvista")


def pixels(path):
    image = pyvista.read(path)
    return image["PNGImage"].reshape(image.dimensions[1], image.dimensions[0], -1)[..., :3]


@contextmanager
def drawn(run, frames=(3,), **look):
    """A scene off screen, small."""
    plotter = pyvista.Plotter(off_screen=True, window_size=[320, 240])
    try:
        yield scene.Scene(plotter, run, render.Look(**look), frames)
    finally:
        plotter.close()


@pytest.fixture
def run(tmp_path):
    with history.HistoryWriter(tmp_path / "run.h5", cases.SCENARIO, cases.assembly(), {}) as writer:
        writer.append(cases.record(0, 5))
        writer.append_frames(*cases.frames(0, 4))
        writer.finish("yield", {"title": "two blocks", "yield_point": {"torsion_centre": [-0.05, 0.0]}})
    with history.read(tmp_path / "run.h5") as found:
        yield found


def rodrigues(v, axis, angle):
    return v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + np.outer(v @ axis, axis) * (1 - np.cos(angle))


@pytest.mark.parametrize("factor", [0.0, 1.0, 10.0])
def test_meshes_are_the_moved_blocks(run, factor):
    blocks = render.meshes(run, 3, factor)
    assert blocks.keys() == ["lower", "upper"] and blocks["upper"].n_cells == 6
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turned = rodrigues(run.block_vertices(1), axis, factor * 0.03)
    expected = run.position0[1] + factor * run.frame_displacement(3)[1] + turned
    np.testing.assert_allclose(blocks["upper"].points, expected, atol=1e-7)
    moved = rodrigues(run.block_vertices(1), axis, 0.03) + run.frame_displacement(3)[1] - run.block_vertices(1)
    np.testing.assert_allclose(blocks["upper"]["displacement"], np.linalg.norm(moved, axis=1), rtol=1e-9)
    np.testing.assert_allclose(blocks["lower"]["displacement"], 0.0)


def test_magnification_makes_motion_visible_and_never_shrinks_it(run):
    assert render.automatic_magnification(run, 0) == 1.0
    factor = render.automatic_magnification(run, 3)
    assert factor == 2.0  # 0.12 x 0.3 m over 10.2 mm is 3.5
    assert render.nearest_frame(run, 2.1e-4) == 2


@pytest.mark.parametrize("view", list(render.VIEWS))
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
        render.picture(run, tmp_path / "nowhere" / "a.png")
    with pytest.raises(ScenarioError, match="iso, front, side, top"):
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


def test_a_history_without_frames_is_said(tmp_path):
    with history.HistoryWriter(
        tmp_path / "bare.h5", cases.SCENARIO, cases.assembly(), {}, channels=("joints",)
    ) as writer:
        writer.append(cases.record(0, 3))
        writer.finish("yield", {})
    with history.read(tmp_path / "bare.h5") as bare, pytest.raises(HistoryError, match="no frames"):
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
        assert found._scale.title == "displacement [mm]"
        top = np.concatenate([m["displacement"] for m in render.meshes(run, 3)]).max()
        assert found._scale.top == pytest.approx(1e3 * top)
        (bar,) = found._plotter.scalar_bars.values()
        assert bar.GetLookupTable().GetTableRange() == pytest.approx((0.0, 1e3 * top), rel=1e-12)
        # the jack pushes along y at a point of the upper block, which moves with it
        turned = rodrigues(np.array([[0.075, 0.0, -0.05]]), np.array([1.0, 2.0, -2.0]) / 3.0, 10.0 * 0.02)[0]
        arrow = np.array(found._actuators[0][0].user_matrix)
        tip = np.array([0.0, 0.0, 0.05]) + 10.0 * run.frame_displacement(2)[1] + turned
        np.testing.assert_allclose(arrow[:3, 3], tip, rtol=0, atol=1e-12)
        np.testing.assert_allclose(arrow[:3, 0] / np.linalg.norm(arrow[:3, 0]), [0.0, 1.0, 0.0], atol=1e-12)


def test_colours_by_block(run, drawing):
    motion = JointMotion(run)
    with drawn(run, color="utilisation") as found:
        np.testing.assert_allclose(found._meshes[0].cell_data["shown"], motion.utilisation(3)[0], rtol=1e-12)
        assert found._scale.top == 1.0
    with drawn(run, color="slip") as found:
        slip = motion.resultants(3)[0, 6]
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
    units = ["m", "m", "mm", "µm", "µm", "nm", "m"]
    assert titles == [f"displacement [{unit}]" for unit in units]


def test_forces_of_joints(run, drawing):
    """The resultant on the upper block, at the centre of pressure, as long as it is large."""
    with drawn(run, forces=True, magnification=1.0) as found:
        arrows = found.arrows.of_joints
        N, V_1, V_2, _, M_1, M_2, _ = JointMotion(run).resultants(3)[0]
        # the axes are those of the upper block, on which the polygon rides, laid into the plane of the lower one
        axis, middle = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([0.0, 0.0, 0.05])
        t1 = rodrigues(np.array([[1.0, 0.0, 0.0]]), axis, 0.03)[0] * [1.0, 1.0, 0.0]
        t1 /= np.linalg.norm(t1)
        axes = np.array([t1, np.cross([0.0, 0.0, 1.0], t1), [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(arrows["force"][0], np.array([-V_1, -V_2, N]) @ axes)
        limit = np.hypot(0.15, 0.1)
        at = np.array([M_2, -M_1, 0.0]) / N
        at *= min(1.0, limit / np.linalg.norm(at))
        place = middle + run.frame_displacement(3)[1] + rodrigues((at - middle)[None], axis, 0.03)[0]
        np.testing.assert_allclose(arrows.points[0], place, atol=1e-12)
        assert arrows["length"][0] == pytest.approx(0.6 * 0.3)
        assert f"green: joint forces, the longest {np.sqrt(V_1**2 + V_2**2 + N**2):.4g} N" in found._text.input
        # blocks shine through: two faces on white, in the bar too
        colour, bar = found._meshes[0], next(iter(found._plotter.scalar_bars.values())).GetLookupTable()
        solid = np.array(next(a for a in found._plotter.actors.values() if a.mapper.dataset is colour).mapper.
                         lookup_table.GetTableValue(255)[:3])  # fmt: skip
        np.testing.assert_allclose(bar.GetTableValue(255)[:3], 1.0 - (1.0 - 0.65**2) * (1.0 - solid), atol=0.01)


def test_forces_ride_on_the_blocks_that_are_drawn(tmp_path, drawing):
    """The second joint of three blocks, whose polygon rides on the third: ten times as far in the picture."""
    assembly = cases.mixed_assembly()
    assembly.orientation[2] = [1.0, 0.0, 0.0, 0.0]
    with history.HistoryWriter(tmp_path / "run.h5", cases.SCENARIO, assembly, {}) as writer:
        writer.append(cases.record(0, 31, 2, 0))
        writer.append_frames(*cases.frames(0, 4, 3))
        writer.finish("completed", {})
    with history.read(tmp_path / "run.h5") as three, drawn(three, forces=True, magnification=10.0) as found:
        N, V_1, V_2, _, M_1, M_2, _ = JointMotion(three).resultants(3)[1]
        at = np.array([M_2, -M_1, 0.0]) / N
        at *= min(1.0, np.hypot(0.15, 0.1) / np.linalg.norm(at))
        axis, middle = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([0.4, 1000.0, 0.2])
        arm = rodrigues((np.array([0.0, 0.0, 0.1]) + at - middle)[None], axis, 10.0 * 0.03)[0]
        expected = middle + 10.0 * three.frame_displacement(3)[2] + arm
        np.testing.assert_allclose(found.arrows.of_joints.points[1], expected, rtol=0, atol=1e-10)
        force = rodrigues(np.array([[-V_1, -V_2, N]]), axis, 0.03)[0]
        np.testing.assert_allclose(found.arrows.of_joints["force"][1], force, rtol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_forces_of_new_contacts(tmp_path, drawing, factor):
    """As many arrows as the frame has, riding on the second block where that is drawn; the others have no length."""
    with cases.open_writer(tmp_path / "run.h5", channels=CHANNELS, control=cases.MOTION) as writer:
        writer.append(cases.moving_record(0, 5))
        still = {"joint_shift": np.zeros((4, 1, 2)), "contact_arm": np.zeros((4, 4, 2))}
        met = cases.new_contacts(0, 4)
        writer.append_frames(*cases.frames(0, 4), **cases.motion(0, 4), **still, new_contacts=met)
        writer.finish("completed", {})
    axis, middle = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([0.0, 0.0, 0.05])
    with history.read(tmp_path / "run.h5") as found, drawn(
        found, frames=(1, 2, 3), forces=True, magnification=factor
    ) as shown:  # fmt: skip
        for frame in (3, 1, 2):
            shown.show(frame)
            arrows, met = shown.arrows.of_new_contacts, cases.new_contacts(frame, frame + 1)
            moved = found.frame_displacement(frame)[1]
            # back to where the block stood, and on as far as it is drawn
            start = rodrigues(met["point"] - middle - moved, axis, -0.01 * frame)
            place = middle + factor * moved + rodrigues(start, axis, factor * 0.01 * frame)
            np.testing.assert_allclose(arrows.points[:frame], place, atol=1e-5)
            np.testing.assert_allclose(arrows["force"][:frame], met["force"])
            size = np.linalg.norm(met["force"], axis=1)
            np.testing.assert_allclose(arrows["length"][:frame] / size, arrows["length"][0] / size[0])
            assert len(arrows["length"]) == 3 and not arrows["length"][frame:].any() and arrows["length"][0] > 0.0
        assert "purple: those of new contacts" in shown._text.input
    with history.HistoryWriter(
        tmp_path / "less.h5", cases.SCENARIO, cases.assembly(), {}, control=cases.MOTION
    ) as writer:
        writer.append(cases.moving_record(0, 5))
        writer.append_frames(*cases.frames(0, 4), joint_shift=np.zeros((4, 1, 2)))
        writer.finish("completed", {})
    with history.read(tmp_path / "less.h5") as found, drawn(found, forces=True) as shown:
        assert "forces of new contacts were not recorded" in shown._text.input


def test_an_impact_leaves_the_other_forces_to_be_seen(tmp_path, drawing):
    """A hundred times the weight in one frame of seven: its arrow is cut, and the picture says so."""
    rows = cases.record(0, 7)
    rows["joint"][..., 0, :] = [10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    rows["joint"][4, 0, 0] = 1000.0
    with history.HistoryWriter(tmp_path / "run.h5", cases.SCENARIO, cases.assembly(), {}) as writer:
        writer.append(rows)
        writer.append_frames(rows["time"], *cases.frames(0, 7)[1:])
        writer.finish("completed", {})
    with history.read(tmp_path / "run.h5") as found:
        with drawn(found, frames=range(7), forces=True) as shown:
            longest, less = shown.arrows.length(10.0), shown.arrows.length(5.0)
            assert less == pytest.approx(longest / 2.0) and "the longest 10 N or more" in shown._text.input
            for frame, length in ((4, longest), (5, longest)):
                shown.show(frame)
                assert shown.arrows.of_joints["length"][0] == pytest.approx(length)
        assert shown.shades(30).shape == (128, 30, 3) and len(np.unique(shown.shades(2).reshape(-1, 3), axis=0)) == 16
        with drawn(found, frames=(4,), forces=True) as shown:
            assert shown._text.input.endswith("the longest 1000 N")


def test_torsion_centre_is_marked_where_it_is(run, drawing):
    centre = JointMotion(run).torsion_centre(3)[0]
    with drawn(run) as found:
        if np.linalg.norm(centre) > 0.6 or np.isnan(centre).any():
            assert not found._rod.visibility and "torsion centre" not in found._text.input
        else:
            np.testing.assert_allclose(found._rod.user_matrix[:2, 3], centre)
        found.show(0)
        assert not found._rod.visibility and "blue" not in found._text.input


def in_picture(plotter, points):
    """Where points lie, as parts of the width and of the height of the picture."""
    plotter.render()
    camera, (width, height) = plotter.camera, plotter.window_size
    across = points - np.array(camera.focal_point)
    up = np.array(camera.up)
    right = np.cross(np.array(camera.direction), up)
    x = 0.5 + across @ right / (2 * camera.parallel_scale) * height / width
    return x, 0.5 + across @ up / (2 * camera.parallel_scale)


@pytest.mark.parametrize(
    "view, right, up",
    [
        ("front", (1, 0, 0), (0, 0, 1)),  # from where y is negative
        ("side", (0, 1, 0), (0, 0, 1)),  # from where x is positive
        ("top", (1, 0, 0), (0, 1, 0)),
        ("iso", (-1.5, 1, 0), None),  # from where all are positive
    ],
)
def test_the_camera_stands_where_its_name_says(run, view, right, up, drawing):
    with drawn(run, view=view) as found:
        x, y = in_picture(found._plotter, np.vstack([np.zeros(3), np.eye(3)]))
        x, y = x[1:] - x[0], y[1:] - y[0]
        np.testing.assert_allclose(x / np.linalg.norm(x), np.array(right) / np.linalg.norm(right), atol=1e-12)
        if up is None:
            assert y[2] > 0.0 > max(y[:2])
        else:
            np.testing.assert_allclose(y / np.linalg.norm(y), up, atol=1e-12)


def test_a_png_holds_the_pixels_it_was_given(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    images.write_png(image, "a.png", str(tmp_path / "a.png"))
    found = pytest.importorskip("PIL.Image").open(tmp_path / "a.png")
    np.testing.assert_array_equal(np.asarray(found), image)


@pytest.mark.parametrize("view", list(render.VIEWS))
def test_the_motion_fits_into_the_picture(run, view, drawing):
    """All corners, at the start and in every frame, lie in the part left for them."""
    with drawn(run, frames=range(4), view=view, magnification=20.0) as found:
        corner = np.concatenate([np.concatenate([m.points for m in render.meshes(run, k, 20.0)]) for k in range(4)])
        x, y = in_picture(found._plotter, corner)
        assert scene._LEFT - 1e-9 <= x.min() < x.max() <= scene._RIGHT + 1e-9
        assert scene._BOTTOM - 1e-9 <= y.min() < y.max() <= scene._TOP + 1e-9


@pytest.mark.parametrize("view", ["front", "side"])
def test_the_arrows_of_the_forces_fit_too(tmp_path, view, drawing):
    """As long as the blocks that can move are large, whatever the size of what they stand on."""
    assembly = cases.assembly()
    assembly.shapes = (box((3.0, 2.0, 0.1)), assembly.shapes[1])
    with history.HistoryWriter(tmp_path / "run.h5", cases.SCENARIO, assembly, {}) as writer:
        rows = cases.record(0, 5)
        rows["joint"][..., :3] = (1.0, 0.0, 0.0)
        rows["joint"][-1, 0, :3] = (100.0, 0.0, 0.0)
        rows["joint"][..., 4:6] = 0.0
        writer.append(rows)
        writer.append_frames(np.linspace(0.0, rows["time"][-1], 4), *cases.frames(0, 4)[1:])
        writer.finish("completed", {})
    with history.read(tmp_path / "run.h5") as wide, drawn(wide, forces=True, view=view, magnification=0.0) as found:
        assert found.arrows.of_joints["length"][0] == pytest.approx(0.6 * 0.3)
        middle = np.array([0.0, 0.0, 0.09])
        y = in_picture(found._plotter, np.array([middle, -middle]))[1]
        assert scene._BOTTOM - 1e-9 <= y[1] < y[0] <= scene._TOP + 1e-9


def at_times(times, **more):
    """As much of a history as the choice of frames looks at."""
    return SimpleNamespace(n_frames=len(times), frame_time=np.array(times), counts_equilibria=False, path="-", **more)


def test_a_movie_takes_its_frames_evenly_in_time():
    """Whatever the frames were recorded by; a frame is held as long as it is the nearest one."""
    even = np.append(0.01 * np.arange(41), 0.403)
    assert render.movie_frames(at_times(even), 100) == list(range(42))  # the last comes when the run ends
    chosen = render.movie_frames(at_times(0.01 * np.arange(401)), 101)
    assert chosen == list(range(0, 401, 4))
    # taken every so much of an angle that grows with the square of time
    times = np.sqrt(np.linspace(0.0, 4.0, 1001))
    chosen = render.movie_frames(at_times(times), 51)
    assert len(chosen) == 51 and chosen[0] == 0 and chosen[-1] == 1000
    # as evenly as the frames allow: none is further away than half of the gap that it lies in
    wanted = np.linspace(0.0, 2.0, 51)
    gap = np.interp(wanted, times[1:], np.diff(times))
    assert (np.abs(times[chosen] - wanted) <= 0.5 * np.maximum(gap, 1e-12) + 0.02 * (wanted < 0.1)).all()
    held = render.movie_frames(at_times([0.0, 0.1, 0.2, 1.0]), 11)
    assert held == [0, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3] or held == [0, 1, 2, 2, 2, 2, 3, 3, 3, 3, 3]
    assert render.movie_frames(at_times([0.5]), 10) == [0] and render.movie_frames(at_times([0.0, 0.0]), 10) == [0, 1]


def test_equilibria_are_no_times(tmp_path, drawing):
    """Of a push that is not lived through: the picture, the diagrams, the text and the file say what it counts."""
    result = simulate(SCENARIOS / "oppenheim.toml", tmp_path / "run.h5")
    assert result.counts_equilibria
    with history.read(tmp_path / "run.h5") as found:
        assert found.counts_equilibria and found.frame_time[1] == 1.0
        chosen = render.movie_frames(found, 7)
        assert chosen == np.unique(np.linspace(0, found.n_frames - 1, 7).round().astype(int)).tolist()
        with drawn(found, frames=(1,)) as shown:
            assert "equilibrium 1, " in shown._text.input and "time" not in shown._text.input
        assert plot.unbalanced([found]).axes[0].get_xlabel() == "number of the equilibrium"
        export.to_csv(found, tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text().startswith("equilibrium [1],")
    with h5py.File(tmp_path / "run.h5") as file:
        for name in ("history/time", "frames/time"):
            assert file[name].attrs["units"] == "1" and "number of the equilibrium" in file[name].attrs["description"]


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_movies_move(run, tmp_path, ending, drawing):
    path, seen = tmp_path / f"out.{ending}", []
    if ending == "mp4":
        ffmpeg = pytest.importorskip("imageio_ffmpeg")
    render.movie(run, path, size=(320, 240), fps=10, progress=lambda *at: seen.append(at))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    if ending == "gif":
        image = pytest.importorskip("PIL.Image").open(path)
        assert image.n_frames == 4 and image.info["duration"] == 100
        frames = []
        for k in range(4):
            image.seek(k)
            frames.append(np.asarray(image.convert("RGB"), int))
    else:
        stream = ffmpeg.read_frames(str(path))
        assert next(stream)["fps"] == pytest.approx(10.0)
        frames = [np.frombuffer(frame, np.uint8).reshape(240, 320, 3).astype(int) for frame in stream]
        assert len(frames) == 4
    for first, second in zip(frames, frames[1:], strict=False):
        assert (np.abs(first - second).max(axis=2) > 40).mean() > 0.01
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name, "run.h5"]


def test_a_movie_shows_frames_spread_over_the_run(run, tmp_path, drawing):
    render.movie(run, tmp_path / "out.gif", size=(128, 96), count=2)
    assert pytest.importorskip("PIL.Image").open(tmp_path / "out.gif").n_frames == 2


def test_movie_errors(run, tmp_path, monkeypatch, drawing):
    for wrong, match in (({"fps": 0.0}, "fps"), ({"count": 1}, "count")):
        with pytest.raises(ScenarioError, match=match):
            render.movie(run, tmp_path / "a.gif", **wrong)
    with pytest.raises(OutputError, match=r"\.gif or \.mp4"):
        render.movie(run, tmp_path / "a.avi")
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingDependency, match="pip install imageio-ffmpeg"):
        render.movie(run, tmp_path / "a.mp4")
    assert main(["render", run.path, "--to", str(tmp_path / "a.mp4")]) == 4
    monkeypatch.setattr(scene.Scene, "show", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError):
        render.movie(run, tmp_path / "a.gif")
    assert [p.name for p in tmp_path.iterdir()] == ["run.h5"]


def test_what_was_not_recorded_cannot_be_shown(tmp_path, drawing):
    path, channels = tmp_path / "few.h5", ("frames",)
    with history.HistoryWriter(path, cases.SCENARIO, cases.assembly(), {}, channels=channels) as writer:
        writer.append(cases.record(0, 5))
        writer.append_frames(*cases.frames(0, 4))
        writer.finish("completed", {})
    with history.read(path) as few:
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


def test_the_slider_moves_the_block(run, drawing):
    plotter, keys = pyvista.Plotter(off_screen=True, window_size=[320, 240]), {}
    plotter.add_key_event = keys.__setitem__
    try:
        found = render.with_slider(plotter, run, render.Look(magnification=1.0))
        assert found.frame == 3
        # nothing is drawn behind the slider, which stands at less than 0.17 of the height
        corner = np.concatenate([np.concatenate([m.points for m in render.meshes(run, k)]) for k in range(4)])
        assert 0.17 < in_picture(plotter, corner)[1].min() < 0.25
        slider = plotter.widgets.slider_widgets[0]
        slider.GetRepresentation().SetValue(1.1e-4)
        slider.InvokeEvent("InteractionEvent")
        assert found.frame == 1
        expected = render.meshes(run, 1)["upper"].points
        np.testing.assert_allclose(found._meshes[0].points[8:], expected, atol=1e-12)
        for key, frame in (
            ("Right", 2),
            ("Right", 3),
            ("Right", 3),
            ("Left", 2),
            ("Left", 1),
            ("Left", 0),
            ("Left", 0),
        ):
            keys[key]()
            assert found.frame == frame
            assert slider.GetRepresentation().GetValue() == pytest.approx(1e-4 * frame, rel=1e-6, abs=1e-12)
    finally:
        plotter.close()


@pytest.mark.parametrize("written", [False, True])
def test_meshes_of_a_result_in_one_call(tmp_path, written):
    """The upper block of set 4a turns about a centre behind O: one corner moves more than another."""
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
    assert result.meshes(time=0.0)["upper"]["displacement"].max() < 0.1 * size.max()


def test_a_result_without_a_record_has_no_meshes():
    result = simulate(SCENARIOS / "set4a.toml", record=False)
    with pytest.raises(HistoryError, match="record=True"):
        result.meshes()
