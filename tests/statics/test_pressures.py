"""Convex joints whose friction follows the bending (pressures "effective", "linear"), against theory and quadrature."""

import dataclasses

import numpy as np
import pytest

from dembrick import theory
from dembrick.assembly import build
from dembrick.geometry import polygons
from dembrick.kernels.joint import pressure as kernels
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.joint.no_tension import no_tension
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
from dembrick.scenario.model import DisplacementControl, Load
from dembrick.simulation.joint_laws import pressed_parts
from dembrick.simulation.statics import area_joints, limit_load, state
from helpers.compiled import forms, matrix
from helpers.one_joint import MU, A, B, N, scene, single
from helpers.random_polygons import slender_polygon as random_polygon
from helpers.random_polygons import slenderness

RECTANGLE = theory.polygons.rectangle(A, B)
# M_T / M_T0 of the rectangle at e_y / b
BENT = (0.1, 1 / 6, 0.25, 0.35, 0.45)
TORSION = {
    "effective": (0.9345, 0.8947, 0.8503, 0.8071, 0.7796),
    "linear": (0.9751, 0.934055, 0.8763, 0.819055, 0.7815),
}


def outline(polygon):
    """`Polygon` with the corners (v, 2)."""
    x, y = np.ascontiguousarray(polygon.T)
    return Polygon(x, y, 0, len(x), float(polygons.area(polygon)), None, float(np.hypot(x, y).max()))


def pressed_by(pressure, polygon, g0, gx, gy, follow=kernels.follow_pressure):
    """Part of one joint in contact under the penetration g0 + gx x + gy y, with N = 1, and its centre of pressure."""
    x, y = np.ascontiguousarray(polygon.T)
    part = pressed_parts([pressure], [len(x)])
    if (g0 + polygon @ [gx, gy]).min() >= 0.0:
        yy, xx, xy = polygons.second_moments(polygon)
        volume, m_x, m_y = polygons.area(polygon) * g0, xx * gx + xy * gy, xy * gx + yy * gy
    else:
        volume, m_x, m_y = no_tension(x, y, 0, len(x), (g0 + polygon @ [gx, gy]).min(), g0, gx, gy)
    centre = np.array([m_x, m_y]) / volume
    follow(part, 0, outline(polygon), (1.0, *map(float, centre)), (float(g0), float(gx), float(gy)))
    return part, centre


def random_bending(rng):
    """A polygon and a penetration under which all of it is in contact, or a part down to a twentieth of its depth."""
    polygon = random_polygon(rng, 10 ** rng.uniform(-3, 1))
    slope = rng.normal(size=2)
    along = polygon @ slope
    level = -along.max() + np.ptp(along) * 10 ** rng.uniform(-1.3, 0.7)
    return polygon, level, *slope


def law_of(pressure, polygon, centre, g0, gx, gy):
    """The same in theory: a uniform or a linear friction stress of strength 1."""
    if pressure == "effective":
        return theory.convex(theory.formulations.effective_polygon(polygon, centre), 1.0, 1.0)
    law = theory.linear_pressure([polygon], 1.0, g0, (gx, gy))
    return theory.linear_pressure([polygon], 1.0 / law.strength, g0, (gx, gy))


@pytest.mark.parametrize("pressure", ["effective", "linear"])
@pytest.mark.parametrize("form", [0, 1])
def test_surface_against_theory(pressure, form):
    """D and its gradient at torsion centres inside, near, on corners and far; second derivatives by differences."""
    surface, follow = forms(kernels.pressed_surface)[form], forms(kernels.follow_pressure)[form]
    rng = np.random.default_rng(21)
    for _ in range(150 if form == 0 else 30):
        polygon, *plane = random_bending(rng)
        part, centre = pressed_by(pressure, polygon, *plane, follow)
        law = law_of(pressure, polygon, centre, *plane)
        size = np.abs(polygon).max()
        loss = slenderness(polygon) ** 2 * 20**2  # loss of digits due to the strip in contact, doubled
        corner = int(part.start[0])
        centres = [
            centre + rng.normal(size=2) * part.reach[0],
            [part.x[corner], part.y[corner]] + centre,
            polygon[0],
            centre + rng.normal(size=2) * 100 * part.reach[0],
            rng.normal(size=2) * size,
        ]
        for c in centres:
            sign = rng.choice([-1.0, 1.0])
            q = sign * np.array([c[1], -c[0], 1.0])
            d, v1, v2, mt, *h = surface(part, 0, *q)
            assert d == pytest.approx(law.dissipation(q), rel=1e-15 * loss + 1e-12)
            units = np.array([1.0, 1.0, size])
            np.testing.assert_allclose([v1, v2, mt] / units, law.gradient(q) / units, atol=1e-15 * loss + 1e-12)
            unscale = np.array([1.0, 1.0, 1.0 / size])
            hessian = matrix(*h) / np.outer(units, units)
            step = 1e-6 * np.linalg.norm(q * [1.0, 1.0, size])
            for k in range(3):
                e = np.zeros(3)
                e[k] = step
                plus, minus = (np.array(surface(part, 0, *(q + s * e * unscale))[1:4]) / units for s in (1, -1))
                scale = np.abs(hessian).max()
                np.testing.assert_allclose((plus - minus) / (2 * step), hessian[k], atol=3e-3 * scale)


