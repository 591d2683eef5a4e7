"""Runs with a user's joint law, against closed forms; where such a law cannot be used, one sentence says so."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest

import dembrick
from dembrick import cli
from dembrick._jit import hearing
from dembrick.errors import DembrickError, HistoryError, ScenarioError
from dembrick.scenario import toml
from dembrick.simulation.statics import custom_limit
from dembrick.views.motion.joints import JointMotion
from tests.helpers.custom_laws import BILINEAR, COULOMB, FOLLOWING, coulomb
from tests.helpers.scenario_text import block, header, jack

N, MU, AREA = 467.0, 0.64, 0.06  # of the laboratory joint: N, friction, m2
K_N, K_S = 1e10, 4e9  # Pa/m
PULSE, T0 = 4.905, 0.2  # m/s2, s: the pulse of Newmark's block


def lab(formulation="concave", **changes):
    """The laboratory joint in pure shear, at a constant rate."""
    scenario = dembrick.load("shear")
    joint = replace(scenario.joint, formulation=formulation)
    control = dembrick.DisplacementControl(rate=2e-5, travel=2e-4)
    return replace(scenario, **{"joint": joint, "control": control, **changes})


def newmark(law):
    """Displacement (m) of a block on a base that moves with a pulse of `PULSE` for `T0`, and its run."""
    scenario = dembrick.load("newmark_pulse", ["control.duration=1.2"])
    scenario = replace(scenario, joint=replace(scenario.joint, formulation="concave"))
    result = dembrick.simulate(scenario, law=law)
    return result.greatest_displacement["block"], result


def test_coulomb_is_what_theory_says():
    found = dembrick.simulate(lab(), law=COULOMB)
    assert found.yield_point.V == pytest.approx(MU * N, rel=1e-4)
    assert found.yield_point.bracket == "indicator"  # nothing is proven for an unknown law
    assert found.theory is None


def test_friction_that_follows_slip_peaks_where_it_should():
    """Peak mu N (1 + rise) at the slip d and residual from 2 d on; friction dissipates the area under the curve."""
    result = dembrick.simulate(lab(), law=FOLLOWING)
    point = result.yield_point
    d, rise, residual = (FOLLOWING.parameters[name] for name in ("slip_distance", "rise", "residual"))
    assert point.V_peak == pytest.approx(MU * N * (1.0 + rise), rel=1e-3)
    assert point.displacement_at_peak == pytest.approx(d + point.V_peak / (K_S * AREA), rel=0.05)
    assert point.V == pytest.approx(MU * N * residual, rel=1e-3)
    slip = point.displacement - point.V / (K_S * AREA)
    rising = d * (1.0 + rise * (math.e - 2.0))
    falling_to = (1.0 + rise + residual) * 0.5 * d
    work = MU * N * (rising + falling_to + residual * (slip - 2.0 * d))
    assert result.rows["energy"]["friction"][-1] == pytest.approx(work, rel=2e-3)
    assert result.energy.relative_residual < 1e-6


def test_bilinear_springs_close_as_they_should_under_the_dead_load():
    """N / A = k (knee + part (g - knee)), reached by relaxation before the actuators push."""
    result = dembrick.simulate(lab(), law=BILINEAR)
    knee, part = BILINEAR.parameters["knee"], BILINEAR.parameters["part"]
    closed = knee + (N / AREA / K_N - knee) / part
    assert closed > 2.0 * N / AREA / K_N
    assert result.frames["displacement"][0][1][2] == pytest.approx(-closed, rel=1e-5)
    assert result.yield_point.V == pytest.approx(MU * N, rel=1e-3)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_a_search_finds_the_peak_within_its_bar(tolerance):
    """In pure shear mu N (1 + rise), and mu N without a rise; in torsion-shear the theory for mu."""
    rise = FOLLOWING.parameters["rise"]
    exact = 254.56982230222368  # N, theory of four points under equal forces, see `theory.limit_loads`
    for name, law, V, after in (
        ("shear", FOLLOWING, MU * N * (1.0 + rise), MU * N * FOLLOWING.parameters["residual"]),
        ("shear", FOLLOWING.with_parameters(slip_distance=2e-4), MU * N * (1.0 + rise), 0.5 * MU * N),
        ("shear", COULOMB, MU * N, None),
        ("shear", BILINEAR, MU * N, None),
        ("set4a", COULOMB, exact, None),
        ("set4a", BILINEAR, exact, None),
    ):
        scenario = dembrick.load(name, ["joint.formulation=concave", f"control.tolerance={tolerance}"])
        result = dembrick.simulate(scenario, law=law)
        point = result.yield_point
        assert point.V_lower <= V <= point.V_upper, (name, law.name)
        assert point.half_width <= tolerance * point.V and point.bracket == "indicator"
        assert point.V_after is None if after is None else point.V_after == pytest.approx(after, rel=2e-3)
        assert point.mechanism == ("sliding" if name == "shear" else "torsion-shear")
        assert point.V_2 == pytest.approx(point.V, rel=5e-3)
        assert result.energy.relative_residual < 1e-6 and result.theory is None and not result.others


@pytest.mark.parametrize("mu, height, weight", [(0.6, 0.4, 1.0), (0.6, 0.3, 1.4), (0.4, 0.2, 1.01)])
def test_of_two_blocks_the_weaker_one_is_the_limit(mu, height, weight):
    """The least mu N over the weight of its jack; V oscillates about it while one block begins to slide."""
    text = header("concave", mu, 1e10) + block("base", (0.0, 0.0, -0.1), (4.0, 4.0, 0.2), "fixed = true")
    text += block("one", (0.0, 0.0, 0.1), (0.3, 0.3, 0.2)) + jack("one", (0.0, 0.0, 0.0))
    text += block("two", (1.0, 0.0, 0.5 * height), (0.3, 0.3, height))
    text += jack("two", (1.0, 0.0, 0.0), more=f"weight = {weight}").replace('"jack"', '"second"')
    text += '[control]\nkind = "yield"\ntolerance = 1e-3\n'
    point = dembrick.simulate(toml.loads(text), law=COULOMB).yield_point
    V = mu * 2000.0 * 9.81 * 0.3**2 * min(0.2, height / weight)
    assert point.V_lower <= V <= point.V_upper
    assert point.half_width <= 1e-3 * V and point.V_after is None


@pytest.mark.parametrize("held, lift", [("z", 0.0), ("y", 200.0)])
def test_a_block_off_its_joint_is_undecided_without_a_number(held, lift):
    """A block guided off its joint, or lifted off it: no joint force is there to scale the out-of-balance force."""
    text = header("concave", 0.6, 1e10) + block("base", (0.0, 0.0, -0.1), (4.0, 4.0, 0.2), "fixed = true")
    text += block("one", (0.0, 0.0, 0.05), more=f'held = ["{held}", "rx", "ry", "rz"]') + jack("one", (0.0, 0.0, 0.0))
    text += f'[[loads]]\nblock = "one"\nforce = [{10.0 - 0.05 * lift}, 0.0, {lift}]\n'
    text += '[control]\nkind = "displacement"\nrate = 2e-5\ntravel = 2e-4\n'
    with pytest.raises(dembrick.UndecidedError, match="no joint is compressed") as error:
        dembrick.simulate(toml.loads(text), law=COULOMB)
    assert not re.search(r"\d (of the joint|N )|e[+]", str(error.value))


def test_a_load_that_nothing_limits_is_no_answer(monkeypatch):
    def sticking(move, law, memory):
        normal = law.normal_stiffness * max(move.penetration, 0.0)
        t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
        t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
        held = normal**2 / law.normal_stiffness + (t1**2 + t2**2) / law.shear_stiffness
        return normal, t1, t2, 0.5 * held

    monkeypatch.setattr(custom_limit, "MOST_STEPS", 100)
    with pytest.raises(dembrick.NotConvergedError, match="no limit load: after 100 steps V is .* neither steady nor"):
        dembrick.simulate(dembrick.load("shear", ["joint.formulation=concave"]), law=sticking)


def test_a_search_is_for_blocks_that_stand_on_fixed_ones():
    scenario = two_blocks(dembrick.load("shear", ["joint.formulation=concave"]))
    with pytest.raises(ScenarioError, match="only if each block stands on fixed blocks alone") as error:
        dembrick.simulate(scenario, law=COULOMB)
    assert "\n" not in str(error.value)


def two_blocks(scenario):
    """The same with a third block on top, pushed by the actuator at its lower face."""
    top = replace(scenario.blocks[1], name="top", position=(0.0, 0.0, 0.15))
    actuator = replace(scenario.actuators[0], block="top", point=(0.0, 0.0, 0.1))
    return replace(scenario, blocks=(*scenario.blocks, top), actuators=(actuator,))


def test_several_blocks():
    """Two blocks on a base, each on its own joint: the upper joint slips at mu times the N of that joint."""
    found = dembrick.simulate(two_blocks(lab()), law=COULOMB).yield_point
    assert found.V == pytest.approx(MU * 9.0 * 9.81, rel=2e-3)
    assert found.joint == ("upper", "top")


def test_newmarks_block_in_real_time():
    """A (A - a_y) t0^2 / (2 a_y); if friction halves at the first slip, the block slides as with half the friction."""
    yielding = 0.2 * 9.81

    def closed_form(a):
        return PULSE * (PULSE - a) * T0**2 / (2.0 * a)

    moved, result = newmark(COULOMB)
    assert moved == pytest.approx(closed_form(yielding), rel=1e-3)
    assert result.energy.relative_residual < 1e-6
    falling = FOLLOWING.with_parameters(slip_distance=1e-8, rise=0.0)
    moved, _ = newmark(falling)
    assert moved == pytest.approx(closed_form(0.5 * yielding), rel=1e-3)


@pytest.mark.parametrize("formulation, height", [("concave", 0.1), ("concave", 0.3), ("corrected", 0.15)])
def test_a_block_that_is_thrown_is_not_braked_by_dashpots(formulation, height):
    """It slides v^2 / (2 mu g) and rattles; dashpots do not act while the law dissipates all the work of its force."""
    v, mu = 0.2, 0.5
    text = header(formulation, mu) + block("floor", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    text += block("stone", (0.0, 0.0, 0.5 * height), (0.2, 0.2, height), f"velocity = [{v}, 0.0, 0.0]")
    text += '[control]\nkind = "dynamic"\nduration = 0.1\nrestitution = 0.5\n'
    went = dembrick.simulate(toml.loads(text), law=COULOMB).greatest_displacement["stone"]
    assert went == pytest.approx(v * v / (2.0 * mu * 9.81), rel=5e-3)


def test_parameters_and_other_laws_compile_no_kernel_again():
    """One compiled kernel serves all laws, and no law is confused with another."""
    dembrick.simulate(lab(), law=COULOMB)
    compiled = []
    with hearing(("numba:compile",), lambda: compiled.append(1)):
        peaks = [
            dembrick.simulate(lab(), law=FOLLOWING.with_parameters(rise=rise)).yield_point.V_peak for rise in (0.1, 0.4)
        ]
        first = len(compiled)
        loose = dembrick.simulate(lab(), law=numba.njit(_frictionless_twin(0.5)))
        tight = dembrick.simulate(lab(), law=numba.njit(_frictionless_twin(2.0)))
    assert peaks == pytest.approx([MU * N * 1.1, MU * N * 1.4], rel=1e-3)
    assert first <= 2  # the law and its wrapper
    assert len(compiled) <= first + 4
    assert loose.yield_point.V == pytest.approx(0.5 * MU * N, rel=1e-3)
    assert tight.yield_point.V == pytest.approx(2.0 * MU * N, rel=1e-3)


def _frictionless_twin(factor):
    """Laws with the same name and source line that differ in a closure variable."""
    import math as functions

    def law(move, law, memory):
        normal = law.normal_stiffness * move.penetration
        if normal <= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
        t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
        kept = min(1.0, factor * law.friction * normal / max(functions.hypot(t1, t2), 1e-30))
        t1, t2 = kept * t1, kept * t2
        held = normal * normal / law.normal_stiffness + (t1 * t1 + t2 * t2) / law.shear_stiffness
        return normal, t1, t2, 0.5 * held

    return law


def test_what_cannot_be_answered_is_refused_in_one_sentence():
    scenario = lab()
    strong = replace(scenario, joint=replace(scenario.joint, cohesion=1e3))
    for wrong, words, options in (
        (
            replace(scenario, control=dembrick.StaticsControl()),
            "followed only through a motion, step by step: give the law",
            {},
        ),
        (lab("convex"), 'formulation = "convex"', {}),
        (strong, "parameters of the law", {}),
        (scenario, "bound = True", {"bound": True}),
        (scenario, "refine = True", {"refine": True}),
    ):
        with pytest.raises(ScenarioError) as error:
            dembrick.simulate(wrong, law=coulomb, **options)
        assert words in str(error.value) and "\n" not in str(error.value)


def three_numbers(move, law, memory):
    return law.normal_stiffness * move.penetration, 0.0, 0.0


def unknown_field(move, law, memory):
    return law.toughness, 0.0, 0.0, 0.0


def no_number(move, law, memory):
    return math.nan, 0.0, 0.0, 0.0


@pytest.mark.parametrize("law", [three_numbers, unknown_field, no_number])
def test_a_law_that_does_not_work_is_refused(law):
    with pytest.raises(ScenarioError, match=f"the joint law {law.__name__} ") as error:
        dembrick.simulate(lab(), law=law)
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_law_that_fails_on_its_way_ends_the_run():
    @dembrick.joint_law(memory="slipped")
    def breaking(move, law, memory):
        memory.slipped += abs(move.slip_2)
        if memory.slipped > 1e-5:
            raise ValueError("too far")
        return law.normal_stiffness * max(move.penetration, 0.0), 0.0, 0.0, 0.0

    with pytest.raises(DembrickError):
        dembrick.simulate(lab(), law=breaking)


@pytest.mark.parametrize("kind", ["displacement", "base-motion"])
def test_an_energy_that_is_none_of_the_forces_is_refused(kind):
    @dembrick.joint_law
    def boasting(move, law, memory):
        normal = law.normal_stiffness * max(move.penetration, 0.0)
        t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
        t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
        kept = min(1.0, law.friction * normal / max(math.hypot(t1, t2), 1e-30))
        held = (kept * t1) ** 2 + (kept * t2) ** 2
        return normal, kept * t1, kept * t2, 0.5 * normal**2 / law.normal_stiffness + 1e7 * held / law.shear_stiffness

    scenario = lab()
    if kind == "base-motion":
        scenario = dembrick.load("newmark_pulse", ["joint.formulation=concave", "control.duration=0.1"])
    with pytest.raises(
        dembrick.EnergyAuditError, match="a custom joint law must return the energy that its springs store"
    ):
        dembrick.simulate(scenario, law=boasting)


def test_names_and_numbers():
    with pytest.raises(ScenarioError, match="memory = 'normal' is out of range: these names are reserved: normal"):
        dembrick.joint_law(coulomb, memory="normal")
    with pytest.raises(ScenarioError, match="parameters = 'friction'"):
        dembrick.joint_law(coulomb, friction=0.3)
    with pytest.raises(ScenarioError, match="this law has no such parameter; it has slip_distance, rise, residual"):
        FOLLOWING.with_parameters(length=1.0)
    with pytest.raises(ScenarioError, match="a function of"):
        dembrick.joint_law(3)
    with pytest.raises(ScenarioError, match="a name is listed twice"):
        dembrick.joint_law(coulomb, memory=["a", "a"])
    assert FOLLOWING.as_dict()["code"] != COULOMB.as_dict()["code"]


def test_a_history_tells_of_its_law_and_is_run_by_no_command(tmp_path, capsys):
    file = tmp_path / "own.h5"
    dembrick.simulate(lab(), file, law=FOLLOWING)
    with dembrick.read_history(file) as history:
        told = history.settings["custom_law"]
        assert told["name"] == "following" and told["parameters"]["rise"] == 0.2
        assert history.results["custom_law"] == told
    assert cli.main(["info", str(file)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "joint law following, of Python (slip_distance = 2e-05, rise = 0.2, residual = 0.5)" in said
    words = "its joints followed the law following of a user's Python, which no file holds"
    with pytest.raises(HistoryError, match=words):
        dembrick.load(file)
    with pytest.raises(HistoryError, match=words):
        dembrick.restart_at(file, 1.0, tmp_path / "new.h5")


def test_no_utilisation_is_told_of_a_strength_that_is_not_known(tmp_path):
    file = tmp_path / "own.h5"
    dembrick.simulate(lab(), file, law=FOLLOWING)
    with dembrick.read_history(file) as history:
        assert np.isnan(JointMotion(history).at([-1]).utilisation).all()


def test_the_page_of_the_manual_runs():
    page = Path(__file__).parents[2] / "docs" / "howto" / "laws.md"
    (code,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    names: dict = {}
    exec(code, names)
    point, brittle = names["result"].yield_point, names["brittle"].yield_point
    assert point.V_peak == pytest.approx(MU * N, rel=0.02)  # friction falls from the first slip on
    assert point.V == pytest.approx(0.5 * MU * N, rel=1e-3)
    assert brittle.V == pytest.approx(0.2 * MU * N, rel=1e-3)
