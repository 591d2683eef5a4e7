"""Load factors of limit analysis against those of other programmes and against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.errors import NotConvergedError
from dembrick.simulation.limit_analysis import analysis, optimum, solver
from dembrick.theory import limit_surface, polygons
from dembrick.theory.limit_load import gauge
from helpers import pushed_assemblies as scenes
from helpers.stone_scenes import law

X, Y, DIAGONAL = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0)
CONCAVE = {  # scenario, load factor (N for an actuator); independent conic programmes, and closed forms
    "3 x 12 along": (scenes.wall(law(), 3, 12, X), 0.6058426),
    "3 x 12 along, .4": (scenes.wall(law(friction=0.4), 3, 12, X), 0.4),
    "6 x 16 along": (scenes.wall(law(), 6, 16, X), 0.6248173),
    "4 x 6 along": (scenes.wall(law(), 4, 6, X), 0.64),
    "4 x 6 across": (scenes.wall(law(), 4, 6, Y), 1.0 / 3.0),
    "4 x 6 askew": (scenes.wall(law(), 4, 6, DIAGONAL), math.sqrt(2.0) / 3.0),
    "4 x 6 askew, .3": (scenes.wall(law(friction=0.3), 4, 6, DIAGONAL), 0.3),
    "3 x 12 across": (scenes.wall(law(), 3, 12, Y), 1.0 / 6.0),
    "3 x 12 askew": (scenes.wall(law(), 3, 12, DIAGONAL), math.sqrt(2.0) / 6.0),
    "actuator, middle block": (scenes.wall_with_actuator(law()), 202.1894),
    "actuator, middle block, .3": (scenes.wall_with_actuator(law(friction=0.3)), 66.49477),
    "actuator, last block": (scenes.wall_with_actuator(law(), "wall.6.4", 0.9), 144.8306),
    "corner +x": (scenes.corner(law(), (1.0, 0.0, 0.0)), 0.6328315),
    "corner -x": (scenes.corner(law(), (-1.0, 0.0, 0.0)), 0.5762355),
    "corner +y": (scenes.corner(law(), (0.0, 1.0, 0.0)), 0.5638456),
    "corner -y": (scenes.corner(law(), (0.0, -1.0, 0.0)), 0.3948452),
    "arch along": (scenes.arch(law(friction=0.7), X), 0.2856458),
    "arch across": (scenes.arch(law(friction=0.7), Y), 0.2614675),
    "arch askew": (scenes.arch(law(friction=0.7), DIAGONAL), 0.3697708),
    "arch along, .4": (scenes.arch(law(friction=0.4), X), 0.0992021),
    "arch across, .4": (scenes.arch(law(friction=0.4), Y), 0.2415385),
    "arch askew, .4": (scenes.arch(law(friction=0.4), DIAGONAL), 0.1325254),
}
CONVEX = {
    "3 x 12 along": (scenes.wall(law("convex"), 3, 12, X), 0.6058426),
    "4 x 6 across": (scenes.wall(law("convex"), 4, 6, Y), 1.0 / 3.0),
    "4 x 6 askew": (scenes.wall(law("convex"), 4, 6, DIAGONAL), math.sqrt(2.0) / 3.0),
    "4 x 6 askew, .3": (scenes.wall(law("convex", 0.3), 4, 6, DIAGONAL), 0.3),
    "actuator, middle block": (scenes.wall_with_actuator(law("convex")), 203.4692),
    "actuator, middle block, .3": (scenes.wall_with_actuator(law("convex", 0.3)), 66.49477),
    "actuator, last block": (scenes.wall_with_actuator(law("convex"), "wall.6.4", 0.9), 144.8306),
    "corner +x": (scenes.corner(law("convex"), (1.0, 0.0, 0.0)), 0.601284),
    "corner -x": (scenes.corner(law("convex"), (-1.0, 0.0, 0.0)), 0.558705),
    "corner +y": (scenes.corner(law("convex"), (0.0, 1.0, 0.0)), 0.539676),
    "corner -y": (scenes.corner(law("convex"), (0.0, -1.0, 0.0)), 0.3948452),
    "arch across": (scenes.arch(law("convex", 0.7), Y), 0.2614675),
    "arch askew": (scenes.arch(law("convex", 0.7), DIAGONAL), 0.356016),
}


@pytest.mark.parametrize("scenario, expected", CONCAVE.values(), ids=CONCAVE)
def test_points_at_the_corners_meet_the_table(scenario, expected):
    found = analysis.limit_load(build.assemble(scenario))
    assert found.load_factor == pytest.approx(expected, rel=3e-7)
    assert found.lower <= found.upper
    assert found.gap < 1e-6


@pytest.mark.parametrize("name", ["4 x 6 across", "corner -y", "arch askew"])
def test_factors_of_large_structures_meet_the_table_too(name, monkeypatch):
    """The method for large programmes, tested on small ones."""
    monkeypatch.setattr(solver, "LARGE", 0)
    scenario, expected = CONCAVE[name]
    found = analysis.limit_load(build.assemble(scenario))
    assert found.load_factor == pytest.approx(expected, rel=3e-7)
    assert found.gap < 1e-6


@pytest.mark.parametrize("scenario, expected", CONVEX.values(), ids=CONVEX)
def test_convex_joints_meet_the_table(scenario, expected):
    found = analysis.limit_load(build.assemble(scenario))
    assert found.load_factor == pytest.approx(expected, rel=2e-6)
    assert found.gap < 3e-6
    assert found.lower < expected * (1.0 + 2e-6) and found.upper > expected * (1.0 - 2e-6)


@pytest.mark.parametrize(
    "formulation, V_4a, V_4b",
    [
        ("concave", 254.5698, 212.2493),
        ("convex", 216.0549, 161.9025),
        ("corrected-shear", 209.3379, 154.8252),
        ("corrected", 208.5335, 154.8252),
    ],
)
def test_one_joint_at_mid_height_carries_what_its_plane_does(formulation, V_4a, V_4b):
    """Limit analysis chooses the normal forces, and so gives the values of loads in the joint's plane."""
    from dembrick.scenario import toml

    for name, expected in (("set4a_mid", V_4a), ("set4b_mid", V_4b)):
        scenario = toml.load(f"scenarios/{name}.toml", [f"joint.formulation={formulation}"])
        found = analysis.limit_load(build.assemble(scenario))
        assert found.load_factor == pytest.approx(expected, rel=1e-6)
        assert found.mechanism.kind == "torsion-shear"


