"""Numbers of a run as text: with error bars, to their known digits, in a suitable unit.

A history may come from an untrusted source, so its results are not taken for granted: values that are not finite
numbers are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import NamedTuple

NO_BAR = "no error bar: --refine gives one"
ROUNDING = 1e-7  # of N (moments: times 1 m): smaller forces of a joint count as zero
_MEET = 1e-9  # of V: bounds closer than this coincide but for rounding
_TINY = 5e-7  # of a value: not visible in seven digits
_SHORT, _LONG = 2e-4, 2.0  # m: displacements up to the first are given in µm, from the second on in m
_MANY = 1e4  # N: loads from here on are given in kN
_UNEVEN = 0.05  # of a bracket: V may be off its middle by as much and still be printed as V ± half the bracket


def number(value) -> float | None:
    """A finite number as float, None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        value = float(value)
    except OverflowError:
        return None
    return value if math.isfinite(value) else None


def part(results, name: str) -> dict:
    """A mapping inside the results, empty if it is missing or of another type."""
    found = results.get(name) if isinstance(results, Mapping) else None
    return dict(found) if isinstance(found, Mapping) else {}


def yield_point(results) -> dict[str, float]:
    """The finite numbers of the yield point by name; ``torsion_centre`` a pair, ``bracket`` and ``mechanism`` texts.

    If refined runs gave an error estimate, it sets the bracket.
    """
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
    error = number(results.get("error_estimate")) if isinstance(results, Mapping) else None
    if error is not None and "V" in point and point.get("bracket") == "indicator":
        point |= {"V_lower": point["V"] - error, "V_upper": point["V"] + error, "bracket": "refined"}
    return point


def with_error(value: float, half_width: float, unit: str) -> str:
    """``215.988 ± 0.068 N``, see `barred`; the value alone if the error is only rounding."""
    text = f"{value:.7g}" if half_width <= _MEET * abs(value) else " ± ".join(barred(value, half_width))
    return f"{text} {unit}".rstrip()


def barred(value: float, error: float) -> tuple[str, str]:
    """A value rounded to the second digit of its ``error``, and the error to two digits, rounded up. The error includes
    the rounding of the value, so that the printed interval contains the true one."""
    if not 0.0 < error < math.inf:
        return f"{value:.7g}", rounded_up(error)
    decimals = max(0, 1 - _magnitude(error))
    fixed = decimals <= 12 and error < 1e6
    digits = _magnitude(value) - _magnitude(error) + 2 if value else 1
    shown = f"{value:.{decimals}f}" if fixed else f"{value:.{min(9, max(1, digits))}g}"
    digits = max(2, _magnitude(error) + 1) if fixed else 2
    bar = rounded_up(error + abs(value - float(shown)), digits)
    return shown, f"{float(bar):.{decimals}f}" if fixed and error > _TINY * abs(value) else bar


def bar_to(decimals: int, value: float, error: float) -> str:
    """The error of a value shown to ``decimals``, rounded up to as many; it includes the rounding of the value."""
    last = 10.0**-decimals
    return f"{math.ceil((error + abs(value - round(value, decimals))) / last * (1.0 - _MEET)) * last:.{decimals}f}"


def outward(lower: float, upper: float) -> tuple[str, str]:
    """Bounds to the third digit of their difference, the lower one rounded down, the upper one rounded up."""
    width = upper - lower
    if not width > _MEET * abs(upper):
        return f"{lower:.9g}", f"{upper:.9g}"
    last = Decimal(1).scaleb(min(0, _magnitude(width) - 2))
    low, high = (Decimal(repr(float(end))) for end in (lower, upper))
    ends = [f"{low.quantize(last, ROUND_FLOOR):f}", f"{high.quantize(last, ROUND_CEILING):f}"]
    while all("." in end and end[-1] in "0." for end in ends):
        ends = [end[:-1] for end in ends]
    return ends[0], ends[1]


def rounded_up(error: float, digits: int = 2) -> str:
    """An error rounded up to ``digits``: a bar that was rounded down could exclude the true value."""
    if not 0.0 < error < math.inf:
        return f"{error:.{digits}g}"
    last = 10.0 ** (_magnitude(error) + 1 - digits)
    return f"{math.ceil(error / last * (1.0 - _MEET)) * last:.{digits}g}"


def known(value: float, error: float | None, most: int = 6) -> str:
    """A value rounded to the second digit of its ``error``, to ``most`` digits at most.

    Two digits if the error is None, which means unknown.
    """
    digits = 2 if error is None else most
    if error and value:
        digits = min(most, max(1, _magnitude(value) - _magnitude(error) + 2))
    text = f"{value:.{digits}g}"
    return f"{float(text):.15g}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def _magnitude(value: float) -> int:
    """The exponent of ten of the first digit."""
    return math.floor(math.log10(abs(value)))


def path_dependence_unknown(beside: Mapping) -> bool:
    """Whether a limit load may depend on the stiffness by an unknown amount; ``beside``: ``collapse`` or ``path``."""
    told = beside.get("path_range") or beside.get("wanders")
    return beside.get("digits_open", beside.get("path_dependent")) is True and told is None


def start_text(beside: Mapping, unit: str) -> str | None:
    """Start of the path to a limit load, and what is proven for other paths (``beside``: ``collapse`` or ``path``);
    None if all paths lead to the same limit, or if their range is known."""
    if beside.get("path_dependent") is not True or beside.get("path_range") or "no_path_above" not in beside:
        return None
    bound = number(part(beside, "associative").get("upper"))
    more = "another path may bear more"
    if bound is not None:
        more = f"no path bears more than {known(bound, 0.0, 5)} {unit}".rstrip() + " (associative)"
    if beside.get("no_path_above") is True:
        more = "no path bears more"
    start = "with the forces locked in by the stages" if beside.get("locked_in") else "without forces locked in"
    return f"{start}: {more}, another history may bear less"


