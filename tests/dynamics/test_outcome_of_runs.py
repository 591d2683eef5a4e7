"""The answer of a run that moves blocks: times and velocities that belong together, which blocks fell and how."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import EnergyAuditError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import (
    BaseMotionControl,
    DynamicControl,
    Pulse,
    SettlementControl,
    Sine,
    TiltControl,
)
from dembrick.scenario.model import Block, Output, Solver
from dembrick.scenario.time_functions import Turn
from dembrick.simulation.dynamics.outcome import _carried
from dembrick.simulation.energy_audit import Auditor, Sums
from helpers.key_lines import words
from helpers.scenario_text import block, header, jack
from helpers.stone_scenes import law, of_stone

G = 9.81
FLOOR = Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)


def scene(*blocks, control, gravity=(0.0, 0.0, -G), friction=0.5, **more):
    return of_stone(law("concave", friction), control, blocks, gravity=gravity, **more)


def test_a_falling_block_has_the_velocity_of_its_frame():
    """v = -g t and z = -g t^2 / 2 at the same t in all frames, up to the end of the duration."""
    high = Block("high", "stone", (0.2, 0.2, 0.2), (0.0, 0.0, 3.0), velocity=(0.3, 0.0, 0.0))
    result = simulate(scene(FLOOR, high, control=DynamicControl(0.2357)))
    t = result.frames["time"]
    np.testing.assert_allclose(result.frames["velocity"][:, 1, 2], -G * t, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(result.frames["displacement"][:, 1, 2], -0.5 * G * t * t, rtol=1e-9, atol=1e-14)
    assert t[-1] == pytest.approx(0.2357, rel=1e-14)
    assert result.as_dict()["simulated_time"] == pytest.approx(0.2357, rel=1e-14)


def test_a_tumbling_block_keeps_its_angular_momentum_from_frame_to_frame():
    """Spin about the intermediate axis: R I R^T w is the same in every frame, not so with an earlier spin."""
    free = Block("free", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 3.0), angular_velocity=(0.02, 9.0, 0.03))
    result = simulate(scene(FLOOR, free, control=DynamicControl(2.0), gravity=(0.0, 0.0, 0.0)))
    R = rotation_matrix(result.frames["orientation"][:, 1])
    momentum = np.einsum("fij,jk,flk,fl->fi", R, result.assembly.inertia[1], R, result.frames["spin"][:, 1])
    np.testing.assert_allclose(
        momentum, np.tile(momentum[0], (len(momentum), 1)), rtol=0, atol=1e-9 * np.abs(momentum).max()
    )


def test_a_block_that_swings_on_its_joint_has_the_velocity_of_its_frame():
    """An oscillation at half the amplitude that would open the joint: v = v0 cos(w t); a velocity of half a step before
    would be off by w dt / 2, 15 %."""
    k, m, lift = 1e10 * 0.04, 2000.0 * 0.04 * 0.2, 0.5 * G
    w = math.sqrt(k / m)
    v0 = lift / w
    block = Block("block", "stone", (0.2, 0.2, 0.2), (0.0, 0.0, 0.1), velocity=(0.0, 0.0, v0))
    result = simulate(
        scene(FLOOR, block, control=DynamicControl(20.0 / w, 1.0), output=Output(rows=400, frames=400)),
    )
    swing = w * result.run.motion.time_step
    stepped = 2.0 * math.asin(0.5 * swing) / swing * w  # central differences oscillate a little faster
    v, t = result.frames["velocity"][:, 1, 2], result.frames["time"]
    assert swing > 0.25
    np.testing.assert_allclose(v, v0 * np.cos(stepped * t), rtol=0, atol=1e-5 * v0)


def test_a_sine_of_velocity_that_begins_above_zero_is_a_jump():
    """The block slides back v^2 / (2 mu g) on its floor, as under a pulse of the same velocity."""
    v, mu = 0.5, 0.5
    block = Block("block", "stone", (0.4, 0.4, 0.2), (0.0, 0.0, 0.1))
    slow = Sine(v, 0.01, math.pi / 2.0)
    for control in (
        BaseMotionControl(0.15, (1.0, 0.0, 0.0), sine=slow, quantity="velocity"),
        BaseMotionControl(0.15, (1.0, 0.0, 0.0), pulse=Pulse(v, 1.0), quantity="velocity"),
    ):
        result = simulate(scene(FLOOR, block, control=control, friction=mu))
        assert result.frames["displacement"][-1, 1, 0] == pytest.approx(-(v**2) / (2.0 * mu * G), rel=3e-3)
    warned = assemble(scene(FLOOR, block, control=BaseMotionControl(0.1, (1, 0, 0), sine=slow, quantity="velocity")))
    assert "the supports jump from rest to 0.5 m/s at time zero" in warned.warnings[0]
    rest = BaseMotionControl(0.1, (1, 0, 0), sine=Sine(0.1, 2.0, 1.570796), quantity="displacement")
    assert not assemble(scene(FLOOR, block, control=rest)).warnings


def test_a_pulse_that_never_comes_is_remarked():
    block = Block("block", "stone", (0.4, 0.4, 0.2), (0.0, 0.0, 0.1))
    late = BaseMotionControl(0.5, (1.0, 0.0, 0.0), pulse=Pulse(1.0, 0.1, 1.0))
    said = []
    simulate(scene(FLOOR, block, control=late), report=said.append)
    assert len(said) == 1 and "begins at 1 s and the run ends at 0.5 s" in said[0]


def test_a_block_at_rest_on_a_slope_is_at_rest():
    """The energy put in is rounding only, and no error of the run."""
    angle = 0.9 * math.atan(0.48)
    turn = (math.cos(0.5 * angle), 0.0, math.sin(0.5 * angle), 0.0)
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    floor = Block("floor", "stone", (20.0, 20.0, 1.0), tuple(-0.5 * normal), turn, fixed=True)
    block = Block("b", "stone", (0.4, 0.3, 0.01), tuple(0.005 * normal), turn)
    result = simulate(scene(floor, block, control=DynamicControl(0.3), friction=0.48))
    assert np.abs(result.frames["displacement"][:, 1] - result.frames["displacement"][0, 1]).max() < 1e-12
    assert result.energy.relative_residual < 1e-2


def test_more_than_rounding_is_an_error_of_the_run():
    rows = {"kinetic": np.array([0.0, 3e-12]), "external": np.array([0.0, 1e-12])}
    for rounding, held in ((1e-13, False), (1e-11, True)):
        auditor = Auditor()
        auditor.add(rows)
        sums = Sums(0.0, 0.0, 0.0, 0.0, 0.0, rounding)
        if held:
            assert auditor.result(sums).relative_residual < 1e-2
        else:
            with pytest.raises(EnergyAuditError):
                auditor.result(sums)


def test_the_greatest_displacement_is_that_of_the_run_and_not_of_its_end():
    """A block thrown up rises by v^2 / (2 g) and lands where it was; the one beside it stays."""
    v = 1.0
    up = Block("up", "stone", (0.2, 0.2, 0.2), (0.0, 0.0, 0.1), velocity=(0.0, 0.0, v))
    still = Block("still", "stone", (0.2, 0.2, 0.2), (1.0, 0.0, 0.1))
    result = simulate(scene(FLOOR, up, still, control=DynamicControl(0.6, 0.2)))
    answer = result.as_dict()
    assert answer["greatest_displacement"]["up"] == pytest.approx(v**2 / (2.0 * G), rel=1e-3)
    assert answer["greatest_displacement"]["still"] < 1e-9
    assert answer["displacement"] < 0.01 and answer["fallen"] == []
    assert "m (of the centroid of up" in result.text()


def test_what_has_fallen_is_named():
    """A column that is thrown over lies on the ground and a block falls over the edge of its table; two others stay."""
    column = Block("column", "stone", (0.2, 0.2, 0.8), (0.0, 0.0, 0.4), angular_velocity=(0.0, 4.0, 0.0))
    stays = Block("stays", "stone", (0.2, 0.2, 0.2), (-1.0, 0.0, 0.1))
    table = Block("table", "stone", (0.4, 0.4, 0.4), (0.0, 1.5, 0.2))
    edge = Block("edge", "stone", (0.4, 0.2, 0.1), (0.25, 1.5, 0.45))
    result = simulate(scene(FLOOR, column, stays, table, edge, control=DynamicControl(1.2, 0.2)))
    assert result.as_dict()["fallen"] == ["column", "edge"]
    assert result.as_dict()["not_standing"] == ["edge"]
    assert "fallen column, edge" in words(result.text())


@pytest.mark.parametrize("rate, displacement", [(1.0, 0.001), (1.0, 0.1), (4.0, 0.02)])
def test_the_onset_of_a_tilt_depends_on_neither_rate_nor_goal(rate, displacement):
    """A column overturns at tan = b / h whatever the rate and the goal; the angle at which it has moved by the given
    displacement is greater."""
    b, h = 0.2, 1.5
    column = Block("column", "stone", (0.4, b, h), (0.0, 0.0, 0.5 * h))
    control = TiltControl((1.0, 0.0, 0.0), rate, displacement, quasi_static=False)
    result = simulate(scene(FLOOR, column, control=control, friction=0.64, solver=Solver()))
    limit = math.degrees(math.atan(b / h))
    assert limit < result.collapse["onset"] == pytest.approx(limit, rel=0.015)
    assert result.collapse["angle"] > result.collapse["onset"]
    assert f"a block has moved {1e3 * result.collapse['displacement']:.4g} mm" in result.text()


def test_what_falls_on_for_ever_ends_the_run():
    """A block shaken off a small floor falls with nothing below: the run ends there with a message."""
    control = BaseMotionControl(20.0, (1.0, 0.0, 0.0), pulse=Pulse(5.0, 0.8))
    floor = Block("f", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    stone, said = Block("b", "stone", (0.4, 0.4, 0.2), (0.0, 0.0, 0.1)), []
    result = simulate(of_stone(law("concave", 0.3, 1e7), control, (floor, stone)), report=said.append)
    assert result.as_dict()["outcome"] == "fell" and 1.0 < result.run.motion.time < 5.0
    assert any("block 'b' has fallen by" in one and "has nothing below it" in one for one in said)
    assert result.rows["time"][-1] == pytest.approx(result.run.motion.time)


def test_blocks_without_a_joint_tilt_and_fall():
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    stone = Block("b", "stone", (0.2, 0.4, 0.5), (0.0, 0.0, 0.4))
    control = TiltControl((0.0, 1.0, 0.0), 10.0, 0.02)
    assert simulate(of_stone(law("concave", 0.5, 1e9), control, (floor, stone))).collapse["mechanism"] == "uplift"


def turned_table(angle, at, friction, more="", width=6.0):
    """A block at x = ``at`` on a table that a settlement rotates by ``angle`` (deg), followed by a free motion."""
    text = header(friction=0.5, normal_stiffness=1e8)
    text += block("table", (0.0, 0.0, -0.1), (width, 4.0, 0.2), "fixed = true") + more
    text += block("up", (at, 0.0, 0.05), (0.3, 0.3, 0.1))
    text += f'[[joints]]\nbetween = ["table", "up"]\nfriction = {friction}\nstages = [2]\n'
    text += '[[stages]]\nkind = "settlement"\nsupports = ["table"]\n'
    return toml.loads(
        f'{text}rotation = {{ axis = [0.0, 1.0, 0.0], angle = {angle} }}\n[control]\nkind = "dynamic"\nduration = 1.0\n'
    )


@pytest.mark.parametrize("at", [-2.0, 0.0, 2.0])
def test_what_a_settlement_has_carried_has_not_fallen_after_it(at):
    """The block rests on the rotated table: relative to the start of the stage it has not fallen, wherever it lies."""
    scenario = turned_table(2.0, at, 0.5)
    result = simulate(replace(scenario, control=DynamicControl(0.05)), record=False)
    assert result.fallen == [] and np.linalg.norm(result.displacement[-1]) < 1e-6
    assert np.isclose(result.run.turned, 0.0, atol=1e-4).all()


def test_what_falls_after_a_settlement_has_fallen():
    """A table that was rotated by 10 degrees becomes slippery: the block slides off, onto a floor below."""
    floor = block("floor", (3.6, 0.0, -0.56), (4.0, 4.0, 0.2), "fixed = true")
    scenario = turned_table(10.0, 1.3, 0.05, floor, 3.0)
    result = simulate(replace(scenario, control=DynamicControl(2.0)), record=False)
    assert result.displacement[-1, 2] < -0.15 and result.fallen == ["up"]


def test_a_support_carries_blocks_by_what_it_has_moved_in_its_stage():
    """A table rotated by 10 degrees in one stage and by 5 more in the next carries a block far from its axis by those 5
    degrees, from its position at the start of that stage."""
    scenario = turned_table(10.0, 2.0, 0.5)
    turn = Turn((0.0, 1.0, 0.0), 5.0, (0.0, 0.0, 0.0))
    control = SettlementControl(("table",), rotation=turn, quasi_static=False, rate=0.5)
    moving = simulate(replace(scenario, control=control), record=False).run.motion
    ((carried, turned),) = _carried(moving, rotation_matrix(moving.upright))

    def about_y(angle):
        c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

    middle = [0.0, 0.0, -0.1]  # of the table, the centre of the first stage's rotation
    start = middle + about_y(10.0) @ [2.0, 0.0, 0.15]
    np.testing.assert_allclose(turned, about_y(5.0), atol=1e-9)
    np.testing.assert_allclose(carried[1], about_y(5.0) @ start - start, atol=1e-4)


@pytest.mark.parametrize("control", [
    'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]',
    'kind = "tilt"\naxis = [0.0, 1.0, 0.0]',
    'kind = "yield"',
])  # fmt: skip
def test_a_column_that_overturns_is_said_to_rock(control):
    """The mechanism is rocking however far it has fallen: lying, O is as far along the floor as its edge is up."""
    text = header("concave", 0.8, 1e8) + block("base", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    text += block("column", (0.0, 0.0, 0.3), (0.2, 0.2, 0.6))
    text += jack("column", (-0.1, 0.0, 0.6)) if "yield" in control else ""
    found = simulate(toml.loads(f"{text}[control]\n{control}\nlarge_displacements = true\n"))
    assert (found.collapse or {"mechanism": found.yield_point.mechanism})["mechanism"] == "rocking"
