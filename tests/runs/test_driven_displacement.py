"""Tests by displacement in the deformed geometry: the driven point is where it should be, however steeply V falls."""

import numpy as np
import pytest

import dembrick
from dembrick.errors import NotConvergedError
from dembrick.scenario import toml
from dembrick.scenario.joint_laws import FORMULATIONS
from helpers.restart_cases import check_same, counted_looks, stop_at_look
from helpers.scenario_text import block, header, jack

pytestmark = pytest.mark.usefixtures("few")

A, N, MU, C, KS, KN = 0.08, 300.0, 0.5, 1e4, 4e9, 1e10  # of a block of .4 by .2 m without weight on a floor
TRAVEL = 2e-5
FLOOR = block("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
STONE = block("stone", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1))
PRESSED = f'[[loads]]\nblock = "stone"\nforce = [0.0, 0.0, {-N}]\npoint = [0.0, 0.0, 0.05]\n'
JACK = jack("stone", (0.0, 0.0, 0.0))
TIE = """[[ties]]
between = [{ block = "floor", point = [-0.5, 0.0, 0.0] }, { block = "stone", point = [-0.2, 0.0, 0.0] }]
stiffness = 1e6
tension_only = false
"""


def driven(formulation, ways, keys="", more=PRESSED, jacks=JACK, stone=STONE):
    law = header(formulation, MU, KN, gravity=(0.0, 0.0, 0.0), keys=keys)
    control = f'[control]\nkind = "displacement"\nlarge_displacements = true\n{ways}\n'
    return dembrick.simulate(toml.loads(law + FLOOR + stone + more + jacks + control))


def curve(found):
    """Driven displacement (m) and V of all equilibria."""
    return found.run.path[:, 0], found.run.path[:, 1]


def there(found, u):
    """V at a driven displacement ``u``, interpolated between equilibria."""
    return np.interp(u, *curve(found))


@pytest.mark.parametrize("formulation, stiffness", [*((one, 0.0) for one in FORMULATIONS), ("concave", 1e6)])
def test_a_brittle_bond_breaks_where_it_is(formulation, stiffness):
    """V is c A + mu N at the elastic slip, then mu N, plus the force of a tie; the block does not run on by itself."""
    tie = TIE if stiffness else ""
    points = "points = [3, 2]\n" if formulation == "distributed" else ""
    found = driven(formulation, f"travel = {TRAVEL}", f"{points}cohesion = {C}", PRESSED + tie)
    strength = C * A + MU * N
    at = strength / (KS * A)
    assert curve(found)[1].max() == pytest.approx(strength + stiffness * at, rel=2e-3)
    assert curve(found)[0][np.argmax(curve(found)[1])] == pytest.approx(at, rel=2e-3)
    assert curve(found)[0].max() == curve(found)[0][-1] == pytest.approx(TRAVEL, rel=1e-9)
    behind = np.array([1.01 * at, 0.5 * TRAVEL, TRAVEL])
    assert there(found, behind) == pytest.approx(MU * N + stiffness * behind, rel=1e-5)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_bond_that_broke_in_a_cycle_stays_broken(formulation):
    """A cycle about the start: a loop of mu N, less the elastic slip at each reversal."""
    found = driven(formulation, f"protocol = [{TRAVEL}, {-TRAVEL}, {TRAVEL}]", f"cohesion = {C}")
    slip = 2.0 * TRAVEL - 2.0 * MU * N / (KS * A)
    (cycle,) = found.cycles
    assert np.abs(cycle["peak"]) == pytest.approx(MU * N, rel=1e-5)
    assert cycle["dissipated"] == pytest.approx(2.0 * MU * N * slip, rel=2e-3)
    assert np.abs(curve(found)[0]).max() == pytest.approx(TRAVEL, rel=1e-9)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_friction_that_falls_at_the_first_slip(formulation):
    found = driven(formulation, f"travel = {TRAVEL}", "residual_friction = 0.3")
    assert curve(found)[1].max() == pytest.approx(MU * N, rel=2e-3)
    assert curve(found)[1][-1] == pytest.approx(0.3 * N, rel=1e-5)
    assert there(found, 1.01 * MU * N / (KS * A)) == pytest.approx(0.3 * N, rel=1e-5)


