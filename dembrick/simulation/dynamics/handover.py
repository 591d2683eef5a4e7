"""State that a stage left, as the start of a run in real time or of a settlement: positions, memory of joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by, unit_quaternion
from dembrick.scenario.stages import TiesBefore
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.checkpoint import PARTS, restore_scene
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.dynamics.tie_handover import take_ties, tie
from dembrick.simulation.session import Kept

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.integrator import Motion
    from dembrick.simulation.statics.state import State

OTHER_JOINTS = (
    "the joints or contact points of the run in real time are not those of the stage before: state joint.points of "
    "distributed joints, and give blocks of several parts to stages of the same kind only"
)


def start_on(moving: Motion, left: State | Kept, before: TiesBefore | None = None) -> None:
    """Put the blocks where ``left`` has them, at rest, and give their joints its memory. Nothing has moved yet.

    A search or a quasi-static test leaves a `State`, a settlement the snapshot of its last equilibrium. ``before``:
    which of its ties stay. Raises ScenarioError if the joints of both are not the same.
    """
    if isinstance(left, Kept):
        _go_on_from(moving, left, before)
    else:
        _take(moving, left, before)


def _go_on_from(moving: Motion, left: Kept, before: TiesBefore | None) -> None:
    dashpots = moving.state.links.viscous  # of this run's time step and damping
    laws = joint_families.strengths(moving.state)
    try:
        restore_scene(moving, left, True, PARTS if before is None else [part for part in PARTS if part != "ties"])
    except HistoryError as error:  # of the same blocks, so what differs is how their joints were made
        raise ScenarioError(OTHER_JOINTS) from error
    joint_families.put_strengths(moving.state, laws)
    if before is not None:
        take_ties(moving.state, left, before)
    moving.state.links.put("viscous", dashpots)
    bodies = moving.state.bodies
    bodies.velocity[:], bodies.momentum[:], bodies.spin[:] = 0.0, 0.0, 0.0
    bodies.applied[:] = 0.0  # loads that act in this stage come with its first step
    bodies.start[:] = bodies.position
    moving.settled = True


def _take(moving: Motion, left: State, before: TiesBefore | None) -> None:
    state = moving.state
    bodies, links = state.bodies, state.links
    same = len(left.joints.block_a) == len(links.host)
    same = same and joint_families.contact_points(state) == (0 if left.points is None else len(left.points.slip))
    if not same:
        raise ScenarioError(OTHER_JOINTS)
    bodies.position[:] += left.blocks.displacement
    bodies.orientation[:] = unit_quaternion(turned_by(left.blocks.rotation, left.blocks.orientation))
    bodies.rotation[:] = rotation_matrix(bodies.orientation)
    bodies.start[:] = bodies.position
    joint_families.take_memory(state, left)
    yielded, rest = (np.zeros(0), np.zeros(0)) if left.ties is None else (left.ties.yielded, left.ties.rest)
    whole = TiesBefore(len(yielded), tuple(range(len(yielded)))) if before is None else before
    drawn = np.zeros(len(yielded))
    kept = [k >= 0 for k in whole.of]
    drawn[[k for k in whole.of if k >= 0]] = state.ties.length[kept]
    tie(state, yielded, drawn + rest, whole)
    links.put_seen(seen(bodies, links))
    links.kept[:] = links.seen[:, [0, 1, 3, 4]]
