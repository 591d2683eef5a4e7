"""Random numbers of a study: stated distributions, a seed, and two ways to draw.

``monte-carlo`` draws every number by itself, ``latin-hypercube`` one number from each of ``count`` equally likely
slices of every key. Any case can be drawn without the others, so that a shard of a study draws the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import nearest, real, show

METHODS = ("monte-carlo", "latin-hypercube")
_KEYS = {
    "uniform": ("lower", "upper"),
    "normal": ("mean", "deviation"),
    "lognormal": ("mean", "deviation"),
    "triangular": ("lower", "mode", "upper"),
}
_BOUNDS = ("lower", "upper")
_STANDARD = NormalDist()
_WIDEST = 1e6  # of the mean: greatest deviation


@dataclass(frozen=True)
class Distribution:
    """Distribution of a number by its quantile function; ``lower`` and ``upper`` truncate a normal or lognormal one.

    ``mean`` and ``deviation`` are those of the number itself, before truncation, also for ``lognormal``.
    """

    kind: str
    mean: float = 0.0
    deviation: float = 1.0
    mode: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf

    def at(self, share: float) -> float:
        """Quantile: the number below which the ``share`` (0 to 1) of all draws lies."""
        if self.kind == "uniform":
            return self.lower + share * (self.upper - self.lower)
        if self.kind == "triangular":
            span, rise = self.upper - self.lower, self.mode - self.lower
            if share * span <= rise:
                return self.lower + math.sqrt(share * span * rise)
            return self.upper - math.sqrt((1.0 - share) * span * (self.upper - self.mode))
        low, high = (self._share_below(bound) for bound in (self.lower, self.upper))
        inside = min(max(low + share * (high - low), 1e-300), 1.0 - 1e-16)
        number = self._from_standard(_STANDARD.inv_cdf(inside))
        return min(max(number, self.lower), self.upper)

    def _shape(self) -> tuple[float, float]:
        """Mean and deviation of the logarithm."""
        variance = math.log1p((self.deviation / self.mean) ** 2)
        return math.log(self.mean) - 0.5 * variance, math.sqrt(variance)

    def _from_standard(self, z: float) -> float:
        if self.kind == "normal":
            return self.mean + self.deviation * z
        middle, spread = self._shape()
        return math.exp(middle + spread * z)

    def _share_below(self, bound: float) -> float:
        if math.isinf(bound):
            return 0.0 if bound < 0.0 else 1.0
        if self.kind == "normal":
            return _STANDARD.cdf((bound - self.mean) / self.deviation)
        middle, spread = self._shape()
        return 0.0 if bound <= 0.0 else _STANDARD.cdf((math.log(bound) - middle) / spread)


def distribution(key: str, table: Mapping) -> Distribution:
    """The distribution that a table of a study states; ScenarioError for an invalid table."""
    place = f"draws.of.{key}"
    kind = table.get("distribution")
    if kind not in _KEYS:
        raise ScenarioError(f"{place}: distribution = {show(kind)} is unknown; {nearest(str(kind), _KEYS)}")
    known = ("distribution", *_KEYS[kind], *_BOUNDS)
    for name, value in table.items():
        if name not in known:
            raise ScenarioError(f"{place}: unknown key {show(name)}; {nearest(name, known)}")
        if name != "distribution":
            real(f"{place}: {name}", value)
    for name in _KEYS[kind]:
        if name not in table:
            raise ScenarioError(f"{place}: a {kind} distribution needs {name!r}; it has no default")
    found = Distribution(kind, **{name: float(value) for name, value in table.items() if name != "distribution"})
    if not found.lower < found.upper:
        raise ScenarioError(f"{place}: lower = {found.lower:g} must be below upper = {found.upper:g}")
    if kind == "triangular" and not found.lower <= found.mode <= found.upper:
        raise ScenarioError(f"{place}: mode = {found.mode:g} must lie between lower and upper")
    if kind in ("normal", "lognormal"):
        if not found.deviation > 0.0:
            raise ScenarioError(f"{place}: deviation = {found.deviation:g} must be greater than 0")
        if kind == "lognormal" and not found.mean > 0.0:
            raise ScenarioError(f"{place}: a lognormal distribution needs a mean greater than 0, not {found.mean:g}")
        if kind == "lognormal" and not found.deviation < _WIDEST * found.mean:
            raise ScenarioError(f"{place}: deviation = {found.deviation:g} is more than {_WIDEST:g} times the mean")
        if not found._share_below(found.upper) - found._share_below(found.lower) > 1e-12:
            raise ScenarioError(f"{place}: the distribution has no values between lower and upper")
    return found


class Draws:
    """``count`` sets of numbers, one for each of the distributions of ``of``; set i is drawn on demand."""

    def __init__(self, of: Mapping[str, Distribution], count: int, seed: int, method: str):
        self.of, self.count, self._seed, self._method = dict(of), count, seed, method
        self._slice: dict[str, np.ndarray] = {}

    def __getitem__(self, index: int) -> dict[str, float]:
        return {key: one.at(self._share(key, k, index)) for k, (key, one) in enumerate(self.of.items())}

    def _share(self, key: str, number: int, index: int) -> float:
        # Philox is counter-based: every case has its own stream, whatever was drawn before
        share = np.random.Generator(np.random.Philox(key=[self._seed, number], counter=[0, 0, 0, index])).random()
        if self._method == "monte-carlo":
            return float(share)
        if key not in self._slice:
            shuffler = np.random.Generator(np.random.Philox(key=[self._seed, number], counter=[0, 0, 1, 0]))
            self._slice[key] = shuffler.permutation(self.count)
        return float((self._slice[key][index] + share) / self.count)
