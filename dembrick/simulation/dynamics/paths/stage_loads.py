"""Equilibrium in the deformed geometry under the laws and loads of a new stage, applied in increments.

During relaxation joint laws act as in one implicit step from the last equilibrium (`kernels.dynamics.law_memory`), so
new loads are applied in increments (`load_increments`). The part that is still to come is cancelled by a force and a
couple on every block: that share of the out-of-balance that the new loads cause at the last equilibrium.

The joint laws of a stage hold from its beginning. Forces that joints may no longer bear are let go in increments too,
under the loads of the stage before; bonds that these overload break. Only then do the loads come.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import Attached
from dembrick.errors import UndecidedError
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.simulation import load_increments
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.dead_load import held_bonds, stuck
from dembrick.simulation.dynamics.integrator import Motion, joint_forces, update_history_at_rest
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.state import out_of_balance

if TYPE_CHECKING:
    from dembrick.kernels.joint.ties import Ties
    from dembrick.simulation.dynamics.paths.equilibria import EquilibriumPath
    from dembrick.simulation.session import Kept


LITTLE = 2.5e-4  # of the greatest force on a block: smaller new loads on it need no increments, as from small rotations
NOTHING = 1e-6  # of the forces of new loads: smaller joint forces are rounding of the drawn positions
Wrenches = tuple[np.ndarray, np.ndarray]  # forces and torques (f, 3) on the free blocks


class PendingLoads:
    """Changes of a new stage that are still to come: ``shares`` of the forces that joints and ties lose by their laws,
    and of its new loads (both at first zero). ``on_others``: whether joints bear other loads already at the last
    equilibrium; ``lost`` and ``part``: the lost forces and the new loads on a block over the greatest force of a
    joint or tie on it there; ``breaks``: whether bonds are too weak for what they bear there. ``loads``: force and
    torque (f, 3) of the new loads on every free block, else the out-of-balance that they cause there; ``wait``: whether
    they are still to come at the end."""

    def __init__(self, moving: Motion, driving: Driving, loads: Wrenches | None = None, wait: bool = False):
        self.shares, bodies, state = (0.0, 0.0), moving.state.bodies, moving.state
        gravity = driving.forces(np.array([moving.time]), moving.time_step)[0][0]

        def unbalanced() -> Wrenches:
            joint_forces(moving, driving)
            force, torque = out_of_balance(state, gravity)
            return force[bodies.free], torque[bodies.free]

        bonds = joint_families.bonded(state)
        with held_bonds(moving):
            with stuck(moving), _unyielding(state.ties):
                whole = unbalanced()
            borne = load_increments.greatest_on_blocks(ends(moving), carried(moving), len(bodies.mass))[bodies.free]
            lost = tuple(now - before for now, before in zip(unbalanced(), whole, strict=True))
        joint_forces(moving, driving)
        self.breaks = bool((joint_families.bonded(state) < bonds).any())
        (at, self._lost), (same, self._force) = _cancelling(bodies, *lost), _cancelling(bodies, *(loads or whole))
        self._at = at.and_then(same)
        self.on_others = bool(borne.max(initial=0.0) > NOTHING * np.abs(self._force).max(initial=0.0))
        sizes = (np.abs(force).reshape(3, len(borne), 3).max(axis=(0, 2)) for force in (self._force, self._lost))
        shares = (np.where(size > 0.0, size / np.where(borne > 0.0, borne, 1e-300), 0.0) for size in sizes)
        self.part, self.lost = (float(share.max(initial=0.0)) for share in shares)
        self.lost = self.lost if self.lost > NOTHING else 0.0
        self.last = 1.0 if wait else 0.0

    @property
    def weakened(self) -> bool:
        """Whether joints are too weak for what they bear at the last equilibrium."""
        return self.lost > LITTLE or self.breaks

    def way(self, count: int) -> list[tuple[float, float]]:
        """The `shares` at the equilibria of a way of ``count`` increments: of lost forces, if there are any, and then
        of loads."""
        parts = [left / count for left in range(count - 1, -1, -1)]
        let_go = parts if self.lost > LITTLE else [0.0] if self.lost or self.breaks else []
        return [(part, 1.0) for part in let_go] + [(0.0, part) for part in parts if not self.last]

    def held_off(self, driving: Driving) -> Driving:
        """``driving`` without the shares that are still to come."""
        if not any(self.shares):
            return driving
        own = len(driving.factor)  # number of loads; the rows of actuators follow them
        to_let_go, to_come = self.shares
        force = np.concatenate([to_let_go * self._lost, to_come * self._force])
        return replace(
            driving,
            at=driving.at[:own].and_then(self._at).and_then(driving.at[own:]),
            force=np.concatenate([driving.force[:own], force, driving.force[own:]]),
            factor=(*driving.factor, *(None,) * len(force)),
        )


@contextmanager
def _unyielding(ties: Ties) -> Iterator[None]:
    """Context in which no tie yields: what a tie loses by a lower strength is let go with what joints lose."""
    strength, least = ties.strength.copy(), ties.least.copy()
    ties.strength[:], ties.least[least < 0.0] = math.inf, -math.inf
    try:
        yield
    finally:
        ties.strength[:], ties.least[:] = strength, least


def _cancelling(bodies: Bodies, force: np.ndarray, torque: np.ndarray) -> tuple[Attached, np.ndarray]:
    """Points of the free blocks, and forces at them (k, 3) that balance a ``force`` and a ``torque`` (f, 3) on each."""
    arm = np.cross(torque, np.eye(3)[np.abs(torque).argmin(axis=1)])  # across the couple, and so at right angles
    length = np.linalg.norm(arm, axis=1, keepdims=True)
    arm = np.divide(arm, length, out=np.zeros_like(arm), where=length > 0.0)
    couple = -0.5 * np.cross(torque, arm)
    block, arms = np.tile(bodies.free.astype(np.int64), 3), np.concatenate([0.0 * arm, arm, -arm])
    at = Attached(block, arms, np.einsum("kji,kj->ki", bodies.rotation[block], arms))
    return at, np.concatenate([-force, couple, -couple])


def rest_by_increments(
    path: EquilibriumPath, kept: Kept, still: Callable[[], Driving], rest: Callable[[], float | None]
) -> float | None:
    """Relax the blocks of a path (``rest``) from the state ``kept`` under the constant loads ``still``, in increments;
    return the out-of-balance over the joint forces, None if they collapse. Loads applied at once could topple blocks
    that stand under them, and swing joints open, whose history is then lost.
    """
    moving = path.moving
    path.to_come = to_come = PendingLoads(moving, still(), path.new_loads, path.loads_wait)

    def go_back() -> None:
        to_come.shares = 0.0, 0.0
        moving.energy.fit(still().n_load, len(still().supports))
        path.past.go_back(kept)

    if to_come.breaks:
        go_back()
    if not to_come.on_others:
        path.path_error = math.inf  # blocks that fall onto one another swing open
        return rest()
    slip, bonds, ratio = slip_path(moving), joint_families.bonds(moving.state), 1.0  # type: float, np.ndarray, float | None

    def gave_way() -> bool:
        return slip_path(moving) != slip or bool((joint_families.bonds(moving.state) < bonds).any())

    def at(shares: tuple[float, float]) -> float | None:
        to_come.shares = shares
        moving.state.bodies.applied[:] = 0.0  # loads that still act add theirs again, removed ones leave nothing
        return rest()

    if to_come.part + to_come.lost <= LITTLE and not to_come.breaks:
        to_come.shares = 0.0, to_come.last
        ratio = rest()
        if ratio is not None:
            update_history_at_rest(moving, still())
        path.path_error = 2.0 * (to_come.part + to_come.lost) if gave_way() else 0.0
        return ratio
    falls_before = False

    def go(count: int) -> bool | None:
        nonlocal ratio, falls_before
        go_back()
        for shares in to_come.way(count):
            early, falls_before = gave_way(), shares[1] == 1.0
            try:
                ratio = at(shares)
            except UndecidedError:
                if not falls_before:
                    raise
                ratio = None
            if ratio is None:
                to_come.shares = 0.0, 0.0
                return None
            update_history_at_rest(moving, still())
        return early

    def scale(forces: np.ndarray) -> np.ndarray:
        return load_increments.on_less_loaded(ends(moving), forces, np.asarray(moving.assembly.fixed))

    path.increments, path.path_error = load_increments.by_increments(
        go, lambda: carried(moving), scale, gave_way, gave_way, one_step=False
    )
    if ratio is None and path.loads_wait:
        return None
    if ratio is None and falls_before:  # the loads of before cannot be borne any more, but those of now perhaps can
        go_back()
        ratio, path.increments, path.path_error = at((0.0, 0.0)), 1, math.inf
    elif to_come.lost <= LITTLE:
        path.path_error += 2.0 * to_come.lost
    if ratio is not None:
        load_increments.report_error(path.session.report, path.increments, path.path_error, falls_before)
    return ratio


def slip_path(moving: Motion) -> float:
    """Sum of the slip paths of all joints and new contacts (m)."""
    corners, faces, touching = moving.state.corners, moving.state.faces, moving.contact_detection.touching
    return math.fsum(float(part.slip.sum()) for part in (corners, faces, touching) if part is not None)


def carried(moving: Motion) -> np.ndarray:
    """Forces (j + t, 3) of the joints, and of the ties as (T, 0, 0), in N."""
    tension = moving.state.ties.now["tension"]
    return np.concatenate([moving.state.links.wrench[:, :3], tension[:, None] * np.eye(3)[0]])


def ends(moving: Motion) -> np.ndarray:
    """The blocks (2, j + t) between which these forces act."""
    links = moving.state.links
    return np.concatenate([np.stack([links.host, links.other]), moving.state.ties.block.T], axis=1).astype(np.int64)
