"""Fits of keys to curves: known values are recovered, undetermined keys reported, and the misfit checked by hand."""

import json

import numpy as np
import pytest

import dembrick
from dembrick import cli
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs import curve_fit
from dembrick.scenario import toml
from dembrick.views.misfit import between
from dembrick.views.plot import MeasuredCurve

SHORT = ["control.travel=5e-6", "control.rate=1e-4", "output.rows=300", 'output.channels=["joints"]']
START = ["joint.friction=0.5", "joint.shear_stiffness=7e9"]
TRUE = {"joint.friction": 0.64, "joint.shear_stiffness": 4e9}


@pytest.fixture(scope="module")
def curve():
    result = dembrick.simulate(toml.load("set4a_curve", SHORT))
    return np.array(result.rows["displacement"]), np.array(result.rows["load"])


def measured(curve, low, high, seed, count=60):
    u = np.linspace(low, high, count)
    V = np.interp(u, *curve)
    return MeasuredCurve("lab", u, V + 0.01 * V.max() * np.random.default_rng(seed).standard_normal(count))


@pytest.fixture(scope="module")
def start():
    return toml.load("set4a_curve", [*SHORT, *START])


@pytest.fixture(scope="module")
def near(curve, start):
    """The fit of one noisy curve."""
    return curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, 1)], list(TRUE))


def test_known_values_come_back_from_noisy_curves(curve, start, near):
    held = 0
    others = (curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, seed)], list(TRUE)) for seed in (2, 3))
    for found in (near, *others):
        for key, true in TRUE.items():
            one = found.keys[key]
            assert one.determined and one.value == pytest.approx(true, rel=0.03)
            held += one.lower <= true <= one.upper
        assert found.misfits[0].rms == pytest.approx(0.01, rel=0.3)
    assert held >= 5


def test_what_the_curve_does_not_change_with_is_not_determined(curve, start):
    keys = ["joint.friction", "joint.normal_stiffness", "joint.shear_stiffness"]
    found = curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, 1)], keys).keys
    assert [found[key].determined for key in keys] == [True, False, True]
    stiffness, true = found["joint.normal_stiffness"], start.joint.normal_stiffness
    assert stiffness.lower is None and (stiffness.upper is None or stiffness.upper > 50.0 * true)


def test_keys_that_trade_off_are_named(curve, start, monkeypatch):
    """Friction and density enter as a product: a search that ends early says that the curves hardly separate them."""
    monkeypatch.setattr(curve_fit, "MOST", 2)
    with pytest.raises(
        NotConvergedError, match=r"hardly distinguish joint.friction and materials.tuff.density: vary only one"
    ):
        curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, 1)], ["joint.friction", "materials.tuff.density"])


def test_a_plateau_tells_the_least_stiffness_and_no_more(curve, start):
    """Points on the plateau at 2.5 um show only that the rise is over by then: V / 2.5 um is a lower bound."""
    found = curve_fit.fit_curves([start], [measured(curve, 2.5e-6, 3.4e-6, 2)], list(TRUE)).keys
    assert found["joint.friction"].determined and not found["joint.shear_stiffness"].determined
    assert found["joint.friction"].value == pytest.approx(0.64, rel=0.01)
    stiffness = found["joint.shear_stiffness"]
    assert stiffness.upper is None and 1.5e9 < stiffness.lower < 4e9


def test_a_far_start_leads_to_the_same_values(curve, near):
    """A stiffness 250 times too high puts all measured points on the plateau, where the misfit has no slope."""
    lab = [measured(curve, 5e-8, 3.4e-6, 1)]
    far = [*SHORT, "joint.friction=0.3", "joint.shear_stiffness=1e12"]
    found = curve_fit.fit_curves([toml.load("set4a_curve", far)], lab, list(TRUE)).keys
    for key in TRUE:
        assert found[key].value == pytest.approx(near.keys[key].value, rel=2e-3)


