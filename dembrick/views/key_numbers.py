"""The key numbers of a run, declared once: what ``run`` and ``info`` print, pages, notebooks and ``repr`` show.

They are found in the object of ``run --json``, and a history may hold anything in its place. A new number is a
`Declared` in one of the tables here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from dembrick.views import structure_numbers as structure
from dembrick.views.summary import (
    NO_BAR,
    angle_text,
    barred,
    known,
    length,
    limit_text,
    listed,
    load_text,
    mechanism,
    number,
    on_one_path,
    outward,
    part,
    peak_text,
    plain,
    rounded_up,
    start_text,
    texts,
    with_error,
    yield_point,
)

_CARRIED = {"N": "N", "V_1": "N", "V_2": "N", "M_T": "N m"}
_COLUMN = 13  # characters, or more
_ROUNDING = 1e-9  # of N (times 1 m): forces below are not there


class KeyNumber(NamedTuple):
    """One line of a summary: what it is, its value with unit and error bar, and what to know about it."""

    name: str
    value: str
    remark: str = ""


def aligned(numbers: Sequence[KeyNumber]) -> list[str]:
    """Key numbers as lines of the command line, names in a column."""
    width = max([_COLUMN, *(len(number.name) for number in numbers)])
    return [plain(f"{name:{width}} {value}{f' ({remark})' if remark else ''}") for name, value, remark in numbers]


class Told(NamedTuple):
    """Value of a key number with unit and error bar, and what to know about it."""

    value: str
    remark: str = ""


class Declared(NamedTuple):
    """Declaration of a key number, of which ``run``, ``info``, pages and notebooks are made: its ``name``, and how
    results tell it, None if they do not (``of``).

    ``only`` and ``unless``: a key that results must have, or must not.
    """

    name: str
    of: Callable[[Mapping], Told | None]
    only: str = ""
    unless: str = ""


def key_numbers(results: Mapping, unit: str = "N") -> list[KeyNumber]:
    """Key numbers of a run: the limit load with its bracket, theory beside it, the mechanism, the collapse.

    ``unit`` of the load of actuators, "1" for a factor.
    """
    lines = []
    if isinstance(results.get("error"), str):
        lines.append(KeyNumber("no answer", results["error"]))
    if isinstance(results.get("answer"), str):
        lines.append(KeyNumber("answer", results["answer"]))
    collapse, path = part(results, "collapse"), part(results, "path")
    point = _refined(yield_point(results), results)
    of_blocks = collapse or unit == "1"
    lines += told_by(OF_SETTLEMENT, results)
    lines += _of_collapse(collapse, point)
    if not isinstance(results.get("error"), str):  # what a run that failed had come to is no limit
        lines += _of_yield(point, "" if of_blocks else unit, results, path | collapse)
        lines += [KeyNumber(*told) for told in structure.of_path(path | collapse, "" if of_blocks else unit)]
        lines += [KeyNumber(*told) for told in structure.of_collapse(results if "hinges" in results else collapse)]
    lines += cycle_numbers(results.get("cycles"), unit)
    lines += told_by(BESIDE, results)
    lines += _of_theory(part(results, "theory"))
    at_rest = point or part(results, "settlement") or part(results, "statics")
    lines += [] if at_rest else told_by(OF_MOTION, results)
    lines += told_by(OF_LAWS, results)
    for of in (structure.of_stages, structure.of_ties, structure.of_reactions):
        lines += [KeyNumber(*told) for told in of(results)]
    lines += told_by(OF_WORK, results)
    return lines


def _refined(point: dict, results: Mapping) -> dict:
    """A yield point whose bracket is as wide as the error estimate beside it, if refined runs gave one."""
    V, error = point.get("V"), number(results.get("error_estimate"))
    if V is None or error is None or point.get("bracket") != "indicator":
        return point
    return point | {"V_lower": V - error, "V_upper": V + error, "bracket": "refined"}


def _of_yield(point: dict, unit: str, results: Mapping, path: dict) -> list[KeyNumber]:
    """The limit load in N, or without a unit the load factor of a structure; ``path``: what stands beside the limit of
    an assembly."""
    load = ("V", "limit load V") if unit else ("load factor", "load factor")
    if "V" not in point:
        return []
    timed = results.get("simulated_time") is not None
    said, alone = limit_text(point, path, unit), on_one_path(path)
    lower, upper = point.get("V_lower"), point.get("V_upper")
    is_open = lower is None or upper is None or point.get("bracket", "open") == "open"
    remark = said.kind
    if alone:
        bound = number(part(path, "associative").get("upper"))
        remark += "" if bound is None else f", at most {bound:.5g} {unit}".rstrip() + " on any"
        remark += "; --refine gives the range" + ("" if bound is not None else ", --bound a bound of it")
    elif not is_open:
        remark = remark.replace("indicator", "indicator, not certified")
        remark += (
            ""
            if "meet" in remark or " to " in said.value
            else f": bounds {' and '.join(outward(lower, upper))} {unit}".rstrip()
        )
        remark += "; of this path" if not path and results.get("path_dependent") is True else ""
    lines = [KeyNumber(load[0] if is_open else load[1], said.value, remark)]
    start = start_text(path, unit)
    if start is not None:
        lines.append(KeyNumber("start", start))
    if "V_peak" in point:
        peak, where = peak_text(point, path, unit, timed and results.get("status") == "completed")
        if is_open and not timed:  # along a path in the deformed geometry, to its end
            error = number(results.get("error_estimate"))
            peak = peak if error is None else with_error(point["V_peak"], error, unit).rstrip()
            where += f"; {NO_BAR}" if error is None else ", from runs refined"
        lines.append(KeyNumber(f"largest {load[0]}", peak, where))
    least = _ROUNDING * abs(point.get("N", 0.0))
    shown = {name: 0.0 if abs(point[name]) <= least else point[name] for name in _CARRIED if name in point}
    carried = [f"{name} = {shown[name]:.5g} {_CARRIED[name]}" for name in shown]
    if carried:
        at_limit = "limit_at" in point or point.get("bracket") == "certified" or not (timed or is_open)
        when = "at the limit" if at_limit else "at the end"
        which = f"{point['joint']}, " if "joint" in point else ""
        lines.append(KeyNumber("the joint carries", ", ".join(carried), f"{which}{when}"))
    if mechanism({"collapse": path}) != "none":
        lines.append(KeyNumber("mechanism", mechanism({"collapse": path})))
    elif "mechanism" in point:
        centre = point.get("torsion_centre")
        # + 0.0: a negative zero would only puzzle the reader
        x, y = (0.0, 0.0) if centre is None else (round(1e3 * x, 4) + 0.0 for x in centre)
        remark = "" if centre is None else f"turns about ({x:.5g}, {y:.5g}) mm from O"
        lines.append(KeyNumber("mechanism", point["mechanism"], remark))
    return lines


def cycle_numbers(cycles: object, unit: str) -> list[KeyNumber]:
    """The peaks of both halves of every cycle with their bars, and what it dissipates; ``unit`` of the load."""
    lines = []
    for count, cycle in enumerate(cycles if isinstance(cycles, list) else [], 1):
        columns = [part({"": cycle}, "").get(name) for name in ("peak", "V_lower", "V_upper")]
        if not all(isinstance(column, list) and [number(V) for V in column] == column for column in columns):
            continue
        peaks = [" ± ".join(barred(V, max(b - V, V - a))) for V, a, b in zip(*columns, strict=False)]
        work, damping, residual = (number(cycle.get(name)) for name in ("dissipated", "damping", "residual"))
        remark = "its loop does not close" if work is None else f"dissipated {work:.5g} J"
        remark += "" if damping is None else f", damping {100.0 * damping:.3g} %"
        remark += "" if residual is None else f", residual {1e3 * residual:.4g} mm"
        lines.append(KeyNumber(f"cycle {count}", f"peaks {' and '.join(peaks)}{' N' if unit == 'N' else ''}", remark))
    return lines


def _moved(results: Mapping) -> Told | None:
    """How far a block has moved or turned up to a limit in the deformed geometry."""
    moved = part(results, "moved")
    way, turn = number(moved.get("displacement")), number(moved.get("turn"))
    if way is None:
        return None
    value = f"{moved.get('block')} by {length(way) if turn is None else f'{math.degrees(turn):.3g} deg'}"
    far = "; large_displacements = false gives the limit before they move" if moved.get("far") is True else ""
    return Told(value, f"up to there{far}")


def _after(results: Mapping) -> Told | None:
    """Other blocks that move on beyond the limit."""
    after = part(results, "after")
    moved, load, names = number(after.get("displacement")), number(after.get("load")), texts(after.get("blocks"))
    if moved is None or not names:
        return None
    at = "" if load is None else f", at {load:.3g}"
    return Told(listed(names), f"by {after.get('mechanism')}, to {length(moved)}{at}; --frame last shows it")


def _of_theory(theory: dict) -> list[KeyNumber]:
    V, error = number(theory.get("V")), number(theory.get("error"))
    if V is None:
        return []
    remark = "" if error is None else f"simulation {100.0 * error:+.2g} %"
    gap = number(theory.get("discretisation_error"))
    if gap is not None:
        remark += f"{'; ' if remark else ''}the points miss the continuum by {100.0 * gap:.2g} %"
    return [KeyNumber("theory", f"{V:.7g} N", remark)]


def _outcome(results: Mapping) -> Told | None:
    """It stood or fell; of what stands and moves when the run ends nobody knows yet."""
    told, speed = results.get("outcome"), number(results.get("speed_at_the_end"))
    if not isinstance(told, str):
        return None
    open_ended = told == "stood" and speed is not None and speed > 0.0
    return Told(told, f"so far: it still moves at {speed:.2g} m/s; give a longer duration" if open_ended else "")


def _moving(results: Mapping) -> Told | None:
    """Forces at the end are those of an instant where blocks still move."""
    speed = number(results.get("speed_at_the_end"))
    return Told(f"at {speed:.2g} m/s at the end", "forces and reactions are those of that instant") if speed else None


def _drift(results: Mapping) -> Told | None:
    drift = part(results, "drift")
    value = number(drift.get("value"))
    if value is None:
        return None
    return Told(f"{100.0 * value:.3g} %", f"displacement over height of {drift.get('block')}, at any time")


def _greatest(results: Mapping) -> Told | None:
    ways = {name: number(way) for name, way in part(results, "greatest_displacement").items()}
    known_ways = {name: way for name, way in ways.items() if way is not None}
    if not known_ways:
        return None
    furthest = max(known_ways, key=lambda name: known_ways[name])
    return Told(length(known_ways[furthest]), f"of the centroid of {furthest}, at any time")


def _at_the_end(results: Mapping) -> Told | None:
    moved, error = number(results.get("displacement")), number(results.get("displacement_error"))
    if moved is None:
        return None
    value = length(moved) if error is None else with_error(moved, error, "m")
    return Told(value, "of a centroid; " + (NO_BAR if error is None else "from stiffer joints"))


def _peak_tie(results: Mapping) -> Told | None:
    peaks = [number(tie.get("peak")) for tie in structure.ties_of(results)]
    known_peaks = [peak for peak in peaks if peak is not None]
    return Told(load_text(max(known_peaks)), "of all ties, at any time") if known_peaks else None


def _fallen(results: Mapping) -> Told | None:
    return Told(listed(texts(results["fallen"]))) if isinstance(results.get("fallen"), list) else None


def _not_standing(results: Mapping) -> Told | None:
    names = texts(results.get("not_standing"))
    return Told(listed(names), "no equilibrium under the dead loads") if names else None


def _left_out(results: Mapping) -> Told | None:
    said = []
    for found in (own.get("left_out") for own in (results, part(results, "path"), part(results, "collapse"))):
        said += [one.get("text") for one in found if isinstance(one, Mapping)] if isinstance(found, list) else []
    return Told("; ".join(texts(said))) if texts(said) else None


def _settled(results: Mapping) -> Told | None:
    collapse = part(results, "collapse")
    at, bar = number(collapse.get("settlement")), number(collapse.get("error_estimate"))
    if at is None:
        return None
    text = f"{at:.5g} m" if bar is None else with_error(at, abs(bar), "m")
    ends = structure.pair(collapse.get("settlement_range"))
    between = "" if ends is None else "between {} and {} m; ".format(*outward(*ends))
    return Told(text, between + (NO_BAR if bar is None else "from runs refined"))


def _reaction(results: Mapping) -> Told | None:
    found = part(results, "settlement")
    reaction, bar, reached = (number(found.get(key)) for key in ("reaction", "reaction_error", "displacement"))
    if reaction is None:
        return None
    text = f"{reaction:.6g} N" if bar is None else with_error(reaction, abs(bar), "N")
    remark = "" if reached is None else f"at {length(reached)}; "
    return Told(text, remark + (NO_BAR if bar is None else "refined"))


def _extreme_reaction(which: str, results: Mapping) -> Told | None:
    one = part(part(results, "settlement"), which)
    value, where = number(one.get("reaction")), number(one.get("displacement"))
    return None if value is None or where is None else Told(f"{value:.6g} N", f"at {length(where)}")


def _reaction_at_rest(results: Mapping) -> Told | None:
    value = number(part(results, "settlement").get("at_rest"))
    return None if value is None else Told(f"{value:.6g} N", "before the supports moved")


def _allowed_reaction(results: Mapping) -> Told | None:
    """Range of the reaction that limit analysis allows before the supports move, if that was asked for."""
    allowed = part(results, "settlement").get("limit_analysis")
    if not isinstance(allowed, Mapping):
        return None
    low, high = ("no limit" if end is None else f"{end:.6g} N" for end in allowed.values())
    return Told(f"{low} to {high}", "before the supports moved, by limit analysis")


def _equilibria(results: Mapping) -> Told | None:
    count = number(part(results, "settlement").get("equilibria") or results.get("equilibria"))
    return None if count is None else Told(f"{count:.0f}", "in the deformed geometry")


def _unbalanced(results: Mapping) -> Told | None:
    value = number(results.get("unbalanced"))
    asked = bool(part(results, "statics") or part(results, "settlement"))
    return Told(f"{value:.2g}", "of the joint forces") if asked and value is not None else None


def _load_path(results: Mapping) -> Told | None:
    found = part(results, "statics")
    increments, error = number(found.get("increments")), number(found.get("path_error"))
    if increments is None or error == 0.0:
        return None
    known = (
        "forces as in one step"
        if error is None
        else f"forces are known to {rounded_up(error, 1)} of the greatest joint force"
    )
    return Told(f"{increments:.0f} increment{'s' if increments > 1 else ''}", known)


def _simulated(results: Mapping) -> Told | None:
    seconds = number(results.get("simulated_time"))
    return None if seconds is None else Told(f"{seconds:.6g} s")


def _time_step(results: Mapping) -> Told | None:
    step, critical = number(results.get("time_step")), number(results.get("critical_time_step"))
    if step is None or critical is None or not step > 0.0 or results.get("simulated_time") is None:
        return None
    return Told(f"{step:.3g} s", f"critical {critical:.3g} s")


def _energy(results: Mapping) -> Told | None:
    audit = part(results, "energy")
    residual, stepping = number(audit.get("relative_residual")), number(audit.get("step_error"))
    if residual is None:
        return None
    remark = "residual over the energy put in"
    if stepping is not None:
        remark += f"; {stepping:.1e} of it went in joints that open or close within a step"
    return Told(f"{residual:.1e}", remark)


def _steps(results: Mapping) -> Told | None:
    steps, seconds = number(results.get("steps")), number(part(results, "wall").get("loop"))
    if steps is None:
        return None
    return Told(f"{steps:.0f}", "" if seconds is None else f"{seconds:.2g} s in the loop")


BESIDE = (Declared("moved", _moved), Declared("beyond the limit", _after))
OF_MOTION = (
    Declared("outcome", _outcome),
    Declared("drift", _drift),
    Declared("greatest displacement", _greatest),
    Declared("displacement at the end", _at_the_end, unless="outcome"),
    Declared("residual displacement", _at_the_end, only="outcome"),
    Declared("still moving", _moving, unless="outcome"),
    Declared("peak tie force", _peak_tie),
    Declared("fallen", _fallen),
    Declared("not standing", _not_standing),
)
OF_LAWS = (Declared("left out", _left_out),)
OF_SETTLEMENT = (
    Declared("settlement at collapse", _settled),
    Declared("reaction along the motion", _reaction),
    Declared("least reaction", partial(_extreme_reaction, "least")),
    Declared("greatest reaction", partial(_extreme_reaction, "greatest")),
    Declared("reaction at rest", _reaction_at_rest),
    Declared("reaction allowed", _allowed_reaction),
)
OF_WORK = (
    Declared("equilibria", _equilibria),
    Declared("out of balance", _unbalanced),
    Declared("way of the loads", _load_path),
    Declared("simulated time", _simulated),
    Declared("time step", _time_step),
    Declared("energy balance", _energy),
    Declared("steps", _steps),
)


def told_by(declared: Sequence[Declared], results: Mapping) -> list[KeyNumber]:
    """Key numbers of results, those of a table that they have."""
    found = []
    for one in declared:
        if (one.only and one.only not in results) or (one.unless and one.unless in results):
            continue
        told = one.of(results)
        if told is not None:
            found.append(KeyNumber(one.name, *told))
    return found


def _of_collapse(collapse: dict, point: dict) -> list[KeyNumber]:
    """The angle of the table; and where no bracket tells it, the load factor with its estimate and the mechanism."""
    lines = []
    onset, moved = number(collapse.get("onset")), number(collapse.get("displacement"))
    angle, factor, bar = (number(collapse.get(key)) for key in ("angle", "load_factor", "error_estimate"))
    if angle is not None and "V" in point:
        lines.append(KeyNumber("collapse angle", *angle_text(point, collapse)))
    elif angle is not None:
        # angle = atan(factor)
        error = None if bar is None else math.degrees(abs(bar) * math.cos(math.radians(angle)) ** 2)
        text = f"{known(angle, 0.0, 5)} deg" if error is None else with_error(angle, error, "deg")
        remarks = [] if onset is None or moved is None else [f"a block has moved {length(moved)}"]
        remarks += [NO_BAR] if error is None else []
        lines.append(KeyNumber("collapse angle", text, "; ".join(remarks)))
        if onset is not None:
            lines.append(KeyNumber("onset", f"{onset:.4g} deg", "there the first block leaves its balance"))
    if factor is not None and "V" not in point:
        text = f"{factor:.5g}" if bar is None else with_error(factor, abs(bar), "").rstrip()
        source = "from the run refined" if bar is not None else "" if lines else NO_BAR
        lines.append(KeyNumber("load factor", text, source))
    if isinstance(collapse.get("mechanism"), str) and "V" not in point:
        lines.append(KeyNumber("mechanism", collapse["mechanism"]))
    return lines