def travel_unit(longest: float) -> tuple[str, float]:
    """A suitable unit for displacements up to ``longest`` (m) on an axis, and the factor from m to it."""
    if longest >= _LONG:
        return "m", 1.0
    return ("mm", 1e3) if longest > _SHORT else ("µm", 1e6)


def load_unit(largest: float, unit: str = "N") -> tuple[str, float]:
    """A suitable unit for loads up to ``largest`` on an axis, and the factor from ``unit`` to it; only N and N m get a
    prefix."""
    if unit.split(" ")[0] != "N" or not largest >= _MANY:
        return unit, 1.0
    return (f"k{unit}", 1e-3) if largest < 1e3 * _MANY else (f"M{unit}", 1e-6)


def load_text(value: float, unit: str = "N") -> str:
    """A load to four digits in a suitable unit."""
    name, factor = load_unit(abs(value), unit)
    return f"{factor * value:.4g} {name}"


class ValueWithRemark(NamedTuple):
    """A number as text: its value with unit and error bar, and a remark, of a limit load the kind of the bar."""

    value: str
    remark: str = ""

    def __str__(self) -> str:
        return f"{self.value} ({self.remark})" if self.remark else self.value


def limit_text(point: Mapping, beside: Mapping | None, unit: str) -> ValueWithRemark:
    """The limit load of a yield point as text, the same in all commands, figures and pages.

    ``beside``: the results beside it, ``collapse`` or ``path``. V ± half its bracket if V is its middle, else both
    bounds; two digits if V depends on the path by an unknown amount.
    """
    V, lower, upper, kind = point["V"], point.get("V_lower"), point.get("V_upper"), point.get("bracket", "open")
    if lower is None or upper is None or kind == "open":
        least = "" if lower is None or lower >= V else f"; the limit is at least {lower:.6g} {unit}".rstrip()
        bound = number(part(beside, "associative").get("upper"))
        most = "no upper bound" if bound is None else f"at most {bound:.6g} {unit}".rstrip() + " by limit analysis"
        if lower is not None and lower >= V and (beside or {}).get("wanders"):  # the greatest load carried
            return ValueWithRemark(f"at least {V:.6g} {unit}".rstrip(), most)
        return ValueWithRemark(f"{V:.6g} {unit}".rstrip(), f"at the end, {most}{least}")
    if path_dependence_unknown(beside or {}):
        return ValueWithRemark(f"about {known(V, None)} {unit}".rstrip(), "of this path")
    above, below = upper - V, V - lower
    if max(above, below) <= _MEET * abs(V):
        return ValueWithRemark(with_error(V, 0.0, unit), f"{kind}: the two bounds meet")
    if abs(above - below) <= _UNEVEN * (above + below):
        return ValueWithRemark(with_error(V, max(above, below), unit), kind)
    return ValueWithRemark(f"{' to '.join(outward(lower, upper))} {unit}".rstrip(), kind)


def angle_text(point: Mapping, beside: Mapping | None) -> ValueWithRemark:
    """Like `limit_text` for a tilting table, in degrees: V is the tangent of its angle."""
    return limit_text(*converted(point, beside, lambda V: math.degrees(math.atan(V))), "deg")


def converted(point: Mapping, beside: Mapping | None, to: Callable[[float], float]) -> tuple[dict, dict]:
    """A yield point and the results ``beside`` it with all that `limit_text` reads of V converted ``to`` another
    unit."""
    loads = {name: to(point[name]) for name in ("V", "V_lower", "V_upper") if point.get(name) is not None}
    bound = number(part(beside, "associative").get("upper"))
    bounded = {} if bound is None else {"associative": {"upper": to(bound)}}
    return {**point, **loads}, {**(beside or {}), **bounded}


def peak_text(point: Mapping, beside: Mapping | None, unit: str, at_rate: bool) -> tuple[str, str]:
    """The largest load of the record, to the known digits of its limit, and where it was reached; ``at_rate``: in a
    constant-rate test."""
    lower, upper = point.get("V_lower"), point.get("V_upper")
    error = 0.0 if lower is None or upper is None else 0.1 * (upper - lower)
    value = f"{known(point['V_peak'], None if path_dependence_unknown(beside or {}) else error)} {unit}".rstrip()
    where = f"at {length(point['displacement_at_peak'])}, " if "displacement_at_peak" in point else ""
    return value, f"{where}the largest {'of the record, with its rate effect' if at_rate else 'in equilibrium'}"


def mechanism(results: Mapping) -> str:
    """Mechanism at a limit: of the whole structure under a load on every block, of the joint under actuators."""
    found = part(results, "collapse").get("mechanism") or part(results, "yield_point").get("mechanism")
    return found if isinstance(found, str) else "none"


def plain(text: str) -> str:
    """A text with characters that every terminal can show."""
    return text.replace("±", "+-").replace("µ", "u")


def length(metres: float, error: float | None = None) -> str:
    """A small length, with its error bar (m) as `with_error` if it has one, in a unit that suits the length."""
    unit, factor = length_unit(metres)
    return f"{metres * factor:.4g} {unit}" if error is None else with_error(factor * metres, factor * error, unit)


def length_unit(metres: float) -> tuple[str, float]:
    """A suitable unit for a small length, and the factor from m to it."""
    for unit, factor, least in (("m", 1.0, 1.0), ("mm", 1e3, 0.1)):
        if abs(metres) * factor >= least:
            return unit, factor
    return "µm", 1e6


def texts(value: object) -> list[str]:
    """The texts of a list, empty for anything else."""
    return [name for name in value if isinstance(name, str)] if isinstance(value, list) else []
