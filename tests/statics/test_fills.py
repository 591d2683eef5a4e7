"""Fills on arches: weight and thrust in closed form, and limits equal to those of the same forces given by hand."""

import math

import numpy as np
import pytest

import dembrick
from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.scenario import toml
from helpers.scenario_text import header

SCENE = (
    header(friction=0.7, normal_stiffness=1e10)
    + """
[[arches]]
name = "arch"
material = "stone"
radius = 2.0
thickness = 0.4
depth = 0.8
voussoirs = 20
heading = {heading}
{fill}
[control]
kind = "pushover"
direction = [1.0, 0.0, 0.0]
"""
)
FILL = '[[fills]]\nblock = "arch"\nsurface = {surface}\nweight = 18000.0\n{state}\n'


def scene(state='pressure = "active"\nfriction_angle = 30.0', surface=3.0, heading=0.0):
    return toml.loads(SCENE.format(fill=FILL.format(surface=surface, state=state), heading=heading))


def corners(scenario):
    """Corners of the extrados (21, 2) in the plane of the arch, from the left springing to the right."""
    assembly = assemble(scenario)
    radius = max(
        np.linalg.norm((assembly.position[0] + assembly.rotation[0] @ v)[[0, 2]]) for v in assembly.shapes[0].vertices
    )
    angle = np.linspace(math.pi, 0.0, 21)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize(
    ("state", "ratio"),
    [
        ('pressure = "none"', 0.0),
        ('pressure = "at-rest"\nfriction_angle = 30.0', 0.5),
        ('pressure = "active"\nfriction_angle = 30.0', 1.0 / 3.0),
        ('pressure = "passive"\nfriction_angle = 30.0', 3.0),
        ("coefficient = 0.4", 0.4),
    ],
)
def test_weight_is_the_column_and_thrust_that_of_its_height(state, ratio):
    scenario = scene(state)
    loads, corner = assemble(scenario).point_loads, corners(scenario)
    width = np.diff(corner[:, 0])
    column = (width * (3.0 - 0.5 * (corner[1:, 1] + corner[:-1, 1]))).sum()
    assert loads.force[:, 2].sum() == pytest.approx(-18000.0 * 0.8 * column, rel=1e-9)
    rise = corner[10, 1]
    half = 18000.0 * 0.8 * ratio * (3.0**2 - (3.0 - rise) ** 2) / 2.0
    left = loads.at.block < 10
    assert loads.force[left, 0].sum() == pytest.approx(half, rel=1e-9, abs=1e-6)
    assert loads.force[~left, 0].sum() == pytest.approx(-half, rel=1e-9, abs=1e-6)
    assert np.abs(loads.force[:, 1]).max() < 1e-6


def test_moment_is_that_of_the_stress_over_the_face():
    # about the axis of the arch, by Simpson's rule, which is exact for a stress linear times a lever linear
    scenario = scene("coefficient = 0.4")
    assembly, corner = assemble(scenario), corners(scenario)
    loads = assembly.point_loads
    point = assembly.position[loads.at.block] + loads.at.arm
    moment = np.cross(point, loads.force)[:, 1]
    expected = []
    for a, b in zip(corner[:-1], corner[1:], strict=True):
        dx, dz = b - a
        at = [a, 0.5 * (a + b), b]
        levers = [18000.0 * 0.8 * (3.0 - z) * (x * dx + z * 0.4 * dz) for x, z in at]
        expected.append((levers[0] + 4.0 * levers[1] + levers[2]) / 6.0)
    order = np.argsort(loads.at.block)
    assert moment[order] == pytest.approx(np.array(expected), rel=1e-9, abs=1e-3)


def test_a_surface_below_the_crown_loads_what_is_under_it():
    scenario = scene('pressure = "none"', surface=1.5)
    loads, corner = assemble(scenario).point_loads, corners(scenario)
    total = 0.0
    for a, b in zip(corner[:10], corner[1:11], strict=True):
        top = min(b[1], 1.5)
        if top > a[1]:
            x = a[0] + (b[0] - a[0]) * (top - a[1]) / (b[1] - a[1])
            total += (x - a[0]) * (1.5 - 0.5 * (a[1] + top))
    assert loads.force[:, 2].sum() == pytest.approx(-2.0 * 18000.0 * 0.8 * total, rel=1e-9)


def test_limit_is_that_of_the_same_forces_by_hand():
    filled = scene()
    assembly = assemble(filled)
    loads, names = assembly.point_loads, assembly.names
    by_hand = "".join(
        f'[[loads]]\nblock = "{names[b]}"\nforce = {f.tolist()}\npoint = {(assembly.position[b] + arm).tolist()}\n'
        for b, arm, f in zip(loads.at.block, loads.at.arm * (1.0 - 1e-9), loads.force, strict=True)
    )
    other = toml.loads(SCENE.format(fill=by_hand, heading=0.0))
    bound = dembrick.limit(filled).load_factor
    assert bound == pytest.approx(dembrick.limit(other).load_factor, rel=1e-6)
    bare = dembrick.limit(toml.loads(SCENE.format(fill="", heading=0.0))).load_factor
    assert bound > 1.05 * bare  # the fill centres the thrust
    assert dembrick.simulate(filled).yield_point.V <= bound * (1.0 + 1e-6)


