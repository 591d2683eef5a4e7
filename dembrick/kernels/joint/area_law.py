"""The law of a convex joint: the no-tension integral over its polygon, and the exact torsion-shear limit surface.

Both engines call `area_pressure` and `area_friction` once per joint and step; new contacts call `area_friction`. Shear
quantities are (V_1, V_2, M_T) about O in the axes of the polygon, in the sense of the action on block b (in dynamics
the host), which is also the direction in which it slips.

- Normal: k_n times the integral of <g + viscous d'>+, zero if g is nowhere positive; d' follows the rule of
  `dashpots.dashpot_growth` if no part of the joint was in contact a step ago.
- Shear and torsion: springs k_s A and k_s J with dashpots in parallel, behind a slider whose strength is the limit
  surface times mu N; a trial force beyond it is returned by the proximal map.
- Memory: the elastic (V_1, V_2, M_T). An open joint carries nothing and remembers nothing, as in `point_law`.
- `slip` is the irreversible part of the shear displacement, as a path length averaged over the pressure: in each step
  the plastic work t.q over the strength, that is D(q) of the plastic twist q. Of points it is the same mean over their
  normal forces.

With strengths (those of `point_law`) one bond holds the whole polygon, with springs that also pull, until the tension
at a corner passes f_t or (V_1, V_2, M_T) leaves the limit surface, which is scaled by c A + mu N; after that the
no-tension integral applies, and a surface scaled by c_r A + mu_r N. Crushing caps the pressure at f_c, without memory:
this is valid where loads only grow. Dilation lifts the block by tan psi times the slip, along the normal; slip and lift
of a step are solved together, so that a joint stays closed if it has separated by less than its slip lifts it.
"""

from math import sqrt
from typing import NamedTuple

from dembrick._jit import jit
from dembrick.kernels.joint.limit_surface import PROXIMAL_TOLERANCE, chord, gauge, proximal_map, surface
from dembrick.kernels.joint.no_tension import extremes, no_tension, no_tension_of_four
from dembrick.kernels.joint.point_law import breaks_at_once, shear_strength
from dembrick.kernels.joint.pressure import follow_pressure

LIFTS = 30  # most iterations for the slip and the lift of a step
LIFTED = 1e-12  # relative error of the lift at the end


@jit
def closed_pressure(area, second, g0, gx, gy):
    """Integrals of g, x g and y g over a polygon about its centroid; ``second``: of y^2, x^2 and x y."""
    return area * g0, second[1] * gx + second[2] * gy, second[2] * gx + second[0] * gy


@jit
def spring_pressure(polygon, g0, gx, gy):
    """Integrals of <g>+, x <g>+ and y <g>+ over a `Polygon`."""
    if g0 < polygon.reach * sqrt(gx * gx + gy * gy):
        least, most = extremes(polygon.x, polygon.y, polygon.first, polygon.last, g0, gx, gy)
        if least < 0.0:
            return no_tension(polygon.x, polygon.y, polygon.first, polygon.last, least, g0, gx, gy)
    return closed_pressure(polygon.area, polygon.second, g0, gx, gy)


@jit
def either_wholly(reach, g0, gx, gy):
    """Whether g0 + gx x + gy y has one sign on the circle of radius ``reach`` around a polygon, which is then closed or
    open everywhere."""
    return g0 * g0 >= reach * reach * (gx * gx + gy * gy)


@jit
def wholly_closed(reach, g0, d0, h0, hx, hy):
    """Whether h (see `area_pressure`) and g are positive on the circle around a polygon, and there was contact at O a
    step ago: then no corner needs to be checked."""
    return either_wholly(reach, h0, hx, hy) & (h0 > 0.0) & (g0 > 0.0) & (g0 > d0)


