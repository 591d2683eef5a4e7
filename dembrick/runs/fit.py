"""The friction coefficient that best explains measured yield points, under each contact formulation.

The measurements are read from a CSV file, one test per line::

    test,scenario,V [N],deviation [N],formulation
    2a,set2a.toml,108,,

``scenario`` is the scenario file of the test, relative to the folder of the CSV; its friction is ignored, and all its
joints must share one. ``V [N]`` (or ``V [kN]``) is the load at yield, in the sense of the scenario's actuators.
``deviation`` (in all lines or in none) and ``formulation`` are optional: without deviations every test is weighted by
its relative error; a line with a formulation counts for that one only. mu solves

    sum((V_i - V) V' / s_i^2) = 0,    s_i the deviation, or V itself,

with V(mu) simulated and its slope V'. Errors relative to the measured V_i would favour tests with low results.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from decimal import Decimal
from functools import cache, partial
from statistics import NormalDist

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import shipped
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import nearest, present, show
from dembrick.scenario.csv_tables import Table, cells_by_name, name_of, read_table
from dembrick.scenario.model import FORMULATIONS, DisplacementControl, Scenario, YieldControl

CONFIDENCE = 0.95
_NORMAL = NormalDist().inv_cdf(0.5 * (1.0 + CONFIDENCE))  # half-width in standard deviations, if these are known
_COLUMNS = {"test": True, "scenario": True, "V": True, "deviation": False, "formulation": False}  # needed or not
_SCANNED = tuple(0.04 * 2.0 ** (k / 2.0) for k in range(14))  # mu tried first: V has kinks where a block tips over
_STEP = 0.01  # relative change of mu for the slope of V
_TELLS = 1e-6  # d ln V / d ln mu below which a test does not slip
_TOLERANCE = 1e-5  # of the simulated limit loads
_ITERATIONS = 20
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class Measurement:
    """A measured yield point: V, its standard deviation (None if unknown) and the value of its last digit, in N."""

    test: str
    scenario: Scenario
    V: float
    deviation: float | None = None
    formulation: str | None = None
    digit: float = 0.0


@dataclass(frozen=True)
class Fit:
    """mu under one formulation (or, "as stated", each line under its own).

    ``half_width`` is half the 95 % confidence interval: by Student's t from the scatter of the tests about the fit, and
    no less than the stated deviations, or the rounding of the measurements, make it; None for a single test without
    deviation. ``tests`` has V measured and fitted (N), their difference in % of the measured, and the mu
    that this test alone implies.
    """

    formulation: str
    mu: float
    half_width: float | None
    scatter: float | None
    tests: list[dict]


def read(path: str | os.PathLike) -> list[Measurement]:
    """Read measurements from a CSV file, or a shipped one by its name; ScenarioError names the line and the column."""
    path = shipped.table(path)
    table = read_table(path, "a file of measured yield points")
    hint = "; for a measured curve, add its SCENARIO"
    columns = cells_by_name(table, _COLUMNS, ("V", "deviation"), hint)
    if not table.lines:
        raise ScenarioError(f"{path}: a header line and at least one test are needed")
    found = []
    for number, row in table.lines:
        place = f"{path}, line {number}"
        cells = {name: row[i].strip() for name, (i, _) in columns.items()}
        formulation = cells.get("formulation") or None
        if formulation is not None and formulation not in FORMULATIONS:
            raise ScenarioError(
                f"{place}: formulation {show(formulation)} is unknown; {nearest(formulation, FORMULATIONS)}"
            )
        V = _positive(table, number, row, *columns["V"])
        deviation = _positive(table, number, row, *columns["deviation"]) if cells.get("deviation") else None
        scenario = scenarios.load(path.parent / cells["scenario"], regular=True)
        if not isinstance(scenario.control, YieldControl | DisplacementControl):  # only these have jacks with a limit
            raise ScenarioError(
                f"{place}: {scenario.path} has control.kind = {show(scenario.control.kind)}, and so no yield point; "
                'give it "yield", or "displacement"'
            )
        for one in scenario.joints:
            for key in ("friction", "formulation"):
                if getattr(one.law, key) != getattr(scenario.joint, key):
                    between = " and ".join(map(show, one.between))
                    raise ScenarioError(
                        f"{place}: {scenario.path} gives the joints between {between} a {key} of their own, but the "
                        f"fit looks for one of all joints; leave {key} out of [[joints]]"
                    )
        digit = columns["V"][1] * _last_digit(cells["V"])
        found.append(Measurement(cells["test"], scenario, V, deviation, formulation, digit))
    missing = [number for (number, _), one in zip(table.lines, found, strict=True) if one.deviation is None]
    if 0 < len(missing) < len(found):
        raise ScenarioError(
            f"{path}, line {missing[0]}: deviation is empty here but not elsewhere, so the weight of this test is "
            "unknown; give one to all tests, or to none"
        )
    return found


def _positive(table: Table, number: int, row: Sequence[str], column: int, size: float) -> float:
    """A number greater than 0, in SI units."""
    value = table.number(number, table.titles[column], row[column])
    if not value > 0.0:
        name = name_of(table.titles[column])
        raise ScenarioError(f"{table.path}, line {number}: {name} = {value:g} must be greater than 0")
    return size * value


def _last_digit(text: str) -> float:
    """Value of the last digit of a finite number in a text."""
    return 10.0 ** int(Decimal(text.replace(",", ".")).as_tuple().exponent)


def fit(
    measurements: Sequence[Measurement],
    formulations: Sequence[str] = FORMULATIONS,
    progress: Callable[[int, int, str], None] | None = None,
) -> list[Fit]:
    """mu under each formulation, and under "as stated" where every measurement states its own.

    Raises NotConvergedError if no mu is found, ScenarioError if V does not depend on friction at all.
    """
    groups = {name: [m for m in measurements if m.formulation in (None, name)] for name in formulations}
    if all(m.formulation for m in measurements) and len({m.formulation for m in measurements}) > 1:
        groups = {"as stated": list(measurements)} | groups
    fits = []
    for done, (name, group) in enumerate(groups.items()):
        if progress:
            progress(done, len(groups), name)
        if group:
            fits.append(_fitted(name, group))
    if progress:
        progress(len(groups), len(groups), "")
    return fits


def _fitted(name: str, group: list[Measurement]) -> Fit:
    """Fit by Gauss-Newton from the best mu of `_SCANNED`: two simulations of every test per iteration, and few
    iterations, as V of sliding blocks is proportional to mu. If they oscillate at a kink, golden sections follow."""
    measured = np.array([m.V for m in group])
    stated = None if group[0].deviation is None else np.array([m.deviation for m in group], float)

    @cache
    def simulated(mu: float) -> np.ndarray:
        return _simulated(group, name, mu)

    def cost(mu: float, scale: np.ndarray) -> float:
        return float((((simulated(mu) - measured) / scale) ** 2).sum())

    least, most = _allowed(group)
    scanned = [mu for mu in _SCANNED if least <= mu <= most] or [least or most]
    best = int(np.argmin([cost(mu, measured if stated is None else stated) for mu in scanned]))
    low = scanned[best - 1] if best else least
    high = scanned[best + 1] if best + 1 < len(scanned) else most
    mu = scanned[best]
    for _ in range(_ITERATIONS):
        V, slope = _with_slope(simulated, mu)
        scale = V if stated is None else stated
        weight = slope / scale
        if not np.abs(slope * mu).max() > _TELLS * V.max():
            raise ScenarioError(f"{name}: no test slips, so none of them gives information on friction")
        change = float(weight @ ((measured - V) / scale) / (weight @ weight))
        now, mu = mu, min(max(mu + change, 0.1 * mu, low), high)
        change = mu - now
        if abs(change) <= 10.0 * _TOLERANCE * mu:
            break
    else:
        if high == math.inf:
            raise NotConvergedError(
                f"{name}: no friction coefficient was found in {_ITERATIONS} rounds, the last {mu:.6g}"
            )
        mu, change = _least(partial(cost, scale=scale), low, high), 0.0
        V, slope = _with_slope(simulated, mu)
        weight = slope / scale
    if mu <= least != 0.0 or mu >= most:
        ends = f"{least:g} (residual friction or dilation) and {most:g} (cohesion over tensile strength)"
        raise ScenarioError(
            f"{name}: the best friction coefficient lies outside the range that strengths allow, {ends}"
        )
    V = V + slope * change
    scatter = half = None
    alone = 1.0 / math.sqrt(float(weight @ weight))  # of mu, for a scatter of one
    if len(group) > 1:
        scatter = math.sqrt(float((((V - measured) / scale) ** 2).sum()) / (len(group) - 1))
        read = np.array([m.digit for m in group]) / (math.sqrt(12.0) * scale)
        rounding = float(np.linalg.norm(weight * read)) * alone
        half = student(CONFIDENCE, len(group) - 1) * max(scatter, rounding) * alone
    if stated is not None:
        half = max(half or 0.0, _NORMAL * alone)
    tests = [
        {
            "test": m.test,
            "formulation": m.formulation or name,
            "V_measured": m.V,
            "V_fitted": float(v),
            "residual_percent": 100.0 * float(v / m.V - 1.0),
            "mu": float(mu + (m.V - v) / s) if abs(s * mu) > _TELLS * v else None,
        }
        for m, v, s in zip(group, V, slope, strict=True)
    ]
    return Fit(name, mu, half, scatter, tests)


def _allowed(group: list[Measurement]) -> tuple[float, float]:
    """Least and greatest friction coefficient that the other strengths of the joints allow."""
    laws = [law for m in group for law in (m.scenario.joint, *(one.law for one in m.scenario.joints))]
    least = max(max(law.residual_friction or 0.0, law.dilation) for law in laws)
    most = min((law.cohesion / law.tensile_strength for law in laws if law.tensile_strength), default=math.inf)
    return least, most / (1.0 + _STEP)


def _with_slope(simulated: Callable[[float], np.ndarray], mu: float) -> tuple[np.ndarray, np.ndarray]:
    """V of the tests, and its derivative by mu."""
    V = simulated(mu)
    return V, (simulated(mu * (1.0 + _STEP)) - V) / (mu * _STEP)


def _least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Minimiser of a function between two numbers, by golden-section search."""
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    of_left, of_right = cost(left), cost(right)
    while high - low > _TOLERANCE * high:
        if of_left <= of_right:
            high, right, of_right = right, left, of_left
            left = high - _GOLDEN * (high - low)
            of_left = cost(left)
        else:
            low, left, of_left = left, right, of_right
            right = low + _GOLDEN * (high - low)
            of_right = cost(right)
    return 0.5 * (low + high)


