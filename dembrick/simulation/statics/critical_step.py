"""The critical time step of central differences, including contacts, actuators and dashpots.

A spring of stiffness k on a mass m with a dashpot that adds beta times the spring force of the same increment is
stable while w^2 dt^2 (1 + 2 beta) <= 4, w^2 = k/m, because the dashpot acts half a step late. Rotation and its
coupling with translation are included: the stiffness of a block is a 6 x 6 matrix, and for a slender or eccentric
joint rocking governs, not translation.

Dashpots in proportion to the time step of the fastest block hardly damp a block a hundred times as
heavy, or on a joint a hundred times as soft, and steady sliding on point springs can then flutter: rocking changes the
friction of the points, which rocks the block. With physical inertia every joint and the actuator therefore get dashpots
for their own frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.statics import ties
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.stiffness import couplings, felt, summed

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

POWER_ITERATIONS = 30
DAMPING_RATIO = math.sqrt(0.125)  # of a block's fastest mode with physical inertia: a dashpot ratio of 1/2 at its step


def block_inertia(assembly: Assembly) -> np.ndarray:
    """Physical inertia (n, 6, 6) of every block about its centroid, world axes at the start."""
    n = len(assembly.names)
    inertia = np.zeros((n, 6, 6))
    inertia[:, [0, 1, 2], [0, 1, 2]] = np.asarray(assembly.mass)[:, None]
    rotation = assembly.rotation
    inertia[:, 3:, 3:] = rotation @ assembly.inertia @ np.swapaxes(rotation, 1, 2)
    return inertia


def greatest_frequency(state: State, inertia: np.ndarray, stiffness: np.ndarray) -> float:
    """Upper bound (rad/s) of the circular frequencies of the assembly with all joints closed and none slipping.

    ``inertia`` and ``stiffness`` (n, 6, 6) are those of every block alone, with its neighbours fixed. Exact for blocks
    that touch fixed blocks only; see :class:`_Coupled`.
    """
    lower = _inverse_factor(state, inertia)
    coupled = _Coupled.of(state, lower)
    return coupled.frequency(_greatest_eigenvalues(lower, stiffness))


@dataclass(frozen=True)
class _Coupled:
    """How joints couple free blocks: numbers (c,) of the ``joints``, of their blocks ``a`` and ``b``, and the
    ``norms`` (c,) of the scaled stiffness between them.

    The 6 x 6 blocks of the scaled stiffness are replaced by their norms: the spectral radius of that smaller,
    non-negative matrix N is never below the greatest eigenvalue, and for any positive vector x it is itself at most
    max (N x)_i / x_i (Collatz and Wielandt). A few power iterations bring x near its best; the bound is safe after
    each.
    """

    free: np.ndarray
    joints: np.ndarray
    a: np.ndarray
    b: np.ndarray
    norms: np.ndarray

    @classmethod
    def of(cls, state: State, lower: np.ndarray) -> _Coupled:
        """The couplings of a state, scaled by ``lower`` (n, 6, 6), see `_inverse_factor`."""
        joints, norms = [np.zeros(0, np.int64)], [np.zeros(0)]
        for some, blocks in couplings(state):
            a, b = state.joints.block_a[some], state.joints.block_b[some]
            scaled = lower[a] @ blocks @ np.swapaxes(lower[b], 1, 2)
            squares = np.linalg.eigvalsh(scaled @ np.swapaxes(scaled, 1, 2))[:, -1]
            joints.append(some)
            norms.append(np.sqrt(np.maximum(squares, 0.0)))
        every = np.concatenate(joints)
        a, b = state.joints.block_a[every], state.joints.block_b[every]
        return cls(state.blocks.free, every, a, b, np.concatenate(norms))

    def frequency(self, diagonal: np.ndarray, times: np.ndarray | None = None) -> float:
        """Bound (rad/s) of the frequencies of the assembly, given the greatest eigenvalue of each block alone (n,);
        ``times`` (j,) scales the joints."""
        diagonal = diagonal[self.free]
        if not len(self.joints):
            return math.sqrt(diagonal.max())
        norms = self.norms if times is None else self.norms * times[self.joints]
        number = np.zeros(max(self.a.max(), self.b.max(), self.free.max()) + 1, int)
        number[self.free] = np.arange(len(self.free))
        a, b = number[self.a], number[self.b]
        x = np.ones(len(diagonal))
        bound = np.inf
        for _ in range(POWER_ITERATIONS):
            y = diagonal * x
            np.add.at(y, a, norms * x[b])
            np.add.at(y, b, norms * x[a])
            bound = min(bound, float((y / x).max()))
            # the shift keeps x positive, and the iteration from oscillating between two halves of the graph
            x = y + bound * x
            x /= x.max()
        return math.sqrt(bound)


def _inverse_factor(state: State, inertia: np.ndarray) -> np.ndarray:
    """Inverse Cholesky factors (n, 6, 6) of the inertia of free blocks; zero for fixed ones."""
    lower, free = np.zeros_like(inertia), state.blocks.free
    lower[free] = np.linalg.inv(np.linalg.cholesky(inertia[free]))
    return lower


def _greatest_eigenvalues(lower: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Greatest eigenvalue (f,) of each block, ``lower`` being the inverse Cholesky factor of its inertia."""
    return np.linalg.eigvalsh(lower @ stiffness @ np.swapaxes(lower, 1, 2))[:, -1]


