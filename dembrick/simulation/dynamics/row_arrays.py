"""Arrays for the rows of a run in real time, and the scene from which they are written."""

from __future__ import annotations

from collections.abc import Container
from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.dynamics.record import NEXT, ROW, Extremes, Pressing, Record, Scene, write_row
from dembrick.kernels.dynamics.row_energies import BALANCE
from dembrick.kernels.math.sums import room_for_halves
from dembrick.simulation.dynamics import joint_families

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.integrator import Motion


def record_of(moving: Motion, room: int, channels: Container[str] = (), balanced: bool = False, frames: bool = False):
    """A `Record` with ``room`` for so many rows of the ``channels`` of an output, with energies if ``balanced``, and
    with ``frames``."""
    state, assembly, watched = moving.state, moving.assembly, moving.assembly.control_points
    n, j, w, t = len(assembly.names), len(state.links.host), len(watched.names), len(state.ties.stiffness)
    supporting = assembly.supporting
    s, joints = int(np.count_nonzero(supporting)), j if "joints" in channels else 0
    framed = room if frames else 0
    return Record(
        next=np.array([(0, 0, np.inf, np.inf)], NEXT),
        travel=moving.travel,
        count=np.zeros(2, np.int64),
        step=np.zeros(room, np.int64),
        row=np.zeros(room, ROW),
        joint=np.zeros((room, joints, 7)),
        support=np.where(supporting, np.cumsum(supporting) - 1, -1),
        reaction=np.zeros((room, s, 6)),
        middle=state.middle,
        tension=np.zeros((room, t)),
        yielded=np.zeros((room, t)),
        watched=np.asarray(watched.at.block, np.int64),
        place=np.zeros((room, w, 3)),
        turn=np.zeros((room, w, 3, 3)),
        energy=np.zeros(room if balanced else 0, BALANCE),
        energy_start=moving.energy.start,
        frame_step=np.zeros(framed, np.int64),
        frame_position=np.zeros((framed, n, 3)),
        frame_orientation=np.zeros((framed, n, 4)),
        frame_shift=np.zeros((framed, joints, 2)),
        shift=moving.polygons.shift,
        held=np.zeros((len(joint_families.convex_joints(state)), 3)),
        of_joints=np.zeros(j),
        pulled=np.zeros((s, 6)),
        halves=room_for_halves(),
    )


def bytes_of_row(record: Record) -> int:
    """Memory of a row and its frame in a record."""
    fields = ("step", "row", "joint", "reaction", "tension", "yielded", "place", "turn", "energy", "frame_position",
              "frame_orientation", "frame_shift")  # fmt: skip
    return sum(getattr(record, name).nbytes for name in fields) // len(record.step)


def scene_of(moving: Motion) -> Scene:
    """The present state in the form from which a row is written."""
    state, touching = moving.state, moving.contact_detection.touching
    new = moving.no_contacts if touching is None else touching
    forces = new.parts.owner, new.first, new.second, new.normal, new.point, new.force, new.torque
    springs = joint_families.springs(state, moving.energy.wanted)
    return Scene(state.bodies, state.links, *springs, state.ties, Pressing(*forces), moving.energy.table)


def reactions(moving: Motion) -> np.ndarray:
    """Present reactions of the supports (s, 6), see `write_reactions`, by the kernel that writes all rows."""
    record, none = record_of(moving, 1), Extremes(*(np.zeros(shape) for shape in (0, 0, (1, 3), 0, 0, 1, (0, 4))))
    write_row(record, scene_of(moving), none, (moving.steps, moving.time_step, 0.0, 0.0, 0.0))
    return record.reaction[0]
