"""The words for how joints and assemblies give way, the same for searches and for limit analysis."""

from __future__ import annotations

import numpy as np

MOVED = 0.1  # of the fastest block: blocks that move faster belong to the mechanism
_PURE = 1e-7  # of the slip at the joint's rim: a part of the slip twist that is not there


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


def moving_blocks(speed: np.ndarray) -> np.ndarray:
    """The blocks (k,) of a mechanism in which blocks move at ``speed`` (n,)."""
    return np.flatnonzero(speed > MOVED * speed.max(initial=0.0))
