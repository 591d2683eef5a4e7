"""Supports that settle: an arch whose springing spreads or sinks, a beam on three supports, bricks on two slabs."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dembrick.runs.reactions import reaction as reaction_bounds
from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.generators import Arch, Wall
from dembrick.scenario.model import JointLaw, Output, Scenario
from dembrick.scenario.time_functions import SupportPath, Turn
from dembrick.simulation.dynamics import run
from dembrick.simulation.dynamics.paths import load_path
from dembrick.simulation.dynamics.support_motion import SupportMotion
from helpers.key_lines import key_lines
from helpers.stone_scenes import law, of_stone

G = 9.81
WEIGHT = 13811.599  # N, of the arch
# thrust of the arch against the spread (m) of its right springing: three rigid hinges
SPREAD = {0.01: 2156.0722, 0.05: 2263.4567, 0.1: 2409.2076}
FURTHER = {0.05: 2263.4567, 0.1: 2409.2076, 0.2: 2749.3188, 0.3: 3181.3291, 0.4: 3762.9176}
LEAST_THRUST = 2130.36785
# right reaction and thrust against the sinking (m) of its right springing
SINKING = {0.01: (6585.1488, 2592.0099), 0.1: (6758.8426, 2607.2245), 0.2: (6948.2364, 2623.5674)}


def arch(control, stiffness=1e10) -> Scenario:
    """Semicircle of 20 straight voussoirs, mean radius 1.5 m, 0.3 m thick, 0.5 m deep."""
    vault = Arch("arch", "stone", 1.5, 0.3, 0.5, 20)
    return of_stone(law("concave", 0.7, stiffness), control, arches=(vault,), output=Output(("frames",)))


@pytest.fixture(scope="module", autouse=True)
def few():
    """Compute fewer equilibria on the path, in longer steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(load_path, "EQUILIBRIA", 10)
        patch.setattr(load_path, "WITHIN", 1.0)
        yield


def thrust_at(result, x) -> float:
    """Reaction along the motion in the equilibrium at this displacement."""
    path = result.run.path
    (row,) = np.flatnonzero(np.isclose(path[:, 0], x, rtol=1e-12, atol=0.0))
    return float(path[row, 1])


@pytest.fixture(scope="module")
def spread():
    return simulate(arch(SettlementControl(("arch.right",), (0.1, 0.0, 0.0))))


def test_the_thrust_of_a_spreading_arch(spread):
    """At the first movement the thrust falls to the minimum of limit analysis, then follows three rigid hinges."""
    assert spread.status == "completed"
    assert spread.settlement["least"]["reaction"] == pytest.approx(LEAST_THRUST, rel=1e-3)
    assert spread.settlement["least"]["displacement"] < 2e-3
    bound = reaction_bounds(spread.scenario, "arch.right", (-1.0, 0.0, 0.0)).least
    assert bound.value == pytest.approx(LEAST_THRUST, rel=1e-6)
    for x in (0.01, 0.05, 0.1):
        assert thrust_at(spread, x) == pytest.approx(SPREAD[x], rel=6e-5)
    np.testing.assert_allclose(spread.rows["load"], spread.run.path[:, 1], rtol=1e-12)
    np.testing.assert_allclose(spread.rows["displacement"], spread.run.path[:, 0], rtol=1e-12)
    assert list(spread.rows["time"]) == list(range(len(spread.run.path)))


