"""Path dependence of the limit of a search: what is proven of other load paths, and the limits found on them.

Friction without dilatancy has no unique limit load: the joint forces at which a mechanism forms depend on the load
history, and locked-in forces let contacts carry that carry nothing otherwise. A search follows one path, from a start
without locked-in forces (or from the state that its stages leave). That no path carries more is proven by its
mechanism, if normality allows it (`simulation.statics.paths.other_paths`), or if the limit reaches the load A of limit
analysis with associative flow, which bounds every admissible state. That none carries less needs a proof of its own: a
path may end below A by another mechanism, unless neither the load nor locked-in forces can change the normal forces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.assembly import build
from dembrick.errors import BracketError, MissingDependency, NotConvergedError, ScenarioError
from dembrick.runs.outcomes.error_estimate import RATIOS, with_laws, with_ratio
from dembrick.scenario.checks import present
from dembrick.scenario.model import Scenario
from dembrick.simulation.session import Session
from dembrick.simulation.statics.paths.other_paths import grazing_joints, greatest_on_any_path, statically_determinate
from dembrick.simulation.statics.rest import dead_load
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.yield_point import YieldPoint, closed, last_moves, slides

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control
    from dembrick.scenario.model import Scenario
    from dembrick.simulation.statics.load_system import Replay


REACHED = 1e-6  # of V: a bound no higher than that above the bracket counts as reached
BEYOND = 2e-3  # of a bound: how far a limit may lie above it within the tolerance of the search
PATIENCE, LONG = 2.0, 30.0  # s that limit analysis may take after any search, and after one without an upper bound


def has_paths(assembly: Assembly) -> bool:
    """Whether several joints share the load, so that how they share it may depend on the path."""
    return len(assembly.joints) > 1


class OtherPaths(NamedTuple):
    """Proofs on all load paths of a structure: whether none carries more than the limit found, whether none
    carries less, and the associative ``bound`` if it was computed, or why there is ``no_bound``."""

    no_path_above: bool
    no_path_below: bool
    bound: dict | None = None
    no_bound: str | None = None

    @property
    def path_dependent(self) -> bool:
        """Whether another path of the same structure may carry more or less: False only if proven."""
        return not (self.no_path_above and self.no_path_below)

    def as_dict(self) -> dict:
        """Entries in the JSON object of a search."""
        associative = None if self.bound is None else self.bound["upper"]
        return {
            "path_dependent": self.path_dependent,
            "no_path_above": self.no_path_above,
            "associative": associative,
        }


def other_paths(run: Replay, assembly: Assembly, control: Control, asked: bool = False) -> OtherPaths:
    """Find what is proven of all paths to the limit of a search.

    Limit analysis is run if it is ``asked`` for, or if nothing else proves that no path carries more and it costs
    little or less than the search.
    """
    from dembrick.runs.limit import associative_bound

    point, determinate = run.yield_point, statically_determinate(assembly)
    if point.V is None:
        return OtherPaths(True, determinate)
    alone = determinate or _mechanism_allows_no_more(run)
    bound = reason = None
    if asked or (not alone and has_paths(assembly) and _affordable(run, assembly)):
        try:
            bound = associative_bound(assembly, control)
        except (NotConvergedError, ScenarioError) as error:
            reason = str(error)
    reached = bound is not None and bound["lower"] <= reach_of(point)
    if bound is not None and not determinate:
        alone = reached  # a path may carry what limit analysis balances
    return OtherPaths(alone or reached, determinate, bound, reason)


def _affordable(run: Replay, assembly: Assembly) -> bool:
    """Whether limit analysis is installed and costs little or less than the search."""
    from dembrick.runs.limit import cheaper_than

    open_ended = run.yield_point.bracket == "open" or run.settings.get("wanders")
    return cheaper_than(max(LONG if open_ended else PATIENCE, run.loop_seconds), assembly)


def cut_at_bound(point: YieldPoint, bound: dict | None) -> YieldPoint:
    """``point`` with its bracket cut at the associative ``bound``, if that is known and lower. V stays if it is below
    the bound; else it is the middle of the new bracket, or the bound itself if the search has no lower bound. An open
    bracket that is narrow enough once it is cut is closed, with V in its middle.

    BracketError if the limit exceeds the bound by more than the error of the search, as one of them is then wrong.
    """
    if bound is None or point.V is None or max(point.V, point.V_upper or -math.inf) <= bound["upper"]:
        return point
    most = bound["upper"]
    if point.V_lower > (1.0 + BEYOND) * most:
        raise BracketError(
            f"the search found a limit of at least {point.V_lower:.9g}, and limit analysis proves that none lies above "
            f"{most:.9g}, so one of them is wrong; please report this scenario"
        )
    lower, upper = min(point.V_lower, most), None if point.V_upper is None else min(point.V_upper, most)
    V = point.V if point.V <= most else 0.5 * (lower + most) if lower > 0.0 else most
    return closed(replace(point, V=V, V_lower=lower, V_upper=upper, V_peak=min(point.V_peak, most)))


def reach_of(point: YieldPoint) -> float:
    """The load up to which others count as equal to that of ``point``: the end of its bracket, or V if that is open,
    plus rounding."""
    upper = None if point.bracket == "open" else point.V_upper
    return max(present(point.V), upper or -math.inf) + REACHED * abs(present(point.V))


def _mechanism_allows_no_more(run: Replay) -> bool:
    """Whether the mechanism at the limit proves that no path carries more; False after a peak, and if blocks keep
    snapping."""
    point = run.yield_point
    if point.V_after is not None or point.bracket == "open" or run.settings.get("wanders"):
        return False
    states = [run.state] if run.left is None else [run.state, run.left]
    return min(map(greatest_on_any_path, states)) <= reach_of(point)


def beside_limit(run: Replay, assembly: Assembly, scenario: Scenario, others: OtherPaths) -> dict | None:
    """Entries beside the limit load of a search of several joints or of a collapse; None if nothing limits the
    load.

    ``slides``: loaded joints slide in the mechanism, so that the joint stiffness may change the limit.
    ``associative``: load factor (V in N of actuators) of limit analysis with its bounds, if it was computed; else
    None, and ``no_bound`` says why it failed, if it did. ``no_path_above``, ``path_dependent``: see `OtherPaths`;
    ``digits_open``: the stiffness may change the limit by an unknown amount. ``locked_in``: earlier stages may have
    left forces in the joints. ``left_out``: effects that the joint laws leave out of the collapse. ``wanders``: range
    in which the load keeps rising and falling as blocks snap between states, half of which is the ``error_estimate``;
    None if the load reaches a limit or has passed a peak. ``--refine`` adds ``path_range``, the load factors found
    with other stiffness ratios, steps and locked-in forces, ``paths``, how many paths found a limit and how many there
    are, and ``error_estimate``, how far the brackets of all these go.
    """
    point = run.yield_point
    if point.V is None:
        return None
    sliding = slides(run.state)
    snaps = run.settings.get("wanders") and point.V_after is None
    most = math.inf if others.bound is None else others.bound["upper"]
    wanders = [point.V_lower, min(present(point.V_upper), most)] if snaps else None
    return {
        "slides": sliding,
        "digits_open": sliding and not others.no_path_above,
        "path_dependent": others.path_dependent,
        "no_path_above": others.no_path_above,
        "locked_in": bool(scenario.stages),
        "associative": others.bound,
        "no_bound": others.no_bound,
        "left_out": _left_out(run, assembly, scenario.control) if has_paths(assembly) else [],
        "wanders": wanders,
        "path_range": None,
        "paths": None,
        "error_estimate": None if wanders is None else point.half_width,
    }


def _left_out(run: Replay, assembly: Assembly, control: Control) -> list[dict]:
    from dembrick.runs.left_out import left_out

    affordable = _affordable(run, assembly)
    state, tilt = run.state, control.tilt_axis is not None
    moves, V = np.stack(last_moves(state), axis=1), present(run.yield_point.V)
    try:
        found = left_out(assembly, V, state.joints.resultant, moves, tilt, bounded=affordable)
    except (NotConvergedError, MissingDependency):
        found = left_out(assembly, V, state.joints.resultant, moves, tilt, bounded=False)
    return [one.as_dict() for one in found]


def ranged(beside: dict, V: float, found: list[tuple[float, float, float]], tried: int) -> tuple[dict, list[float]]:
    """``beside`` with the range of V and of the load factors ``found`` on other paths, each in the middle of its
    `ends`, of which so many were ``tried``; and the ends of all their brackets. At most up to the associative bound, if
    that is known."""
    most = math.inf if beside.get("associative") is None else max(V, beside["associative"]["upper"])
    lower, factors, upper = np.minimum([(V, V, V), *found], most).T
    reach = [float(lower.min()), float(upper.max())]
    error = max(reach[1] - V, V - reach[0], beside["error_estimate"] or 0.0)
    path_range = [float(factors.min()), float(factors.max())]
    return beside | {"path_range": path_range, "paths": [len(found) + 1, tried + 1], "error_estimate": error}, reach


def ends(point: YieldPoint) -> tuple[float, float, float]:
    """The lower bound, V, and the upper bound of a limit; V alone if its bracket is open."""
    V = present(point.V)
    if point.bracket == "open" or point.V_upper is None:
        return V, V, V
    return point.V_lower, V, point.V_upper


# yield point of a scenario, by steps relative to the usual ones, of an assembly in place of its own, from a state
Search = Callable[..., YieldPoint]
REVERSED = 0.9  # of the limit of the reversed load
PRESSED = (2.0, 0.5, 0.1)  # of the weight of all blocks: forces that press a joint, tried until the blocks stand


class UnstableHistory(NotConvergedError):
    """A load history under which the blocks do not stand."""


def histories(run: Replay, scenario: Scenario, search: Search) -> list[Callable[[], YieldPoint]]:
    """Functions that find the yield point of ``scenario`` after other load histories; each may raise NotConvergedError,
    and UnstableHistory if the blocks do not stand under the history."""
    found: list[Callable[[], YieldPoint]]
    found = [partial(_after_smooth_rest, scenario, search), partial(_after_reversed_load, scenario, search)]
    states = [run.state] if run.left is None else [run.state, run.left]
    pressed = np.unique(np.concatenate([grazing_joints(state) for state in states]))
    if len(pressed):
        softest = with_ratio(scenario, max(RATIOS))
        found += [partial(_after_pressing, one, search, pressed) for one in (scenario, softest)]
    return found


def _after_smooth_rest(scenario: Scenario, search: Search) -> YieldPoint:
    smooth = with_laws(scenario, lambda law: replace(law, friction=0.0, residual_friction=None))
    return search(scenario, 1.0, start=_rest(build.assemble(smooth)))


def _after_reversed_load(scenario: Scenario, search: Search) -> YieldPoint:
    assembly = build.assemble(scenario)
    actuators = assembly.actuators
    back = replace(assembly, actuators=replace(actuators, direction=-actuators.direction))
    V = present(search(scenario, 1.0, back).V)
    wrench = actuators.at.on_blocks(actuators.force, len(assembly.names))
    return search(scenario, 1.0, start=_after_load_cycle(assembly, -REVERSED * V * wrench))


def _after_pressing(scenario: Scenario, search: Search, joints: np.ndarray) -> YieldPoint:
    assembly = build.assemble(scenario)
    table, wrench = assembly.joints, np.zeros((len(assembly.names), 6))
    normal = table.axes[joints, 2]
    for block, sign in ((table.block_a[joints], 1.0), (table.block_b[joints], -1.0)):
        arm = table.origin[joints] - assembly.position[block]
        np.add.at(wrench, block, sign * np.concatenate([normal, np.cross(arm, normal)], axis=1))
    weight = float(np.linalg.norm(assembly.dead_force[~assembly.fixed], axis=1).sum())
    for times in PRESSED:
        try:
            start = _after_load_cycle(assembly, times * weight * wrench)
        except UnstableHistory:
            continue
        return search(scenario, 1.0, start=start)
    raise UnstableHistory("the blocks fall when their joints are pressed together")


def _after_load_cycle(assembly: Assembly, wrench: np.ndarray) -> State:
    """The equilibrium after ``wrench`` (n, 6), N and N m, was applied to the blocks at rest and removed."""
    force, torque = assembly.dead_force + wrench[:, :3], assembly.dead_torque + wrench[:, 3:]
    acts = replace(assembly, dead_force=force, dead_torque=torque)
    return _rest(assembly, _rest(acts, _rest(assembly)))


def _rest(assembly: Assembly, start: State | None = None) -> State:
    """The equilibrium under the dead loads; UnstableHistory without one."""
    found = dead_load.find_rest(assembly, Session(start=start))
    if found.rest.stands is not True:
        raise UnstableHistory("the blocks fall in this history")
    return found.state