def test_a_turned_arch_bears_the_same():
    assert dembrick.limit(scene("coefficient = 0.4")).load_factor > 0.0
    straight, turned = (assemble(scene("coefficient = 0.4", heading=h)).point_loads.force for h in (0.0, 90.0))
    assert np.abs(turned[:, 1]) == pytest.approx(np.abs(straight[:, 0]), rel=1e-9, abs=1e-3)
    assert turned[:, 2] == pytest.approx(straight[:, 2], rel=1e-9, abs=1e-3)


def test_real_time_carries_the_fill():
    # an arch in equilibrium under its fill stands, and its supports carry the weight of the fill
    text = SCENE.format(fill=FILL.format(surface=3.0, state="coefficient = 0.4"), heading=0.0)
    text = text[: text.index("[control]")] + '[control]\nkind = "dynamic"\nduration = 0.02\nrestitution = 0.2\n'
    scenario = toml.loads(text)
    result = dembrick.simulate(scenario)
    assembly = assemble(scenario)
    weight = assembly.mass[~assembly.fixed].sum() * 9.81 - assembly.point_loads.force[:, 2].sum()
    borne = sum(reaction[2] for reaction in result.reactions.values())
    assert borne == pytest.approx(weight, rel=1e-2)


def test_a_text_is_read_back():
    scenario = scene()
    assert toml.loads(toml.dumps(scenario)) == scenario


@pytest.mark.parametrize(
    ("state", "surface", "words"),
    [
        ("", 3.0, "needs either pressure (none, at-rest, active, passive), or coefficient"),
        ('pressure = "active"', 3.0, "needs friction_angle (deg)"),
        ('pressure = "none"\nfriction_angle = 30.0', 3.0, "it belongs to pressure = at-rest, active or passive only"),
        ('pressure = "active"\nfriction_angle = 75.0', 3.0, "it must lie between 0 and 60 deg"),
        ("coefficient = -0.1", 3.0, "it must be at least 0"),
        ("coefficient = 0.4", -1.0, "no free block of it has a bare upward face below surface = -1 m"),
        ('pressure = "passiv"\nfriction_angle = 30.0', 3.0, "passive"),
    ],
)
def test_what_is_wrong_is_said(state, surface, words):
    with pytest.raises(ScenarioError, match=".*") as error:
        assemble(scene(state, surface))
    assert words in str(error.value)


def test_a_tilt_refuses_a_fill_and_an_unknown_block_is_named():
    text = SCENE.format(fill=FILL.format(surface=3.0, state="coefficient = 0.4"), heading=0.0)
    tilt = text[: text.index("[control]")] + '[control]\nkind = "tilt"\naxis = [0.0, 1.0, 0.0]\n'
    with pytest.raises(ScenarioError, match="a tilt turns loads like gravity"):
        assemble(toml.loads(tilt))
    with pytest.raises(ScenarioError, match="block of fill number 1 = 'arc' is not the name"):
        toml.loads(text.replace('block = "arch"', 'block = "arc"'))


SHAKEN = """[control]
kind = "base-motion"
duration = 1.0
quantity = "acceleration"
direction = [1.0, 0.0, 0.0]
sine = { amplitude = 1.0, frequency = 2.0 }
"""


@pytest.mark.parametrize("doing", ["pushed", "shaken"])
def test_the_weight_of_a_fill_that_is_not_pushed_or_shaken_is_told(doing):
    scenario, corner = scene(), corners(scene())
    text = toml.dumps(scenario)
    if doing == "shaken":
        text = text[: text.index("[control]")] + SHAKEN
    fill = 18000.0 * 0.8 * (np.diff(corner[:, 0]) * (3.0 - 0.5 * (corner[1:, 1] + corner[:-1, 1]))).sum()
    inner, outer = 2.0 - 0.2, 2.0 + 0.2
    stones = 0.8 * 20 * math.sin(math.pi / 20) * (outer**2 - inner**2) / 2.0  # m3, of straight-sided voussoirs
    material = scenario.materials["stone"].density * 9.81 * stones
    (said,) = (one for one in assemble(toml.loads(text)).warnings if "[[fills]]" in one)
    assert f"{fill:.6g} N or {100.0 * fill / (fill + material):.2g} %" in said
    assert f"is not {doing}" in said


def test_loads_without_mass_are_told_apart_and_no_uplift_is():
    load = '[[loads]]\nblock = "arch.{}"\nforce = [0.0, 0.0, {}]\n'
    text = SCENE.format(fill=load.format(10, -1000.0) + load.format(11, -500.0), heading=0.0)
    (said,) = assemble(toml.loads(text)).warnings
    assert "weight of [[loads]], 1500 N" in said
    assert not assemble(toml.loads(SCENE.format(fill=load.format(10, 1000.0), heading=0.0))).warnings


@pytest.mark.parametrize(
    "keys", ["", "large_displacements = true\n", "quasi_static = false\nrate = 1.0\ndisplacement = 0.1\n"]
)
def test_tilts_refuse_fills_in_every_geometry(keys):
    text = toml.dumps(scene())
    tilt = f'[control]\nkind = "tilt"\naxis = [0.0, 1.0, 0.0]\n{keys}'
    with pytest.raises(ScenarioError, match="sideways pressure"):
        assemble(toml.loads(text[: text.index("[control]")] + tilt))
