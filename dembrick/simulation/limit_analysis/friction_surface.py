"""The friction of an area joint by its support function: mean slip speed of a polygon, and the gauge of a force.

For a slip twist q = (v1, v2, w) about O the friction of uniform pressure dissipates V_0 D_1(q), where D_1 is the mean
of |v + w x r| over the polygon. A force f = (V_1, V_2, M_T) / V_0 can be carried if q . f <= D_1(q) for every q. The
gauge of f is 1 / min of D_1(q) over q . f = 1, and the q that attains the minimum is the normal of the plane that cuts
f off.

D_1 in closed form: seen from the torsion centre C each edge spans a signed triangle; h is its distance from C, s runs
along it, rho = hypot(h, s). Far from the joint these sums cancel, and the series about pure translation takes their
place (`friction_integrals.far_moments`): without it, cuts near pure translation are wrong by more than what they cut
off. All functions take stacks: k polygons with equally many corners (k, m, 2), twists (k, 3).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dembrick.simulation.limit_analysis.strength import Areas

FAR = 50.0  # gyrations that the torsion centre is away: the series is exact to 1e-14 there, the sums to 1e-12
_TINY = 1e-150
_ITERATIONS, _HALVINGS = 60, 40
_CONVERGED = 1e-14  # of D_1: what half the Newton decrement still promises


class Surfaces:
    """The limit surfaces of some area joints with equally many corners, scaled to V_0 = 1 and lengths in gyrations."""

    def __init__(self, areas: Areas, chosen: np.ndarray):
        counts = np.diff(areas.start)[chosen]
        corner = areas.corner[areas.start[chosen, None] + np.arange(counts[0])]
        gyration = areas.gyration[chosen]
        self._corner = corner / gyration[:, None, None]
        scale = gyration[:, None] ** -np.repeat(np.arange(2, 9), np.arange(3, 10))
        self._far = areas.far[chosen] * scale
        yy, xx, xy = (areas.second[chosen] / (areas.area * areas.gyration**2)[chosen, None]).T
        self._second = xx, yy, xy

    def speed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """D_1 (k,), its gradient (k, 3) and its Hessian (k, 3, 3) at twists (k, 3); far off the Hessian's first
        term."""
        far = np.hypot(q[:, 0], q[:, 1]) > FAR * np.abs(q[:, 2])
        value, gradient, hessian = np.empty(len(q)), np.empty((len(q), 3)), np.empty((len(q), 3, 3))
        for some, evaluate in ((far, self._series), (~far, self._edges)):
            if some.any():
                value[some], gradient[some], hessian[some] = evaluate(q[some], some)
        return value, gradient, hessian

    def _series(self, q: np.ndarray, some: np.ndarray):
        size = np.hypot(q[:, 0], q[:, 1])
        d1, d2 = q[:, 0] / size, q[:, 1] / size
        e = q[:, 2] / size
        total, in_e, in_d, at = np.ones_like(size), np.zeros_like(size), np.zeros((len(q), 2)), 0
        for n in range(2, 9):  # J_n = sum of c_k d1^(n-k) d2^k
            c = self._far[some, at : at + n + 1]
            at += n + 1
            powers = [d1 ** (n - k) * d2**k for k in range(n + 1)]
            form = sum(c[:, k] * powers[k] for k in range(n + 1))
            first = sum((n - k) * c[:, k] * d1 ** (n - k - 1) * d2**k for k in range(n))
            second = sum(k * c[:, k] * d1 ** (n - k) * d2 ** (k - 1) for k in range(1, n + 1))
            total = total + e**n * form
            in_e = in_e + n * e ** (n - 1) * form
            in_d = in_d + (e**n)[:, None] * np.stack([first, second], axis=1)
        # D_1 = |v| F(d, e), e = w / |v|: the change of d is across d
        d = np.stack([d1, d2], axis=1)
        gradient = np.empty((len(q), 3))
        gradient[:, :2] = (total - e * in_e)[:, None] * d + in_d - (in_d * d).sum(axis=1)[:, None] * d
        gradient[:, 2] = in_e
        xx, yy, xy = (moment[some] for moment in self._second)
        hessian = np.zeros((len(q), 3, 3))
        across = np.stack([-d2, d1], axis=1)
        hessian[:, :2, :2] = across[:, :, None] * across[:, None, :]
        hessian[:, 2, 2] = d1 * d1 * xx + 2.0 * d1 * d2 * xy + d2 * d2 * yy
        return size * total, gradient, hessian / size[:, None, None]

    def _edges(self, q: np.ndarray, some: np.ndarray):
        start = self._corner[some]
        edge = np.roll(start, -1, axis=1) - start
        length = np.sqrt((edge**2).sum(axis=2))
        t = edge / length[..., None]
        n = np.stack([t[..., 1], -t[..., 0]], axis=2)
        area = 0.5 * (start[..., 0] * edge[..., 1] - start[..., 1] * edge[..., 0]).sum(axis=1)
        w = q[:, 2]
        centre = np.stack([-q[:, 1], q[:, 0]], axis=1) / w[:, None]
        away = start - centre[:, None]
        h, s0 = (away * n).sum(axis=2), (away * t).sum(axis=2)
        s1 = s0 + length
        r0, r1 = np.hypot(h, s0), np.hypot(h, s1)
        on_line = np.abs(h) < _TINY
        lever = np.where(on_line, 1.0, np.abs(h))
        asinh = np.where(on_line, 0.0, np.arcsinh(s1 / lever) - np.arcsinh(s0 / lever))
        i0 = 0.5 * (s1 * r1 - s0 * r0 + h * h * asinh)  # integral of rho along the edge
        moment = (h * i0).sum(axis=1) / (3.0 * area)
        push = (i0[..., None] * n).sum(axis=1) / area[:, None]
        sign = np.sign(w)
        gradient = np.empty((len(q), 3))
        gradient[:, 0], gradient[:, 1] = -sign * push[:, 1], sign * push[:, 0]
        gradient[:, 2] = sign * moment + centre[:, 0] * gradient[:, 1] - centre[:, 1] * gradient[:, 0]
        inverse0 = np.divide(1.0, r0, out=np.zeros_like(r0), where=r0 > _TINY)
        inverse1 = np.divide(1.0, r1, out=np.zeros_like(r1), where=r1 > _TINY)
        cc = s1 * inverse1 - s0 * inverse0  # integrals of h^2 / rho^3, h s / rho^3 and s^2 / rho^3
        cs = -h * (inverse1 - inverse0)
        nn, nt, tt = h * cc, h * cs, h * (asinh - cc)
        block = np.einsum("ke,kei,kej->kij", nn, n, n) + np.einsum("ke,kei,kej->kij", tt, t, t)
        mixed = np.einsum("ke,kei,kej->kij", nt, n, t)
        block += mixed + mixed.transpose(0, 2, 1)
        block /= (np.abs(w) * area)[:, None, None]
        carry = np.zeros((len(q), 2, 3))
        carry[:, 0, 0] = carry[:, 1, 1] = 1.0
        carry[:, 0, 2], carry[:, 1, 2] = -centre[:, 1], centre[:, 0]
        return np.abs(w) * moment, gradient, carry.transpose(0, 2, 1) @ block @ carry

    def cut(self, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The gauge (k,) of forces (k, 3) = (V_1, V_2, M_T / gyration) / V_0, and the twists (k, 3), scaled to
        D_1 = 1, that attain it: guarded Newton steps on the plane q . f = 1."""
        size = np.linalg.norm(force, axis=1)
        f = force / size[:, None]
        helper = np.eye(3)[np.argmin(np.abs(f), axis=1)]
        first = np.cross(f, helper)
        first /= np.linalg.norm(first, axis=1)[:, None]
        basis = np.stack([first, np.cross(f, first)], axis=2)
        z = np.zeros((len(f), 2))  # q = f: the normal of the ellipsoid around the surface
        live = np.arange(len(f))
        value, gradient, hessian = self._on_plane(f, basis, z, live)
        for _ in range(_ITERATIONS):
            step, decrement = _newton(gradient, hessian)
            going = decrement > _CONVERGED * value
            live, value, gradient, hessian = live[going], value[going], gradient[going], hessian[going]
            step, decrement = step[going], decrement[going]
            if not len(live):
                break
            length, waiting = np.ones(len(live)), np.arange(len(live))
            for _ in range(_HALVINGS):
                at = live[waiting]
                tried = z[at] + length[waiting, None] * step[waiting]
                new = self._on_plane(f[at], basis[at], tried, at)
                good = new[0] < value[waiting] - 1e-4 * length[waiting] * decrement[waiting]
                taken = waiting[good]
                z[live[taken]] = tried[good]
                value[taken], gradient[taken], hessian[taken] = (part[good] for part in new)
                waiting = waiting[~good]
                if not len(waiting):
                    break
                length[waiting] *= 0.5
            keep = np.ones(len(live), bool)
            keep[waiting] = False  # nothing left to gain but rounding
            live, value, gradient, hessian = live[keep], value[keep], gradient[keep], hessian[keep]
        q = f + np.einsum("kij,kj->ki", basis, z)
        least = self.speed(q)[0]
        return size / least, q / least[:, None]

    def _on_plane(self, f, basis, z, at):
        q = f + np.einsum("kij,kj->ki", basis, z)
        value, gradient, hessian = self._of(at).speed(q)
        back = basis.transpose(0, 2, 1)
        return value, np.einsum("kij,kj->ki", back, gradient), back @ hessian @ basis

    def _of(self, at: np.ndarray) -> Surfaces:
        """Some of them."""
        if len(at) == len(self._corner):
            return self
        some = object.__new__(Surfaces)
        some._corner, some._far = self._corner[at], self._far[at]
        some._second = tuple(moment[at] for moment in self._second)
        return some


