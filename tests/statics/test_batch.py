"""Many limit loads in one call: equal to single searches and to theory, for any number of threads; invalid input."""

import dataclasses

import numpy as np
import pytest

from dembrick import theory
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario.model import FORMULATIONS
from dembrick.simulation.statics import batch, yield_domain
from helpers.one_joint import MU, A, B, N, scene, single
from helpers.random_polygons import slender_polygon as random_polygon

RECTANGLE = theory.polygons.rectangle(A, B)
FORCE = [0.6, 0.8, 0.0]


def one_force(point, formulation="convex", **options):
    options = {"friction": MU, "normal_force": N, "actuator_direction": [FORCE]} | options
    return batch.Cases.on(RECTANGLE, formulation, actuator_point=point, **options)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("z", [0.0, 0.05])
def test_the_same_as_scene_by_scene(formulation, z):
    """Where brackets are certified, batch and single search pass the same states: same V, bracket and number of steps.

    Elsewhere a single search follows equilibria and a batch steps in time as always; their brackets hold the same
    limit.
    """
    arms = [(0.0, 0.0), (0.07, 0.02), (-0.13, 0.08)]
    points = (9, 6) if formulation == "distributed" else None  # a single search would place them by the load
    found = batch.find_limit_loads(
        one_force(
            [[[*arm, z]] for arm in arms], formulation, normal_stiffness=1e10, shear_stiffness=4e9, points=points,
            tolerance=1e-4,
        )
    )  # fmt: skip
    assert (found.status == "yield").all()
    for i, arm in enumerate(arms):
        alone = simulate(
            scene(formulation, jacks=single(arm, FORCE, z), tolerance=1e-4, points=points, height=0.1), record=False
        )
        point = alone.yield_point
        assert bool(found.certified[i]) == (point.bracket == "certified")
        if point.bracket != "certified":
            assert found.V[i] == pytest.approx(point.V, rel=2e-4)
            assert found.V_lower[i] <= point.V_upper and point.V_lower <= found.V_upper[i]
            continue
        for key in ("V", "V_lower", "V_upper", "N", "V_1", "V_2", "actuator_load"):
            assert getattr(found, key)[i] == pytest.approx(getattr(point, key), rel=1e-9, abs=1e-9 * MU * N), key
        assert found.M_T[i] == pytest.approx(point.M_T, abs=1e-9 * MU * N * A)
        assert found.steps[i] == alone.run.steps


@pytest.mark.parametrize("pressure", ["full", pytest.param("effective", marks=pytest.mark.slow), "linear"])
def test_random_convex_joints_against_theory(pressure):
    """Each case has its own polygon, friction, N, eccentricity, dead shear and load; certified brackets hold theory."""
    rng = np.random.default_rng(31)
    k = 60
    shapes = [random_polygon(rng, 10 ** rng.uniform(-2, 1)) for _ in range(k)]
    size = np.array([np.abs(p).max() for p in shapes])
    mu, normal = rng.uniform(0.1, 1.5, k), 10 ** rng.uniform(0, 6, k)
    e = np.array([p[rng.integers(len(p))] * rng.uniform(0, 0.45) for p in shapes])
    dead = rng.normal(size=(k, 2)) * 0.2 * (mu * normal)[:, None]
    arm, direction = rng.normal(size=(2, k, 1, 3))
    arm *= 0.7 * size[:, None, None]
    arm[..., 2] = direction[..., 2] = 0.0
    cases = batch.Cases.on(
        shapes, "convex", shape=np.arange(k), friction=mu, normal_force=normal, eccentricity=e, dead_shear=dead,
        actuator_point=arm, actuator_direction=direction, pressure=pressure, tolerance=1e-5,
    )  # fmt: skip
    found = batch.find_limit_loads(cases, threads=2)
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    held = 0
    for i in range(k):
        law = theory.polygon_formulation(shapes[i], mu[i], pressure).law(normal[i], e[i])
        f, r = direction[i, 0], arm[i, 0]
        try:
            V = theory.limit_load(law, (f[0], f[1], r[0] * f[1] - r[1] * f[0]), (*dead[i], 0.0)).V
        except ScenarioError:  # the dead shear exceeds the strength at that eccentricity
            assert found.status[i] == "no equilibrium"
            continue
        held += 1
        assert found.status[i] == "yield" and found.certified[i]
        assert found.V[i] == pytest.approx(V, rel=1e-5)
        assert found.V_lower[i] * (1 - 1e-7) <= V <= found.V_upper[i] * (1 + 1e-7)
    assert held > 0.9 * k


def test_threads_and_blocks_change_no_bit():
    point = np.zeros((300, 1, 3))
    point[:, 0, 0] = np.linspace(-0.15, 0.15, 300)
    cases = one_force(point, "corrected")
    one, two = (batch.find_limit_loads(cases, threads=n) for n in (1, 2))
    alone = batch.find_limit_loads(cases.part(211, 212))
    for name in batch.LimitLoads.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
        np.testing.assert_array_equal(getattr(one, name)[211], getattr(alone, name)[0])
    assert len(one.V) == 300


def test_no_friction_and_no_answer():
    found = batch.find_limit_loads(one_force([[0.05, 0.0, 0.0]], friction=[0.0, MU, MU], eccentricity=[
        [0.0, 0.0], [0.0, 0.0], [0.0, 0.11]]))  # fmt: skip
    assert (found.V[0], found.V_lower[0], found.V_upper[0]) == (0.0, 0.0, 0.0)
    assert list(found.status) == ["yield", "yield", "no equilibrium"]


