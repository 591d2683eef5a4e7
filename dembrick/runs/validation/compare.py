"""Validation cases: run them, compare E = S - D with the uncertainties of measurement and simulation, and report.

The report is a text table, and a self-contained HTML page.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np

from dembrick.errors import DembrickError, NotConvergedError
from dembrick.runs.outcomes.error_estimate import RATIOS, with_ratio
from dembrick.runs.outcomes.load_path_result import LoadPathResult
from dembrick.runs.outcomes.result import Result, fell
from dembrick.runs.path_dependence import ends
from dembrick.runs.simulate import AnyResult, simulate
from dembrick.runs.validation.cases import Case
from dembrick.runs.verification.verify import page
from dembrick.scenario import toml
from dembrick.scenario.checks import present
from dembrick.scenario.model import Scenario

# Error by a finite stiffness over the change by halving it, as it decreases with the stiffness to the power -1/3.
OF_HALF_STIFFNESS = 1.0 / (2.0 ** (1.0 / 3.0) - 1.0)
KILO = 1e-3


@dataclass(frozen=True, slots=True)
class Comparison:
    """Outcome of a case. ``S`` with ``u_num``, in the unit of the case (None: no answer, and ``failure`` says why);
    ``seconds``: wall time."""

    case: Case
    S: float | None
    u_num: float | None
    seconds: float
    failure: str = ""

    @property
    def E(self) -> float | None:
        """The comparison error, simulated less measured."""
        return None if self.S is None else self.S - self.case.D

    @property
    def open(self) -> float | None:
        """Combined uncertainty of measurement and simulation: the root of the sum of squares."""
        return None if self.u_num is None else math.hypot(self.case.u_D, self.u_num)

    @property
    def within(self) -> bool | None:
        """Whether the comparison error is no larger than the combined uncertainty; None without an answer."""
        return None if self.E is None or self.open is None else abs(self.E) <= self.open

    @property
    def unknown(self) -> str:
        """Text on what was not known of the test, its scatter included."""
        several = self.case.scatter_of
        return self.case.unknown + (f"; relative u_D of {several}, because there is only one value" if several else "")

    def as_dict(self) -> dict:
        """The row of ``verify --validation --json``."""
        of_case = ("title", "load", "quantity", "unit", "source", "inputs", "scenario", "finding", "D", "u_D")
        own = ("S", "u_num", "E", "within", "unknown", "seconds", "failure")
        return {
            "case": self.case.name,
            "set": list(self.case.set),
            "measured": list(self.case.measured),
            **{name: getattr(self.case, name) for name in of_case},
            **{name: getattr(self, name) for name in own},
        }


def compare(cases: Iterable[Case], report: Callable[[Case], None] | None = None) -> Iterator[Comparison]:
    """Run the cases one after the other; ``report`` is called with each before it runs."""
    for case in cases:
        if report is not None:
            report(case)
        yield comparison_of(case)


def comparison_of(case: Case) -> Comparison:
    """Run one case. An error of the run makes a comparison without S and is not raised."""
    began = time.perf_counter()
    try:
        S, u_num = _SIMULATED[case.quantity](case)
    except DembrickError as error:
        return Comparison(case, None, None, time.perf_counter() - began, str(error))
    return Comparison(case, S, u_num, time.perf_counter() - began)


def _force(case: Case) -> tuple[float, float]:
    """The limit load and its uncertainty (kN): how far its bracket reaches from it; with ``paths`` also the limits for
    other stiffness ratios, and the associative bound, above which no path ends."""
    scenario = toml.load(case.path, case.set)
    result = simulate(scenario, None, bound=case.paths, record=False)
    point = present(result.yield_point)
    V, reach = present(point.V), [point.V_lower, present(point.V_upper)]
    if case.paths:
        assert isinstance(result, Result)
        reach.append(present(result.path)["associative"]["upper"])
        reach += [end for other in _on_other_paths(scenario) for end in ends(present(other.yield_point))]
    return KILO * V, KILO * max(abs(end - V) for end in reach)


def _on_other_paths(scenario: Scenario) -> list[AnyResult]:
    """Results of the search with other ratios of shear to normal stiffness, which load the joints differently."""
    own = scenario.joint.shear_stiffness / scenario.joint.normal_stiffness
    others = [ratio for ratio in RATIOS if not math.isclose(ratio, own)]
    return [simulate(with_ratio(scenario, ratio), None, record=False) for ratio in others]


def _force_at(case: Case) -> tuple[float, float]:
    """V in the deformed geometry at the displacement ``at``, and its uncertainty by the joint stiffness (kN)."""
    at, scenario = present(case.at), toml.load(case.path, case.set)

    def V(one: Scenario) -> float:
        result = simulate(one, None, record=False)
        assert isinstance(result, LoadPathResult)
        moved, load = result.run.path[:, :2].T
        if moved[-1] < at * (1.0 - 1e-9):
            raise NotConvergedError(f"the wall collapses at {moved[-1]:.3g} m, before {at:g} m")
        return KILO * float(np.interp(at, moved, load))

    return _with_stiffness(V, scenario)


def _cycle_peaks(case: Case) -> tuple[float, float]:
    """The mean of the peaks of V of all half cycles, and how far single peaks with their bars lie from it (kN)."""
    result = simulate(toml.load(case.path, case.set), None)
    cycles = present(result.cycles)
    ends = np.abs([[cycle[key] for key in ("V_lower", "peak", "V_upper")] for cycle in cycles])
    mean = float(ends[:, 1].mean())
    return KILO * mean, KILO * float(np.abs(ends - mean).max())


def _threshold(case: Case) -> tuple[float, float]:
    """The middle between a value at which the structure stands and one at which it falls, and half their distance."""
    stands, falls = case.between
    for value, expected in ((stands, False), (falls, True)):
        result = simulate(toml.load(case.path, (*case.set, f"{case.key}={value}")), None, record=False)
        if fell(result.as_dict()) is not expected:
            raise NotConvergedError(f"it {'stands' if expected else 'falls'} at {case.key} = {value}")
    return 0.5 * (stands + falls), 0.5 * abs(falls - stands)


def _speed_ratio(case: Case) -> tuple[float, float]:
    """Speed after the first impact over that before, over Housner's, and its uncertainty by the stiffness."""
    scenario = toml.load(case.path, case.set)
    return _with_stiffness(_kept_over_housner, scenario)


