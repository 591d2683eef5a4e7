"""Movies, the selection of their frames, and the slider of a window."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.errors import MissingDependency, OutputError, ScenarioError, WriteError
from dembrick.runs.simulate import simulate
from dembrick.views import export, plot, render
from dembrick.views.render import scene
from helpers.places import SCENARIOS
from helpers.scenes import drawn, in_picture

pyvista = pytest.importorskip("pyvista")


def at_times(times, **more):
    """A stand-in for a history with the attributes that the selection of frames reads."""
    return SimpleNamespace(n_frames=len(times), frame_time=np.array(times), counts_equilibria=False, path="-", **more)


def test_a_movie_takes_its_frames_evenly_in_time():
    """Frames are chosen at even times, however they were recorded; each is shown while it is the nearest in time."""
    even = np.append(0.01 * np.arange(41), 0.403)
    assert render.movie_frames(at_times(even), 100) == list(range(42))  # the last one is at the end of the run
    chosen = render.movie_frames(at_times(0.01 * np.arange(401)), 101)
    assert chosen == list(range(0, 401, 4))
    # recorded at equal steps of an angle that grows with the square of time
    times = np.sqrt(np.linspace(0.0, 4.0, 1001))
    chosen = render.movie_frames(at_times(times), 51)
    assert len(chosen) == 51 and chosen[0] == 0 and chosen[-1] == 1000
    # as even as possible: none is further from the wanted time than half the gap between frames there
    wanted = np.linspace(0.0, 2.0, 51)
    gap = np.interp(wanted, times[1:], np.diff(times))
    assert (np.abs(times[chosen] - wanted) <= 0.5 * np.maximum(gap, 1e-12) + 0.02 * (wanted < 0.1)).all()
    held = render.movie_frames(at_times([0.0, 0.1, 0.2, 1.0]), 11)
    assert held == [0, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3] or held == [0, 1, 2, 2, 2, 2, 3, 3, 3, 3, 3]
    assert render.movie_frames(at_times([0.5]), 10) == [0] and render.movie_frames(at_times([0.0, 0.0]), 10) == [0, 1]


def test_equilibria_are_no_times(tmp_path, drawing):
    """In a run of equilibria, not in real time, picture, diagrams, table and file count equilibria, not seconds."""
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


def test_a_movie_takes_the_ffmpeg_of_the_path(run, tmp_path, monkeypatch, drawing):
    """A system ffmpeg on the PATH is used without imageio-ffmpeg, and its error message is passed on."""
    ours = pytest.importorskip("imageio_ffmpeg")
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "ffmpeg").symlink_to(ours.get_ffmpeg_exe())
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", str(folder))
    render.movie(run, tmp_path / "odd.mp4", size=(321, 241), fps=10)
    stream = ours.read_frames(str(tmp_path / "odd.mp4"))
    told = next(stream)
    assert told["fps"] == pytest.approx(10.0) and told["size"] == (322, 242) and len(list(stream)) == 4
    (folder / "ffmpeg").unlink()
    (folder / "ffmpeg").write_text("#!/bin/sh\necho Unknown encoder libx264 >&2\nexit 1\n")
    (folder / "ffmpeg").chmod(0o755)
    with pytest.raises(WriteError, match="Unknown encoder libx264"):
        render.movie(run, tmp_path / "none.mp4")
    assert not (tmp_path / "none.mp4").exists()


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
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingDependency, match="pip install imageio-ffmpeg"):
        render.movie(run, tmp_path / "a.mp4")
    assert main(["render", run.path, "--to", str(tmp_path / "a.mp4")]) == 4
    monkeypatch.setattr(scene.Scene, "show", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError):
        render.movie(run, tmp_path / "a.gif")
    assert [p.name for p in tmp_path.iterdir()] == ["run.h5"]


@pytest.mark.parametrize(
    "name, words, said",
    [
        ("a.png", ["--fps", "10"], "--fps belongs to a movie"),
        ("a.png", ["--count", "10"], "--count belongs to a movie"),
        ("a.gif", ["--frame", "last"], "--frame belongs to a picture"),
        ("a.html", ["--time", "0"], "--time belongs to a picture"),
    ],
)
def test_options_of_the_other_kind_are_refused(run, tmp_path, capsys, name, words, said):
    assert main(["render", run.path, "--to", str(tmp_path / name), *words]) == 2
    assert said in capsys.readouterr().err and not (tmp_path / name).exists()


def test_the_slider_moves_the_block(run, drawing):
    plotter, keys = pyvista.Plotter(off_screen=True, window_size=[320, 240]), {}
    plotter.add_key_event = keys.__setitem__
    try:
        found = render.with_slider(plotter, run, render.Look(magnification=1.0))
        assert found.frame == 3
        # nothing is drawn behind the slider, which lies below 0.17 of the height
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