def test_supports_carry_the_weight_at_every_equilibrium(spread):
    """The springings carry the weight and equal thrusts; moments about the left one balance in the deformed state."""
    reaction, frames = spread.rows["reaction"], spread.frames
    np.testing.assert_allclose(reaction[:, :, 2].sum(axis=1), WEIGHT, rtol=1e-6)
    np.testing.assert_allclose(reaction[:, 0, 0], -reaction[:, 1, 0], rtol=1e-4)
    np.testing.assert_allclose(reaction[:, 1, 0], -spread.rows["load"], rtol=1e-9)
    assembly = spread.assembly
    weights = np.where(assembly.fixed, 0.0, assembly.mass * G)
    place = assembly.position + frames["displacement"]
    turning = (weights * place[:, :, 0]).sum(axis=1)
    # moments are about the centroids at the start, also of the support that has moved away
    (left, right), arm = np.flatnonzero(assembly.fixed), assembly.position
    about_y = reaction[:, :, 4].sum(axis=1)
    for k, i in enumerate((left, right)):
        about_y += arm[i, 2] * reaction[:, k, 0] - arm[i, 0] * reaction[:, k, 2]
    np.testing.assert_allclose(about_y, -turning, atol=1e-5 * WEIGHT)


def test_the_crown_of_a_spreading_arch_comes_down(spread):
    """The crown sinks as in two rigid halves on three hinges: 60.9893 mm at a spread of 0.1 m."""
    assembly, hinge = spread.assembly, np.array([0.0, 0.0, 1.65])
    stone = assembly.names.index("arch.10")
    from dembrick.geometry.rotations import rotation_matrix

    turn = rotation_matrix(spread.frames["orientation"][-1, stone]) @ assembly.rotation[stone].T
    arm = hinge - assembly.position[stone]
    moved = np.diff(spread.frames["displacement"][[0, -1], stone], axis=0)[0] + turn @ arm - arm
    assert moved[2] == pytest.approx(-0.0609893, rel=1e-3)
    assert moved[0] == pytest.approx(0.05, rel=1e-3)


def test_a_springing_that_sinks():
    result = simulate(arch(SettlementControl(("arch.right",), (0.0, 0.0, -0.2))))
    thrust = dict(zip(result.rows["displacement"].round(12), result.rows["reaction"][:, 0, 0], strict=True))
    for x, (reaction, horizontal) in SINKING.items():
        assert thrust_at(result, x) == pytest.approx(reaction, rel=5e-4)
        assert thrust[x] == pytest.approx(horizontal, rel=5e-4)
    # elastic joints let the stones sink by some 10 um, not exactly alike on both sides
    assert result.run.path[0, 1] == pytest.approx(0.5 * WEIGHT, rel=1e-5)
    assert result.run.path[1:, 1].min() == pytest.approx(6565.6696, rel=1e-3)
    assert result.fallen == []  # although stones have sunk with it by two thirds of their thickness


def test_two_supports_that_move_apart():
    """Half of the spread at each springing equals all of it at one; so does a rotation about a far point."""
    ways = (
        SupportPath(("arch.right",), (0.005, 0.0, 0.0)),
        SupportPath(("arch.left",), (-0.005, 0.0, 0.0)),
    )
    result = simulate(arch(SettlementControl(motions=ways)))
    # each moves half as far, and both carry the thrust
    path = result.run.path
    assert path[-1, 0] == pytest.approx(0.005, rel=1e-12)
    assert path[-1, 1] == pytest.approx(2.0 * SPREAD[0.01], rel=2e-4)


def beam(control, width, formulation) -> Scenario:
    """A block of 3000 N on three supports at -1, 0 and 1 m, each of 100 MN/m."""
    depth, height = 0.5, 3000.0 / (2000.0 * G * 2.4 * 0.5)
    blocks = [Block("beam", "stone", box=(2.4, depth, height), position=(0.0, 0.0, 0.5 * height))]
    for name, x in (("left", -1.0), ("middle", 0.0), ("right", 1.0)):
        blocks.append(Block(name, "stone", box=(width, depth, 0.2), position=(x, 0.0, -0.1), fixed=True))
    law = JointLaw(formulation, 0.6, 1e8 / (width * depth), 0.4e8 / (width * depth))
    return of_stone(law, control, blocks, output=Output(()))


