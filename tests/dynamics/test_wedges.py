"""Coulomb's earth pressure: a wedge between a slip plane and a wall that yields or is pushed in."""

import math

import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.model import JointLaw, JointOverride, Material, Output, Scenario
from dembrick.simulation.dynamics.paths import load_path
from helpers.stone_scenes import of_stone

G, DENSITY = 9.81, 1800.0


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Compute fewer equilibria on the path."""
    monkeypatch.setattr(load_path, "EQUILIBRIA", 30)


def prism(name: str, outline: list[tuple[float, float]], fixed: bool = False) -> Block:
    """A block 1 m deep over an outline of (x, z) in m."""
    corners = tuple((x, y, z) for y in (-0.5, 0.5) for x, z in outline)
    return Block(name, "stone", vertices=corners, fixed=fixed)


def wedge(height: float, slope: float, friction: float, wall_friction: float, travel: float, kn: float) -> Scenario:
    """Soil above a plane that rises at ``slope`` (rad) from the foot of a wall, which moves by ``travel`` (m)."""
    width = height / math.tan(slope)
    c, s = math.cos(slope), math.sin(slope)
    low, high = -0.2, 1.4 * math.hypot(width, height)
    face = [(low * c, low * s), (high * c, high * s)]
    rock = face + [(x + 0.3 * s, z - 0.3 * c) for x, z in reversed(face)]
    wall = [(-0.3, 0.08 * height), (0.0, 0.08 * height), (0.0, 1.25 * height), (-0.3, 1.25 * height)]
    blocks = (
        prism("soil", [(0.0, 0.0), (width, height), (0.0, height)]),
        prism("rock", rock, True),
        prism("wall", wall, True),
    )
    laws = (JointLaw("concave", tan, kn, 0.4 * kn) for tan in (friction, wall_friction))
    law, at_wall = laws
    control = SettlementControl(("wall",), (travel, 0.0, 0.0))
    joints = (JointOverride(("soil", "wall"), at_wall),)
    stone = {"stone": Material(DENSITY)}
    output = Output(("frames",))
    return of_stone(law, control, blocks, materials=stone, joints=joints, output=output)


@pytest.mark.parametrize(
    ("active", "height", "slope", "friction", "wall_friction", "travel", "kn"),
    [
        (True, 2.0, 59.394, 35.0, 20.0, -2e-3, 1e11),  # the slip plane of Coulomb's greatest thrust; once .53 % off
        (True, 2.02, 69.0, 18.6, 23.9, -1.6e-3, 2.5e10),
        (False, 2.73, 34.5, 22.2, 7.1, 1e-3, 5.1e10),
    ],
)
def test_earth_pressure(active, height, slope, friction, wall_friction, travel, kn):
    """Both joints slide with full friction as long as the wall moves: with t = slope -+ phi, N = W tan(t) / (1 +-
    tan(t) tan(delta))."""
    slope, phi, delta = (math.radians(angle) for angle in (slope, friction, wall_friction))
    side = 1.0 if active else -1.0
    along = math.tan(slope - side * phi)
    weight = 0.5 * height**2 / math.tan(slope) * DENSITY * G
    thrust = weight * along / (1.0 + side * along * math.tan(delta))
    found = simulate(wedge(height, slope, math.tan(phi), math.tan(delta), travel, kn), record=False, progress=False)
    assert found.status == "completed"
    sliding = abs(found.run.path[12:, 1])  # after the elastic displacement of the joints
    assert sliding == pytest.approx(thrust, rel=1e-4)
