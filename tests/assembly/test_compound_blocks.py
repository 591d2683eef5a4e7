"""Blocks of several convex parts: mass, joints of several pieces, and the torsional strength of an L or a triangle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.geometry.convex_hull import compound
from dembrick.geometry.friction_integrals import area_radius, far_moments
from dembrick.geometry.rotations import rotation_matrix, unit_quaternion
from dembrick.geometry.shapes import box
from dembrick.runs import theory_check
from dembrick.runs.simulate import simulate
from dembrick.runs.theory_check import theory_of
from dembrick.scenario import toml
from dembrick.scenario.blocks import Block, Part, Prism
from dembrick.scenario.controls import DynamicControl, PushoverControl, StaticsControl
from dembrick.scenario.joint_laws import FORMULATIONS
from dembrick.scenario.model import Actuator, JointLaw, Load, Material, YieldControl
from dembrick.simulation.statics.limit_load import find_limit_load
from dembrick.simulation.statics.state import initial_state
from helpers.stone_scenes import of_stone

L_PARTS = (Part(box=(0.3, 0.1, 0.2), position=(0.15, 0.05, 0.1)), Part(box=(0.1, 0.2, 0.2), position=(0.05, 0.2, 0.1)))
L_AREA = 0.03 + 0.02
L_CENTRE = (0.03 * np.array([0.15, 0.05]) + 0.02 * np.array([0.05, 0.2])) / L_AREA
TRIANGLE = ((0.0, 0.0), (0.4, 0.0), (0.0, 0.12))
# Load factor along (cos 0.3, sin 0.3) at which an L 0.6 m high tips about the line between its feet, x + y = 0.4
OVER_THE_NOTCH = (0.4 - L_CENTRE.sum()) / (math.cos(0.3) + math.sin(0.3)) / 0.3


def law(formulation="convex", **more):
    return JointLaw(formulation, 0.64, 1e10, 4e9, **more)


def on_a_floor(*blocks, joint=None, loads=(), jacks=(), tolerance=1e-6):
    floor = Block("floor", "tuff", (2.0, 2.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    return of_stone(
        joint or law(),
        YieldControl(tolerance),
        (floor, *blocks),
        materials={"tuff": Material(2000.0)},
        loads=loads,
        actuators=jacks,
    )


def least_mean_distance_by_quadrature(pieces):
    """Mean distance of rectangles or triangles from the best centre, by Gauss rules in cells and a descent."""
    from scipy.optimize import minimize

    points, weights = [], []
    nodes, w = np.polynomial.legendre.leggauss(12)
    for piece in pieces:
        for i in range(1, len(piece) - 1):
            a, u, v = piece[0], piece[i] - piece[0], piece[i + 1] - piece[i]
            for k in range(24):  # strips of the triangle, each mapped from a square
                lower, upper = k / 24, (k + 1) / 24
                r = lower + (upper - lower) * 0.5 * (nodes + 1)
                s = np.concatenate([(j + 0.5 * (nodes + 1)) / 24 for j in range(24)])
                ws = np.tile(0.5 * w / 24, 24)
                grid_r, grid_s = np.meshgrid(r, s, indexing="ij")
                points.append((a + grid_r[..., None] * (u + grid_s[..., None] * v)).reshape(-1, 2))
                jacobian = abs(u[0] * v[1] - u[1] * v[0]) * grid_r
                weights.append((np.outer(0.5 * w * (upper - lower), ws) * jacobian).ravel())
    points, weights = np.concatenate(points), np.concatenate(weights)

    def mean(centre):
        return float(weights @ np.hypot(*(points - centre).T)) / float(weights.sum())

    start = weights @ points / weights.sum()
    found = minimize(mean, start + 0.01, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-13})
    return found.fun, mean(start)


# --- mass -------------------------------------------------------------------------------------------------------------


def test_an_l_has_the_mass_properties_of_its_two_boxes():
    """Mass, centroid and inertia by the parallel-axis theorem from boxes 0.3 x 0.1 and 0.1 x 0.2, each 0.2 high."""
    (block,) = assemble(on_a_floor(Block("l", "tuff", parts=L_PARTS, position=(0, 0, 0)))).shapes[1:]
    assert block.volume == pytest.approx(L_AREA * 0.2, rel=1e-14)
    assert block.centroid == pytest.approx([*L_CENTRE, 0.1], rel=1e-14)
    inertia = np.zeros((3, 3))
    for part in L_PARTS:
        a, b, c = part.box
        volume, d = a * b * c, np.array(part.position) - [*L_CENTRE, 0.1]
        inertia += volume / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
        inertia += volume * ((d @ d) * np.eye(3) - np.outer(d, d))
    assert block.inertia == pytest.approx(inertia, rel=1e-12, abs=1e-12 * inertia.max())
    assert abs(block.inertia[0, 1]) > 0.05 * block.inertia[0, 0]


def test_a_box_sawn_up_and_put_together_is_the_box():
    turn = unit_quaternion((0.9, 0.1, -0.3, 0.2))
    whole = box((0.6, 0.2, 0.1))
    halves = compound(
        [box((0.3, 0.2, 0.1))] * 2, [rotation_matrix(turn) @ (x, 0, 0) for x in (-0.15, 0.15)], [turn] * 2
    )
    rotation = rotation_matrix(turn)
    assert halves.volume == pytest.approx(whole.volume, rel=1e-14)
    assert halves.centroid == pytest.approx(np.zeros(3), abs=1e-15)
    assert halves.inertia == pytest.approx(rotation @ whole.inertia @ rotation.T, abs=1e-15)
    assert (
        len(halves.faces) == 12
        and halves.vertices.shape == (16, 3)
        and halves.diameter == pytest.approx(whole.diameter)
    )


# --- joints -----------------------------------------------------------------------------------------------------------


def test_an_l_on_a_floor_has_one_joint_of_two_pieces():
    found = assemble(on_a_floor(Block("l", "tuff", parts=L_PARTS, position=(0.5, -0.3, 0.0))))
    (joint,) = found.joints
    assert joint.area == pytest.approx(L_AREA, rel=1e-14) and len(joint.pieces) == 2 and joint.gap == 0.0
    assert joint.origin == pytest.approx([0.5 + L_CENTRE[0], -0.3 + L_CENTRE[1], 0.0], abs=1e-15)
    assert found.position[1] - found.position[0] == pytest.approx(joint.arm_a - joint.arm_b, abs=1e-15)
    for piece in joint.pieces:
        assert piece @ joint.axes[:2] + joint.origin == pytest.approx(
            np.c_[piece @ joint.axes[:2, :2] + joint.origin[:2], np.zeros(len(piece))], abs=1e-15
        )
    state = initial_state(found)
    second = state.areas.second[0]
    xx = yy = xy = 0.0
    for part in L_PARTS:
        (a, b, _), d = part.box, np.array(part.position[:2]) - L_CENTRE
        xx += a**3 * b / 12 + a * b * d[0] ** 2
        yy += a * b**3 / 12 + a * b * d[1] ** 2
        xy += a * b * d[0] * d[1]
    assert second == pytest.approx([yy, xx, xy], rel=1e-12)


def test_points_of_an_l_own_its_area_about_its_centroid():
    block = Block("l", "tuff", parts=L_PARTS, position=(0, 0, 0))
    for formulation in ("concave", "corrected", "corrected-shear", "distributed"):
        (points,) = assemble(on_a_floor(block, joint=law(formulation), tolerance=1e-2)).contact_points
        assert points.area.sum() == pytest.approx(L_AREA, rel=1e-12)
        assert points.area @ points.normal_arm == pytest.approx([0.0, 0.0], abs=1e-15)
        assert formulation != "concave" or len(points.area) == 8
    joint = assemble(on_a_floor(block)).joints[0]
    corrected = assemble(on_a_floor(block, joint=law("corrected"))).contact_points[0]
    mean = corrected.area @ np.hypot(*corrected.shear_arm.T) / L_AREA  # the points have the c_T of the area, eq. 9
    assert mean == pytest.approx(least_mean_distance_by_quadrature(joint.pieces)[1], rel=1e-6)


def test_two_feet_make_one_joint_and_steps_make_two():
    feet = (Part(box=(0.1, 0.2, 0.1), position=(-0.2, 0, 0.05)), Part(box=(0.1, 0.2, 0.1), position=(0.2, 0, 0.05)),
            Part(box=(0.5, 0.2, 0.1), position=(0, 0, 0.15)))  # fmt: skip
    table = Block("table", "tuff", parts=feet, position=(0, 0, 0))
    (joint,) = assemble(on_a_floor(table)).joints
    assert joint.area == pytest.approx(0.04) and joint.origin == pytest.approx(np.zeros(3), abs=1e-15)
    step = Block("step", "tuff", (0.2, 0.2, 0.1), (0.6, 0.0, 0.05))
    high = Block("high", "tuff", parts=(Part(box=(0.2, 0.2, 0.1), position=(0, 0, 0.15)),
                                        Part(box=(0.2, 0.2, 0.2), position=(0.2, 0, 0.1))),
                 position=(0.6, 0, 0))  # fmt: skip
    found = assemble(on_a_floor(step, high))
    pairs = sorted((j.block_a, j.block_b, round(abs(j.axes[2][2]))) for j in found.joints)
    assert pairs == [(0, 1, 1), (0, 2, 1), (1, 2, 0), (1, 2, 1)]  # a bed and a head between the same two blocks


def test_what_is_refused():
    overlap = (L_PARTS[0], Part(box=(0.1, 0.2, 0.2), position=(0.05, 0.19, 0.1)))
    with pytest.raises(ScenarioError, match=r"parts\[0\] and parts\[1\] of block 'l' overlap by 0.01 m"):
        assemble(on_a_floor(Block("l", "tuff", parts=overlap)))
    sunk = Block("l", "tuff", parts=L_PARTS, position=(0, 0, -0.01))
    with pytest.raises(ScenarioError, match=r"'floor' and 'l' overlap by 0.01 m"):
        assemble(on_a_floor(sunk))
    wedge = Block("w", "tuff", prism=Prism(TRIANGLE, 0.2), position=(0, 0, 0.07))
    with pytest.raises(ScenarioError, match=r"'floor' and 'w' overlap by 0.03 m"):
        assemble(on_a_floor(wedge))
    for formulation in ("corrected", "corrected-shear"):
        still = on_a_floor(Block("l", "tuff", parts=L_PARTS), joint=law(formulation))
        assemble(still)
        for control in (DynamicControl(0.1), StaticsControl(large_displacements=True)):
            with pytest.raises(ScenarioError, match=f"'{formulation}' handles the joint between 'floor' and 'l', of 2"):
                assemble(replace(still, control=control))
    with pytest.raises(ScenarioError, match="has 2 shapes"):
        Block("x", "tuff", (1, 1, 1), (0, 0, 0), parts=L_PARTS)
    with pytest.raises(ScenarioError, match="has no shape"):
        Block("x", "tuff", position=(0, 0, 0))
    with pytest.raises(ScenarioError, match=r"block 'w': parts\[1\]: polygon: it is not convex"):
        bad = Part(prism=Prism([(0, 0), (2, 0), (2, 1), (1, 0.5), (0, 1)], 1.0))
        assemble(on_a_floor(Block("w", "tuff", parts=(L_PARTS[0], bad))))


def test_a_jack_may_push_any_part():
    block = Block("l", "tuff", parts=L_PARTS, position=(0, 0, 0))
    assemble(on_a_floor(block, jacks=(Actuator("j", "l", (0.05, 0.3, 0.1), (1, 0, 0)),)))
    with pytest.raises(ScenarioError, match=r"lies 0.05 m outside block 'l'"):
        assemble(on_a_floor(block, jacks=(Actuator("j", "l", (0.15, 0.15, 0.1), (1, 0, 0)),)))


# --- body force against force at the centroid -------------------------------------------------------------------------


@pytest.mark.parametrize("formulation, pressure, tall", [
    *((name, "full", tall) for name in FORMULATIONS for tall in (0.2, 0.6)),
    *(("convex", pressure, 0.2) for pressure in ("linear", "effective")),
    *(pytest.param("convex", pressure, 0.6, marks=pytest.mark.slow) for pressure in ("linear", "effective")),
])  # fmt: skip
def test_a_body_force_and_an_actuator_at_the_centroid_have_one_limit(formulation, pressure, tall):
    """The same load defined in two ways has the closed-form limit: the low block slides, the high one rocks."""
    parts = tuple(
        Part(box=(*part.box[:2], tall), position=(*part.position[:2], 0.5 * tall)) for part in (L_PARTS[0], L_PARTS[1])
    )
    joint = JointLaw(formulation, 0.64, 1e11, 4e10, pressure=pressure)
    scene = on_a_floor(Block("l", "tuff", parts=parts), joint=joint, tolerance=1e-4)
    weight = 2000.0 * L_AREA * tall * 9.81
    ahead = (math.cos(0.3), math.sin(0.3), 0.0)
    behind = np.array([*L_CENTRE, 0.5 * tall]) - 0.03 * np.array(ahead)  # the centroid lies outside the L
    jack = Actuator("jack", "l", tuple(behind), ahead)
    at_centroid = simulate(replace(scene, actuators=(jack,)))
    everywhere = simulate(replace(scene, control=PushoverControl(ahead, tolerance=1e-4)))
    first, second = at_centroid.yield_point, everywhere.yield_point
    if formulation == "distributed" and tall == 0.6:  # the points lie inside the edges, which both runs report
        assert at_centroid.points_miss == pytest.approx(first.V / weight / OVER_THE_NOTCH - 1.0, rel=1e-3)
        assert any("rocking blocks topple too early by as much" in warning for warning in everywhere.assembly.warnings)
        return
    bars = 0.5 * (second.V_upper - second.V_lower + (first.V_upper - first.V_lower) / weight)
    assert bars < 3e-3
    assert abs(second.V - first.V / weight) < bars + 1e-5
    if formulation != "corrected":  # whose points let the block rock early
        assert second.V == pytest.approx(0.64 if tall == 0.2 else OVER_THE_NOTCH, rel=2e-4 if tall == 0.2 else 2.5e-3)


def test_points_whose_continuum_is_not_found_are_told_to_miss_the_edge(monkeypatch):
    """Without a continuum solution no theory is given, and the shortfall of the points is reported instead."""

    def none(*_):
        raise NotConvergedError("no compressive pressure was found")

    monkeypatch.setattr(theory_check, "_continuum", none)
    parts = tuple(replace(part, box=(*part.box[:2], 0.6), position=(*part.position[:2], 0.3)) for part in L_PARTS)
    jack = Actuator("jack", "l", (0.05, 0.11, 0.3), (1.0, 0.0, 0.0))
    found = simulate(on_a_floor(Block("l", "tuff", parts=parts), joint=law("distributed"), jacks=(jack,)))
    assert found.yield_point.mechanism == "rocking" and found.theory is None
    assert found.points_miss < -1e-3


# --- torsion ----------------------------------------------------------------------------------------------------------


def twisted(block):
    """A block under 1000 N of additional dead load, turned by a couple in the plane of its joint."""
    vertices = assemble(on_a_floor(block)).shapes[1]
    low = vertices.vertices + assemble(on_a_floor(block)).position[1]
    corners = low[np.abs(low[:, 2]) < 1e-12]
    first, second = corners[np.argmin(corners[:, 0])], corners[np.argmax(corners[:, 0])]
    jacks = (Actuator("j1", block.name, tuple(first), (0, -1, 0)), Actuator("j2", block.name, tuple(second), (0, 1, 0)))
    found = on_a_floor(block, loads=(Load(block.name, (0, 0, -1000.0)),), jacks=jacks)
    return found, second[0] - first[0]


BLOCKS = {
    "an L": Block("stone", "tuff", parts=L_PARTS, position=(0.2, 0.1, 0.0)),
    "a triangle": Block("stone", "tuff", prism=Prism(TRIANGLE, 0.2), position=(0.2, 0.1, 0.1)),
}


@pytest.mark.parametrize("shape", BLOCKS)
def test_torsion_about_the_best_centre_by_independent_quadrature(shape):
    """The limit couples of the replay and of theory equal an independent quadrature, and not c_T about O."""
    scene, arm = twisted(BLOCKS[shape])
    assembly = assemble(scene)
    joint = assembly.joints[0]
    normal = -assembly.dead_force[1][2]
    pieces = [np.asarray(p) for p in (joint.pieces or (joint.polygon,))]
    least, about_o = least_mean_distance_by_quadrature(pieces)
    assert 1.5e-3 < about_o / least - 1.0 < 0.015
    exact = 0.64 * normal * least
    assert area_radius(joint.polygon) == pytest.approx(least, rel=1e-6)
    assert theory_of(assembly).V * arm == pytest.approx(exact, rel=1e-5)
    replay = find_limit_load(assembly, 1e-6)
    assert replay.yield_point.V * arm == pytest.approx(exact, rel=1e-4)
    assert abs(replay.yield_point.V * arm / exact - 1.0) < 3e-6
    assert not math.isclose(replay.yield_point.V * arm, 0.64 * normal * about_o, rel_tol=1e-3)


def test_the_far_field_of_an_l_is_that_of_its_pieces():
    joint = assemble(on_a_floor(BLOCKS["an L"])).joints[0]
    areas = [abs(0.5 * sum(p[i - 1][0] * p[i][1] - p[i][0] * p[i - 1][1] for i in range(len(p)))) for p in joint.pieces]
    parts = sum(a * far_moments(np.asarray(p)) for a, p in zip(areas, joint.pieces, strict=True)) / sum(areas)
    assert far_moments(joint.polygon) == pytest.approx(parts, rel=1e-12, abs=1e-15)


# --- text -------------------------------------------------------------------------------------------------------------


def test_parts_in_a_file():
    scene, _ = twisted(BLOCKS["an L"])
    text = toml.dumps(scene)
    assert "parts = [{ box = [0.3, 0.1, 0.2], position = [0.15, 0.05, 0.1] }" in text
    assert toml.loads(text) == scene
    with pytest.raises(ScenarioError, match=r"unknown key 'boxx' in parts\[0\] in \[\[blocks\]\] number 2"):
        toml.loads(text.replace("{ box", "{ boxx", 1))


# --- joints of any two polygons ---------------------------------------------------------------------------------------


def test_joints_of_prisms_that_overlap_anyhow():
    """Joint areas of overlapping convex prisms, several per block, compared with an area from counted points."""
    rng = np.random.default_rng(5)
    lower = [
        Prism([(math.cos(a), math.sin(a)) for a in np.linspace(0, 2 * np.pi, n, endpoint=False)], 0.5) for n in (5, 7)
    ]
    blocks = [Block(f"low{i}", "tuff", prism=p, position=(1.9 * i, 0, -0.25), fixed=True) for i, p in enumerate(lower)]
    quarter = rng.uniform(0, 2 * np.pi)
    turn = (math.cos(quarter / 2), 0, 0, math.sin(quarter / 2))
    upper = Prism([(-0.9, -0.4), (0.9, -0.4), (0.0, 0.7)], 0.3)
    blocks.append(Block("high", "tuff", prism=upper, position=(0.9, 0.1, 0.15), orientation=turn))
    with pytest.raises(ScenarioError, match="'low0' and 'low1' overlap"):
        assemble(of_stone(law(), YieldControl(), blocks, materials={"tuff": Material(2000.0)}))
    blocks[1] = Block("low1", "tuff", prism=lower[1], position=(2.05, 0, -0.25), fixed=True)
    found = assemble(of_stone(law(), YieldControl(), blocks, materials={"tuff": Material(2000.0)}))
    assert sorted((j.block_a, j.block_b) for j in found.joints) == [(0, 2), (1, 2)]
    for joint in found.joints:
        shapes = [found.shapes[i].moved(found.position[i], found.orientation[i]) for i in (joint.block_a, 2)]
        outlines = [s[np.abs(s[:, 2]) < 1e-9][:, :2] for s in shapes]
        points = rng.uniform(-1.2, 3.2, (400_000, 2)) * (1, 0.5)
        inside = np.ones(len(points), bool)
        for outline in outlines:
            angle = np.arctan2(*(outline - outline.mean(axis=0)).T[::-1])
            ring = outline[np.argsort(angle)]
            edges = np.roll(ring, -1, axis=0) - ring
            for corner, edge in zip(ring, edges, strict=True):
                inside &= edge[0] * (points[:, 1] - corner[1]) - edge[1] * (points[:, 0] - corner[0]) >= 0
        area = inside.mean() * 4.4 * 2.2
        assert joint.area == pytest.approx(area, rel=0.03)
        assert joint.origin[:2] == pytest.approx(points[inside].mean(axis=0), abs=0.01)


def test_t_and_l_contacts_of_walls_that_meet():
    """Walls that meet in a T and in an L have joints on all touching faces and none where only edges touch."""
    first = Block("a", "tuff", (1.0, 0.2, 0.5), (0.0, 0.0, 0.25))
    tee = Block("t", "tuff", (0.2, 0.6, 0.5), (0.1, 0.4, 0.25))
    ell = Block("l", "tuff", (0.2, 0.6, 0.5), (0.6, 0.2, 0.25))
    found = assemble(on_a_floor(first, tee, ell))
    beside = {(j.block_a, j.block_b): (round(j.area, 9), np.abs(j.axes[2]).round(9).tolist()) for j in found.joints}
    assert beside.pop((1, 2)) == (0.1, [0, 1, 0])
    assert beside.pop((1, 3)) == (0.1, [1, 0, 0])
    assert set(beside) == {(0, 1), (0, 2), (0, 3)}