@jit
def area_pressure(polygon, viscous, depth, growth):
    """Integrals (3) over the polygon of <h>+, x <h>+ and y <h>+, and h = h0 + hx x + hy y itself (3).

    h is the penetration ``depth``, g = g0 + gx x + gy y, plus ``viscous`` times its ``growth`` in the step, d = d0 + dx
    x + dy y. All integrals are zero if g is nowhere positive.
    """
    g0, gx, gy = depth
    d0, dx, dy = growth
    x = polygon.x
    y = polygon.y
    first = polygon.first
    last = polygon.last
    h0 = g0 + viscous * d0
    hx = gx + viscous * dx
    hy = gy + viscous * dy
    if not wholly_closed(polygon.reach, g0, d0, h0, hx, hy):
        least, most, before = 1e300, -1e300, -1e300
        for i in range(first, last):
            g = g0 + gx * x[i] + gy * y[i]
            d = d0 + dx * x[i] + dy * y[i]
            least = min(least, g + viscous * d)
            most = max(most, g)
            before = max(before, g - d)
        if most <= 0.0:
            return (0.0, 0.0, 0.0), (h0, hx, hy)
        if before <= 0.0:  # contact began in the step: see `dashpots`
            h0 = g0 + viscous * (g0 + 0.5 * d0)
            hx = gx + viscous * (gx + 0.5 * dx)
            hy = gy + viscous * (gy + 0.5 * dy)
            least, most = extremes(x, y, first, last, h0, hx, hy)
        if least < 0.0:
            pressure = no_tension(x, y, first, last, least, h0, hx, hy)
            if not pressure[0] > 0.0:
                return (0.0, 0.0, 0.0), (h0, hx, hy)
            return pressure, (h0, hx, hy)
    return closed_pressure(polygon.area, polygon.second, h0, hx, hy), (h0, hx, hy)


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
def area_pressure_of_four(x, y, area, second, viscous, depth, growth):
    """The integrals of `area_pressure` of a polygon of four corners ``x``, ``y``, and whether g is positive somewhere;
    without a branch, so that many are evaluated side by side."""
    g0, gx, gy = depth
    d0, dx, dy = growth
    g = at_four(x, y, g0, gx, gy)
    d = at_four(x, y, d0, dx, dy)
    touching = most_of_four(g) > 0.0
    began = most_of_four((g[0] - d[0], g[1] - d[1], g[2] - d[2], g[3] - d[3])) <= 0.0
    own = 1.0 if began else 0.0  # contact began in the step: see `dashpots`
    grown = 0.5 if began else 1.0
    h0 = g0 + viscous * (own * g0 + grown * d0)
    hx = gx + viscous * (own * gx + grown * dx)
    hy = gy + viscous * (own * gy + grown * dy)
    volume, moment_x, moment_y = pressure_of_four(x, y, area, second, touching, h0, hx, hy)
    return volume, moment_x, moment_y, touching


@jit
def follow_bending(pressed, a, polygon, pressure, depth):
    """Update the pressed part of a convex joint from the result of `area_pressure`; ``pressed`` is None if the friction
    of no joint follows the bending."""
    if pressed is not None:
        follow_pressure(pressed, a, polygon, pressure, depth)


@jit
def stretched(springs, slip, elastic):
    """The forces (3) of springs that carried ``elastic`` and are stretched by ``slip``."""
    k_t, k_r = springs
    return elastic[0] + k_t * slip[0], elastic[1] + k_t * slip[1], elastic[2] + k_r * slip[2]


@jit
def trial_force(pressed, a, radius, springs, damped, slip, elastic):
    """The force (3) of a convex joint if it does not slide, its memory then (3), and an upper bound of the strength
    that this requires; see `area_friction`."""
    k_t, k_r = springs
    s1, s2, turn = slip
    b1, b2, bm = elastic
    f1 = b1 + damped * k_t * s1
    f2 = b2 + damped * k_t * s2
    fm = bm + damped * k_r * turn
    return (f1, f2, fm), stretched(springs, slip, elastic), chord(pressed, a, radius, f1, f2, fm)


@jit
def shear_springs(polygon, k_s):
    """Stiffness in shear (N/m) and in torsion (N m) of a joint of ``k_s`` (Pa/m)."""
    return k_s * polygon.area, k_s * (polygon.second[0] + polygon.second[1])


