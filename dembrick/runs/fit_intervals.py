"""Confidence intervals of the keys of a least-squares fit: half-widths from the scatter about the fit.

Near the fit a key is a weighted sum of the measured forces, by the rows of (J^T J)^-1 J^T. Its variance is estimated
for scatter that is equal and independent at all points, for scatter that differs from point to point (jackknife: every
point left out once), and for scatter that is correlated along the curve, as a model error is (Newey and West, 1987:
autocovariances of the residuals, tapered linearly up to some share of the curve). The greatest estimate counts: the
first always, another if it is greater than chance would make it. Student's t has the degrees of freedom of each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from dembrick.errors import needed

SHARES = tuple(1.0 / (3 * 2**power) for power in range(9))  # of a curve, up to which autocovariances are followed
LAGS = 1.5  # degrees of freedom times the share (of Bartlett's taper)
FEWEST = 2.0  # least degrees of freedom of an estimate that counts
CHANCE = 0.7  # quantile of the ratio to the first estimate, for equal and independent scatter
STRONGEST = 0.99  # greatest correlation of neighbours
ALONE = 1e-6  # least value of one minus the leverage of a point

_Estimate = tuple[np.ndarray, np.ndarray]  # variances (k,), degrees of freedom (k,)


def half_widths(slopes: np.ndarray, residuals: np.ndarray, ends: Sequence[int], confidence: float) -> np.ndarray:
    """Half-widths (k,) of the intervals that contain all k keys at once with that ``confidence`` (Bonferroni).

    ``slopes`` (n, k) of the residuals; ``ends``: indices in the n points at which the curves but the last end.
    """
    special = needed("scipy.special", "a fit of curves")
    n, k = slopes.shape
    inverse = np.linalg.pinv(slopes.T @ slopes)
    weights = inverse @ slopes.T  # (k, n)
    quantile = 1.0 - 0.5 * (1.0 - confidence) / k
    parts = [slice(a, b) for a, b in zip((0, *ends), (*ends, n), strict=True)]
    alike = float(residuals @ residuals) / (n - k) * np.diag(inverse)
    rho = _neighbours(residuals, parts)
    half = special.stdtrit(n - k, quantile) * np.sqrt(alike * (1.0 + rho) / (1.0 - rho))
    for variance, freedom in (_unequal(slopes, weights, residuals), *_running(weights, residuals, parts)):
        counts = (freedom >= FEWEST) & (variance > alike * special.fdtri(freedom, n - k, CHANCE))
        half = np.where(counts, np.maximum(half, special.stdtrit(freedom, quantile) * np.sqrt(variance)), half)
    return half


def _neighbours(residuals: np.ndarray, parts: Sequence[slice]) -> float:
    """Correlation of neighbouring residuals on a curve: 0 if negative, at most `STRONGEST`."""
    total = float(residuals @ residuals)
    found = sum(float(residuals[own][1:] @ residuals[own][:-1]) for own in parts) / total if total > 0.0 else 0.0
    return min(max(found, 0.0), STRONGEST)


def _unequal(slopes: np.ndarray, weights: np.ndarray, residuals: np.ndarray) -> _Estimate:
    """Estimate for independent scatter that differs from point to point."""
    n, k = slopes.shape
    others = np.maximum(1.0 - np.einsum("ni,in->n", slopes, weights), ALONE)
    squares = weights**2 / others
    total = np.sum(squares**2, axis=1)  # zero for a key on which no force depends
    freedom = np.divide(np.sum(squares, axis=1) ** 2, total, out=np.zeros(k), where=total > 0.0)
    return np.sum((weights * residuals / others) ** 2, axis=1) * (n - 1) / n, np.maximum(freedom - k, 0.0)


def _running(weights: np.ndarray, residuals: np.ndarray, parts: Sequence[slice]) -> Iterator[_Estimate]:
    """Estimates for equal scatter that is correlated along each of `SHARES` of the curves."""
    k, n = weights.shape
    for share in SHARES:
        variance = np.zeros(k)
        for own in parts:
            lags = int(share * (own.stop - own.start)) + 1
            taper = 1.0 - np.arange(lags) / lags
            tapered = taper * _products(residuals[own], lags) / (own.stop - own.start) * n / (n - k)
            for i in range(k):
                both = tapered * _products(weights[i, own], lags)
                variance[i] += both[0] + 2.0 * both[1:].sum()
        yield variance, np.full(k, max(LAGS / share - k, 0.0))


def _products(values: np.ndarray, lags: int) -> np.ndarray:
    """Sums of products (lags,) of the values that lie 0, 1, 2, ... points apart."""
    size = 2 ** math.ceil(math.log2(2 * len(values)))
    spectrum = np.fft.rfft(values, size)
    return np.fft.irfft(spectrum * spectrum.conj(), size)[:lags]
