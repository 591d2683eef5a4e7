"""Quasi-static tilt and pushover against rigid-block limit analysis: walls, arches, blocks with loads."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.optimize import linprog

from dembrick import history
from dembrick.assembly import build
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import shipped
from dembrick.scenario.controls import PushoverControl
from dembrick.scenario.generators import Arch, Dome, Wall
from dembrick.scenario.model import Actuator, Block, Load, Scenario
from dembrick.scenario.toml import load
from dembrick.simulation.statics import limit_load
from dembrick.simulation.statics.elastic_factor import elastic_factor
from dembrick.simulation.statics.load_system import Setup
from dembrick.simulation.statics.paths.path_following import PathFollower
from dembrick.simulation.statics.rest.dead_load import dead_load_equilibrium
from dembrick.simulation.statics.sparse_equations import inner
from dembrick.simulation.statics.state import initial_state
from dembrick.simulation.statics.stiffness import block_stiffness
from dembrick.views.export.text import to_csv
from helpers.quasi_static import leaf, scene, tilt


def arch(thickness, voussoirs, angle=180.0, curved=False):
    return Arch("arch", "stone", 1.0, thickness, 0.1, voussoirs, angle, curved)


def on_table(mu, control, loads=(), actuators=()) -> Scenario:
    """A block 0.3 x 0.2 x 0.4 on a fixed one."""
    return scene(
        control,
        friction=mu,
        blocks=(
            Block("table", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("block", "stone", (0.3, 0.2, 0.4), (0.0, 0.0, 0.2)),
        ),
        loads=loads,
        actuators=actuators,
    )


# --- one block


@pytest.mark.parametrize("axis, sign", [((1.0, 0.0, 0.0), 1.0), ((0.0, 1.0, 0.0), 1.0), ((-1.0, 2.0, 0.0), -1.0)])
def test_a_block_slides_at_the_friction_angle(axis, sign):
    fallen = simulate(on_table(0.3, tilt(axis))).collapse
    assert fallen["angle"] == pytest.approx(math.degrees(math.atan(0.3)), rel=1e-3)
    assert fallen["load_factor"] == pytest.approx(0.3, rel=1e-3)
    assert fallen["mechanism"] == "sliding" and fallen["blocks"] == ["block"]


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_joint_that_tilts_before_it_slides_is_said_to_slide(formulation):
    """A convex joint may reach its limit surface in an elastic step, in which it tilts more than it slips."""
    given = on_table(0.6, PushoverControl((1.0, 0.0, 0.0)))
    fallen = simulate(replace(given, joint=replace(given.joint, formulation=formulation))).collapse
    assert fallen["load_factor"] == pytest.approx(0.6, rel=1e-3) and fallen["mechanism"] == "sliding"


def test_loads_turn_with_gravity():
    """A weight P on top of the block: (W h/2 + P h) tan(psi) = (W + P) b/2."""
    weight, load = 2000.0 * 0.3 * 0.2 * 0.4 * 9.81, 300.0
    scenario = on_table(2.0, tilt(), loads=(Load("block", (0.0, 0.0, -load), (0.0, 0.0, 0.4)),))
    expected = (weight + load) * 0.1 / (weight * 0.2 + load * 0.4)
    fallen = simulate(scenario).collapse
    assert fallen["load_factor"] == pytest.approx(expected, rel=1e-3) and fallen["mechanism"] == "rocking"


def test_a_table_tilts_the_side_of_its_axis():
    """By a rotation about +x the side towards +y rises, and the block moves towards -y."""
    moved = simulate(on_table(0.3, tilt())).run.state.blocks.velocity[1]
    assert moved[1] < 0.0 and abs(moved[0]) < 1e-6 * abs(moved[1])


# --- walls


@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
def test_a_wall_turns_about_its_toe(formulation):
    result = simulate(leaf(formulation))
    fallen = result.collapse
    assert fallen["angle"] == pytest.approx(11.30993, rel=1e-4)
    assert fallen["mechanism"] == "rocking" and len(fallen["blocks"]) == 105
    assert result.status == "collapse" and result.as_dict()["collapse"]["time"] == pytest.approx(fallen["angle"])


@pytest.mark.parametrize(
    "formulation, courses, blocks, close, most",
    [("concave", 24, 12, 1e-5, 40), ("concave", 60, 6, 1e-4, 16), ("corrected-shear", 60, 6, 1e-4, 16)],
)
def test_large_and_high_walls_take_few_newton_steps(formulation, courses, blocks, close, most):
    """Trial steps without progress are given up at once: nearly all steps are elastic or follow a mechanism. A step
    beyond the limit opens the joints of many courses; bisection finds the one mechanism among them."""
    wall = Wall("wall", "stone", (0.3, 0.2, 0.1), courses=courses, blocks=blocks, base=0.1)
    result = simulate(scene(tilt(), friction=0.64, walls=(wall,), formulation=formulation), record=False)
    assert result.collapse["load_factor"] == pytest.approx(0.2 / (0.1 * courses), rel=close)
    assert result.run.steps <= most


def test_a_newton_step_is_cut_where_the_forces_do_no_more_work_on_it():
    """A dome displaced elastically to loads beyond its limit, 0.37: a whole Newton step from there goes too far."""
    dome = Dome("dome", "stone", radius=2.0, thickness=0.2, rings=4, blocks=8, key=8.0)
    setup = Setup(build.assemble(scene(tilt((0.0, 1.0, 0.0)), domes=(dome,))), 1e-3)
    follower = PathFollower(setup.state, setup.load, setup.factor, setup.certificate)
    follower.prepare()
    search = follower.search
    start = search.motion()
    for V in (0.5, 2.0, 10.0):
        motion = start + V * follower.elastic
        search.attempt(motion, V)
        step = search._newton_step(V)
        work = inner(search.trial.residual, step[0])
        search.attempt(motion + step[0], V + step[1])
        assert inner(search.trial.residual, step[0]) < -0.8 * work < 0.0
        part = search._line_search(motion, V, step, work)
        search.attempt(motion + part * step[0], V + part * step[1])
        assert 0.0 < part < 1.0 and abs(inner(search.trial.residual, step[0])) <= 0.5 * work


def test_a_mechanism_is_followed_without_newton_steps():
    """Once V is constant the next equilibrium lies on the tangent: ever longer steps need no iteration."""
    wall = Wall("wall", "stone", (0.3, 0.2, 0.1), courses=12, blocks=12, base=0.1)
    assembly = build.assemble(scene(tilt(), friction=0.64, walls=(wall,)))
    begun, gone = (limit_load.find_limit_load(assembly, 1e-4, goal=goal) for goal in (None, 1e-2))
    assert gone.settings["equilibria"] >= begun.settings["equilibria"] + 8
    assert gone.steps <= begun.steps + 4
    assert gone.yield_point.V == pytest.approx(0.2 / 1.2, rel=1e-5)


def test_corrected_joints_let_the_wall_fall_early():
    """Their points also carry the weight, and lie at s = 0.537 of the half thickness from the middle."""
    assert simulate(leaf("corrected")).collapse["angle"] == pytest.approx(6.1302, rel=1e-3)


HALF, WHOLE = "h1111h", "11111"
E, U, V, W = "1111", "h111h", "h1 o 1h", "1h o h1"
WALLS = {
    "W1": ((HALF, WHOLE), 6, 0.64286),
    "W2": ((HALF, WHOLE), 10, 0.58000),
    "W3": ((E, U, E, V, W, V, W, V, E, U, E), 11, 0.40369),
}


@pytest.mark.parametrize("name, blocks, joints", [("W1", 33, 83), ("W2", 55, 141), ("W3", 46, 102)])
def test_walls_in_plane(name, blocks, joints):
    """Friction without dilatancy: at or below the associative limit of Ferris and Tin-Loi, in which sliding joints lift
    the blocks above. W3 fails in stages: blocks beside its openings slip suddenly and come to rest again."""
    pattern, courses, associative = WALLS[name]
    wall = Wall("wall", "stone", (0.4, 0.2, 0.175), courses=courses, pattern=pattern, base=0.2)
    built = build.assemble(scene(PushoverControl((1.0, 0.0, 0.0)), friction=0.65, walls=(wall,)))
    assert (len(built.names) - 1, len(built.joints)) == (blocks, joints)
    point = limit_load.find_limit_load(built, 1e-3).yield_point
    assert 0.85 * associative < point.V <= associative


# --- arches


@pytest.mark.parametrize(
    "thickness, voussoirs, expected",
    [(0.15, 7, 0.17072), (0.15, 17, 0.14715), (0.15, 27, 0.14534), (0.20, 17, 0.28657), (0.12, 17, 0.05312)],
)
def test_arch_under_horizontal_load(thickness, voussoirs, expected):
    result = simulate(scene(PushoverControl((1.0, 0.0, 0.0)), arches=(arch(thickness, voussoirs),)))
    assert result.collapse["load_factor"] == pytest.approx(expected, rel=5e-4)
    assert result.collapse["angle"] is None and result.collapse["mechanism"] == "rocking"


def rigid_multiplier(thickness, voussoirs, friction):
    """Horizontal multiplier of a semicircular arch of straight voussoirs by linear programming (static theorem)."""
    angle = np.pi - np.arange(voussoirs + 1) * np.pi / voussoirs
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = np.stack([out[:, 1], -out[:, 0]], axis=1)
    radii = (1.0 - thickness / 2, 1.0 + thickness / 2)
    variables = 3 * (voussoirs + 1) + 1  # N at intrados and extrados, T of each joint; the multiplier
    equations, dead = np.zeros((3 * voussoirs, variables)), np.zeros(3 * voussoirs)
    for i in range(voussoirs):
        x, y = np.array([radii[0] * out[i], radii[1] * out[i], radii[1] * out[i + 1], radii[0] * out[i + 1]]).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        centre = [float(((c + np.roll(c, -1)) * cross).sum() / (3.0 * cross.sum())) for c in (x, y)]
        for j, sign in ((i, 1.0), (i + 1, -1.0)):
            for k, (r, direction) in enumerate(((radii[0], along[j]), (radii[1], along[j]), (1.0, out[j]))):
                arm, force = r * out[j] - centre, sign * direction
                equations[3 * i : 3 * i + 3, 3 * j + k] += [*force, arm[0] * force[1] - arm[1] * force[0]]
        equations[3 * i, -1] = dead[3 * i + 1] = 1.0
    cones = np.zeros((2 * (voussoirs + 1), variables))
    for j in range(voussoirs + 1):
        cones[2 * j : 2 * j + 2, 3 * j : 3 * j + 3] = [[-friction, -friction, 1.0], [-friction, -friction, -1.0]]
    bounds = [(0, None), (0, None), (None, None)] * (voussoirs + 1) + [(None, None)]
    worth = np.zeros(variables)
    worth[-1] = -1.0
    found = linprog(worth, cones, np.zeros(len(cones)), equations, dead, bounds, method="highs")
    return float(found.x[-1]) if found.status == 0 else None


def test_the_programme_is_right():
    assert rigid_multiplier(0.15, 17, 0.7) == pytest.approx(0.14715, abs=5e-6)
    assert rigid_multiplier(0.107, 31, 0.7) is None


@pytest.mark.parametrize("share", [0.01, 0.02])
def test_a_plateau_while_gaps_close_is_no_limit(share):
    """This arch has opened at its left springing; at two thirds of its limit the load closes it again at constant V."""
    thickness = 0.107442 * (1.0 + share)
    scenario = scene(PushoverControl((1.0, 0.0, 0.0)), arches=(arch(thickness, 50),))
    expected = rigid_multiplier(thickness, 50, 0.7)
    assert simulate(scenario).collapse["load_factor"] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("seed", range(24))
def test_any_arch_agrees_with_linear_programming(seed):
    rng = np.random.default_rng(seed)
    voussoirs, share = int(rng.integers(7, 51)), 10 ** rng.uniform(-2.0, -0.3)
    scenario = scene(PushoverControl((1.0, 0.0, 0.0)), arches=(arch(0.1075 * (1.0 + share), voussoirs),))
    expected = rigid_multiplier(0.1075 * (1.0 + share), voussoirs, 0.7)
    point = limit_load.find_limit_load(build.assemble(scenario), 1e-3).yield_point
    assert point.V == pytest.approx(expected, rel=1e-3)
    assert point.half_width <= 1e-3 * point.V


def stands(**parts):
    built = build.assemble(scene(PushoverControl((1.0, 0.0, 0.0)), **parts))
    state = initial_state(built)
    try:
        dead_load_equilibrium(state, block_stiffness(state, shared=2.0), built, elastic_factor(state, built.position))
    except NotConvergedError:
        return False
    return True


LEAST = [(7, 0.095703), (9, 0.101525), (11, 0.104589), (15, 0.106068), (21, 0.106695), (31, 0.107130), (50, 0.107442)]


@pytest.mark.parametrize("voussoirs, least", LEAST)
def test_least_thickness_of_a_semicircle(voussoirs, least):
    """An arch 0.2 % thinner than the least thickness does not stand, one 0.2 % thicker does."""
    assert not stands(arches=(arch(0.998 * least, voussoirs),)) and stands(arches=(arch(1.002 * least, voussoirs),))


def test_little_friction_lets_the_arch_slide():
    result = simulate(scene(PushoverControl((1.0, 0.0, 0.0)), friction=0.4, arches=(arch(0.15, 17),)))
    assert result.collapse["load_factor"] == pytest.approx(0.0525, rel=0.1)


@pytest.mark.parametrize("curved, factor", [(True, 0.3700), (False, 0.37361)])
@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
def test_the_tilted_arch_of_oppenheim(curved, factor, formulation):
    parts = (arch(0.15, 7, 157.5, curved),)
    fallen = simulate(scene(tilt((0.0, 1.0, 0.0)), formulation, arches=parts)).collapse
    assert fallen["load_factor"] == pytest.approx(factor, rel=5e-4)
    if curved:
        assert fallen["angle"] == pytest.approx(20.30, rel=1e-3)


SCENARIOS = {  # load factor by rigid-block limit analysis
    "arch_tilt": 0.14715,
    "wall_tilt": 0.2,
}


@pytest.mark.parametrize("stem", SCENARIOS)
def test_scenarios_run_to_their_numbers(stem):
    fallen = simulate(load(shipped.folder() / f"{stem}.toml", ["control.quasi_static=true"])).collapse
    assert fallen["load_factor"] == pytest.approx(SCENARIOS[stem], rel=1e-3)


@pytest.mark.slow
def test_least_thickness_of_a_hemisphere():
    """0.0428 of the radius, without tension across any meridian."""
    for share, expected in ((0.97, False), (1.01, True)):
        dome = Dome("dome", "stone", 1.0, share * 0.0428, 12, 12, oculus=2.0)
        assert stands(domes=(dome,)) == expected


def test_refining_gives_an_error_bar():
    scenario = scene(PushoverControl((1.0, 0.0, 0.0)), arches=(arch(0.15, 17),))
    fallen = simulate(scenario, refine=True).collapse
    assert 0.0 <= fallen["error_estimate"] < 1e-3 * fallen["load_factor"]
    assert abs(fallen["load_factor"] - 0.14715) < 2e-5


def test_a_path_goes_on_to_the_displacement_asked_for():
    scenario = scene(PushoverControl((1.0, 0.0, 0.0), displacement=0.05), arches=(arch(0.15, 17),))
    result = simulate(scenario)
    way = np.linalg.norm(result.frames["displacement"][-1] - result.frames["displacement"][0], axis=1)
    assert result.collapse["displacement"] < 0.05 <= way.max()  # the reported one is at the limit, long before that


# --- refusals


def test_what_does_not_go_together():
    with pytest.raises(ScenarioError, match=r"has no use for \[\[actuators\]\]"):
        jack = Actuator("jack", "block", (0.0, 0.0, 0.2), (1.0, 0.0, 0.0))
        simulate(on_table(0.3, tilt(), actuators=(jack,)))
    with pytest.raises(ScenarioError, match="a component along control.axis"):
        simulate(on_table(0.3, tilt((0.0, 0.6, 0.8))))
    with pytest.raises(ScenarioError, match="a component along control.axis"):
        simulate(on_table(0.3, tilt(), loads=(Load("block", (10.0, 0.0, -10.0)),)))
    with pytest.raises(ScenarioError, match="rate = 0.1 is out of range"):
        PushoverControl((1.0, 0.0, 0.0), rate=0.1)
    with pytest.raises(ScenarioError, match="length must be greater than 0"):
        PushoverControl((0.0, 0.0, 0.0))


def test_an_arch_too_thin_stands_no_load():
    with pytest.raises(NotConvergedError, match="under the dead loads, before the test begins"):
        simulate(scene(PushoverControl((1.0, 0.0, 0.0)), arches=(arch(0.10, 17),)))


def test_the_load_of_a_tilt_is_a_number_and_that_of_jacks_a_force(tmp_path):
    """In the history and in the text exported from it."""
    path, text = tmp_path / "tilt.h5", tmp_path / "tilt.csv"
    simulate(on_table(0.3, tilt()), path)
    with h5py.File(path) as file:
        assert {file[f"history/{name}"].attrs["units"] for name in ("load", "lower", "upper")} == {"1"}
        assert (file.attrs["control"], file.attrs["load_unit"]) == ("tilt", "1")
        assert file.attrs["load_name"] == "load factor tan(angle)"
    with history.read(path) as found:
        to_csv(found, text)
    assert text.read_text().splitlines()[0].startswith("equilibrium [1],load [1],")


@pytest.mark.parametrize("blocks", [10, 20])
def test_the_plan_tells_the_memory_of_a_search(blocks):
    wall = Wall("wall", "stone", (0.3, 0.2, 0.1), blocks, blocks, base=0.1)
    given = scene(PushoverControl((0.0, 1.0, 0.0)), walls=(wall,))
    built = build.assemble(given)
    limit_load.find_limit_load(built, 0.1)  # compiles, or loads the cache
    tracemalloc.start()
    limit_load.find_limit_load(built, 1e-3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert limit_load.plan(built, given.control, given.output).memory == pytest.approx(peak, rel=0.15)


@pytest.mark.parametrize("short", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_a_load_that_is_next_to_nothing(short, tolerance):
    """Four blocks at 1 - x of the harmonic overhang l/(2k) overturn under a push of 1.25 x of their weight."""
    place, blocks = 0.0, [Block("base", "stone", (1.0, 0.5, 0.2), (0.0, 0.0, -0.1), fixed=True)]
    for level, k in enumerate((4, 3, 2, 1)):
        place += (1.0 - short) * 0.5 / k
        blocks.append(Block(f"b.{k}", "stone", (1.0, 0.5, 0.2), (place, 0.0, 0.1 + 0.2 * level)))
    # the four blocks are 0.8 m high and their centroid is x of l/2 inside the edge: x 0.5 / 0.4 of their weight
    point = simulate(
        scene(PushoverControl((1.0, 0.0, 0.0), tolerance=tolerance), blocks=tuple(blocks)), record=False
    ).yield_point
    exact = short * 0.5 / 0.4
    assert point.V_lower * (1.0 - 1e-6) <= exact <= point.V_upper * (1.0 + 1e-6)
    assert point.V == pytest.approx(exact, rel=tolerance)
