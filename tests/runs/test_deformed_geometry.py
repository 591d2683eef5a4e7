"""Searches in the deformed geometry: after a settlement, and for blocks that lean enough to change the limit."""

import itertools
import math
import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from dembrick.errors import ScenarioError, UndecidedError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.history import read
from dembrick.runs.simulate import restart, simulate
from dembrick.runs.steps import steps
from dembrick.scenario import toml
from dembrick.simulation.dynamics.paths import driven_path, equilibria
from helpers.key_lines import key_lines
from helpers.restart_cases import stop_in_stages
from helpers.scenario_text import block, header, jack
from helpers.stone_scenes import GRAVITY

G, WEIGHT = 9.81, 16.0 * 9.81
FLOOR = block("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
BLOCK = block("block", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1))
JACK = jack("block", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), "stages = [2]")
STATICS, YIELD = 'kind = "statics"\n', 'kind = "yield"\n'
ALONG_Y = 'kind = "pushover"\ndirection = [0.0, 1.0, 0.0]\n'
TRAVEL = 'kind = "displacement"\nrate = 1e-3\ntravel = 3e-4\n'


pytestmark = pytest.mark.usefixtures("few")


def turns(degrees):
    return (
        'kind = "settlement"\nsupports = ["floor"]\n'
        f"rotation = {{ axis = [0.0, 1.0, 0.0], angle = {degrees}, point = [0.0, 0.0, 0.0] }}\n"
    )


def staged(*controls, blocks=FLOOR + BLOCK, more="", formulation="concave", friction=0.5, kn=1e9, gravity=GRAVITY):
    """A flat block on a floor under a sequence of controls."""
    text = header(formulation, friction, kn, gravity=gravity) + blocks
    text += "".join(f"[[stages]]\n{control}" for control in controls[:-1]) + f"[control]\n{controls[-1]}{more}"
    return toml.loads(text, "deformed.toml")


def brackets(result, V):
    """V lies between a load that stands and one that falls, and their distance is within the tolerance."""
    point = result.yield_point
    assert point.V_lower <= V <= point.V_upper
    assert point.V_upper - point.V_lower <= 1.01 * 1e-3 * point.V_upper
    assert point.V == pytest.approx(0.5 * (point.V_lower + point.V_upper), rel=1e-12)


@pytest.mark.parametrize("formulation", [pytest.param("concave", marks=pytest.mark.slow), "convex"])
def test_a_push_down_and_across_a_floor_that_has_turned(formulation):
    """Down the floor V = tan(phi - th), and a tilt about y adds to th; across it friction resists both components."""
    th, phi = math.radians(10.0), math.atan(0.5)
    down = simulate(staged(turns(10.0), 'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n', formulation=formulation))
    brackets(down, math.tan(phi - th))
    assert down.status == "collapse"
    assert down.collapse["mechanism"] == "sliding" and down.collapse["blocks"] == ["block"]
    assert down.collapse["load_factor"] == down.yield_point.V and down.collapse["angle"] is None
    assert down.yield_point.N == pytest.approx(
        WEIGHT * (math.cos(th) - down.yield_point.V_lower * math.sin(th)), rel=1e-5
    )
    np.testing.assert_allclose(down.rows["load"], down.run.path[:, 1], rtol=1e-12)
    np.testing.assert_allclose(down.rows["actuator_force"][:, 0], WEIGHT * down.rows["load"], rtol=1e-12)
    tilt = 'kind = "tilt"\naxis = [0.0, 1.0, 0.0]\n'
    tilted = simulate(staged(turns(10.0), tilt, formulation=formulation), record=False)
    assert tilted.collapse["angle"] == pytest.approx(math.degrees(phi) - 10.0, rel=1e-3)
    across = simulate(staged(turns(10.0), STATICS, ALONG_Y, formulation="convex"), record=False)
    exact = math.sqrt((0.5 * math.cos(th)) ** 2 - math.sin(th) ** 2)  # neglects a little torsion, as the block leans
    assert across.yield_point.V == pytest.approx(exact, rel=1e-3)
    assert [stage["status"] for stage in across.stages] == ["completed", "stands"]


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_actuators_across_a_floor_that_has_turned(formulation):
    """The limit, and V for a travel of the actuators, are those of a level floor under inclined gravity."""
    th = math.radians(10.0)
    lean = (G * math.sin(th), 0.0, -G * math.cos(th))
    level = staged(
        'kind = "yield"\ntolerance = 1e-6\n',
        more=JACK.replace("[2]", "[1]"),
        formulation=formulation,
        gravity=lean,
        kn=1e9,
    )
    V = simulate(level, record=False).yield_point.V
    found = simulate(staged(turns(10.0), YIELD, more=JACK, formulation=formulation), record=False)
    brackets(found, V)
    assert found.status == "yield" and found.collapse is None and found.as_dict()["collapse"] is None
    driven = simulate(staged(turns(10.0), TRAVEL, more=JACK, formulation=formulation))
    assert driven.status == "completed"
    assert driven.yield_point.V_peak == pytest.approx(V, rel=2e-5)
    assert driven.yield_point.V == pytest.approx(V, rel=1e-4)
    assert driven.rows["displacement"][-1] == pytest.approx(3e-4, rel=0.15)
    assert driven.rows["load"].max() == driven.yield_point.V_peak


