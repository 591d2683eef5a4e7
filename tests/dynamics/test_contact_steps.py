"""Stability of new contacts in a time step: their load is bounded in the loop, examined closely if need be, and
reported if it is too great."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import eigh

from dembrick import history
from dembrick.assembly.ties import NO_TIES
from dembrick.cli import main
from dembrick.errors import DivergedError
from dembrick.geometry.rotations import quaternion_product
from dembrick.geometry.shapes import box
from dembrick.kernels.dynamics.contact_forces import clear_applied, touch
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, Load, Output, Sine, Solver
from dembrick.scenario.toml import dumps
from dembrick.simulation.dynamics import contact_detection, time_step
from dembrick.simulation.dynamics.state import MovingState
from dembrick.simulation.moving_ties import moving_ties
from helpers.impact_scenes import collapse, falling_arch, scene
from helpers.pairs import BLOCK, K_N, K_S, SETTINGS, Pair, no_joints, quaternion, set_up

DT = 1e-6


def stiffness_by_differences(pair):
    """(12, 12) forces on both blocks per small motion of both, about their centroids, by central differences."""
    columns = []
    start = pair.bodies.position.copy(), pair.bodies.orientation.copy()
    for block in (0, 1):
        for axis in range(6):
            sides, step = [], 2e-7 if axis < 3 else 2e-6
            for sense in (1.0, -1.0):
                position, q = start[0][block].copy(), start[1][block]
                if axis < 3:
                    position[axis] += sense * step
                else:
                    q = quaternion_product(quaternion(np.eye(3)[axis - 3], sense * step), q)
                pair.place(block, position, q)
                clear_applied(pair.contact, pair.bodies)
                touch(pair.contact, no_joints(), pair.bodies, DT)
                sides.append(pair.bodies.applied.ravel().copy())
            pair.place(block, start[0][block], start[1][block])
            columns.append((sides[1] - sides[0]) / (2.0 * step))
    return np.array(columns).T


def masses(pair):
    """Mass matrix (12, 12) of both blocks in world axes."""
    matrix = np.zeros((12, 12))
    for b in (0, 1):
        turn, at = pair.bodies.rotation[b], 6 * b
        matrix[at : at + 3, at : at + 3] = pair.bodies.mass[b] * np.eye(3)
        matrix[at + 3 : at + 6, at + 3 : at + 6] = turn @ np.linalg.inv(pair.bodies.inverse[b]) @ turn.T
    return matrix


def looked_at(pair):
    """Load of the last step by the close examination, and the bounds of both blocks."""
    none = moving_ties(NO_TIES, np.zeros((2, 3)), np.zeros((2, 3, 3)))
    state = MovingState(pair.bodies, no_joints(), None, None, none, np.zeros(3))
    return time_step.load_of_contacts(state, pair.contact, np.zeros(0), DT), pair.contact.load.copy()


@pytest.mark.parametrize("name", SETTINGS)
def test_springs_are_those_that_forces_show(name):
    """Edges and corners are softer than the sum of their springs, sharp ones by a third: the bound underrates none."""
    pair = set_up(name, friction=0.0)
    pair.contact.k_s[:] = 0.0
    k = stiffness_by_differences(pair)
    greatest = DT**2 * eigh(0.5 * (k + k.T), masses(pair), eigvals_only=True)[-1]
    pair.touch(DT)
    found, bounds = looked_at(pair)
    assert 0.98 * greatest < found < 1.6 * greatest
    assert found < bounds.min()


@pytest.mark.parametrize("ratio", [0.0, 0.2])
def test_a_block_on_its_face_swings_as_the_time_step_expects(ratio):
    """Normal, shear, bending and torsional stiffness and dashpots of a flat contact are those of the face itself."""
    pair = Pair(box((1.0, 1.0, 0.2)), BLOCK, ratio=ratio)
    pair.contact.free[0] = 0.0
    pair.bodies = pair.bodies._replace(free=np.array([1], np.uint32))
    pair.place(1, (0.05, 0.02, 0.15 - 1e-6))
    pair.touch(DT)
    found, bounds = looked_at(pair)
    mass, inertia = pair.bodies.mass[1], np.linalg.inv(pair.bodies.inverse[1])
    number = int(np.argmin(BLOCK.face_normals[:, 2]))
    spring = time_step._fastest(BLOCK, number, np.zeros(3), K_N, K_S, mass, inertia)
    swing = math.sqrt(K_N * 0.06 / mass) * DT
    dashpot = (1.0 - math.exp(-2.0 * ratio * swing)) / swing**2
    assert found == pytest.approx(DT**2 * spring * (1.0 + 2.0 * dashpot), rel=2e-3)
    inverse = np.diag(np.linalg.inv(inertia))
    arms = 0.06 * np.array([0.2**2 / 12.0, 0.3**2 / 12.0])
    trace = K_N * (0.06 / mass + inverse[:2] @ arms)
    trace += K_S * (2.0 * 0.06 / mass + 0.06 * 0.05**2 * inverse[:2].sum() + arms.sum() * inverse[2])
    assert bounds[1] == pytest.approx(DT**2 * trace * (1.0 + 2.0 * dashpot), rel=2e-3)
    assert bounds[0] == 0.0  # a fixed block


def ball():
    """200 points spread evenly on a sphere of 0.1 m radius by the golden angle."""
    k = np.arange(200) + 0.5
    z, turn = 1.0 - 2.0 * k / 200, math.pi * (1.0 + math.sqrt(5.0)) * k
    wide = np.sqrt(1.0 - z * z)
    return tuple(map(tuple, (0.1 * np.column_stack([wide * np.cos(turn), wide * np.sin(turn), z])).tolist()))


def squeezed(step_factor=0.9, duration=0.4):
    """A ball of 396 small faces, pressed into the floor until far more than the area of any one face is in contact."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.4), (0.0, 0.0, -0.2), fixed=True)
    stone = Block("ball", "stone", vertices=ball(), position=(0.0, 0.0, 0.1 + 1e-4))
    press = Load("ball", (0.0, 0.0, -6e4), sine=Sine(1.0, 0.5, 0.0))
    return scene(
        DynamicControl(duration, 0.8), floor, stone, stiffness=1e9, friction=0.3, loads=(press,),
        solver=Solver(step_factor), output=Output(rows=200, frames=200),
    )  # fmt: skip


