"""Tilting table in the geometry of the start: conversion of the results of a search to those of the table.

The search pushes the blocks by V = tan(psi) times their weight under constant gravity (`assembly.load_system`). So
all its forces and elastic displacements are those of the table at psi over cos(psi) = 1 / sqrt(1 + V^2). Displacements
of previous stages are not scaled, nor are slip paths, as no path gets shorter. Energies, work along the path, are not
proportional to those of the table and are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_matrix, rotation_vector, turned_by

if TYPE_CHECKING:
    from dembrick.assembly.actuators import ControlPoints
    from dembrick.simulation.statics.load_system import Replay
    from dembrick.simulation.statics.state import State

FORCES = ("actuator_force", "reaction", "tension")
DRIVEN = ("displacement", "actuator_displacement")


class Before(NamedTuple):
    """Displacements of blocks and control points when the table began to tilt, from the geometry as drawn."""

    displacement: np.ndarray  # (n, 3) m
    rotation: np.ndarray  # (n, 3) rad
    orientation: np.ndarray  # (n, 4) as they are drawn
    control_point: np.ndarray  # (w, 3) m

    @classmethod
    def of(cls, state: State, watched: ControlPoints, goes_on: bool) -> Before:
        """From a ``state`` that a previous run has left, if this one ``goes_on`` from it; else as drawn."""
        blocks = state.blocks
        displacement, rotation = goes_on * blocks.displacement, goes_on * blocks.rotation
        turned = rotation_matrix(turned_by(rotation, blocks.orientation))
        points = watched.displacement(displacement, turned)
        return cls(displacement, rotation, blocks.orientation.copy(), points)


def cosine(load_factor) -> np.ndarray:
    """cos(psi) of tables at tan(psi) = ``load_factor``."""
    return 1.0 / np.hypot(1.0, load_factor)


def forces_on_table(rows: Mapping) -> dict:
    """Rows of a search with the forces of the table."""
    found, share = dict(rows), cosine(rows["load"])
    found |= {name: _times(share, rows[name]) for name in FORCES if name in rows}
    if "joint" in rows:
        found["joint"] = rows["joint"].copy()
        found["joint"][..., :6] = _times(share, rows["joint"][..., :6])
    return found


def rows_on_table(rows: Mapping, before: Before) -> dict:
    """Rows of a search, converted to the table."""
    found, share = forces_on_table(rows) | {"energy": {}}, cosine(rows["load"])
    found |= {name: _times(share, rows[name]) for name in DRIVEN}
    if "control_point" in rows:
        found["control_point"] = _since(before.control_point, share, rows["control_point"])
    return found


def frames_on_table(frames: Mapping, load_factor: np.ndarray, before: Before) -> dict:
    """Frames of a search at these load factors (F,), converted to the table."""
    found, share = dict(frames), cosine(load_factor)
    found["displacement"] = _since(before.displacement, share, frames["displacement"])
    turn = rotation_vector(quaternion_product(frames["orientation"], before.orientation * (1.0, -1.0, -1.0, -1.0)))
    found["orientation"] = turned_by(_since(before.rotation, share, turn), before.orientation)
    if "contact_force" in frames:
        found["contact_force"] = _times(share, frames["contact_force"])
    return found


def _times(share: np.ndarray, values: np.ndarray) -> np.ndarray:
    """``values`` with each row multiplied by its ``share``."""
    return share.reshape(-1, *[1] * (values.ndim - 1)) * values


def _since(before: np.ndarray, share: np.ndarray, values: np.ndarray) -> np.ndarray:
    """``values`` whose change since ``before`` is multiplied by ``share``."""
    return before + _times(share, values - before)


def on_table(replay: Replay, displacement: np.ndarray, rotation: np.ndarray) -> Replay:
    """A finished search, with the forces and displacements converted to the table at its limit; ``displacement`` and
    ``rotation`` (n, 3): when the table began to tilt, see `Before`."""
    point, state, moved = replay.yield_point, replay.state, replay.moved
    share = float(cosine(float(state.actuators.driven[0].load)))
    carried = {name: share * getattr(point, name) for name in ("N", "V_1", "V_2", "M_T", "displacement")}
    peak = float(cosine(point.V_peak)) * point.displacement_at_peak
    point = replace(point, **carried, displacement_at_peak=peak)
    found = _state_on_table(state, share, displacement, rotation)
    if moved is not None:  # since the dead-load equilibrium, which is that of the level table
        moved = moved + (found.blocks.displacement - state.blocks.displacement)
    return replace(replay, yield_point=point, state=found, moved=moved)


def _state_on_table(state: State, share: float, displacement: np.ndarray, rotation: np.ndarray) -> State:
    """A ``state`` with the forces and the motion of the table; the history of its points is that of the search."""
    now, joints, ties = state.blocks, state.joints, state.ties
    blocks = now._replace(
        displacement=displacement + share * (now.displacement - displacement),
        rotation=rotation + share * (now.rotation - rotation),
        guide=share * now.guide,
    )
    joints = joints._replace(resultant=joints.resultant * (*[share] * 6, 1.0))
    if ties is not None:
        ties = ties._replace(tension=share * ties.tension)
    return state._replace(blocks=blocks, joints=joints, ties=ties)