W = 2000.0 * 9.81 * 0.5  # Pa: weight of the stack over its bed


@pytest.mark.parametrize(
    "direction, friction, strengths, expected",
    [
        (Y, 0.64, {"cohesion": 1e4, "tensile_strength": 5e3}, 0.4 * (1.0 + 5e3 / W)),
        (X, 0.64, {"cohesion": 1e4, "tensile_strength": 5e3}, 0.6 * (1.0 + 5e3 / W)),
        (X, 0.3, {"cohesion": 1e3, "tensile_strength": 3e3}, 0.3 + 1e3 / W),
        (Y, 0.64, {"compressive_strength": 15e3}, 0.4 * (15e3 / W - 1.0)),
    ],
)
def test_bonded_and_crushing_points_have_closed_forms(direction, friction, strengths, expected):
    found = analysis.limit_load(build.assemble(scenes.stack(law(friction=friction, **strengths), direction)))
    assert found.load_factor == pytest.approx(expected, rel=1e-6)
    assert found.gap < 1e-6


@pytest.mark.parametrize("direction, arm", [(Y, 0.4), (X, 0.6)])
def test_a_bonded_convex_joint_is_as_strong_in_bending_as_its_corners(direction, arm):
    bonded = law("convex", cohesion=1e4, tensile_strength=5e3)
    found = analysis.limit_load(build.assemble(scenes.stack(bonded, direction)))
    assert found.load_factor == pytest.approx(arm * (1.0 + 5e3 / W), rel=1e-6)


@pytest.mark.parametrize("formulation", ["concave", "corrected-shear", "convex"])
def test_cohesion_scales_the_limit_surface(formulation):
    """V at fixed eccentricity is (c A + mu N) / (mu N) times the dry value, for a load in the joint's plane."""
    from dembrick.scenario import toml

    keys = [f"joint.formulation={formulation}"]
    dry, bonded = (
        analysis.limit_load(build.assemble(toml.load("scenarios/set4a.toml", [*keys, *more]))).load_factor
        for more in ([], ["joint.cohesion=1e4"])
    )
    # corners distribute their normal forces in the best way, dry or bonded, under a load in the plane
    assert bonded / dry == pytest.approx((600.0 + 0.64 * 467.0) / (0.64 * 467.0), rel=1e-5)


