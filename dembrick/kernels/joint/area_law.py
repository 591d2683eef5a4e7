"""The law of a convex joint: the no-tension integral over its polygon, and the exact torsion-shear limit surface.

Both engines call `area_pressure` and `area_friction` once a joint and step; new contacts call `area_friction`. Shear
quantities are (V_1, V_2, M_T) about O in the axes of the polygon, in the sense of the action on block b (in dynamics
the host), which is also the direction in which it slips.

- Normal: k_n times the integral of <g + viscous d'>+, zero if g is nowhere positive; d' follows the rule of
  `onset.dashpot_growth` if no part of the joint was in contact a step ago.
- Shear and torsion: springs k_s A and k_s J with dashpots in parallel, behind a slider whose strength is the limit
  surface times mu N; beyond it the trial force returns by the proximal map.
- Memory: the elastic (V_1, V_2, M_T). An open joint carries nothing and remembers nothing, as in `point_law`.
- `slip` is the irreversible part of the shear displacement, as a path length averaged over what presses: the plastic
  work t.q over the strength, that is D(q) of the plastic twist q. For points it is the same mean of theirs.
"""

from math import sqrt

from dembrick._jit import jit
from dembrick.kernels.joint.limit_surface import PROXIMAL_TOLERANCE, chord, proximal_map
from dembrick.kernels.joint.no_tension import extremes, no_tension
from dembrick.kernels.joint.pressure import follow_pressure


@jit
def closed_pressure(area, second, g0, gx, gy):
    """Integrals of g, x g and y g over a polygon about its centroid; ``second``: of y^2, x^2 and x y."""
    return area * g0, second[1] * gx + second[2] * gy, second[2] * gx + second[0] * gy


@jit
def spring_pressure(x, y, first, last, area, second, reach, g0, gx, gy):
    """Integrals of <g>+, x <g>+ and y <g>+ over a polygon about its centroid; ``reach`` of its farthest corner."""
    if g0 < reach * sqrt(gx * gx + gy * gy):
        least, most = extremes(x, y, first, last, g0, gx, gy)
        if least < 0.0:
            return no_tension(x, y, first, last, least, g0, gx, gy)
    return closed_pressure(area, second, g0, gx, gy)


@jit
def area_pressure(x, y, first, last, area, second, reach, viscous, g0, gx, gy, d0, dx, dy):
    """Integrals (3) over the polygon of <h>+, x <h>+ and y <h>+, and h = h0 + hx x + hy y itself (3).

    h is the penetration g = g0 + gx x + gy y plus ``viscous`` times what it grew by in the step, d = d0 + dx x + dy y.
    All integrals are zero if g is nowhere positive.
    """
    h0 = g0 + viscous * d0
    hx = gx + viscous * dx
    hy = gy + viscous * dy
    # h and g positive on the circle around the polygon, and contact at O a step ago: no corner needs to be looked at
    if min(h0 - reach * sqrt(hx * hx + hy * hy), g0, g0 - d0) <= 0.0:
        least, most, before = 1e300, -1e300, -1e300
        for i in range(first, last):
            g = g0 + gx * x[i] + gy * y[i]
            d = d0 + dx * x[i] + dy * y[i]
            least = min(least, g + viscous * d)
            most = max(most, g)
            before = max(before, g - d)
        if most <= 0.0:
            return 0.0, 0.0, 0.0, h0, hx, hy
        if before <= 0.0:  # contact began in the step: see `onset`
            h0 = g0 + viscous * (g0 + 0.5 * d0)
            hx = gx + viscous * (gx + 0.5 * dx)
            hy = gy + viscous * (gy + 0.5 * dy)
            least, most = extremes(x, y, first, last, h0, hx, hy)
        if least < 0.0:
            volume, moment_x, moment_y = no_tension(x, y, first, last, least, h0, hx, hy)
            if not volume > 0.0:
                return 0.0, 0.0, 0.0, h0, hx, hy
            return volume, moment_x, moment_y, h0, hx, hy
    volume, moment_x, moment_y = closed_pressure(area, second, h0, hx, hy)
    return volume, moment_x, moment_y, h0, hx, hy


@jit
def follow_bending(pressed, a, x, y, first, last, reach, volume, moment_x, moment_y, h0, hx, hy):
    """Bring the pressed part of a convex joint up to date with what `area_pressure` found; ``pressed`` is None if the
    friction of no joint follows the bending."""
    if pressed is not None:
        follow_pressure(pressed, a, x, y, first, last, reach, volume, moment_x, moment_y, h0, hx, hy)


@jit
def area_friction(
    x, y, first, last, area, reach, far, pressed, a, radius, normal, friction, negligible, k_t, k_r, damped,
    s1, s2, turn, b1, b2, bm, w1, w2, wm, tolerance=PROXIMAL_TOLERANCE,
):  # fmt: skip
    """Return mapping of a convex joint under the normal force ``normal`` for the slip twist (s1, s2, turn) of a step.

    (b1, b2, bm): memory; (w1, w2, wm): last plastic twist, the start of the search; ``k_t`` N/m, ``k_r`` N m;
    ``damped``: one plus dashpot over spring force; up to ``negligible`` (N) of strength the chord of the limit surface
    is good enough. The rest as in `limit_surface.surface`. Returns the force (3), the new memory (3), the plastic twist
    (3; of an open joint: what its springs let go, too), the next start (3), the slip path, and the evaluations of the
    surface.
    """
    if not normal > 0.0:
        return (
            0.0, 0.0, 0.0, 0.0, 0.0, 0.0, s1 + b1 / k_t, s2 + b2 / k_t, turn + bm / k_r, 0.0, 0.0, 0.0, 0.0, 0,
        )  # fmt: skip
    full_t = damped * k_t
    full_r = damped * k_r
    f1 = b1 + full_t * s1
    f2 = b2 + full_t * s2
    fm = bm + full_r * turn
    strength = friction * normal
    size = chord(pressed, a, radius, f1, f2, fm)
    if size <= strength:  # inside the limit surface by convexity, and most joints are most of the time
        return (
            f1, f2, fm, b1 + k_t * s1, b2 + k_t * s2, bm + k_r * turn, 0.0, 0.0, 0.0, w1, w2, wm, 0.0, 0,
        )  # fmt: skip
    if strength <= negligible:
        kept = strength / size
        t1 = kept * f1
        t2 = kept * f2
        tm = kept * fm
        q1 = (f1 - t1) / full_t
        q2 = (f2 - t2) / full_t
        qm = (fm - tm) / full_r
        evaluations = 0
    else:
        t1, t2, tm, q1, q2, qm, w1, w2, wm, evaluations = proximal_map(
            x, y, first, last, area, reach, far, pressed, a, radius, strength, full_t, full_r, f1, f2, fm, w1, w2, wm,
            tolerance,
        )  # fmt: skip
    # without friction there is no work to divide by: the path of O
    slid = (t1 * q1 + t2 * q2 + tm * qm) / strength if strength > 0.0 else sqrt(q1 * q1 + q2 * q2)
    return (
        t1, t2, tm, b1 + k_t * (s1 - q1), b2 + k_t * (s2 - q2), bm + k_r * (turn - qm), q1, q2, qm, w1, w2, wm, slid,
        evaluations,
    )  # fmt: skip
