"""What a replay writes down: rows of history and frames of motion, into arrays given to it."""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.forces import unbalanced_ratio
from dembrick.kernels.vec3 import turned


class Record(NamedTuple):
    """Rows and frames written by the loop."""

    every: ndarray  # (2,) int64, steps between rows, between frames
    count: ndarray  # (2,) int64, rows, frames so far
    row: ndarray  # (r, 6) time, load, displacement, unbalanced, lower, upper
    actuator: ndarray  # (r, k) m
    joint: ndarray  # (r, j, 7)
    energy: ndarray  # (r, 6) J, see `energy.balance`
    frame_time: ndarray  # (F,)
    frame_displacement: ndarray  # (F, n, 3)
    frame_orientation: ndarray  # (F, n, 4)


@jit
def write_row(record, time, blocks, joints, jacks, lower, upper):
    """Add a row to the record, with a frame where one is due; False when the record is full."""
    row = record.count[0]
    if row >= record.row.shape[0]:
        return False
    record.row[row, 0] = time
    record.row[row, 1] = jacks.drive[2]
    record.row[row, 2] = jacks.drive[1]
    record.row[row, 3] = unbalanced_ratio(blocks, joints)
    record.row[row, 4] = lower
    record.row[row, 5] = upper
    for i in range(jacks.block.size):
        record.actuator[row, i] = jacks.displacement[i]
    for j in range(joints.resultant.shape[0]):
        for i in range(7):
            record.joint[row, j, i] = joints.resultant[j, i]
    record.count[0] = row + 1
    if row % record.every[1] == 0 and record.count[1] < record.frame_time.size:
        frame = record.count[1]
        record.frame_time[frame] = time
        for b in range(blocks.displacement.shape[0]):
            q = turned(blocks.orientation, b, blocks.rotation[b, 0], blocks.rotation[b, 1], blocks.rotation[b, 2])
            for i in range(3):
                record.frame_displacement[frame, b, i] = blocks.displacement[b, i]
            for i in range(4):
                record.frame_orientation[frame, b, i] = q[i]
        record.count[1] = frame + 1
    return True
