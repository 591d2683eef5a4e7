"""A NaN in a solver is an error: every comparison with it is false, so an engine might report equilibrium or proof."""

import copy
from dataclasses import replace

import numpy as np
import pytest

import dembrick
from dembrick.assembly import build
from dembrick.errors import DivergedError
from dembrick.scenario import toml
from dembrick.simulation.dynamics import state as dynamic_state
from dembrick.simulation.floating_point import faults_raised, not_nan
from dembrick.simulation.statics import joint_families
from helpers.scenario_text import block, header, jack

CONTROLS = {
    "yield": "kind = 'yield', tolerance = 1e-3",
    "displacement": "kind = 'displacement', rate = 1e-4, travel = 1e-4",
    "yield, deformed": "kind = 'yield', tolerance = 1e-3, large_displacements = true",
    "displacement, deformed": "kind = 'displacement', rate = 1e-4, travel = 1e-4, large_displacements = true",
    "tilt": "kind = 'tilt', axis = [0, 1, 0]",
    "pushover": "kind = 'pushover', direction = [1, 0, 0]",
    "statics": "kind = 'statics'",
    "statics, deformed": "kind = 'statics', large_displacements = true",
    "dynamic": "kind = 'dynamic', duration = 0.01",
    "base": "kind = 'base-motion', duration = 0.01, direction = [1, 0, 0], sine = {amplitude = 1, frequency = 5}",
    "settlement": "kind = 'settlement', supports = ['floor'], displacement = [0, 0, -0.001]",
}


def stack(control: str, formulation: str, blocks: int = 1):
    """Blocks of .3 x .2 x .2 m on a floor; the upper one is pushed if the control drives an actuator."""
    text = f"control = {{{CONTROLS[control]}}}" + header(formulation, 0.6, 1e10)
    text += block("floor", (0, 0, -0.1), (1, 1, 0.2), "fixed = true")
    text += "".join(block(f"stone{i}", (0, 0, 0.1 + 0.2 * i), (0.3, 0.2, 0.2)) for i in range(blocks))
    if control.split(",")[0] in ("yield", "displacement"):
        text += jack(f"stone{blocks - 1}", (-0.15, 0.05, 0.2 * blocks - 0.1))
    return toml.loads(text)


@pytest.fixture(params=["concave", "convex"])
def formulation(request):
    return request.param


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("what", ["friction", "dead_force", "position"])
def test_no_engine_starts_from_what_is_no_number(control, what, monkeypatch):
    """A NaN in the assembly that `build` makes of a scenario: friction of a law, weight or position of a block."""
    spoiled = []

    def check(assembly):
        n = len(assembly.names) - 1
        if what == "friction":
            law = copy.copy(assembly.joints.law[0])
            object.__setattr__(law, "friction", np.nan)
            assembly = replace(assembly, joints=replace(assembly.joints, law=(law, *assembly.joints.law[1:])))
        else:
            values = np.array(getattr(assembly, what), float)
            values[n, 0] = np.nan
            assembly = replace(assembly, **{what: values})
        spoiled.append(assembly)
        sound(assembly)

    sound = build.check_finite
    monkeypatch.setattr(build, "check_finite", check)
    with pytest.raises(DivergedError, match="not a finite number"):
        dembrick.simulate(stack(control, "concave"), record=False)
    assert spoiled


@pytest.mark.parametrize("control", CONTROLS)
def test_a_state_that_is_no_number_has_no_answer(control, formulation, monkeypatch):
    """A NaN that arises during a run: in the stiffness of a joint record or the inertia of the bodies."""
    at_rest, bodies = joint_families.at_rest, dynamic_state._bodies

    def joints(assembly):
        found = at_rest(assembly)
        for record in found:
            for name in () if record is None else {"k_n", "K_n", "area"} & set(record._fields):
                getattr(record, name).flat[0] = np.nan
        return found

    def masses(*given):
        found = bodies(*given)
        for name in (name for name in found._fields if "mass" in name):
            getattr(found, name)[...] = np.nan
        return found

    monkeypatch.setattr(joint_families, "at_rest", joints)
    monkeypatch.setattr(dynamic_state, "_bodies", masses)
    for blocks in (1, 2):
        with pytest.raises(dembrick.DembrickError):
            dembrick.simulate(stack(control, formulation, blocks), record=False)


def test_a_fault_is_raised_and_not_warned_of():
    with pytest.raises(DivergedError, match="floating-point error"), faults_raised():
        np.zeros(1) / np.zeros(1)
    with faults_raised(), np.errstate(divide="ignore"):
        assert np.ones(1) / np.zeros(1) == np.inf  # where infinity is intended
    with pytest.raises(DivergedError, match="the load is not a number"):
        not_nan(np.nan, "the load")
    assert not_nan(2.0, "the load") == 2.0
