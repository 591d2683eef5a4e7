"""Dynamic runs against motions known in closed form or by a one-dimensional integral, as given in the literature."""

import math

import numpy as np
import pytest

from dembrick.assembly.actuators import Attached
from dembrick.assembly.build import assemble
from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.dynamics.loop import RUNNING, Limits
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Pulse, Sine
from dembrick.scenario.model import Block, JointLaw, Load, Material, Output, Scenario
from dembrick.simulation.dynamics.dead_load import find_equilibrium
from dembrick.simulation.dynamics.integrator import NO_LIMIT, advance, motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.run import IMPACTS
from dembrick.simulation.dynamics.time_step import (
    damping_of_restitution,
    restitution_of_damping,
    stepped_dashpots,
)
from helpers import motions as theory
from helpers.stone_scenes import of_stone

DENSITY = 2000.0


def scenario(control, formulation="concave", box=(0.3, 0.2, 0.1), friction=0.64, gravity=(0.0, 0.0, -9.81), loads=(),
             stiffness=1e10, rows=300, floor=(4.0, 4.0, 0.1), **block):  # fmt: skip
    """A block on a floor larger than its path."""
    points = {"points": (12, 8)} if formulation == "distributed" else {}
    return Scenario(
        title="a block on a floor",
        gravity=gravity,
        joint=JointLaw(formulation, friction, stiffness, 0.4 * stiffness, **points),
        materials={"stone": Material(DENSITY)},
        blocks=(
            Block("floor", "stone", floor, (0.0, 0.0, -floor[2] / 2), fixed=True),
            Block("block", "stone", box, (0.0, 0.0, box[2] / 2), **block),
        ),
        control=control,
        loads=loads,
        output=Output(rows=rows, frames=rows),
    )


def turned_about(result, axis):
    """Angle of the block about a world axis in every frame (rad)."""
    q = result.frames["orientation"][:, 1]
    return np.unwrap(2.0 * np.arctan2(q[:, 1 + axis], q[:, 0]))


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_slope(formulation):
    """a = g (sin psi - mu cos psi); below the friction angle the block stays where it is."""
    psi, friction = math.radians(40.0), math.tan(math.radians(20.0))
    gravity = (10.0 * math.sin(psi), 0.0, -10.0 * math.cos(psi))
    result = simulate(scenario(DynamicControl(0.3), formulation, friction=friction, gravity=gravity))
    time = result.run.motion.time
    assert 2.0 * result.displacement[1, 0] / time**2 == pytest.approx(3.63970, rel=1e-5)
    assert theory.slope_acceleration(psi, friction, 10.0) == pytest.approx(3.63970, rel=2e-6)
    stuck = simulate(scenario(DynamicControl(0.3), formulation, friction=0.9, gravity=gravity))
    assert np.abs(stuck.displacement).max() < 1e-6


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_newmark_pulse(formulation):
    """A rectangular pulse of .5 g for .2 s on friction .2: slip A (A - a_y) t0^2 / (2 a_y) = .14715 m."""
    control = BaseMotionControl(1.0, (1.0, 0.0, 0.0), pulse=Pulse(0.5 * 9.81, 0.2))
    result = simulate(scenario(control, formulation, friction=0.2))
    assert -result.displacement[1, 0] == pytest.approx(0.14715, rel=1e-3)
    np.testing.assert_allclose(result.displacement[1, 1], 0.0, atol=1e-9)


@pytest.mark.parametrize("formulation", ["concave", "corrected", "convex"])
def test_stop(formulation):
    """From 1 m/s to rest in .07964 m and .15928 s."""
    result = simulate(scenario(DynamicControl(0.25), formulation, velocity=(1.0, 0.0, 0.0)))
    assert result.displacement[1, 0] == pytest.approx(0.0796381, rel=1e-4)
    speed, time = result.frames["velocity"][:, 1, 0], result.frames["time"]
    assert time[speed > 0.01][-1] == pytest.approx(0.15928 - 0.01 / (0.64 * 9.81), abs=5e-4)


def test_harmonic_push():
    """m = 1, mu = .8, F = 8 cos t from x = 3: slips, sticks and returns; 3.004349, 2.991303, 3.004349 at 2, 5, 8 s."""
    mass = DENSITY * 0.3 * 0.2 * 0.1
    push = Load("block", (8.0 * mass, 0.0, 0.0), sine=Sine(1.0, 1.0 / (2.0 * math.pi), math.pi / 2.0))
    result = simulate(scenario(DynamicControl(8.0), "convex", friction=0.8, loads=(push,), stiffness=1e9))
    x = 3.0 + np.interp([2.0, 5.0, 8.0], result.frames["time"], result.frames["displacement"][:, 1, 0])
    np.testing.assert_allclose(x - 3.0, [0.004349, -0.008697, 0.004349], rtol=2e-3)
    np.testing.assert_allclose(x, [3.004349, 2.991303, 3.004349], rtol=1e-5)


