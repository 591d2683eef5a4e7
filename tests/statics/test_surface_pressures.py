"""Surface pressures: resultants in closed form, and limits of the dams and retaining walls under them."""

import numpy as np
import pytest

import dembrick
from dembrick.assembly.build import assemble
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.history import read
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.key_lines import words
from helpers.scenario_text import block, header

BASE = block("base", (0.0, 0.0, -0.1), (4.0, 1.0, 0.2), "fixed = true")
DRIVEN = "actuator = true"
WATER = "surface = 1.2\nweight = 9810.0"
FILL = "surface = 2.0\nweight = 6000.0"


def courses(widths, height, back=None):
    """Blocks dam.1 and so on upwards, 1 m deep; their backs flush at x = ``back``, or centred."""
    entries = []
    for i, width in enumerate(widths):
        x = 0.0 if back is None else back + 0.5 * width
        entries.append(block(f"dam.{i + 1}", (x, 0.0, height * (i + 0.5)), (width, 1.0, height)))
    return "".join(entries)


SIX = courses([0.6] * 6, 0.2)
STEPPED = courses([1.0, 0.8, 0.6, 0.4], 0.5, back=0.0)


def scene(blocks, pressure, friction=0.64, control='kind = "yield"'):
    pressure = f'[[pressures]]\nblock = "dam"\ndirection = [-1.0, 0.0, 0.0]\n{pressure}\n'
    return toml.loads(
        header(friction=friction, normal_stiffness=1e10) + BASE + blocks + pressure + f"[control]\n{control}"
    )


@pytest.mark.parametrize(
    "blocks, pressure, friction, expected, mechanism",
    [
        (SIX, WATER, 0.64, 2 * 0.64 * 2000 * 9.81 * 0.6 / (9810 * 1.2), "sliding"),
        (SIX, WATER, 0.3, 2 * 0.3 * 2000 * 9.81 * 0.6 / (9810 * 1.2), "sliding"),
        (SIX, WATER, 2.0, 3 * 2000 * 9.81 * 0.6**2 / (9810 * 1.2**2), "rocking"),
        (SIX, "surface = 0.9\nweight = 9810.0", 0.64, 2 * 0.64 * 2000 * 9.81 * 0.6 * 1.2 / (9810 * 0.9**2), "sliding"),
        (SIX, "value = 5000.0", 0.64, 2000 * 9.81 * 0.6**2 / (5000 * 1.2), "rocking"),
        (STEPPED, FILL, 0.3, 0.68670, "sliding"),
        (STEPPED, FILL, 0.45, 1.03005, "sliding"),
        (STEPPED, FILL, 0.64, 1.46496, "sliding"),
        (STEPPED, FILL, 1.5, 2.10915, "rocking"),
    ],
)
def test_the_limit_of_a_driven_pressure(blocks, pressure, friction, expected, mechanism):
    point = simulate(scene(blocks, f"{pressure}\n{DRIVEN}", friction), record=False).yield_point
    assert point.V == pytest.approx(expected, rel=1e-5)
    assert point.V_lower <= expected * (1 + 1e-6) and expected * (1 - 1e-6) <= point.V_upper
    assert point.mechanism == mechanism