@jit
def area_friction(
    limit, normal, friction, negligible, springs, damped, slip, elastic, start, tolerance=PROXIMAL_TOLERANCE
):  # fmt: skip
    """Return mapping of a joint of the `LimitSurface` ``limit`` under the normal force ``normal`` for the ``slip`` (3)
    of a step.

    ``elastic`` (3): memory; ``start`` (3): last plastic twist, the start of the search; ``springs``: k_t (N/m) and k_r
    (N m); ``damped``: one plus dashpot over spring force; up to ``negligible`` (N) of strength the chord of the limit
    surface is accurate enough. Returns the force (3), the new memory (3), the plastic twist (3; for an open joint it
    includes the release of its springs), the next start (3), the slip path, and the number of evaluations of the
    surface.
    """
    k_t, k_r = springs
    s1, s2, turn = slip
    b1, b2, bm = elastic
    still = (0.0, 0.0, 0.0)
    if not normal > 0.0:
        return still, still, (s1 + b1 / k_t, s2 + b2 / k_t, turn + bm / k_r), still, 0.0, 0
    trial, whole, size = trial_force(limit.pressed, limit.index, limit.radius, springs, damped, slip, elastic)
    strength = friction * normal
    if size <= strength:  # inside the limit surface by convexity, as most joints most of the time
        return trial, whole, still, start, 0.0, 0
    full = damped * k_t, damped * k_r
    if strength <= negligible:
        kept = strength / size
        force = kept * trial[0], kept * trial[1], kept * trial[2]
        twist = (trial[0] - force[0]) / full[0], (trial[1] - force[1]) / full[0], (trial[2] - force[2]) / full[1]
        evaluations = 0
    else:
        force, twist, start, evaluations = proximal_map(limit, strength, full, trial, start, tolerance)
    q1, q2, qm = twist
    # without friction there is no work to divide by: take the path of O
    power = force[0] * q1 + force[1] * q2 + force[2] * qm
    slid = power / strength if strength > 0.0 else sqrt(q1 * q1 + q2 * q2)
    return force, (b1 + k_t * (s1 - q1), b2 + k_t * (s2 - q2), bm + k_r * (turn - qm)), twist, start, slid, evaluations


# --- with strengths


class Memory(NamedTuple):
    """Memory of a convex joint with strengths."""

    elastic: tuple[float, float, float]  # N, N, N m
    start: tuple[float, float, float]  # m, m, rad, last plastic twist
    bonded: float  # 1 or 0
    rise: float  # m, by dilation


@jit
def area_springs(polygon, bonded, most, g0, gx, gy):
    """Integrals (3) over the polygon of the depth of its normal springs, from g = g0 + gx x + gy y, and its x and y
    moments; and the volume beyond ``most`` (m), the penetration at which the joint crushes."""
    if bonded > 0.0:
        volume, moment_x, moment_y = closed_pressure(polygon.area, polygon.second, g0, gx, gy)
    else:
        volume, moment_x, moment_y = spring_pressure(polygon, g0, gx, gy)
    beyond = 0.0
    if g0 + polygon.reach * sqrt(gx * gx + gy * gy) > most:
        beyond, beyond_x, beyond_y = spring_pressure(polygon, g0 - most, gx, gy)
        volume -= beyond
        moment_x -= beyond_x
        moment_y -= beyond_y
    return (volume, moment_x, moment_y), beyond


@jit
def bonded_pressure(polygon, viscous, bonded, most, depth, growth):
    """`area_springs` including the dashpots; `area_pressure` if there is no bond."""
    if bonded > 0.0:
        h0 = depth[0] + viscous * growth[0]
        hx = depth[1] + viscous * growth[1]
        hy = depth[2] + viscous * growth[2]
        volume, moment_x, moment_y = closed_pressure(polygon.area, polygon.second, h0, hx, hy)
    else:
        (volume, moment_x, moment_y), (h0, hx, hy) = area_pressure(polygon, viscous, depth, growth)
    if h0 + polygon.reach * sqrt(hx * hx + hy * hy) > most:
        beyond, beyond_x, beyond_y = spring_pressure(polygon, h0 - most, hx, hy)
        volume -= beyond
        moment_x -= beyond_x
        moment_y -= beyond_y
    return volume, moment_x, moment_y


@jit
def lifted(vector, lift):
    """A penetration (3), or its growth, increased by the ``lift`` of dilation."""
    return vector[0] + lift, vector[1], vector[2]


