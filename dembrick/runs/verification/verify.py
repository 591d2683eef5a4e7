"""Verification cases: run them, compare value with error bar and reference, and report as text and as an HTML page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from dembrick.errors import DembrickError
from dembrick.runs.outcomes.result import fell
from dembrick.runs.verification.cases import Case
from dembrick.scenario.checks import present
from dembrick.views.summary import barred, rounded_up

SLACK = 1e-9  # of the reference: rounding error by which it may lie outside an error bar


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a case. ``value`` with its bounds ``lower`` and ``upper`` (None: the run gives no bar) in the unit
    of the case; ``failure``: why there is no value; ``seconds``: wall time of the run."""

    case: Case
    value: float | None
    lower: float | None
    upper: float | None
    seconds: float
    failure: str = ""

    @property
    def error(self) -> float | None:
        """Relative difference from the reference; the plain difference if that is zero."""
        if self.value is None:
            return None
        difference = self.value - self.case.reference
        return difference / self.case.reference if self.case.reference else difference

    @property
    def bar_holds(self) -> bool | None:
        """Whether the reference, within its own error, lies in the error bar; None if there is no bar."""
        if self.lower is None or self.upper is None or self.case.relation != "equal":
            return None
        slack = SLACK * abs(self.case.reference) + self.case.reference_error
        return self.lower - slack <= self.case.reference <= self.upper + slack

    @property
    def passed(self) -> bool:
        """Whether the value is within the tolerance, and its bar holds the reference or a remark says why not."""
        if self.error is None:
            return False
        if self.case.relation == "at most":
            return self.error <= SLACK
        return abs(self.error) <= self.case.tolerance and (self.bar_holds is not False or bool(self.case.remark))

    def as_dict(self) -> dict:
        """The row of ``verify --json``."""
        of_case = ("title", "scenario", "quantity", "unit", "source", "reference", "reference_error", "relation")
        case = {name: getattr(self.case, name) for name in (*of_case, "tolerance", "remark")}
        own = ("value", "lower", "upper", "error", "bar_holds", "passed", "seconds", "failure")
        return {
            "case": self.case.name,
            "set": list(self.case.set),
            **case,
            **{name: getattr(self, name) for name in own},
        }


def verify(cases: Iterable[Case], report: Callable[[Case], None] | None = None) -> Iterator[Outcome]:
    """Run the cases one after the other; ``report`` is called with each before it runs."""
    for case in cases:
        if report is not None:
            report(case)
        yield outcome_of(case)


def outcome_of(case: Case) -> Outcome:
    """Run one case. An error of the run makes a failed outcome and is not raised."""
    from dembrick.runs.simulate import simulate
    from dembrick.scenario import toml

    began = time.perf_counter()
    try:
        result = simulate(toml.load(case.path, case.set), None, refine=case.refine, record=False)
        value, lower, upper = _READ[case.quantity](result)
    except DembrickError as error:
        return Outcome(case, None, None, None, time.perf_counter() - began, str(error))
    return Outcome(case, value, lower, upper, time.perf_counter() - began)


Measured = tuple[float, float | None, float | None]


def _limit(result) -> Measured:
    point = result.yield_point
    return point.V, point.V_lower, point.V_upper


def _angle(result) -> Measured:
    """Angle (deg) of a table that tilts quasi-statically: the arc tangent of the load factor."""
    value, lower, upper = (math.degrees(math.atan(present(V))) for V in _limit(result))
    return value, lower, upper


def _with_bar(found: dict, name: str) -> Measured:
    value, bar = found[name], found[f"{name}_error"]
    return (value, None, None) if bar is None else (value, value - bar, value + bar)


def _settlement(result) -> Measured:
    fallen = present(result.collapse)
    return fallen["settlement"], *fallen["settlement_range"]


_READ: dict[str, Callable[..., Measured]] = {
    "V": _limit,
    "load_factor": _limit,
    "angle": _angle,
    "displacement": lambda result: _with_bar(result.as_dict(), "displacement"),
    "angle_at_displacement": lambda result: (result.collapse["angle"], None, None),
    "stands": lambda result: (float(not fell(result.as_dict())), None, None),
    "reaction": lambda result: _with_bar(result.settlement, "reaction"),
    "settlement": _settlement,
}


STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem; color: #1b1f24; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem; border-bottom: 1px solid #d8dde3; text-align: left; vertical-align: top; }
td.n { text-align: right; white-space: nowrap; } td.bad { color: #b3261e; font-weight: 600; }
small { color: #57606a; } code { font-size: .9em; }
@media (prefers-color-scheme: dark) { body { background: #14171a; color: #e6e8ea; } th, td { border-color: #333a41; }
small { color: #9aa4ae; } td.bad { color: #ff8a80; } }
"""


def verdict(outcome: Outcome) -> str:
    """In a few words: ok, FAILED, or ok within the tolerance although the reference lies outside the error bar."""
    if not outcome.passed:
        return "FAILED"
    return "ok, but outside its bar" if outcome.bar_holds is False else "ok"


def value_text(outcome: Outcome) -> str:
    """Value with its half-width, in significant digits."""
    if outcome.value is None:
        return "none"
    if outcome.lower is None or outcome.upper is None:
        return f"{outcome.value:.7g}"
    return " +- ".join(barred(outcome.value, max(outcome.upper - outcome.value, outcome.value - outcome.lower)))


def reference_text(outcome: Outcome) -> str:
    """The reference with its unit, and with its error if that is larger than the error bar of the value."""
    case = outcome.case
    bar = math.inf if outcome.lower is None or outcome.upper is None else 0.5 * (outcome.upper - outcome.lower)
    known = f" +- {rounded_up(case.reference_error)}" if case.reference_error > bar else ""
    return f"{case.reference:.7g}{known}{'' if case.unit == '1' else f' {case.unit}'}"


def error_text(outcome: Outcome) -> str:
    """Relative error in per cent (negative below a bound), or the plain difference if the reference is zero."""
    if outcome.error is None:
        return "-"
    return f"{100.0 * outcome.error:+.2g} %" if outcome.case.reference else f"{outcome.error:+.2g}"


def text_row(outcome: Outcome) -> str:
    """One line of the table on the terminal."""
    case = outcome.case
    reference = f"{'<= ' if case.relation == 'at most' else ''}{reference_text(outcome)}"
    return (
        f"{case.name:28} {reference:>24} {value_text(outcome):>22} {error_text(outcome):>10} "
        f"{outcome.seconds:6.2f} s  {verdict(outcome)}"
    )


def text_header() -> str:
    """The heads of the columns of :func:`text_row`."""
    return f"{'case':28} {'reference':>24} {'dembrick':>22} {'error':>10} {'time':>8}"


def summary(outcomes: Sequence[Outcome]) -> str:
    """How many cases passed, and how many error bars hold the reference."""
    passed = sum(outcome.passed for outcome in outcomes)
    bars = [outcome.bar_holds for outcome in outcomes if outcome.bar_holds is not None]
    seconds = sum(outcome.seconds for outcome in outcomes)
    held = f"{sum(bars)} of {len(bars)} error bars contain the reference, within its own accuracy"
    return f"{passed} of {len(outcomes)} cases pass, {held}, {seconds:.1f} s"


def html(outcomes: Sequence[Outcome], version: str) -> str:
    """The page of the report."""
    intro = (
        f"{escape(summary(outcomes))}. An error bar is the bracket of the limit load, or in real time the estimate of "
        "<code>--refine</code>. Run any case again with <code>dembrick verify CASE</code>."
    )
    heads = ("case", "source", "reference", "dembrick", "error", "time", "")
    return page("Verification", version, intro, heads, map(_html_row, outcomes))


def page(title: str, version: str, intro: str, heads: Iterable[str], rows: Iterable[str]) -> str:
    """A page with one table: the ``heads`` of its columns, its ``rows`` and the ``intro`` as HTML."""
    lines = "\n".join(rows)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>dembrick {escape(version)}: {title.lower()}</title><style>{STYLE}</style></head>
<body><h1>{title} of dembrick {escape(version)}</h1>
<p>{intro}</p>
<table><thead><tr>{"".join(f"<th>{head}</th>" for head in heads)}</tr></thead><tbody>
{lines}
</tbody></table></body></html>
"""


def _html_row(outcome: Outcome) -> str:
    case = outcome.case
    changes = "".join(f" --set {escape(change)}" for change in case.set)
    remark = f"<br><small>{escape(case.remark or outcome.failure)}</small>" if case.remark or outcome.failure else ""
    reference = f"{'at most ' if case.relation == 'at most' else ''}{reference_text(outcome)}"
    return (
        f"<tr><td>{escape(case.title)}<br><small><code>{escape(case.name)}: {escape(case.scenario)}{changes}</code>"
        f"</small></td><td>{escape(case.source)}{remark}</td><td class=n>{escape(reference)}</td>"
        f"<td class=n>{escape(value_text(outcome))}</td><td class=n>{escape(error_text(outcome))}</td>"
        f"<td class=n>{outcome.seconds:.2f} s</td>"
        f"<td class='{'' if outcome.passed else 'bad'}'>{verdict(outcome)}</td></tr>"
    )
