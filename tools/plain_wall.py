"""Reference for the speed of assemblies: a plain explicit loop for a wall with four-point joints and nothing else.

A running-bond wall under gravity: every joint has four contact points with a normal spring, a shear spring and Coulomb
friction; blocks have six degrees of freedom with quaternions and angular momentum; forces are added to the blocks joint
by joint. One formulation, one constant polygon per joint, no loads but gravity, no record, no damping except in the
contacts, no guards. Its cost per joint and step is that of the physics; the package adds the cost of everything else,
so the ratio of the two is the number to judge.

    python tools/plain_wall.py [courses]
"""

from __future__ import annotations

import sys
import time

import numba
import numpy as np


@numba.njit(error_model="numpy")
def run(n_steps, dt, x, q, v, w, mass, inertia, free, a, b, normal, tangent, lever, corner, stiffness, mu, g, elastic):
    """Advance ``n_steps``; all arrays are changed in place. SI units.

    x (n, 3), q (n, 4), v (n, 3), w (n, 3) of the blocks; ``inertia`` (n, 3) principal. Joints: ``normal`` and
    ``tangent`` (j, 3) in the axes of a, ``lever`` (j, 3) of the joint's plane on a, ``corner`` (j, 4, 3) in the axes
    of b, ``stiffness`` (j, 2) of one point, ``elastic`` (j, 4, 2).
    """
    n = x.shape[0]
    R = np.empty((n, 3, 3))
    force = np.empty((n, 3))
    torque = np.empty((n, 3))
    for _ in range(n_steps):
        for i in range(n):
            s, p, r, t = q[i]
            R[i, 0, 0] = 1 - 2 * (r * r + t * t)
            R[i, 0, 1] = 2 * (p * r - s * t)
            R[i, 0, 2] = 2 * (p * t + s * r)
            R[i, 1, 0] = 2 * (p * r + s * t)
            R[i, 1, 1] = 1 - 2 * (p * p + t * t)
            R[i, 1, 2] = 2 * (r * t - s * p)
            R[i, 2, 0] = 2 * (p * t - s * r)
            R[i, 2, 1] = 2 * (r * t + s * p)
            R[i, 2, 2] = 1 - 2 * (p * p + r * r)
            force[i, 0] = force[i, 1] = 0.0
            force[i, 2] = -mass[i] * g
            torque[i, 0] = torque[i, 1] = torque[i, 2] = 0.0
        for j in range(a.size):
            A = a[j]
            B = b[j]
            RA = R[A]
            RB = R[B]
            n0 = RA[0, 0] * normal[j, 0] + RA[0, 1] * normal[j, 1] + RA[0, 2] * normal[j, 2]
            n1 = RA[1, 0] * normal[j, 0] + RA[1, 1] * normal[j, 1] + RA[1, 2] * normal[j, 2]
            n2 = RA[2, 0] * normal[j, 0] + RA[2, 1] * normal[j, 1] + RA[2, 2] * normal[j, 2]
            t0 = RA[0, 0] * tangent[j, 0] + RA[0, 1] * tangent[j, 1] + RA[0, 2] * tangent[j, 2]
            t1 = RA[1, 0] * tangent[j, 0] + RA[1, 1] * tangent[j, 1] + RA[1, 2] * tangent[j, 2]
            t2 = RA[2, 0] * tangent[j, 0] + RA[2, 1] * tangent[j, 1] + RA[2, 2] * tangent[j, 2]
            z0 = n1 * t2 - n2 * t1
            z1 = n2 * t0 - n0 * t2
            z2 = n0 * t1 - n1 * t0
            d0 = x[B, 0] - x[A, 0]
            d1 = x[B, 1] - x[A, 1]
            d2 = x[B, 2] - x[A, 2]
            plane = normal[j, 0] * lever[j, 0] + normal[j, 1] * lever[j, 1] + normal[j, 2] * lever[j, 2]
            kn = stiffness[j, 0]
            ks = stiffness[j, 1]
            F0 = F1 = F2 = TA0 = TA1 = TA2 = TB0 = TB1 = TB2 = 0.0
            for i in range(4):
                c = corner[j, i]
                r0 = RB[0, 0] * c[0] + RB[0, 1] * c[1] + RB[0, 2] * c[2]
                r1 = RB[1, 0] * c[0] + RB[1, 1] * c[1] + RB[1, 2] * c[2]
                r2 = RB[2, 0] * c[0] + RB[2, 1] * c[1] + RB[2, 2] * c[2]
                s0 = r0 + d0
                s1 = r1 + d1
                s2 = r2 + d2
                gap = s0 * n0 + s1 * n1 + s2 * n2 - plane
                if gap >= 0.0:
                    elastic[j, i, 0] = elastic[j, i, 1] = 0.0
                    continue
                u0 = v[B, 0] - v[A, 0] + w[B, 1] * r2 - w[B, 2] * r1 - w[A, 1] * s2 + w[A, 2] * s1
                u1 = v[B, 1] - v[A, 1] + w[B, 2] * r0 - w[B, 0] * r2 - w[A, 2] * s0 + w[A, 0] * s2
                u2 = v[B, 2] - v[A, 2] + w[B, 0] * r1 - w[B, 1] * r0 - w[A, 0] * s1 + w[A, 1] * s0
                N = max(-kn * (gap + 0.3 * dt * (u0 * n0 + u1 * n1 + u2 * n2)), 0.0)
                p = elastic[j, i, 0] + ks * dt * (u0 * t0 + u1 * t1 + u2 * t2)
                o = elastic[j, i, 1] + ks * dt * (u0 * z0 + u1 * z1 + u2 * z2)
                size2 = p * p + o * o
                if size2 > mu * mu * N * N:
                    scale = mu * N / np.sqrt(size2)
                    p *= scale
                    o *= scale
                elastic[j, i, 0] = p
                elastic[j, i, 1] = o
                f0 = N * n0 - p * t0 - o * z0
                f1 = N * n1 - p * t1 - o * z1
                f2 = N * n2 - p * t2 - o * z2
                F0 += f0
                F1 += f1
                F2 += f2
                TB0 += r1 * f2 - r2 * f1
                TB1 += r2 * f0 - r0 * f2
                TB2 += r0 * f1 - r1 * f0
                TA0 += s1 * f2 - s2 * f1
                TA1 += s2 * f0 - s0 * f2
                TA2 += s0 * f1 - s1 * f0
            force[A, 0] -= F0
            force[A, 1] -= F1
            force[A, 2] -= F2
            force[B, 0] += F0
            force[B, 1] += F1
            force[B, 2] += F2
            torque[A, 0] -= TA0
            torque[A, 1] -= TA1
            torque[A, 2] -= TA2
            torque[B, 0] += TB0
            torque[B, 1] += TB1
            torque[B, 2] += TB2
        for i in range(n):
            if not free[i]:
                continue
            for k in range(3):
                v[i, k] += dt * force[i, k] / mass[i]
                x[i, k] += dt * v[i, k]
            M = R[i]
            l0 = M[0, 0] * w[i, 0] + M[1, 0] * w[i, 1] + M[2, 0] * w[i, 2]
            l1 = M[0, 1] * w[i, 0] + M[1, 1] * w[i, 1] + M[2, 1] * w[i, 2]
            l2 = M[0, 2] * w[i, 0] + M[1, 2] * w[i, 1] + M[2, 2] * w[i, 2]
            m0 = M[0, 0] * torque[i, 0] + M[1, 0] * torque[i, 1] + M[2, 0] * torque[i, 2]
            m1 = M[0, 1] * torque[i, 0] + M[1, 1] * torque[i, 1] + M[2, 1] * torque[i, 2]
            m2 = M[0, 2] * torque[i, 0] + M[1, 2] * torque[i, 1] + M[2, 2] * torque[i, 2]
            I0 = inertia[i, 0]
            I1 = inertia[i, 1]
            I2 = inertia[i, 2]
            k0 = l0 + dt * (m0 - (I2 - I1) * l1 * l2) / I0
            k1 = l1 + dt * (m1 - (I0 - I2) * l2 * l0) / I1
            k2 = l2 + dt * (m2 - (I1 - I0) * l0 * l1) / I2
            w[i, 0] = M[0, 0] * k0 + M[0, 1] * k1 + M[0, 2] * k2
            w[i, 1] = M[1, 0] * k0 + M[1, 1] * k1 + M[1, 2] * k2
            w[i, 2] = M[2, 0] * k0 + M[2, 1] * k1 + M[2, 2] * k2
            h0 = 0.5 * dt * k0
            h1 = 0.5 * dt * k1
            h2 = 0.5 * dt * k2
            s, p, r, t = q[i]
            e0 = s - p * h0 - r * h1 - t * h2
            e1 = p + s * h0 + r * h2 - t * h1
            e2 = r + s * h1 - p * h2 + t * h0
            e3 = t + s * h2 + p * h1 - r * h0
            scale = 1.0 / np.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
            q[i, 0] = e0 * scale
            q[i, 1] = e1 * scale
            q[i, 2] = e2 * scale
            q[i, 3] = e3 * scale