def arch_at(placed, built, friction, push):
    """Largest V of forces at the closed corners of joints between blocks at ``placed`` (position, rotation), by linear
    programming in the plane y = 0."""
    position, rotation = placed
    free = np.flatnonzero(~built.fixed)
    row, columns = {block: 3 * k for k, block in enumerate(free)}, []
    turn = rotation @ np.swapaxes(built.rotation, 1, 2)
    for joint in built.joints:
        a, b = joint.block_a, joint.block_b
        normal = turn[a] @ joint.axes[2]
        for corner in joint.polygon:
            start = joint.origin + corner @ joint.axes[:2]
            on_a, on_b = (position[i] + turn[i] @ (start - built.position[i]) for i in (a, b))
            if (on_b - on_a) @ normal > 2e-5:
                continue
            for force in (normal, np.cross([0.0, 1.0, 0.0], normal)):
                column = np.zeros(3 * len(free))
                for stone, sign in ((b, 1.0), (a, -1.0)):
                    if stone in row:
                        moment = np.cross(on_b - position[stone], force)[1]
                        column[row[stone] : row[stone] + 3] += sign * np.array([force[0], force[2], moment])
                columns.append(column)
    weight = built.mass[free] * G
    load = (weight[:, None] * [push[0], push[2], 0.0]).ravel()
    dead = (weight[:, None] * [0.0, -1.0, 0.0]).ravel()
    forces = len(columns) // 2
    cones = np.kron(np.eye(forces), [[-friction, 1.0], [-friction, -1.0]])
    cones = np.column_stack([cones, np.zeros(2 * forces)])
    worth = np.append(np.zeros(2 * forces), -1.0)
    bounds = [(0.0, None), (None, None)] * forces + [(0.0, None)]
    found = linprog(
        worth, cones, np.zeros(2 * forces), np.column_stack([*columns, load]), -dead, bounds, method="highs"
    )
    assert found.status == 0, found.message
    return float(found.x[-1])


ARCH = '[[arches]]\nname = "arch"\nmaterial = "stone"\nradius = 1.5\nthickness = 0.5\ndepth = 0.5\nvoussoirs = 12\n'
PUSH = 'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n'


def test_an_arch_that_has_spread_is_pushed():
    """Against linear programming for the displaced stones, whose hinges have opened; .4786 before the spread."""
    spread = 'kind = "settlement"\nsupports = ["arch.right"]\ndisplacement = [0.2, 0.0, 0.0]\n'
    scenario = staged(spread, PUSH, blocks=ARCH, friction=0.7)
    settled = simulate(replace(scenario, control=scenario.stages[0], stages=(), text=None))
    assembly = settled.assembly
    position = assembly.position + settled.frames["displacement"][-1]
    rotation = rotation_matrix(settled.frames["orientation"][-1])
    V = arch_at((position, rotation), assembly, 0.7, (1.0, 0.0, 0.0))
    assert V == pytest.approx(0.14562, abs=2e-5)
    level = arch_at((assembly.position, assembly.rotation), assembly, 0.7, (1.0, 0.0, 0.0))
    assert level == pytest.approx(0.47863, abs=1e-5)
    found = simulate(scenario)
    assert found.yield_point.V == pytest.approx(V, rel=1e-3)
    assert found.collapse["mechanism"] == "rocking" and len(found.collapse["hinges"]) >= 3


