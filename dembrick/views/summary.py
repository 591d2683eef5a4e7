"""The key numbers of a run as words, each with its error bar, out of the object of ``run --json``.

A history may come from anywhere, so nothing in its results is taken for granted: what is not a finite number is left
out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

_CARRIED = {"N": "N", "V_1": "N", "V_2": "N", "M_T": "N m"}
_ROUNDING = 1e-9  # of N (times 1 m): forces below are not there
_NO_BAR = "no error bar (--refine gives one)"
_MEET = 1e-9  # of V: bounds closer than this meet, but for rounding
_TINY = 5e-7  # of a value: what no digit of seven shows
_SHORT, _LONG = 2e-4, 2.0  # m: travels up to the one are told in µm, from the other on in m
_MANY = 1e4  # N: from there on loads are told in kN
_UNEVEN = 0.05  # of a bracket: as far as V may be off its middle and stand with half of it


class KeyNumber(NamedTuple):
    """One line of a summary: what it is, its value with unit and error bar, and what to know about it."""

    name: str
    value: str
    remark: str = ""


def number(value) -> float | None:
    """A finite number as it is, None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        value = float(value)
    except OverflowError:
        return None
    return value if math.isfinite(value) else None


def part(results, name: str) -> dict:
    """A mapping inside the results, empty if it is missing or something else."""
    found = results.get(name) if isinstance(results, Mapping) else None
    return dict(found) if isinstance(found, Mapping) else {}


def yield_point(results) -> dict[str, float]:
    """The finite numbers of the yield point by name; ``torsion_centre`` a pair, ``bracket`` and ``mechanism`` texts."""
    found = part(results, "yield_point")
    point: dict = {name: number(value) for name, value in found.items()}
    point = {name: value for name, value in point.items() if value is not None}
    point |= {name: found[name] for name in ("bracket", "mechanism") if isinstance(found.get(name), str)}
    joint = found.get("joint")
    if isinstance(joint, list | tuple) and len(joint) == 2:
        point["joint"] = " / ".join(map(str, joint))
    centre = found.get("torsion_centre")
    if isinstance(centre, list | tuple) and len(centre) == 2:
        centre = tuple(number(x) for x in centre)
        if None not in centre:
            point["torsion_centre"] = centre
    return point


def with_error(value: float, half_width: float, unit: str) -> str:
    """``215.988 ± 0.067 N``: the error to two digits, the value as far as the error lets it be known."""
    if half_width <= _MEET * abs(value):
        return f"{value:.7g} {unit}"
    if half_width <= _TINY * abs(value):
        return f"{value:.7g} ± {half_width:.2g} {unit}"
    digits = max(0, 1 - math.floor(math.log10(half_width)))
    if digits > 12 or half_width >= 1e6:
        return f"{value:.9g} ± {half_width:.2g} {unit}"
    return f"{value:.{digits}f} ± {half_width:.{digits}f} {unit}"


def known(value: float, error: float | None, most: int = 6) -> str:
    """A value to the digits that its ``error`` leaves known: as far as the second digit of it, ``most`` at most.

    Two digits if the error is None: nobody knows it.
    """
    digits = 2 if error is None else most
    if error and value:
        digits = min(most, max(1, _magnitude(value) - _magnitude(error) + 2))
    text = f"{value:.{digits}g}"
    return f"{float(text):.15g}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def _magnitude(value: float) -> int:
    """The power of ten of the first digit."""
    return math.floor(math.log10(abs(value)))


def on_one_path(beside: Mapping) -> bool:
    """Whether the stiffness may move a limit load, and nothing tells how far (``collapse`` or ``path``)."""
    told = beside.get("path_range") or beside.get("wanders")
    return beside.get("digits_open", beside.get("path_dependent")) is True and told is None


def start_text(beside: Mapping, unit: str) -> str | None:
    """From what the path to a limit load began, and what is proven of others (``collapse`` or ``path``); None where all
    lead to the same limit, or where their range is known."""
    if beside.get("path_dependent") is not True or beside.get("path_range") or "no_path_above" not in beside:
        return None
    bound = number(part(beside, "associative").get("upper"))
    more = "another path may bear more"
    if bound is not None:
        more = f"no path bears more than {known(bound, 0.0, 5)} {unit}".rstrip() + " (associative)"
    if beside.get("no_path_above") is True:
        more = "no path bears more"
    start = "from what the stages left in the joints" if beside.get("locked_in") else "without forces locked in"
    return f"{start}: {more}, another history may bear less"


