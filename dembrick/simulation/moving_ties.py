"""Arrays of ties in moving geometry, for runs in real time and constant-rate tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.joint.ties import TIE, Ties

if TYPE_CHECKING:
    from dembrick.assembly.ties import TieTable


def moving_ties(table: TieTable, position: np.ndarray, rotation: np.ndarray) -> Ties:
    """The ties of a table as drawn, with blocks at a ``position`` (n, 3) m and a ``rotation`` (n, 3, 3)."""
    n = len(table)
    a, b = table.ends.block.T
    now = np.zeros(n, TIE)
    now["length"], now["tension"] = table.length, table.prestress
    return Ties(
        block=table.ends.block.copy(),
        lever=np.einsum("teji,tej->tei", rotation[table.ends.block], table.ends.arm),
        offset=position[b] - position[a],
        stiffness=table.stiffness.copy(),
        strength=table.strength.copy(),
        least=np.where(table.tension_only, 0.0, -table.strength),
        prestress=table.prestress.copy(),
        length=table.length.copy(),
        now=now,
        before=now.copy(),
        force=table.prestress[:, None] * table.direction,
        arm=table.ends.arm.copy(),
    )


def at_ends(ties: Ties, blocks: int) -> np.ndarray:
    """Forces and moments (n, 6) of the ties on so many ``blocks``, about their centroids: N and N m, world axes."""
    found = np.zeros((blocks, 6))
    if not len(ties.stiffness):
        return found
    for side, sense in ((0, 1.0), (1, -1.0)):
        couple = np.cross(ties.arm[:, side], ties.force)
        np.add.at(found, ties.block[:, side], sense * np.concatenate([ties.force, couple], axis=1))
    return found
