"""Tilting tables, pushed walls and scenarios in real time in complete runs, and the input that they refuse."""

import json
import math

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.cli import main
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.kernels.dynamics.loop import Limits
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Pulse, PushoverControl, Sine, TiltControl
from dembrick.scenario.model import Block, Load, Scenario, Wall
from dembrick.simulation.dynamics.dead_load import find_equilibrium
from dembrick.simulation.dynamics.integrator import advance, motion
from dembrick.simulation.dynamics.loads import Driving
from helpers.motions import toppling_tilt
from helpers.places import SCENARIOS
from helpers.resting_blocks import block_on_floor
from helpers.stone_scenes import law, of_stone


def wall(control, courses=4, blocks=2, formulation="concave", friction=0.64, stiffness=1e10, **more):
    """A straight wall of 0.3 x 0.2 x 0.1 m blocks in running bond, on a slab."""
    return of_stone(
        law(formulation, friction, stiffness),
        control,
        walls=(Wall("wall", "stone", (0.3, 0.2, 0.1), courses=courses, blocks=blocks, base=0.1),),
        **more,
    )


def tilt(displacement=0.02, rate=5.0, axis=(1.0, 0.0, 0.0), **more):
    return TiltControl(axis, rate, displacement, **more)


def rigid():
    """Angle (deg) at which the top of a rigid wall of four courses on its toe has moved by 20 mm, tilted at 5 deg/s."""
    height = 0.4
    lever = math.hypot(0.1, height - 0.05)
    return math.degrees(toppling_tilt(0.2, height, math.radians(5.0), lever, 0.02))


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
def test_wall_tilted_out_of_plane(formulation, axis):
    """The wall rotates about its toe as the rigid wall does."""
    result = simulate(wall(tilt(axis=axis), formulation=formulation))
    assert result.status == "collapse"
    fallen = result.collapse
    assert fallen["angle"] == pytest.approx(rigid(), rel=1e-3)
    assert fallen["load_factor"] == pytest.approx(math.tan(math.radians(fallen["angle"])))
    assert fallen["displacement"] == pytest.approx(0.02, rel=1e-2)
    assert fallen["mechanism"] == "rocking"
    assert {f"wall.4.{i}" for i in (1, 2)} <= set(fallen["blocks"])
    # by a right-hand rotation about +x the far side, +y, rises, and the wall falls to -y
    top = result.assembly.names.index("wall.4.1")
    assert math.copysign(1.0, result.displacement[top, 1]) == -axis[0]


def test_convex_joints_fall_early_by_the_pressed_strip():
    """The toe lies within the edge by a third of the strip in contact, w = sqrt(2 N / (kn L theta)).

    At a given rotation the loss vanishes as 1/sqrt(kn). The greatest moment, where w/3 and the shift h theta of the
    weight together cost least (w = 6 h theta), falls short by 3 h theta ~ kn^-1/3; a fall at a given time lies in
    between.
    """
    missing = []
    for stiffness in (1e10, 1.6e11):
        result = simulate(wall(tilt(), formulation="convex", stiffness=stiffness))
        missing.append(1.0 - result.collapse["angle"] / rigid())
    assert 0.0 < missing[1] < 0.03
    assert 16 ** (1 / 3) < missing[0] / missing[1] < 16 ** (1 / 2)


def test_corrected_joints_topple_on_their_shrunk_polygons():
    """s = 0.54 of the lever remains: the wall falls at about half of the rigid wall's angle."""
    result = simulate(wall(tilt(), formulation="corrected"))
    assert math.tan(math.radians(result.collapse["angle"])) / math.tan(math.radians(rigid())) == pytest.approx(
        0.56, abs=0.03
    )


def test_sliding_comes_first_on_a_slippery_joint():
    result = simulate(wall(tilt(displacement=0.002, rate=2.0), courses=2, friction=0.3))
    assert result.collapse["mechanism"] == "sliding"
    # from atan(mu) on it accelerates by g cos(psi) rate t, and slides by a cubic in t
    late = math.degrees((6.0 * 0.002 * math.radians(2.0) ** 2 / (9.81 * 1.045)) ** (1 / 3))
    assert result.collapse["angle"] == pytest.approx(math.degrees(math.atan(0.3)) + late, rel=3e-3)


