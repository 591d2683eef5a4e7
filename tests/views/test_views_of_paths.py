"""Views of a history given by its path equal those of the opened history."""

import numpy as np
import pytest

import dembrick


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.h5"
    dembrick.simulate(dembrick.load("set4a_curve", ["output.rows=40", "output.frames=5"]), path)
    return path


def lines(figure):
    return [line.get_xydata() for axes in figure.axes for line in axes.lines]


def test_figures(path):
    for name in ("force_displacement", "energies", "unbalanced", "load_path", "joint_stages", "layout"):
        draw = getattr(dembrick.plot, name)
        with dembrick.read_history(path) as found:
            expected = lines(draw(found))
        for given in (path, str(path), [path]):
            drawn = lines(draw(given))
            assert len(drawn) == len(expected), name
            assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(drawn, expected, strict=True)), name


def test_blocks_and_pictures(path, tmp_path):
    with dembrick.read_history(path) as found:
        dembrick.render.picture(found, tmp_path / "open.png", size=(200, 150))
        expected = dembrick.render.meshes(found, -1)
    assert np.array_equal(dembrick.render.meshes(str(path), -1)[0].points, expected[0].points)
    dembrick.render.picture(str(path), tmp_path / "named.png", size=(200, 150))
    assert (tmp_path / "named.png").read_bytes() == (tmp_path / "open.png").read_bytes()


def test_exports(path, tmp_path):
    dembrick.export(str(path), tmp_path / "run.csv")
    assert len((tmp_path / "run.csv").read_text().splitlines()) > 30
    with pytest.raises(dembrick.HistoryError, match="no such file"):
        dembrick.export(tmp_path / "none.h5", tmp_path / "none.csv")
