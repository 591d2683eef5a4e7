"""Cycles of a joint whose points dilate while the block slides and turns, against plane points solved by scipy."""

import numpy as np
import pytest
from scipy.optimize import root

import dembrick
from dembrick.scenario import toml
from dembrick.simulation.dynamics.paths import driven_path
from helpers.scenario_text import block, header, jack

pytestmark = pytest.mark.usefixtures("few")

MU, PSI, KN = 0.45, 0.15, 1e10  # the shear stiffness is 0.4 KN
ARM = np.array([0.02, 0.05])  # of the jack, m
DIRECTION = np.array([0.4, -np.sqrt(1.0 - 0.4**2)])
SIZE, HEIGHT, PRESSED = (0.13, 0.24), 0.3, 6000.0
TURNS = np.array([0.0, 8e-5, -4e-5, 8e-5, -4e-5])


class Corners:
    """Four corners of a block that moves in its plane, by radial return: `q` holds its twist (m, m, rad), penetration
    (m) and multiplier V (N)."""

    def __init__(self, N: float):
        self.at = 0.5 * np.array(SIZE) * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        self.area, self.N = 0.25 * np.prod(SIZE), N
        self.slipped, self.risen = np.zeros((4, 2)), np.zeros(4)
        self.q = np.array([0.0, 0.0, 0.0, N / (KN * 4.0 * self.area), 0.0])

    def forces(self, q):
        x, y = self.at.T
        stretch = np.column_stack([q[0] - q[2] * y, q[1] + q[2] * x]) - self.slipped
        shear, normal = 0.4 * KN * self.area * stretch, KN * self.area * (q[3] + self.risen)
        size = np.linalg.norm(shear, axis=1) + 1e-300
        slip = np.maximum(size - MU * normal, 0.0) / (KN * self.area * (0.4 + MU * PSI))
        way = slip[:, None] * shear / size[:, None]
        return shear - 0.4 * KN * self.area * way, normal + KN * self.area * PSI * slip, way, slip

    def unbalanced(self, scaled, scale, u):
        q = scaled * scale
        shear, normal, _, _ = self.forces(q)
        moment = float((self.at[:, 0] * shear[:, 1] - self.at[:, 1] * shear[:, 0]).sum())
        lever = ARM[0] * DIRECTION[1] - ARM[1] * DIRECTION[0]
        sums = [*(shear.sum(axis=0) - q[4] * DIRECTION), (moment - q[4] * lever) / 0.1, normal.sum() - self.N]
        return np.array([*(np.array(sums) / self.N), (DIRECTION @ q[:2] + lever * q[2] - u) / scale[0]])

    def push(self, u: float) -> float:
        scale = np.array([1e-5, 1e-5, 1e-4, 1e-5, self.N])
        found = root(self.unbalanced, self.q / scale, args=(scale, u), tol=1e-12)
        assert np.abs(found.fun).max() < 1e-9
        self.q = found.x * scale
        _, _, way, slip = self.forces(self.q)
        self.slipped += way
        self.risen += PSI * slip
        return float(self.q[4])


def test_cycles_of_a_joint_that_dilates_as_it_turns(monkeypatch):
    """It dilates most where it slips most, and pressure grows there: V creeps along the plateau, by its path."""
    text = header("concave", MU, KN, keys=f"dilation = {PSI}\n")
    text += block("floor", (0.0, 0.0, -0.05), (*SIZE, 0.1), "fixed = true")
    text += block("stone", (0.0, 0.0, 0.5 * HEIGHT), (*SIZE, HEIGHT), 'held = ["rx", "ry"]')
    text += f'[[loads]]\nblock = "stone"\nforce = [0.0, 0.0, {-PRESSED}]\n' + jack(
        "stone", (*ARM.tolist(), 0.0), (*DIRECTION.tolist(), 0.0)
    )
    monkeypatch.setattr(driven_path, "EQUILIBRIA", 12)
    protocol = f"protocol = {TURNS.tolist()}\nlarge_displacements = true\n"
    found = dembrick.simulate(toml.loads(f'{text}[control]\nkind = "displacement"\n{protocol}'))
    corners = Corners(PRESSED + np.prod(SIZE) * HEIGHT * 2000.0 * 9.81)
    halves = []
    for begin, end in zip(TURNS[:-1], TURNS[1:], strict=True):
        V = [corners.push(u) for u in np.linspace(begin, end, 301)[1:]]
        halves.append(max(V, key=lambda force: force * np.sign(end - begin)))
    (cycle,) = found.cycles
    assert cycle["peak"] == pytest.approx(halves[1:3], rel=1e-4)
    assert all(
        low <= peak <= high for low, peak, high in zip(cycle["V_lower"], halves[1:3], cycle["V_upper"], strict=True)
    )
