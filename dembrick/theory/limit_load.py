"""The inverse problem: the multiplier of a given load at which the joint slips.

For a unit load f = (f1, f2, m) about O (m = f2 e_x - f1 e_y for a force at eccentricity e), a constant tangential dead
load g0 and a law with dissipation D, the limit multiplier is

    V* = min over slip twists q of (D(q) - g0 . q) / (f . q),   f . q > 0,

This is the upper-bound theorem with normality in the torsion-shear plane, hence exact at fixed normal forces. On the
plane f . q = 1 it is a convex problem in two unknowns, solved by a guarded Newton iteration for many loads at a time.
Point laws have kinks where the torsion centre coincides with a point; these are approached through a smoothed D, and an
optimal kink is recognised by its exact optimality condition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.theory.limit_surface import Law, PointLaw

_TINY = 1e-300
_SMOOTHING = [0.1**k for k in range(1, 14)]
_SHARP = 4  # step lengths tried on the sharp D of points: shorter steps are needed only on approach to a kink


@dataclass(frozen=True)
class LimitLoad:
    """Limit of one load: multiplier ``V``, ``twist`` (3,) with f . twist = 1, ``torsion_centre`` (x, y) about O in m.

    ``torsion_centre`` is None for a pure translation. ``mode`` is "sliding", or "overturning" if the joint tips first
    (then the twist is NaN).
    """

    V: float
    twist: tuple[float, float, float]
    torsion_centre: tuple[float, float] | None
    mode: str = "sliding"


@dataclass(frozen=True)
class LimitLoads:
    """Limits of k loads: ``V`` (k,), ``twist`` (k, 3), ``torsion_centre`` (k, 2), infinite for a translation."""

    V: np.ndarray
    twist: np.ndarray
    torsion_centre: np.ndarray


class _Problem:
    """The scaled problem: twists (v1, v2, w radius), loads of length one, dissipation over V_0.

    q(z) = f + B z with orthonormal columns B spans the plane f . q = 1.
    """

    def __init__(self, law: Law, loads: np.ndarray, dead: np.ndarray):
        self.law = law
        self.f, self.dead = loads, dead
        k = len(loads)
        helper = np.zeros((k, 3))
        helper[np.arange(k), np.argmin(np.abs(loads), axis=1)] = 1.0
        first = np.cross(loads, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        self.B = np.stack([first, np.cross(loads, first)], axis=2)
        self.to_twist = np.array([1.0, 1.0, 1.0 / law.radius])

    def twist(self, z: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Scaled twists (k, 3) at z (k, 2) of the loads ``at``."""
        return self.f[at] + np.einsum("kij,kj->ki", self.B[at], z)

    def start(self, twist: np.ndarray) -> np.ndarray:
        """The z (k, 2) of given twists, scaled to f . q = 1; zero for a twist whose load does no work."""
        q = twist / self.to_twist
        power = np.sum(self.f * q, axis=1, keepdims=True)
        usable = power > 1e-6 * np.linalg.norm(q, axis=1, keepdims=True)
        q = np.where(usable, q / np.where(usable, power, 1.0), self.f)
        return np.einsum("kij,ki->kj", self.B, q - self.f)

    def evaluate(self, z: np.ndarray, at: np.ndarray, smoothing: float):
        """Objective (k,), gradient (k, 2) and Hessian (k, 2, 2) at z."""
        q = self.twist(z, at)
        D, G, H = self.law.derivatives(q * self.to_twist, smoothing)
        scale = self.to_twist / self.law.strength
        B, dead = self.B[at], self.dead[at]
        value = D / self.law.strength - np.sum(dead * q, axis=1)
        g = np.einsum("kij,ki->kj", B, G * scale - dead)
        H = np.swapaxes(B, 1, 2) @ (H * np.outer(self.to_twist, scale)) @ B
        return value, g, H