def travel_unit(longest: float) -> tuple[str, float]:
    """The unit that suits travels up to ``longest`` (m) on an axis, and how many of it are a metre."""
    if longest >= _LONG:
        return "m", 1.0
    return ("mm", 1e3) if longest > _SHORT else ("µm", 1e6)


def load_unit(largest: float, unit: str = "N") -> tuple[str, float]:
    """The unit that suits loads up to ``largest`` on an axis (``unit``: N, N m, or one without thousands), and how many
    of it are one of ``unit``."""
    if unit.split(" ")[0] != "N" or not largest >= _MANY:
        return unit, 1.0
    return (f"k{unit}", 1e-3) if largest < 1e3 * _MANY else (f"M{unit}", 1e-6)


def load_text(value: float, unit: str = "N") -> str:
    """A load to four digits in the unit that suits it."""
    name, factor = load_unit(abs(value), unit)
    return f"{factor * value:.4g} {name}"


class Limit(NamedTuple):
    """A limit load as words: its ``value`` with error bar and unit, and what ``kind`` of bar that is."""

    value: str
    kind: str

    def __str__(self) -> str:
        return f"{self.value} ({self.kind})"


def limit_text(point: Mapping, beside: Mapping | None, unit: str) -> Limit:
    """The limit load of a yield point as every command, figure and page says it.

    ``beside``: what stands beside it, ``collapse`` or ``path``. V with half its bracket if it is the middle of it, else
    with both bounds; two digits if it depends on the path, and nothing tells how far.
    """
    V, lower, upper, kind = point["V"], point.get("V_lower"), point.get("V_upper"), point.get("bracket", "open")
    if lower is None or upper is None or kind == "open":
        least = "" if lower is None or lower >= V else f"; the limit is at least {lower:.6g} {unit}".rstrip()
        bound = part(beside, "associative").get("upper")
        most = "no upper bound" if bound is None else f"at most {bound:.6g} {unit}".rstrip() + " by limit analysis"
        return Limit(f"{V:.6g} {unit}".rstrip(), f"at the end, {most}{least}")
    if on_one_path(beside or {}):
        return Limit(f"about {known(V, None)} {unit}".rstrip(), "of this path")
    above, below = upper - V, V - lower
    if max(above, below) <= _MEET * abs(V):
        return Limit(with_error(V, 0.0, unit).rstrip(), f"{kind}: the two bounds meet")
    if abs(above - below) <= _UNEVEN * (above + below):
        return Limit(with_error(V, max(above, below), unit).rstrip(), kind)
    return Limit(f"{' to '.join(_to_width((lower, upper), upper - lower))} {unit}".rstrip(), kind)


def _to_width(values: Sequence[float], width: float) -> list[str]:
    """Values to the third digit of a ``width``."""
    digits = max(0, 2 - _magnitude(width))
    return [f"{value:.{digits}f}" if digits <= 12 else f"{value:.9g}" for value in values]


def angle_text(point: Mapping, beside: Mapping | None) -> Limit:
    """The same of a table that tilts, in degrees: V is the tangent of its angle."""
    names = ("V", "V_lower", "V_upper")
    turned = {name: math.degrees(math.atan(point[name])) for name in names if point.get(name) is not None}
    return limit_text({**point, **turned}, beside, "deg")


def peak_text(point: Mapping, beside: Mapping | None, unit: str, at_rate: bool) -> tuple[str, str]:
    """The largest load of the record, to the digits that its limit is known by, and where it was; ``at_rate``: of a
    constant-rate test."""
    lower, upper = point.get("V_lower"), point.get("V_upper")
    error = 0.0 if lower is None or upper is None else 0.1 * (upper - lower)
    value = f"{known(point['V_peak'], None if on_one_path(beside or {}) else error)} {unit}".rstrip()
    where = f"at {length(point['displacement_at_peak'])}, " if "displacement_at_peak" in point else ""
    return value, f"{where}the largest {'of the record, with its rate effect' if at_rate else 'in equilibrium'}"


def mechanism(results: Mapping) -> str:
    """How the blocks give way at a limit: of a load on every block all of them, of actuators their joint."""
    found = part(results, "collapse").get("mechanism") or part(results, "yield_point").get("mechanism")
    return found if isinstance(found, str) else "none"


def plain(text: str) -> str:
    """A text in characters that every terminal has."""
    return text.replace("±", "+-").replace("µ", "u")


def length(metres: float) -> str:
    """A small length in the unit that suits it."""
    for unit, factor, least in (("m", 1.0, 1.0), ("mm", 1e3, 0.1)):
        if abs(metres) * factor >= least:
            return f"{metres * factor:.4g} {unit}"
    return f"{metres * 1e6:.4g} µm"


