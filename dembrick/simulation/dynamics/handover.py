"""What a search or a quasi-static test left as the start of a run in real time: positions, and what joints remember."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by, unit_quaternion
from dembrick.kernels.dynamics.tiles import SEEN
from dembrick.kernels.joint.ties import YIELDED
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.state import seen

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.integrator import Motion
    from dembrick.simulation.statics.state import State


def start_on(moving: Motion, left: State) -> None:
    """Put the blocks where ``left`` has them, at rest, and give their joints its memory. Nothing has moved yet.

    Raises ScenarioError if the joints of both are not the same.
    """
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
