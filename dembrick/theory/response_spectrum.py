"""Response spectrum of a ground motion: peak response of linear oscillators over a range of periods."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError

_A_PERIOD = 40  # least number of steps per shortest period: a peak between two steps is missed by at most 0.3 %


class Spectrum(NamedTuple):
    """Peak ``displacement`` (k,) m relative to the ground of oscillators with ``period`` (k,) s; ``damping``: fraction
    of critical."""

    period: np.ndarray
    displacement: np.ndarray
    damping: float

    @property
    def pseudo_acceleration(self) -> np.ndarray:
        """omega^2 times the displacement (m/s2): spring force per mass."""
        return (2.0 * np.pi / self.period) ** 2 * self.displacement


def response_spectrum(time, acceleration, period, damping: float = 0.05) -> Spectrum:
    """The spectrum of ground accelerations (T,) m/s2 at ``time`` (T,) s, linear between these and zero afterwards, at
    each ``period`` (k,) s; ``damping``: fraction of critical, below 1.

    Steps are exact for linear segments of acceleration (Nigam and Jennings, Bull. Seism. Soc. Am. 59, 1969), and so
    short that no peak is missed by more than 0.3 %; the peak of the free vibration after the record is in closed form.
    Raises ScenarioError for invalid values.
    """
    t, a, T = (np.asarray(values, float) for values in (time, acceleration, period))
    if not (len(t) > 1 and t.shape == a.shape and (np.diff(t) > 0.0).all() and np.isfinite(a).all()):
        raise ScenarioError("a spectrum needs increasing times, with a finite acceleration at each")
    if not (len(T) and np.isfinite(T).all() and (T > 0.0).all()):
        raise ScenarioError("the periods of a spectrum must be finite and greater than 0 s")
    if not 0.0 <= damping < 1.0:
        raise ScenarioError(f"damping = {damping!r} is out of range: 0 to less than 1 of critical")
    step = float(np.diff(t).min()) / np.ceil(float(np.diff(t).min()) * _A_PERIOD / float(T.min()))
    count = int(np.ceil((t[-1] - t[0]) / step))
    ground = np.interp(t[0] + step * np.arange(count + 1), t, a, right=0.0)
    forth, before, after = _steps(T, damping, step)
    state, most = np.zeros((2, len(T))), np.zeros(len(T))
    for now, then in zip(ground[:-1], ground[1:], strict=True):
        state = np.einsum("ijk,jk->ik", forth, state) + now * before + then * after
        np.maximum(most, np.abs(state[0]), out=most)
    return Spectrum(T, np.maximum(most, _free_peak(T, damping, *state)), float(damping))


def _free_peak(period: np.ndarray, damping: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Peak displacement (k,) m of a free vibration from u (m) and v (m/s): that at the start or at the first reversal,
    as later ones are damped."""
    w = 2.0 * np.pi / period
    free = w * np.sqrt(1.0 - damping**2)
    # u(t) = exp(-damping w t) (u cos + (v + damping w u) / free sin), whose derivative is zero at
    turn = np.mod(np.arctan2(v * free, w * (w * u + damping * v)), np.pi)
    swing = u * np.cos(turn) + (v + damping * w * u) / free * np.sin(turn)
    return np.maximum(np.abs(u), np.exp(-damping * w / free * turn) * np.abs(swing))


def _steps(period: np.ndarray, damping: float, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices of a step of ``h`` (s): from displacement and velocity before it (2, 2, k), from the ground acceleration
    before it (2, k), and from that after it (2, k)."""
    w = 2.0 * np.pi / period
    free = w * np.sqrt(1.0 - damping**2)
    decay, s, c = np.exp(-damping * w * h), np.sin(free * h), np.cos(free * h)
    forth = decay * np.array([[c + damping * w / free * s, s / free], [-(w**2) / free * s, c - damping * w / free * s]])
    # under -(a0 + (a1 - a0) t / h) the particular solution is p + q t
    q = -np.array([-1.0, 1.0])[:, None] / (h * w**2)
    p = -np.array([1.0, 0.0])[:, None] / w**2 - 2.0 * damping / w * q
    end = np.stack([p + q * h, q], axis=1)  # (2 accelerations, 2, k)
    start = np.stack([p, q], axis=1)
    gained = end - np.einsum("ijk,ajk->aik", forth, start)
    return forth, gained[0], gained[1]