def _kept_over_housner(scenario: Scenario) -> float:
    """Speed ratio over Housner's, from the greatest turns before and after the first impact, as energy is conserved."""
    result = simulate(scenario, None)
    quaternion = result.frames["orientation"][:, 1]
    turn = 2.0 * np.arctan2(quaternion[:, 2], quaternion[:, 0])
    back = int(np.argmax(turn < 0.0))
    if not back:
        raise NotConvergedError("the block has not rocked to its other side")
    width, _, height = present(next(block for block in scenario.blocks if not block.fixed).box)
    alpha = math.atan2(width, height)
    before, after = (
        math.sqrt(math.cos(alpha - angle) - math.cos(alpha)) for angle in (turn[:back].max(), -turn[back:].min())
    )
    return after / before / (1.0 - 1.5 * math.sin(alpha) ** 2)


def _with_stiffness(answer: Callable[[Scenario], float], scenario: Scenario) -> tuple[float, float]:
    """An answer, and its error estimated from joints half as stiff."""
    law = scenario.joint
    softer = replace(law, normal_stiffness=0.5 * law.normal_stiffness, shear_stiffness=0.5 * law.shear_stiffness)
    found = answer(scenario)
    other = answer(replace(scenario, joint=softer, text=None))
    return found, OF_HALF_STIFFNESS * abs(found - other)


_SIMULATED: dict[str, Callable[[Case], tuple[float, float]]] = {
    "force": _force,
    "force_at": _force_at,
    "cycle_peaks": _cycle_peaks,
    "threshold": _threshold,
    "speed_ratio": _speed_ratio,
}


