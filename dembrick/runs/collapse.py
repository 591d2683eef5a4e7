"""Collapse at the limit of a tilt or a pushover, from a search."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.scenario.checks import present
from dembrick.simulation.statics.load_system import Replay
from dembrick.simulation.statics.yield_point import mechanism_of, moving_blocks

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control


def collapse_of(run: Replay, assembly: Assembly, control: Control) -> dict:
    """The object ``collapse`` of the JSON output.

    ``load_factor`` is V of the yield point and shares its bracket: that of the limit, or of a higher peak on the path.
    ``angle`` (deg) is the tilt at that load factor, ``time`` (s) when the table reaches it at its rate, None without a
    rate; both are None for a pushover. ``mechanism_load_factor`` is the load that the blocks still carry during the
    collapse: a peak above it depends on forces locked into the joints, and so on the load path. ``displacement`` (m) is
    that of the block that has moved furthest since the dead-load equilibrium. Displacement, mechanism and blocks are
    those at the limit.
    """
    point = run.yield_point
    V, rate = present(point.V), control.rate
    angle = control.angle(V)
    return {
        "angle": angle,
        "load_factor": V,
        "mechanism_load_factor": V if point.V_after is None else point.V_after,
        "time": None if angle is None or rate is None else angle / rate,
        "displacement": float(np.linalg.norm(present(run.moved), axis=1).max()),
        "mechanism": point.mechanism if point.bracket == "certified" else mechanism_of(run.state),
        "blocks": [assembly.names[i] for i in moving_blocks(run.state)],
    }
