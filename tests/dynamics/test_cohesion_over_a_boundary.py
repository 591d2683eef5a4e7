"""Cohesion acts on the covered area of a block: one that slides over the edges of its base, and a plank that slides
from one fixed block onto its neighbour.

The two joints of the plank are parts of its face; as it slides they are handed over to new contacts. The whole face
stays covered, so that its resistance is mu N + c A, by hand.
"""

from dataclasses import replace

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DisplacementControl, DynamicControl
from dembrick.scenario.model import Actuator, Block, JointLaw, Scenario
from helpers.custom_laws import COULOMB
from helpers.stone_scenes import of_stone

pytestmark = pytest.mark.usefixtures("few")

FRICTION, COHESION, WEIGHT, AREA = 0.6, 4000.0, 0.2 * 0.2 * 0.1 * 2000.0 * 9.81, 0.04
THIN = 0.02  # m
TRAVEL = 0.018  # m: 0.16 of the distance from the middle of a joint to its corner, by which all is handed over


@pytest.mark.parametrize(
    "formulation, points",
    [("concave", None), ("convex", None), ("distributed", (1, 1)), ("distributed", (2, 5))],
)
@pytest.mark.parametrize(
    "way",
    [
        pytest.param((1.0, 0.0), id="along", marks=pytest.mark.slow),
        pytest.param((0.0, 1.0), id="across", marks=pytest.mark.slow),
        pytest.param((0.8, 0.6), id="askew"),
    ],
)
def test_cohesion_goes_with_the_area_that_both_blocks_share(formulation, points, way):
    """V = mu N + c (a - x) (b - y) of a guided block that slides by (x, y): the overlap is known to a fraction of a
    thousandth of the short side."""
    a, b, N = 0.4, 0.2, 0.4 * 0.2 * 0.1 * 2000.0 * 9.81
    law = JointLaw(
        formulation,
        0.5,
        1e10,
        4e9,
        points,
        cohesion=1e4,
        residual_cohesion=1e4,
    )
    blocks = (
        Block("base", "stone", (a, b, 0.2), (0.0, 0.0, -0.1), fixed=True),
        Block("block", "stone", (a, b, 0.1), (0.0, 0.0, 0.05), held=("rx", "ry", "rz")),
    )
    control = DisplacementControl(travel=0.02, large_displacements=True)
    jack = Actuator("jack", "block", (0.0, 0.0, 0.0), (*way, 0.0))
    rows = simulate(of_stone(law, control, blocks, actuators=(jack,))).to_pandas()
    moved, load = rows["displacement [m]"].to_numpy(), rows["load [N]"].to_numpy()
    slides = moved > 1e-5
    shared = (a - way[0] * moved[slides]) * (b - way[1] * moved[slides])
    assert moved[-1] > 0.0199 and slides.sum() > 5
    np.testing.assert_allclose(load[slides], 0.5 * N + 1e4 * shared, rtol=1e-3)


def plank(formulation: str, cohesion: float, kept: float) -> Scenario:
    points = (3, 3) if formulation == "distributed" else None
    law = JointLaw(formulation, FRICTION, 1e10, 4e9, points, cohesion=cohesion, residual_cohesion=kept)
    floors = [
        Block(f"floor {i}", "stone", (0.4, 0.4, 0.2), (x, 0.0, -0.1), fixed=True) for i, x in enumerate((-0.2, 0.2))
    ]
    return of_stone(
        law,
        DisplacementControl(1e-3, TRAVEL, large_displacements=True),
        (*floors, Block("plank", "stone", (0.2, 0.2, 0.1), (0.0, 0.0, 0.05))),
        actuators=(Actuator("jack", "plank", (-0.1, 0.0, 0.0), (1.0, 0.0, 0.0)),),
    )


def thrown(still: Scenario, speed: float) -> Scenario:
    """A thinner plank with an initial speed."""
    floors, own = still.blocks[:2], still.blocks[2]
    own = replace(own, box=(0.2, 0.2, THIN), position=(0.0, 0.0, 0.5 * THIN), velocity=(speed, 0.0, 0.0))
    return replace(still, blocks=(*floors, own), actuators=())


@pytest.mark.parametrize("formulation", ["concave", "convex", "distributed"])
@pytest.mark.parametrize("kept", [pytest.param(COHESION, marks=pytest.mark.slow), 0.25 * COHESION])
def test_what_a_bond_keeps_is_handed_over(formulation, kept):
    rows = simulate(plank(formulation, COHESION, kept)).to_pandas()
    moved, load = rows["displacement [m]"].to_numpy(), rows["load [N]"].to_numpy()
    assert moved[-1] > 0.99 * TRAVEL
    sliding = load[moved > 0.1 * TRAVEL] / (FRICTION * WEIGHT + kept * AREA)
    assert sliding.max() < 1.0 + 1e-4
    assert sliding.min() > 0.97  # meanwhile the area lost by one joint is not yet taken up by the other: 8 mm of 200
    assert sliding[-1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_thin_plank_that_is_thrown_stops_where_its_energy_is_spent(formulation):
    """In real time: v^2 / 2 = (mu g + c A / m) s. The plank is so thin that all of it stays pressed; the energy audit
    of the run checks the work of the contacts."""
    kept, speed = COHESION / 8.0, 0.85
    braking = FRICTION * 9.81 + kept / (2000.0 * THIN)
    scene = replace(thrown(plank(formulation, kept, kept), speed), control=DynamicControl(0.06))
    moved = simulate(scene).displacement[2]
    assert moved[0] == pytest.approx(speed**2 / (2.0 * braking), rel=0.02)


@pytest.mark.parametrize(
    "key, value, left",
    [
        ("compressive_strength", 1e8, "do not crush"),
        ("dilation", 0.01, "do not dilate"),
        ("residual_friction", 0.5, ""),
    ],
)
def test_a_result_says_what_contacts_leave_of_a_law(key, value, left):
    still = plank("concave", COHESION, COHESION)
    joint = replace(still.joint, **{key: value})
    result = simulate(replace(still, joint=joint))
    said = [(one["law"], one["joints"]) for one in result.as_dict().get("left_out", [])]
    assert said == ([(key, 2)] if left else [])
    assert ("left out" in result.text()) == bool(left) and left in result.text()
    short = replace(still.control, travel=1e-4)  # both joints still carry on their whole area
    assert "left_out" not in simulate(replace(still, joint=joint, control=short)).as_dict()


def test_a_result_says_that_contacts_know_no_law_of_the_users_own():
    scene = replace(thrown(plank("concave", 0.0, 0.0), 0.85), control=DynamicControl(0.04))
    (said,) = simulate(scene, law=COULOMB).left_out
    assert said.law == "custom_law" and "plain friction" in said.text