def leaning(control, kn, more=""):
    """A slender block on a soft bed without tension."""
    blocks = FLOOR + BLOCK.replace("0.4, 0.2, 0.1", "0.3, 0.5, 1.0").replace("0.05]", "0.5]")
    return staged(control, blocks=blocks, formulation="convex", friction=2.0, kn=kn, more=more)


SIZE, BED = (0.3, 0.5, 1.0), 1e9  # m; Pa/m
SLENDER = 2000.0 * G * math.prod(SIZE)  # N


def leans_at(turned):
    """V over N of the slender block at its rotation th (rad): a contact of length L carries N = k d L^2 th / 2 at
    e = b / 2 - L / 3 from the middle, sunk there by 2 L th / 3; moments about that point balance."""
    b, d, h = SIZE
    L = np.sqrt(2.0 * SLENDER / (BED * d * turned))
    e, sunk = 0.5 * b - L / 3.0, 2.0 * L * turned / 3.0
    return (e - 0.5 * h * np.tan(turned)) / (0.5 * h + e * np.tan(turned) - sunk)


def test_a_slender_block_on_a_soft_bed_leans_before_it_overturns():
    large = PUSH + "large_displacements = true\n"
    V = leans_at(np.linspace(0.005, 0.03, 10001)).max()
    assert V == pytest.approx(0.26653, abs=2e-5) and SIZE[0] / SIZE[2] == 0.3
    found = simulate(leaning(large, BED), refine=True, record=False)
    brackets(found, V)
    # the error covers the limit of rigid blocks; halved steps change V by less than the tolerance
    assert found.as_dict()["error_estimate"] == pytest.approx(0.3 - V, rel=0.08)
    small = simulate(leaning(PUSH, BED), record=False)
    assert small.yield_point.V == pytest.approx(0.3, rel=1e-3)


def test_a_travel_goes_on_behind_the_peak_of_a_block_that_leans(monkeypatch):
    control = 'kind = "displacement"\nrate = 1e-3\ntravel = 2e-2\nlarge_displacements = true\n'
    monkeypatch.setattr(driven_path, "EQUILIBRIA", 40)
    result = simulate(leaning(control, BED, jack("block", (0.0, 0.0, 0.5))))
    turned = 2.0 * np.arcsin(result.frames["orientation"][:, 1, 2])
    opened = turned > 2.0 * SLENDER / (BED * SIZE[0] ** 2 * SIZE[1])
    assert opened.sum() > 25 and turned[-1] > 0.03
    V = SLENDER * leans_at(turned[opened])
    np.testing.assert_allclose(result.rows["load"][opened], V, rtol=3e-4)
    assert result.yield_point.V_peak == pytest.approx(V.max(), rel=1e-4)
    assert result.rows["load"][-1] < 0.95 * result.yield_point.V_peak


def turned_about_its_toe(travel: float) -> float:
    """V (N) that balances the rigid block of `TIED` with its driven point moved by ``travel`` and its tie stretched."""
    toe, weight = np.array([0.2, 0.0]), 320.0 * G
    low, high = 0.0, 1.0
    for _ in range(100):
        angle = 0.5 * (low + high)
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        head, tied, middle = (turn @ (point - toe) + toe for point in np.array([[-0.2, 1.0], [-0.2, 0.6], [0.0, 0.5]]))
        low, high = (angle, high) if head[0] + 0.2 < travel else (low, angle)
    tie = tied - np.array([-0.2, 0.0])
    length = math.hypot(*tie)
    pull = -(300.0 + 5000.0 * (length - 0.6)) * tie / length
    arm = tied - toe
    return float((weight * (toe[0] - middle[0]) + arm[0] * pull[1] - arm[1] * pull[0]) / head[1])


