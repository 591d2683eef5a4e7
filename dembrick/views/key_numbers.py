"""The key numbers of a run, declared once for ``run``, ``info``, pages, notebooks and ``repr``.

They are found in the object of ``run --json``; that of a history may be malformed. To add a number, add it
to one of the tables of `motion_numbers`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dembrick.scenario.checks import listed
from dembrick.views import structure_numbers as structure
from dembrick.views.motion_numbers import BESIDE, OF_LAWS, OF_MOTION, OF_SETTLEMENT, OF_WORK
from dembrick.views.number_lines import KeyNumber, evaluate, no_bar, refuses_refining
from dembrick.views.summary import (
    ROUNDING,
    ValueWithRemark,
    angle_text,
    known,
    length,
    limit_text,
    mechanism,
    number,
    outward,
    part,
    path_dependence_unknown,
    peak_text,
    start_text,
    texts,
    with_error,
    yield_point,
)

_CARRIED = {"N": "N", "V_1": "N", "V_2": "N", "M_T": "N m"}
_REACHED = 1e-3  # of a limit: a record whose peak is this close has reached it


def key_numbers(results: Mapping, unit: str = "N") -> list[KeyNumber]:
    """Key numbers of a run: the limit load with its bracket, theory beside it, the mechanism, the collapse.

    ``unit``: that of the load of actuators, "1" for a load factor.
    """
    lines = []
    if isinstance(results.get("error"), str):
        lines.append(KeyNumber("no answer", results["error"]))
    if isinstance(results.get("answer"), str) and results["answer"] != results.get("error"):
        lines.append(KeyNumber("answer", results["answer"]))
    collapse, path = part(results, "collapse"), part(results, "path")
    point = yield_point(results)
    of_blocks = collapse or unit == "1"
    lines += evaluate(OF_SETTLEMENT, results)
    lines += _of_collapse(collapse, point, results)
    if not isinstance(results.get("error"), str):  # the last load of a failed run is no limit
        lines += _of_yield(point, "" if of_blocks else unit, results, path | collapse)
        lines += structure.of_path(path | collapse, "" if of_blocks else unit)
        lines += structure.of_collapse(results if "hinges" in results else collapse)
    lines += cycle_numbers(results.get("cycles"), unit)
    lines += evaluate(BESIDE, results)
    lines += _after(part(results, "after"), "" if of_blocks else unit)
    lines += _of_theory(part(results, "theory"), unit)
    at_rest = point or part(results, "settlement") or part(results, "statics")
    lines += [] if at_rest else evaluate(OF_MOTION, results)
    lines += evaluate(OF_LAWS, results)
    for of in (structure.of_stages, structure.of_ties, structure.of_reactions):
        lines += of(results)
    lines += evaluate(OF_WORK, results)
    return lines


def _of_yield(point: dict, unit: str, results: Mapping, path: dict) -> list[KeyNumber]:
    """The limit load in N, or without a unit the load factor of a structure; ``path``: the results beside the limit of
    an assembly."""
    if "V" not in point:
        return []
    load, limit = ("V", "limit load V") if unit else ("load factor", "load factor")
    open_ended = point.get("bracket", "open") == "open" or not {"V_lower", "V_upper"} <= point.keys()
    timed = results.get("simulated_time") is not None
    told = _limit(point, unit, results, path, open_ended)
    if open_ended and not timed and "displacement" in point:  # the end of a path in the deformed geometry
        falls = ", where blocks fall" if results.get("status") == "collapse" else ""
        at = f"at the end, {length(point['displacement'])}{falls}"
        told = told._replace(remark=told.remark.replace("at the end", at, 1))
    if "path_dependent" not in path and not open_ended and results.get("path_dependent") is True:
        told = told._replace(remark=f"{told.remark}; of this path")
    lines = [KeyNumber(load if open_ended else limit, *told)]
    start = start_text(path, unit)
    if start is not None:
        lines.append(KeyNumber("start", start))
    if "V_peak" in point:
        lines.append(KeyNumber(f"largest {load}", *_largest(point, unit, results, path, open_ended and not timed)))
    least = ROUNDING * abs(point.get("N", 0.0))
    shown = {name: 0.0 if abs(point[name]) <= least else point[name] for name in _CARRIED if name in point}
    carried = [f"{name} = {shown[name]:.5g} {_CARRIED[name]}" for name in shown]
    if carried:
        at_limit = "limit_at" in point or point.get("bracket") == "certified" or not (timed or open_ended)
        which = f"{point['joint']}, " if "joint" in point else ""
        when = "at the largest load" if _short_of_the_limit(point) else "at the limit" if at_limit else "at the end"
        lines.append(KeyNumber("joint forces", ", ".join(carried), f"{which}{when}"))
    if mechanism({"collapse": path}) != "none":
        lines.append(KeyNumber("mechanism", mechanism({"collapse": path})))
    elif "mechanism" in point:
        centre = point.get("torsion_centre")
        # + 0.0 turns a negative zero into zero
        x, y = (0.0, 0.0) if centre is None else (round(1e3 * x, 4) + 0.0 for x in centre)
        remark = "" if centre is None else f"rotation about ({x:.5g}, {y:.5g}) mm from O"
        lines.append(KeyNumber("mechanism", point["mechanism"], remark))
    return lines


def _limit(point: dict, unit: str, results: Mapping, path: dict, open_ended: bool) -> ValueWithRemark:
    """The limit load with its error bar, and its proven bounds."""
    said = limit_text(point, path, unit)
    if path_dependence_unknown(path):
        bound = number(part(path, "associative").get("upper"))
        most = "" if bound is None else f", at most {bound:.5g} {unit}".rstrip() + " on any path"
        bounded = ", --bound an upper bound" if bound is None else ""
        advice = "" if refuses_refining(results) else f"; --refine gives the range{bounded}"
        return ValueWithRemark(said.value, f"{said.remark}{most}{advice}")
    if open_ended:
        return said
    remark = said.remark.replace("indicator", "indicator, not certified")
    if not ("meet" in remark or " to " in said.value):  # these texts give the bounds already
        remark += f": bounds {' and '.join(outward(point['V_lower'], point['V_upper']))} {unit}".rstrip()
    return ValueWithRemark(said.value, remark)


def _short_of_the_limit(point: dict) -> bool:
    """Whether the record of a search approaches its limit but ends before reaching it."""
    peak, lower = point.get("V_peak"), point.get("V_lower")
    known = point.get("bracket", "open") != "open" and peak is not None and lower is not None
    return known and abs(peak) < (1.0 - _REACHED) * lower


def _largest(point: dict, unit: str, results: Mapping, path: dict, on_the_way: bool) -> ValueWithRemark:
    """The largest load of the record; ``on_the_way``: it lies on a path in the deformed geometry, for which refined
    runs give its error."""
    at_rate = results.get("status") == "completed" and results.get("simulated_time") is not None
    peak, where = peak_text(point, path, unit, at_rate)
    error = number(results.get("error_estimate"))
    if not on_the_way:
        if _short_of_the_limit(point):
            share = 100.0 * point["V_peak"] / point["V_lower"]
            where += f", {share:.3g} % of the limit, which it approaches gradually"
        return ValueWithRemark(peak, where)
    if error is None:
        return ValueWithRemark(peak, f"{where}; {no_bar(results)}")
    return ValueWithRemark(with_error(point["V_peak"], error, unit), f"{where}, from refined runs")


def cycle_numbers(cycles: object, unit: str) -> list[KeyNumber]:
    """Peaks of both halves of each cycle with error bars, and the dissipated energy; ``unit``: that of the load."""
    lines = []
    for count, cycle in enumerate(cycles if isinstance(cycles, list) else [], 1):
        columns = [part({"": cycle}, "").get(name) for name in ("peak", "V_lower", "V_upper")]
        if not all(isinstance(column, list) and [number(V) for V in column] == column for column in columns):
            continue
        peaks = [with_error(V, max(b - V, V - a), "") for V, a, b in zip(*columns, strict=False)]
        work, damping, residual = (number(cycle.get(name)) for name in ("dissipated", "damping", "residual"))
        remark = "its loop is not closed" if work is None else f"dissipated {work:.5g} J"
        remark += "" if damping is None else f", damping {100.0 * damping:.3g} %"
        remark += "" if residual is None else f", residual {1e3 * residual:.4g} mm"
        lines.append(KeyNumber(f"cycle {count}", f"peaks {' and '.join(peaks)}{' N' if unit == 'N' else ''}", remark))
    return lines


def _after(after: dict, unit: str) -> list[KeyNumber]:
    """Other blocks that move beyond the limit, and the load at which they do: in ``unit``, or a factor without one."""
    moved, load, names = number(after.get("displacement")), number(after.get("load")), texts(after.get("blocks"))
    if moved is None or not names:
        return []
    told = f"by {after.get('mechanism')}, to {length(moved)}"
    if load is not None:
        told += f", at V = {load:.3g} {unit}" if unit else f", at a load factor of {load:.3g}"
    return [KeyNumber("beyond the limit", listed(names), f"{told}; --frame last shows it")]


def _of_theory(theory: dict, unit: str) -> list[KeyNumber]:
    V, error = number(theory.get("V")), number(theory.get("error"))
    if V is None:
        return []
    remark = "" if error is None else f"simulation {100.0 * error:+.2g} %"
    gap = number(theory.get("discretisation_error"))
    if gap is not None:
        remark += f"{'; ' if remark else ''}the points deviate from the continuum by {100.0 * gap:.2g} %"
    return [KeyNumber("theory", f"{V:.7g} {unit.strip('1')}".rstrip(), remark)]


def _of_collapse(collapse: dict, point: dict, results: Mapping) -> list[KeyNumber]:
    """The angle of the table; without a bracket also the load factor with its error estimate and the mechanism."""
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
        remarks += [no_bar(results)] if error is None else []
        lines.append(KeyNumber("collapse angle", text, "; ".join(remarks)))
        if onset is not None:
            lines.append(KeyNumber("onset", f"{onset:.4g} deg", "where the first block loses equilibrium"))
    if factor is not None and "V" not in point:
        text = f"{factor:.5g}" if bar is None else with_error(factor, abs(bar), "")
        source = "from refined runs" if bar is not None else "" if lines else no_bar(results)
        lines.append(KeyNumber("load factor", text, source))
    if isinstance(collapse.get("mechanism"), str) and "V" not in point:
        lines.append(KeyNumber("mechanism", collapse["mechanism"]))
    return lines