PRESSED = [(0.56, 0.05), (0.5, 0.1), (0.45, 0.13), (0.59, 0.2)]  # push over pressure, its arm (m) about the centroid


@pytest.mark.parametrize("cohesion", [0.0, 1e3, 1e5, 1e7])
@pytest.mark.parametrize("push, arm", PRESSED)
def test_a_bonded_convex_joint_that_its_load_presses(push, arm, cohesion):
    """V g = c A + mu (W + V / q) for a push V at an arm and a pressure V / q, g the gauge of the push."""
    found = analysis.limit_load(build.assemble(scenes.pressed_cube(law("convex", 0.6, cohesion=cohesion), push, arm)))
    g = gauge(limit_surface.convex(polygons.rectangle(0.4, 0.4), 1.0, 1.0), (1.0, 0.0, -arm))
    exact = (cohesion * 0.16 + 0.6 * 0.064 * 2000.0 * 9.81) / (g - 0.6 / push)
    assert found.lower <= exact <= found.upper
    assert found.load_factor == pytest.approx(exact, rel=3e-5)


@pytest.mark.parametrize("push, arm", PRESSED)
def test_no_limit_is_only_said_where_forces_can_grow(push, arm, monkeypatch):
    """With too few rounds of planes a finite limit may look unlimited: then there is no answer."""
    monkeypatch.setattr(optimum, "MOST_ROUNDS", 1)
    with pytest.raises(NotConvergedError, match="no limit was found|further apart"):
        analysis.limit_load(build.assemble(scenes.pressed_cube(law("convex", 0.6, cohesion=1e5), push, arm)))


def test_a_ray_that_is_none_is_no_proof_of_no_limit(monkeypatch):
    solve = solver.solve

    def unbounded(programme, sizes=None):
        found = solve(programme)
        return replace(found, status=solver.UNBOUNDED, said="AlmostDualInfeasible") if programme.cost.any() else found

    monkeypatch.setattr(solver, "solve", unbounded)
    with pytest.raises(NotConvergedError, match="AlmostDualInfeasible, but its forces cannot grow"):
        analysis.limit_load(build.assemble(scenes.stack(law(), X)))


def test_a_tilt_knows_that_strengths_do_not_turn():
    """tan th = (b/H)(f_c/(rho g H cos th) - 1) for a stack with four corners that crush."""
    from dataclasses import replace

    from dembrick.scenario.controls import TiltControl

    scenario = scenes.stack(law(compressive_strength=15e3), X)
    tilt = TiltControl((-1.0, 0.0, 0.0), 1.0, 0.02, quasi_static=True)
    assembly = build.assemble(replace(scenario, control=tilt))
    found = analysis.limit_load(assembly, tilt=True)
    angle = math.atan(found.load_factor)
    assert math.tan(angle) == pytest.approx(0.4 * (15e3 / (W * math.cos(angle)) - 1.0), rel=1e-6)


def test_a_symmetric_structure_in_its_plane_has_the_limit_it_has_in_space(monkeypatch):
    for formulation in ("concave", "convex"):
        assembly = build.assemble(scenes.wall(law(formulation), 3, 5, X))
        flat = analysis.limit_load(assembly)
        assert analysis.prepared(assembly, [analysis.live_wrench(assembly)]).frame.per_block == 3
        with monkeypatch.context() as patched:
            patched.setattr("dembrick.simulation.limit_analysis.programme.plane_of_symmetry", lambda *_: None)
            assert analysis.prepared(assembly, [analysis.live_wrench(assembly)]).frame.per_block == 6
            space = analysis.limit_load(assembly)
        assert flat.load_factor == pytest.approx(space.load_factor, rel=1e-6)


def test_the_forces_of_the_lower_bound_balance_and_obey_the_law():
    """Equilibrium from the resultants, independently of the programme's matrix; Coulomb's law point by point."""
    assembly = build.assemble(scenes.corner(law(), (0.7, 0.6, 0.0)))
    found = analysis.limit_load(assembly)
    joints, force = assembly.joints, found.resultants
    total = analysis.dead_wrench(assembly) + found.lower * analysis.live_wrench(assembly)
    on_b = force[:, :1] * joints.axes[:, 2] - force[:, 1:2] * joints.axes[:, 0] - force[:, 2:3] * joints.axes[:, 1]
    about = -np.einsum("ji,jik->jk", force[:, [4, 5, 3]], joints.axes)
    for block, sign in ((joints.block_b, 1.0), (joints.block_a, -1.0)):
        moment = about + np.cross(joints.origin - assembly.position[block], on_b)
        np.add.at(total, block, sign * np.concatenate([on_b, moment], axis=1))
    free = ~assembly.fixed
    assert np.abs(total[free]).max() < 1e-8 * np.abs(analysis.dead_wrench(assembly)).max()
    points = found.forces
    assert (np.hypot(*points.tangential.T) <= 0.64 * points.normal + 1e-7).all()
    assert (points.normal >= -1e-9).all()