@pytest.mark.parametrize("formulation, angle", [("convex", 0.8912), ("corrected", 0.8912), ("concave", 0.4786)])
def test_spin_down(formulation, angle):
    """A spin of 10 rad/s, flat on the floor, slows down by 12 mu g arm/(a^2 + b^2): 56.106 or 104.479 rad/s^2."""
    result = simulate(scenario(DynamicControl(0.25), formulation, angular_velocity=(0.0, 0.0, 10.0)))
    assert turned_about(result, 2)[-1] == pytest.approx(angle, rel=1e-3)
    np.testing.assert_allclose(result.displacement[1, :2], 0.0, atol=1e-7)


PLATE = {
    ("convex", 5.0): (-0.00126, 0.09238, 0.58576),
    ("convex", 10.0): (-0.00500, 0.12630, 1.28769),
    ("concave", 5.0): (0.00023, 0.0923, 0.3441),
    ("concave", 10.0): (0.0000, 0.12556, 0.7517),
    ("corrected", 5.0): (0.00018, 0.0926, 0.6452),
    ("corrected", 10.0): (-0.01278, 0.13012, 1.3879),
}


@pytest.mark.parametrize("formulation, spin", PLATE, ids=str)
def test_plate_sliding_and_spinning(formulation, spin):
    """A plate that slides at 1 m/s along y and spins; at 1 mm thickness nothing overturns it."""
    control = DynamicControl(0.3)
    start = {"velocity": (0.0, 1.0, 0.0), "angular_velocity": (0.0, 0.0, spin)}
    result = simulate(scenario(control, formulation, box=(0.3, 0.2, 0.001), stiffness=1e9, **start))
    x, y, angle = PLATE[formulation, spin]
    assert result.displacement[1, 1] == pytest.approx(y, rel=1e-3)
    assert turned_about(result, 2)[-1] == pytest.approx(angle, rel=1e-3)
    assert result.displacement[1, 0] == pytest.approx(x, abs=3e-4)
    assert np.abs(result.frames["velocity"][-1, 1]).max() < 1e-6


@pytest.mark.parametrize("ratio, period", [(0.3, 0.94481), (0.5, 1.38837)])
def test_free_rocking(ratio, period):
    """A block of 0.2 x 1.0 m, set rotating from upright, rocks on its toe up to ratio alpha and is back after half a
    period.

    The reference is exact: the period of the linearised equation is 0.2 % shorter.
    """
    b, h = 0.2, 1.0
    alpha, p = math.atan2(b, h), theory.rocking_frequency(b, h)
    spin = p * math.sqrt(2.0 * (math.cos(alpha - ratio * alpha) - math.cos(alpha)))
    velocity = tuple(np.cross([0.0, spin, 0.0], [-b / 2, 0.0, h / 2]))
    block = {"velocity": velocity, "angular_velocity": (0.0, spin, 0.0)}
    result = simulate(scenario(DynamicControl(0.8), box=(b, 0.5, h), friction=0.8, rows=1500, **block))
    time, angle = result.frames["time"], turned_about(result, 1)
    peak = int(np.argmax(angle))
    assert angle[peak] == pytest.approx(ratio * alpha, rel=1e-4)
    back = peak + int(np.flatnonzero(angle[peak:] <= 0.0)[0])
    crossing = np.interp(0.0, -angle[[back - 1, back]], time[[back - 1, back]])
    assert 2.0 * crossing == pytest.approx(period, rel=5e-4)
    assert theory.rocking_period(b, h, ratio) == pytest.approx(period, rel=1e-5)
    # Housner's loss at the impact, set here by the contact damping: the peak of the next swing gives the energy left
    swing = angle[back : back + int(0.9 * (len(angle) - back))].min()
    left = (math.cos(alpha + swing) - math.cos(alpha)) / (math.cos(alpha - ratio * alpha) - math.cos(alpha))
    assert 0.8 < math.sqrt(left) / theory.housner_restitution(b, h) < 1.1 or back > 0.85 * len(angle)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.9])