@pytest.mark.parametrize(
    "formulation, support, left, middle, right",
    [
        ("convex", "middle", 1333.3333, 333.3333, 1333.3333),
        ("convex", "right", 835.8209, 1333.3333, 830.8458),
        ("concave", "right", 840.7225, 1333.3333, 825.9442),
    ],
)
def test_a_beam_on_three_supports(formulation, support, left, middle, right):
    """One support sinks by 0.01 mm: the reactions change as by springs of 100 MN/m."""
    scenario = beam(SettlementControl((support,), (0.0, 0.0, -1e-5)), 0.2, formulation)
    found = simulate(scenario).reactions
    assert [found[name][2] for name in ("left", "middle", "right")] == pytest.approx([left, middle, right], rel=2e-5)


def test_a_stiff_beam_lifts_off_a_support_that_sinks():
    scenario = beam(SettlementControl(("middle",), (0.0, 0.0, -1e-3)), 0.2, "convex")
    found = simulate(scenario).reactions
    assert found["middle"] == [0.0] * 6
    assert found["left"][2] == pytest.approx(1500.0, rel=1e-6)


def two_slabs(control, friction) -> Scenario:
    """Running bond of 4 courses of 4 blocks on two slabs that meet in its middle."""
    slabs = (
        Block("left", "stone", (1.2, 0.6, 0.2), (0.2, 0.0, -0.1), fixed=True),
        Block("right", "stone", (1.2, 0.6, 0.2), (1.4, 0.0, -0.1), fixed=True),
    )
    wall = Wall("wall", "stone", (0.4, 0.2, 0.2), 4, 4, ends="half", position=(0.0, 0.0, 0.0))
    return of_stone(law("concave", friction), control, slabs, walls=(wall,), output=Output(()))


@pytest.mark.parametrize("friction, bound", [(0.5, 1255.68), (0.8, 969.59)])
def test_bricks_on_a_slab_that_sinks(friction, bound):
    """The slab's reaction falls from half the weight, but not below the least value of associative equilibrium."""
    scenario = two_slabs(SettlementControl(("right",), (0.0, 0.0, -5e-3)), friction)
    result = simulate(scenario)
    weight = 5022.72
    reaction = result.run.path[:, 1]
    assert reaction[0] == pytest.approx(0.5 * weight, rel=1e-3)
    assert reaction.min() > bound * (1.0 - 1e-3)
    assert reaction.min() < 0.42 * weight
    assert result.status == "completed"


