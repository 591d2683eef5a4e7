"""The state at the limit of a search: motion and joint forces there, while the path may go on beyond it."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.load_bounds import at_joint
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.session import Prefixed, Snapshot
from dembrick.simulation.statics.paths.path_state import PathState
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, load_vectors

SAME = 1e-6  # of V: the load of an unchanged mechanism grows by no more than that
NEAR = 0.02  # of V: greatest shortfall of the equilibrium from which the next stage starts
_PREFIX, _REACHED = "limit.", "reached."


class LimitState:
    """The equilibrium of a path that is its limit so far: a copy of its ``state``, and its number in ``way.limit``.

    It is the one with the greatest certain load. Once the bracket is narrow enough, it is the equilibrium that made it
    so, until another carries more: a block that comes off later, at no greater load, is not part of the mechanism.

    With ``hands_on`` the first equilibrium with nearly that load is kept too (``reached``), as the start of another
    search: a rocking convex joint approaches its limit over metres.
    """

    def __init__(self, state: State, hands_on: bool):
        self.state = copy_of(state)
        self.reached = copy_of(state) if hands_on else None

    def look_at(self, state: State, way: PathState, judged: bool, within: float) -> None:
        """Keep the ``state`` of the last equilibrium if it is the limit; ``judged``: the bracket is narrow enough,
        ``within`` so much of V (relative)."""
        _, V, lower, *_ = way.seen[-1]
        sure = min(V, lower)
        if way.limit_found:
            better = sure > (1.0 + SAME) * way.limit_load
        else:
            better = sure > way.limit_load or (judged and sure >= (1.0 - within) * way.limit_load)
        way.limit_found = way.limit_found or judged
        if self.reached is not None and sure > (1.0 + NEAR) * way.reached_load:
            self.reached, way.reached_load = copy_of(state), sure
        if better:
            self.state, way.limit, way.limit_load = copy_of(state), way.equilibria, sure

    def record(self, recorder: Recorder | None, way: PathState) -> None:
        """Add the frame of the limit to the record, if it has none."""
        if recorder is not None and way.limit > way.framed:
            recorder.write_frame(self.state, way.limit)
            way.framed = way.limit

    def record_end(self, recorder: Recorder | None, state: State, way: PathState) -> None:
        """`record`, add the frame of the end of the path, and drain the recorder."""
        if recorder is None:
            return
        self.record(recorder, way)
        if way.equilibria > way.framed:
            recorder.write_frame(state, way.equilibria)
            way.framed = way.equilibria
        recorder.drain()

    def arrays(self) -> dict[str, np.ndarray]:
        """Named arrays for a checkpoint, not copied, as the states kept here never change."""
        kept = {_PREFIX: self.state} | ({} if self.reached is None else {_REACHED: self.reached})
        return {
            f"{prefix}{name}": array
            for prefix, state in kept.items()
            for name, array in flattened({"state": state}).items()
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Restore it from a snapshot of the same scene; HistoryError if it is of another."""
        self.state = restored_state(copy_of(self.state), Prefixed(snapshot, _PREFIX))
        if self.reached is not None:
            self.reached = restored_state(copy_of(self.reached), Prefixed(snapshot, _REACHED))


def copy_of(state):
    """Deep copy of a named tuple of arrays and of such tuples."""

    def own(value):
        if hasattr(value, "_asdict"):
            return copy_of(value)
        return value.copy() if isinstance(value, np.ndarray) else value

    return state._replace(**{name: own(value) for name, value in state._asdict().items()})


def carrying(state: State, V: float) -> State:
    """``state`` with its one joint in equilibrium with the dead loads and V (N), if that alone determines its forces.

    That holds for one free block on one joint without ties, in the geometry of the start; any other state is returned
    unchanged.
    """
    joints, free = state.joints, state.blocks.free
    if len(joints.block_a) != 1 or len(free) != 1 or state.ties is not None or len(state.blocks.guided):
        return state
    block, found = int(free[0]), np.zeros(6)
    on_b = block == joints.block_b[0]
    if not on_b and block != joints.block_a[0]:
        return state
    wrench = V * load_vectors(state)[block]
    wrench += np.concatenate([state.blocks.dead_force[block], state.blocks.dead_torque[block]])
    seen = joints if on_b else joints._replace(arm_b=joints.arm_a)
    at_joint(seen, 0, wrench, found)
    side = 1.0 if on_b else -1.0
    state = copy_of(state)
    state.joints.resultant[0, :6] = side * found[[2, 0, 1, 5, 3, 4]] * [-1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    return state
