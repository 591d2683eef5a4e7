"""Histories in other libraries: h5py beside our reader, pandas and xarray."""

import sys

import h5py
import numpy as np
import pytest

import dembrick


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "set4a.h5"
    return dembrick.simulate(dembrick.load("set4a", ["output.rows=40", "output.frames=20"]), path), path


def test_h5py_opens_a_history_that_is_open_and_the_other_way_round(run):
    _, path = run
    with dembrick.read_history(path) as ours, h5py.File(path) as theirs:
        assert np.array_equal(ours.load, theirs["history/load"][: ours.n_row])
    with h5py.File(path) as theirs, dembrick.read_history(path) as ours:
        assert np.array_equal(ours.load, theirs["history/load"][: ours.n_row])
    with h5py.File(path, locking=False), dembrick.read_history(path) as ours:
        assert ours.n_row > 1


def test_a_history_gives_the_tables_that_its_result_gives(run):
    pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
    result, path = run
    with dembrick.read_history(path) as found:
        pandas.testing.assert_frame_equal(found.to_pandas(), result.to_pandas())
        xarray.testing.assert_identical(found.to_xarray(), result.to_xarray())
        assert np.array_equal(found.to_xarray()["load"], result.load)


@pytest.mark.parametrize("package", ["pandas", "xarray"])
def test_a_table_without_its_library_says_what_to_install(run, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with (
        dembrick.read_history(run[1]) as found,
        pytest.raises(dembrick.MissingDependency, match=f"pip install {package}"),
    ):
        getattr(found, f"to_{package}")()


def test_a_closed_history_says_so(run):
    """The error names the closed file; it once was a ValueError of h5py, or a report of damaged attributes."""
    found = dembrick.read_history(run[1])
    assert len(found.load) == found.n_row
    found.close()
    assert len(found.load) == found.n_row  # data already read stay
    asked = (lambda: found.displacement, lambda: found.results, lambda: found.block_names, found.to_pandas,
             lambda: found.series("load"), lambda: found.frame_values("position", 0, 1))  # fmt: skip
    for ask in asked:
        with pytest.raises(dembrick.HistoryError, match="set4a.h5: this history is closed; open it again"):
            ask()
    found.close()
