"""Collapse at the limit of a tilt or a pushover, from a search."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dembrick.runs.path_dependence import path_lines
from dembrick.scenario.checks import present
from dembrick.simulation.statics.load_system import Replay
from dembrick.simulation.statics.yield_point import mechanism_of, moving_blocks
from dembrick.views.summary import NO_BAR, angle_text, barred, known, limit_text, listed, on_one_path, outward, plain

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control


def collapse_of(run: Replay, assembly: Assembly, control: Control) -> dict:
    """The object ``collapse`` of the JSON output.

    ``load_factor`` is V of the yield point, whose bracket is its own: of the limit, or of a peak on the way that lies
    above it; ``angle`` (deg) that of a table tilted so far and ``time`` (s) when it stands so at its rate, None without
    one; both None for a pushover. ``mechanism_load_factor`` is what the blocks still carry while they come down: a peak
    above it rests on forces locked into the joints, and so on the way they were loaded. ``displacement`` (m) is that of
    the block that has moved most since the dead-load equilibrium. It, the mechanism and the blocks are those at the
    limit.
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


def collapse_lines(collapse: dict, point: Mapping | None = None) -> list[str]:
    """Lines of the command line on it; ``point``: the yield point of a search, whose bracket is the error bar."""
    if "settlement" in collapse:
        return _settlement_lines(collapse)
    error, alone = collapse.get("error_estimate"), on_one_path(collapse)
    if point is not None:
        angle = "" if collapse["angle"] is None else f"{plain(angle_text(point, collapse).value)}, "
        factor = f"load factor {plain(str(limit_text(point, collapse, '')))}, by {collapse['mechanism']}"
        width = point["V_upper"] - point["V_lower"]
    else:
        width, value = error or 0.0, collapse["load_factor"]
        found = f"{value:.5g} ({NO_BAR})" if error is None else "{} (+- {})".format(*barred(value, error))
        factor = f"load factor {found}, by {collapse['mechanism']}"
        angle = ""
        if collapse["angle"] is not None:
            turned = math.degrees(width * math.cos(math.radians(collapse["angle"])) ** 2)  # angle = atan(factor)
            angle = f"{known(collapse['angle'], turned, 5)} deg, "
    lines = [f"collapse      {angle}{factor}", f"blocks        {listed(collapse['blocks'])}"]
    lines[1:1] = path_lines(collapse)
    if collapse.get("onset") is not None:  # of a table that turns in real time
        lines[0] = f"collapse      a block has moved {1e3 * collapse['displacement']:.4g} mm at {angle}{factor}"
        lines.insert(0, f"onset         {collapse['onset']:.4g} deg: there the first block leaves its balance")
    after = collapse.get("mechanism_load_factor")
    if after is not None and after < collapse["load_factor"]:
        about = known(after, None if alone else width, 5)
        lines.insert(1, f"after a peak  load factor {about}; how high the peak is depends on the way there")
    return lines


def after_lines(after: Mapping | None, unit: str) -> list[str]:
    """Lines of the command line on the blocks that move on beyond the limit; ``unit`` of the load."""
    if after is None:
        return []
    moved = f"to {after['displacement']:.3g} m, by {after['mechanism']}"
    load = f"{after['load']:.3g}{unit}"
    return [f"after it      other blocks move: {listed(after['blocks'])}, {moved}, at {load}; --frame last shows it"]


def _settlement_lines(collapse: dict) -> list[str]:
    """The same where supports moved until the structure came down."""
    error, between, value = collapse["error_estimate"], collapse.get("settlement_range"), collapse["settlement"]
    bars = [] if between is None else ["between {} and {}".format(*outward(*between))]
    shown, bar = (f"{value:.5g}", NO_BAR) if error is None else barred(value, error)
    bars.append(bar if error is None else f"+- {bar} m")
    return [
        f"collapse      at a settlement of {shown} m ({', '.join(bars)}), by {collapse['mechanism']}",
        f"blocks        {listed(collapse['blocks'])}",
        f"hinges        {listed(collapse['hinges'])}",
    ]
