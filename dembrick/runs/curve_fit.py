"""Keys of a scenario that best explain measured curves of force over displacement, with their 95 % intervals.

Least squares on the logarithms of the keys (they are positive): sum(((V_sim(u_i) - V_i) / V_peak)^2) over all measured
points. The intervals are those of the linearised problem, Student's t with the scatter about the fit; all keys at once
are within theirs with 95 %. A direction of the keys along which the curves do not change is not determined by the data:
the intervals of its keys are open.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dembrick.errors import DembrickError, NotConvergedError, ScenarioError, needed
from dembrick.runs.fit import CONFIDENCE
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import show
from dembrick.scenario.model import Scenario
from dembrick.scenario.regimes import ACTUATORS
from dembrick.views.misfit import Curve, Misfit, between, compared, text
from dembrick.views.plot.curves import MeasuredCurve

STEP = 1e-3  # relative change of a key, for the slope of the curve
TOLERANCE = 1e-6  # relative change of the keys, or of the misfit, that ends the search
MOST = 40  # iterations
RANGE = math.log(1e4)  # about the start, in which keys are looked for
OPEN = math.log(10.0)  # half width of an interval beyond which the data do not determine a key
REACHED = 0.8  # of the measured points: what the simulated travel must reach at least
FURTHER = 3.0  # half widths of an interval from the best value: there the curve must be worse than at its end
HOLD = 1e-4  # of V_peak for a key that grows by e: keeps what the data do not determine near its start
REFUSED = 1e3  # in place of residuals, where values allow no run
FLAT = 1e-5  # of V_peak: what a key must change the curve by, if it doubles


@dataclass(frozen=True)
class Fitted:
    """A key: its ``value`` and 95 % interval, and whether the data determine it; open ends are None."""

    value: float
    lower: float | None
    upper: float | None
    determined: bool


@dataclass(frozen=True)
class CurveFit:
    """``keys``: what was found of each; ``misfits`` of every curve with these values; ``scenarios`` with them."""

    keys: dict[str, Fitted]
    misfits: list[Misfit]
    scenarios: list[Scenario]

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick fit --lab CURVE SCENARIO``; of several curves the mean misfit, and each."""
        each = [one.numbers() for one in self.misfits]
        mean = {}
        for name in each[0]:
            known = [value for one in each if (value := one[name]) is not None]
            mean[name] = float(np.mean(known)) if known else None
        found = {"fit": {key: vars(one) for key, one in self.keys.items()}, "misfit": mean}
        return found | ({"misfits": each} if len(each) > 1 else {})


