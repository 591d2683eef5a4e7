"""How far the limit of a search depends on the path: the associative bound beside it, and the range of other paths.

Friction without dilatancy has no unique limit load: what the joints carry when a mechanism forms depends on how they
were loaded. Every state on any path is statically admissible, so the load of limit analysis with associative flow, A,
bounds all of them from above. If a path ends at A, its limit is called unique, for two reasons. No other path ends
above. And the mechanism u of limit analysis is complementary to every admissible state at A, the end of the path among
them: contacts that stick there do not move in u, and sliding ones move along the normal of their friction cone at the
force that they carry. So u takes no work from what friction leaves free, A follows from the dead loads alone, and every
path that ends with the same contacts sliding the same way ends at A as well. A wall that slides whole on a bed is such
a case. What this does not exclude is another path that finds another mechanism below A; that is what ``--refine`` looks
for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import MissingDependency, NotConvergedError, ScenarioError
from dembrick.scenario.checks import present
from dembrick.simulation.statics.yield_point import last_moves, slides

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control
    from dembrick.simulation.statics.load_system import Replay

PATIENCE = 2.0  # s that limit analysis may take whatever the search took


def has_paths(assembly: Assembly) -> bool:
    """Whether several joints share the load, so that how they share it may depend on the path."""
    return len(assembly.joints) > 1


def beside_limit(run: Replay, assembly: Assembly, control: Control) -> dict | None:
    """What stands beside the limit load of a search; None if nothing limits the load.

    ``slides``: joints slide in the mechanism. ``associative``: load factor (V in N of actuators) of limit analysis with
    its bounds, if the mechanism slides and limit analysis is installed and costs less than the search (or little); None
    otherwise, and ``no_bound`` says why it failed, if it did. ``path_dependent``: the mechanism slides, and the limit
    is not known to be unique (see above). ``left_out``: what the joint laws leave out of the collapse.
    ``wanders``: from where to where the load goes on rising and falling, as blocks snap from one state into another;
    None where it comes to a limit or has passed a peak; half of that is then the ``error_estimate``. ``--refine``
    adds ``path_range``, the load factors that other stiffness ratios and steps lead to, ``paths``, how many of them
    found a limit, of how many, and ``error_estimate``, how far the range goes.
    """
    point = run.yield_point
    if point.V is None:
        return None
    from dembrick.runs.limit import associative_bound, cheaper_than

    sliding, bound, reason = slides(run.state), None, None
    affordable = cheaper_than(max(PATIENCE, run.loop_seconds), assembly)
    if sliding and affordable:
        try:
            bound = associative_bound(assembly, control)
        except (NotConvergedError, ScenarioError) as error:
            reason = str(error)
    snaps = run.settings.get("wanders") and point.V_after is None
    wanders = [point.V_lower, point.V_upper] if snaps else None
    unique = bound is not None and point.V >= (1.0 - getattr(control, "tolerance", 0.0)) * bound["lower"]
    return {
        "slides": sliding,
        "path_dependent": sliding and not unique,
        "associative": bound,
        "no_bound": reason,
        "left_out": _left_out(run, assembly, control, affordable),
        "wanders": wanders,
        "path_range": None,
        "paths": None,
        "error_estimate": None if wanders is None else point.half_width,
    }


def _left_out(run: Replay, assembly: Assembly, control: Control, affordable: bool) -> list[dict]:
    from dembrick.runs.left_out import left_out

    state, tilt = run.state, control.tilt_axis is not None
    moves, V = np.stack(last_moves(state), axis=1), present(run.yield_point.V)
    try:
        found = left_out(assembly, V, state.joints.resultant, moves, tilt, bounded=affordable)
    except (NotConvergedError, MissingDependency):
        found = left_out(assembly, V, state.joints.resultant, moves, tilt, bounded=False)
    return [one.as_dict() for one in found]


def ranged(beside: dict, V: float, factors: list[float], tried: int) -> dict:
    """``beside`` with the range of V and the load ``factors`` that other paths found, of so many ``tried``."""
    low, high = min(*factors, V), max(*factors, V)
    paths = [len(factors) + 1, tried + 1]
    error = max(high - V, V - low, beside["error_estimate"] or 0.0)
    return beside | {"path_range": [low, high], "paths": paths, "error_estimate": error}


def path_lines(beside: dict, unit: str = "") -> list[str]:
    """What the command line prints of it; ``unit`` of the load."""
    lines = []
    if beside.get("wanders") is not None:
        low, high = beside["wanders"]
        lines.append(f"wanders       {low:.5g} to {high:.5g}{unit}: blocks snap on and on, and no limit is narrower")
    if beside.get("path_range") is not None:
        (low, high), (found, tried) = beside["path_range"], beside["paths"]
        lines.append(f"path range    {low:.5g} to {high:.5g}{unit}, by {found} of {tried} paths of the same structure")
    bound = beside.get("associative")
    if bound is not None and beside.get("path_range") is not None:
        lines.append(f"bound         {bound['upper']:.5g}{unit} (associative): no path ends above")
    elif beside.get("path_dependent"):
        most = "" if bound is None else f"at most {bound['upper']:.5g}{unit} (associative); "
        rest = "" if bound is not None else ", dembrick limit a bound of it"
        lines.append(f"              depends on the path: {most}--refine gives the range{rest}")
    return lines + [f"left out      {one['text']}" for one in beside.get("left_out", ())]