@dataclass(frozen=True)
class Dashpots:
    """Ratios of dashpots to springs as times (s), force = stiffness x time x velocity, and the critical time step
    (s)."""

    joints: np.ndarray
    actuator: float
    critical_time_step: float


def dashpots(state: State, inertia: np.ndarray, actuator: np.ndarray) -> Dashpots:
    """Dashpots for physical inertia (n, 6, 6), each with DAMPING_RATIO at the frequency at which it moves its blocks.

    That is the greatest of a block on this joint and the actuator alone; for the actuator, on it and all its joints.
    ``actuator`` (n, 6, 6) is the stiffness that the actuator adds to the loaded blocks. With springs K and dashpots C
    the scheme is stable while dt^2 k + 2 dt c <= 4 for any bounds k, c of the greatest eigenvalues of K and C against
    M.
    """
    joints, free = state.joints, state.blocks.free
    lower, alone = _inverse_factor(state, inertia), summed(state)
    moves = np.zeros(len(inertia), bool)
    moves[free] = True
    squares = np.zeros(len(joints.block_a))
    for some, block, felt_alone in felt(state):
        mine = np.flatnonzero(moves[block])
        own = felt_alone[mine] + actuator[block[mine]]
        squares[some[mine]] = np.maximum(squares[some[mine]], _greatest_eigenvalues(lower[block[mine]], own))
    times = 2.0 * DAMPING_RATIO / np.sqrt(np.where(squares > 0.0, squares, np.inf))
    loaded = state.actuators.block[moves[state.actuators.block]]
    square = _greatest_eigenvalues(lower[loaded], alone[loaded] + actuator[loaded]).max()
    actuator_time = 2.0 * DAMPING_RATIO / math.sqrt(square)
    coupled = _Coupled.of(state, lower)
    k = coupled.frequency(_greatest_eigenvalues(lower, alone + actuator + ties.bound(state))) ** 2
    damping = summed(state, times) + actuator * actuator_time
    c = coupled.frequency(_greatest_eigenvalues(lower, damping), times) ** 2
    return Dashpots(times, actuator_time, (math.sqrt(c * c + 4.0 * k) - c) / k)


def critical_time_step(frequency: float, viscous: float) -> float:
    """Greatest stable time step (s) for a greatest frequency (rad/s) and a dashpot ratio."""
    return 2.0 / (frequency * math.sqrt(1.0 + 2.0 * viscous))
