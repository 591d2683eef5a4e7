"""What a search for the limit of a tilt or a pushover says of the collapse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.scenario.checks import present
from dembrick.simulation.statics.load_system import Replay
from dembrick.simulation.statics.yield_point import mechanism_of, moving_blocks, slides

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control

NAMED = 5  # blocks that a line names


def collapse_of(run: Replay, assembly: Assembly, control: Control) -> dict:
    """The object ``collapse`` of the JSON output.

    ``load_factor`` is V of the yield point, whose bracket is its own: of the limit, or of a peak on the way that lies
    above it; ``angle`` (deg) that of a table tilted so far and ``time`` (s) when it stands so at its rate, None without
    one; both None for a pushover. ``mechanism_load_factor`` is what the blocks still carry while they come down: a peak
    above it rests on forces locked into the joints, and so on the way they were loaded. ``displacement`` (m) is that of
    the block that has moved most since it was seated. With a refined run come ``path_range``, the load factors that
    other stiffness ratios and steps lead to, ``paths``, of which so many found a limit, and ``error_estimate``, how far
    the range goes. ``slides``: joints slide in the mechanism, so that the limit depends on the path.
    """
    point = run.yield_point
    V, rate = present(point.V), getattr(control, "rate", None)
    angle = control.angle(V)
    return {
        "angle": angle,
        "load_factor": V,
        "mechanism_load_factor": V if point.V_after is None else point.V_after,
        "time": None if angle is None or rate is None else angle / rate,
        "displacement": float(np.linalg.norm(present(run.moved), axis=1).max()),
        "mechanism": mechanism_of(run.state),
        "blocks": [assembly.names[i] for i in moving_blocks(run.state)],
        "slides": slides(run.state),
        "path_range": None,
        "error_estimate": None,
    }


def listed(names: list[str]) -> str:
    """Names in a line, the first few of many."""
    more = len(names) - NAMED
    return f"{', '.join(names[:NAMED])}{f' and {more} more' if more > 0 else ''}"


def collapse_lines(collapse: dict) -> list[str]:
    """What the command line prints of it."""
    error = collapse["error_estimate"]
    bar = "no error bar: --refine gives one" if error is None else f"+- {error:.2g}"
    factor = f"load factor {collapse['load_factor']:.5g} ({bar}), by {collapse['mechanism']}"
    angle = "" if collapse["angle"] is None else f"{collapse['angle']:.5g} deg, "
    lines = [f"collapse      {angle}{factor}", f"blocks        {listed(collapse['blocks'])}"]
    if collapse.get("onset") is not None:  # of a table that turns in real time
        lines[0] = f"collapse      a block has moved {1e3 * collapse['displacement']:.4g} mm at {angle}{factor}"
        lines.insert(0, f"onset         {collapse['onset']:.4g} deg: there the first block leaves its balance")
    after = collapse.get("mechanism_load_factor")
    if collapse.get("path_range") is not None:
        (low, high), (found, tried) = collapse["path_range"], collapse["paths"]
        lines.insert(1, f"path range    {low:.5g} to {high:.5g}, by {found} of {tried} paths of the same structure")
    elif collapse.get("slides"):
        lines.insert(1, "              depends on the path: --refine gives the range, dembrick limit a bound of it")
    if after is not None and after < collapse["load_factor"]:
        lines.insert(1, f"after a peak  load factor {after:.5g}; how high the peak is depends on the way there")
    return lines
