"""Results in Python: pandas and xarray tables, short representations, figures displayed by a notebook."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import dembrick
from dembrick import history
from dembrick.errors import HistoryError
from dembrick.runs import in_memory, lab
from dembrick.scenario.controls import CONTROLS
from dembrick.views.plot.subject import time_name
from helpers.custom_laws import COULOMB
from helpers.scenario_text import block, header

SINKS = (
    header()
    + block("base", (0.0, 0.0, -0.05), more="fixed = true")
    + block("stone", (0.0, 0.0, 0.05))
    + '[control]\nkind = "settlement"\nsupports = ["base"]\ndisplacement = [0.0, 0.0, -1e-3]\n'
)


@pytest.fixture(scope="module")
def result():
    scenario = dembrick.load("set4a")
    channels = dembrick.Output(("joints", "energy", "frames"))
    return dembrick.simulate(dataclasses.replace(scenario, output=channels))


def test_a_table_has_the_series_by_equilibrium(result):
    table = result.to_pandas()
    assert table.index.name == "equilibrium [1]" and len(table) == len(result.rows["time"])
    np.testing.assert_array_equal(table["load [N]"], result.load)
    np.testing.assert_array_equal(table["N lower/upper [N]"], result.rows["joint"][:, 0, 0])
    assert "elastic energy [J]" in table


@pytest.mark.parametrize(
    "name, law, counts",
    [
        ("set4a", None, True),
        ("oppenheim", None, True),
        (SINKS, None, True),
        ("set4a", COULOMB, False),
        ("set4a_curve", None, False),
        ("newmark_pulse", None, False),
    ],
)
def test_rows_are_of_times_or_of_equilibria_in_memory_and_in_files(tmp_path, few, name, law, counts):
    """A search with a user's law is a test in time."""
    changes = [] if law is None else ["joint.formulation=concave"]
    scenario = dembrick.loads(name) if name is SINKS else dembrick.load(name, changes)
    result = dembrick.simulate(scenario, tmp_path / "run.h5", law=law)
    with history.read(tmp_path / "run.h5") as found:
        assert result.counts_equilibria == found.counts_equilibria == counts
        assert found.unit("history/time") == found.unit("time") == ("1" if counts else "s")
        with pytest.raises(KeyError, match="no series 'lod' in .*did you mean 'load'"):
            found.unit("lod")
        named = {time_name(result), time_name(found)}
    assert named == {"number of the equilibrium" if counts else "time [s]"}
    assert result.to_pandas().index.name == ("equilibrium [1]" if counts else "time [s]")


def test_what_is_done_with_the_rows_of_lab_is_no_part_of_its_time(monkeypatch):
    clock, away = lab.time.perf_counter, [0.0]
    monkeypatch.setattr(lab.time, "perf_counter", lambda: clock() + away[0])
    heard = []

    def told(replayed):
        heard.append(len(replayed.rows))
        away[0] += 1e6

    replayed = lab.replay_lab(("2a",), ("concave",), told=told)
    assert heard == [len(replayed.rows)] == [2] and 0.0 < replayed.wall["total"] < 1e5


def test_a_dataset_names_dimensions_and_units(result):
    data = result.to_xarray()
    np.testing.assert_array_equal(data["load"], result.load)
    np.testing.assert_array_equal(data["joint_V_1"].sel(joint="lower/upper"), result.rows["joint"][:, 0, 1])
    moved = data["frame_displacement"].sel(block="upper", axis="y")
    np.testing.assert_array_equal(moved, result.frames["displacement"][:, 1, 1])
    assert moved.attrs["units"] == "m" and data["load"].attrs["units"] == "N"
    assert data["frame_orientation"].dims == ("frame", "block", "quaternion")
    assert data.attrs["status"] == "yield"
    bound = result.rows["upper"] < 1e300
    assert 0 < np.count_nonzero(bound) < len(bound)
    np.testing.assert_array_equal(data["upper"], np.where(bound, result.rows["upper"], np.inf))
    assert data["upper"].attrs["long_name"].endswith("inf means none")
    for name in ("time", "frame_time"):
        assert data[name].attrs == {"units": "1", "long_name": "number of the equilibrium"}


def test_without_a_record_there_is_no_table():
    with pytest.raises(HistoryError, match="record=True"):
        dembrick.simulate("set4a", record=False).to_pandas()


def test_representations_are_short(result):
    assert repr(result).startswith("<Result 'Set 4a") and "yield, limit load V 216.0549 N" in repr(result)
    assert repr(result.scenario).endswith("yield, convex, 2 blocks>")
    assert len(repr(result.assembly)) < 120
    reaction = dembrick.reaction("arch_spread", "arch.right", (-1.0, 0.0, 0.0))
    assert repr(reaction).startswith("<ReactionResult ") and f"{reaction.least.value:.6g} to " in repr(reaction)
    assert len(repr(reaction)) < 150


def test_an_open_history_is_not_pickled(tmp_path):
    dembrick.simulate("set4a", tmp_path / "run.h5")
    with dembrick.read_history(tmp_path / "run.h5") as found, pytest.raises(HistoryError, match="pass on its path"):
        pickle.dumps(found)


def test_every_control_is_at_top_level():
    for control in CONTROLS.values():
        assert getattr(dembrick, control.__name__) is control


def test_modules_are_attributes():
    assert dembrick.plot.force_displacement and dembrick.theory.limit_load and dembrick.generators.Wall is dembrick.Wall


def test_a_bare_notebook_shows_figures(result):
    """Through the hooks that IPython looks up on every object, without pyplot; the figure can still be pickled."""
    figure = pickle.loads(pickle.dumps(result.plot()))
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_history_gives_the_same_table(result):
    from dembrick.views import export

    with in_memory.recording(result) as found:
        assert export.to_pandas(found).equals(result.to_pandas())


def test_remarks_and_answers_are_logged(caplog, capsys):
    """Silent by default; with logging configured, remarks are warnings, and scenario and answer are information."""
    caplog.set_level("INFO", logger="dembrick")
    dembrick.simulate(dembrick.load("set4a", ["materials.tuff.density=150"]), record=False)
    told = [(record.levelname, record.getMessage()) for record in caplog.records if record.name == "dembrick"]
    assert any(level == "WARNING" and "150" in text for level, text in told)
    assert told[0][0] == told[-1][0] == "INFO" and "<Scenario" in told[0][1] and "<Result" in told[-1][1]
    assert capsys.readouterr() == ("", "")
    caplog.clear()
    heard = []
    dembrick.simulate(dembrick.load("set4a", ["materials.tuff.density=150"]), record=False, report=heard.append)
    assert heard and not [record for record in caplog.records if record.levelname == "WARNING"]
