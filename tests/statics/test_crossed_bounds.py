"""Bounds that contradict each other are reported; bounds that have met may cross by rounding."""

import numpy as np
import pytest

from dembrick.errors import BracketError
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
from dembrick.simulation.statics import limit_load, yield_point


@pytest.fixture(scope="module")
def ended():
    """State, certificate and names at the end of a search in set 4a (V about 254.6 N under N = 467 N)."""
    caught = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(limit_load, "read_off", lambda *given: caught.append(given) or yield_point.read_off(*given))
        simulate(lab_scenario("set4a", "concave"), record=False)
    return caught[0][:3]


def with_bounds(ended, lower, upper):
    state, certificate, names = ended
    return yield_point.read_off(state, certificate._replace(bracket=np.array([lower, upper])), names)


@pytest.mark.parametrize("lower, upper", [(254.6, 254.6 * (1.0 - 1e-9)), (0.0, -1e-9), (-1.0, -2.0)])
def test_bounds_that_cross_are_refused(ended, lower, upper):
    with pytest.raises(BracketError, match="one of them is wrong"):
        with_bounds(ended, lower, upper)


@pytest.mark.parametrize("lower, upper", [(254.6, 254.6 * (1.0 - 1e-13)), (0.0, -7e-20)])
def test_bounds_that_met_may_cross_by_rounding(ended, lower, upper):
    """The second pair is the result of a stack without friction."""
    point = with_bounds(ended, lower, upper)
    assert point.V_lower <= point.V == pytest.approx(lower, abs=1e-10) and point.V <= point.V_upper
