"""Table that tilts, in the geometry of the start: from the blocks that its search knows to those on the table.

The search pushes the blocks by V = tan(psi) times their weight and leaves gravity as it is (`assembly.load_system`). So
all forces, and what springs give by them, are those of the table at psi over cos(psi) = 1 / sqrt(1 + V^2). Energies,
work along the path, are no multiple of the table's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_vector, turned_by

if TYPE_CHECKING:
    from dembrick.simulation.statics.load_system import Replay
    from dembrick.simulation.statics.state import State

FORCES = ("actuator_force", "reaction", "tension", "joint")
MOTIONS = ("displacement", "actuator_displacement", "control_point")
OF_FRAMES = ("displacement", "contact_force")


def cosine(load_factor) -> np.ndarray:
    """cos(psi) of tables at tan(psi) = ``load_factor``."""
    return 1.0 / np.hypot(1.0, load_factor)


def forces_on_table(rows: Mapping) -> dict:
    """Rows of a search, with the forces of the table."""
    return {**rows, **_shared(rows, FORCES, cosine(rows["load"]))}


def rows_on_table(rows: Mapping) -> dict:
    """Rows of a search, as the table has them."""
    return {**forces_on_table(rows), "energy": {}, **_shared(rows, MOTIONS, cosine(rows["load"]))}


def frames_on_table(frames: Mapping, load_factor: np.ndarray, start: np.ndarray) -> dict:
    """Frames of a search at these load factors (F,), as the table has them; ``start`` (n, 4): orientations of the
    blocks as they are drawn."""
    share = cosine(load_factor)
    turn = rotation_vector(quaternion_product(frames["orientation"], start * (1.0, -1.0, -1.0, -1.0)))
    turned = turned_by(share[:, None, None] * turn, np.broadcast_to(start, turn.shape[:-1] + (4,)))
    return {**frames, "orientation": turned, **_shared(frames, OF_FRAMES, share)}


def _shared(record: Mapping, names: tuple[str, ...], share: np.ndarray) -> dict:
    return {name: share.reshape(-1, *[1] * (record[name].ndim - 1)) * record[name] for name in names if name in record}


def on_table(replay: Replay) -> Replay:
    """A search that has ended, with what joints, supports and ties of the table carry at its limit, and how far the
    blocks went up to there."""
    point, state = replay.yield_point, replay.state
    share = float(cosine(_load_factor(state)))
    carried = {name: share * getattr(point, name) for name in ("N", "V_1", "V_2", "M_T", "displacement")}
    peak = float(cosine(point.V_peak)) * point.displacement_at_peak
    point = replace(point, **carried, displacement_at_peak=peak)
    moved = replay.moved
    if moved is not None:  # since the dead loads alone, which the level table carries
        moved = moved - (1.0 - share) * state.blocks.displacement
    return replace(replay, yield_point=point, state=_state_on_table(state, share), moved=moved)


def _load_factor(state: State) -> float:
    return float(state.actuators.driven[0].load)


def _state_on_table(state: State, share: float) -> State:
    """A ``state`` with the forces and the motion of the table; what its points remember is the search's."""
    blocks = state.blocks._replace(
        displacement=share * state.blocks.displacement,
        rotation=share * state.blocks.rotation,
        guide=share * state.blocks.guide,
    )
    joints = state.joints._replace(resultant=share * state.joints.resultant)
    ties = state.ties
    if ties is not None:
        ties = ties._replace(tension=share * ties.tension)
    return state._replace(blocks=blocks, joints=joints, ties=ties)