TIED = (
    block("block", (0.0, 0.0, 0.5), (0.4, 0.4, 1.0))
    + jack("block", (-0.2, 0.0, 1.0))
    + """
[[ties]]
between = [{ block = "block", point = [-0.2, 0.0, 0.6] }, { block = "floor", point = [-0.2, 0.0, 0.0] }]
stiffness = 5000.0
prestress = 300.0
[control]
kind = "displacement"
rate = 0.01
large_displacements = true
"""
)


@pytest.mark.parametrize("travel", [0.25, 0.1])
def test_a_travel_ends_where_it_was_to_end(travel, monkeypatch):
    """The path ends at the given travel; V there is that of a rigid block on its toe, and its bracket contains it."""
    monkeypatch.setattr(driven_path, "EQUILIBRIA", 20)
    given = header(friction=0.9, normal_stiffness=1e10)
    found = simulate(toml.loads(f"{given}{FLOOR}{TIED}travel = {travel}\n"), record=False, progress=False)
    path, point = found.run.path, found.yield_point
    assert path[-1, 0] - path[0, 0] == pytest.approx(travel, rel=1e-9)
    assert path[-1, 1] == pytest.approx(turned_about_its_toe(travel), rel=1e-4)
    assert point.V == path[-1, 1] and point.V_lower <= point.V < point.V_peak


def held_back(angle: float, attached, anchored, stiffness: float, strength: float, prestress: float) -> float:
    """V (N) that balances the rigid block of `TIED` rotated by ``angle`` (rad) about its toe, its tie stretched and
    yielding."""
    toe, weight, start = np.array([0.2, 0.0]), 320.0 * G, math.dist(attached, anchored)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    head, tied, middle = (turn @ (np.array(point) - toe) + toe for point in ((-0.2, 1.0), attached, (0.0, 0.5)))
    line, arm = tied - np.array(anchored), tied - toe
    length = math.hypot(*line)
    pull = -min(strength, max(0.0, prestress + stiffness * (length - start))) * line / length
    return float((weight * (toe[0] - middle[0]) + arm[0] * pull[1] - arm[1] * pull[0]) / head[1])


@pytest.mark.parametrize(
    "anchored, attached, stiffness, strength, prestress",
    [
        (-0.8, 0.66, 20800.0, 1258.8, 17.3),
        pytest.param(-0.84, 0.43, 20200.0, 287.7, 37.7, marks=pytest.mark.slow),
        pytest.param(-0.92, 0.92, 6140.0, 1430.6, 223.1, marks=pytest.mark.slow),
    ],
)
def test_an_inclined_tie_yields_by_no_more_than_rest_asks_for(anchored, attached, stiffness, strength, prestress):
    """The greatest V that balances the leaning block lies in the bracket: a swing towards equilibrium yields no tie,
    and a fall during one is not taken as a proof for a lower load."""
    ends, law = ((-0.2, attached), (anchored, 0.0)), (stiffness, strength, prestress)
    most = max(held_back(angle, *ends, *law) for angle in np.linspace(0.0, 0.4, 20001))
    tied = TIED.partition("[control]")[0].replace("[-0.2, 0.0, 0.0]", f"[{anchored}, 0.0, 0.0]")
    tied = tied.replace("[-0.2, 0.0, 0.6]", f"[-0.2, 0.0, {attached}]").replace("5000.0", f"{stiffness}")
    tied = tied.replace("prestress = 300.0", f"prestress = {prestress}\nstrength = {strength}")
    control = '[control]\nkind = "yield"\nlarge_displacements = true\n'
    given = header(friction=0.9, normal_stiffness=1e10)
    point = simulate(toml.loads(f"{given}{FLOOR}{tied}{control}"), record=False, progress=False).yield_point
    assert point.V_lower <= most * (1.0 + 1e-4) and most <= point.V_upper * (1.0 + 1e-4)
    assert point.V_upper - point.V_lower < 2e-3 * point.V


