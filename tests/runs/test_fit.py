"""Friction fitted to measured yield points."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs import fit
from dembrick.scenario import shipped, toml
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import YieldControl
from dembrick.scenario.model import Actuator, Material
from helpers.stone_scenes import law, of_stone

FOLDER = shipped.folder()


def data(tmp_path, *lines, header="test,scenario,V [N]"):
    path = tmp_path / "data.csv"
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def line(name, V, *more):
    return ",".join([name, str(FOLDER / f"set{name}.toml"), f"{V:.17g}", *more])


def test_the_printed_numbers_of_the_paper_give_their_friction_back():
    """Eight analytical yield points, rounded to a newton; the friction in the scenario files must not matter."""
    measurements = fit.read(FOLDER / "paper_analytical.csv")
    fits = {one.formulation: one for one in fit.fit(measurements, ("convex", "concave"))}
    stated = fits["as stated"]
    assert len(stated.tests) == 8
    assert stated.mu == pytest.approx(0.640, abs=0.002)
    assert stated.half_width < 0.002
    for name in ("convex", "concave"):
        assert fits[name].mu == pytest.approx(0.640, abs=0.002)
        assert len(fits[name].tests) == 4


def test_the_experiments_speak_for_the_area_and_against_the_corners():
    measurements = fit.read(FOLDER / "paper_experiments.csv")
    convex, concave = fit.fit(measurements, ("convex", "concave"))
    assert convex.mu == pytest.approx(0.655, abs=0.002)
    assert concave.scatter > 5.0 * convex.scatter
    alone = {test["test"]: test["mu"] for test in convex.tests}
    # each test alone, in proportion to theory at .64: 107.1658, 192.8984, 216.0549, 161.9025
    expected = {"2a": 108 / 107.1658, "2b": 205 / 192.8984, "4a": 216 / 216.0549, "4b": 166 / 161.9025}
    assert alone == pytest.approx({name: 0.64 * ratio for name, ratio in expected.items()}, rel=1e-4)


def test_mu_and_its_interval_by_the_closed_form_of_a_proportional_law(tmp_path):
    """V = k mu, so for relative errors mu and its interval follow from the mean of V_i / k_i."""
    k = np.array([107.1658, 192.8984, 216.054938, 161.9025]) / 0.64
    measured = 0.58 * k * np.array([1.02, 0.97, 1.01, 0.99])
    names = ("2a", "2b", "4a", "4b")
    path = data(tmp_path, *(line(name, V) for name, V in zip(names, measured, strict=True)))
    (found,) = fit.fit(fit.read(path), ("convex",))
    alone = measured / k
    mu = alone.mean()
    scatter = (alone / mu).std(ddof=1)
    assert found.mu == pytest.approx(mu, rel=1e-4)
    assert found.half_width == pytest.approx(stats.t.ppf(0.975, 3) * scatter * mu / 2.0, rel=1e-3)
    assert abs(found.mu / 0.58 - 1.0) > 1e-3  # the scatter does move it


def test_a_stated_deviation_weighs(tmp_path):
    k = 107.1658 / 0.64
    header = "test,scenario,V [kN],deviation [N]"
    path = data(tmp_path, line("2a", 0.5e-3 * k, "1"), line("2a", 0.7e-3 * k, "3"), header=header)
    (found,) = fit.fit(fit.read(path), ("convex",))
    assert found.mu == pytest.approx((9 * 0.5 + 0.7) / 10.0, rel=1e-4)


def test_intervals_hold_the_friction_of_tests_that_scatter_by_a_seventh(monkeypatch):
    """V = k mu with errors of 15 %: errors relative to the measured V would lower mu by 4.5 % and coverage by half."""
    monkeypatch.setattr(fit, "_simulated", lambda group, name, mu: mu * np.array([float(one.test) for one in group]))
    rng, held = np.random.default_rng(3), 0
    scenario = toml.load("set4a")
    for _ in range(150):
        k = rng.uniform(100.0, 400.0, 40)
        measured = 0.6 * k * rng.normal(1.0, 0.15, 40)
        group = [fit.Measurement(str(one), scenario, V) for V, one in zip(measured, k, strict=True)]
        (found,) = fit.fit(group, ("convex",))
        held += abs(found.mu - 0.6) <= found.half_width
    assert 0.92 <= held / 150 <= 0.98


def test_bars_are_no_less_than_what_was_stated_and_read(tmp_path):
    """Two equal readings show no scatter; stated deviations bound the interval, or the number of digits read."""
    k = 107.1658 / 0.64
    stated = data(tmp_path, line("2a", 110, "10"), line("2a", 110, "10"), header="test,scenario,V [N],deviation [N]")
    (found,) = fit.fit(fit.read(stated), ("convex",))
    assert found.half_width == pytest.approx(1.959964 * 10.0 / np.sqrt(2.0) / k, rel=1e-3)
    alone = data(tmp_path, line("2a", 110, "10"), header="test,scenario,V [N],deviation [N]")
    (found,) = fit.fit(fit.read(alone), ("convex",))
    assert found.half_width == pytest.approx(1.959964 * 10.0 / k, rel=1e-3)
    equal = data(tmp_path, line("2a", 110), line("2a", 110))
    (found,) = fit.fit(fit.read(equal), ("convex",))
    assert found.half_width == pytest.approx(stats.t.ppf(0.975, 1) / np.sqrt(12.0) / np.sqrt(2.0) / k, rel=1e-3)


def test_a_test_at_constant_rate_counts_by_its_limit(tmp_path):
    """The scenario of its curve has the same jacks, and so gives the same friction."""
    found = []
    for name in ("set4a", "set4a_curve"):
        path = tmp_path / f"{name}.csv"
        path.write_text(f"test, scenario, V [N]\na, {FOLDER / name}.toml, 216.055\n")
        found.append(fit.fit(fit.read(path), ("convex",))[0].mu)
    assert found[0] == found[1] == pytest.approx(0.64, rel=1e-3)


def test_one_test_has_no_interval(tmp_path):
    (found,) = fit.fit(fit.read(data(tmp_path, line("4a", 200.0))), ("concave",))
    assert found.half_width is None
    assert found.mu == pytest.approx(0.64 * 200.0 / 254.5698, rel=1e-4)


@pytest.mark.parametrize("freedom", [1, 2, 3, 7, 30, 400])
def test_student(freedom):
    assert fit.student(0.95, freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-10)


@pytest.mark.parametrize(
    ("header", "lines", "words"),
    [
        ("test,scenario,V", [line("2a", 100.0)], ["unit", "V [N]"]),
        ("test,scenario,V [lbf]", [line("2a", 100.0)], ["unit"]),
        ("test,scenarios,V [N]", [line("2a", 100.0)], ["scenarios", "scenario"]),
        ("test,scenario", ["2a,x.toml"], ["no column 'V'"]),
        ("test,scenario,V [N]", [line("2a", -1.0)], ["greater than 0"]),
        ("test,scenario,V [N]", ["2a,none.toml,100"], ["none.toml", "no such file"]),
        ("test,scenario,V [N],formulation", [line("2a", 100.0, "convx")], ["convx", "convex"]),
        ("test,scenario,V [N]", [f"a,{FOLDER / 'arch.toml'},100.0"], ["pushover", "yield", "displacement"]),
        ("test,scenario,V [N]", [], ["at least one test"]),
    ],
)
def test_what_is_no_data_is_refused_in_one_sentence(tmp_path, header, lines, words):
    with pytest.raises(ScenarioError) as caught:
        fit.read(data(tmp_path, *lines, header=header))
    for word in (*words, "data.csv" if "none.toml" not in words else "none.toml"):
        assert word in str(caught.value)


def test_the_command(capsys):
    assert main(["fit", "--lab", "paper_experiments.csv", "--formulation", "convex"]) == 0, "which ships"
    out = capsys.readouterr().out
    assert "mu = 0.655 +- 0.029" in out and "2b" in out
    assert main(["fit", "--lab", "paper_experiments.csv", "--formulation", "konvex"]) == 2
    assert "convex" in capsys.readouterr().err


def block(tmp_path, name, width, push_at, weight=100.0, control=None, **strengths):
    """A block 0.2 m deep and 0.4 m high: it slides at mu W, or overturns at W width / (2 push_at)."""
    blocks = (
        Block("lower", "stone", box=(1.0, 1.0, 0.1), position=(0.0, 0.0, -0.05), fixed=True),
        Block("upper", "stone", box=(width, 0.2, 0.4), position=(0.0, 0.0, 0.2)),
    )
    push = Actuator("push", "upper", (-0.5 * width, 0.0, push_at), (1.0, 0.0, 0.0))
    materials = {"stone": Material(weight / (9.81 * 0.2 * width * 0.4))}
    given = of_stone(
        law(friction=0.5, **strengths), control or YieldControl(), blocks, actuators=(push,), materials=materials
    )
    (tmp_path / f"{name}.toml").write_text(toml.dumps(given), encoding="utf-8")


@pytest.mark.parametrize(
    ("lines", "mu", "alone"),
    [
        (["tips,20"], 0.2, [0.2]),  # at 0.5 it overturns, which gives no friction
        (["tips,30", "slides,60"], 0.6, [None, 0.6]),
        (["late,52", "slides,48", "heavy,150"], 0.5, None),  # best fit where `late` begins to overturn
    ],
)
def test_blocks_that_tip_over_have_a_friction_too(tmp_path, lines, mu, alone):
    for name, width, push_at in (("tips", 0.1, 0.2), ("late", 0.2, 0.2), ("slides", 0.3, 0.02)):
        block(tmp_path, name, width, push_at)
    block(tmp_path, "heavy", 0.3, 0.02, weight=300.0)
    path = data(tmp_path, *(f"{one.split(',')[0]},{one.split(',')[0]}.toml,{one.split(',')[1]}" for one in lines))
    (found,) = fit.fit(fit.read(path), ("concave",))
    assert found.mu == pytest.approx(mu, rel=3e-3)
    if alone is not None:
        assert [test["mu"] for test in found.tests] == [None if one is None else pytest.approx(one) for one in alone]


def test_a_deviation_is_given_to_all_tests_or_to_none(tmp_path):
    block(tmp_path, "slides", 0.3, 0.02)
    lines = ("1,slides.toml,30,2", "2,slides.toml,31,")
    with pytest.raises(ScenarioError, match="line 3: deviation is empty here but not elsewhere"):
        fit.read(data(tmp_path, *lines, header="test,scenario,V [N],deviation [N]"))


@pytest.mark.parametrize("large", [False, True])
def test_a_test_is_fitted_in_the_geometry_that_it_states(tmp_path, monkeypatch, large):
    asked = []

    def simulated(scenario, **_):
        asked.append(scenario.control.large_displacements)
        return SimpleNamespace(yield_point=SimpleNamespace(V=100.0 * scenario.joint.friction))

    block(tmp_path, "slides", 0.3, 0.02, control=YieldControl(1e-3, large))
    monkeypatch.setattr(fit, "simulate", simulated)
    (found,) = fit.fit(fit.read(data(tmp_path, "1,slides.toml,30")), ("concave",))
    assert found.mu == pytest.approx(0.3, rel=1e-6) and set(asked) == {large}


def test_what_other_strengths_exclude_is_no_answer(tmp_path):
    block(tmp_path, "slides", 0.3, 0.02, residual_friction=0.4)
    with pytest.raises(ScenarioError, match=r"outside the range that strengths allow, 0.4 \(residual"):
        fit.fit(fit.read(data(tmp_path, "1,slides.toml,30")), ("concave",))


def test_joints_with_a_friction_of_their_own_are_refused(tmp_path):
    block(tmp_path, "slides", 0.3, 0.02)
    path = tmp_path / "slides.toml"
    own = '[[joints]]\nbetween = ["lower", "upper"]\n'
    path.write_text(path.read_text() + own + "friction = 0.3\n")
    with pytest.raises(ScenarioError, match="between 'lower' and 'upper' a friction of their own"):
        fit.read(data(tmp_path, "1,slides.toml,30"))
    path.write_text(path.read_text().replace("friction = 0.3\n", "shear_stiffness = 1e9\n"))
    (found,) = fit.fit(fit.read(data(tmp_path, "1,slides.toml,30")), ("concave",))
    assert found.mu == pytest.approx(0.3, rel=1e-4)
