"""Ties in moving geometry, from the assembly to the arrays of the loops: runs in real time, constant-rate tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.joint.ties import LENGTH, TENSION, Ties

if TYPE_CHECKING:
    from dembrick.assembly.ties import TieTable


def moving_ties(table: TieTable, position: np.ndarray, rotation: np.ndarray) -> Ties:
    """The ties of a table as drawn, their blocks at a ``position`` (n, 3) m and a ``rotation`` (n, 3, 3)."""
    n = len(table)
    block = np.stack([table.block_a, table.block_b], axis=1)
    arm = np.stack([table.arm_a, table.arm_b], axis=1)
    now = np.zeros((n, 3))
    now[:, LENGTH], now[:, TENSION] = table.length, table.prestress
    return Ties(
        block=block,
        lever=np.einsum("teji,tej->tei", rotation[block], arm),
        offset=position[table.block_b] - position[table.block_a],
        stiffness=table.stiffness.copy(),
        strength=table.strength.copy(),
        least=np.where(table.tension_only, 0.0, -table.strength),
        prestress=table.prestress.copy(),
        length=table.length.copy(),
        now=now,
        before=now.copy(),
        force=table.prestress[:, None] * table.direction,
        arm=arm.copy(),
    )


def at_ends(ties: Ties, blocks: int) -> np.ndarray:
    """Forces and moments (n, 6) of the ties on every one of so many blocks, at its centroid: N and N m, world axes."""
    found = np.zeros((blocks, 6))
    if not len(ties.stiffness):
        return found
    for side, sense in ((0, 1.0), (1, -1.0)):
        couple = np.cross(ties.arm[:, side], ties.force)
        np.add.at(found, ties.block[:, side], sense * np.concatenate([ties.force, couple], axis=1))
    return found