@pytest.mark.parametrize("friction, falls", [(0.7, math.atan(0.2)), (0.15, math.atan(0.15))])
def test_a_block_on_a_floor_that_turns(friction, falls):
    """The block overturns at atan(b/h), or slides at atan(mu); the settlement is the arc of the floor's corner."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.2, 0.4, 1.0), (0.0, 0.0, 0.5))
    control = SettlementControl(("floor",), rotation=Turn((0.0, 1.0, 0.0), 20.0, (0.0, 0.0, 0.0)), tolerance=2e-3)
    result = simulate(of_stone(law("concave", friction, 4e9), control, (floor, block), output=Output(())))
    corner = math.hypot(0.5, 0.2)
    assert result.status == "collapse"
    found = result.collapse
    assert found["settlement"] / corner == pytest.approx(falls, rel=3e-3)
    low, high = found["settlement_range"]
    assert low < found["settlement"] < high and high - low < 4e-3 * high
    assert found["mechanism"] == ("rocking" if friction > 0.2 else "sliding")
    assert found["blocks"] == ["block"]


def test_hinges_of_stiff_joints_stay_closed():
    """Ten times as stiff, in long steps: a hinge that chattered open would slide, and its joint would fail for good."""
    result = simulate(arch(SettlementControl(("arch.right",), (0.1, 0.0, 0.0)), stiffness=1e11))
    for x in (0.05, 0.1):
        assert np.interp(x, *result.run.path[:, :2].T) == pytest.approx(SPREAD[x], rel=2e-5)
    assert not result.run.motion.contact_detection.retired.any()


@pytest.fixture(scope="module")
def too_far():
    """Result of an arch in long steps, but for the first and the last ones, with a coarse tolerance."""
    end, first = 0.465, [0.05 * 2.0**-k for k in range(7, 0, -1)]
    way = [*first, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.43, 0.45, end]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(load_path, "shares", lambda *_: [x / end for x in way])
        return simulate(arch(SettlementControl(("arch.right",), (end, 0.0, 0.0), tolerance=1e-2)))


def test_an_arch_that_spreads_too_far(too_far):
    """At .458035 m the thrust reaches the outer edges of both springings; up to there it follows three rigid hinges, to
    0.4 % at nine tenths of that. By then the crown has rotated so far that its blocks press each other as new contacts,
    along a toe of 2 mm: an effect of the finite stiffness of the joints, which vanishes with its root."""
    for x, thrust in FURTHER.items():
        assert thrust_at(too_far, x) == pytest.approx(thrust, rel=2e-4 if x < 0.35 else 4e-3)
    assert too_far.status == "collapse"
    assert too_far.collapse["settlement"] == pytest.approx(0.458035, rel=1e-2)
    hinges = {name.split(" / ")[0] for name in too_far.collapse["hinges"]}
    assert len(hinges) >= 4 and len(too_far.collapse["blocks"]) >= 19  # of 20: rounding decides about the last one
    assert too_far.fallen == too_far.collapse["blocks"]
    said = key_lines(too_far)
    assert said["settlement at collapse"].startswith("settlement at collapse 45")
    assert said["hinges"].startswith("hinges arch.")


def test_frames_of_the_fall_follow_the_last_equilibrium(too_far):
    """Frames show the crown falling further and further, by half of a voussoir's least dimension; rows end before."""
    rows, frames = too_far.rows, too_far.frames
    last = len(too_far.run.path) - 1
    assert rows["time"][-1] == last and len(rows["time"]) == len(too_far.run.path)
    falling = frames["time"] > last
    assert falling.sum() > 3 and frames["time"][-1] == last + 1.0 and (np.diff(frames["time"]) > 0.0).all()
    assert frames["time"][~falling].tolist() == rows["time"].tolist()
    crown = too_far.assembly.names.index("arch.10")
    assert (np.diff(frames["displacement"][last:, crown, 2]) < 0.0).all()
    # from the equilibrium before, as the last two are closer than the tolerance
    away = np.linalg.norm(frames["displacement"][last:] - frames["displacement"][last - 1], axis=2).max(axis=1)
    least = min(np.ptp(shape.vertices, axis=0).min() for shape in too_far.assembly.shapes)
    assert 0.5 * least < away[-1] < least and away[1] < 0.5 * away[-1]