def test_the_mechanism_of_the_upper_bound_does_the_work_and_opens_no_joint_inwards():
    assembly = build.assemble(scenes.corner(law(), (0.7, 0.6, 0.0)))
    found = analysis.limit_load(assembly)
    velocity = found.mechanism.velocity
    assert (velocity * analysis.live_wrench(assembly)).sum() == pytest.approx(1.0, rel=1e-6)
    assert -(velocity * analysis.dead_wrench(assembly)).sum() == pytest.approx(found.upper, rel=1e-6)
    moved = found.mechanism.relative
    for j, joint in enumerate(assembly.joints):
        x, y = joint.polygon.T
        opening = moved[j, 2] + moved[j, 3] * y - moved[j, 4] * x
        slip = np.hypot(moved[j, 0] - moved[j, 5] * y, moved[j, 1] + moved[j, 5] * x)
        assert (opening >= 0.64 * slip - 1e-6 * np.abs(velocity).max()).all()


def test_the_bounds_see_less_friction(monkeypatch):
    """One per cent less friction lowers the limit of a sliding wall by one per cent, far outside the bounds."""
    found = analysis.limit_load(build.assemble(scenes.wall(law(friction=0.3), 4, 6, DIAGONAL)))
    less = analysis.limit_load(build.assemble(scenes.wall(law(friction=0.297), 4, 6, DIAGONAL)))
    assert less.upper < found.lower
    assert less.load_factor == pytest.approx(0.99 * found.load_factor, rel=1e-6)


@pytest.mark.parametrize("direction, width", [(X, 0.3), (Y, 0.2)])
@pytest.mark.parametrize("strength", [10e3, 15e3, 1e6])
def test_convex_joints_that_crush(direction, width, strength):
    """A stack of height H pushed over: lambda = (b/H)(1 - rho g H / f_c), the toe crushing over N / (f_c a)."""
    joint = law("convex", friction=0.9, compressive_strength=strength)
    found = analysis.limit_load(build.assemble(scenes.stack(joint, direction)))
    exact = width / 0.5 * (1.0 - W / strength)
    assert found.lower <= exact <= found.upper * (1.0 + 1e-7)
    assert found.load_factor == pytest.approx(exact, rel=1e-5)
    assert found.gap < 1e-4 and found.mechanism.kind == "rocking"


def test_dense_points_tend_to_the_convex_joint_that_crushes():
    """Under an oblique push, without a closed form: 400 points a joint, each with its own strength."""
    joint = {"friction": 0.9, "compressive_strength": 15e3}
    exact, points = (
        analysis.limit_load(build.assemble(scenes.stack(law(formulation, **joint, **more), DIAGONAL)))
        for formulation, more in (("convex", {}), ("distributed", {"points": (20, 20)}))
    )
    assert exact.load_factor == pytest.approx(points.load_factor, rel=1e-5)
    assert exact.gap < 1e-5


def test_a_bond_and_crushing_together():
    """The block carries f_c at its toe and f_t at its heel: M = (N + f_t A)(b - (N + f_t A) / ((f_c + f_t) a)) / 2."""
    joint = law("convex", friction=0.9, cohesion=1e6, tensile_strength=5e3, compressive_strength=15e3)
    found = analysis.limit_load(build.assemble(scenes.stack(joint, Y)))
    total = W + 5e3
    exact = total * 0.2 * (1.0 - total / 20e3) / (W * 0.5)
    assert found.load_factor == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("formulation", ["convex", "concave", "distributed"])
def test_what_is_too_heavy_falls_by_crushing(formulation):
    more = {"points": (4, 4)} if formulation == "distributed" else {}
    joint = law(formulation, friction=0.9, compressive_strength=9e3, **more)
    with pytest.raises(NotConvergedError, match="does not stand under its dead loads: crushing of stack.1"):
        analysis.limit_load(build.assemble(scenes.stack(joint, Y)))
