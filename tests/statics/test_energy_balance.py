"""The energy balance: it closes, each term agrees with a closed form, and a run with a wrong balance fails."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.errors import EnergyAuditError
from dembrick.kernels.state import WORK, Energy
from dembrick.kernels.statics.point_joints import Points
from dembrick.kernels.statics.point_joints import forces as point_forces
from dembrick.runs import lab
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.model import FORMULATIONS
from dembrick.scenario.protocols import Protocol
from dembrick.simulation import energy_audit
from dembrick.simulation.statics import constant_rate
from helpers.joints_of_engines import motion_of
from helpers.scenario_text import block, header, jack


def balance(name: str, formulation: str, rate: float | None = None):
    """Energies (T,) by name of a search, its audit and the search."""
    scenario = lab.lab_scenario(name, formulation)
    built = build.assemble(scenario)
    parts: list[dict] = []

    def observe(rows, _frames):
        parts.append(rows["energy"])

    control = scenario.control
    protocol = Protocol.one_way(control.travel, rate or control.rate)
    run = constant_rate.push_at_constant_rate(built, protocol, 0.9, observe)
    energies = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    return energies, energy_audit.Auditor().add(energies).result(run.energy), run


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_energy_balance_closes(formulation):
    _, result, _ = balance("set4a_curve", formulation)
    assert result.relative_residual < 1e-9
    assert result.least_friction_increment >= 0.0


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_friction_takes_what_the_loads_give_along_a_search(formulation):
    """Friction work equals the work of the loads, dead torques included: by the trapezoidal rule along the last step,
    much longer than the elastic ones."""
    scenario = lab.lab_scenario("set4a", formulation, 1e-5)
    beside = dataclasses.replace(scenario.loads[0], point=(0.005, -0.01, 0.05))
    energies = simulate(dataclasses.replace(scenario, loads=(beside,))).rows["energy"]
    given, friction, elastic = (np.diff(energies[name])[-1] for name in ("external", "friction", "elastic"))
    assert friction + elastic == pytest.approx(given, rel=2e-2 if formulation == "convex" else 1e-4)
    assert given > 0.0 and friction > 0.85 * given


@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
def test_a_block_pushed_near_its_top_overturns(formulation):
    """V = N (b / 2) / h."""
    scenario = lab.lab_scenario("set4a", formulation)
    jack = dataclasses.replace(scenario.actuators[0], point=(0.0, 0.0, 0.09))
    law = dataclasses.replace(scenario.joint, friction=9.0)
    point = simulate(dataclasses.replace(scenario, joint=law, actuators=(jack,)), record=False).yield_point
    assert point.mechanism == "rocking"
    assert point.V == pytest.approx(467.0 * 0.1 / 0.09, rel=1e-3)


def test_points_that_miss_the_continuum_are_not_passed_over():
    scenario = lab.lab_scenario("set4a", "distributed")
    jack = dataclasses.replace(scenario.actuators[0], point=(0.0, 0.0, 0.09))
    law = dataclasses.replace(scenario.joint, friction=1.5)
    result = simulate(dataclasses.replace(scenario, joint=law, actuators=(jack,)))
    assert abs(result.theory.discretisation_error) > 0.01
    assert result.points_miss == result.theory.discretisation_error
    assert not result.agrees()


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_work_and_friction_of_a_plateau_are_force_times_path(formulation):
    """At the limit the jack does the work V times its path, all of which friction dissipates."""
    energies, _, run = balance("set4a_curve", formulation)
    T = len(energies["external"])
    late = slice(T // 2, T - 1)
    path = np.ptp(np.arange(T)[late]) / (T - 1) * 2.5e-5
    V = run.yield_point.V
    assert np.ptp(energies["external"][late]) == pytest.approx(V * path, rel=5e-3)
    assert np.ptp(energies["friction"][late]) == pytest.approx(V * path, rel=5e-3)
    assert np.ptp(energies["elastic"][late]) < 1e-3 * V * path


def test_elastic_and_jack_energy_are_half_force_times_displacement():
    """Before anything slips, the springs store V u / 2."""
    scenario = lab.lab_scenario("set2a_curve", "convex")
    result = simulate(scenario)
    rows = result.rows
    i = int(np.argmax(rows["load"] > 0.5 * result.yield_point.V))
    weights = 2.0  # each of the two jacks moves by the driven displacement
    expected = 0.5 * weights * rows["load"][i] * rows["displacement"][i]
    assert rows["energy"]["elastic"][i] == pytest.approx(expected, rel=0.03)


def test_friction_work_meets_the_law_to_first_order_in_the_step():
    """Coarse against fine rate: the difference falls with the slip per step."""
    errors = [abs(balance("set4a_curve", "concave", rate=rate)[1].friction_law_error) for rate in (1e-3, 1e-4)]
    assert errors[0] < 1e-3
    assert errors[1] < 0.2 * errors[0]


def test_an_energy_balance_that_does_not_close_fails_the_run(monkeypatch):
    energies, _, run = balance("set4a_curve", "concave")
    wrong = dict(energies, friction=1.01 * energies["friction"])
    with pytest.raises(EnergyAuditError, match="off by 0.009"):
        energy_audit.Auditor().add(wrong).result(run.energy)
    giving = run.energy._replace(work=run.energy.work.copy())
    giving.work[0].least = -1e-6
    with pytest.raises(EnergyAuditError, match="friction gave back"):
        energy_audit.Auditor().add(energies).result(giving)
    slipping = run.energy._replace(work=run.energy.work.copy())
    slipping.work[0].by_law *= 1.2
    with pytest.raises(EnergyAuditError, match="friction work is off by -0.1"):
        energy_audit.Auditor().add(energies).result(slipping)
    monkeypatch.setattr(energy_audit, "LIMIT", 1e-20)
    with pytest.raises(EnergyAuditError):
        simulate(lab.lab_scenario("set4a_curve", "concave"))


def test_what_actuators_give_to_gravity_is_put_in_too():
    """A block that rocks far, V = W (b / 2 cos th - h / 2 sin th) / (h cos th + b sin th): the work of jack and gravity
    together is a few thousandths of the jack's."""
    b, h, travel = 0.4, 0.4, 2e-3
    text = header("concave", 1.5, 1e10) + block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true")
    text += block("stone", (0, 0, 0.5 * h), (b, b, h)) + jack("stone", (-0.5 * b, 0, h))
    text += f'[control]\nkind = "displacement"\nrate = 1e-4\ntravel = {travel}\n'
    result = simulate(toml.loads(text))
    weight, th = 2000.0 * b * b * h * 9.81, travel / h
    falls = weight * (0.5 * b * np.cos(th) - 0.5 * h * np.sin(th)) / (h * np.cos(th) + b * np.sin(th))
    assert result.rows["load"][-1] == pytest.approx(falls, rel=3e-3)
    assert abs(result.rows["energy"]["external"][-1]) < 5e-3 * falls * travel
    assert result.energy.relative_residual < 1e-4


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_brittle_bond_that_breaks_at_a_constant_rate_loses_what_its_springs_held(formulation):
    """A weightless block pressed by N: as the bond breaks the springs store (c A + mu N)^2 / (2 ks A), afterwards what
    they store at mu N. Blocks oscillate, so that the audit's limits without a bond do not hold."""
    A, N, mu, c, kn, travel = 0.08, 300.0, 0.5, 1e4, 1e10, 2e-5
    keys = f"cohesion = {c}\n" + ("points = [4, 3]\n" if formulation == "distributed" else "")
    text = header(formulation, mu, kn, gravity=(0.0, 0.0, 0.0), keys=keys)
    text += block("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    text += block("stone", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1)) + jack("stone", (0.0, 0.0, 0.0))
    text += f'[[loads]]\nblock = "stone"\nforce = [0.0, 0.0, {-N}]\npoint = [0.0, 0.0, 0.05]\n'
    text += f'[control]\nkind = "displacement"\nrate = 1e-4\ntravel = {travel}\n'
    result = simulate(toml.loads(text))
    strength, ks = c * A + mu * N, 0.4 * kn * A
    assert result.yield_point.V_peak == pytest.approx(strength, rel=5e-3)
    assert result.yield_point.V == pytest.approx(mu * N, rel=1e-6)
    lost = (strength**2 - (mu * N) ** 2) / (2.0 * ks)
    assert result.rows["energy"]["fracture"][-1] == pytest.approx(lost, rel=3e-3)
    gave_back = -result.energy.least_friction_increment / result.rows["energy"]["external"][-1]
    assert result.energy.relative_residual > energy_audit.LIMIT or gave_back > energy_audit.NEGATIVE


def test_the_json_carries_the_audit():
    result = simulate(lab.lab_scenario("set4a_curve", "convex"))
    shown = result.as_dict()["energy"]
    assert shown == dataclasses.asdict(result.energy)
    assert 0.0 <= shown["relative_residual"] < 1e-9


def naive_books(points, motions, viscous):
    """Friction, dashpot work and mu N |slip| of one point joint, point by point, as in `point_forces`."""
    count = len(points.k_n)
    elastic, dash, dash_n = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(count)
    friction = dashpots = by_law = 0.0
    mu = points.friction[0]
    for dn, r1, r2, pn, pr1, pr2, p1, p2, pr in motions:
        for i in range(count):
            x, y = points.x_n[i], points.y_n[i]
            penetration, closing = -(dn + r1 * y - r2 * x), -(pn + pr1 * y - pr2 * x)
            k = points.k_n[i]
            # contact that began within the step has lasted for g / d of it, and a force acts for half a step beyond it
            met = penetration + 0.5 * closing if 0.0 < penetration <= closing else closing
            normal = max(k * (penetration + viscous * met), 0.0) if penetration > 0.0 else 0.0
            s = np.array([p1 - pr * points.y_s[i], p2 + pr * points.x_s[i]])
            k_s, cap = points.k_s[i], mu * normal
            trial = elastic[i] + k_s * (1.0 + viscous) * s
            size = np.linalg.norm(trial)
            plastic = np.zeros(2) if size <= cap else (size - cap) / (k_s * (1.0 + viscous)) * trial / size
            if normal == 0.0:  # an open point stores nothing: its spring releases everything
                plastic = s + elastic[i] / k_s
            now = elastic[i] + k_s * (s - plastic)
            force = trial * min(1.0, cap / size) if size else trial
            work = 0.5 * (elastic[i] + now) @ plastic
            friction += work if cap > 0.0 else 0.0
            dashpots += work if cap == 0.0 else 0.0
            by_law += cap * np.linalg.norm(plastic)
            d, d_n = force - now, normal - k * max(penetration, 0.0)
            dashpots += 0.5 * (dash[i] + d) @ s + 0.5 * (dash_n[i] + d_n) * closing
            elastic[i], dash[i], dash_n[i] = now, d, d_n
    return friction, dashpots, by_law


def test_the_energy_terms_of_a_point_joint_against_points_one_by_one():
    """Dashpots are summed by their resultants: the same as point by point, also when points open and slide."""
    rng, opened = np.random.default_rng(5), 0
    for _ in range(20):
        n = 5
        arms, k = rng.uniform(-0.1, 0.1, size=(4, n)), rng.uniform(1e8, 3e8, size=(2, n))
        zero = np.zeros
        points = Points(np.zeros(1, np.int64), np.array([0, n]), np.array([0.64]), *arms, *k, *zero((4, n)), zero(1))
        dash, normal, before = zero((2, 6)), zero((1, 7)), zero(7)
        x, y = arms[:2]
        normal[0] = [*((k[0] * f).sum() for f in (1.0, x, y, x**2, y**2, x * y)), np.hypot(x, y).max()]
        energy = Energy(zero(1, WORK), np.zeros(0, np.int64), dash, normal)
        motion = np.array([-1e-6, 0.0, 0.0])
        motions = []
        for _ in range(40):
            change = rng.normal(size=3) * [3e-7, 3e-6, 3e-6]
            motion = motion + change
            motions.append((*motion, *change, *(rng.normal(size=3) * [1e-6, 1e-6, 1e-5])))
        for one in motions:
            seen = motion_of(one[:3], one[3:6], one[6:])
            before[:] = point_forces(points, 0, before.copy(), seen, (0.7, 0.7), energy)
        expected = naive_books(points, motions, 0.7)
        np.testing.assert_allclose(
            [energy.work[0][name] for name in ("sliding", "damping", "by_law")], expected, rtol=1e-11
        )
        opened += bool((points.normal == 0.0).any()) and bool((points.normal > 0.0).any())
    assert opened > 3
