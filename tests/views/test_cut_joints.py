"""A joint that is cut as its block slides over an edge: what is printed has its torsion about O of the start; no
figure has it on the limit surface of the whole joint."""

import numpy as np
import pytest

import dembrick
from dembrick import cli, history, plot
from dembrick.errors import HistoryError
from dembrick.simulation.dynamics.paths import driven_path
from dembrick.views.motion.table import joint_table
from dembrick.views.page import content
from dembrick.views.plot.paths import joint_path
from helpers.scenario_text import block, header, jack


@pytest.fixture(scope="module")
def slid(tmp_path_factory):
    """A slab that a jack beside its middle pushes along, by 0.1 m and by 1 mm: results and paths."""
    blocks = block("lower", (0.0, 0.0, -0.025), (0.3, 0.2, 0.05), "fixed = true")
    blocks += block("upper", (0.0, 0.0, 0.025), (0.3, 0.2, 0.05)) + jack("upper", (-0.15, 0.02, 0.0))
    found = {}
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr(driven_path, "EQUILIBRIA", 12)
    for travel in (0.1, 1e-3):
        control = f'[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = {travel}'
        scenario = dembrick.loads(header("convex", 0.5, 1e10) + blocks + control)
        path = tmp_path_factory.mktemp("slid") / "slid.h5"
        found[travel] = dembrick.simulate(scenario, path), path
    monkeypatch.undo()
    return found


def test_its_torsion_is_one_number(slid, capsys):
    result, path = slid[0.1]
    with history.read(path) as found:
        (row,) = joint_table(found)
        recorded, shift = (
            found.joint("M_T")[-1, 0],
            found.frame_values("joint_shift", found.n_frames - 1, found.n_frames),
        )
    for name in ("N", "V_1", "V_2", "M_T"):
        assert getattr(result.yield_point, name) == pytest.approx(row[name], rel=1e-9), name
    s_1, s_2 = shift[0, 0]
    assert row["M_T"] == pytest.approx(recorded + s_1 * row["V_2"] - s_2 * row["V_1"], rel=1e-9)
    assert abs(row["M_T"] - recorded) > 0.1 * abs(recorded)  # the series is about what is left
    assert cli.main(["joints", str(path)]) == 0
    assert "cut at an edge: lower/upper; M_T and e about O of the start" in capsys.readouterr().out


def test_it_is_not_drawn_on_the_domain_of_the_whole_joint(slid):
    with history.read(slid[0.1][1]) as found:
        own = joint_path(found)
        assert own.cut and own.sections == () and own.strength is None
        assert np.abs(own.M_T[-1]) == pytest.approx(np.abs(found.joint("M_T")[-1, 0]))
        (axes,) = plot.load_path(found).axes
        assert "cut at an edge" in axes.get_title().replace("\n", " ")
        assert [line.get_label() for line in axes.lines] == ["convex"]
        with pytest.raises(HistoryError, match="cut at an edge as its block slid"):
            plot.domains([found])
        assert "cut at an edge" in content.collect(found)["path"]["title"]


def test_one_that_slid_by_a_little_has_its_domain(slid):
    with history.read(slid[1e-3][1]) as found:
        own = joint_path(found)
        assert not own.cut and [section.formulation for section in own.sections] == ["convex"]
        plot.domains([found])
