"""Ties that stay, come and go as a run begins on what another has left."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.joint.ties import LENGTH, TENSION, YIELDED
from dembrick.scenario.stages import TiesBefore

if TYPE_CHECKING:
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.simulation.dynamics.state import MovingState
    from dembrick.simulation.session import Snapshot


def take_ties(state: MovingState, left: Snapshot, before: TiesBefore) -> None:
    """Give the ties of a state, whose blocks are in place, what a snapshot of the run before holds of them."""
    m = before.total
    now = left.array("ties.now", np.zeros((m, 3)))
    tie(state, now[:, YIELDED], left.array("ties.length", np.zeros(m)), before)
    old = np.array(before.of, np.int64)
    kept = old >= 0
    ties = state.ties
    for name, array in (("now", ties.now), ("before", ties.before), ("force", ties.force), ("arm", ties.arm)):
        found = left.array(f"ties.{name}", np.zeros((m, *array.shape[1:])))
        array[kept] = found[old[kept]]  # as of the last forces, which a step may lie behind


def tie(state: MovingState, yielded: np.ndarray, length: np.ndarray, before: TiesBefore) -> None:
    """Let ties of a state go on with what those before kept (m) and the lengths (m) with which they came; others come
    now, with the length that they have."""
    ties, bodies = state.ties, state.bodies
    if not len(ties.length):
        return
    old = np.array(before.of, np.int64)
    kept = old >= 0
    ties.arm[:] = np.einsum("teij,tej->tei", bodies.rotation[ties.block], ties.lever)
    line = bodies.position[ties.block[:, 1]] - bodies.position[ties.block[:, 0]] + ties.arm[:, 1] - ties.arm[:, 0]
    now = np.linalg.norm(line, axis=1)
    ties.length[:] = now
    ties.length[kept], ties.now[kept, YIELDED] = length[old[kept]], yielded[old[kept]]
    tension = ties.prestress + ties.stiffness * (now - ties.length - ties.now[:, YIELDED])
    ties.now[:, LENGTH], ties.now[:, TENSION] = now, np.clip(tension, ties.least, ties.strength)
    ties.before[:] = ties.now
    ties.force[:] = (ties.now[:, TENSION] / now)[:, None] * line


def ties_taken(left: Snapshot, before: TiesBefore, bodies: Bodies, dt: float) -> float:
    """Energy (J) that goes with the ties of a snapshot that do not stay: what they hold, and half of their work over
    the last step ``dt`` (s), which is that of the forces before and after it."""
    m = before.total
    gone = np.setdiff1d(np.arange(m), before.of)
    now, force = left.array("ties.now", np.zeros((m, 3)))[gone], left.array("ties.force", np.zeros((m, 3)))[gone]
    stiffness = left.array("ties.stiffness", np.zeros(m))[gone]
    block, arm = left.array("ties.block", np.zeros((m, 2), np.int64)), left.array("ties.arm", np.zeros((m, 2, 3)))
    stretched = _stretched(bodies, block[gone], arm[gone], dt)
    return float((0.5 * now[:, TENSION] ** 2 / stiffness).sum() + 0.5 * (force * stretched).sum())


def ties_given(state: MovingState, before: TiesBefore, dt: float) -> float:
    """Energy (J) that comes with the ties of a state that were not there: what they hold, less half of their work over
    the last step ``dt`` (s)."""
    ties, new = state.ties, np.array(before.of, np.int64) < 0
    held = 0.5 * ties.now[new, TENSION] ** 2 / ties.stiffness[new]
    return float(
        held.sum() - 0.5 * (ties.force[new] * _stretched(state.bodies, ties.block[new], ties.arm[new], dt)).sum()
    )


def _stretched(bodies: Bodies, block: np.ndarray, arm: np.ndarray, dt: float) -> np.ndarray:
    """How the lines (t, 3) between the ends of ties have changed in a step ``dt`` (m)."""
    end = bodies.velocity[block] + np.cross(bodies.spin[block], arm)
    return dt * (end[:, 1] - end[:, 0])