def wall(
    courses: int, columns: int | None = None, k_n: float = 1.0e10, k_s: float = 4.0e9, density: float = 2000.0,
    mu: float = 0.64,
):  # fmt: skip
    """Arguments of `run` after the time step for a straight running-bond wall on a base: 0.3 x 0.2 x 0.1 m blocks,
    ``columns`` of them per course (by default as many as there are courses)."""
    columns = columns or courses
    length, depth, height = 0.3, 0.2, 0.1
    span = [[(0.0, columns * length)]]  # the base, one long block
    for c in range(courses):
        cuts = [i * length for i in range(columns + 1)]
        if c % 2:
            cuts = [0.0, *(cut + length / 2 for cut in cuts[:-1]), columns * length]
        span.append(list(zip(cuts[:-1], cuts[1:], strict=True)))
    blocks = [(i, *edges) for i, row in enumerate(span) for edges in row]
    first = np.cumsum([0] + [len(row) for row in span])
    size = np.array([[right - left, depth, height] for _, left, right in blocks])
    x = np.array([[(left + right) / 2, 0.0, (i - 0.5) * height] for i, left, right in blocks])
    mass = density * size.prod(axis=1)
    inertia = mass[:, None] / 12 * np.stack([(size[:, [1, 2]] ** 2).sum(1), (size[:, [0, 2]] ** 2).sum(1),
                                             (size[:, [0, 1]] ** 2).sum(1)], axis=1)  # fmt: skip
    joints = []  # a, b, normal, tangent, corners in the world
    for i in range(courses):
        for m, (l0, r0) in enumerate(span[i]):
            for k, (l1, r1) in enumerate(span[i + 1]):
                left, right = max(l0, l1), min(r0, r1)
                if right - left > 1e-9:
                    z, y = i * height, depth / 2
                    corners = [(left, -y, z), (right, -y, z), (right, y, z), (left, y, z)]
                    joints.append((first[i] + m, first[i + 1] + k, (0, 0, 1), (1, 0, 0), corners))
        z0, z1, y = i * height, (i + 1) * height, depth / 2
        for k in range(len(span[i + 1]) - 1):
            cut = span[i + 1][k][1]
            corners = [(cut, -y, z0), (cut, y, z0), (cut, y, z1), (cut, -y, z1)]
            joints.append((first[i + 1] + k, first[i + 1] + k + 1, (1, 0, 0), (0, 1, 0), corners))
    a = np.array([joint[0] for joint in joints])
    b = np.array([joint[1] for joint in joints])
    corners = np.array([joint[4] for joint in joints], float)
    edges = corners[:, [1, 3]] - corners[:, :1]
    area = np.sqrt((edges**2).sum(2)).prod(1)
    lever = corners.mean(axis=1) - x[a]
    n = len(blocks)
    free = np.ones(n, bool)
    free[0] = False
    q = np.zeros((n, 4))
    q[:, 0] = 1.0
    stiffness = np.stack([k_n * area / 4, k_s * area / 4], axis=1)
    normal, tangent = (np.array([joint[i] for joint in joints], float) for i in (2, 3))
    return (
        x, q, np.zeros((n, 3)), np.zeros((n, 3)), mass, inertia, free, a, b, normal, tangent, lever,
        corners - x[b][:, None], stiffness, mu, 9.81, np.zeros((len(a), 4, 2)),
    )  # fmt: skip


