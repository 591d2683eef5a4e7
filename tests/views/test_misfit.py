"""The misfit of a run against a measured curve."""

import json

import numpy as np
import pytest

import dembrick
from dembrick import cli
from dembrick.errors import ScenarioError
from dembrick.scenario import shipped
from dembrick.views import misfit, plot


def test_the_misfit_by_its_closed_forms():
    """Ours rises at 2 N/mm to 10 N, the measured curve at 1 N/mm to 8 N: areas over 20 mm are 175 and 128 mJ."""
    ours = plot.MeasuredCurve("ours", np.array([0.0, 5e-3, 20e-3]), np.array([0.0, 10.0, 10.0]))
    lab = plot.MeasuredCurve("lab", 1e-3 * np.array([0.0, 4.0, 8.0, 12.0, 20.0]), np.array([0.0, 4.0, 8.0, 8.0, 8.0]))
    found = misfit.between(ours, lab)
    assert found.rms == pytest.approx(np.sqrt((0 + 16 + 4 + 4 + 4) / 5.0) / 8.0, rel=1e-12)
    assert found.peak == pytest.approx(0.25, rel=1e-12)
    assert found.stiffness == pytest.approx(1.0, rel=1e-12)
    assert found.energy == pytest.approx(175.0 / 128.0 - 1.0, rel=1e-12)
    same = misfit.between(lab, lab)
    assert (same.rms, same.peak, same.stiffness, same.energy) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-12)


def test_a_misfit_is_of_what_both_curves_have():
    """A measured curve that begins above a third of its peak has no initial stiffness; the part beyond the end of the
    run is ignored."""
    ours = plot.MeasuredCurve("ours", np.array([0.0, 1e-3, 2e-3]), np.array([0.0, 10.0, 10.0]))
    lab = plot.MeasuredCurve("lab", np.array([1e-3, 2e-3, 3e-3]), np.array([9.0, 9.0, 30.0]))
    found = misfit.between(ours, lab)
    assert found.stiffness is None and "stiffness not determined" in misfit.text(found)
    assert found.peak == pytest.approx(1.0 / 9.0) and found.compared == (1e-3, 2e-3)


@pytest.mark.parametrize(
    "displacement, load, said",
    [
        ([0.0, 1e-3, -1e-3], [0.0, 9.0, -9.0], "rig goes to and fro"),
        (
            [5e-3, 6e-3],
            [1.0, 1.0],
            r"none of the 2 points of rig \(5 to 6 mm\) lie in the range of the run \(0 to 2 mm\)",
        ),
        ([0.0, 1e-3], [0.0, -1.0], "rig has no force above 0"),
        ([1e-3, 1e-3], [0.0, 1.0], "rig has no two points"),
    ],
)
def test_what_has_no_misfit(displacement, load, said):
    ours = plot.MeasuredCurve("ours", np.array([0.0, 1e-3, 2e-3]), np.array([0.0, 10.0, 10.0]))
    with pytest.raises(ScenarioError, match=said):
        misfit.between(ours, plot.MeasuredCurve("rig", np.array(displacement), np.array(load)), "rig")


def test_loops_that_begin_the_other_way_have_no_misfit():
    """Half cycles are compared in order, so loops that begin in opposite directions are refused."""
    u = 1e-3 * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    ours, lab = (plot.MeasuredCurve(name, sign * u, sign * 1e4 * u) for name, sign in (("ours", 1.0), ("rig", -1.0)))
    with pytest.raises(ScenarioError, match="rig first moves opposite to the run"):
        misfit.between(ours, lab, "rig")
    assert misfit.between(ours, plot.MeasuredCurve("rig", -lab.displacement, -lab.load), "rig").rms == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_loops_are_compared_at_the_points_of_both(sign):
    """An elastic-plastic loop, 10 N at 1 mm to 5 mm and back, dissipates 4 (5 mm - 1 mm) 10 N = 160 mJ. Straight lines
    between turning points enclose no area; a curve measured only at the corners of the loop is the same curve."""
    corners = sign * 1e-3 * np.array([0.0, 1.0, 5.0, 3.0, -5.0, -3.0, 5.0])
    force = sign * np.array([0.0, 10.0, 10.0, -10.0, -10.0, 10.0, 10.0])
    fine = [np.interp(np.linspace(0.0, 6.0, 601), np.arange(7.0), column) for column in (corners, force)]
    ours, lab = plot.MeasuredCurve("ours", *fine), plot.MeasuredCurve("lab", corners, 0.8 * force)
    found = misfit.between(ours, lab)
    assert (found.peak, found.stiffness, found.energy) == pytest.approx((0.25, 0.25, 0.25), rel=1e-9)
    turned = plot.MeasuredCurve("turns", corners[[0, 2, 4, 6]], 0.8 * force[[0, 2, 4, 6]])
    assert misfit.between(ours, turned).peak == pytest.approx(0.25, rel=1e-9)
    coarse = plot.MeasuredCurve("ours", corners, force)  # conversely, the measured curve has many points
    assert misfit.between(coarse, plot.MeasuredCurve("lab", fine[0], 0.8 * fine[1])).energy == pytest.approx(0.25)