def _simulated(group: list[Measurement], name: str, mu: float) -> np.ndarray:
    loads = []
    for m in group:
        law = replace(m.scenario.joint, formulation=m.formulation or name, friction=mu)
        others = (replace(one.law, formulation=law.formulation, friction=mu) for one in m.scenario.joints)
        joints = tuple(replace(one, law=own) for one, own in zip(m.scenario.joints, others, strict=True))
        control = YieldControl(_TOLERANCE, getattr(m.scenario.control, "large_displacements", False))
        test = replace(m.scenario, joint=law, joints=joints, control=control)
        loads.append(present(simulate(test, record=False).yield_point).V)
    return np.array(loads)


def student(confidence: float, freedom: int) -> float:
    """Quantile t of Student's distribution: the variable lies within -t and t with this probability.

    With t = sqrt(freedom) tan(angle) the density becomes a power of the cosine on a finite interval.
    """
    nodes, weights = np.polynomial.legendre.leggauss(200)

    def mass(angle: float) -> float:
        return float(0.5 * angle * weights @ np.cos(0.5 * angle * (nodes + 1.0)) ** (freedom - 1))

    wanted = confidence * mass(0.5 * math.pi)
    low, high = 0.0, 0.5 * math.pi
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if mass(middle) < wanted else (low, middle)
    return math.sqrt(freedom) * math.tan(low)


def as_dicts(fits: Sequence[Fit]) -> list[dict]:
    """The fits as in ``dembrick fit --json``."""
    return [asdict(one) for one in fits]
