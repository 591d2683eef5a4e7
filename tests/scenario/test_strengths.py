"""Joint strengths in scenarios: refusals, inheritance and warnings."""

import re

import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.model import JointLaw
from helpers.scenario_text import block, header

BLOCKS = block("bed", (0.0, 0.0, -0.05), (1.0, 1.0, 0.1), "fixed = true") + block("block", (0.0, 0.0, 0.05))
STATICS, SHAKE = 'kind = "statics"', 'kind = "dynamic"\nduration = 0.1'


def text_of(keys, formulation="concave", control=STATICS):
    return f"{header(formulation, 0.5, 1e10, keys=keys)}{BLOCKS}[control]\n{control}\n"


def given(keys, formulation="concave", control=STATICS):
    return toml.loads(text_of(keys, formulation, control))


@pytest.mark.parametrize(
    "keys, said",
    [
        ("cohesion = -1.0", "cohesion = -1.0 .*at least 0 Pa"),
        ("tensile_strength = -1.0", "tensile_strength = -1.0 .*at least 0 Pa"),
        ("compressive_strength = 0.0", "compressive_strength = 0.0 .*greater than 0 Pa"),
        ("residual_friction = 0.6", "residual_friction = 0.6 .*must not be above friction = 0.5"),
        ("residual_cohesion = 2.0", "residual_cohesion = 2.0 .*must not be above cohesion = 0 Pa"),
        ("dilation = 0.6", "dilation = 0.6 .*must not be above friction = 0.5.*create energy"),
        ("dilation = 0.4\nresidual_friction = 0.3", "dilation = 0.4 .*must not be above residual_friction = 0.3"),
        ("tensile_strength = 1e4\ncohesion = 4e3", "cohesion must be at least friction x tensile_strength = 5000 Pa"),
        ("cohesion = true", "cohesion"),
        ("cohesions = 1.0", "did you mean 'cohesion'"),
    ],
)
def test_refused(keys, said):
    with pytest.raises(ScenarioError) as error:
        given(keys)
    assert re.search(said, str(error.value)), error.value


@pytest.mark.parametrize(
    "keys, formulation, control, said",
    [
        ('cohesion = 1.0\npressure = "linear"', "convex", STATICS, 'pressure = "full"'),
        ("compressive_strength = 1e6", "convex", SHAKE, '"distributed"'),
    ],
)
def test_refused_by_what_is_done_with_it(keys, formulation, control, said):
    with pytest.raises(ScenarioError) as error:
        assemble(given(keys, formulation, control))
    assert said in str(error.value)


def test_a_quasi_static_tilt_knows_friction_alone():
    tilt = 'kind = "tilt"\naxis = [1.0, 0.0, 0.0]'
    with pytest.raises(ScenarioError, match="a tilt with a rate"):
        simulate(given("cohesion = 1.0", control=tilt))
    # the rear points slip first; then 0.3 (1/2 - x/4) + 0.5 (1/2 + x/4) = x, with the moment of x at half the height
    found = simulate(given("residual_friction = 0.3", control=tilt), record=False)
    assert found.yield_point.V_peak == pytest.approx(8.0 / 19.0, rel=1e-3)


def test_what_a_law_does_not_say_by_itself():
    brittle = assemble(given("cohesion = 1e4")).warnings
    assert any("bonds are brittle" in warning for warning in brittle)
    assert not assemble(given("cohesion = 1e4\nresidual_cohesion = 1e4")).warnings
    crushing = assemble(given("compressive_strength = 1e6")).warnings
    assert any("miss the crushing of a toe" in warning for warning in crushing)


def test_overrides_inherit_strengths_and_a_text_reads_back():
    text = text_of("cohesion = 1e4\nresidual_cohesion = 5e3")
    text += '\n[[joints]]\nbetween = ["bed", "block"]\nfriction = 0.3\nresidual_friction = 0.2\n'
    scenario = toml.loads(text)
    law = scenario.joints[0].law
    assert (law.cohesion, law.cohesion_after, law.friction_after) == (1e4, 5e3, 0.2)
    assert toml.loads(toml.dumps(scenario)) == scenario


def test_what_is_dry():
    plain = {"formulation": "concave", "friction": 0.5, "normal_stiffness": 1e10, "shear_stiffness": 4e9}
    assert JointLaw(**plain).dry and JointLaw(**plain, residual_friction=0.5, residual_cohesion=0.0).dry
    for more in ({"cohesion": 1.0}, {"residual_friction": 0.4}, {"dilation": 0.1}, {"compressive_strength": 1e6}):
        assert not JointLaw(**plain, **more).dry