def test_a_run_that_turns_before_the_measured_curve_keeps_its_last_force():
    """The remark says that the run turns at 5 mm and is compared up to 5.2 mm with its last force."""
    ours = plot.MeasuredCurve("ours", 1e-3 * np.array([0.0, 5.0, -5.0, 5.0]), np.array([0.0, 10.0, -10.0, 10.0]))
    further = 1e-3 * np.array([0.0, 5.2, 6.0, -6.0, 6.0])
    lab = plot.MeasuredCurve("lab", further, np.array([0.0, 10.0, 10.0, -10.0, 10.0]))
    said = misfit.extent(misfit.between(ours, lab), ours, lab)
    assert said == " (compared up to 5.2 mm: the run turns at 5, its last force is kept beyond)"
    assert misfit.extent(misfit.between(ours, ours), ours, ours) == ""
    near = lab._replace(displacement=1e-3 * np.array([0.0, 5.0, 5.2, -5.2, 5.2]))  # within the slack of a turning point
    said = misfit.extent(misfit.between(ours, near), ours, near)
    assert said == " (the run turns at 5 mm, the curve at 5.2 mm)" and misfit.turns_early(ours, near)
    assert not misfit.turns_early(near, ours)


def test_the_initial_stiffness_is_of_what_both_curves_have():
    """The stiffness uses a third of the peak within the compared part, although the measured curve rises beyond it."""
    ours = plot.MeasuredCurve("ours", np.array([0.0, 1e-3, 2e-3]), np.array([0.0, 10.0, 10.0]))
    lab = plot.MeasuredCurve("lab", 1e-3 * np.array([0.0, 1.0, 2.0, 9.0]), np.array([0.0, 8.0, 8.0, 200.0]))
    assert misfit.between(ours, lab).stiffness == pytest.approx(0.25, rel=1e-9)


def test_the_command_says_the_misfit(tmp_path, capsys):
    """For a measured curve 10 % above ours, at our own points, all errors are 1 / 1.1 - 1."""
    run = dembrick.simulate(shipped.folder() / "set4a_curve.toml", tmp_path / "run.h5")
    load, travel = 1.1 * np.asarray(run.rows["load"]), np.asarray(run.rows["displacement"])
    rows = "\n".join(f"{u:.17g},{V:.17g}" for u, V in zip(travel, load, strict=True))
    lab = tmp_path / "lab.csv"
    lab.write_text(f"displacement [m],force [N]\n{rows}\n", encoding="utf-8")
    command = ["plot", str(tmp_path / "run.h5"), "--lab", str(lab), "--to", str(tmp_path / "f.svg")]
    assert cli.main([*command, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["misfit"]
    assert said.pop("compared") == pytest.approx([travel.min(), travel.max()], rel=1e-12)
    relative = dict.fromkeys(("peak", "stiffness", "energy"), 1.0 / 1.1 - 1.0)
    assert said == pytest.approx({"rms": np.sqrt(np.mean((load / 11.0) ** 2)) / load.max()} | relative, rel=1e-6)
    assert cli.main([*command, "--lab", str(lab)]) == 0
    assert capsys.readouterr().out.count("peak -9.09 %") == 2
    lab.write_text(
        f"displacement [m],force [N]\n0,0\n{0.5 * travel.max()},5\n{2.0 * travel.max()},6\n", encoding="utf-8"
    )
    assert cli.main([*command, "--json"]) == 0  # the measured curve is twice as long as the run
    assert json.loads(capsys.readouterr().out)["misfit"]["compared"] == pytest.approx([0.0, travel.max()], rel=1e-9)
    lab.write_text("displacement [m],force [N]\n0,0\n1,5\n-1,-5\n", encoding="utf-8")
    assert cli.main([*command, "--json"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["misfit"] == dict.fromkeys(("rms", "peak", "stiffness", "energy", "compared"))
    assert "lab goes to and fro" in told.err