def _newton_step(g: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """-H^-1 g and the decrement g . H^-1 g for 2 x 2 systems, regularised where the objective is flat."""
    size = H[:, 0, 0] + H[:, 1, 1] + _TINY
    a, c, b = H[:, 0, 0] + 1e-15 * size, H[:, 1, 1] + 1e-15 * size, H[:, 0, 1]
    det = np.maximum(a * c - b * b, 1e-15 * a * c) + _TINY
    step = -np.stack([c * g[:, 0] - b * g[:, 1], a * g[:, 1] - b * g[:, 0]], axis=1) / det[:, None]
    return step, -np.sum(step * g, axis=1)


def _minimise(
    problem: _Problem, z: np.ndarray, at: np.ndarray, smoothing: float, iterations: int = 100, halvings: int = 50
):
    """Guarded Newton iteration from z (k, 2) for the loads ``at``: (z, converged), where converged is to rounding.

    The iteration ends for a load whose step must be halved more than ``halvings`` times.
    """
    z = z.copy()
    converged = np.zeros(len(z), bool)
    live = np.arange(len(z))
    value, g, H = problem.evaluate(z, at, smoothing)
    for _ in range(iterations):
        step, decrement = _newton_step(g, H)
        # half the decrement is the expected gain; below this limit it is rounding in the objective
        done = decrement <= max(1e-15, problem.law.rounding) * (np.abs(value) + 1e-3)
        if done.any():
            # one last full step, accepted if it reduces the gradient: the twist still gains digits
            last, trial = live[done], z[live[done]] + step[done]
            g_new = problem.evaluate(trial, at[last], smoothing)[1]
            better = np.sum(g_new**2, axis=1) < np.sum(g[done] ** 2, axis=1)
            z[last[better]] = trial[better]
            converged[last] = True
            live, value, g, H, step, decrement = (item[~done] for item in (live, value, g, H, step, decrement))
        if not len(live):
            break
        length, pending = np.ones(len(live)), np.arange(len(live))
        for _halving in range(halvings):
            trial = z[live[pending]] + length[pending, None] * step[pending]
            v_new, g_new, H_new = problem.evaluate(trial, at[live[pending]], smoothing)
            good = v_new < value[pending] - 1e-4 * length[pending] * decrement[pending]
            taken = pending[good]
            z[live[taken]], value[taken], g[taken], H[taken] = trial[good], v_new[good], g_new[good], H_new[good]
            pending = pending[~good]
            if not len(pending):
                break
            length[pending] *= 0.5
        if len(pending):  # no descent: at a kink, or rounding reached
            keep = np.ones(len(live), bool)
            keep[pending] = False
            floor = max(1e-11, 100.0 * problem.law.rounding)
            converged[live[pending]] = decrement[pending] <= floor * (np.abs(value[pending]) + 1e-3)
            live, value, g, H = live[keep], value[keep], g[keep], H[keep]
    return z, converged


def _kinks(
    problem: _Problem, law: PointLaw, z: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotate each load about the point nearest to its torsion centre: (value, scaled twist, whether it is optimal).

    With C on point i, the load is a limit load if the force that balance requires at point i, given the forces of the
    other points, is within its strength; V follows from the moment balance about that point.
    """
    R = law.radius
    q = problem.twist(z, at)
    x, y = law.arms.T / R
    nearest = np.argmin((q[:, :1] - q[:, 2:] * y) ** 2 + (q[:, 1:2] + q[:, 2:] * x) ** 2, axis=1)
    p = law.arms[nearest] / R
    about = np.stack([p[:, 1], -p[:, 0], np.ones(len(q))], axis=1)
    power = np.sum(problem.f[at] * about, axis=1)
    possible = np.abs(power) > 1e-12
    about = about / np.where(possible, power, 1.0)[:, None]
    speed = np.hypot(about[:, :1] - about[:, 2:] * y, about[:, 1:2] + about[:, 2:] * x)
    still = speed <= 1e-13 * np.abs(about[:, 2:])
    pull = np.where(still, 0.0, law.strengths / law.strength)
    value = np.sum(pull * speed, axis=1) - np.sum(problem.dead[at] * about, axis=1)
    pull = pull / np.where(still, 1.0, speed)
    t_1 = np.sum(pull * (about[:, :1] - about[:, 2:] * y), axis=1)
    t_2 = np.sum(pull * (about[:, 1:2] + about[:, 2:] * x), axis=1)
    rest = value[:, None] * problem.f[at, :2] + problem.dead[at, :2] - np.stack([t_1, t_2], axis=1)
    can_bear = np.sum(np.where(still, law.strengths / law.strength, 0.0), axis=1)
    optimal = possible & (np.hypot(*rest.T) <= can_bear * (1.0 + 1e-14))
    return np.where(possible, value, np.inf), about, optimal


def _solve_points(
    problem: _Problem, law: PointLaw, z: np.ndarray, smoothings: list[float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(value, scaled twist, solved) of a point law: an optimal kink, or a smooth minimum away from all points."""
    k = len(problem.f)
    value, q, solved = np.full(k, np.inf), np.zeros((k, 3)), np.zeros(k, bool)
    z, open_ = z.copy(), np.arange(k)
    for smoothing in smoothings:
        if smoothing > 0.0:
            z[open_], _ = _minimise(problem, z[open_], open_, smoothing)
        best, twist, optimal = _kinks(problem, law, z[open_], open_)
        turned, converged = np.ones(len(open_), bool), np.zeros(len(open_), bool)
        smooth = np.flatnonzero(~optimal)  # at an optimal kink the sharp D has no gradient
        if len(smooth):
            sharp, converged[smooth] = _minimise(problem, z[open_[smooth]], open_[smooth], 0.0, 30, _SHARP)
            sharp_value = problem.evaluate(sharp, open_[smooth], 0.0)[0]
            turned[smooth] = best[smooth] < sharp_value
            away = ~turned[smooth]
            best[smooth[away]] = sharp_value[away]
            twist[smooth[away]] = problem.twist(sharp[away], open_[smooth[away]])
        lower = best < value[open_]
        value[open_[lower]], q[open_[lower]] = best[lower], twist[lower]
        done = optimal | (converged & ~turned)
        solved[open_[done]] = True
        open_ = open_[~done]
        if not len(open_):
            break
    # smoothed to 1e-13 of the speed, the bound is accurate to 1e-13 V_0 even if no optimality condition was met
    solved[open_] = True
    return value, q, solved


def limit_loads(
    law: Law, loads: ArrayLike, dead_load: ArrayLike = (0.0, 0.0, 0.0), near: ArrayLike | None = None
) -> LimitLoads:
    """Limit multipliers of many loads (k, 3) = (f1, f2, m) about O, in N, N, N m per unit of V.

    ``dead_load`` (3,) or (k, 3) is the constant tangential load (t1, t2, m) about O. ``near`` (k, 3) are twists close
    to the solutions, such as those of a neighbouring problem: they save time and do not affect the result. Relative
    accuracy is about 1e-12 for polygons, 1e-11 for points.
    """
    loads = np.array(np.atleast_2d(loads), float)
    if loads.ndim != 2 or loads.shape[1] != 3 or not np.isfinite(loads).all():
        raise ScenarioError("a load has three finite components (f1, f2, m)")
    dead = np.array(np.broadcast_to(np.asarray(dead_load, float), loads.shape))
    if not np.isfinite(dead).all():
        raise ScenarioError("a dead load has three finite components (t1, t2, m)")
    scale = np.array([1.0, 1.0, 1.0 / law.radius])
    size = np.linalg.norm(loads * scale, axis=1)
    if not np.all(size > 0.0):
        raise ScenarioError("a load of zero has no limit: give it a force or a moment")
    if law.strength <= 0.0:
        if dead.any():
            raise ScenarioError("the joint has no friction, so it cannot carry the tangential dead load")
        return _loads_of(law, np.zeros(len(loads)), loads * scale / size[:, None], loads)
    if dead.any():
        bearing = dead.any(axis=1)
        room = limit_loads(law, dead[bearing]).V
        if np.any(room <= 1.0):
            raise ScenarioError(
                f"the tangential dead load is {1.0 / room.min():.6g} times what the joint can carry: it slips before "
                "any other load is applied; lower the load or raise the friction"
            )
    problem = _Problem(law, loads * scale / size[:, None], dead * scale / law.strength)
    everything = np.arange(len(loads))
    start, smoothings = np.zeros((len(loads), 2)), _SMOOTHING
    if near is not None:
        start, smoothings = problem.start(np.reshape(np.asarray(near, float), loads.shape)), [0.0, *_SMOOTHING]
    if isinstance(law, PointLaw):
        value, q, solved = _solve_points(problem, law, start, smoothings)
    else:
        z, solved = _minimise(problem, start, everything, 0.0)
        value, q = problem.evaluate(z, everything, 0.0)[0], problem.twist(z, everything)
    if not solved.all():
        raise NotConvergedError(f"no limit load was found for {np.count_nonzero(~solved)} of {len(loads)} loads")
    return _loads_of(law, value * law.strength / size, q, loads)


def _loads_of(law: Law, V: np.ndarray, q: np.ndarray, loads: np.ndarray) -> LimitLoads:
    twist = q * np.array([1.0, 1.0, 1.0 / law.radius])
    twist = twist / np.sum(twist * loads, axis=1)[:, None]
    w = twist[:, 2]
    turning = np.abs(w) * law.radius > 1e-9 * np.hypot(twist[:, 0], twist[:, 1])
    safe = np.where(turning, w, 1.0)
    centre = np.where(turning[:, None], np.stack([-twist[:, 1], twist[:, 0]], axis=1) / safe[:, None], np.inf)
    return LimitLoads(V, twist, centre)


def limit_load(
    law: Law, load: ArrayLike, dead_load: ArrayLike = (0.0, 0.0, 0.0), near: ArrayLike | None = None
) -> LimitLoad:
    """Limit multiplier of one load (f1, f2, m) about O on top of a constant tangential ``dead_load`` (t1, t2, m)."""
    many = limit_loads(law, np.reshape(load, (1, -1)), dead_load, near)
    x, y = (float(value) for value in many.torsion_centre[0])
    v1, v2, w = (float(value) for value in many.twist[0])
    return LimitLoad(float(many.V[0]), (v1, v2, w), (x, y) if np.isfinite(x) else None)


def gauge(law: Law, force: ArrayLike) -> np.ndarray:
    """Gauge of tangential forces (k, 3) or (3,) with respect to the law: 1 on the limit surface, 0 for zero force."""
    force = np.asarray(force, float)
    rows = force.reshape(-1, 3)
    result = np.zeros(len(rows))
    acting = rows.any(axis=1)
    if acting.any():
        with np.errstate(divide="ignore"):
            result[acting] = 1.0 / limit_loads(law, rows[acting]).V
    return result.reshape(force.shape[:-1])[()]