BAD = {
    "friction": ({"friction": -0.1}, "case 0: friction"),
    "no force": ({"actuator_direction": [[0.0, 0.0, 0.0]]}, "case 0: a load or an actuator"),
    "a pull": ({"normal_force": -1.0, "normal_stiffness": 1e9, "shear_stiffness": 1e9}, "must press"),
    "a push across": (
        {"actuator_direction": [[0.0, 0.0, -1.0]], "actuator_point": np.zeros((1, 3))},
        "load of the actuators",
    ),
    "tolerance": ({"tolerance": 0.5}, "tolerance = 0.5"),
    "pressure": ({"pressure": "ful"}, "did you mean 'full'?"),
    "stiffness": ({"normal_stiffness": 0.0}, "normal_stiffness is out of range"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_cases(name):
    options, words = BAD[name]
    with np.errstate(invalid="ignore"), pytest.raises(ScenarioError, match=words.replace("?", r"\?")):
        batch.find_limit_loads(one_force(**({"point": [[0.05, 0.0, 0.0]]} | _renamed(options))))


def _renamed(options):
    return {"point" if key == "actuator_point" else key: value for key, value in options.items()}


@pytest.mark.parametrize(
    "polygon, words",
    [
        (RECTANGLE[::-1], "clockwise"),
        (RECTANGLE + 0.01, "must have its centroid at the origin"),
        (RECTANGLE[:2], "at least three corners"),
        (np.insert(RECTANGLE, 1, [[0.0, -B / 2]], axis=0), "on the line of its neighbours"),
    ],
)
def test_bad_polygons(polygon, words):
    cases = one_force([[0.05, 0.0, 0.0]])
    with pytest.raises(ScenarioError, match=words):
        batch.find_limit_loads(dataclasses.replace(cases, polygons=[polygon]))


# --- yield domains


@pytest.mark.parametrize("space", yield_domain.SPACES)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_domain_is_that_of_theory_convex_and_normal(space, formulation):
    options = {"friction": MU, "normal_force": N, "fan": yield_domain.Fan(120, space, 70.0)}
    domain = yield_domain.yield_domain(
        RECTANGLE, formulation, points=(6, 4) if formulation[0] == "d" else None, **options
    )
    if formulation != "distributed":
        law = theory.formulation_law(formulation, A, B, MU, N)
    else:
        faces = batch._Faces(dataclasses.replace(one_force([[0, 0, 0]], formulation), points=(6, 4)))
        points = faces.contact_points[0]
        law = theory.points(points.normal_arm, N * points.area / points.area.sum(), MU)
    expected = theory.limit_loads(law, domain.load).V
    np.testing.assert_allclose(domain.limits.V, expected, rtol=1e-3)
    assert (domain.limits.V_lower <= expected * (1 + 1e-9)).all() and (
        domain.limits.V_upper >= expected * (1 - 1e-9)
    ).all()
    assert domain.certified and domain.error_bar <= 1e-3 * (1 + 1e-9)
    assert domain.convexity().holds and domain.normality().holds


@pytest.mark.parametrize("space", yield_domain.SPACES)
def test_the_checks_see_a_dent_and_an_oblique_slip(space):
    domain = yield_domain.yield_domain(
        RECTANGLE, "convex", friction=MU, normal_force=N, fan=yield_domain.Fan(150, space)
    )
    assert domain.convexity().holds and domain.normality().holds
    V, twist = domain.limits.V.copy(), domain.limits.twist.copy()
    V[70] *= 0.9
    dented = dataclasses.replace(domain, limits=dataclasses.replace(domain.limits, V=V))
    assert not dented.convexity().holds and 0.005 < dented.convexity().value < 0.1
    twist[70] += 0.3 * np.linalg.norm(twist[70]) * np.array([0.0, 1.0, -1.0])
    oblique = dataclasses.replace(domain, limits=dataclasses.replace(domain.limits, twist=twist))
    assert not oblique.normality().holds and oblique.convexity().holds


def test_directions_are_spread():
    sphere = yield_domain.directions(400, "all")
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=1), 1.0, rtol=1e-12)
    nearest = np.sort(sphere @ sphere.T, axis=1)[:, -2]
    angle = np.arccos(nearest)
    assert angle.max() < 2.0 * angle.min()
    np.testing.assert_allclose(sphere.mean(axis=0), 0.0, atol=0.01)
    quarter = yield_domain.directions(5, "quarter")
    np.testing.assert_allclose(quarter[[0, -1]], [[0, 1, 0], [0, 0, 1]], atol=1e-15)
    with pytest.raises(ScenarioError, match="too few"):
        yield_domain.directions(1, "quarter")


def test_a_bent_joint_has_a_smaller_domain_and_one_outside_none():
    options = {"friction": MU, "normal_force": N, "fan": yield_domain.Fan(40, "all"), "pressure": "linear"}
    whole, bent = (
        yield_domain.yield_domain(RECTANGLE, "convex", eccentricity=(0.0, e), **options) for e in (0.0, 0.07)
    )
    law = theory.polygon_formulation(RECTANGLE, MU, "linear").law(N, (0.0, 0.07))
    np.testing.assert_allclose(bent.limits.V, theory.limit_loads(law, bent.load).V, rtol=1e-3)
    assert bent.convexity().holds and bent.normality().holds and bent.certified
    # loads about O: the lower torsion strength shows if the force passes through the centre of pressure
    assert (np.linalg.norm(bent.points - whole.points, axis=1) > 1e-2 * whole.V_0 * whole.lever).any()
    with pytest.raises(NotConvergedError, match="no equilibrium"):
        yield_domain.yield_domain(RECTANGLE, "convex", eccentricity=(0.0, 0.12), **options)
