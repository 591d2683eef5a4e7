"""Names of the mechanisms of joints and assemblies, the same for searches and for limit analysis."""

from __future__ import annotations

import numpy as np

MOVED = 0.1  # of the fastest block: blocks that move faster belong to the mechanism
CARRIES_NOTHING = 1e-9  # of the heaviest block
_PURE = 1e-5  # of the slip at the joint's rim: smaller parts of the slip twist count as zero


def joint_mechanism(twist, tilt, reach: float) -> tuple[tuple[float, float] | None, str]:
    """Torsion centre (m, about O; None in pure shear) and name of a slip twist (v_1, v_2, w) with tilts (2,).

    ``reach`` is the greatest distance from O at which the joint carries shear (m).
    """
    shift, turn = float(np.hypot(twist[0], twist[1])), abs(float(twist[2])) * reach
    if float(np.hypot(*tilt)) * reach > max(shift, turn):
        return None, "rocking"
    if turn <= _PURE * shift:
        return None, "sliding"
    centre = (-float(twist[1] / twist[2]) + 0.0, float(twist[0] / twist[2]) + 0.0)
    return centre, "torsion" if shift <= _PURE * turn else "torsion-shear"


def assembly_mechanism(slid: np.ndarray, turned: np.ndarray, tilted: np.ndarray) -> str:
    """Name of the mechanism of an assembly, from how far the rims of its joints slid, turned about the normal and
    tilted (j,) in m."""
    most = (float(moves.max(initial=0.0)) for moves in (slid, tilted, turned))
    return max(zip(most, ("sliding", "rocking", "torsion"), strict=True))[1]


def crushes(closed: np.ndarray, strength: np.ndarray, *moves: np.ndarray) -> bool:
    """Whether the mechanism is crushing: joints with a compressive ``strength`` (j,) in Pa have ``closed`` (j,) at O
    by more than any rim has moved otherwise, ``moves`` (j,), all in m."""
    depth = float(closed[np.isfinite(strength)].max(initial=0.0))
    return depth > max(float(move.max(initial=0.0)) for move in moves)


def fastest_blocks(speed: np.ndarray) -> np.ndarray:
    """The blocks (k,) of a mechanism whose blocks move at ``speed`` (n,): at least a tenth as fast as the fastest."""
    return np.flatnonzero(speed > MOVED * speed.max(initial=0.0))


def nothing_between(moving: np.ndarray, ends, normal: np.ndarray, weight: float) -> bool:
    """Whether the moving blocks have lost contact with those at rest: no joint between the two carries a force.

    ``moving`` (k,) block numbers; ``ends``: the two blocks of every joint (j,); ``normal`` (j,) N; ``weight`` (N) of
    the heaviest block.
    """
    among = [np.isin(block, moving) for block in ends]
    between = among[0] != among[1]
    return bool(len(moving) and (normal[between] <= CARRIES_NOTHING * weight).all())