def test_a_start_that_is_too_strong_goes_as_far_as_the_measured_curve(curve):
    """With more friction the jack deforms over more of the travel, and the run ends before the measured curve."""
    strong = toml.load("set4a_curve", [*SHORT, "joint.friction=0.9"])
    lab = MeasuredCurve("lab", curve[0][::10], curve[1][::10])
    assert dembrick.simulate(strong).rows["displacement"][-1] < 0.95 * lab.displacement[-1]
    found = curve_fit.fit_curves([strong], [lab], ["joint.friction"]).keys["joint.friction"]
    assert found.value == pytest.approx(0.64, rel=1e-3) and found.lower < 0.64 < found.upper


def test_why_runs_have_no_answer_is_passed_on(curve, start, monkeypatch):
    """The usual reason is the travel, and no other values of the keys would help."""
    run, friction = curve_fit._curve, start.joint.friction

    def fails(scenario, told=False):
        if scenario.joint.friction != friction:
            raise NotConvergedError("no limit load: lengthen control.travel")
        return run(scenario, told)

    monkeypatch.setattr(curve_fit, "_curve", fails)
    with pytest.raises(NotConvergedError, match="start from other values, or remove the cause: no limit load"):
        curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, 1)], list(TRUE))


def test_a_misfit_that_runs_on_widens_the_intervals(curve):
    """A wave of 1 % along the curve is less information than independent scatter of the same size."""
    scattered = measured(curve, 5e-8, 3.4e-6, 1)
    V = np.interp(scattered.displacement, *curve)
    wave = MeasuredCurve("wave", scattered.displacement, V + 0.0141 * V.max() * np.sin(np.linspace(0.0, 12.0, len(V))))
    test = toml.load("set4a_curve", [*SHORT, "joint.friction=0.5"])
    widths = []
    for lab in (wave, scattered):
        found = curve_fit.fit_curves([test], [lab], ["joint.friction"]).keys["joint.friction"]
        assert found.lower < 0.64 < found.upper
        widths.append(found.upper - found.lower)
    assert widths[0] > 2.0 * widths[1]


def test_the_misfit_of_loops():
    ways = (np.linspace(0, 1, 50), np.linspace(1, -1, 99)[1:], np.linspace(-1, 0, 50)[1:])
    loop = np.concatenate(ways)
    force = np.concatenate([2 * x + side * (1 - x**2) for x, side in zip(ways, (0.5, -0.5, 0.5), strict=True)])
    lab = MeasuredCurve("lab", loop, force)
    assert between(lab, lab).rms == pytest.approx(0.0, abs=1e-12)
    assert between(MeasuredCurve("", loop, force + 0.1), lab).rms == pytest.approx(0.1 / np.abs(force).max(), rel=1e-9)
    wider = between(MeasuredCurve("", loop, 1.1 * force), lab)
    assert wider.energy == pytest.approx(0.1) == wider.peak
    with pytest.raises(ScenarioError, match="to and fro"):
        between(MeasuredCurve("", loop[:50], force[:50]), lab)


def test_a_loop_that_turns_a_little_before_the_measured_one_is_compared_to_its_end():
    ways = (np.linspace(0, 1, 11), np.linspace(1, -1, 21)[1:], np.linspace(-1, 0, 11)[1:])
    lab = MeasuredCurve("lab", np.concatenate(ways), np.concatenate(ways))
    short = MeasuredCurve("", 0.98 * lab.displacement, lab.load)
    assert len(curve_fit.compared(short, lab)[0]) == len(lab.load) + 2  # turning points belong to both branches
    assert between(short, lab).peak == pytest.approx(0.0, abs=1e-12)


def test_the_misfit_of_loops_against_a_curve_that_goes_one_way():
    """Simulated loops after their first turning point are ignored."""
    u = np.linspace(0.0, 1.0, 50)
    loops = MeasuredCurve(
        "", np.concatenate([u, u[-2::-1], -u[1:]]), np.concatenate([1.02 * u, 7.0 * u[1:], -9.0 * u[1:]])
    )
    found = between(loops, MeasuredCurve("lab", u, u))
    assert found.peak == pytest.approx(0.02) == found.energy and found.compared == (0.0, 1.0)