def test_tilt_by_the_command_line(capsys, tmp_path):
    code = main(["run", str(SCENARIOS / "wall_tilt.toml"), "--out", str(tmp_path / "wall.h5"), "--json",
                 "--set", "walls.0.courses=2", "--set", "walls.0.blocks=1", "--set", "control.rate=10.0"])  # fmt: skip
    answer = json.loads(capsys.readouterr().out)
    assert code == 0 and answer["status"] == "collapse"
    assert set(answer["collapse"]) >= {"angle", "load_factor", "time", "displacement", "mechanism", "blocks"}
    assert answer["collapse"]["error_estimate"] is None
    assert (tmp_path / "wall.h5").exists()


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
def test_ten_by_ten(formulation):
    """The top has moved 20 mm at 12.015 deg, within 0.1 %."""
    scenario = scenarios.load(SCENARIOS / "wall_tilt.toml", [f"joint.formulation={formulation}"])
    assert simulate(scenario, record=False).collapse["angle"] == pytest.approx(12.015, rel=1e-3)


@pytest.mark.slow
def test_thirty_by_thirty():
    """The top has moved 20 mm at 4.560 deg, within 0.5 %; with thirty compliant joints they must be twice as stiff."""
    changes = ["walls.0.courses=30", "walls.0.blocks=30", "joint.normal_stiffness=2.2e10", "joint.shear_stiffness=8e9"]
    scenario = scenarios.load(SCENARIOS / "wall_tilt.toml", changes)
    assert simulate(scenario, record=False).collapse["angle"] == pytest.approx(4.560, rel=5e-3)


def still(courses, blocks, duration):
    """Displacement of the top course since the dead-load equilibrium (m), and the speed fitted to its path (m/s)."""
    result = simulate(wall(DynamicControl(duration), courses, blocks))
    assert result.run.unbalanced < 1e-8  # head joints that open and close do not keep the wall from coming to rest
    top = [i for i, name in enumerate(result.assembly.names) if name.startswith(f"wall.{courses}.")]
    path = result.frames["displacement"][:, top] - result.frames["displacement"][:1, top]
    time = result.frames["time"]
    slope = np.polyfit(time, path.reshape(len(time), -1), 1)[0]
    return np.abs(path).max(), np.abs(slope).max()


def test_a_wall_left_alone_stays():
    moved, drift = still(4, 3, 0.3)
    assert moved < 1e-6 and drift < 1e-9


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_wall_that_lands_comes_to_rest(formulation):
    """Thrown obliquely against its base at 10 mm/s, it slips and then lies for 10 s as still as an undisturbed wall."""
    moving = motion(build.assemble(wall(DynamicControl(10.0), 4, 4, formulation)), damping=0.2, step_factor=0.8)
    driving, bodies = Driving(np.array([0.0, 0.0, -9.81])), moving.state.bodies
    find_equilibrium(moving, driving)
    bodies.velocity[bodies.free] = (3e-3, 1e-3, -1e-2)
    top = [i for i, name in enumerate(moving.assembly.names) if name.startswith("wall.4.")]
    steps, limits = round(0.5 / moving.time_step), Limits(1.0, 1.0)
    times, path = [], []
    for _ in range(22):
        advance(moving, driving, steps, limits)
        times.append(moving.time)
        path.append(moving.displacement[top].ravel())
    landed = np.array(path)[1:]  # a second after it was thrown
    assert np.abs(landed[-1]).max() > 5e-7  # it has slipped
    assert np.abs(landed - landed[0]).max() < 1e-9
    assert np.abs(np.polyfit(times[1:], landed, 1)[0]).max() < 1e-9


@pytest.mark.slow
def test_thirty_by_thirty_stays_for_ten_seconds():
    moved, drift = still(30, 30, 10.0)
    assert moved < 1e-6 and drift < 1e-9


# --- scenarios


def test_scenario_spinning_plate():
    result = simulate(scenarios.load(SCENARIOS / "spinning_plate.toml"))
    q = result.frames["orientation"][-1, 1]
    end = [*result.displacement[1, :2], 2.0 * math.atan2(q[3], q[0])]
    np.testing.assert_allclose(end, [-0.00126, 0.09238, 0.58576], rtol=5e-3)


