"""Key numbers of a structure besides its limit load: other load paths, blocks and hinges, stages, ties, reactions.

The results may come from an untrusted file, so values of unexpected types are skipped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dembrick.scenario.checks import listed
from dembrick.scenario.controls import CONTROLS
from dembrick.scenario.regimes import ACTUATORS
from dembrick.views.number_lines import KeyNumber
from dembrick.views.summary import ValueWithRemark, known, length, limit_text, number, part, texts, yield_point

BEFORE = "before the supports moved"
_SHOWN = 8  # greatest number of supports, or ties, with a line each
_OF_STAGE = 2  # greatest number of supports in the line of a stage
_ROUNDING = 1e-7  # of the largest force or moment: less is printed as zero
_WRENCH = 6  # numbers of a reaction


def of_path(beside: Mapping, unit: str) -> Iterator[KeyNumber]:
    """Lines on the capacity along other paths, from the results beside a limit load in ``unit`` (``collapse`` or
    ``path``)."""
    after, at = number(beside.get("mechanism_load_factor")), number(beside.get("load_factor"))
    if after is not None and at is not None and after < at:
        told = f"{'' if unit else 'load factor '}{known(after, 0.0, 5)} {unit}".rstrip()
        yield KeyNumber("after a peak", told, "the height of the peak depends on the load path")
    if (ends := pair(beside.get("wanders"))) is not None:
        yield KeyNumber("wanders", _range(*ends, unit), "blocks keep snapping, so no narrower limit exists")
    if (ends := pair(beside.get("path_range"))) is not None:
        count = pair(beside.get("paths"))
        by = "" if count is None else f"by {count[0]:.0f} of {count[1]:.0f} paths of the same structure, "
        yield KeyNumber("path range", _range(*ends, unit), f"{by}without their bars")
        upper = number(part(beside, "associative").get("upper"))
        if upper is not None:
            yield KeyNumber("bound", f"{known(upper, 0.0, 5)} {unit}".rstrip(), "associative: no path exceeds it")
        elif beside.get("no_path_above") is True:
            yield KeyNumber("bound", "no path exceeds the limit", "the mechanism obeys normality")


def of_collapse(collapse: Mapping) -> Iterator[KeyNumber]:
    """The blocks that move in the collapse mechanism, and the hinges between them."""
    for key, name in (("blocks", "blocks that move"), ("hinges", "hinges")):
        if isinstance(collapse.get(key), list):
            yield KeyNumber(name, listed(texts(collapse[key])), "")


def of_stages(results: Mapping) -> Iterator[KeyNumber]:
    """The stages before the last: their kind, how they ended, and their limit load, or else the reactions of their
    supports."""
    stages = results.get("stages")
    for stage in stages if isinstance(stages, list) else ():
        count = number(part({"": stage}, "").get("stage"))
        kind, status = (part({"": stage}, "").get(key) for key in ("kind", "status"))
        if count is None or not (isinstance(kind, str) and isinstance(status, str)):
            continue
        point = yield_point(stage)
        pushed = kind in CONTROLS and CONTROLS[kind].drives == ACTUATORS
        limit = limit_text(point, part(stage, "path"), "N" if pushed else "") if "V" in point else None
        load = _borne(stage) if limit is None else f"{'V' if pushed else 'load factor'} = {limit.value}, {limit.remark}"
        yield KeyNumber(f"stage {count:.0f}", f"{kind}: {status}", load)


def _borne(stage: Mapping) -> str:
    """Reactions of the supports in a stage: along their motion if they settle, else at the end if there are several."""
    found = part(stage, "settlement")
    reaction, reached = number(found.get("reaction")), number(found.get("displacement"))
    if reaction is not None and reached is not None:
        said = [f"reaction along the motion {reaction:.6g} N at {length(reached)}"]
        extremes = ((which, extreme_reaction(which, stage)) for which in ("least", "greatest"))
        said += [f"{which} {told.value} {told.remark}" for which, told in extremes if told is not None]
        return ", ".join(said)
    wrenches = _wrenches(stage)
    if len(wrenches) < 2:
        return ""  # a single support carries the weight and no thrust
    forces = _spelled([value for wrench in wrenches.values() for value in wrench[:3]])
    told = [f"{name} {', '.join(forces[3 * i : 3 * i + 3])} N" for i, name in enumerate(wrenches)]
    more = f" and {len(told) - _OF_STAGE} more" if len(told) > _OF_STAGE else ""
    return f"reactions: {'; '.join(told[:_OF_STAGE])}{more}"


def extreme_reaction(which: str, results: Mapping) -> ValueWithRemark | None:
    """The "least" or "greatest" reaction along the motion of supports, and where it was."""
    one = part(part(results, "settlement"), which)
    value, where = number(one.get("reaction")), number(one.get("displacement"))
    if value is None or where is None:
        return None
    return ValueWithRemark(f"{value:.6g} N", f"at {length(where)}" if where else BEFORE)


def ties_of(results: Mapping) -> list[Mapping]:
    """The ties in results."""
    ties = results.get("ties")
    return [tie for tie in ties if isinstance(tie, Mapping)] if isinstance(ties, list) else []


def of_ties(results: Mapping) -> Iterator[KeyNumber]:
    """The tension of each tie, its peak and its yielded elongation."""
    known_ties = ties_of(results)
    for tie in known_ties[:_SHOWN]:
        tension, peak, yielded = (number(tie.get(key)) for key in ("tension", "peak", "yielded"))
        if tension is None:
            continue
        remarks = [] if peak is None else [f"{peak:.6g} N at most"]
        remarks += [f"yielded by {length(yielded)}"] if yielded else []
        yield KeyNumber(f"tie {' - '.join(texts(tie.get('between')))}".rstrip(), f"{tension:.6g} N", ", ".join(remarks))
    if len(known_ties) > _SHOWN:
        yield KeyNumber("more ties", str(len(known_ties) - _SHOWN), "--json lists all")


def of_reactions(results: Mapping) -> Iterator[KeyNumber]:
    """Force and moment that each support exerts on the structure."""
    wrenches = _wrenches(results)
    spelled = _spelled([value for wrench in wrenches.values() for value in wrench])
    when = ", at the end" if "cycles" in results else ", at the last load tried" if results.get("unlimited") else ""
    about = f"about its centroid{when}"
    for i, name in enumerate(list(wrenches)[:_SHOWN]):
        shown = spelled[_WRENCH * i : _WRENCH * (i + 1)]
        force, moment = f"{', '.join(shown[:3])} N", f"{', '.join(shown[3:])} N m {about}"
        yield KeyNumber(f"reaction of {name}", force, moment)
    if len(wrenches) > _SHOWN:
        yield KeyNumber("more supports", str(len(wrenches) - _SHOWN), "--json lists all")


def _wrenches(results: Mapping) -> dict[str, list[float]]:
    """Force (N) and moment (N m) that each support exerts on the structure, by its name."""
    found = {}
    for name, wrench in part(results, "reactions").items():
        numbers = [number(value) for value in wrench] if isinstance(wrench, list) else []
        if isinstance(name, str) and len(numbers) == _WRENCH and None not in numbers:
            found[name] = [value for value in numbers if value is not None]
    return found


def _spelled(values: list[float]) -> list[str]:
    """Forces to six digits; those that are rounding error relative to the largest are printed as 0."""
    least = _ROUNDING * max(map(abs, values), default=0.0)
    return [f"{value:.6g}" if abs(value) > least else "0" for value in values]


def pair(value: object) -> tuple[float, float] | None:
    """Two finite numbers, None for anything else."""
    found = [number(one) for one in value] if isinstance(value, list | tuple) else []
    return (found[0], found[1]) if len(found) == 2 and None not in found else None


def _range(low: float, high: float, unit: str) -> str:
    return f"{known(low, 0.0, 5)} to {known(high, 0.0, 5)} {unit}".rstrip()
