"""All arrays that a search or a constant-rate test changes, as one argument of the kernels."""

from typing import NamedTuple

from dembrick.kernels.joint.ties import Ties
from dembrick.kernels.state import Actuators, Blocks, Joints
from dembrick.kernels.statics.area_joints import Areas
from dembrick.kernels.statics.point_joints import Points


class State(NamedTuple):
    """State of an assembly for kernels, made of `simulation.statics.state.State`; ``points`` or ``areas`` is None if no
    joint is of that family, ``ties`` if there are none, or if their forces are among the dead loads."""

    blocks: Blocks
    joints: Joints
    points: Points | None
    areas: Areas | None
    actuators: Actuators
    ties: Ties | None