def test_scenario_rocking_block():
    """Up and down take half a rocking period; then the block rocks on with a smaller amplitude after every impact."""
    result = simulate(scenarios.load(SCENARIOS / "rocking_block.toml"))
    time, q = result.frames["time"], result.frames["orientation"][:, 1]
    angle = 2.0 * np.arctan2(q[:, 2], q[:, 0])
    back = int(np.flatnonzero((angle[:-1] > 0.0) & (angle[1:] <= 0.0))[0])
    impact = np.interp(0.0, -angle[[back, back + 1]], time[[back, back + 1]])
    assert 2.0 * impact == pytest.approx(0.94481, rel=5e-3)
    assert angle.max() == pytest.approx(0.3 * math.atan2(0.2, 1.0), rel=1e-3)
    assert 0.8 < -angle.min() / angle.max() < 1.0
    last = np.abs(angle[time > 1.5]).max()
    assert last < -angle.min()


def push(displacement=0.02, rate=2e-3, direction=(0.0, 1.0, 0.0), **more):
    return PushoverControl(direction, displacement, quasi_static=False, rate=rate, **more)


def test_push_over_an_edge():
    """A block pushed by a share V of its weight rotates on its toe at V = tan(alpha - theta), also past the peak; its
    centroid has moved by R (sin(alpha) - sin(alpha - theta))."""
    b, h = 0.2, 1.0
    result = simulate(scenarios.load(SCENARIOS / "rocking_push.toml"))
    alpha, R = math.atan(b / h), 0.5 * math.hypot(b, h)
    assert result.status == "collapse"
    assert result.collapse["angle"] is None
    assert result.collapse["mechanism"] == "rocking"
    inertia = 5e-3 * math.sqrt(9.81 / 0.06) / 9.81  # rate times frequency of the jack over g
    assert 0.0 < result.collapse["load_factor"] - math.tan(alpha) < inertia
    u, V = result.rows["displacement"], result.rows["load"]
    theta = alpha - np.arcsin(np.sin(alpha) - np.clip(u, 0.0, None) / R)
    past = u > 0.01
    assert past.sum() > 50
    assert V[past] == pytest.approx(np.tan(alpha - theta[past]), abs=1e-4)
    assert u[-1] == pytest.approx(0.06, rel=0.03)  # path of the centroid, a little longer because it rises


def test_push_of_a_sliding_block():
    result = simulate(
        tower(push(displacement=2e-3, rate=1e-3, direction=(0.0, -1.0, 0.0)), (0.3, 0.2, 0.1), friction=0.3)
    )
    assert 0.0 < result.collapse["load_factor"] - 0.3 < 1e-3 * math.sqrt(9.81 / 2e-3) / 9.81
    assert result.collapse["mechanism"] == "sliding"
    slid = result.rows["displacement"] > 1e-3
    assert slid.sum() > 20
    assert result.rows["load"][slid] == pytest.approx(0.3, rel=1e-3)


def test_a_wall_pushed_out_of_plane_and_what_refines_it():
    result = simulate(wall(push(displacement=0.01, rate=4e-3)), refine=True)
    quasi_static = simulate(wall(PushoverControl((0.0, 1.0, 0.0))))
    expected = quasi_static.collapse["load_factor"]
    assert expected == pytest.approx(0.5, rel=2e-3)  # t / H
    assert result.collapse["load_factor"] == pytest.approx(expected, rel=0.015)
    # at half the rate half of the inertial force is gone
    assert result.collapse["error_estimate"] > 0.3 * abs(result.collapse["load_factor"] - expected)


def test_a_push_that_brings_nothing_down():
    with pytest.raises(NotConvergedError, match="before the load factor came near 10"):
        simulate(tower(push(displacement=2e-3, rate=0.05, direction=(0.0, 0.0, -1.0)), (0.3, 0.2, 0.1)))


def tower(control, box, friction=0.8):
    """A block with the edges ``box`` on a floor."""
    return of_stone(
        law("concave", friction),
        control,
        (
            Block("floor", "stone", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("block", "stone", box, (0.0, 0.0, 0.5 * box[2])),
        ),
    )


# --- what ends a run, and what is no run


def test_blocks_that_meet_again_go_on():
    """A block slides into a pillar and pushes it on; neither passes through the other."""
    scenario = block_on_floor(DynamicControl(0.3))
    pillar = Block("pillar", "stone", (0.1, 0.1, 0.12), (0.3, 0.0, 0.06))
    slider = Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05), velocity=(1.0, 0.0, 0.0))
    result = simulate(Scenario(**_fields(scenario) | {"blocks": (scenario.blocks[0], slider, pillar)}))
    before = result.frames["displacement"][result.frames["time"] < 0.1]
    assert np.abs(before[:, 2]).max() < 1e-5
    apart = 0.1 + result.frames["displacement"][:, 2, 0] - result.frames["displacement"][:, 1, 0]
    assert result.displacement[2, 0] > 0.05 and apart.min() > -3e-4
    assert result.frames["velocity"][-1, 1, 0] < 0.5