def by_corners(areas: Areas, chosen: np.ndarray) -> Iterator[tuple[np.ndarray, Surfaces]]:
    """The ``chosen`` area joints with equally many corners: places in ``chosen``, and their surfaces."""
    counts = np.diff(areas.start)[chosen]
    for count in np.unique(counts):
        places = np.flatnonzero(counts == count)
        yield places, Surfaces(areas, chosen[places])


def gauges(areas: Areas, chosen: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gauges (k,) of forces (k, 3) = (V_1, V_2, M_T / gyration) / V_0 in the ``chosen`` joints (k,), and the twists
    (k, 3) of D_1 = 1 that attain them. No force has the gauge 0."""
    gauge, twist = np.zeros(len(chosen)), np.zeros((len(chosen), 3))
    acting = np.flatnonzero(np.linalg.norm(force, axis=1) > 0.0)
    for places, surfaces in by_corners(areas, chosen[acting]):
        own = acting[places]
        gauge[own], twist[own] = surfaces.cut(force[own])
    return gauge, twist


def _newton(gradient: np.ndarray, hessian: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton steps (k, 2) and decrements (k,), regularised where a Hessian (k, 2, 2) is singular."""
    trace = hessian[:, 0, 0] + hessian[:, 1, 1] + _TINY
    a, c, b = hessian[:, 0, 0] + 1e-14 * trace, hessian[:, 1, 1] + 1e-14 * trace, hessian[:, 0, 1]
    det = np.maximum(a * c - b * b, 1e-14 * a * c) + _TINY
    step = np.stack([b * gradient[:, 1] - c * gradient[:, 0], b * gradient[:, 0] - a * gradient[:, 1]], axis=1)
    step /= det[:, None]
    return step, -(step * gradient).sum(axis=1)
