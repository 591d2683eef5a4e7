"""Key numbers of a shaken structure: whether it stood or fell, its drift, the displacement that remains."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

STOOD, FELL = "stood", "fell"


class Drift(NamedTuple):
    """The greatest displacement of a centroid at any row over its height above the foot of the free blocks, and of
    which ``block`` it is."""

    value: float
    block: str


def outcome(fallen: list[str], not_standing: list[str]) -> str:
    """In one word: it fell if any block has fallen at the end, or found no equilibrium under the dead loads."""
    return FELL if fallen or not_standing else STOOD


def drift(assembly: Assembly, furthest: np.ndarray) -> Drift | None:
    """The drift of a structure whose centroids went as far as ``furthest`` (n,) m; None without gravity, which alone
    says what is up."""
    weight = float(np.linalg.norm(assembly.gravity))
    free = np.flatnonzero(~np.asarray(assembly.fixed))
    if not (weight > 0.0 and len(free)):
        return None
    up = -np.asarray(assembly.gravity, float) / weight
    height = assembly.position[free] @ up
    corners = [(assembly.shapes[i].vertices @ assembly.rotation[i].T @ up).min() for i in free]
    foot = float((height + np.array(corners)).min())
    found = furthest[free] / (height - foot)
    most = int(np.argmax(found))
    return Drift(float(found[most]), assembly.names[free[most]])