@pytest.mark.parametrize("pressure", ["effective", "linear"])
def test_surface_against_quadrature(pressure):
    """The integral of p |v + w x r| by a fine rule on the part in contact, independent of edge sums."""
    rng = np.random.default_rng(22)
    nodes, weights = np.polynomial.legendre.leggauss(150)
    s, w_s = 0.5 * (nodes + 1), 0.5 * weights
    for _ in range(12):
        polygon, g0, gx, gy = random_bending(rng)
        part, centre = pressed_by(pressure, polygon, g0, gx, gy)
        own = slice(part.start[0], part.start[0] + part.count[0])
        corners = np.stack([part.x[own], part.y[own]], axis=1) + part.centre[0]
        c = centre + rng.normal(size=2) * part.reach[0]
        total = force = 0.0
        for p, p_next in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            # triangles from the torsion centre: the distance is smooth along each, however sharp at its tip
            u, v = p - c, p_next - c
            r = c + s[:, None, None] * (u + s[None, :, None] * (v - u))
            density = (g0 + r @ [gx, gy]) if pressure == "linear" else np.ones(r.shape[:2])
            area = (u[0] * v[1] - u[1] * v[0]) * w_s[:, None] * w_s * s[:, None]
            total += (area * density * np.hypot(*np.moveaxis(r - c, 2, 0))).sum()
            force += (area * density).sum()
        assert kernels.pressed_surface(part, 0, c[1], -c[0], 1.0)[0] == pytest.approx(total / force, rel=1e-9)


def test_the_effective_part_of_a_rectangle():
    """Bending about one side leaves a x (b - 2 e), about both (a - 2 e_x) x (b - 2 e_y), centred on the resultant."""
    for e_x, e_y in ((0.0, 0.03), (0.0, -0.09), (0.12, 0.0), (0.04, -0.05), (0.0, 0.0)):
        part = pressed_parts(["effective"], [4])
        kernels.follow_pressure(part, 0, outline(RECTANGLE), (N, N * e_x, N * e_y), (1.0, 0.0, 0.0))
        corners = np.stack([part.x[: part.count[0]], part.y[: part.count[0]]], axis=1)
        expected = theory.polygons.rectangle(A - 2 * abs(e_x), B - 2 * abs(e_y))
        assert len(corners) == 4
        first = int(np.argmin(corners @ [1.0, 0.9]))
        np.testing.assert_allclose(np.roll(corners, -first, axis=0), expected, atol=1e-15)
        np.testing.assert_allclose(part.centre[0], [e_x, e_y], atol=1e-17)
        assert part.density[0, 0] == pytest.approx(1.0 / ((A - 2 * abs(e_x)) * (B - 2 * abs(e_y))), rel=1e-12)


def test_near_and_far_meet():
    rng = np.random.default_rng(23)
    for pressure in ("effective", "linear") * 40:
        polygon, *plane = random_bending(rng)
        part, centre = pressed_by(pressure, polygon, *plane)
        direction = rng.normal(size=2)
        c = centre + kernels.FAR * part.reach[0] * direction / np.linalg.norm(direction)
        q = (c[1], -c[0], 1.0)
        near = np.array(kernels.pressed_surface(part._replace(reach=part.reach * 1.001), 0, *q))
        far = np.array(kernels.pressed_surface(part._replace(reach=part.reach * 0.999), 0, *q))
        assert not np.array_equal(near, far)
        scale = np.array([near[0], 1.0, 1.0, np.abs(polygon).max()])
        own = np.stack([part.x, part.y], axis=1)[: part.count[0]]
        assert np.abs((near - far)[:4] / scale).max() < 3e-13 * slenderness(own) ** 2


@pytest.mark.parametrize("pressure", ["effective", "linear"])
def test_a_line_of_contact(pressure):
    """In contact along one edge only: M_T about its middle is V_0 a/4, however thin the strip is."""
    for gy in (1e-3, 1.0, 1e6):
        for depth in (1e-3, 1e-6, 1e-12):  # of the joint, pressed along the edge y = b/2
            part, _ = pressed_by(pressure, RECTANGLE, gy * B * (depth - 0.5), 0.0, gy)
            strength = kernels.pressed_surface(part, 0, part.centre[0, 1], 0.0, 1.0)[3]
            assert strength == pytest.approx(A / 4, rel=1e-4)
            assert np.isfinite(kernels.pressed_surface(part, 0, 1.0, 2.0, 3.0)).all()


