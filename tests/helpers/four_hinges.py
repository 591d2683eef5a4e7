"""A circular arch as a mechanism of three rigid links on four hinges: one degree of freedom, its exact finite motion.

The hinges are those of the lowest horizontal load factor. The centroids z (complex: x in the direction of the push, y
up) and rotations t of the stones are functions of the rotation q of the first link; ' is d/dq. Lagrange's equation is

    sum(m |z'|^2 + J t'^2) q.. + sum(m |z'|^2 + J t'^2)' q.^2 / 2 = sum(m (f . z'))

where f is the acceleration that gravity and the accelerated base give every stone (Oppenheim 1992).
"""

from __future__ import annotations

import itertools
import math

import numpy as np


class FourHinges:
    """An arch of ring segments: mean ``radius`` and ``thickness`` (m), angle of embrace (deg), pushed along +x."""

    def __init__(self, radius, thickness, voussoirs, embrace):
        inner, outer = radius - 0.5 * thickness, radius + 0.5 * thickness
        stone = math.radians(embrace) / voussoirs
        self.angle = 0.5 * math.pi + stone * (0.5 * voussoirs - np.arange(voussoirs + 1))
        self.mass = np.full(voussoirs, 0.5 * stone * (outer**2 - inner**2))  # for unit density and depth
        lever = 4.0 / 3.0 * math.sin(0.5 * stone) / stone * (outer**3 - inner**3) / (outer**2 - inner**2)
        self.centroid = lever * np.exp(0.5j * (self.angle[1:] + self.angle[:-1]))
        self.second = 0.25 * stone * (outer**4 - inner**4) - self.mass * lever**2
        found = []
        for joints in itertools.combinations(range(voussoirs + 1), 4):
            for edges in ((inner, outer, inner, outer), (outer, inner, outer, inner)):
                self.joints, self.hinge = joints, np.array(edges) * np.exp(1j * self.angle[list(joints)])
                factor = self._load_factor(np.array(edges) == outer)
                found.append((factor, joints, self.hinge))
        self.load_factor, self.joints, self.hinge = min(found, key=lambda one: one[0])
        self.way = 1.0 if self.slopes(0.0)[0].real @ self.mass > 0.0 else -1.0

    def _links(self):
        return (slice(*self.joints[k : k + 2]) for k in range(3))

    def _load_factor(self, outside):
        """By virtual work; infinite if no such mechanism opens its joints away from the hinges."""
        h = self.hinge
        arms = np.array([h[2] - h[1], h[3] - h[2]])
        system = np.array([arms.real, arms.imag])
        if abs(np.linalg.det(system)) < 1e-9:
            return math.inf
        second, third = np.linalg.solve(system, [(h[0] - h[1]).real, (h[0] - h[1]).imag])
        turns, velocity = (1.0, second, third), np.zeros(len(self.mass), complex)
        ends = (0.0, 1j * (h[1] - h[0]), 0.0)
        for link, turn, end, hinge in zip(self._links(), turns, ends, (h[0], h[1], h[3]), strict=True):
            velocity[link] = end + 1j * turn * (self.centroid[link] - hinge)
        along, up = velocity.real @ self.mass, velocity.imag @ self.mass
        opening = math.copysign(1.0, along) * np.diff([0.0, *turns, 0.0])
        return up / along if up / along > 0.0 and ((opening > 0.0) == outside).all() else math.inf

    def place(self, q):
        """Centroids (n,) and rotations (n,) of the stones when the first link has turned by q."""
        h, (first, second, third) = self.hinge, self._links()
        one = h[0] + (h[1] - h[0]) * np.exp(1j * q)
        rest = h[3] - one
        a, b, c = abs(h[2] - h[1]), abs(h[3] - h[2]), abs(rest)
        along = (a * a - b * b + c * c) / (2.0 * c)
        side = 1j * math.sqrt(a * a - along * along)
        two = min((one + rest / c * (along + s * side) for s in (1.0, -1.0)), key=lambda z: abs(z - h[2]))
        z, t = self.centroid.copy(), np.zeros(len(self.mass))  # stones outside the hinges stay
        turns = q, np.angle((two - one) / (h[2] - h[1])), np.angle((two - h[3]) / (h[2] - h[3]))
        rows = zip((first, second, third), turns, (h[0], h[1], h[3]), (h[0], one, h[3]), strict=True)
        for link, turn, before, now in rows:
            z[link], t[link] = now + (self.centroid[link] - before) * np.exp(1j * turn), turn
        return z, t

    def slopes(self, q, step=1e-5):
        """z' and t'."""
        (z1, t1), (z0, t0) = self.place(q + step), self.place(q - step)
        return (z1 - z0) / (2.0 * step), (t1 - t0) / (2.0 * step)

    def acceleration(self, q, rate, f, step=1e-4):
        """q.. under the acceleration ``f`` (complex, m/s2) of every moving stone."""

        def inertia(q):
            z, t = self.slopes(q)
            return float(self.mass @ abs(z) ** 2 + self.second @ t**2)

        z, _ = self.slopes(q)
        power = float(self.mass @ (f.real * z.real + f.imag * z.imag))
        return (power - 0.25 * (inertia(q + step) - inertia(q - step)) / step * rate**2) / inertia(q)

    def turns(self, f, times, most=0.1):
        """q at the ``times`` under f(t), 0 until the hinges open; by Runge-Kutta. Integration ends when q exceeds
        ``most`` or the hinges close; later values are NaN."""
        found = np.full(len(times), np.nan)
        state = np.zeros(2)
        for k, now in enumerate(times):
            found[k] = state[0]
            if k + 1 == len(times) or abs(state[0]) > most or self.way * state[0] < 0.0:
                break
            then = times[k + 1]
            if not state.any() and self.way * self.acceleration(0.0, 0.0, f(now)) <= 0.0:
                continue

            def change(y, t):
                return np.array([y[1], self.acceleration(y[0], y[1], f(t))])

            dt, half = then - now, 0.5 * (now + then)
            k1 = change(state, now)
            k2 = change(state + 0.5 * dt * k1, half)
            k3 = change(state + 0.5 * dt * k2, half)
            k4 = change(state + dt * k3, then)
            state = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return found
