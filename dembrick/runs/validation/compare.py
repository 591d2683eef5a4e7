"""Run validation cases and compare: E = S - D against what the measurement and the simulation leave open."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dembrick.errors import DembrickError, NotConvergedError
from dembrick.runs.outcomes.error_estimate import RATIOS, with_ratio
from dembrick.runs.outcomes.load_path_result import DrivenPathResult
from dembrick.runs.outcomes.result import Result, fell
from dembrick.runs.simulate import AnyResult, simulate
from dembrick.runs.validation.cases import Case
from dembrick.scenario import toml
from dembrick.scenario.checks import present
from dembrick.scenario.model import Scenario

# The error of a stiffness over the difference that half of it makes, as it fades with the stiffness to the power -1/3.
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
        """Uncertainty of measurement and simulation together: the root of the sum of squares."""
        return None if self.u_num is None else math.hypot(self.case.u_D, self.u_num)

    @property
    def within(self) -> bool | None:
        """Whether the comparison error is no larger than that; None without an answer."""
        return None if self.E is None or self.open is None else abs(self.E) <= self.open

    @property
    def unknown(self) -> str:
        """Text on what was not known of the test, its scatter included."""
        several = self.case.scatter_of
        return self.case.unknown + (f"; u_D relative as of {several}, as there is one value only" if several else "")

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
    """Run the cases one after the other; ``report`` hears of each before it runs."""
    for case in cases:
        if report is not None:
            report(case)
        yield comparison_of(case)


def comparison_of(case: Case) -> Comparison:
    """Run one case. What a run refuses or cannot answer is a comparison without S, not an error."""
    began = time.perf_counter()
    try:
        S, u_num = _SIMULATED[case.quantity](case)
    except DembrickError as error:
        return Comparison(case, None, None, time.perf_counter() - began, str(error))
    return Comparison(case, S, u_num, time.perf_counter() - began)


def _force(case: Case) -> tuple[float, float]:
    """The limit load and how far its bracket reaches from it (kN); with ``paths`` also how far the limits of other
    ratios of stiffness do, and the associative bound, above which no path ends."""
    scenario = toml.load(case.path, case.set)
    result = simulate(scenario, None, bound=case.paths, record=False)
    point = present(result.yield_point)
    V = present(point.V)
    reach = [present(point.V_upper) - V, V - point.V_lower]
    if case.paths:
        assert isinstance(result, Result)
        reach.append(present(result.path)["associative"]["upper"] - V)
        reach += [abs(present(present(other.yield_point).V) - V) for other in _on_other_paths(scenario)]
    return KILO * V, KILO * max(reach)


def _on_other_paths(scenario: Scenario) -> list[AnyResult]:
    """The search with other ratios of shear to normal stiffness, by which joints are loaded otherwise on the way."""
    own = scenario.joint.shear_stiffness / scenario.joint.normal_stiffness
    others = [ratio for ratio in RATIOS if not math.isclose(ratio, own)]
    return [simulate(with_ratio(scenario, ratio), None, record=False) for ratio in others]


def _force_at(case: Case) -> tuple[float, float]:
    """V in the deformed geometry at the displacement ``at``, and what the stiffness of the joints leaves open (kN)."""
    at, scenario = present(case.at), toml.load(case.path, case.set)

    def V(one: Scenario) -> float:
        result = simulate(one, None, record=False)
        assert isinstance(result, DrivenPathResult)
        moved, load = result.run.path[:, :2].T
        if moved[-1] < at * (1.0 - 1e-9):
            raise NotConvergedError(f"the wall comes down at {moved[-1]:.3g} m, before {at:g} m")
        return KILO * float(np.interp(at, moved, load))

    return _with_stiffness(V, scenario)


def _cycle_peaks(case: Case) -> tuple[float, float]:
    """The mean of the greatest V of all half cycles, and how far the others with their bars reach from it (kN)."""
    result = simulate(toml.load(case.path, case.set), None)
    cycles = present(result.cycles)
    ends = np.abs([[cycle[key] for key in ("V_lower", "peak", "V_upper")] for cycle in cycles])
    mean = float(ends[:, 1].mean())
    return KILO * mean, KILO * float(np.abs(ends - mean).max())


def _threshold(case: Case) -> tuple[float, float]:
    """The middle between a value at which it stands and one at which it falls, and half their distance."""
    stands, falls = case.between
    for value, expected in ((stands, False), (falls, True)):
        result = simulate(toml.load(case.path, (*case.set, f"{case.key}={value}")), None, record=False)
        if fell(result.as_dict()) is not expected:
            raise NotConvergedError(f"it {'stands' if expected else 'falls'} at {case.key} = {value}")
    return 0.5 * (stands + falls), 0.5 * abs(falls - stands)


def _speed_ratio(case: Case) -> tuple[float, float]:
    """Speed after the first impact over that before, over Housner's, and what the stiffness leaves open."""
    scenario = toml.load(case.path, case.set)
    return _with_stiffness(_kept_over_housner, scenario)


def _kept_over_housner(scenario: Scenario) -> float:
    """From the greatest turns before and after the first impact: a rigid block turning on a corner keeps its energy."""
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
    """An answer, and its error by that of joints half as stiff."""
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
