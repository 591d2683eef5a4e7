"""A block that spins and slides obliquely over the edges of a floor of its size, against the differential equations of
its plane motion: its joint is cut by two edges at a time, and rotates."""

import math

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, JointLaw, Material, Output
from helpers.custom_laws import COULOMB
from helpers.stone_scenes import of_stone

G, DENSITY = 9.81, 2000.0
CELLS = 40  # of the face, along each edge


class PlaneMotion:
    """A block of edges a, b, h on a floor a x b: friction of every cell against its motion, under a pressure that is
    uniform over the remaining joint, or linear and in equilibrium with the friction."""

    def __init__(self, edges, friction, linear):
        a, b, h = self.edges = np.array(edges)
        self.friction, self.linear = friction, linear
        self.mass = DENSITY * a * b * h
        self.inertia = self.mass * (a * a + b * b) / 12.0
        middles = (np.arange(CELLS) + 0.5) / CELLS - 0.5
        self.cells = np.stack(np.meshgrid(a * middles, b * middles, indexing="ij"), -1).reshape(-1, 2)

    def accelerations(self, state):
        x, y, angle, *velocity, spin = state
        c, s = math.cos(angle), math.sin(angle)
        arm = self.cells @ np.array([[c, s], [-s, c]])
        size = self.edges[:2] / CELLS
        part = np.clip((0.5 * self.edges[:2] - np.abs(arm + (x, y))) / size + 0.5, 0.0, 1.0).prod(axis=1)
        area = size.prod() * part
        moving = np.column_stack([velocity[0] - spin * arm[:, 1], velocity[1] + spin * arm[:, 0]])
        against = -moving / (np.linalg.norm(moving, axis=1) + 1e-9)[:, None]
        pressure = np.full(len(area), self.mass * G / area.sum())
        for _ in range(3 if self.linear else 0):  # friction below the centroid shifts the pressure
            force = (self.friction * pressure * area) @ against
            shape = np.column_stack([np.ones(len(area)), arm])
            wanted = np.array([self.mass * G, *(-0.5 * self.edges[2] * force)])
            pressure = shape @ np.linalg.solve(shape.T @ (area[:, None] * shape), wanted)
            assert pressure[area > 0.0].min() > 0.0
        forces = (self.friction * pressure * area)[:, None] * against
        torque = (arm[:, 0] * forces[:, 1] - arm[:, 1] * forces[:, 0]).sum()
        return np.array([*velocity, spin, *(forces.sum(axis=0) / self.mass), torque / self.inertia])

    def to_rest(self, velocity, spin):
        """x, y (m) and angle (rad) where the block stops, by the Runge-Kutta method."""
        state = np.array([0.0, 0.0, 0.0, *velocity, spin])
        while (speed := math.hypot(*state[3:5]) + abs(state[5]) * self.edges[0]) > 2e-3:
            step = 2e-3 if speed > 0.1 else 2e-4
            one = self.accelerations(state)
            two = self.accelerations(state + 0.5 * step * one)
            three = self.accelerations(state + 0.5 * step * two)
            four = self.accelerations(state + step * three)
            state = state + step / 6.0 * (one + 2.0 * two + 2.0 * three + four)
        return state[:3]


def simulated(edges, friction, formulation, velocity, spin, law, **joint):
    """x, y (m) and angle (rad) at the end of the run."""
    a, b, h = edges
    floor = Block("floor", "stone", (a, b, 0.1), (0.0, 0.0, -0.05), fixed=True)
    block = Block(
        "block", "stone", edges, (0.0, 0.0, 0.5 * h), velocity=(*velocity, 0.0), angular_velocity=(0.0, 0.0, spin)
    )
    scenario = of_stone(
        JointLaw(formulation, friction, 1e9, 4e8, **joint),
        DynamicControl(0.5),
        (floor, block),
        materials={"stone": Material(DENSITY)},
        output=Output(("energy", "frames"), rows=40, frames=4),
    )
    result = simulate(scenario, law=law)
    assert result.energy.relative_residual < 1e-5
    w, _, _, z = result.frames["orientation"][-1, 1]
    return np.array([*result.frames["displacement"][-1, 1, :2], 2.0 * math.atan2(z, w)])


@pytest.mark.parametrize(
    "formulation, joint, law, within",
    [
        ("convex", {}, None, 3e-4),
        ("convex", {"pressure": "linear"}, None, 3e-4),
        ("distributed", {}, None, 3e-3),  # its accuracy is the spacing of its points
        ("distributed", {}, COULOMB, 3e-3),
    ],
)
def test_where_a_spinning_block_comes_to_rest(formulation, joint, law, within):
    edges, friction = (0.3, 0.24, 0.02), 0.3
    linear = formulation == "distributed" or "pressure" in joint
    for velocity, spin in (((0.3, 0.2), 2.5), ((-0.42, 0.06), -1.5)):
        found = simulated(edges, friction, formulation, velocity, spin, law, **joint)
        exact = PlaneMotion(edges, friction, linear).to_rest(velocity, spin)
        assert math.hypot(*exact[:2]) > 0.02 and abs(exact[2]) > 0.05
        np.testing.assert_allclose(found[:2], exact[:2], rtol=0.0, atol=within * math.hypot(*exact[:2]))
        assert found[2] == pytest.approx(exact[2], rel=within)
