"""Measured curves that cannot be compared are refused with the true reason."""

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.runs import curve_fit
from dembrick.scenario import toml
from dembrick.views.misfit import between, require_comparable
from dembrick.views.plot import MeasuredCurve, read_measured

RUN = MeasuredCurve("run", np.array([1e-25, 1e-5, 2e-5]), np.array([0.0, 200.0, 210.0]))
CURVES = {
    "negative": ([0.0, -5e-6, -1e-5, -2e-5], [0.0, -95.0, -170.0, -216.0], "displacements of negative are negative"),
    "unsorted": ([2e-5, 5e-6, 1e-5, 0.0], [216.0, 95.0, 170.0, 0.0], "sort its lines by displacement"),
    "metres": ([0.0, 5e-3, 1e-2, 2e-2], [0.0, 95.0, 170.0, 216.0], "1 of the 4 points of metres .0 to 20 mm. lies"),
}


@pytest.mark.parametrize("name", CURVES)
def test_why_a_curve_cannot_be_compared(name):
    u, V, said = CURVES[name]
    with pytest.raises(ScenarioError, match=said):
        require_comparable(RUN, MeasuredCurve(name, np.array(u), np.array(V)), name)


@pytest.mark.parametrize("name", CURVES)
def test_a_fit_says_the_same(name):
    """It once reported for each of them that the travel of the run ends too early."""
    u, V, said = CURVES[name]
    start = toml.load("set4a_curve", ["control.travel=5e-6", "control.rate=1e-4", "output.rows=300"])
    with pytest.raises(ScenarioError, match=said):
        curve_fit.fit_curves([start], [MeasuredCurve(name, np.array(u), np.array(V))], ["joint.friction"])


def test_what_has_a_misfit_is_comparable():
    """Scatter of a gauge about zero, and a cyclic run against its own loops and against one branch of them."""
    scatter = MeasuredCurve("", np.array([0.0, -1e-7, 1e-5, 0.97e-5, 2e-5]), np.array([0.0, 1.0, 170.0, 171.0, 216.0]))
    loops = MeasuredCurve("", np.array([0.0, 1e-5, -1e-5, 1e-5]), np.array([0.0, 9.0, -9.0, 9.0]))
    way = MeasuredCurve("", np.array([0.0, -0.5e-5, -1e-5]), np.array([0.0, 5.0, 9.0]))
    for ours, theirs in ((RUN, scatter), (RUN, RUN), (loops, loops)):
        require_comparable(ours, theirs, "lab")
        assert between(ours, theirs).peak < 0.1
    require_comparable(loops, way, "lab")  # allowed for a run that covers it too: its misfit is another question


@pytest.mark.parametrize("header", ["displacement [N],force [mm]", "displacement [kN],way [mm],force [N]"])
def test_a_column_whose_unit_is_not_that_of_its_name(header, tmp_path):
    """Columns are found by their unit, so swapped units once swapped the axes."""
    rows = "\n".join(",".join([str(i)] * (1 + header.count(","))) for i in range(3))
    (tmp_path / "lab.csv").write_text(f"{header}\n{rows}\n", encoding="utf-8")
    with pytest.raises(
        ScenarioError, match="'displacement' has the unit 'k?N', which is not one of displacement; write"
    ):
        read_measured(tmp_path / "lab.csv")


def test_other_columns_may_have_any_name(tmp_path):
    (tmp_path / "lab.csv").write_text("jack [kN],gauge 2 [mm],time [s]\n0,0,0\n1,2,3\n", encoding="utf-8")
    found = read_measured(tmp_path / "lab.csv")
    assert found.displacement[1] == 2e-3 and found.load[1] == 1e3
