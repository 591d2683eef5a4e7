"""Pictures of blocks: geometry of the meshes, files, and what is said where nothing can be drawn."""

import history_cases as cases
import numpy as np
import pytest

from dembrick import history, render
from dembrick.errors import HistoryError, MissingDependency, OutputError, ScenarioError

pytest.importorskip("pyvista")


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
def test_pictures_are_written_and_not_blank(run, tmp_path, view):
    import pyvista

    try:
        render.require_drawing()
    except MissingDependency as error:
        pytest.skip(str(error))
    path = tmp_path / f"{view}.png"
    assert render.picture(run, path, view=view, size=(400, 300)) == str(path)
    pixels = pyvista.read(path)["PNGImage"].reshape(300, 400, -1)
    inked = (pixels[..., :3] < 200).any(axis=2).mean()
    assert (pixels[0, 0, :3] == 255).all() and 0.05 < inked < 0.9
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
    monkeypatch.setattr(render, "_PROBE", "import os; os.abort()")
    render.require_drawing.cache_clear()
    with pytest.raises(MissingDependency, match="libegl1 libgl1-mesa-dri"):
        render.picture(run, tmp_path / "a.png")
    render.require_drawing.cache_clear()
    assert not (tmp_path / "a.png").exists()


def test_a_history_without_frames_is_said(tmp_path):
    with history.HistoryWriter(
        tmp_path / "bare.h5", cases.SCENARIO, cases.assembly(), {}, channels=("joints",)
    ) as writer:
        writer.append(cases.record(0, 3))
        writer.finish("yield", {})
    with history.read(tmp_path / "bare.h5") as bare, pytest.raises(HistoryError, match="no frames"):
        render.picture(bare, tmp_path / "a.png")