def test_a_collapse_in_real_time_says_at_which_settlement():
    """A floor rotates under a block until it overturns, at atan(b/h) and a little later, as falling takes time."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.2, 0.4, 0.5), (0.0, 0.0, 0.25))
    turn = Turn((0.0, 1.0, 0.0), 30.0, (0.0, 0.0, 0.0))
    control = SettlementControl(("floor",), rotation=turn, quasi_static=False, rate=0.1)
    result = simulate(of_stone(law("concave", 0.9, 1e8), control, (floor, block)))
    assert result.status == "collapse" and result.collapse["blocks"] == ["block"] and result.settlement is None
    angle = result.collapse["settlement"] / math.hypot(0.5, 0.2)
    assert math.atan(0.4) * 0.98 < angle < math.atan(0.4) * 1.1
    assert "settlement at collapse" in key_lines(result)


@pytest.mark.parametrize("friction", [0.6, 0.2])
def test_what_comes_down_with_its_support_has_not_fallen(friction):
    """A floor sinks by twice the height of a block and rotates by 25 deg, with the block or from under it."""
    floor = Block("floor", "stone", (2.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    away = Block("away", "stone", (1.0, 1.0, 0.2), (0.0, 1.2, -0.1), fixed=True)
    block = Block("block", "stone", (0.2, 0.2, 0.1), (0.3, 0.0, 0.05))
    turn, rides = Turn((0.0, 1.0, 0.0), 25.0), friction > math.tan(math.radians(25.0))
    control = SettlementControl(("floor",), (0.0, 0.0, -0.2), turn, quasi_static=False, rate=0.5)
    scene = of_stone(law("concave", friction, 3e7), control, (floor, away, block), output=Output(()))
    result = simulate(scene)
    assert result.fallen == ([] if rides else ["block"])
    assert result.status == ("completed" if rides else "collapse")


@pytest.mark.parametrize("size, rate", [(1.0, 0.05), (0.1, 0.05 * math.sqrt(0.1))])
def test_a_tower_that_falls_slowly_is_seen_to_fall(size, rate):
    """A tower of 2 x 2 x 10 m, on a floor that rotates by little more than atan(1 / 5): at both scales it falls alike,
    some seconds after the floor has stopped."""
    floor = Block("floor", "stone", (3.0 * size, 3.0 * size, 0.2 * size), (0.0, 0.0, -0.1 * size), fixed=True)
    tower = Block("tower", "stone", (2.0 * size, 2.0 * size, 10.0 * size), (0.0, 0.0, 5.0 * size))
    turn = Turn((0.0, 1.0, 0.0), 11.5, (0.0, 0.0, 0.0))
    control = SettlementControl(("floor",), None, turn, quasi_static=False, rate=rate)
    result = simulate(of_stone(law("concave", 0.8, 1e9 / size), control, (floor, tower), output=Output(())))
    assert result.status == "collapse" and result.fallen == ["tower"]
    assert result.as_dict()["speed_at_the_end"] > 0.0 and "still moving" in key_lines(result)


def over_the_ground(friction: float, block: tuple, angle: float, rate: float, formulation: str, kn: float) -> Scenario:
    """A block on a floor that rotates in real time, above the ground onto which it falls."""
    ground = Block("ground", "stone", (40.0, 40.0, 0.4), (0.0, 0.0, -1.5), fixed=True)
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    control = SettlementControl(("floor",), None, Turn((0.0, 1.0, 0.0), angle), quasi_static=False, rate=rate)
    parts = ground, floor, Block("b", "stone", block, (0.0, 0.0, 0.5 * block[2]))
    return of_stone(law(formulation, friction, kn), control, parts, output=Output(("energy",)))


@pytest.mark.parametrize(
    "friction, block, rate, formulation, off",
    [(0.12, (0.156, 0.4, 0.524), 0.016, "corrected-shear", 0.006), (0.9, (0.2, 0.4, 0.5), 0.0125, "concave", 0.018),
     (0.9, (0.2, 0.4, 0.5), 0.1, "concave", 0.009)],
)  # fmt: skip
def test_the_settlement_at_which_a_block_leaves_its_balance(friction, block, rate, formulation, off):
    """The block slides from tan = mu on, or overturns from tan = b / h, and at the end lies still on the ground."""
    truth = min(friction, block[0] / block[2])
    angle = math.degrees(math.atan(truth)) + 3.0
    found = simulate(over_the_ground(friction, block, angle, rate, formulation, 2e8), record=False).collapse
    floor = math.hypot(0.5, 0.1)  # settlement per angle: distance from its centroid to its farthest corner
    low, high = found["settlement_range"]
    assert low - 0.01 * high < math.atan(truth) * floor < high + 0.01 * high
    assert found["settlement"] == pytest.approx(math.atan(truth) * floor, rel=off)


@pytest.mark.slow
def test_a_spread_in_real_time_is_that_of_equilibria(monkeypatch):
    """At 20 mm/s the thrust follows three hinges except for vibrations, and the energy balances."""
    control = SettlementControl(("arch.right",), (0.01, 0.0, 0.0), quasi_static=False, rate=0.02)
    monkeypatch.setattr(run, "AFTER", (1.0, 2.0))  # nothing falls
    scenario = dataclasses.replace(arch(control), output=Output(rows=14000, frames=20))
    result = simulate(scenario)
    rows = result.rows
    assert result.status == "completed" and rows["displacement"][-1] == pytest.approx(0.01, rel=1e-9)
    late = rows["time"] > rows["time"][-1] - 0.3
    assert rows["load"][late].mean() == pytest.approx(SPREAD[0.01], rel=2e-3)
    assert result.energy.relative_residual < 1e-5
    # gravity does work on the stones, and the thrust on the support that moves
    first, *_, last = result.frames["displacement"][:, :, 2]
    fallen = float((result.assembly.mass * G) @ (first - last))
    work = np.trapezoid(rows["load"], rows["displacement"])
    assert rows["energy"]["external"][-1] == pytest.approx(fallen - work, abs=1e-4 * work)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.9)])
def test_a_support_goes_along_its_path_and_stays_where_it_is_held(turn):
    """At any share of its path the reference point has moved, and the support turned about it, by that share."""
    start, point, way = np.array([[1.0, 2.0, 3.0]]), np.array([[0.5, 2.5, 3.0]]), np.array([[0.2, 0.0, -0.1]])
    before = Rotation.from_rotvec([0.1, 0.2, 0.3])
    quaternion = before.as_quat(scalar_first=True)[None]
    motion = SupportMotion(np.array([4]), start, quaternion, np.array([0.4]), way, point, np.array([turn]), 1.0)
    for share in (np.full(4, 0.3), np.array([0.0, 0.1, 0.25, 0.6])):
        steps = motion.between(share, 0.5)
        for k, part in enumerate(share[1:]):
            turned = Rotation.from_rotvec(part * np.array(turn))
            there = point + part * way + turned.apply(start - point)
            np.testing.assert_allclose(steps.place[k], there, rtol=1e-14)
            np.testing.assert_allclose((turned * before).as_matrix(), _matrix(steps.orientation[k, 0]), atol=1e-15)
            gone = part - share[k]
            np.testing.assert_allclose(
                steps.velocity[k], (there - motion.pose(share[k : k + 1])[0][0]) / 0.5, atol=1e-15
            )
            np.testing.assert_allclose(steps.spin[k, 0], gone * np.array(turn) / 0.5, atol=1e-15)
            corners = before.apply(0.4 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]))
            moved = turned.apply(corners) - Rotation.from_rotvec(share[k] * np.array(turn)).apply(corners)
            moved += steps.velocity[k] * 0.5
            assert (moved**2).sum(axis=1).max() <= steps.moved[k] * (1.0 + 1e-12)


def _matrix(quaternion) -> np.ndarray:
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


def test_blocks_that_never_were_calm_fell_at_some_settlement():
    """A floor is pulled away at once; the reported settlement was 0 m, between 0 and 0."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    column = Block("column", "stone", (0.1, 0.1, 1.0), (0.0, 0.0, 0.5))
    control = SettlementControl(("floor",), displacement=(0.3, 0.0, 0.0), quasi_static=False, rate=1.0)
    fallen = simulate(of_stone(law("concave", 0.8, 1e8), control, (floor, column)), record=False).collapse
    low, high = fallen["settlement_range"]
    assert low == 0.0 < fallen["settlement"] < high


def test_what_has_moved_is_told_of_free_blocks_alone():
    """A lintel rotates about the inner edge of one pier as the other sinks, and lies on the latter's outer edge: its
    centroid moves by 0.8 / 2.0 of the settlement, and the supports do not count."""
    piers = tuple(Block(n, "stone", (0.4, 0.4, 0.2), (x, 0.0, -0.1), fixed=True) for n, x in (("l", -1.0), ("r", 1.0)))
    lintel = Block("lintel", "stone", (2.4, 0.4, 0.2), (0.0, 0.0, 0.1))
    control = SettlementControl(("r",), displacement=(0.0, 0.0, -0.02), quasi_static=False, rate=0.02)
    found = simulate(of_stone(law("concave", 0.6, 1e8), control, (*piers, lintel)), record=False).as_dict()
    assert found["displacement"] == pytest.approx(0.02 * 0.8 / 2.0, rel=0.05)
    assert found["displacement"] <= found["greatest_displacement"]["lintel"] * (1.0 + 1e-9)
