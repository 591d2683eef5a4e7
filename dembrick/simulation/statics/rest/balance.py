"""The out-of-balance of every block over the forces that act on it.

A light block beside a heavy one is in equilibrium only if what is out of balance is little of its own forces: little of
the greatest forces of the scene may be more than its weight.
"""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.newton import Trial
from dembrick.simulation.statics import elastic_factor, joint_families
from dembrick.simulation.statics.state import State

ROUNDED = 4.0 * float(np.finfo(float).eps)  # of the force that the motion of its blocks would cause in a closed joint
ROUGH = 1e-3  # of the forces of a block: with more that may be rounding, no equilibrium is known
FAINT = 1e-9  # of the greatest force on any block: less is none, in that comparison
BONDED = 1e-3  # of its strongest bond: reference force of a block without dead loads
NARROW = 1e-3  # of the lever of a joint: its least reach


class Balance:
    """Balance of the free blocks of a ``state``, whose ``trial`` gives reach and stiffness of the joints.

    The forces of a block are those of its joints and ties, and its dead load; a moment counts as the force that makes
    it at the reach of its joints. Forces that rounding of the motion of the blocks causes cannot be balanced. While
    ``shared`` is set, the greatest force of the scene counts as that of every block, as long as all of them move.
    """

    shared = False

    def __init__(self, state: State, trial: Trial):
        self._state, joints = state, state.joints
        bonds, reach = BONDED * joint_families.greatest_strength(state), trial.reach
        stiffness = np.einsum("jii->ji", trial.stiffness)[:, :3].max(axis=1)
        if state.ties is not None:
            none = np.zeros(len(state.ties.stiffness))
            bonds, reach = np.concatenate([bonds, none]), np.concatenate([reach, none])
            stiffness = np.concatenate([stiffness, state.ties.stiffness])
        self._stiffness = ROUNDED * stiffness
        ends = np.stack(elastic_factor.ends(state, joints.block_a, joints.block_b))[:, : len(stiffness)]
        seen = [matrices[: len(stiffness), :3, 3:].reshape(-1, 9) for matrices in (trial.seen_a, trial.seen_b)]
        self._ends, self._levers = ends, np.sqrt(0.5 * np.stack([(arm * arm).sum(axis=1) for arm in seen]))
        number = np.zeros(len(state.blocks.displacement), np.int64)
        number[state.blocks.free] = 1 + np.arange(len(state.blocks.free))
        ends = number[ends.ravel()]
        self._order = np.argsort(ends, kind="stable")
        self._held, self._first = np.unique(ends[self._order], return_index=True)
        self._one = self._order % max(1, len(stiffness))
        lever, self._bonds = self._greatest(self._levers), self._greatest(bonds)
        reach = np.maximum(self._greatest(reach), NARROW * lever)
        self._reach = np.where(reach > 0.0, reach, 1.0)  # m: a block without joints and ties only has dead loads
        self._further = np.maximum(1.0, lever / self._reach)

    def _greatest(self, values: np.ndarray) -> np.ndarray:
        """Greatest (f,) for every free block of ``values``, (e,) of joints and ties or (2, e) of their ends."""
        found = np.zeros(len(self._state.blocks.free) + 1)
        ordered = values[self._one] if values.ndim == 1 else values.ravel()[self._order]
        if len(self._held):
            found[self._held] = np.maximum.reduceat(ordered, self._first)
        return found[1:]

    def ratio(self, residual: np.ndarray) -> float:
        """The out-of-balance of the worst block over its forces, from forces and moments ``residual`` (f, 6) on the
        free blocks; 1 if it has no forces."""
        return self._worst(self.sizes(residual))

    def beyond_rounding(self, residual: np.ndarray) -> float:
        """`ratio` without the part that may be rounding, at most `ROUGH`: no equilibrium is known of a block that has
        moved so far that rounding may exceed its own forces."""
        own = self._own()
        most = ROUGH * np.maximum(own, FAINT * own.max())
        return self._worst(np.maximum(self.sizes(residual) - np.minimum(self._noise(), most), 0.0))

    def rounding(self) -> float:
        """`ratio` of the forces and moments that rounding may cause."""
        return self._worst(self._noise())

    def sizes(self, residual: np.ndarray) -> np.ndarray:
        """Sizes (2, f) in N of the forces and moments ``residual`` (f, 6) on the free blocks."""
        force, moment = np.sqrt((residual * residual).reshape(-1, 2, 3).sum(axis=2)).T
        return np.stack([force, moment / self._reach])

    def _worst(self, sizes: np.ndarray) -> float:
        own, worst = self._own(), np.maximum(*sizes)
        nothing = own == 0.0
        if nothing.any():
            own, worst = np.where(nothing, 1.0, own), np.where(nothing, worst > 0.0, worst)
        return float((worst / own).max())

    def _own(self) -> np.ndarray:
        """The greatest force (f,) on each free block: of a joint or tie, or its dead load; else a part of a bond."""
        blocks, ties = self._state.blocks, self._state.ties
        dead = (blocks.dead_force if ties is None else ties.dead[:, :3])[blocks.free]
        own = np.sqrt((dead * dead).sum(axis=1))
        carried = self._greatest(self._forces())
        own = np.maximum(np.where(own > 0.0, own, self._bonds), carried)
        return np.full_like(own, own.max()) if self.shared else own

    def _forces(self) -> np.ndarray:
        """Forces (e,) of joints and ties now."""
        carried, ties = self._state.joints.resultant[:, :3], self._state.ties
        forces = np.sqrt((carried * carried).sum(axis=1))
        return forces if ties is None else np.concatenate([forces, np.abs(ties.tension)])

    def _noise(self) -> np.ndarray:
        """Sizes (2, f) of forces and moments that rounding may cause."""
        blocks = self._state.blocks
        size = np.sqrt((np.stack([blocks.displacement, blocks.rotation]) ** 2).sum(axis=2))[:, self._ends]
        noise = self._greatest(self._stiffness * (size[0] + self._levers * size[1]).sum(axis=0))
        noise += ROUNDED * self._forces().max(initial=0.0)
        return np.stack([noise, noise * self._further])
