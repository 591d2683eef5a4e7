"""Intervals of least-squares fits cover the truth as often as they claim, for random scatter of several kinds."""

import numpy as np
import pytest
from scipy import stats

from dembrick.runs.fit_intervals import half_widths

DRAWS = 200


def rise_and_plateau(n: int, keys: int) -> np.ndarray:
    """Slopes (n, k) of a curve that rises over a fifth of its length: a plateau by friction, a rise by stiffness."""
    way = np.linspace(0.0, 1.0, n)
    return np.column_stack([np.where(way >= 0.2, 1.0, 0.05), np.where(way < 0.2, way / 0.2, 0.02)])[:, :keys]


def covered(slopes: np.ndarray, scatter, ends=()) -> float:
    """The share of draws of ``scatter(rng, n)`` whose intervals cover all keys, whose true value is zero."""
    rng = np.random.default_rng(7)
    fit, held = np.linalg.pinv(slopes), 0
    for _ in range(DRAWS):
        forces = scatter(rng, len(slopes))
        found = fit @ forces
        held += np.all(np.abs(found) <= half_widths(slopes, forces - slopes @ found, ends, 0.95))
    return held / DRAWS


def drift(rng, n):
    """A slow wave over the whole curve, plus noise of the same size."""
    way = np.linspace(0.0, 1.0, n)
    return np.sin(2.0 * np.pi * (rng.uniform(0.3, 2.0) * way + rng.random())) + rng.normal(size=n)


def autoregressive(rng, n, strength=0.8):
    values = np.zeros(n + 200)
    for i, kick in enumerate(rng.normal(size=n + 199), 1):
        values[i] = strength * values[i - 1] + kick
    return values[200:]


@pytest.mark.parametrize("n, keys", [(3, 1), (5, 1), (20, 2), (300, 2)])
def test_scatter_that_is_alike_and_independent(n, keys):
    held = covered(rise_and_plateau(n, keys), lambda rng, size: rng.normal(size=size))
    assert 0.92 <= held <= 0.992


@pytest.mark.parametrize("n, keys", [(500, 1), (1000, 2), (4000, 2)])
def test_a_drift_does_not_get_surer_by_more_points(n, keys):
    """By the correlation of neighbours alone 4,000 points count as a thousand, and one interval in ten is right."""
    assert covered(rise_and_plateau(n, keys), drift) >= 0.83


def test_what_runs_on_from_point_to_point():
    assert covered(rise_and_plateau(100, 1), autoregressive) >= 0.86


def test_a_strong_curve_of_few_points_beside_a_weak_one_of_many():
    """Noise of 1 % of each peak; a common scatter for both curves would cover the key in 40 of 100 draws."""
    heights = np.repeat([1.0, 0.1], [8, 200])
    held = covered(heights[:, None], lambda rng, n: 0.01 * heights * rng.normal(size=n), (8,))
    assert 0.92 <= held <= 0.99


def test_noise_that_grows_with_the_force():
    way = np.r_[np.linspace(0.005, 0.19, 40), np.linspace(0.3, 1.0, 5)]
    force = np.minimum(way / 0.2, 1.0)
    slopes = np.where(way >= 0.2, 1.0, 0.05)[:, None]
    assert covered(slopes, lambda rng, n: 0.02 * force * rng.normal(size=n)) >= 0.9


def test_a_width_by_hand():
    """For n equal points: t s / sqrt(n), with s the deviation and Student's t = 2.262157 for ten points."""
    forces = np.array([3.0, -1.0, 4.0, -1.0, -5.0, 9.0, -2.0, 6.0, -5.0, 3.0])
    left = forces - forces.mean()
    (half,) = half_widths(np.ones((10, 1)), left, (), 0.95)
    assert half == pytest.approx(2.262157 * forces.std(ddof=1) / np.sqrt(10.0), rel=1e-6)


def test_a_key_without_any_effect_has_no_width():
    """Those of the others change by the degree of freedom that it takes."""
    slopes, forces = rise_and_plateau(20, 2), np.sin(np.arange(20.0))
    alone, beside = (half_widths(own, forces, (), 0.95) for own in (slopes, np.column_stack([slopes, np.zeros(20)])))
    assert beside[2] == 0.0 and beside[:2] == pytest.approx(alone, rel=0.2)


def test_the_width_of_running_scatter_by_its_double_sum():
    """Newey and West: sum_ij a_i a_j g_|i-j| (1 - |i - j| / L) for n equal points, a = 1 / n, with the autocovariance g
    of the residuals and L = n / 3 + 1 lags. Here neighbours are uncorrelated, and every second point is not."""
    n = 30
    left = np.where(np.arange(n) < n // 2, 1.0, -1.0) + np.where(np.arange(n) % 2, 1.0, -1.0)
    lags = n // 3 + 1
    g = [sum(left[i] * left[i + h] for i in range(n - h)) / (n - 1) for h in range(lags)]
    pairs = ((i, j) for i in range(n) for j in range(n) if abs(i - j) < lags)
    variance = sum(g[abs(i - j)] * (1.0 - abs(i - j) / lags) for i, j in pairs) / n**2
    assert variance > 3.0 * g[0] / n
    (half,) = half_widths(np.ones((n, 1)), left, (), 0.95)
    assert half == pytest.approx(stats.t.ppf(0.975, 1.5 * 3.0 - 1.0) * np.sqrt(variance), rel=1e-9)