@pytest.mark.parametrize("held", ['["y", "z", "rx", "ry", "rz"]', '["rz"]', '["ry", "rz"]'])
def test_a_guided_block_goes_where_its_jack_takes_it(held):
    """The jack acts beside the centroid, so guides against rotation carry a moment."""
    stone = block("stone", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1), f"held = {held}")
    found = driven("concave", f"travel = {TRAVEL}", jacks=jack("stone", (-0.2, 0.05, 0.05)), stone=stone)
    if "z" in held.split('"'):
        assert curve(found)[1][-1] == pytest.approx(0.0, abs=1e-6 * N)  # its load is carried by the guide
    else:
        assert curve(found)[1][-1] == pytest.approx(MU * N, rel=1e-5)
    assert curve(found)[0][-1] == pytest.approx(TRAVEL, rel=1e-9)


def test_jacks_of_two_blocks_share_their_displacement():
    """Weights 3 and -1: the block that needs the lower V moves, and u is (3 u_1 - u_2) / 4."""
    second = block("second", (0.0, 0.6, 0.05), (0.4, 0.2, 0.1))
    floor_2 = block("floor 2", (0.0, 1.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    loads = PRESSED + PRESSED.replace('"stone"', '"second"').replace("0.0, 0.0, 0.05]", "0.0, 0.6, 0.05]")
    jacks = jack("stone", (0.0, 0.0, 0.0), more="weight = 3.0")
    jacks += jack("second", (0.0, 0.6, 0.0), more="weight = -1.0").replace('"jack"', '"other"')
    found = driven("concave", f"travel = {TRAVEL}", more=floor_2 + second + loads, jacks=jacks)
    V = MU * N / 3.0
    assert curve(found)[1][-1] == pytest.approx(V, rel=1e-5)
    u_2 = -V / (KS * A)
    moved = found.run.motion.displacement[:, 0][[1, 3]]
    assert moved == pytest.approx([(4.0 * TRAVEL + u_2) / 3.0, u_2], rel=1e-4)


def test_a_driven_pressure_pushes_as_a_jack_does():
    text = '[[pressures]]\nblock = "stone"\ndirection = [-1.0, 0.0, 0.0]\nvalue = 1.0\nactuator = true\n'
    by_pressure = driven("concave", f"travel = {TRAVEL}", f"cohesion = {C}", PRESSED + text, jacks="")
    by_jack = driven("concave", f"travel = {TRAVEL}", f"cohesion = {C}", jacks=jack("stone", (-0.2, 0.0, 0.05)))
    face = 0.2 * 0.1
    u = np.linspace(0.0, TRAVEL, 50)
    peak = curve(by_jack)[1].max()
    assert MU * N < 0.5 * peak < C * A + MU * N  # it is pushed above its joint, part of which breaks first
    assert face * there(by_pressure, u) == pytest.approx(there(by_jack, u), abs=2e-3 * peak)
    assert curve(by_pressure)[1][-1] == pytest.approx(MU * N / face, rel=1e-5)
    assert curve(by_pressure)[0][-1] == pytest.approx(TRAVEL, rel=1e-9)


def test_a_point_that_is_held_cannot_be_driven():
    stone = block("stone", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1), 'held = ["x", "rx", "ry", "rz"]')
    with pytest.raises(NotConvergedError, match="guides or supports hold the points"):
        driven("concave", f"travel = {TRAVEL}", stone=stone)


@pytest.mark.parametrize("parts", [1, 2])
def test_a_column_that_rocks_has_its_greatest_load_at_once(parts):
    """W b / (2 h) at the start; then V = W (b cos t - h sin t) / (2 h cos t + 2 b sin t), rotated by t about an edge.
    The joint between two blocks uses half of its friction and must not slip through inertia."""
    b, h, W = 0.2, 1.0, 0.2 * 0.3 * 1.0 * 2000.0 * 9.81
    law, column = header("concave", 0.5, 1e11), ""
    for k in range(parts):
        column += block(f"part {k}", (0.0, 0.0, (k + 0.5) * h / parts), (b, 0.3, h / parts))
    push = jack(f"part {parts - 1}", (-0.1, 0.0, h * (1.0 - 0.25 * (parts - 1))))
    arm = h * (1.0 - 0.25 * (parts - 1))
    control = '[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = 0.05\n'
    found = dembrick.simulate(toml.loads(law + FLOOR + column + push + control))
    assert curve(found)[1].max() == pytest.approx(0.5 * W * b / arm, rel=2e-3)
    t = np.linspace(0.0, 0.08, 2000)
    u = arm * np.sin(t) - b * (np.cos(t) - 1.0)
    V = 0.5 * W * (b * np.cos(t) - h * np.sin(t)) / (arm * np.cos(t) + b * np.sin(t))
    shown = np.linspace(0.005, 0.05, 10)
    assert there(found, shown) == pytest.approx(np.interp(shown, u, V), rel=1e-3)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_what_lies_on_a_block_goes_along(formulation):
    """The rider exerts only its inertia force, which vanishes in a slow test: V is mu times the whole weight."""
    rider = block("rider", (0.0, 0.0, 0.125), (0.2, 0.2, 0.05))
    control = '[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = 0.03\n'
    push = jack("stone", (0.0, 0.0, 0.0))
    found = dembrick.simulate(toml.loads(header(formulation, MU, 1e10) + FLOOR + STONE + rider + push + control))
    weight = (0.4 * 0.2 * 0.1 + 0.2 * 0.2 * 0.05) * 2000.0 * 9.81
    assert curve(found)[1][-1] == pytest.approx(MU * weight, rel=1e-6)
    assert found.run.motion.displacement[1:, 0] == pytest.approx([0.03, 0.03], rel=1e-5)


@pytest.mark.parametrize("height", [0.5, 0.7])
def test_a_stiff_block_comes_to_rest_wherever_it_is_pushed(height):
    """Local damping makes forces of dashpots up to 1.8 times as large: at .7 of the time step a block whose point was
    fixed oscillated without end."""
    b, h, W = 0.6, 1.2, 0.6 * 0.3 * 1.2 * 2000.0 * 9.81
    text = header("concave", 5.0, 1e10) + FLOOR + block("column", (0.0, 0.0, 0.5 * h), (b, 0.3, h))
    text += jack("column", (-0.5 * b, 0.0, height * h))
    control = '[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = 1e-3\n'
    found = dembrick.simulate(toml.loads(text + control))
    assert curve(found)[1].max() == pytest.approx(0.5 * W * b / (height * h), rel=2e-3)


@pytest.mark.parametrize("look", [2])
def test_a_run_that_is_stopped_before_its_first_equilibrium_goes_on(tmp_path, look):
    control = f'[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = {TRAVEL}\n'
    text = header("concave", MU, KN, keys=f"cohesion = {C}") + FLOOR + STONE + JACK + control
    given = toml.loads(text)
    dembrick.simulate(given, tmp_path / "whole.h5")
    stop_at_look(given, tmp_path / "stopped.h5", look)
    dembrick.restart(tmp_path / "stopped.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "stopped.h5")


def test_a_short_way_far_from_the_middle_of_the_scene():
    """Positions there are rounded to 1e-11 of the travel."""
    away = 100.0
    post = block("post", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1), "fixed = true")
    floor = block("floor", (away, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    stone = block("stone", (away, 0.0, 0.05), (0.4, 0.2, 0.1)) + jack("stone", (away, 0.0, 0.0))
    control = '[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = 1e-3\n'
    found = dembrick.simulate(toml.loads(header("concave", MU, KN) + post + floor + stone + control))
    weight = 0.4 * 0.2 * 0.1 * 2000.0 * 9.81
    assert curve(found)[1][-1] == pytest.approx(MU * weight, rel=1e-6)
    assert len(found.run.path) < 120


@pytest.mark.parametrize("fixed", [False, True])
def test_blocks_that_meet_are_followed_in_shorter_steps(fixed):
    """A block driven into another bears on more springs than the joints that the time step was chosen for: V is the
    friction of one block, then of both, or it grows with the overlap at a fixed face."""
    gap, kn, mu, density = 1e-4, 1e10, 0.6, 2000.0
    size, face = (0.2, 0.2, 0.1), 0.2 * 0.1
    law = header("concave", mu, kn, density=density)
    curb = block("curb", (size[0] + gap, 0.0, 0.05), size, "fixed = true" if fixed else "")
    jacks = jack("stone", (-0.1, 0.0, 0.05))
    control = f'[control]\nkind = "displacement"\nlarge_displacements = true\ntravel = {2.0 * gap}\n'
    found = dembrick.simulate(toml.loads(law + FLOOR + block("stone", (0.0, 0.0, 0.05), size) + curb + jacks + control))
    one = mu * density * float(np.prod(size)) * 9.81
    assert there(found, 0.5 * gap) == pytest.approx(one, rel=1e-5)
    if not fixed:
        assert curve(found)[1][-1] == pytest.approx(2.0 * one, rel=1e-5)
    else:
        assert curve(found)[1][-1] > 100.0 * one
        assert curve(found)[1][-1] == pytest.approx(one + kn * face * gap, rel=2e-3)
    assert found.run.motion.time_step < 0.9 * found.run.motion.critical_time_step


def test_the_largest_load_of_a_test_to_and_fro_may_be_a_negative_one():
    """The last force is more than mu N, at which the block slides."""
    mu = 0.3
    text = header("concave", mu, 1e9) + FLOOR + block("stone", (0.0, 0.0, 0.05)) + jack("stone", (-0.15, 0.0, 0.02))
    control = '[control]\nkind = "displacement"\nlarge_displacements = true\nforce_protocol = [-30.0, 10.0, -40.0]\n'
    found = dembrick.simulate(toml.loads(text + control))
    point, one = found.yield_point, mu * 2000.0 * 0.3 * 0.2 * 0.1 * 9.81
    assert point.V_peak == pytest.approx(-one, rel=2e-4) and found.uncertain == -point.V_peak
    assert point.displacement_at_peak == found.rows["displacement"][-1] < 0.0


def test_a_loop_that_loses_nothing_loses_nothing_whatever_comes_after():
    """Forces below mu N, then one that drives the block into another; the first loop once dissipated -5e-7 J."""
    text = header("concave", 0.3, 1e9) + FLOOR + block("stone", (0.0, 0.0, 0.05)) + block("curb", (0.302, 0.0, 0.05))
    text += jack("stone", (-0.15, 0.0, 0.02))
    control = '[control]\nkind = "displacement"\nlarge_displacements = true\nforce_protocol = [30.0, -20.0, 50.0]\n'
    (cycle,) = dembrick.simulate(toml.loads(text + control)).cycles
    assert cycle["dissipated"] == 0.0 and cycle["damping"] == 0.0


COUPLE = jack("stone", (0.2, 0.0, 0.0), (0.0, 1.0, 0.0))
COUPLE += jack("stone", (-0.2, 0.0, 0.0), (0.0, 1.0, 0.0)).replace("jack", "other") + "weight = -1.0\n"


@pytest.mark.parametrize("back", [0.0, 0.99])
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_the_mechanism_is_that_of_the_last_segment_in_which_joints_give_way(formulation, back):
    """A couple turns the block: torsion, though the test ends at its start, or begins to unload at its last turning
    point while all is elastic. The motion since the start would be a rest of creep in any direction."""
    protocol = f"protocol = [{-TRAVEL}, {TRAVEL}, {back * TRAVEL}]"
    found = driven(formulation, protocol, jacks=COUPLE)
    assert found.yield_point.mechanism == "torsion"


def test_blocks_that_slide_away_from_each_other_are_not_lifted():
    """The joint between them opens by more than either slides, but both stay on the floor."""
    beside = block("beside", (-0.4, 0.0, 0.05), (0.4, 0.2, 0.1))
    beside += PRESSED.replace("stone", "beside").replace("[0.0, 0.0, 0.05]", "[-0.4, 0.0, 0.05]")
    jacks = JACK + jack("beside", (-0.4, 0.0, 0.0), (-1.0, 0.0, 0.0)).replace('"jack"', '"other jack"')
    found = driven("concave", f"travel = {TRAVEL}", more=PRESSED + beside, jacks=jacks)
    assert found.yield_point.mechanism == "sliding"


def test_a_restart_after_the_last_turning_point_names_the_same_mechanism(tmp_path):
    text = header("concave", MU, KN, gravity=(0.0, 0.0, 0.0)) + FLOOR + STONE + PRESSED + COUPLE
    text += f'[control]\nkind = "displacement"\nlarge_displacements = true\nprotocol = [{TRAVEL}, {-TRAVEL}, 0.0]\n'
    scenario = toml.loads(text)
    with counted_looks() as looks:
        dembrick.simulate(scenario, tmp_path / "whole.h5")
    stop_at_look(scenario, tmp_path / "stopped.h5", 9 * len(looks) // 10)
    dembrick.restart(tmp_path / "stopped.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "stopped.h5")
