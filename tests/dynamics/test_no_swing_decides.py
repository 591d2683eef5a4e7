"""Limits of walls whose brittle bonds break one after another on the way: the swing after a break leaves no trace.

After a break blocks swing to the next equilibrium, and rounding decides in which sense those move that are at rest. A
limit is the same in all units, and for increments of any length.
"""

from __future__ import annotations

import pytest

from dembrick.assembly import build
from dembrick.runs.drivers import driver_of
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import PushoverControl
from dembrick.scenario.model import Block, JointLaw, Material, Scenario
from dembrick.simulation.session import Session

WALLS = {
    "concave": (3, (0.3577, 0.2570), (0.656, 3.5775e8, 2249.0, 1600.0), (0.9726, 0.2324, 0.0)),
    "convex": (6, (0.4313, 0.2432), (0.532, 1.25286e9, 4369.0, 6382.0), (1.0, 0.0, 0.0)),
}


def wall(formulation: str, length: float = 1.0, force: float = 1.0) -> Scenario:
    """A small wall whose ``length`` and ``force`` units are multiples of the usual ones, under the same gravity."""
    count, (wide, high), (friction, stiffness, tension, cohesion), direction = WALLS[formulation]
    places = [(0.0, 0, 1.0), (1.0, 0, 1.0), (0.0, 1, 0.5), (0.5, 1, 1.0), (1.5, 1, 0.5), (0.0, 2, 1.0)]

    def block(name, x, z, along, up, fixed=False):
        ends = [(a, y, c) for c in (z, z + up) for y in (-0.125, 0.125) for a in (x, x + along)]
        return Block(name, "stone", fixed=fixed, vertices=tuple(tuple(length * v for v in at) for at in ends))

    blocks = [block("base", -1.0, -0.25, 3.0, 0.25, True)]
    for x, course, share in places[:count]:
        blocks.append(block(f"block {len(blocks)}", x * wide, course * high, share * wide, high))
    stress = force / length**2
    law = JointLaw(
        formulation, friction, stiffness * stress / length, stiffness * stress / length,
        cohesion=cohesion * stress, tensile_strength=tension * stress,
    )  # fmt: skip
    stone = {"stone": Material(2000.0 * force / length**3)}
    control = PushoverControl(direction, large_displacements=True)
    return Scenario("wall", (0.0, 0.0, -9.81), law, stone, tuple(blocks), control)


def bracket(scenario: Scenario, steps: float) -> tuple[float, float]:
    run = driver_of(scenario.control).run(scenario, build.assemble(scenario), Session(), steps)
    return run.bracket


@pytest.fixture(scope="module", params=WALLS)
def usual(request):
    """The formulation of a wall, and its run in the usual units."""
    return request.param, simulate(wall(request.param), record=False)


def test_a_limit_is_the_same_in_all_units(usual):
    """Units of half a metre and of 8 N make other roundings, as the time step is a root."""
    formulation, found = usual
    other = simulate(wall(formulation, 0.5, 8.0), record=False)
    assert other.collapse["load_factor"] == found.collapse["load_factor"]


def test_a_limit_is_the_same_for_shorter_increments(usual):
    formulation, found = usual
    (low, high), (least, most) = found.run.bracket, bracket(wall(formulation), 0.25)
    assert max(low, least) <= min(high, most) * (1.0 + 5e-4)
