"""The energy books: they balance, each term is what a closed form says, and a run whose books do not balance fails."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dembrick import assembly, audit, lab, replay
from dembrick.errors import EnergyAuditError
from dembrick.model import FORMULATIONS
from dembrick.result import simulate


def books(name: str, formulation: str, step_factor: float = 0.9, rate: float | None = None):
    """Energies (T,) by name of a replay, its audit and the replay."""
    scenario = lab.lab_scenario(name, formulation)
    built = assembly.build(scenario)
    parts: list[dict] = []

    def observe(rows, _frames):
        parts.append(rows["energy"])

    control = scenario.control
    if control.kind == "yield":
        run = replay.find_limit_load(built, 1e-4, step_factor, observe)
    else:
        run = replay.push_at_constant_rate(built, rate or control.rate, control.travel, step_factor, observe)
    energies = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    return energies, audit.audit(energies, run.energy), run


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ["set2a", "set4a", "set4a_curve"])
def test_the_books_balance(name, formulation):
    _, result, _ = books(name, formulation)
    assert result.relative_residual < 1e-9
    assert result.least_friction_increment >= 0.0


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_work_and_friction_of_a_plateau_are_force_times_path(formulation):
    """At the limit the jack works V times its path, and friction takes all of it."""
    energies, _, run = books("set4a_curve", formulation)
    T = len(energies["external"])
    late = slice(T // 2, T - 1)
    path = np.ptp(np.arange(T)[late]) / (T - 1) * 2.5e-5
    V = run.yield_point.V
    assert np.ptp(energies["external"][late]) == pytest.approx(V * path, rel=5e-3)
    assert np.ptp(energies["friction"][late]) == pytest.approx(V * path, rel=5e-3)
    assert np.ptp(energies["elastic"][late]) < 1e-3 * V * path


def test_elastic_and_jack_energy_are_half_force_times_displacement():
    """Before anything slips, the springs hold V u / 2."""
    scenario = lab.lab_scenario("set2a_curve", "convex")
    result = simulate(scenario)
    rows = result.rows
    i = int(np.argmax(rows["load"] > 0.5 * result.yield_point.V))
    weights = 2.0  # two jacks move by the driven displacement each
    expected = 0.5 * weights * rows["load"][i] * rows["displacement"][i]
    assert rows["energy"]["elastic"][i] == pytest.approx(expected, rel=0.03)


def test_friction_work_meets_the_law_to_first_order_in_the_step():
    """Coarse against fine rate: the difference falls with the slip of a step."""
    errors = [abs(books("set4a_curve", "concave", rate=rate)[1].friction_law_error) for rate in (1e-3, 1e-4)]
    assert errors[0] < 1e-3
    assert errors[1] < 0.2 * errors[0]


def test_books_that_do_not_balance_fail_the_run(monkeypatch):
    energies, _, run = books("set4a", "concave")
    wrong = dict(energies, friction=1.01 * energies["friction"])
    with pytest.raises(EnergyAuditError, match="off by 0.009"):
        audit.audit(wrong, run.energy)
    giving = run.energy._replace(least=np.array([-1e-6]))
    with pytest.raises(EnergyAuditError, match="friction gave back"):
        audit.audit(energies, giving)
    monkeypatch.setattr(audit, "LIMIT", 1e-20)
    with pytest.raises(EnergyAuditError):
        simulate(lab.lab_scenario("set4a", "concave"))


def test_the_json_carries_the_audit():
    result = simulate(lab.lab_scenario("set4a", "convex"))
    shown = result.as_dict()["energy"]
    assert shown == dataclasses.asdict(result.energy)
    assert 0.0 <= shown["relative_residual"] < 1e-9