# --- by replay


def bent(pressure, eccentricity, load, **options):
    """A convex joint under N at an eccentricity (e_x, e_y), pushed in its plane; (V of the search, theory)."""
    base = scene("convex", jacks=load, tolerance=1e-5, normal=1.0, **options)
    point = (*eccentricity, base.blocks[1].box[2])
    return dataclasses.replace(
        base,
        joint=dataclasses.replace(base.joint, pressure=pressure),
        loads=(Load("upper", (0.0, 0.0, -N), point),),
    )


COUPLE = (((0.1, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0), ((-0.1, 0.0, 0.0), (0.0, -1.0, 0.0), 1.0))


@pytest.mark.parametrize("pressure", ["effective", "linear"])
@pytest.mark.parametrize("i", range(len(BENT)))
def test_torsion_under_bending(pressure, i):
    result = simulate(bent(pressure, (0.0, BENT[i] * B), COUPLE, kn=1e12), record=False)
    point = result.yield_point
    M_T0 = MU * N * 0.09681061
    assert 0.2 * point.V / M_T0 == pytest.approx(TORSION[pressure][i], abs=6e-5)
    assert point.bracket == "certified"
    V = result.theory.V
    assert point.V == pytest.approx(V, rel=1e-5)
    assert point.V_lower * (1 - 1e-8) <= V <= point.V_upper * (1 + 1e-8)


@pytest.mark.parametrize("pressure", ["effective", "linear"])
@pytest.mark.parametrize("e, jack", [((0.03, 0.05), (0.1, 0.02)), ((-0.08, 0.01), (0.05, -0.09)), ((0, 0), (0.1, 0))])
def test_force_on_a_bent_joint(pressure, e, jack):
    result = simulate(bent(pressure, e, single(jack, (0.6, 0.8, 0.0)), kn=1e12), record=False)
    point, V = result.yield_point, result.theory.V
    assert point.bracket == "certified"
    assert point.V == pytest.approx(V, rel=1e-5)
    assert point.V_lower * (1 - 1e-8) <= V <= point.V_upper * (1 + 1e-8)


LAB = {
    ("4a", "effective"): 206.927,
    ("4b", "effective"): 155.303,
    ("4a", "linear"): 212.1613,
    ("4b", "linear"): 159.7313,
}


@pytest.mark.parametrize("name, pressure", LAB)
def test_lab_sets(name, pressure):
    """At mid-height friction follows the overturning moment; in the joint plane it is that of eq. (5)."""
    for ending, expected in (("_mid", LAB[name, pressure]), ("", {"4a": 216.0549, "4b": 161.9025}[name])):
        base = lab_scenario(f"set{name}{ending}", "convex", 1e-5)
        law = dataclasses.replace(base.joint, pressure=pressure)
        result = simulate(dataclasses.replace(base, joint=law), record=False)
        point = result.yield_point
        assert point.V == pytest.approx(expected, rel=1e-5)
        assert point.V == pytest.approx(result.theory.V, rel=1e-5)
        assert point.bracket == ("indicator" if ending else "certified")


@pytest.mark.parametrize("pressure", ["effective", "linear"])
def test_the_energy_balance_of_a_constant_rate_closes(pressure):
    """Physical inertia above the joint shifts the pressure: an indicator, but the energy balance closes."""
    base = lab_scenario("set4a_mid", "convex")
    base = dataclasses.replace(
        base,
        joint=dataclasses.replace(base.joint, pressure=pressure),
        control=DisplacementControl(rate=1e-4, travel=1e-5),
    )
    result = simulate(base)
    assert result.yield_point.bracket in ("indicator", "open")
    assert abs(result.energy.as_dict()["relative_residual"]) < 1e-6
    assert result.load.max() == pytest.approx(LAB["4a", pressure], rel=0.02)


def test_full_pressure_stays_out_of_it(monkeypatch):
    """A scene without these pressures stores nothing for them; full pressures beside them are unchanged."""
    base = lab_scenario("set4b_mid", "convex", 1e-5)
    built = build.assemble(base)
    assert state.initial_state(built).areas.pressed is None
    alone = limit_load.find_limit_load(built, 1e-5).yield_point
    monkeypatch.setattr(
        area_joints,
        "pressed_parts",
        lambda pressures, corners: pressed_parts(["linear"], corners)._replace(kind=np.zeros(1, np.int64)),
    )
    assert state.initial_state(built).areas.pressed is not None
    beside = limit_load.find_limit_load(built, 5e-6).yield_point
    assert beside.V == pytest.approx(alone.V, rel=1e-5)
    assert beside.V == pytest.approx(161.9025, rel=1e-5)
