"""Detection of collapse during relaxation on a path of equilibria, before blocks get too fast for the time step; and
the message on blocks that neither fall nor stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import DivergedError
from dembrick.scenario.checks import listed, show
from dembrick.simulation.dynamics.integrator import PressedTooDeep, in_shorter_steps
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.run import falls_by

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.paths.equilibria import EquilibriumPath

AS_DRAWN = "control.large_displacements = false gives the limit in the initial geometry"
IN_TIME = (
    "There may be no angle at which they fall: control.quasi_static = false, with a rate and a displacement, gives the "
    "angle at which they have moved that far"
)
SEEN_FALLING = 0.25  # of the time in which a block falls by its size: interval between checks for a collapse


def in_resolved_steps(
    path: EquilibriumPath, attempt: Callable[[], float | None], go_back: Callable[[], None]
) -> float | None:
    """Result of an ``attempt`` of a path, `in_shorter_steps` if necessary. Blocks that fall for long get too fast for a
    step or press into each other: the attempt is then repeated with frequent checks for a collapse."""
    path.often = math.inf
    try:
        return in_shorter_steps(path.moving, attempt, go_back)
    except (DivergedError, PressedTooDeep):
        go_back()
        path.often = SEEN_FALLING
        return in_shorter_steps(path.moving, attempt, go_back)


def falls_in(path: EquilibriumPath, driving: Driving, steps: int, before: np.ndarray) -> bool:
    """Advance a path by so many ``steps``; whether its blocks, whose `places` were ``before``, were seen to collapse.
    Checked at intervals of ``path.often`` times the time in which the smallest block falls by its size."""
    few = max(1, int(min(path.often * math.sqrt(2.0 * path.moving.smallest / falls_by(path.moving)) / path.dt, steps)))
    for done in range(0, steps, few):
        path.advance(driving, min(few, steps - done))
        if path.often < math.inf and path.down(before) > 1.0:
            path.record_collapse_frame(1.0)
            return True
    return False


def still_follows(path: EquilibriumPath) -> str:
    """Message on blocks that follow the load of a path without end, with the cause and a remedy."""
    follow = f"because blocks still follow {path.said(path.reached)}"
    found = f"undecided: no limit within {path.equilibria} equilibria, {follow}"
    pressed, moving = path.driving.pressed, path.moving
    ties = len(moving.state.ties.stiffness) > 0
    if not pressed.slope.any():
        return f"{found}; stiffen the {'ties or joints' if ties else 'joints'} on which they move"
    names = [moving.assembly.names[i] for i in np.unique(pressed.block[pressed.slope != 0.0])]
    on = listed([*map(show, names)])
    return (
        f"{found}: the pressure on {on} depends on the height of the faces, and so on how far they have moved. "
        f"{IN_TIME if path.control.kind == 'tilt' else AS_DRAWN}{'; or stiffen the ties' if ties else ''}"
    )