def key_numbers(results: Mapping, unit: str = "N") -> list[KeyNumber]:
    """Key numbers of a run: the limit load with its bracket, theory beside it, the mechanism, the collapse.

    ``unit`` of the load of actuators, "1" for a factor.
    """
    lines = []
    if isinstance(results.get("error"), str):
        lines.append(KeyNumber("no answer", results["error"]))
    if isinstance(results.get("answer"), str):
        lines.append(KeyNumber("answer", results["answer"]))
    point, collapse, path = yield_point(results), part(results, "collapse"), part(results, "path")
    of_blocks = collapse or unit == "1"
    at_rate = results.get("status") == "completed" and results.get("simulated_time") is not None
    lines += _of_collapse(collapse, point)
    if not isinstance(results.get("error"), str):  # what a run that failed had come to is no limit
        lines += _of_yield(point, "" if of_blocks else unit, at_rate, path | collapse)
    lines += cycle_numbers(results.get("cycles"), unit)
    lines += _after(part(results, "after"))
    lines += _of_theory(part(results, "theory"))
    lines += _of_settlement(part(results, "settlement"), collapse)
    lines += _of_motion(results) if not (point or collapse or results.get("settlement")) else []
    audit = part(results, "energy")
    residual, stepping = number(audit.get("relative_residual")), number(audit.get("step_error"))
    if residual is not None:
        remark = "residual over the energy put in"
        if stepping is not None:
            remark += f"; {stepping:.1e} of it went in joints that open or close within a step"
        lines.append(KeyNumber("energy balance", f"{residual:.1e}", remark))
    steps, seconds = number(results.get("steps")), number(part(results, "wall").get("loop"))
    if steps is not None:
        lines.append(KeyNumber("steps", f"{steps:.0f}", "" if seconds is None else f"{seconds:.2g} s in the loop"))
    return lines


def _of_yield(point: dict, unit: str, at_rate: bool, path: dict) -> list[KeyNumber]:
    """The limit load in N, or without a unit the load factor of a structure; ``at_rate``: of a constant-rate test;
    ``path``: what stands beside the limit of an assembly."""
    load = ("V", "limit load V") if unit else ("load factor", "load factor")
    if "V" not in point:
        return []
    said, alone = limit_text(point, path, unit), on_one_path(path)
    lower, upper = point.get("V_lower"), point.get("V_upper")
    is_open = lower is None or upper is None or point.get("bracket", "open") == "open"
    remark = said.kind
    if alone:
        bound = number(part(path, "associative").get("upper"))
        remark += "" if bound is None else f", at most {bound:.5g} {unit}".rstrip() + " on any"
        remark += "; --refine gives the range"
    elif not is_open:
        remark = remark.replace("indicator", "indicator, not certified")
        remark += "" if "meet" in remark else f": bounds {lower:.7g} and {upper:.7g} {unit}".rstrip()
    lines = [KeyNumber(load[0] if is_open else load[1], said.value, remark)]
    start = start_text(path, unit)
    if start is not None:
        lines.append(KeyNumber("start", start))
    if "V_peak" in point:
        lines.append(KeyNumber(f"largest {load[0]}", *peak_text(point, path, unit, at_rate)))
    least = _ROUNDING * abs(point.get("N", 0.0))
    shown = {name: 0.0 if abs(point[name]) <= least else point[name] for name in _CARRIED if name in point}
    carried = [f"{name} = {shown[name]:.5g} {_CARRIED[name]}" for name in shown]
    if carried:
        lines.append(KeyNumber("the joint carries", ", ".join(carried), point.get("joint", "")))
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
        peaks = [f"{known(V, 0.5 * (b - a))} ± {0.5 * (b - a):.1g}" for V, a, b in zip(*columns, strict=False)]
        work, damping, residual = (number(cycle.get(name)) for name in ("dissipated", "damping", "residual"))
        remark = "its loop does not close" if work is None else f"dissipated {work:.5g} J"
        remark += "" if damping is None else f", damping {100.0 * damping:.3g} %"
        remark += "" if residual is None else f", residual {1e3 * residual:.4g} mm"
        lines.append(KeyNumber(f"cycle {count}", f"peaks {' and '.join(peaks)}{' N' if unit == 'N' else ''}", remark))
    return lines


def _after(after: dict) -> list[KeyNumber]:
    """Line on the blocks that move on beyond the limit."""
    moved, names = number(after.get("displacement")), after.get("blocks")
    if moved is None or not isinstance(names, list) or not names:
        return []
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return [KeyNumber("beyond the limit", f"{names[0]}{more}", f"by {after.get('mechanism')}, to {length(moved)}")]


