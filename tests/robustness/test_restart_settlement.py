"""Settlements stopped on their way and restarted: bit for bit the whole run."""

import numpy as np
import pytest

from dembrick.errors import HistoryError
from dembrick.history import Checkpoints, read
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.model import Block, JointLaw, Output, Scenario
from dembrick.scenario.time_functions import Turn
from dembrick.simulation.dynamics.paths import equilibria, load_path
from helpers.restart_cases import check_same, counted_looks, rewritten
from helpers.stone_scenes import of_stone


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Fewer equilibria on the path of a settlement."""
    monkeypatch.setattr(load_path, "EQUILIBRIA", 6)
    monkeypatch.setattr(load_path, "WITHIN", 1.0)


def turned_floor() -> Scenario:
    """A block that overturns when its floor has turned by atan(.4)."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.2, 0.4, 0.5), (0.0, 0.0, 0.25))
    control = SettlementControl(("floor",), rotation=Turn((0.0, 1.0, 0.0), 30.0), tolerance=0.05)
    law, output = JointLaw("concave", 0.9, 1e9, 4e8), Output(checkpoint=1e9)
    return of_stone(law, control, (floor, block), output=output)


def test_a_settlement_goes_on_where_it_was_stopped(tmp_path, stop_after):
    """Stopped while the supports move and during the collapse: it continues from the last equilibrium."""
    with counted_looks() as looks:
        whole = simulate(turned_floor(), tmp_path / "whole.h5")
    assert whole.status == "collapse" and whole.collapse["settlement"] > 0.0
    for stop in (len(looks) // 4, len(looks) // 2, len(looks) - 3):
        path = tmp_path / f"{stop}.h5"
        with stop_after(stop, match="after equilibrium [0-9]+; continue with: dembrick restart"):
            simulate(turned_floor(), path)
        with read(path) as found:
            assert found.status == "interrupted" and found.n_row > 0
        result = restart(path)
        np.testing.assert_array_equal(result.run.path, whole.run.path)
        assert result.collapse == whole.collapse and result.reactions == whole.reactions
        check_same(tmp_path / "whole.h5", path)


@pytest.mark.parametrize(
    "numbers",
    [
        (2.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0),
        (0.5, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0),
        (0.5, 0.0, 0.0, 1.5, 0.0, 0.5, 0.0),
        (0.5, -1.0, 0.0, 3.0, 0.0, 0.5, 0.0),
        (0.5, 0.0, 0.0, 3.0, 0.0, 0.6, 0.0),
    ],
)
def test_a_checkpoint_of_no_equilibrium_is_refused(tmp_path, stop_after, numbers):
    path = tmp_path / "run.h5"
    with stop_after(40):
        simulate(turned_floor(), path)
    for one in Checkpoints(path).existing():
        rewritten(one, **{equilibria.SNAPSHOT: np.array(numbers)})
    with pytest.raises(HistoryError, match="this checkpoint holds no step of this run"):
        restart(path)
