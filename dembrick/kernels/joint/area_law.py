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

With strengths (those of `point_law`) one bond holds the whole polygon, by springs on both sides, until the tension at
a corner passes f_t or (V_1, V_2, M_T) leaves the limit surface, which is scaled by c A + mu N; from then on the
no-tension integral holds, and a surface scaled by c_r A + mu_r N. Crushing caps the pressure at f_c, without memory: it
holds where loads only grow. Dilation lifts the block by tan psi times the slip, along the normal; slip and lift of a
step are one solution, so that a joint has not opened that came apart by less than its slip lifts it.
"""

from math import sqrt

from dembrick._jit import jit
from dembrick.kernels.joint.limit_surface import PROXIMAL_TOLERANCE, chord, gauge, proximal_map, surface
from dembrick.kernels.joint.no_tension import extremes, no_tension, no_tension_of_four
from dembrick.kernels.joint.point_law import breaks_at_once, shear_strength
from dembrick.kernels.joint.pressure import follow_pressure

LIFTS = 30  # of the search for the slip that lifts by what makes it
LIFTED = 1e-12  # of the slip: its error at the end


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
def either_wholly(reach, g0, gx, gy):
    """Whether g0 + gx x + gy y has one sign on the circle of that radius around a polygon: it is wholly closed, or
    wholly open."""
    return g0 * g0 >= reach * reach * (gx * gx + gy * gy)


@jit
def wholly_closed(reach, g0, d0, h0, hx, hy):
    """Whether h (see `area_pressure`) and g are positive on the circle around a polygon, and there was contact at O a
    step ago: then no corner needs to be looked at."""
    return either_wholly(reach, h0, hx, hy) & (h0 > 0.0) & (g0 > 0.0) & (g0 > d0)


@jit
def area_pressure(x, y, first, last, area, second, reach, viscous, g0, gx, gy, d0, dx, dy):
    """Integrals (3) over the polygon of <h>+, x <h>+ and y <h>+, and h = h0 + hx x + hy y itself (3).

    h is the penetration g = g0 + gx x + gy y plus ``viscous`` times what it grew by in the step, d = d0 + dx x + dy y.
    All integrals are zero if g is nowhere positive.
    """
    h0 = g0 + viscous * d0
    hx = gx + viscous * dx
    hy = gy + viscous * dy
    if not wholly_closed(reach, g0, d0, h0, hx, hy):
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
def at_four(x, y, g0, gx, gy):
    """g0 + gx x + gy y at four corners."""
    return (
        g0 + gx * x[0] + gy * y[0],
        g0 + gx * x[1] + gy * y[1],
        g0 + gx * x[2] + gy * y[2],
        g0 + gx * x[3] + gy * y[3],
    )


@jit
def least_of_four(g):
    """The least of four numbers."""
    return min(min(g[0], g[1]), min(g[2], g[3]))


@jit
def most_of_four(g):
    """The greatest of four numbers."""
    return max(max(g[0], g[1]), max(g[2], g[3]))


@jit
def pressure_of_four(x, y, area, second, touching, g0, gx, gy):
    """`spring_pressure` of a polygon of four corners ``x``, ``y`` without a branch; zero unless ``touching``."""
    g = at_four(x, y, g0, gx, gy)
    closed = least_of_four(g) >= 0.0
    c0, cx, cy = closed_pressure(area, second, g0, gx, gy)
    p0, px, py = no_tension_of_four(x, y, g, g0, gx, gy)
    some = touching & (closed | (p0 > 0.0))
    volume = (c0 if closed else p0) if some else 0.0
    moment_x = (cx if closed else px) if some else 0.0
    moment_y = (cy if closed else py) if some else 0.0
    return volume, moment_x, moment_y


@jit
def area_pressure_of_four(x, y, area, second, viscous, g0, gx, gy, d0, dx, dy):
    """The integrals of `area_pressure` of a polygon of four corners ``x``, ``y``, without a branch: many are done side
    by side; and whether g is positive somewhere."""
    g = at_four(x, y, g0, gx, gy)
    d = at_four(x, y, d0, dx, dy)
    touching = most_of_four(g) > 0.0
    began = most_of_four((g[0] - d[0], g[1] - d[1], g[2] - d[2], g[3] - d[3])) <= 0.0
    own = 1.0 if began else 0.0  # contact began in the step: see `onset`
    grown = 0.5 if began else 1.0
    h0 = g0 + viscous * (own * g0 + grown * d0)
    hx = gx + viscous * (own * gx + grown * dx)
    hy = gy + viscous * (own * gy + grown * dy)
    volume, moment_x, moment_y = pressure_of_four(x, y, area, second, touching, h0, hx, hy)
    return volume, moment_x, moment_y, touching


@jit
def follow_bending(pressed, a, x, y, first, last, reach, volume, moment_x, moment_y, h0, hx, hy):
    """Bring the pressed part of a convex joint up to date with what `area_pressure` found; ``pressed`` is None if the
    friction of no joint follows the bending."""
    if pressed is not None:
        follow_pressure(pressed, a, x, y, first, last, reach, volume, moment_x, moment_y, h0, hx, hy)


@jit
def trial_force(pressed, a, radius, k_t, k_r, damped, s1, s2, turn, b1, b2, bm):
    """The force (3) that a convex joint carries if it does not slide, its memory then (3), and a bound of what strength
    that takes; see `area_friction`."""
    f1 = b1 + damped * k_t * s1
    f2 = b2 + damped * k_t * s2
    fm = bm + damped * k_r * turn
    return f1, f2, fm, b1 + k_t * s1, b2 + k_t * s2, bm + k_r * turn, chord(pressed, a, radius, f1, f2, fm)


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
    f1, f2, fm, e1, e2, em, size = trial_force(pressed, a, radius, k_t, k_r, damped, s1, s2, turn, b1, b2, bm)
    strength = friction * normal
    if size <= strength:  # inside the limit surface by convexity, and most joints are most of the time
        return f1, f2, fm, e1, e2, em, 0.0, 0.0, 0.0, w1, w2, wm, 0.0, 0
    full_t = damped * k_t
    full_r = damped * k_r
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


# --- with strengths


@jit
def area_springs(x, y, first, last, area, second, reach, bonded, most, g0, gx, gy):
    """Integrals (3) over the polygon of what its normal springs are pressed by, g = g0 + gx x + gy y, its x and y
    moments; and the volume beyond ``most`` (m), the penetration at which the joint crushes."""
    if bonded > 0.0:
        volume, moment_x, moment_y = closed_pressure(area, second, g0, gx, gy)
    else:
        volume, moment_x, moment_y = spring_pressure(x, y, first, last, area, second, reach, g0, gx, gy)
    beyond = 0.0
    if g0 + reach * sqrt(gx * gx + gy * gy) > most:
        beyond, beyond_x, beyond_y = spring_pressure(x, y, first, last, area, second, reach, g0 - most, gx, gy)
        volume -= beyond
        moment_x -= beyond_x
        moment_y -= beyond_y
    return volume, moment_x, moment_y, beyond


@jit
def bonded_pressure(x, y, first, last, area, second, reach, viscous, bonded, most, g0, gx, gy, d0, dx, dy):
    """`area_springs` with the dashpots: `area_pressure` where there is no bond."""
    if bonded > 0.0:
        h0 = g0 + viscous * d0
        hx = gx + viscous * dx
        hy = gy + viscous * dy
        volume, moment_x, moment_y = closed_pressure(area, second, h0, hx, hy)
    else:
        volume, moment_x, moment_y, h0, hx, hy = area_pressure(
            x, y, first, last, area, second, reach, viscous, g0, gx, gy, d0, dx, dy
        )
    if h0 + reach * sqrt(hx * hx + hy * hy) > most:
        beyond, beyond_x, beyond_y = spring_pressure(x, y, first, last, area, second, reach, h0 - most, hx, hy)
        volume -= beyond
        moment_x -= beyond_x
        moment_y -= beyond_y
    return volume, moment_x, moment_y


@jit
def bonded_area(
    x, y, first, last, area, second, reach, far, radius, strengths, i, k_n, k_s, friction, negligible, viscous, damped,
    bonded, rise, g0, gx, gy, d0, dx, dy, s1, s2, turn, b1, b2, bm, w1, w2, wm, tolerance=PROXIMAL_TOLERANCE,
):  # fmt: skip
    """Force of a convex joint with the strengths ``i``, under full pressure, and its new memory.

    ``k_n``, ``k_s`` Pa/m; ``bonded`` 1 or 0 and ``rise`` (m): memory; the penetration g and its growth d as in
    `area_pressure`, the slip and the memory of shear as in `area_friction`. Returns N and its x and y moments (3), the
    shear force (3), the new memory (3), the plastic twist (3), the next start (3), the slip path of the step,
    evaluations of the surface, ``bonded`` and ``rise``.
    """
    held = strengths.held[0] > 0.0
    most = strengths.crushing[i] / k_n
    k_t = k_s * area
    k_r = k_s * (second[0] + second[1])
    if bonded > 0.0:
        least, _ = extremes(x, y, first, last, g0 + rise, gx, gy)
        n, nx, ny = bonded_pressure(
            x, y, first, last, area, second, reach, viscous, bonded, most, g0 + rise, gx, gy, d0, dx, dy
        )
        n *= k_n
        cap = shear_strength(strengths, i, area, bonded, friction, n)
        t1 = b1 + damped * k_t * s1
        t2 = b2 + damped * k_t * s2
        tm = bm + damped * k_r * turn
        whole = held and (least < 0.0 or breaks_at_once(strengths, i))
        tears = k_n * least < -strengths.tension[i] and not held
        if not (whole or tears):
            whole = chord(None, 0, radius, t1, t2, tm) <= cap
            if not whole and cap > 0.0:
                size, w1, w2, wm = gauge(
                    x, y, first, last, area, reach, far, None, 0, t1 / cap, t2 / cap, tm / cap, w1, w2, wm, 0.0
                )
                whole = size <= 1.0
        if whole:
            return (
                n, k_n * nx, k_n * ny, t1, t2, tm, b1 + k_t * s1, b2 + k_t * s2, bm + k_r * turn, 0.0, 0.0, 0.0,
                w1, w2, wm, 0.0, 1, bonded, rise,
            )  # fmt: skip
        bonded = 0.0
        if tears or breaks_at_once(strengths, i):  # the springs go at once, and no dashpot acts in this step
            viscous = 0.0
            damped = 1.0
    dilation = strengths.dilation[i]
    lift = below = above = last_lift = error = 0.0
    bounded = False
    evaluations = 0
    for turns in range(LIFTS):
        n, nx, ny = bonded_pressure(
            x, y, first, last, area, second, reach, viscous, bonded, most, g0 + rise + lift, gx, gy, d0 + lift, dx, dy
        )
        n *= k_n
        t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, more = area_friction(
            x, y, first, last, area, reach, far, None, 0, radius,
            shear_strength(strengths, i, area, bonded, friction, n), 1.0, negligible, k_t, k_r, damped, s1, s2, turn,
            b1, b2, bm, w1, w2, wm, tolerance,
        )  # fmt: skip
        evaluations += more
        if dilation > 0.0 and n <= 0.0 and q1 * q1 + q2 * q2 + qm * qm > 0.0:  # the slip under next to no N
            wanted = dilation * surface(x, y, first, last, area, reach, far, None, 0, q1, q2, qm)[0]
        else:
            wanted = dilation * slid
        if turns == LIFTS - 1 or abs(wanted - lift) <= LIFTED * wanted:
            break
        # more lift is more strength and less slip: between what was too little and what was too much
        if wanted > lift:
            below = lift
            if not bounded:
                above = wanted
                bounded = True
        else:
            above = lift
        if turns > 0 and error != wanted - lift:
            guess = lift + (wanted - lift) * (lift - last_lift) / (error - (wanted - lift))
            if not below < guess < above:
                guess = 0.5 * (below + above)
        else:
            guess = wanted
        last_lift = lift
        error = wanted - lift
        lift = guess
    if n <= 0.0:
        lift = 0.0
    return (
        n, k_n * nx, k_n * ny, t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, evaluations, bonded, rise + lift,
    )  # fmt: skip


@jit
def springs_hold(x, y, first, last, area, second, reach, bonded, rise, most, g0, gx, gy):
    """Twice the energy over k_n in the normal springs of a convex joint: a state, not a path, since what is crushed
    gives nothing back."""
    n, nx, ny, beyond = area_springs(x, y, first, last, area, second, reach, bonded, most, g0 + rise, gx, gy)
    return n * (g0 + rise) + nx * gx + ny * gy - (most * beyond if beyond > 0.0 else 0.0)