def _of_theory(theory: dict) -> list[KeyNumber]:
    V, error = number(theory.get("V")), number(theory.get("error"))
    if V is None:
        return []
    remark = "" if error is None else f"simulation {100.0 * error:+.2g} %"
    gap = number(theory.get("discretisation_error"))
    if gap is not None:
        remark += f"{'; ' if remark else ''}the points miss the continuum by {100.0 * gap:.2g} %"
    return [KeyNumber("theory", f"{V:.7g} N", remark)]


def _of_motion(results: Mapping) -> list[KeyNumber]:
    """How far the block came that moved most, at any time and at the end."""
    ways = {name: number(way) for name, way in part(results, "greatest_displacement").items()}
    ways = {name: way for name, way in ways.items() if way is not None}
    lines = []
    if isinstance(results.get("outcome"), str):
        lines.append(KeyNumber("outcome", results["outcome"]))
    drift = part(results, "drift")
    value = number(drift.get("value"))
    if value is not None:
        remark = f"displacement over height of {drift.get('block')}, at any time"
        lines.append(KeyNumber("drift", f"{100.0 * value:.3g} %", remark))
    if ways:
        furthest = max(ways, key=lambda name: ways[name])
        remark = f"of the centroid of {furthest}, at any time"
        lines.append(KeyNumber("greatest displacement", length(ways[furthest]), remark))
    moved, error = number(results.get("displacement")), number(results.get("displacement_error"))
    if moved is not None:
        value = length(moved) if error is None else with_error(moved, error, "m")
        remark = "of a centroid; " + (_NO_BAR if error is None else "from stiffer joints")
        name = "residual displacement" if "outcome" in results else "displacement at the end"
        lines.append(KeyNumber(name, value, remark))
    peaks = [number(tie.get("peak")) for tie in results.get("ties") or () if isinstance(tie, Mapping)]
    known_peaks = [peak for peak in peaks if peak is not None]
    if known_peaks:
        lines.append(KeyNumber("peak tie force", load_text(max(known_peaks)), "of all ties, at any time"))
    return lines


def _of_settlement(found: dict, collapse: dict) -> list[KeyNumber]:
    """Where the structure came down, and the reaction along the motion of its supports."""
    lines = []
    at, bar = number(collapse.get("settlement")), number(collapse.get("error_estimate"))
    if at is not None:
        text = f"{at:.5g} m" if bar is None else with_error(at, abs(bar), "m")
        lines.append(KeyNumber("settlement at collapse", text, _NO_BAR if bar is None else "from runs refined"))
    reaction, bar, reached = (number(found.get(key)) for key in ("reaction", "reaction_error", "displacement"))
    if reaction is not None:
        text = f"{reaction:.6g} N" if bar is None else with_error(reaction, abs(bar), "N")
        remark = "" if reached is None else f"at {length(reached)}; "
        lines.append(KeyNumber("reaction along the motion", text, remark + (_NO_BAR if bar is None else "refined")))
    for key in ("least", "greatest"):
        one = part(found, key)
        value, where = number(one.get("reaction")), number(one.get("displacement"))
        if value is not None and where is not None:
            lines.append(KeyNumber(f"{key} reaction", f"{value:.6g} N", f"at {length(where)}"))
    return lines


def _of_collapse(collapse: dict, point: dict) -> list[KeyNumber]:
    """The angle of the table; and where no bracket tells it, the load factor with its estimate and the mechanism."""
    lines = []
    angle, factor, bar = (number(collapse.get(key)) for key in ("angle", "load_factor", "error_estimate"))
    if angle is not None and "V" in point:
        lines.append(KeyNumber("collapse angle", *angle_text(point, collapse)))
    elif angle is not None:
        # angle = atan(factor)
        error = None if bar is None else math.degrees(abs(bar) * math.cos(math.radians(angle)) ** 2)
        text = f"{known(angle, 0.0, 5)} deg" if error is None else with_error(angle, error, "deg")
        lines.append(KeyNumber("collapse angle", text, _NO_BAR if error is None else ""))
    if factor is not None and "V" not in point:
        text = f"{factor:.5g}" if bar is None else with_error(factor, abs(bar), "").rstrip()
        source = "from the run refined" if bar is not None else "" if lines else _NO_BAR
        lines.append(KeyNumber("load factor", text, source))
    if isinstance(collapse.get("mechanism"), str) and "V" not in point:
        lines.append(KeyNumber("mechanism", collapse["mechanism"]))
    return lines