def test_an_arch_has_the_same_limit_in_its_own_geometry_as_in_the_deformed_one():
    arch = {"blocks": ARCH.replace("12", "6"), "friction": 0.7, "kn": 1e10}
    controls = (f"{PUSH}large_displacements = {large}\n" for large in ("false", "true"))
    found = [simulate(staged(control, **arch), record=False).yield_point.V for control in controls]
    assert found[1] == pytest.approx(found[0], rel=1e-3)


def test_a_bonded_block_is_tilted():
    """Shear with a bond: m g sin(psi) = c A + mu m g cos(psi), which is no condition on the tangent alone."""
    cohesion, area = 1000.0, 0.08
    tilt = 'kind = "tilt"\naxis = [0.0, 1.0, 0.0]\nlarge_displacements = true\ntolerance = 1e-3\n'
    scenario = staged(tilt, formulation="convex")
    law = replace(scenario.joint, cohesion=cohesion, tensile_strength=500.0, residual_cohesion=cohesion)
    found = simulate(replace(scenario, joint=law, text=None), record=False)
    low, high = found.yield_point.V_lower, found.yield_point.V_upper
    exact = math.atan(0.5) + math.asin(cohesion * area * math.cos(math.atan(0.5)) / WEIGHT)
    assert low <= math.tan(exact) <= high and high < 1.0025 * low


def test_whether_a_block_stands_where_a_settlement_has_brought_it():
    """On a floor at 20 deg, tan 20 = .364: the block stands under its weight and slides under an extra push of .2."""
    load = f'[[loads]]\nblock = "block"\nforce = [{0.2 * WEIGHT!r}, 0.0, 0.0]\nstages = [2]\n'
    stands = simulate(staged(turns(20.0), STATICS), record=False)
    assert stands.status == "stands" and stands.statics["stands"] is True
    assert stands.reactions["floor"][2] == pytest.approx(WEIGHT, rel=1e-6)
    assert np.abs(stands.motion.displacement).max() < 1e-9 and stands.motion.settlement is None
    falls = simulate(staged(turns(20.0), STATICS, more=load))
    assert falls.status == "falls" and falls.statics["blocks"] == ["block"] and falls.reactions is None
    assert "block falls by sliding" in falls.plain_answer and falls.motion.fallen == ["block"]
    with pytest.raises(ScenarioError, match="stage 2 of kind 'statics' fell, and no stage can start"):
        simulate(staged(turns(20.0), STATICS, ALONG_Y, more=load), record=False)


SINKS = 'kind = "settlement"\nsupports = ["floor"]\ndisplacement = [0.0, 0.0, -1e-6]\n'


@pytest.mark.parametrize("control", [STATICS + "large_displacements = true\n", SINKS])
def test_joints_do_not_forget_shear_as_the_first_loads_come(control):
    """Two cubes, the upper fixed along y, and a push on the lower one: two joints share it by their springs. Released
    onto one another from their drawn positions, they once swung open and lost 3 % of the shear."""
    size, push, k_n = 0.4, 200.0, 1e9
    area, k_s = size**2, 0.4e9
    blocks = (
        FLOOR
        + block("lower", (0.0, 0.0, 0.2), (size,) * 3)
        + block("upper", (0.0, 0.0, 0.6), (size,) * 3, 'held = ["y"]')
    )
    load = f'[[loads]]\nblock = "lower"\nforce = [0.0, {push}, 0.0]\n'
    found = simulate(staged(control, blocks=blocks, more=load, kn=k_n, friction=0.8), record=False)
    # unknowns (u, theta, phi): displacement of the lower cube, rotations of both about x; four points at the corners
    slips = np.array([[1.0, 0.5 * size, 0.0], [1.0, -0.5 * size, -0.5 * size]])
    tilts = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, -1.0]])
    stiffness = k_s * area * slips.T @ slips + k_n * area * (0.5 * size) ** 2 * tilts.T @ tilts
    motion = np.linalg.solve(stiffness, [push, 0.0, 0.0])
    shear = k_s * area * slips @ motion
    assert shear[0] / push == pytest.approx(19.0 / 30.0)
    assert found.reactions["floor"][1] == pytest.approx(-shear[0], rel=2e-4)
    assert found.reactions["upper"][1] == pytest.approx(-shear[1], rel=2e-4)


