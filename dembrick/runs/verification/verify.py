"""Run verification cases and compare: value with error bar against the reference."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from dembrick.errors import DembrickError
from dembrick.runs.outcomes.result import fell
from dembrick.runs.verification.cases import Case
from dembrick.scenario.checks import present

SLACK = 1e-9  # of the reference: rounding by which it may lie outside an error bar


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
        """Whether the reference, as far as it is known, lies in the error bar; None if there is no bar."""
        if self.lower is None or self.upper is None or self.case.relation != "equal":
            return None
        slack = SLACK * abs(self.case.reference) + self.case.reference_error
        return self.lower - slack <= self.case.reference <= self.upper + slack

    @property
    def passed(self) -> bool:
        """Within the tolerance, and inside the error bar unless the case says why it need not be."""
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
    """Run the cases one after the other; ``report`` hears of each before it runs."""
    for case in cases:
        if report is not None:
            report(case)
        yield outcome_of(case)


def outcome_of(case: Case) -> Outcome:
    """Run one case. What a run refuses or cannot answer is an outcome that has failed, not an error."""
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
