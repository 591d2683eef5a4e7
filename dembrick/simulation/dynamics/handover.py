"""What a stage left as the start of a run in real time or of a settlement: positions, and what joints remember."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by, unit_quaternion
from dembrick.kernels.dynamics.tiles import SEEN, VISCOUS
from dembrick.kernels.joint.ties import YIELDED
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.checkpoint import restore_scene
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.session import Kept

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.integrator import Motion
    from dembrick.simulation.statics.state import State


def start_on(moving: Motion, left: State | Kept) -> None:
    """Put the blocks where ``left`` has them, at rest, and give their joints its memory. Nothing has moved yet.

    A search or a quasi-static test leaves a `State`, a settlement the snapshot of its last equilibrium. Raises
    ScenarioError if the joints of both are not the same.
    """
    if isinstance(left, Kept):
        _go_on_from(moving, left)
    else:
        _take(moving, left)


def _go_on_from(moving: Motion, left: Kept) -> None:
    dashpots = moving.state.links.rows(VISCOUS, 2)  # of this run's time step and damping
    restore_scene(moving, left, met=True)
    moving.state.links.put(VISCOUS, dashpots)
    bodies = moving.state.bodies
    bodies.velocity[:], bodies.momentum[:], bodies.spin[:] = 0.0, 0.0, 0.0
    bodies.applied[:] = 0.0  # loads that act in this stage come with its first step
    bodies.start[:] = bodies.position
    moving.settled = True


def _take(moving: Motion, left: State) -> None:
    state = moving.state
    bodies, links = state.bodies, state.links
    same = len(left.joints.block_a) == len(links.host)
    same = same and joint_families.contact_points(state) == (0 if left.points is None else len(left.points.slip))
    if not same:
        raise ScenarioError(
            "the joints or contact points of the run in real time are not those of the stage before: state "
            "joint.points of distributed joints, and give blocks of several parts to stages of the same kind only"
        )
    bodies.position[:] += left.blocks.displacement
    bodies.orientation[:] = unit_quaternion(turned_by(left.blocks.rotation, left.blocks.orientation))
    bodies.rotation[:] = rotation_matrix(bodies.orientation)
    bodies.start[:] = bodies.position
    joint_families.take_memory(state, left)
    if left.ties is not None:
        state.ties.now[:, YIELDED] = left.ties.yielded
    links.put(SEEN, seen(bodies, links))
    links.kept[:] = links.seen[:, [0, 1, 3, 4]]
