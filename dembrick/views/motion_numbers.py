"""Key numbers of motion, settlements, laws and computing effort of a run, in tables.

The results may come from an untrusted file, so values of unexpected types are skipped.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

from dembrick.scenario.checks import listed
from dembrick.views import structure_numbers as structure
from dembrick.views.number_lines import Table, no_bar
from dembrick.views.summary import (
    ValueWithRemark,
    known,
    length,
    length_unit,
    load_text,
    number,
    outward,
    part,
    rounded_up,
    texts,
    with_error,
)


def _moved(results: Mapping) -> ValueWithRemark | None:
    """Displacement or rotation of a block up to a limit in the deformed geometry."""
    moved = part(results, "moved")
    way, turn = number(moved.get("displacement")), number(moved.get("turn"))
    if way is None:
        return None
    value = f"{moved.get('block')} by {length(way) if turn is None else f'{math.degrees(turn):.3g} deg'}"
    far = "; large_displacements = false gives the limit of the initial geometry" if moved.get("far") is True else ""
    return ValueWithRemark(value, f"up to the limit{far}")


def _outcome(results: Mapping) -> ValueWithRemark | None:
    """Whether the structure stood or fell; undecided if it stands but still moves when the run ends."""
    told, speed = results.get("outcome"), number(results.get("speed_at_the_end"))
    if not isinstance(told, str):
        return None
    open_ended = told == "stood" and speed is not None and speed > 0.0
    return ValueWithRemark(
        told, f"so far: blocks still move at {speed:.2g} m/s; give a longer duration" if open_ended else ""
    )


def _moving(results: Mapping) -> ValueWithRemark | None:
    """Warning that blocks still move at the end, so the final forces are those of an instant; for a shaken structure
    see `_outcome`."""
    speed = number(results.get("speed_at_the_end"))
    if not speed or "outcome" in results:
        return None
    return ValueWithRemark(f"at {speed:.2g} m/s at the end", "forces and reactions are those of that instant")


def _drift(results: Mapping) -> ValueWithRemark | None:
    drift = part(results, "drift")
    value = number(drift.get("value"))
    if value is None:
        return None
    return ValueWithRemark(f"{100.0 * value:.3g} %", f"displacement over height of {drift.get('block')}, at any time")


def _greatest(results: Mapping) -> ValueWithRemark | None:
    ways = {name: number(way) for name, way in part(results, "greatest_displacement").items()}
    known_ways = {name: way for name, way in ways.items() if way is not None}
    if not known_ways:
        return None
    furthest = max(known_ways, key=lambda name: known_ways[name])
    return ValueWithRemark(length(known_ways[furthest]), f"of the centroid of {furthest}, at any time")


def _residual(results: Mapping) -> ValueWithRemark | None:
    """Displacement that is left of a shaken structure; None of others, and if blocks still move."""
    moves = "outcome" not in results or number(results.get("speed_at_the_end"))
    return None if moves else _displacement(results)


def _at_the_end(results: Mapping) -> ValueWithRemark | None:
    """Displacement at the last instant; None if it is what is left of a motion (see `_residual`)."""
    return None if _residual(results) else _displacement(results)


def _displacement(results: Mapping) -> ValueWithRemark | None:
    moved, error = number(results.get("displacement")), number(results.get("displacement_error"))
    if moved is None:
        return None
    bar = "from stiffer joints" if error is not None else no_bar(results)
    if part(results, "collapse").get("error_estimate") is not None:  # the collapse load has the bar of the refined runs
        bar = "no error bar"
    block = results.get("furthest")
    whose = f"the centroid of {block}" if isinstance(block, str) else "a centroid"
    return ValueWithRemark(length(moved, error), f"of {whose}; {bar}")


def _peak_tie(results: Mapping) -> ValueWithRemark | None:
    peaks = [number(tie.get("peak")) for tie in structure.ties_of(results)]
    known_peaks = [peak for peak in peaks if peak is not None]
    return ValueWithRemark(load_text(max(known_peaks)), "of all ties, at any time") if known_peaks else None


def _fallen(results: Mapping) -> ValueWithRemark | None:
    return ValueWithRemark(listed(texts(results["fallen"]))) if isinstance(results.get("fallen"), list) else None


def _not_standing(results: Mapping) -> ValueWithRemark | None:
    names = texts(results.get("not_standing"))
    return ValueWithRemark(listed(names), "no equilibrium under the dead loads") if names else None


def _left_out(results: Mapping) -> ValueWithRemark | None:
    said = []
    for found in (own.get("left_out") for own in (results, part(results, "path"), part(results, "collapse"))):
        said += [one.get("text") for one in found if isinstance(one, Mapping)] if isinstance(found, list) else []
    return ValueWithRemark("; ".join(dict.fromkeys(texts(said)))) if texts(said) else None


def _settled(results: Mapping) -> ValueWithRemark | None:
    collapse = part(results, "collapse")
    at, bar = number(collapse.get("settlement")), number(collapse.get("error_estimate"))
    if at is None:
        return None
    unit, factor = length_unit(at)
    text = f"{factor * at:.5g} {unit}" if bar is None else length(at, abs(bar))
    ends = structure.pair(collapse.get("settlement_range"))
    between = ""
    if ends is not None:
        between = "between {} and {} {}; ".format(*outward(factor * ends[0], factor * ends[1]), unit)
    return ValueWithRemark(text, between + (no_bar(results) if bar is None else "from refined runs"))


def _reaction(results: Mapping) -> ValueWithRemark | None:
    found = part(results, "settlement")
    reaction, bar, reached = (number(found.get(key)) for key in ("reaction", "reaction_error", "displacement"))
    if reaction is None:
        return None
    text = f"{reaction:.6g} N" if bar is None else with_error(reaction, abs(bar), "N")
    remark = "" if reached is None else f"at {length(reached)}; "
    return ValueWithRemark(text, remark + (no_bar(results) if bar is None else "refined"))


def _reaction_at_rest(results: Mapping) -> ValueWithRemark | None:
    value = number(part(results, "settlement").get("at_rest"))
    return None if value is None else ValueWithRemark(f"{value:.6g} N", structure.BEFORE)


def _allowed_reaction(results: Mapping) -> ValueWithRemark | None:
    """Range of the reaction by limit analysis before the supports move, if it was requested."""
    allowed = part(results, "settlement").get("limit_analysis")
    if not isinstance(allowed, Mapping):
        return None
    low, high = ("no limit" if end is None else f"{end:.6g} N" for end in allowed.values())
    return ValueWithRemark(f"{low} to {high}", f"{structure.BEFORE}, by limit analysis")


def _equilibria(results: Mapping) -> ValueWithRemark | None:
    count = number(part(results, "settlement").get("equilibria") or results.get("equilibria"))
    return None if count is None else ValueWithRemark(f"{count:.0f}", "in the deformed geometry")


def _unbalanced(results: Mapping) -> ValueWithRemark | None:
    value = number(results.get("unbalanced"))
    asked = bool(part(results, "statics") or part(results, "settlement"))
    return ValueWithRemark(f"{value:.2g}", "of the joint forces") if asked and value is not None else None


def _load_path(results: Mapping) -> ValueWithRemark | None:
    found = part(results, "statics")
    increments, error = number(found.get("increments")), number(found.get("path_error"))
    if increments is None or error == 0.0 or found.get("stands") is False:
        return None
    accuracy = (
        "same forces as in one step"
        if error is None
        else f"forces are known to {rounded_up(error, 1)} of the greatest on a block"
    )
    return ValueWithRemark(f"{increments:.0f} increment{'s' if increments > 1 else ''}", accuracy)


def _simulated(results: Mapping) -> ValueWithRemark | None:
    seconds = number(results.get("simulated_time"))
    return None if seconds is None else ValueWithRemark(f"{seconds:.6g} s")


def _time_step(results: Mapping) -> ValueWithRemark | None:
    step, critical = number(results.get("time_step")), number(results.get("critical_time_step"))
    if step is None or critical is None or not step > 0.0 or results.get("simulated_time") is None:
        return None
    return ValueWithRemark(f"{step:.3g} s", f"critical {critical:.3g} s")


def _energy(results: Mapping) -> ValueWithRemark | None:
    audit = part(results, "energy")
    residual, stepping = number(audit.get("relative_residual")), number(audit.get("step_error"))
    if residual is None:
        return None
    remark = "residual over the energy put in"
    if stepping is not None:
        remark += f"; {stepping:.1e} of it in joints that open or close within a step"
    return ValueWithRemark(f"{residual:.1e}", remark)


def _steps(results: Mapping) -> ValueWithRemark | None:
    steps, seconds = number(results.get("steps")), number(part(results, "wall").get("loop"))
    if steps is None:
        return None
    return ValueWithRemark(f"{steps:.0f}", "" if seconds is None else f"{known(seconds, None)} s in the loop")


BESIDE: Table = {"moved": _moved}
OF_MOTION: Table = {
    "outcome": _outcome,
    "drift": _drift,
    "greatest displacement": _greatest,
    "displacement at the end": _at_the_end,
    "residual displacement": _residual,
    "still moving": _moving,
    "peak tie force": _peak_tie,
    "fallen": _fallen,
    "not standing": _not_standing,
}
OF_LAWS: Table = {"left out": _left_out}
OF_SETTLEMENT: Table = {
    "settlement at collapse": _settled,
    "reaction along the motion": _reaction,
    "least reaction": partial(structure.extreme_reaction, "least"),
    "greatest reaction": partial(structure.extreme_reaction, "greatest"),
    "reaction at rest": _reaction_at_rest,
    "admissible reaction": _allowed_reaction,
}
OF_WORK: Table = {
    "equilibria": _equilibria,
    "out of balance": _unbalanced,
    "load path": _load_path,
    "simulated time": _simulated,
    "time step": _time_step,
    "energy balance": _energy,
    "steps": _steps,
}