@pytest.mark.parametrize(("formulation", "within"), [("concave", 0.008), ("convex", 0.035)])
def test_bounce(formulation, within, restitution):
    """A block thrown up flat from the floor rebounds at the given restitution, wherever in a step it lands; the convex
    joint, softer in rotation, has longer steps."""
    for speed in (0.50, 0.51, 0.52, 0.53, 0.54):
        assert bounced(formulation, restitution, speed) == pytest.approx(restitution, rel=within)
    assert bounced(formulation, restitution, 0.5, step_factor=0.3) == pytest.approx(restitution, rel=0.005)


def bounced(formulation, restitution, speed, step_factor=0.9):
    """Speed after over speed before the first impact of a block thrown up at this speed; observed in every step from
    shortly before it lands until it has left the floor."""
    built = assemble(scenario(DynamicControl(1.0, restitution), formulation))
    moving = motion(built, damping_of_restitution(restitution), step_factor, IMPACTS)
    driving, no_limit = Driving(built.gravity), Limits(NO_LIMIT, NO_LIMIT)
    find_equilibrium(moving, driving)
    moving.state.bodies.velocity[1, 2] = speed
    nearly = 2.0 * speed / 9.81 - 5e-4
    assert advance(moving, driving, math.floor(nearly / moving.time_step), no_limit) == RUNNING
    rise = []
    for _ in range(math.ceil(3e-3 / moving.time_step)):
        advance(moving, driving, 1, no_limit)
        rise.append(moving.state.bodies.velocity[1, 2])
    landing = int(np.argmin(rise))
    assert 0 < landing and rise[landing] == pytest.approx(-speed, rel=0.01)
    return max(rise[landing:]) / -rise[landing]


def test_dashpots_of_steps():
    """The eigenvalues of a stepped oscillator have the damping asked for, though the dashpot acts half a step late."""
    for ratio in (0.05, 0.3, 0.7):
        for swing in (1e-4, 0.1, 0.5, 0.9):
            C = float(stepped_dashpots(np.array([swing]), ratio)[0]) * swing**2
            # u_{n+1} = u_n + v, v = v_old - K u_n - C v_old
            values = np.linalg.eigvals([[1.0 - swing**2, 1.0 - C], [-(swing**2), 1.0 - C]])
            decay = np.log(values[0])
            assert -decay.real / abs(decay) == pytest.approx(ratio, rel=1e-7 / swing)
    assert stepped_dashpots(np.array([0.4]), 0.0) == 0.0


def test_damping_and_restitution_are_inverse():
    for restitution in (0.14, 0.3, 0.7, 0.99):
        assert restitution_of_damping(damping_of_restitution(restitution)) == pytest.approx(restitution, rel=1e-9)
    assert restitution_of_damping(0.0) == 1.0
    # light damping: exp(-pi zeta), as for a contact that may pull
    assert restitution_of_damping(1e-3) == pytest.approx(math.exp(-math.pi * 1e-3), abs=1e-5)


def test_free_fall_without_joints():
    """No contact and no damping: the block falls by exactly g t^2 / 2."""
    result = simulate(
        of_stone(
            JointLaw("concave", 0.6, 1e9, 1e9),
            DynamicControl(0.5),
            (Block("stone", "stone", (0.1, 0.2, 0.3), (0, 0, 0), velocity=(2.0, 0.0, 1.0)),),
            materials={"stone": Material(DENSITY)},
        )
    )
    t = result.run.motion.time
    np.testing.assert_allclose(result.displacement[0], [2.0 * t, 0.0, t - 0.5 * 9.81 * t * t], rtol=1e-9, atol=1e-12)


def test_a_tilting_table_turns_gravity_and_loads_the_other_way():
    rng = np.random.default_rng(3)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    gravity, force, rate, times = rng.normal(size=3), rng.normal(size=(2, 3)), 0.3, np.array([0.0, 0.7, 4.0])
    growing = Driving(
        gravity, at=Attached(np.array([0, 1]), np.zeros((2, 3)), np.zeros((2, 3))), force=force,
        factor=(None, lambda t: 1.0 + t), tilt=(axis, lambda times: rate * times),
    )  # fmt: skip
    found_gravity, found_force = growing.forces(times, 1e-3)
    for i, t in enumerate(times):
        back = rotation_matrix([math.cos(rate * t / 2), *(-math.sin(rate * t / 2) * axis)])
        np.testing.assert_allclose(found_gravity[i], back @ gravity, atol=1e-14)
        np.testing.assert_allclose(found_force[i], [back @ force[0], (1.0 + t) * back @ force[1]], atol=1e-13)
    np.testing.assert_array_equal(growing.force, force)  # evaluating a driving does not change it
