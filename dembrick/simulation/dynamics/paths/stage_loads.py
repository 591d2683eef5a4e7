"""Equilibrium in the deformed geometry under the loads of a new stage, applied in increments.

During relaxation joint laws act as in one implicit step from the last equilibrium (`kernels.dynamics.law_memory`), so
new loads are applied in increments (`load_increments`). The part that is still to come is cancelled by a force and a
couple on every block: that share of the out-of-balance that the new loads cause at the last equilibrium.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import Attached
from dembrick.simulation import load_increments
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.integrator import Motion, joint_forces, update_history_at_rest
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.state import out_of_balance

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.paths.equilibria import EquilibriumPath
    from dembrick.simulation.session import Kept


LITTLE = 2.5e-4  # of the greatest joint force: smaller new loads need no increments, such as those from small rotations
NOTHING = 1e-6  # of the forces of new loads: smaller joint forces are rounding of the drawn positions


class PendingLoads:
    """New loads of ``driving``, of which a ``share`` is still to come (at first zero). ``on_others``: whether joints
    bear other loads already at the last equilibrium; ``part``: the new loads over the greatest joint force there."""

    def __init__(self, moving: Motion, driving: Driving):
        joint_forces(moving, driving)
        bodies, self.share = moving.state.bodies, 0.0
        gravity = driving.forces(np.array([moving.time]), moving.time_step)[0][0]
        force, torque = (-part[bodies.free] for part in out_of_balance(moving.state, gravity))
        arm = np.cross(torque, np.eye(3)[np.abs(torque).argmin(axis=1)])  # across the couple, and so at right angles
        length = np.linalg.norm(arm, axis=1, keepdims=True)
        arm = np.divide(arm, length, out=np.zeros_like(arm), where=length > 0.0)
        couple = 0.5 * np.cross(torque, arm)
        block, arms = np.tile(bodies.free.astype(np.int64), 3), np.concatenate([0.0 * arm, arm, -arm])
        self._at = Attached(block, arms, np.einsum("kji,kj->ki", bodies.rotation[block], arms))
        self._force = np.concatenate([force, couple, -couple])
        borne = np.abs(moving.state.links.wrench[:, :3]).max(initial=0.0)
        greatest = float(np.abs(self._force).max(initial=0.0))
        self.on_others = bool(borne > NOTHING * greatest)
        self.part = greatest / borne if borne > 0.0 else math.inf

    def held_off(self, driving: Driving) -> Driving:
        """``driving`` without the share that is still to come."""
        if not self.share:
            return driving
        own = len(driving.factor)  # number of loads; the rows of actuators follow them
        share = self.share
        return replace(
            driving,
            at=driving.at[:own].and_then(self._at).and_then(driving.at[own:]),
            force=np.concatenate([driving.force[:own], self._force, driving.force[own:]]),
            factor=(*driving.factor, *(lambda times: np.full(len(times), share),) * len(self._force)),
        )


def rest_by_increments(
    path: EquilibriumPath, kept: Kept, still: Callable[[], Driving], rest: Callable[[], float | None]
) -> float | None:
    """Relax the blocks of a path (``rest``) from the state ``kept`` under the constant loads ``still``, in increments;
    return the out-of-balance over the joint forces, None if they collapse. Loads applied at once could topple blocks
    that stand under them, and swing joints open, whose history is then lost.
    """
    moving = path.moving
    path.to_come = to_come = PendingLoads(moving, still())
    if not to_come.on_others:
        path.path_error = math.inf  # blocks that fall onto one another swing open
        return rest()
    slip, bonds, ratio = slip_path(moving), joint_families.bonds(moving.state), 1.0  # type: float, np.ndarray, float | None

    def gave_way() -> bool:
        return slip_path(moving) != slip or bool((joint_families.bonds(moving.state) < bonds).any())

    if to_come.part <= LITTLE:
        ratio = rest()
        path.path_error = 2.0 * to_come.part if gave_way() else 0.0
        return ratio

    def go(count: int) -> bool | None:
        nonlocal ratio
        path.past.go_back(kept)
        for left in range(count - 1, -1, -1):
            to_come.share, early = left / count, gave_way()
            moving.state.bodies.applied[:] = 0.0  # loads that still act add theirs again, removed ones leave nothing
            ratio = rest()
            if ratio is None:
                to_come.share = 0.0
                return None
            update_history_at_rest(moving, still())
        return early

    path.increments, path.path_error = load_increments.by_increments(
        go, lambda: carried(moving), gave_way, gave_way, one_step=False
    )
    if ratio is not None:
        load_increments.report_error(path.session.report, path.increments, path.path_error)
    return ratio


def slip_path(moving: Motion) -> float:
    """Sum of the slip paths of all joints and new contacts (m)."""
    corners, faces, touching = moving.state.corners, moving.state.faces, moving.contact_detection.touching
    return math.fsum(float(part.slip.sum()) for part in (corners, faces, touching) if part is not None)


def carried(moving: Motion) -> np.ndarray:
    """Forces of the joints (3 j,) and tensions of the ties (N)."""
    return np.append(moving.state.links.wrench[:, :3], moving.state.ties.now["tension"])
