"""Points on rays from the torsion centre, and the iteration that finds that centre."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.assembly import build, ray_quadrature
from dembrick.geometry import polygons
from dembrick.runs import theory_check
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.simulation.statics import limit_load
from dembrick.simulation.statics.limit_load import place_points
from dembrick.theory import limit_load_at_height, rectangle_formulation
from helpers.scenario_text import block, header, jack

RECTANGLE = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
TRIANGLE = np.array([[-0.4, -0.2], [0.5, -0.1], [-0.1, 0.3]])
SHAPES = [RECTANGLE, TRIANGLE - np.mean(TRIANGLE, axis=0), RECTANGLE * [10.0, 1.0]]


@pytest.mark.parametrize("polygon", SHAPES)
@given(x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0))
@settings(max_examples=40, deadline=None)
def test_rays_keep_area_centroid_and_second_moments(polygon, x, y):
    size = np.abs(polygon).max(axis=0)
    arms, areas = ray_quadrature.rays(polygon, (x * size[0], y * size[1]), 2, 2)
    total = polygons.area(polygon)
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(total, rel=1e-12)
    assert np.abs(areas @ arms).max() <= 1e-12 * total * size.max()
    yy, xx, xy = polygons.second_moments(polygon)
    found = [areas @ arms[:, 1] ** 2, areas @ arms[:, 0] ** 2, areas @ (arms[:, 0] * arms[:, 1])]
    assert found == pytest.approx([yy, xx, xy], rel=1e-10, abs=1e-10 * total * size.max() ** 2)


@pytest.mark.parametrize("polygon", SHAPES)
@given(x=st.floats(-1.5, 1.5), y=st.floats(-1.5, 1.5))
@settings(max_examples=40, deadline=None)
def test_friction_moment_about_the_centre_of_the_rays_converges_to_the_closed_form(polygon, x, y):
    centre = np.array([x, y]) * np.abs(polygon).max(axis=0)
    exact = polygons.mean_distance(polygon, [centre])[0] * polygons.area(polygon)
    for counts, most in (((2, 2), 3e-3), ((3, 3), 2e-4), ((5, 5), 2e-6), ((10, 8), 1e-7)):
        moment = ray_quadrature.friction_moment(*ray_quadrature.rays(polygon, centre, *counts), centre, (1.0, 0.0, 0.0))
        assert moment == pytest.approx(exact, rel=most)


def test_forty_eight_points_do_what_a_lattice_needs_a_thousand_for():
    centre = np.array([-0.07, 0.01])
    exact = polygons.mean_distance(RECTANGLE, [centre])[0] * 0.06
    arms, areas = ray_quadrature.rays(RECTANGLE, centre, 2, 2)
    assert len(areas) <= 60
    assert ray_quadrature.friction_moment(arms, areas, centre, (1.0, 0.0, 0.0)) == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
@pytest.mark.parametrize("name", ["set2a", "set4a", "set4b", "set4a_mid", "set4b_mid"])
def test_placed_points_meet_the_continuum_within_half_the_tolerance(name, tolerance):
    built = build.assemble(lab_scenario(name, "distributed", tolerance))
    placed, seconds = place_points(built, tolerance)
    assert seconds > 0.0
    assert 20 <= len(placed.contact_points[0].area) <= 200
    theory = theory_check.theory_of(placed)
    assert abs(theory.discretisation_error) <= 0.5 * tolerance
    V = limit_load.find_limit_load(placed, tolerance).yield_point.V
    assert V / theory.V * (1.0 + theory.discretisation_error) == pytest.approx(1.0, abs=1.5 * tolerance)


def test_points_for_another_centre_would_miss():
    """The same number of points, placed for pure torsion, is wrong for set 4a: the placement matters."""
    built = build.assemble(lab_scenario("set4a", "distributed", 1e-5))
    placed, _ = place_points(built, 1e-5)
    arms, areas = ray_quadrature.rays(RECTANGLE, (0.0, 0.0), 3, 2)
    points = dataclasses.replace(placed.contact_points[0], normal_arm=arms, shear_arm=arms, area=areas)
    elsewhere = dataclasses.replace(built, contact_points=(points,))
    assert abs(theory_check.theory_of(elsewhere).discretisation_error) > 0.5e-5


def test_a_joint_that_opens_keeps_the_lattice():
    """Pushed 0.09 m above the joint, the block has only part of its bed in contact when it slides."""
    scenario = lab_scenario("shear", "distributed", 1e-2)
    jacks = [dataclasses.replace(jack, point=(*jack.point[:2], 0.09)) for jack in scenario.actuators]
    built = build.assemble(dataclasses.replace(scenario, actuators=tuple(jacks)))
    placed, _ = place_points(built, 1e-2)
    run = limit_load.find_limit_load(placed, 1e-2)
    assert not (run.state.points.normal > 0.0).all()
    np.testing.assert_allclose(placed.contact_points[0].normal_arm, built.contact_points[0].normal_arm)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_other_formulations_are_left_alone(formulation):
    built = build.assemble(lab_scenario("set4a", formulation, 1e-3))
    assert place_points(built, 1e-3) == (built, 0.0)


@pytest.mark.parametrize(("friction", "cohesion"), [(0.6, 2e4), (0.6, 1e3), (0.0, 2e4)])
def test_points_of_a_bonded_joint_meet_the_bonded_continuum(friction, cohesion):
    """As with a lattice of 120 by 90 points. The reference was once the dry continuum, 90 % off and more."""
    side = (0.4, 0.3, 0.1)
    text = header("distributed", friction, 1e10, keys=f"cohesion = {cohesion}\nresidual_cohesion = {cohesion}")
    text += block("floor", (0.0, 0.0, -0.1), (1.0, 1.0, 0.2), "fixed = true") + block("block", (0.0, 0.0, 0.05), side)
    text += jack("block", (0.05, 0.15, 0.004)) + '[control]\nkind = "yield"\n'
    found = simulate(toml.loads(text), record=False, progress=False)
    many = rectangle_formulation("distributed", *side[:2], friction, cohesion, cells=(120, 90))
    weight = 2000.0 * 9.81 * side[0] * side[1] * side[2]
    V = limit_load_at_height(many, weight, (1.0, 0.0, -0.15), overturning=(0.004, 0.0)).V
    assert found.yield_point.V == pytest.approx(V, rel=1e-3)
    assert found.theory.V / (1.0 + found.theory.discretisation_error) == pytest.approx(V, rel=1e-4)
    assert found.agrees()
