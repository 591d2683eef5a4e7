"""Fit keys of a scenario to measured force-displacement curves, with 95 % confidence intervals.

Least squares on the logarithms of the keys (they are positive): sum(((V_sim(u_i) - V_i) / V_peak)^2) over all measured
points. Intervals are those of the linearised problem (`fit_intervals`): all keys at once are within theirs with 95 %.
Both ends are checked: the misfit there, with the other keys fitted again, must have risen as the linearised problem
predicts; otherwise the end is searched for. An interval that reaches a factor of 100 is open at that end: the data do
not determine the key.
"""

from __future__ import annotations

import itertools
import math
import os
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dembrick.errors import DembrickError, NotConvergedError, ScenarioError, needed
from dembrick.runs.fit import CONFIDENCE
from dembrick.runs.fit_intervals import half_widths
from dembrick.runs.simulate import simulate
from dembrick.scenario import overrides
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import present, show
from dembrick.scenario.controls import DisplacementControl
from dembrick.scenario.model import Scenario
from dembrick.simulation.session import Progress
from dembrick.views.misfit import Curve, Misfit, between, compared, require_comparable, text, turns
from dembrick.views.plot.curves import MeasuredCurve

STEP = 0.01  # change of the logarithm of a key for the slope of the curve
MOST = 60  # most runs of a search, without those for slopes
STARTS = 5  # most searches: the trial of an interval may find better values, from which one starts again
RANGE = math.log(1e4)  # of the logarithms about the start, to be searched
OPEN = math.log(100.0)  # an interval that reaches further on one side is open there
REACHED = 0.8  # of the measured points: least share within the simulated travel
SPARE = 1.1  # travel of the runs over the largest measured displacement
NUMERICAL = 1e-4  # of V_peak: least error of a simulated curve
AGREES = (0.7, 1.4)  # range of the rise of the misfit over the expected one, in which an end is accepted
CLOSE = 0.05  # relative tolerance of an end that is searched for
# Weights that hold keys near their start if the data do not determine them; small beside the weight of the data.
HOLD, HOLD_OF_SCATTER = 3e-3, 0.2
OF_THE_RUN = ("control", "output", "solver")
APART, MIXED = 1e-2, 0.1  # of the largest singular value, and of its vector: keys that curves hardly tell apart


@dataclass(frozen=True)
class Fitted:
    """A key: its ``value`` and 95 % interval, and whether the data determine it; open ends are None."""

    value: float
    lower: float | None
    upper: float | None
    determined: bool