@pytest.mark.parametrize("controls", [(turns(1.0), STATICS), (STATICS + "large_displacements = true\n",)])
def test_how_blocks_fall_that_do_not_stand(controls):
    """A slender block pushed at its top overturns, after a settlement and from the drawn geometry."""
    blocks = FLOOR + BLOCK.replace("0.4, 0.2, 0.1", "0.1, 0.2, 0.4").replace("0.05]", "0.2]")
    push = '[[loads]]\nblock = "block"\npoint = [0.0, 0.0, 0.4]\nforce = [40.0, 0.0, 0.0]\n'
    push += "stages = [2]\n" if len(controls) == 2 else ""
    falls = simulate(staged(*controls, blocks=blocks, more=push, friction=2.0), record=False)
    assert falls.status == "falls" and falls.statics["mechanism"] == "rocking"
    assert falls.statics["blocks"] == ["block"]


@pytest.mark.parametrize("last", [STATICS, 'kind = "dynamic"\nduration = 0.02\n'], ids=["statics", "real time"])
def test_loads_of_a_settlement_end_with_it(last):
    """A push of .2 W during the settlement leaves no elastic shear V / (ks A) in the joint once it is removed."""
    load = f'[[loads]]\nblock = "block"\nforce = [0.0, {0.2 * WEIGHT!r}, 0.0]\nstages = [1]\n'
    held = simulate(staged(turns(1e-3), last, more=load, formulation="convex"))
    moved = held.frames["displacement"][-1, 1, 1]
    assert abs(held.reactions["floor"][1]) < (1e-6 if last is STATICS else 1.0) * 0.2 * WEIGHT
    assert moved < 0.6 * 0.2 * WEIGHT / (0.4e9 * 0.08)


def test_what_the_deformed_geometry_has_no_use_for_is_one_sentence():
    with pytest.raises(ScenarioError, match=r"displacement = 0.1: a search in the deformed geometry ends at collapse"):
        staged(turns(10.0), PUSH + "displacement = 0.1\n")
    with pytest.raises(ScenarioError, match="large_displacements = 1 is of the wrong type: it must be true or false"):
        staged(YIELD + "large_displacements = 1\n")
    scenario = staged(turns(10.0), PUSH)
    assert scenario.control.large_displacements and toml.loads(toml.dumps(scenario), "x.toml") == scenario
    with pytest.raises(ScenarioError, match="steps need a run in real time, but control kind 'settlement' is a search"):
        next(steps(staged(turns(10.0)), 0.1))