def _fields(scenario):
    names = ("title", "gravity", "joint", "materials", "blocks", "control")
    return {name: getattr(scenario, name) for name in names}


def test_what_cannot_stand_falls_from_where_it_was():
    """A block with only a third of its base on the floor begins to rotate about the edge: alpha = m g arm / I_edge."""
    a, b, c, out = 0.3, 0.2, 0.1, 0.05
    scenario = of_stone(
        law("concave", 0.9),
        DynamicControl(0.1),
        (
            Block("floor", "stone", (1.0, 1.0, 0.5), (-0.5, 0.0, -0.25), fixed=True),
            Block("block", "stone", (a, b, c), (out, 0.0, c / 2)),
        ),
    )
    result = simulate(scenario)
    inertia = (a * a + c * c) / 12.0 + out**2 + (c / 2) ** 2
    q = result.frames["orientation"][-1, 1]
    angle, time = 2.0 * math.atan2(q[2], q[0]), result.run.motion.time
    alpha = 9.81 * out / inertia
    # the arm grows as it rotates: alpha t^2/2 (1 + ...), 2 % by then
    assert angle == pytest.approx(0.5 * alpha * time**2, rel=0.05)
    assert result.run.motion.falling.tolist() == [False, True]


def test_what_cannot_stand_is_said_before_it_falls():
    loads = (Load("wall.4.1", (0.0, 600.0, 0.0)), Load("wall.4.2", (0.0, 600.0, 0.0)))
    with pytest.raises(NotConvergedError, match="no equilibrium under the dead loads"):
        simulate(wall(tilt(), stiffness=1e8, loads=loads))


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: TiltControl((0, 0, 0), 1.0, 0.02), "axis"),
        (lambda: TiltControl((1, 0, 0), -1.0, 0.02), "rate = -1.0"),
        (lambda: TiltControl((1, 0, 0), 1.0, 0.0), "displacement = 0.0"),
        (lambda: DynamicControl(0.0), "duration = 0.0"),
        (lambda: DynamicControl(1.0, 1.5), "restitution = 1.5"),
        (lambda: BaseMotionControl(1.0, (1, 0, 0)), "exactly one of file, sine and pulse"),
        (lambda: BaseMotionControl(1.0, (1, 0, 0), pulse=Pulse(1.0, 0.1), file="a.csv"), "exactly one of"),
        (lambda: BaseMotionControl(1.0, (1, 0, 0), pulse=Pulse(1.0, 0.1), quantity="speed"), "quantity = 'speed'"),
        (lambda: Sine(1.0, 0.0), "frequency = 0.0"),
        (lambda: Load("block", (1, 0, 0), sine=Sine(1.0, 1.0), history="a.csv"), "either a sine or a history"),
    ],
)
def test_controls_that_are_refused(make, message):
    with pytest.raises(ScenarioError, match=message):
        make()


def test_controls_survive_a_round_trip():
    for control in (
        tilt(damping=0.1),
        DynamicControl(2.0, 0.3),
        BaseMotionControl(1.0, (0.0, 1.0, 0.0), sine=Sine(1.0, 2.0)),
        BaseMotionControl(1.0, (0.0, 1.0, 0.0), pulse=Pulse(1.0, 0.2), quantity="velocity"),
    ):
        sine = None if control.kind == "tilt" else Sine(1.0, 2.0, 0.1)
        scenario = wall(control, loads=(Load("wall.1.1", (1.0, 0.0, 0.0), sine=sine),))
        again = scenarios.loads(scenarios.dumps(scenario))
        assert again == scenario


def test_very_stiff_joints_rest_to_their_rounding():
    """kn = 64,000 GPa/m: a position in its last digit is 1e-8 of the joint force, which bounds the equilibrium."""
    result = simulate(wall(DynamicControl(1e-5), stiffness=6.4e13))
    assert 1e-10 < result.run.unbalanced < 5e-6