def fit_curves(given: Sequence[Scenario], curves: Sequence[MeasuredCurve], keys: Sequence[str]) -> CurveFit:
    """Fit ``keys``, paths as for ``--set``, of scenarios to measured curves: one scenario for all or one for each.

    Raises ScenarioError for keys that are no positive numbers of the scenario, for fewer points than keys, for a
    control that pushes no actuator; NotConvergedError if the search does not settle; MissingDependency without scipy.
    """
    least_squares = needed("scipy.optimize", "a fit of curves").least_squares
    if len(given) not in (1, len(curves)):
        raise ScenarioError(f"{len(curves)} curves and {len(given)} scenarios; give one for all or one for each")
    alone = len(given) == 1
    given = [given[0]] * len(curves) if alone else list(given)
    start = _start(given, keys)
    points = sum(len(curve.load) for curve in curves)
    if points <= len(keys):
        raise ScenarioError(f"{points} measured points cannot tell {len(keys)} keys; vary fewer, or measure more")
    documents = [scenarios.text_of(scenario) for scenario in given]
    greatest = max(float(np.abs(curve.load).max(initial=0.0)) for curve in curves)
    count = 0

    def residuals(x: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        values = dict(zip(keys, np.exp(x).tolist(), strict=True))
        found = []
        for scenario, document, curve in zip(given, documents, curves, strict=True):
            try:
                ours = _curve(_with(scenario, document, values))
            except (ScenarioError, NotConvergedError):
                if count <= 1 + len(keys):  # at the start, or next to it
                    raise
                return np.full(points + len(keys), REFUSED)  # values that no run takes: the step was too long
            if count == 1 and len(compared(ours, curve)[0]) < REACHED * len(curve.load):
                raise ScenarioError("the simulated travel ends before the measured one; lengthen control.travel")
            found.append(_difference(ours, curve) / greatest)
        return np.concatenate([*found, HOLD * (x - begin)])

    x = begin = np.log(start)
    try:
        found = least_squares(
            residuals, x, bounds=(x - RANGE, x + RANGE), diff_step=STEP / np.maximum(np.abs(x), 1.0), xtol=TOLERANCE,
            ftol=TOLERANCE, gtol=1e-12, max_nfev=MOST, x_scale="jac",
        )  # fmt: skip
    except (ValueError, FloatingPointError) as error:
        raise NotConvergedError(f"the fit failed: {error}; start from other values") from error
    if not found.success:
        raise NotConvergedError(
            f"the fit did not settle after {count} runs; start from values that are nearer, or vary fewer keys"
        )
    fitted = _intervals(keys, found.x, found.jac[:points], found.fun[:points], lambda x: residuals(x)[:points])
    values = {key: one.value for key, one in fitted.items()}
    best = [_with(scenario, document, values) for scenario, document in zip(given, documents, strict=True)]
    misfits = [between(_curve(scenario), curve, curve.name) for scenario, curve in zip(best, curves, strict=True)]
    return CurveFit(fitted, misfits, best[:1] if alone else best)


def _start(given: Sequence[Scenario], keys: Sequence[str]) -> list[float]:
    """The values (k,) of the keys that the first scenario has."""
    if not keys:
        raise ScenarioError("--vary names no key; for instance --vary joint.friction,joint.shear_stiffness")
    if len(set(keys)) < len(keys):
        raise ScenarioError(f"--vary names a key twice: {', '.join(keys)}")
    for scenario in given:
        if scenario.control.drives != ACTUATORS:
            raise ScenarioError(
                f"a test of kind {show(scenario.control.kind)} has no curve of force over displacement; fit one whose "
                "actuators push"
            )
    return [_value(given[0], key) for key in keys]


def _value(scenario: Scenario, key: str) -> float:
    """The number that a scenario has under a path of keys."""
    text = scenarios.text_of(scenario)
    node: object = scenario
    for part in key.split("."):
        entries = node if isinstance(node, tuple) else None
        if entries is not None:
            names = (({getattr(one, "name", None), getattr(one, "block", None)}, one) for one in entries)
            node = next((one for own, one in names if part in own), None)
        elif isinstance(node, dict):
            node = node.get(part)
        else:
            node = getattr(node, part, None)
    if isinstance(node, int | float) and not isinstance(node, bool):
        if node > 0.0:
            return float(node)
        raise ScenarioError(f"{key} = {node:g} is no start for a fit; give the scenario a value above zero")
    if node is None:
        scenarios.varied(text, scenario.path, {key: 1.0})  # a key that there is not is named here, with the nearest one
    raise ScenarioError(f"{key} is no number of this scenario; give it a value to start from")


def _with(scenario: Scenario, text: str, values: dict[str, float]) -> Scenario:
    found = scenarios.varied(text, scenario.path, values)
    return replace(found, path=scenario.path, files=scenario.files)


def _curve(scenario: Scenario) -> Curve:
    """Displacement and force of a run."""
    try:
        result = simulate(scenario, progress=False)
    except DembrickError as error:
        raise type(error)(f"a run of the fit failed: {error}") from error
    rows = result.rows
    return MeasuredCurve("ours", np.asarray(rows["displacement"], float), np.asarray(rows["load"], float))


def _difference(ours: Curve, theirs: Curve) -> np.ndarray:
    """Simulated less measured force (k,) at all measured points; those beyond the simulated travel have its last."""
    _, simulated, measured = compared(ours, theirs, beyond=True)
    if len(measured) < len(theirs.load):
        raise ScenarioError("the measured curve turns more often than the simulated one: give control.protocol")
    return simulated - measured


def _intervals(
    keys: Sequence[str],
    x: np.ndarray,
    jacobian: np.ndarray,
    residual: np.ndarray,
    residuals: Callable[[np.ndarray], np.ndarray],
) -> dict[str, Fitted]:
    """Value and interval of every key, from the Jacobian of the residuals in the logarithms of the keys.

    An interval is open at an end beyond which the curve does not get worse as the linearised problem says:
    ``residuals`` are asked at `FURTHER` half widths.
    """
    freedom = len(residual) - len(x)
    squares = float(residual @ residual)
    scatter = math.sqrt(squares / freedom)
    t = float(
        needed("scipy.special", "a fit of curves").stdtrit(freedom, 1.0 - 0.5 * (1.0 - CONFIDENCE) / len(x))
    )  # Bonferroni: of all keys at once
    _, sizes, directions = np.linalg.svd(jacobian, full_matrices=False)
    least = FLAT * math.sqrt(len(residual))
    variance = np.zeros(len(x))
    flat = np.zeros(len(x), bool)
    for size, direction in zip(sizes, directions, strict=True):
        if size <= least:
            flat |= np.abs(direction) > 0.1
        else:
            variance += (scatter * direction / size) ** 2
    found = {}
    for i, (key, at, spread, is_flat) in enumerate(zip(keys, x, t * np.sqrt(variance), flat, strict=True)):
        ends: list[float | None] = [None, None]
        if not (is_flat or spread > OPEN):
            for side, sign in enumerate((-1.0, 1.0)):
                there = x.copy()
                there[i] += sign * FURTHER * spread
                more = residuals(there)
                if float(more @ more) - squares > (t * scatter) ** 2:
                    ends[side] = math.exp(at + sign * spread)
        found[key] = Fitted(math.exp(at), ends[0], ends[1], None not in ends)
    return found


def lines_of(found: CurveFit) -> list[str]:
    """What the command line prints of a fit."""
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
    """Write a fitted scenario; ``source`` names the curves, for a remark at its head."""
    from dembrick import history

    text = f"# fitted to {source}\n{scenarios.dumps(scenario)}"
    history.write_whole(os.fspath(path), text.encode(), "file")