@dataclass(frozen=True)
class CurveFit:
    """Fitted ``keys``, the ``misfits`` of every curve with their values, and the ``scenarios`` with them."""

    keys: dict[str, Fitted]
    misfits: list[Misfit]
    scenarios: list[Scenario]

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick fit --lab CURVE SCENARIO``; for several curves the mean misfit and each one."""
        each = [one.numbers() for one in self.misfits]
        mean = {}
        for name in each[0]:
            known = [value for one in each if (value := one[name]) is not None]
            mean[name] = float(np.mean(known)) if known else None
        found = {"fit": {key: vars(one) for key, one in self.keys.items()}, "misfit": mean}
        return found | ({"misfits": each} if len(each) > 1 else {})


def fit_curves(
    given: Sequence[Scenario],
    curves: Sequence[MeasuredCurve],
    keys: Sequence[str],
    report: Callable[[Progress], None] | None = None,
) -> CurveFit:
    """Fit ``keys``, paths as for ``--set``, of scenarios to measured curves: one scenario for all or one for each;
    ``report`` receives the number of runs so far.

    Raises ScenarioError for keys that are no positive numbers of the scenario, for fewer points than keys, for a
    control that gives no such curve; NotConvergedError if the search does not settle; MissingDependency without scipy.
    """
    least_squares = needed("scipy.optimize", "a fit of curves").least_squares
    if len(given) not in (1, len(curves)):
        raise ScenarioError(f"{len(curves)} curves and {len(given)} scenarios; give one for all or one for each")
    for one, other in itertools.combinations(curves, 2):
        if np.array_equal(one.displacement, other.displacement) and np.array_equal(one.load, other.load):
            raise ScenarioError(f"{one.name} and {other.name} are the same curve; give it once")
    alone = len(given) == 1
    given = [given[0]] * len(curves) if alone else list(given)
    start = _start(given, keys)
    points = sum(len(curve.load) for curve in curves)
    if points <= len(keys):
        raise ScenarioError(
            f"{points} measured points cannot determine {len(keys)} keys; vary fewer keys, or measure more points"
        )
    runs = _Runs(given, curves, dict(zip(keys, start, strict=True)), report)
    at = np.zeros(len(keys))
    for _ in range(STARTS):
        trial = _IntervalSearch(runs, _searched(least_squares, runs, at, HOLD))
        trial = _IntervalSearch(runs, _searched(least_squares, runs, trial.best, HOLD_OF_SCATTER * trial.scatter))
        try:
            ends = [(trial.end(i, -1.0), trial.end(i, 1.0)) for i in range(len(keys))]
        except _Better as better:
            at = better.at
            continue
        break
    else:
        raise NotConvergedError(f"the fit did not converge from {STARTS} starts; the last: {runs.told(trial.best)}")
    values = runs.values(trial.best)
    fitted = {
        key: Fitted(value, _times(value, low), _times(value, high), None not in (low, high))
        for (key, value), (low, high) in zip(values.items(), ends, strict=True)
    }
    documents = runs.documents
    best = [_with(scenario, document, values) for scenario, document in zip(given, documents, strict=True)]
    misfits = [between(_curve(scenario), curve, curve.name) for scenario, curve in zip(best, curves, strict=True)]
    return CurveFit(fitted, misfits, best[:1] if alone else best)


def _times(value: float, end: float | None) -> float | None:
    return None if end is None else value * math.exp(end)


def _searched(least_squares, runs: _Runs, start: np.ndarray, hold: float) -> np.ndarray:
    """Best logarithms (k,) found from a start; ``hold`` is the weight that holds them near it."""
    held = hold * np.eye(len(start))
    found = least_squares(
        lambda x: np.concatenate([runs.residuals(x), held @ (x - start)]), start,
        jac=lambda x: np.concatenate([runs.slopes(x), held]),
        bounds=(-RANGE, RANGE), ftol=1e-9, xtol=1e-7, gtol=1e-10, max_nfev=MOST,
    )  # fmt: skip
    if not found.success:
        _, sizes, directions = np.linalg.svd(runs.slopes(found.x), full_matrices=False)
        remedy = "start from closer values, or vary fewer keys"
        if sizes[-1] < APART * sizes[0]:
            mixed = [key for key, part in zip(runs.starts, directions[-1], strict=True) if abs(part) > MIXED]
            remedy = f"these curves hardly distinguish {' and '.join(mixed)}: vary only one of them"
        raise NotConvergedError(f"the fit did not converge in {MOST} rounds; the last: {runs.told(found.x)}; {remedy}")
    return found.x


class _Runs:
    """Runs of the scenarios as functions of x (k,), the logarithms of the keys over their start values."""

    def __init__(
        self,
        given: Sequence[Scenario],
        curves: Sequence[MeasuredCurve],
        starts: dict[str, float],
        report: Callable[[Progress], None] | None,
    ):
        self.given, self.measured, self.starts, self.report = given, curves, starts, report
        self.documents = [scenarios.text_of(scenario) for scenario in given]
        self.greatest = max(float(np.abs(curve.load).max(initial=0.0)) for curve in curves)
        if not self.greatest > 0.0:
            raise ScenarioError("the measured curves have no force")
        self._known: dict[bytes, list[MeasuredCurve] | None] = {}
        self._reason = ""  # why the last run that failed has no answer
        self._travels: list[dict[str, float]] = [{} for _ in given]
        self._reach()

    def _reach(self) -> None:
        """Extend the travel to a little beyond the measured curves, as a stronger joint leaves more of it in the jack;
        ScenarioError if they go much further."""
        at_start = np.zeros(len(self.starts))
        for i, (scenario, curve) in enumerate(zip(self.given, self.measured, strict=True)):
            travel = scenario.control.travel
            lack = SPARE * curve.displacement.max() - present(self.curves(at_start))[i].displacement.max()
            if travel is not None and 0.0 < lack <= travel:
                self._travels[i] = {"control.travel": travel + lack}
        if any(self._travels):
            self._known.clear()
        for ours, curve in zip(present(self.curves(at_start)), self.measured, strict=True):
            require_comparable(ours, curve, curve.name)
            reached = len(_difference(ours, curve, beyond=False))
            if reached < REACHED * len(curve.load):
                raise ScenarioError(
                    f"the simulated travel ends before the measured one ({1e3 * ours.displacement.max():.4g} and "
                    f"{1e3 * curve.displacement.max():.4g} mm); lengthen control.travel, or correct the unit of the "
                    "curve"
                )

    def values(self, x: np.ndarray) -> dict[str, float]:
        return {key: start * math.exp(one) for (key, start), one in zip(self.starts.items(), x, strict=True)}

    def told(self, x: np.ndarray) -> str:
        return ", ".join(f"{key} = {value:.5g}" for key, value in self.values(x).items())

    def curves(self, x: np.ndarray) -> list[MeasuredCurve] | None:
        """The curve of every run, None if one of them has no answer; runs are cached."""
        place = x.tobytes()
        if place not in self._known:
            values = self.values(x)
            if self.report is not None:
                self.report(Progress("runs of the fit", len(self._known)))
            try:
                self._known[place] = [
                    _curve(_with(scenario, document, travel | values), told=not self._known)
                    for scenario, document, travel in zip(self.given, self.documents, self._travels, strict=True)
                ]
            except DembrickError as error:
                if not x.any():  # the scenario as it is given
                    raise
                self._known[place], self._reason = None, str(error)
        return self._known[place]

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Simulated minus measured force (n,) over the greatest measured one; infinite if a run has no answer."""
        curves = self.curves(x)
        if curves is None:
            return np.full(sum(len(curve.load) for curve in self.measured), math.inf)
        pairs = zip(curves, self.measured, strict=True)
        return np.concatenate([_difference(ours, theirs) / self.greatest for ours, theirs in pairs])

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Derivatives (n, k) of the residuals by the logarithms, by central differences about x."""
        pairs = [(self.residuals(x + h), self.residuals(x - h)) for h in STEP * np.eye(len(x))]
        if not np.isfinite(pairs).all():
            raise NotConvergedError(
                f"runs close to {self.told(x)} have no answer, so the fit cannot continue; start from other values, "
                f"or remove the cause: {self._reason}"
            )
        return np.stack([(above - below) / (2.0 * STEP) for above, below in pairs], axis=1)

    @property
    def ends(self) -> list[int]:
        """Indices in the residuals at which the curves but the last end."""
        return np.cumsum([len(curve.load) for curve in self.measured])[:-1].tolist()


class _Better(Exception):
    """Raised with values that explain the curves better than the best so far."""

    def __init__(self, at: np.ndarray):
        super().__init__()
        self.at = at


class _IntervalSearch:
    """Finds how far each key may move from its ``best`` value before the misfit rises beyond chance."""

    def __init__(self, runs: _Runs, best: np.ndarray):
        self.runs, self.best = runs, best
        residuals, self.slopes = runs.residuals(best), runs.slopes(best)
        n, k = self.slopes.shape
        self.least = float(residuals @ residuals)
        self.scatter = max(math.sqrt(self.least / (n - k)), NUMERICAL)
        _, sizes, directions = np.linalg.svd(self.slopes, full_matrices=False)
        alone = np.linalg.norm(directions.T / np.maximum(sizes, 1e-9), axis=1)  # for a scatter of one
        self.half = np.maximum(half_widths(self.slopes, residuals, runs.ends, CONFIDENCE), 2.0 * NUMERICAL * alone)
        self.rise = (self.half / alone) ** 2  # of the misfit at the ends, if all is linear

    def end(self, i: int, sign: float) -> float | None:
        """The end of the interval of key i, as the change of its logarithm; None if it is open."""
        d = min(float(self.half[i]), OPEN)
        risen = self._risen(i, sign * d)
        if AGREES[0] <= risen <= AGREES[1]:
            return sign * d
        below, above = 0.0, d
        while risen < 1.0:
            if d >= OPEN:
                return None
            below, d = d, min(2.0 * d, OPEN)
            above, risen = d, self._risen(i, sign * d)
        while above - below > CLOSE * above:
            middle = 0.5 * (below + above)
            found = self._risen(i, sign * middle)
            if found < 1.0:
                below = middle
            else:
                above, risen = middle, found
        return sign * above if math.isfinite(risen) else None  # a run without an answer refutes nothing

    def _risen(self, i: int, change: float) -> float:
        """Rise of the misfit over the greatest rise by chance, with key i changed and the others fitted again."""
        others = np.delete(np.arange(len(self.best)), i)
        own, hold = self.slopes[:, others], HOLD_OF_SCATTER * self.scatter
        back = np.linalg.solve(own.T @ own + hold**2 * np.eye(len(others)), own.T)
        at = self.best.copy()
        at[i] += change
        at[others] -= (back @ self.slopes[:, i] * change).clip(-OPEN, OPEN)
        least = math.inf
        for _ in range(2 if len(others) else 1):
            residuals = self.runs.residuals(at)
            misfitting = float(residuals @ residuals)
            if not math.isfinite(misfitting):
                break
            if self.least - misfitting > 0.1 * self.rise[i]:
                raise _Better(at.clip(-RANGE, RANGE))
            least = min(least, misfitting)
            at = at.copy()
            at[others] -= (back @ residuals).clip(-1.0, 1.0)
        return (least - self.least) / self.rise[i]


def _start(given: Sequence[Scenario], keys: Sequence[str]) -> list[float]:
    """Start values (k,) of the keys, those of the first scenario."""
    if not keys:
        raise ScenarioError("--vary names no key; for instance --vary joint.friction,joint.shear_stiffness")
    if len(set(keys)) < len(keys):
        raise ScenarioError(f"--vary names a key twice: {', '.join(keys)}")
    for key in keys:
        if key.split(".")[0] in OF_THE_RUN:
            raise ScenarioError(
                f"{key} says how the test is run and cannot be fitted to a curve; vary properties of the structure"
            )
    for scenario in given:
        control = scenario.control
        pressed = any(pressure.actuator for pressure in scenario.pressures)
        if not isinstance(control, DisplacementControl) or pressed:
            raise ScenarioError(
                f"a test of kind {show(scenario.control.kind)} has no curve of force over displacement; fit one of "
                'kind "displacement" whose actuators push'
            )
    return [_value(given[0], key) for key in keys]


def _value(scenario: Scenario, key: str) -> float:
    """The number at a key path of a scenario."""
    text = scenarios.text_of(scenario)
    document = tomllib.loads(text)
    node: object = document
    default: object = scenario  # default of a key that the text leaves out
    for step in overrides.resolved(document, key):
        if isinstance(node, list) and isinstance(step, int):
            node = node[step]
        else:
            node = node.get(step) if isinstance(node, dict) else None
        if isinstance(default, tuple) and isinstance(step, int):
            default = default[step]
        else:
            default = default.get(step) if isinstance(default, dict) else getattr(default, str(step), None)
    node = default if node is None else node
    if isinstance(node, int | float) and not isinstance(node, bool):
        if node > 0.0:
            return float(node)
        raise ScenarioError(f"{key} = {node:g} cannot be the start of a fit; give the scenario a value above zero")
    if node is None:
        scenarios.varied(text, scenario.path, {key: 1.0})  # raises for an unknown key, and names the nearest
    raise ScenarioError(f"{key} is not a number in this scenario; give it a value to start from")


def _with(scenario: Scenario, text: str, values: dict[str, float]) -> Scenario:
    found = scenarios.varied(text, scenario.path, values)
    return replace(found, path=scenario.path, files=scenario.files)


def _curve(scenario: Scenario, told: bool = False) -> MeasuredCurve:
    """Displacement and force of a run; remarks are reported if ``told``, for the first run only."""
    try:
        result = simulate(scenario, progress=False, report=None if told else _unheard)
    except DembrickError as error:
        raise type(error)(f"a run of the fit failed: {error}") from error
    rows = result.rows
    return MeasuredCurve("ours", np.asarray(rows["displacement"], float), np.asarray(rows["load"], float))


def _unheard(_: str) -> None:
    """Ignore a remark, as the first run has made it."""


def _difference(ours: Curve, theirs: Curve, beyond: bool = True) -> np.ndarray:
    """Simulated minus measured force (k,) at the measured points; with ``beyond`` also at those beyond the simulated
    travel, with its last force."""
    if turns(np.asarray(theirs.displacement)) > turns(np.asarray(ours.displacement)):
        raise ScenarioError(
            "the measured curve turns more often than the simulated one: sort its lines by displacement if it was "
            "measured one way, else give control.protocol"
        )
    _, simulated, measured = compared(ours, theirs, beyond)
    return simulated - measured


def lines_of(found: CurveFit) -> list[str]:
    """Lines that the command line prints of a fit."""
    width = max(map(len, found.keys))
    lines = []
    for key, one in found.keys.items():
        if one.determined:
            lines.append(f"{key:{width}}  {one.value:.5g}  (95 %: {one.lower:.5g} to {one.upper:.5g})")
        else:
            known = [f"{word} {end:.5g}" for word, end in (("at least", one.lower), ("at most", one.upper)) if end]
            lines.append(
                f"{key:{width}}  {one.value:.5g}  not determined by these data{''.join(', ' + k for k in known)}"
            )
    return lines + [f"misfit        {text(one)}" for one in found.misfits]


def write(scenario: Scenario, path: str | os.PathLike, source: str) -> None:
    """Write a fitted scenario; ``source`` names the curves, for a comment at its head."""
    from dembrick import history

    text = f"# fitted to {source}\n{scenarios.dumps(scenario)}"
    history.write_whole(os.fspath(path), text.encode(), "file")