def sunk(z: np.ndarray, courses: int, k_n: float = 1.0e10, density: float = 2000.0) -> np.ndarray:
    """Settlement (m) of blocks with centroids at heights ``z`` (m) until the wall carries its weight."""
    height = 0.1
    course = np.round(z / height - 0.5)  # -1 is the base
    return density * 9.81 * height / k_n * (course + 1.0) * (courses - 0.5 * course)


def at_rest(courses: int, columns: int | None = None):
    """`wall` in equilibrium under its own weight, since open contacts would be cheap."""
    arguments = wall(courses, columns)
    arguments[0][:, 2] -= sunk(arguments[0][:, 2], courses)
    return arguments


def nanoseconds(arguments, n_steps: int = 200, dt: float = 3e-5) -> float:
    """Processor time (ns) per joint and step in one call."""
    began = time.thread_time()
    run(n_steps, dt, *arguments)
    return 1e9 * (time.thread_time() - began) / n_steps / len(arguments[7])


def main() -> None:
    """Print the cost per joint and step."""
    courses = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    arguments = at_rest(courses)
    best = min(nanoseconds(arguments) for _ in range(20))
    print(f"plain wall, {len(arguments[4])} blocks, {len(arguments[7])} joints: {best:.1f} ns a joint and step")


if __name__ == "__main__":
    main()