@pytest.mark.parametrize("z1, z2", [(0.0, 0.2), (0.4, 0.6), (0.8, 1.0)])
def test_force_and_centre_of_a_fluid_on_a_face(z1, z2):
    """F = gamma a (z2 - z1)(z_s - (z1 + z2)/2); the last face is cut by the surface at 0.9 m."""
    loads = assemble(scene(SIX, "surface = 0.9\nweight = 9810.0", control=PUSH)).point_loads
    row = int(round(z1 / 0.2))
    top = min(z2, 0.9)
    force = 9810.0 * (top - z1) * (0.9 - 0.5 * (z1 + top))
    height = 9810.0 * (0.9 * (top**2 - z1**2) / 2 - (top**3 - z1**3) / 3) / force
    np.testing.assert_allclose(loads.force[row], [force, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(loads.at.arm[row], [-0.3, 0.0, height - (z1 + 0.1)], atol=1e-12)
    assert loads.at.block[row] == row + 1 and len(loads.at.block) == 5  # the course above the water carries none


PUSH = 'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]'


def test_a_dead_pressure_lowers_the_load_factor_that_is_left():
    """Moments about the toe: rho g b H (b/2 - lambda H/2) = gamma H^3 / 6; and sliding on the foot."""
    b, H, rho, gamma, mu = 0.6, 1.2, 2000.0, 9810.0, 0.64
    overturning = b / H - gamma * H / (3 * rho * 9.81 * b)
    sliding = mu - gamma * H / (2 * rho * 9.81 * b)
    point = simulate(scene(SIX, WATER, mu, PUSH), record=False).yield_point
    assert point.V == pytest.approx(min(overturning, sliding), rel=1e-5)


def test_a_tilt_in_the_geometry_of_the_start_refuses_pressures():
    """They rotate with the table, gravity does not; test_pressures_follow_faces covers the tilt that allows for it."""
    tilt = 'kind = "tilt"\naxis = [0.0, 1.0, 0.0]'
    with pytest.raises(ScenarioError, match="stay normal to the faces"):
        assemble(scene(courses([0.6], 1.2), "value = 5000.0", 0.64, tilt))


def test_a_covered_face_feels_no_pressure():
    """Two blocks side by side: the joint between them carries no pressure, only the exposed end does."""
    beside = courses([0.6], 1.2) + block("dam.b", (0.6, 0.0, 0.25), (0.6, 1.0, 0.5))
    loads = assemble(scene(beside, "value = 5000.0", control=PUSH)).point_loads
    np.testing.assert_allclose(loads.force[:, 0].sum(), 5000.0 * 1.2, rtol=1e-12)
    upright = scene(beside, "value = 5000.0", control=PUSH)
    turned = toml.loads(toml.dumps(upright).replace("direction = [-1.0, 0.0, 0.0]", "direction = [1.0, 0.0, 0.0]", 1))
    loads = assemble(turned).point_loads  # of the tall block only the part above the low one, and that in full
    np.testing.assert_allclose(sorted(loads.force[:, 0]), [-5000.0 * 0.7, -5000.0 * 0.5], rtol=1e-12)
    np.testing.assert_allclose(loads.at.arm[loads.at.block == 1], [[0.3, 0.0, 0.5 + 0.35 - 0.6]], atol=1e-12)


UPLIFT = '[[pressures]]\nblock = "stone"\ndirection = [0.0, 0.0, -1.0]\nvalue = 10000.0\n'


def on_a_pedestal(control, pedestal=(1.2, 0.5)):
    """A stone of two cubes of 1 m side by side, both on a pedestal, under an uplift of 10 kPa."""
    cubes = ", ".join(f"{{ box = [1.0, 1.0, 1.0], position = [{x}, 0.0, 0.5] }}" for x in (0.5, 1.5))
    stone = f'[[blocks]]\nname = "stone"\nmaterial = "stone"\nparts = [{cubes}]\n'
    base = block("base", (0.9, 0.0, -0.5), (*pedestal, 1.0), "fixed = true")
    return toml.loads(header("convex", 0.6) + base + stone + UPLIFT + f"[control]\n{control}\n")


BARE, WEIGHT = 2.0 - 1.2 * 0.5, 2.0 * 2000.0 * 9.81


def test_a_joint_covers_of_each_part_what_lies_on_it():
    """Two parts share a joint, whose full area was once subtracted from the faces of both."""
    result = simulate(on_a_pedestal('kind = "statics"'), record=False)
    assert result.reactions["base"][2] == pytest.approx(WEIGHT - 1e4 * BARE, rel=1e-9)
    assert result.reactions["base"][4] == pytest.approx(0.9 * (WEIGHT - 1e4 * BARE) - WEIGHT + 1e4 * (2.0 - 0.6 * 0.9))
    expected = 0.6 * (1.0 - 1e4 * BARE / WEIGHT)
    push = 'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\nlarge_displacements = '
    for large, tilts in (("false", 1e-6), ("true", 1e-3)):  # by 1e-4 rad, on the springs of the joint
        assert simulate(on_a_pedestal(push + large), record=False).yield_point.V == pytest.approx(expected, rel=tilts)
    proven = dembrick.limit(on_a_pedestal(push + "false"))
    assert proven.lower <= expected * (1 + 1e-9) and expected * (1 - 1e-9) <= proven.upper


def test_covered_faces_of_parts_are_not_sucked_down_in_real_time():
    result = simulate(on_a_pedestal('kind = "dynamic"\nduration = 0.01', (2.4, 1.0)), record=False)
    assert abs(result.reactions["base"][2] - WEIGHT) < 1e-6 * WEIGHT


@pytest.mark.parametrize(
    "pressure, message",
    [
        ("value = 5000.0\nsurface = 1.0\nweight = 9810.0", "either value"),
        ("surface = 1.0", "either value"),
        ("value = -5.0", "greater than 0 Pa"),
        ("surface = -3.0\nweight = 9810.0", "no free block of it has a bare face"),
        ("value = 1.0\nactuators = true", "did you mean 'actuator'"),
    ],
)
def test_a_pressure_that_cannot_be_is_refused(pressure, message):
    with pytest.raises(ScenarioError, match=message):
        assemble(scene(SIX, pressure, control=PUSH))


def test_a_driven_pressure_needs_a_control_that_drives():
    with pytest.raises(ScenarioError, match="drives no pressure"):
        assemble(scene(SIX, f"{WATER}\n{DRIVEN}", control=PUSH))
    with pytest.raises(ScenarioError, match="none; add"):
        scene(SIX, WATER)


def test_round_trip_through_toml():
    given = scene(SIX, f"{WATER}\n{DRIVEN}")
    assert toml.loads(toml.dumps(given)) == given


def test_the_multiplier_of_a_pressure_has_no_unit(tmp_path, capsys):
    """V is a force if an actuator pushes; a multiplier of pressures is a factor, in history and text."""
    path = tmp_path / "dam.h5"
    assert main(["run", "dam", "--out", str(path)]) == 0
    assert "load factor 1.28000000 +- 1.2e-07 (indicator" in words(capsys.readouterr().out)
    with read(path) as history:
        assert (history.curve.load, history.curve.unit) == ("load factor V", "1")
    result = dembrick.simulate("dam", record=False)
    assert "load factor 1.28" in repr(result) and " N" not in repr(result)