SAYS = "at t = 0.0[0-9]+ s block 'ball' oscillates on its contacts faster than .*: lower solver.step_factor"


def test_many_small_faces_at_once_are_more_than_a_step_stands(monkeypatch):
    """Without the check the ball leaps off the floor with spurious energy; the check ends the run before that."""
    with pytest.raises(DivergedError, match=SAYS):
        simulate(squeezed())
    monkeypatch.setattr(contact_detection, "STABLE", np.inf)
    with pytest.raises(DivergedError, match="moves by more than 0.1 of a block in a step"):
        simulate(squeezed())


def test_shorter_steps_are_the_remedy():
    """With shorter steps the ball sinks in as slowly as it is pressed."""
    result = simulate(squeezed(step_factor=0.2, duration=0.12))
    late = result.frames["time"] > 0.09
    assert np.abs(result.frames["velocity"][late, 1, 2]).max() < 0.2
    assert result.displacement[1, 2] < -1e-3


def test_what_was_simulated_is_on_disk(folder, capsys):
    """A run that ends with this error has exit code 1, a one-sentence message and a history up to that time."""
    (folder / "ball.toml").write_text(dumps(squeezed()))
    assert main(["run", "ball.toml", "--out", "ball.h5"]) == 1
    error = capsys.readouterr().err
    assert "lower solver.step_factor" in error and "Traceback" not in error
    with history.read(folder / "ball.h5") as file:
        assert 10 < len(file.time) and 0.03 < file.time[-1] < 0.1


@pytest.mark.parametrize("made", [collapse(), falling_arch("concave")], ids=["collapse", "arch"])
def test_ordinary_heaps_are_far_from_it(monkeypatch, made):
    """A wall thrown over and an arch that falls are seldom examined closely and stay far from the limit."""
    found, look = [], contact_detection.load_of_contacts
    monkeypatch.setattr(contact_detection, "load_of_contacts", lambda *given: found.append(look(*given)) or found[-1])
    simulate(dataclasses.replace(made, output=Output((), rows=100, frames=100)))
    assert len(found) < 20 and max(found, default=0.0) < 2.0