@jit
def bonded_area(limit, strengths, i, springs, friction, negligible, dashpots, motion, memory):
    """Force of a convex joint with the strengths ``i``, under full pressure, and its new `Memory`.

    ``springs``: k_n, k_s (Pa/m); ``dashpots``: dashpot over spring force along the normal, and one plus that in shear;
    the `Motion` of the step. Returns N and its x and y moments (3), the shear force (3), the plastic twist (3), the
    slip path of the step, evaluations of the surface, and the memory.
    """
    polygon = limit.polygon
    k_n, k_s = springs
    viscous, damped = dashpots
    area = polygon.area
    b1, b2, bm = memory.elastic
    s1, s2, turn = motion.slip
    still = (0.0, 0.0, 0.0)
    bonded = memory.bonded
    rise = memory.rise
    start = memory.start
    held = strengths.held[0] > 0.0
    most = strengths.crushing[i] / k_n
    k_t, k_r = stiff = shear_springs(polygon, k_s)
    g0, gx, gy = motion.depth
    if bonded > 0.0:
        least, _ = extremes(polygon.x, polygon.y, polygon.first, polygon.last, g0 + rise, gx, gy)
        n, nx, ny = bonded_pressure(polygon, viscous, bonded, most, (g0 + rise, gx, gy), motion.growth)
        n *= k_n
        brittle = breaks_at_once(strengths, i)
        t1 = b1 + damped * k_t * s1
        t2 = b2 + damped * k_t * s2
        tm = bm + damped * k_r * turn
        whole = held and (least < 0.0 or brittle)
        tears = k_n * least < -strengths.tension[i] and not held
        elastic = b1 + k_t * s1, b2 + k_t * s2, bm + k_r * turn
        if not (whole or tears):
            e1, e2, em = t1, t2, tm
            pressed = n
            if brittle:  # by its springs alone, which store the energy for it: dashpots break nothing
                (pressed, _, _), _ = area_springs(polygon, bonded, most, g0 + rise, gx, gy)
                pressed *= k_n
                e1, e2, em = elastic
            cap = shear_strength(strengths, i, area, bonded, friction, pressed)
            whole = chord(None, 0, limit.radius, e1, e2, em) <= cap
            if not whole and cap > 0.0:
                size, start = gauge(limit, (e1 / cap, e2 / cap, em / cap), start)
                whole = size <= 1.0
        if whole:
            same = Memory(elastic, start, bonded, rise)
            return (n, k_n * nx, k_n * ny), (t1, t2, tm), still, 0.0, 1, same
        bonded = 0.0
        if tears or brittle:  # the springs unload at once, and no dashpot acts in this step
            viscous = 0.0
            damped = 1.0
    dilation = strengths.dilation[i]
    lift = below = above = last_lift = error = 0.0
    bounded = False
    evaluations = 0
    for turns in range(LIFTS):
        n, nx, ny = bonded_pressure(
            polygon, viscous, bonded, most, (g0 + rise + lift, gx, gy), lifted(motion.growth, lift)
        )
        n *= k_n
        strength = shear_strength(strengths, i, area, bonded, friction, n)
        shear, elastic, twist, start, slid, more = area_friction(
            limit, strength, 1.0, negligible, stiff, damped, motion.slip, memory.elastic, start
        )
        evaluations += more
        q1, q2, qm = twist
        if dilation > 0.0 and n <= 0.0 and q1 * q1 + q2 * q2 + qm * qm > 0.0:  # slip under almost no N
            wanted = dilation * surface(limit, q1, q2, qm)[0]
        else:
            wanted = dilation * slid
        if turns == LIFTS - 1 or abs(wanted - lift) <= LIFTED * wanted:
            break
        # more lift means more strength and less slip: bracket it between too little and too much
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
    return (n, k_n * nx, k_n * ny), shear, twist, slid, evaluations, Memory(elastic, start, bonded, rise + lift)


@jit
def springs_hold(polygon, bonded, rise, most, g0, gx, gy):
    """Twice the energy over k_n in the normal springs of a convex joint: a function of the state, not of the path,
    since crushed material releases nothing."""
    (n, nx, ny), beyond = area_springs(polygon, bonded, most, g0 + rise, gx, gy)
    return n * (g0 + rise) + nx * gx + ny * gy - (most * beyond if beyond > 0.0 else 0.0)
