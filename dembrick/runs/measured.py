"""Whether a measured curve can be compared with a simulated one, and if not, why: signs, order and units of its points.

Curves are force over displacement, as of `dembrick.views.misfit`, whose own refusals come last and know no reason.
"""

from __future__ import annotations

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.protocols import turning_points
from dembrick.views.misfit import BACK, Curve


def require_comparable(simulated: Curve, measured: Curve, name: str) -> None:
    """ScenarioError, with what to do, if the displacements of a measured curve cannot be those of the simulated one."""
    ours, theirs = np.asarray(simulated.displacement, float), np.asarray(measured.displacement, float)
    size = np.abs(theirs).max(initial=0.0)
    if not size > 0.0 or not np.ptp(ours) > 0.0 or not np.ptp(theirs) > 0.0:
        return  # said elsewhere
    if theirs.max() <= BACK * size and ours.min() >= -BACK * np.abs(ours).max():
        raise ScenarioError(
            f"the displacements of {name} are negative ({_range(theirs)}), and those of the run are not; turn the "
            "signs of its columns, or the direction of the actuator"
        )
    if turns(ours) < turns(theirs) and (np.maximum.accumulate(theirs) - theirs).max() > BACK * np.ptp(theirs):
        raise ScenarioError(
            f"{name} goes to and fro, and the run turns less often; if it was measured one way, sort its lines by "
            "displacement, else give the envelope of its loops, or their turning points as control.protocol"
        )
    slack = (BACK if turns(ours) else 1e-9) * np.ptp(ours)
    inside = int(((theirs >= ours.min() - slack) & (theirs <= ours.max() + slack)).sum())
    if inside < 2:
        raise ScenarioError(
            f"{inside or 'none'} of the {len(theirs)} points of {name} ({_range(theirs)}) "
            f"{'lies' if inside == 1 else 'lie'} where the run goes ({_range(ours)}), and 2 are needed; is the unit of "
            "its displacement right?"
        )


def turns(displacement: np.ndarray) -> int:
    """How often a curve turns."""
    return len(turning_points(displacement)) - 2 if np.ptp(displacement) > 0.0 else 0


def _range(displacement: np.ndarray) -> str:
    """From where to where, in mm; rounding beside its size is none."""
    low, high = (1e3 * float(end) for end in (displacement.min(), displacement.max()))
    least = 1e-9 * max(abs(low), abs(high))
    return " to ".join(f"{end if abs(end) > least else 0.0:.4g}" for end in (low, high)) + " mm"