@pytest.mark.parametrize("last", [PUSH, TRAVEL], ids=["pushover", "displacement"])
def test_a_search_after_a_settlement_goes_on_where_it_was_stopped(last, tmp_path, monkeypatch):
    """Stopped in the last stage, a search between both too: bit for bit the same."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    given = staged(turns(1.0), last, more=JACK if last is TRAVEL else "")
    whole = simulate(given, tmp_path / "whole.h5")
    path = tmp_path / "run.h5"
    for stop in ("stage 1 of 2", "equilibrium 5")[last is TRAVEL :]:
        stop_in_stages(given, path, lambda where, later, stop=stop: later and where.startswith(stop))
        result = restart(path)
        np.testing.assert_array_equal(result.run.path, whole.run.path)
        assert result.yield_point == whole.yield_point and result.reactions == whole.reactions
        with read(path) as one, read(tmp_path / "whole.h5") as other:
            np.testing.assert_array_equal(one.load, other.load)
            assert one.results["yield_point"] == other.results["yield_point"]


def test_a_block_that_may_not_turn_slides_without_a_hinge():
    text = header(friction=0.5, normal_stiffness=1e9) + FLOOR
    text += block("stone", (0.0, 0.0, 0.4), (0.2, 0.2, 0.8), 'held = ["rx", "ry", "rz"]')
    text += '[control]\nkind = "pushover"\ndirection = [1, 0, 0]\nlarge_displacements = true\n'
    found = simulate(toml.loads(text), record=False)
    assert found.collapse["load_factor"] == pytest.approx(0.5, rel=2e-3) and found.collapse["hinges"] == []
    said = key_lines(found)
    assert said["hinges"] == "hinges none" and said["moved"].startswith("moved stone by ")


def test_a_load_that_a_soft_tie_follows_on_and_on_is_undecided(monkeypatch):
    """V = mu W + k u grows on; whether the tie yields later is unknown when the number of equilibria is used up."""
    monkeypatch.setattr(equilibria, "SPARE", 60)
    monkeypatch.setattr("dembrick.simulation.session.TOLD_EVERY", 0.0)
    text = header("convex", 0.5, 1e10) + block("floor", (0.0, 0.0, -0.1), (4.0, 4.0, 0.2), "fixed = true")
    text += block("post", (-1.1, 0.0, 0.3), (0.2, 0.2, 0.6), "fixed = true")
    text += block("stone", (0.0, 0.0, 0.05), (0.4, 0.4, 0.1))
    ends = '[{ block = "stone", point = [-0.2, 0.0, 0.05] }, { block = "post", point = [-1.0, 0.0, 0.05] }]'
    text += f"[[ties]]\nbetween = {ends}\nstiffness = 1e4\n"
    control = 'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\nlarge_displacements = true\n'
    promised = []
    found = "no limit within .* equilibria, because blocks still follow a load of V = .*; stiffen the ties or joints"
    with pytest.raises(UndecidedError, match=found):
        simulate(toml.loads(f"{text}[control]\n{control}"), progress=promised.append)
    path = [progress.total for progress in promised if progress.stage == "equilibrium"]
    assert path and set(path) == {None}  # increments adapt to the blocks, so nobody knows how many there will be


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_of_two_parts_rocks_as_a_whole_one(formulation):
    """The joint of the far part opens completely, but that is not an uplift of the block."""
    parts = (
        "parts = [" + ", ".join(f"{{ box = [0.2, 0.4, 0.4], position = [{x}, 0.0, 0.0] }}" for x in (-0.1, 0.1)) + "]\n"
    )
    text = header(formulation, 0.9, 1e10) + block("floor", (0.0, 0.0, -0.1), (4.0, 4.0, 0.2), "fixed = true")
    text += f'[[blocks]]\nname = "stone"\nmaterial = "stone"\nposition = [0.0, 0.0, 0.2]\n{parts}'
    text += jack("stone", (-0.2, 0.0, 0.4)) + '[control]\nkind = "yield"\nlarge_displacements = true\n'
    assert simulate(toml.loads(text)).yield_point.mechanism == "rocking"


def test_a_block_that_slides_on_and_rests_below_its_limit_is_put_back():
    """Pushed and lifted at a corner, it swings as the load grows, slides by millimetres and stops: 1.5 % too low."""
    turn = rotation_matrix(np.array([math.cos(0.15), 0.0, 0.0, math.sin(0.15)]))
    ends = itertools.product((-0.1323, 0.1323), (-0.1579, 0.1579), (0.0, 0.32845))
    corners, point = np.array(list(ends)), [-0.13224, 0.05971, 0.03686]
    push = turn @ [0.49193, 0.20827, -0.24976]
    scene = header("corrected-shear", 0.807, 5.31e9) + block("floor", (0.0, 0.0, -0.1), (3.0, 3.0, 0.2), "fixed = true")
    scene += f'[[blocks]]\nname = "block"\nmaterial = "stone"\nvertices = {(corners @ turn.T).tolist()}\n'
    scene += jack("block", tuple((turn @ point).tolist()), tuple(push.tolist()))
    start, moved = (
        simulate(toml.loads(scene + f"[control]\nkind = 'yield'\nlarge_displacements = {large}\n"), record=False)
        for large in ("false", "true")
    )
    low, high = moved.yield_point.V_lower, moved.yield_point.V_upper
    assert low < start.yield_point.V * (1.0 + 2e-4) and high > start.yield_point.V * (1.0 - 2e-4)
    assert moved.yield_point.displacement < 1e-4