def verdict(found: Comparison) -> str:
    """In a word: within, outside, or no answer."""
    return "no answer" if found.within is None else "within" if found.within else "OUTSIDE"


def number(value: float | None) -> str:
    """Four digits, or a dash for None."""
    return "-" if value is None else f"{value:.4g}"


def small(value: float | None) -> str:
    """Two digits, or a dash for None."""
    return "-" if value is None else f"{value:.2g}"


def text_row(found: Comparison) -> str:
    """One line of the table on the terminal."""
    case = found.case
    mark = "*" if case.scatter_of else " "
    error = "-" if found.E is None else f"{found.E:+.3g}"
    percent = "-" if found.E is None else f"{100.0 * found.E / case.D:+z.1f} %"
    unit = "" if case.unit == "1" else case.unit
    return (
        f"{case.name:17} {number(case.D):>8} {small(case.u_D):>8}{mark} {number(found.S):>8} {small(found.u_num):>9} "
        f"{error:>8} {percent:>9} {unit:3} {found.seconds:6.1f} s  {verdict(found)}"
    )


def text_header() -> str:
    """The heads of the columns of :func:`text_row`."""
    return (
        f"{'case':17} {'D':>8} {'u_D':>8}  {'S':>8} {'u_num':>9} {'E':>8} {'E / D':>9} {'':3} {'time':>6}    |E| and "
        "what remains unknown"
    )


def summary(found: Sequence[Comparison]) -> str:
    """How many tests are met, and the meaning of the columns."""
    met = sum(one.within is True for one in found)
    seconds = sum(one.seconds for one in found)
    lines = [
        f"{met} of {len(found)} tests agree: |E| = |S - D| is at most the root of u_D^2 + u_num^2, {seconds:.1f} s",
        "D measured, u_D half the range of all peaks, S simulated, u_num its error bar without unknown inputs.",
    ]
    if any(one.case.scatter_of for one in found):
        names = sorted({one.case.scatter_of for one in found if one.case.scatter_of})
        lines.append(f"* one value only: relative u_D of {', '.join(names)}, the largest of the others.")
    return "\n".join(lines)


def remarks(found: Sequence[Comparison]) -> str:
    """Inputs and what was not known, once for the cases of one series; then findings and failures of single cases."""
    lines, last = [], ""
    for one in found:
        case = one.case
        if case.source != last:
            unknown = f"  unknown     {case.unknown}"
            lines += ["", f"{case.title}: {case.source}", f"  inputs      {case.inputs}", unknown]
            last = case.source
        lines += [f"  {case.name}: {said}" for said in (case.finding, one.failure) if said]
    return "\n".join(lines)


def html(found: Sequence[Comparison], version: str) -> str:
    """The page of the report."""
    heads = ("test", "source, inputs, unknown", "D", "u_D", "S", "u_num", "E", "")
    return page("Validation", version, escape(summary(found)), heads, map(_html_row, found))


def _html_row(found: Comparison) -> str:
    case = found.case
    changes = "".join(f" --set {escape(change)}" for change in case.set)
    said = "".join(f"<br><small>{escape(text)}</small>" for text in (case.finding, found.failure) if text)
    unit = "" if case.unit == "1" else f" {case.unit}"
    numbers = (
        number(case.D) + unit,
        small(case.u_D),
        number(found.S) + unit,
        small(found.u_num),
        "-" if found.E is None else f"{found.E:+.3g}",
    )
    cells = "".join(f"<td class=n>{escape(text)}</td>" for text in numbers)
    return (
        f"<tr><td>{escape(case.title)}, {escape(case.load)}<br><small><code>{escape(case.name)}: "
        f"{escape(case.scenario)}{changes}</code></small></td><td>{escape(case.source)}<br><small>{escape(case.inputs)}.<br>"
        f"Unknown: {escape(found.unknown)}</small>{said}</td>{cells}<td "
        f"class='{'' if found.within else 'bad'}'>{verdict(found)}</td></tr>"
    )
