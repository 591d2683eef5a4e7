"""Dependence of a limit load on the load path: whether another path may bear more, and whether one may bear less.

**More.** For a mechanism u along the load f, joint forces in equilibrium with the dead load g and V f give
V f . u = -g . u - (power of the joints on the blocks). At a contact point that power is N u_n + T . u_t, which
by Coulomb's cone |T| <= mu N is not negative if u_n >= mu |u_t|. Then V f . u <= -g . u on every path. This must
hold at all points that touch, loaded on this path or not: a prestress may load points that only graze their
neighbour here. Bonds and ties add the greatest power that their strength can dissipate.

**Less.** In a chain or tree of joints without closed loops, statics alone gives the forces of every joint under a load,
and normal springs without memory give its pressures. Then the load at which a joint fails does not depend on history.

`FrictionReserve` measures how much of its friction each joint uses along a path, and extrapolates that to greater
loads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.simulation.joint_laws import has_strengths
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.state import State, load_vectors
from dembrick.simulation.statics.stiffness import to_joint

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.simulation.statics.state import State


RESTS = 1e-3  # of the greatest relative motion at a contact point: slip beyond dilatancy that is neglected


def greatest_on_any_path(state: State) -> float:
    """V (N) that no path exceeds, by the mechanism of the last step and normality; infinite if it slides without the
    dilatancy that normality requires, or stretches a tie that never yields."""
    blocks, free = state.blocks, state.blocks.free
    motion = np.concatenate([blocks.velocity, blocks.spin], axis=1)
    along = float((load_vectors(state)[free] * motion[free]).sum())
    if not along > 0.0:
        return np.inf
    taken = _taken_by_joints(state, motion) + _taken_by_ties(state, motion)
    return (taken - float((ties.dead_loads(state)[free] * motion[free]).sum())) / along


def _taken_by_joints(state: State, motion: np.ndarray) -> float:
    """Greatest dissipation of the joints in the ``motion`` (n, 6) of the blocks, N m per step."""
    moved = _at_contacts(state, motion)
    if _not_dilatant(moved).any():
        return np.inf
    apart = np.maximum(moved.opening - moved.friction * moved.slip, 0.0)
    return float((moved.tension * apart + moved.cohesion * moved.slip).sum())


def grazing_joints(state: State) -> np.ndarray:
    """Numbers of the joints, loaded or not, that slide in the last step without opening as much as normality requires:
    the mechanism bears more if they are pressed together."""
    blocks = state.blocks
    moved = _at_contacts(state, np.concatenate([blocks.velocity, blocks.spin], axis=1))
    return np.unique(moved.joint[_not_dilatant(moved)])


class _Contacts(NamedTuple):
    """Contact points, or the corners of convex joints, in a mechanism (c,): their joints, opening and slip (m),
    friction, and the greatest tension and cohesion (N) of their bonds. Each corner has the whole bond of its joint,
    which is on the safe side for an upper bound."""

    joint: np.ndarray
    opening: np.ndarray
    slip: np.ndarray
    friction: np.ndarray
    tension: np.ndarray
    cohesion: np.ndarray


def _not_dilatant(moved: _Contacts) -> np.ndarray:
    fastest = float(np.hypot(moved.opening, moved.slip).max(initial=0.0))
    return moved.friction * moved.slip - moved.opening > RESTS * fastest


def _at_contacts(state: State, motion: np.ndarray) -> _Contacts:
    """The contacts of all joints for the ``motion`` (n, 6) of the blocks."""
    joints = state.joints
    relative = np.einsum("jik,jk->ji", to_joint(joints.axes, joints.arm_b), motion[joints.block_b])
    relative -= np.einsum("jik,jk->ji", to_joint(joints.axes, joints.arm_a), motion[joints.block_a])
    found = [_of_family(module, own, relative[own.joint]) for module, own in joint_families.present(state)]
    return _Contacts(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _of_family(module, own, relative: np.ndarray) -> _Contacts:
    """The contacts of joints of a family that move by ``relative`` (p, 6)."""
    counts = np.diff(own.start)
    d_1, d_2, d_n, r_1, r_2, r_n = np.repeat(relative, counts, axis=0).T
    (x, y), (x_s, y_s) = module.corners(own), module.shear_corners(own)
    opening, slip = d_n + y * r_1 - x * r_2, np.hypot(d_1 - r_n * y_s, d_2 + r_n * x_s)
    tension = cohesion = np.zeros(len(x))
    if own.strengths is not None:
        area = own.bonds.area if hasattr(own.bonds, "area") else np.repeat(own.area, counts)
        tension = area * np.repeat(own.strengths.tension, counts)
        cohesion = area * np.repeat(own.strengths.cohesion, counts)
    return _Contacts(np.repeat(own.joint, counts), opening, slip, np.repeat(own.friction, counts), tension, cohesion)


def _taken_by_ties(state: State, motion: np.ndarray) -> float:
    """Greatest dissipation of the ties in the ``motion`` (n, 6) of the blocks, N m per step."""
    own = state.ties
    if own is None:
        return 0.0
    longer = np.einsum("tk,tk->t", own.seen_b[:, 2], motion[own.block_b])
    longer -= np.einsum("tk,tk->t", own.seen_a[:, 2], motion[own.block_a])
    longer[np.abs(longer) <= RESTS * np.abs(motion[:, :3]).max(initial=0.0)] = 0.0
    with np.errstate(invalid="ignore"):  # infinite strength times zero elongation
        taken = np.where(longer > 0.0, own.strength * longer, own.least * longer)
    return float(np.where(longer == 0.0, 0.0, taken).sum())


def statically_determinate(assembly: Assembly) -> bool:
    """Whether statics alone determines the forces of every joint, whatever the load history: the joints form no closed
    loop, there are no ties, and joints have friction alone, as bonds, first slip and crushing are irreversible."""
    joints = assembly.joints
    if len(assembly.ties) or has_strengths(joints.law):
        return False
    parent = np.arange(len(assembly.names))
    parent[assembly.fixed] = int(np.flatnonzero(assembly.fixed)[0]) if assembly.fixed.any() else 0

    def root(block: int) -> int:
        while parent[block] != block:
            block = parent[block]
        return block

    for a, b in zip(joints.block_a.tolist(), joints.block_b.tolist(), strict=True):
        one, other = root(a), root(b)
        if one == other:
            return False
        parent[one] = other
    return True


SURE = 0.98  # of the friction: joints that use less do not slide
NOTHING = 1e-6  # of the greatest normal force: smaller forces are neglected
SLIDES = 1e-6  # of the friction: joints with a smaller reserve slide already


class FrictionReserve:
    """The forces of the joints of a ``state`` at the last two equilibria of its path, to predict sliding.

    ``forces`` (2, j + 1, 4): N, V_1, V_2 (N) and M_T (N m), the earlier first; V (N) in the last row.
    """

    def __init__(self, state: State):
        # in a joint that crushes the strip is not one of elastic springs alone
        crushes = np.isfinite(joint_families.compressive_strength(state)).any()
        self._state, self._strips = state, joint_families.has_areas(state) and not crushes
        self._friction, self._cohesion = joint_families.friction(state), joint_families.cohesion_of_sliding(state)
        self._lever = joint_families.torsion_radius(state)
        self.forces = np.zeros((2, len(self._friction) + 1, 4))

    def note(self, V: float) -> None:
        """Store the forces of the present equilibrium at ``V``."""
        self.forces[0] = self.forces[1]
        self.forces[1, :-1], self.forces[1, -1] = self._state.joints.resultant[:, :4], V

    def rocks_on(self, V: float) -> bool:
        """Whether convex joints may rock on, on elastic strips, until the load is ``V`` (N): no further joint begins to
        slide.

        While one mechanism rocks, joint forces are linear in V; those of a single joint follow from statics.
        """
        if not self._strips:
            return False
        forces, (before, now) = self.forces[:, :-1], self.forces[:, -1, 0]
        if V <= now:
            return True
        if not now > before:
            return False
        there = forces[1] + (V - now) / (now - before) * (forces[1] - forces[0])
        slid = (self._slid(forces) >= (1.0 - SLIDES) * self._strength(forces)).all(axis=0)
        taken = self._slid(there) + np.abs(there[:, 3]) / self._lever
        nothing = NOTHING * there[:, 0].max()
        return bool((slid | (taken <= np.maximum(SURE * self._strength(there), nothing))).all())

    def _slid(self, forces: np.ndarray) -> np.ndarray:
        """Shear force (.., j) in N."""
        return np.hypot(forces[..., 1], forces[..., 2])

    def _strength(self, forces: np.ndarray) -> np.ndarray:
        """Friction and residual cohesion (.., j) in N."""
        return self._friction * np.maximum(forces[..., 0], 0.0) + self._cohesion
