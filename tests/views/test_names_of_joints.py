"""A joint is named by its two blocks, in either order and with or without spaces."""

import pytest

from dembrick import cli, history
from dembrick.errors import ScenarioError
from dembrick.views.plot import subject
from helpers import history_cases as cases


@pytest.mark.parametrize("name", ["lower/upper", "upper/lower", "upper / lower", " lower /upper", "0"])
def test_either_order_names_a_joint(run, name):
    assert subject.chosen_joint(run, name) == 0


@pytest.mark.parametrize("name", ["upper/lid", "upper", "upper/lower #1", "/", "#", "upper/lower/x"])
def test_other_blocks_do_not(run, name):
    with pytest.raises(ScenarioError, match="its joints are lower/upper"):
        subject.chosen_joint(run, name)


def test_of_several_joints_of_two_blocks_each_has_a_number(run, monkeypatch):
    monkeypatch.setitem(run.__dict__, "joints", run.joints * 3)
    assert subject.chosen_joint(run, "upper/lower #2") == subject.chosen_joint(run, "lower/upper #2") == 2
    assert subject.chosen_joint(run, "upper / lower#1") == 1 and subject.chosen_joint(run, "upper/lower") == 0


def test_the_command_takes_a_hinge_as_a_result_names_it(run, tmp_path):
    for order in ("upper / lower", "lower/upper"):
        figure = tmp_path / f"{order.replace('/', '_')}.png"
        assert cli.main(["plot", run.path, "--kind", "path", "--joint", order, "--to", str(figure)]) == 0
    with history.HistoryWriter(tmp_path / "bare.h5", cases.SCENARIO, cases.assembly(), {}) as writer:
        writer.append(cases.record(0, 3))
    assert cli.main(["plot", str(tmp_path / "bare.h5"), "--kind", "path", "--joint", "x/y"]) == 2
