"""Reference for speed: a plain explicit loop for one block on four corner springs, with nothing else in it.

It replays set 4a for the concave joint (paper eq. 3): four corner points with normal and shear springs and Coulomb
friction, the block with six degrees of freedom (translation and rotation vector, taken at the centroid of the joint),
central difference, a jack spring whose head moves at a constant rate. No record, no bracket, no stopping criterion, no
other joint or formulation, no input file. Its cost per step is that of the physics; the package adds the cost of
everything else, so the ratio of the two is the number to judge.

Inertia is artificial and diagonal, so that all modes have the same frequency, and springs have dashpots that act before
the friction limit, as in the package. The loop has no estimate of its error. The search below therefore uses theory: it
tries travels and numbers of steps and keeps the shortest replay that, like all slower ones, ends within the error. Its
times are thus the best that such a loop could reach with perfectly chosen settings.

    python tools/plain_loop.py
"""

from __future__ import annotations

import math
import time

import numba
import numpy as np

A, B = 0.3, 0.2  # m, joint a x b
N, MU = 467.0, 0.64  # N, friction
E = 0.25 * A  # m, eccentricity of the jack along a
KN, KS = 1.0e10 * A * B / 4, 4.0e9 * A * B / 4  # N/m of one corner
JACK = 4 * KS  # N/m
CORNERS = np.array([[-A / 2, -B / 2], [A / 2, -B / 2], [A / 2, B / 2], [-A / 2, B / 2]])
ETA = 0.8  # frequency of every mode times the time step; the jack and the dashpots lower the stable limit from 2
VISCOUS = 0.5  # dashpot force over spring force for the same increment
SLIP = MU * N / (4 * KS)  # m, elastic slip of the joint in pure shear
TRAVELS = (2, 3, 4, 6, 8, 12, 20, 40, 80)  # elastic slips of the jack head
STEPS = tuple(round(10 * 2 ** (i / 2)) for i in range(21))  # 10 to 10,240


@numba.njit(error_model="numpy")
def replay(n_steps, travel, corners, kn, ks, jack, mu, normal, e, inverse, viscous):
    """Move the jack head over ``travel`` (m) in ``n_steps`` steps of unit time; returns the jack force (N)."""
    ux = uy = rx = ry = rz = vx = vy = vz = wx = wy = wz = 0.0
    uz = -normal / (4.0 * kn)
    fx, fy = np.zeros(4), np.zeros(4)  # elastic shear forces on the block
    head, force = 0.0, 0.0
    for _ in range(n_steps):
        head += travel / n_steps
        force = jack * (head - (uy + e * rz)) + viscous * jack * (travel / n_steps - (vy + e * wz))
        Fx, Fy, Fz, Mx, My, Mz = 0.0, force, -normal, 0.0, 0.0, e * force
        for c in range(4):
            x, y = corners[c, 0], corners[c, 1]
            press = -kn * (uz + rx * y - ry * x)
            if press <= 0.0:
                fx[c] = fy[c] = 0.0
                continue
            limit = mu * press
            dx, dy = -ks * (vx - wz * y), -ks * (vy + wz * x)
            ex, ey = fx[c] + dx, fy[c] + dy
            size = math.sqrt(ex * ex + ey * ey)
            if size > limit:
                ex, ey = ex * limit / size, ey * limit / size
            fx[c], fy[c] = ex, ey
            tx, ty = ex + viscous * dx, ey + viscous * dy
            size = math.sqrt(tx * tx + ty * ty)
            if size > limit:
                tx, ty = tx * limit / size, ty * limit / size
            press -= viscous * kn * (vz + wx * y - wy * x)
            Fx, Fy, Fz = Fx + tx, Fy + ty, Fz + press
            Mx, My, Mz = Mx + y * press, My - x * press, Mz + x * ty - y * tx
        vx, vy, vz = vx + inverse[0] * Fx, vy + inverse[1] * Fy, vz + inverse[2] * Fz
        wx, wy, wz = wx + inverse[3] * Mx, wy + inverse[4] * My, wz + inverse[5] * Mz
        ux, uy, uz = ux + vx, uy + vy, uz + vz
        rx, ry, rz = rx + wx, ry + wy, rz + wz
    return force


def inverse_inertia() -> np.ndarray:
    """(6,) inverse of the artificial inertia, ETA^2 over the stiffness of each degree of freedom; unit time step."""
    x2, y2 = A * A / 4, B * B / 4
    stiffness = 4 * np.array([KS, KS, KN, KN * y2, KN * x2, KS * (x2 + y2)])
    return ETA**2 / stiffness


def theory() -> float:
    """Limit load (N): the block turns about that (c, 0) for which the moment of the four friction forces is e times
    their sum."""

    def forces(c: float) -> tuple[float, float]:
        r = np.hypot(CORNERS[:, 0] - c, CORNERS[:, 1])
        v = MU * N / 4 * ((CORNERS[:, 0] - c) / r).sum()
        return v, MU * N / 4 * ((CORNERS[:, 0] * (CORNERS[:, 0] - c) + CORNERS[:, 1] ** 2) / r).sum()

    low, high = -100.0 * A, 0.0
    for _ in range(200):
        c = 0.5 * (low + high)
        v, moment = forces(c)
        low, high = (c, high) if moment < E * v else (low, c)
    return v if abs(moment - E * v) < 1e-9 * moment else math.nan


def run(n_steps: int, slips: float) -> float:
    """V (N) after a travel of ``slips`` elastic slips."""
    return replay(n_steps, slips * SLIP, CORNERS, KN, KS, JACK, MU, N, E, inverse_inertia(), VISCOUS)


def steps_needed(error: float) -> tuple[int, float] | None:
    """Fewest steps, and their travel in elastic slips, that give V within ``error`` as all slower replays do."""
    exact, best = theory(), None
    for slips in TRAVELS:
        good = [abs(run(n, slips) / exact - 1.0) <= error for n in STEPS]
        first = next((i for i in range(len(STEPS)) if all(good[i:])), None)
        if first is not None and (best is None or STEPS[first] < best[0]):
            best = (STEPS[first], slips)
    return best


def seconds(n_steps: int, slips: float, repeats: int = 50) -> float:
    """Best time of one replay (s)."""
    arguments = (n_steps, slips * SLIP, CORNERS, KN, KS, JACK, MU, N, E, inverse_inertia(), VISCOUS)
    best = math.inf
    for _ in range(repeats):
        began = time.perf_counter()
        replay(*arguments)
        best = min(best, time.perf_counter() - began)
    return best


def step_nanoseconds() -> float:
    """Time (ns) of one step in a replay that slips most of the time."""
    return 1e9 * seconds(100_000, 320, repeats=10) / 100_000


def main() -> None:
    """Print the cost per step, and the steps and time needed for given errors."""
    run(1, 1.0)
    print(f"plain four-point loop, set 4a, V = {theory():.6f} N by theory")
    print(f"{step_nanoseconds():.1f} ns a joint and step")
    print(f"{'error':>8}{'steps':>8}{'slips':>7}{'time, us':>10}")
    for error in (1e-2, 1e-3, 1e-4, 1e-5):
        found = steps_needed(error)
        if found is None:
            print(f"{error:8.0e}{'-':>8}  not with {STEPS[-1]} steps at constant rate")
        else:
            print(f"{error:8.0e}{found[0]:8}{found[1]:7}{1e6 * seconds(*found):10.1f}")


if __name__ == "__main__":
    main()