@pytest.mark.parametrize("keys, said", [
    ([], "names no key"),
    (["joint.friction", "joint.friction"], "twice"),
    (["joint.frictoin"], "friction"),
    (["joint.formulation"], "not a number"),
    (["joint.cohesion"], "above zero"),
    (["joint.friction", "control.travel"], "control.travel says how the test is run"),
])  # fmt: skip
def test_keys_that_cannot_be_fitted(keys, said, curve, start):
    with pytest.raises(ScenarioError, match=said):
        curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, 1)], keys)


def test_data_that_cannot_be_fitted(curve, start):
    with pytest.raises(ScenarioError, match="2 measured points cannot determine 2 keys"):
        curve_fit.fit_curves([start], [measured(curve, 5e-8, 3.4e-6, 1, count=2)], list(TRUE))
    twice = [measured(curve, 5e-8, 3.4e-6, 1), measured(curve, 5e-8, 3.4e-6, 1)]
    with pytest.raises(ScenarioError, match="are the same curve; give it once"):
        curve_fit.fit_curves([start], twice, ["joint.friction"])
    with pytest.raises(ScenarioError, match="lengthen control.travel"):
        curve_fit.fit_curves([start], [measured(curve, 5e-8, 3e-5, 1)], ["joint.friction"])
    for kind in ("wall_tilt", "set4a"):  # a tilting table, and a search, whose record is no test
        with pytest.raises(ScenarioError, match="no curve"):
            curve_fit.fit_curves([toml.load(kind)], [measured(curve, 5e-8, 3.4e-6, 1)], ["joint.friction"])


def test_the_commands(curve, folder, capsys):
    _, u, V = measured(curve, 5e-8, 3.4e-6, 3)
    lines = [f"{1e6 * x:.8f},{1e-3 * y:.8f}" for x, y in zip(u, V, strict=True)]
    (folder / "lab.csv").write_text("\n".join(["displacement [um],force [kN]", *lines]))
    (folder / "test.toml").write_text(toml.dumps(toml.load("set4a_curve", [*SHORT, *START])))
    args = ["fit", "--lab", "lab.csv", "test.toml", "--vary", ",".join(TRUE), "--out", "fitted.toml", "--json"]
    assert cli.main(args) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["fit"]) == set(TRUE) and set(told["misfit"]) == {"rms", "peak", "stiffness", "energy"}
    fitted = toml.load("fitted.toml")
    assert fitted.joint.friction == told["fit"]["joint.friction"]["value"]
    dembrick.simulate(fitted, folder / "fitted.h5")
    assert cli.main(["plot", "fitted.h5", "--lab", "lab.csv", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["misfit"]
    assert shown.pop("compared")[1] == pytest.approx(u[-1], rel=1e-6)
    assert shown == pytest.approx(told["misfit"], rel=1e-6)
    assert cli.main(["plot", "fitted.h5", "--lab", "lab.csv", "--force"]) == 0
    assert "misfit: rms" in capsys.readouterr().out
    assert cli.main([*args[:-3], "--formulation", "convex"]) == 2
    assert "--formulation belongs to yield points" in capsys.readouterr().err
    (folder / "lab.csv").write_text("\n".join(["displacement,force", *lines]))
    assert cli.main(["fit", "--lab", "lab.csv", "test.toml", "--vary", "joint.friction"]) == 2
    assert "unit" in capsys.readouterr().err


def test_keys_are_named_as_for_set():
    """By name, by number, in quotes; also keys that the text omits."""
    text = toml.text_of(toml.load("set4a_curve")) + '[[joints]]\nbetween = ["lower", "upper"]\nfriction = 0.6\n'
    scenario = toml.loads(text)
    for key, value in (("joints.0.friction", 0.6), ("materials.tuff.density", 1500.0), ('"joint".friction', 0.64)):
        assert curve_fit._value(scenario, key) == value
    with pytest.raises(ScenarioError, match="no entry 1"):
        curve_fit._value(scenario, "joints.1.friction")
