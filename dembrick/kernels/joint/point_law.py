"""The law of a contact point: a no-tension normal spring and Coulomb friction, each spring with a dashpot beside it.

Both engines call `point_law` once per point and step, or `bonded_law` in scenes where a point has cohesion or tension,
dilates, or crushes. Sign of all shear quantities: the action on block b (in dynamics the host), which is also the
direction in which it slips; the joint pushes back with the opposite.

- Normal: N = k_n (g + viscous d'), never negative and zero if g <= 0; d' is `dashpots.dashpot_growth`.
- Shear: spring and dashpot in parallel, both behind a slider of strength mu N. The trial force is the last elastic
  force plus k_s (1 + viscous) times the slip of the step; beyond mu N it is returned along its own direction.
- Memory: the elastic shear force, in N. An open point (N = 0) carries nothing and remembers nothing: a point that
  closes again begins without shear. (If the memory decayed over the time of the dashpot instead, k_s / c, the
  regularisation would decide what a joint remembers; for a vanishing dashpot that tends to this rule.)
- `slip` is the irreversible part of the shear displacement, as a path length: the plastic increments of all steps in
  which the point is closed. The motion of an open point is no slip. That of a joint grows in each step by the mean of
  these increments over the pressure, as that of a convex joint: the friction work of the step over mu N. So what is
  open does not lower it, and it never falls.

The dry law has one branch, so a point that sticks needs no root and no division. It consists of arithmetic only: in a
loop over the lanes of a tile the compiler evaluates it for all lanes by wide instructions, and selects those that
slide.

With strengths (cohesion c, tensile strength f_t, compressive strength f_c, dilation tan psi, residual friction mu_r and
cohesion c_r; areas A) a point also remembers whether its *bond* holds, the depth by which it was crushed, and its rise
by dilation. The normal spring then has the length g + rise - crushed. In this order:

1. A bond breaks in tension if the spring pulls more than f_t A; without a bond, a point is open unless its spring
   presses.
2. A point that presses more than f_c A crushes by the excess depth, and carries f_c A.
3. The bond breaks in shear beyond c A + mu N. From then on, in the same evaluation, the strength is c_r A + mu_r N; a
   bond that breaks while it pulls leaves no strength.
4. Slip ds lifts by tan psi ds, by its length whatever its sense, and N grows with it: slip and lift of a step are
   solved together. So a point stays closed if it has separated by less than its slip lifts it.

The springs of a bond that breaks unload at once: no dashpot resists that.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.joint.dashpots import dashpot_growth

NONE = 1e-140  # least divisor, in place of zero


@jit
def coulomb(elastic, slip, k, damped, share, cap):
    """Return mapping of Coulomb friction at a point, radial, spring and dashpot in parallel behind the slider.

    ``elastic`` (2): memory (N); ``slip`` (2): increment of the relative displacement (m); ``k`` N/m; ``damped``: one
    plus dashpot force over spring force for the same increment; ``share``: one over that; ``cap`` = mu N (N). Returns
    the shear force (2), its elastic part, the new memory (2), and the length of the plastic increment (m), which points
    along the force.
    """
    elastic_1, elastic_2 = elastic
    t1 = elastic_1 + damped * k * slip[0]
    t2 = elastic_2 + damped * k * slip[1]
    size2 = t1 * t1 + t2 * t2
    plastic = 0.0
    if size2 > cap * cap:
        size = sqrt(size2)
        divisor = max(k, NONE)
        both = 1.0 / (size * divisor)  # one over the size and over the stiffness, by one division
        kept = cap * divisor * both
        plastic = (size - cap) * share * size * both
        t1 *= kept
        t2 *= kept
    e1 = elastic_1 + share * (t1 - elastic_1)
    e2 = elastic_2 + share * (t2 - elastic_2)
    return t1, t2, e1, e2, plastic


@jit
def point_law(g, d, slip, elastic, springs, friction, dashpots):
    """Force of a contact point and its new memory, dry.

    ``g`` penetration now and ``d`` its growth in the step (m); ``slip`` (2) of the step (m); ``elastic`` (2): memory
    (N); ``springs``: k_n, k_s (N/m); ``dashpots``: dashpot over spring force along the normal, one plus that ratio in
    shear, one over that sum. Returns N, the shear force (2), the new memory (2) and the slip path of the step (m).
    """
    k_n, k_s = springs
    viscous, damped, share = dashpots
    h = k_n * (g + viscous * dashpot_growth(g, d))
    h = h if g > 0.0 else 0.0
    normal = h if h > 0.0 else 0.0
    closed = 1.0 if h > 0.0 else 0.0
    t1, t2, e1, e2, slid = coulomb(elastic, slip, k_s, damped, share, friction * normal)
    return normal, t1, t2, closed * e1, closed * e2, closed * slid


@jit
def slip_weight(normal, t1, t2):
    """Weight (N) of the slip of a point in that of its joint: its normal force, or, if it holds without pressing, as
    bonds and user-defined laws may, its shear force."""
    return normal if normal > 0.0 else sqrt(t1 * t1 + t2 * t2)


@jit
def shear_loss(before, after, slip, k):
    """Work of a step that the shear spring of a point does not store (J): lost in friction, or released.

    A spring that was loaded from e (``before``, 2) to e' (``after``) while the point moved by s (``slip``) received
    (e + e') s / 2 and stores (e'^2 - e^2) / 2k more. The rest was lost in friction, or released if the point has
    opened.
    """
    divisor = max(k, NONE)
    q1 = k * slip[0] - (after[0] - before[0])
    q2 = k * slip[1] - (after[1] - before[1])
    return 0.5 * ((before[0] + after[0]) * q1 + (before[1] + after[1]) * q2) / divisor


class Strengths(NamedTuple):
    """Strengths of joints beside friction, one entry per joint (s,) or law of joints; None in scenes without any."""

    cohesion: ndarray  # (s,) Pa, while the bond holds
    tension: ndarray  # (s,) Pa
    crushing: ndarray  # (s,) Pa, infinite if nothing crushes
    dilation: ndarray  # (s,) rise over slip
    residual_cohesion: ndarray  # (s,) Pa, of a closed point without a bond
    residual: ndarray  # (s,) residual friction over friction
    held: ndarray  # (1,) 1 during the search for an equilibrium: no bond may break whose loss would release force


@jit
def breaks_at_once(strengths, i):
    """Whether the strength of a pressed bond drops when it breaks in shear (brittle), or remains (ductile)."""
    return strengths.residual_cohesion[i] < strengths.cohesion[i] or strengths.residual[i] < 1.0


@jit
def bond_strength(strengths, i, area, friction, normal):
    """Shear strength (N) while the bond holds: c A + mu N."""
    return strengths.cohesion[i] * area + friction * normal


@jit
def residual_strength(strengths, i, area, friction, normal):
    """Shear strength (N) without a bond, if the point presses: c_r A + mu_r N."""
    return strengths.residual_cohesion[i] * area + strengths.residual[i] * friction * normal


@jit
def shear_strength(strengths, i, area, bonded, friction, normal):
    """Shear strength (N) of a point under N = ``normal``, or scale of the limit surface of an area, with or without its
    bond."""
    if bonded > 0.0:
        return max(bond_strength(strengths, i, area, friction, normal), 0.0)
    return residual_strength(strengths, i, area, friction, normal) if normal > 0.0 else 0.0


class Bond(NamedTuple):
    """Memory of a contact point with strengths."""

    elastic: tuple[float, float]  # N, elastic shear force
    bonded: float  # 1 or 0
    crushed: float  # m, depth by which it was crushed
    rise: float  # m, by dilation


@jit
def carries_nothing(spring, crushed, rise):
    """Result of `bonded_law` for a point without a bond that does not press."""
    return 0.0, spring, (0.0, 0.0), 0.0, Bond((0.0, 0.0), 0.0, crushed, rise)


@jit
def bonded_law(g, d, slip, springs, friction, dashpots, strengths, i, area, bond):
    """Force of a contact point with the strengths ``i``, and its new memory.

    ``area`` (m2) tributary; ``bond``: its `Bond`; all others as in `point_law`. Returns N (negative in tension), N of
    the spring alone, the shear force (2), the slip path of the step (m), and the memory.
    """
    k_n, k_s = springs
    viscous, damped, share = dashpots
    elastic_1, elastic_2 = bond.elastic
    slip_1, slip_2 = slip
    bonded = bond.bonded
    crushed = bond.crushed
    rise = bond.rise
    held = strengths.held[0] > 0.0
    length = g + rise - crushed
    spring = k_n * length
    most = strengths.crushing[i] * area
    if bonded > 0.0:
        growth = d
        if spring < -strengths.tension[i] * area and not held:
            return carries_nothing(0.0, crushed, rise)
    else:
        growth = dashpot_growth(length, d)
        if spring <= 0.0 and strengths.dilation[i] == 0.0:
            return carries_nothing(0.0, crushed, rise)
    if spring > most:  # spring and dashpot are in series with crushing, and with lift
        growth -= (spring - most) / k_n
        crushed += (spring - most) / k_n
        spring = most
    normal = spring + k_n * viscous * growth
    if normal > most:
        normal = most
    if bonded == 0.0 and normal <= 0.0 and strengths.dilation[i] == 0.0:
        return carries_nothing(spring, crushed, rise)
    t1 = elastic_1 + damped * k_s * slip_1
    t2 = elastic_2 + damped * k_s * slip_2
    stiff = damped * k_s
    if bonded > 0.0:
        brittle = breaks_at_once(strengths, i)
        s1, s2, pressed = t1, t2, normal
        if brittle:  # by its springs alone, which store the energy for it: dashpots break nothing
            s1 = elastic_1 + k_s * slip_1
            s2 = elastic_2 + k_s * slip_2
            pressed = spring
        size = sqrt(s1 * s1 + s2 * s2)
        if size <= bond_strength(strengths, i, area, friction, pressed) or (held and (spring <= 0.0 or brittle)):
            e1 = elastic_1 + share * (t1 - elastic_1)
            e2 = elastic_2 + share * (t2 - elastic_2)
            return normal, spring, (t1, t2), 0.0, Bond((e1, e2), bonded, crushed, rise)
        bonded = 0.0
        if spring <= 0.0:
            return carries_nothing(0.0, crushed, rise)
        if brittle:  # the springs unload at once, and no dashpot acts in this step
            normal = spring
            t1 = s1
            t2 = s2
            stiff = k_s
            share = 1.0
            viscous = 0.0
    else:
        size = sqrt(t1 * t1 + t2 * t2)
    mu = friction * strengths.residual[i]
    cap = residual_strength(strengths, i, area, friction, normal)
    dilation = strengths.dilation[i]
    slid = 0.0
    lift = 0.0
    if size > cap:
        slid = (size - cap) / max(stiff + mu * k_n * (1.0 + viscous) * dilation, NONE)
        lift = dilation * slid
    if normal + k_n * (1.0 + viscous) * lift <= 0.0 or spring + k_n * lift <= 0.0:
        return carries_nothing(max(spring, 0.0), crushed, rise)
    if size > cap:
        rise += lift
        normal += k_n * (1.0 + viscous) * lift
        spring += k_n * lift
        if normal > most:  # a point that crushes lifts no further
            crushed += (spring - most) / k_n if spring > most else 0.0
            spring = min(spring, most)
            normal = most
            again = (size - residual_strength(strengths, i, area, friction, normal)) / max(stiff, NONE)
            rise += dilation * (again - slid)
            crushed += dilation * (again - slid)
            slid = again
        kept = residual_strength(strengths, i, area, friction, normal) / size
        t1 *= kept
        t2 *= kept
    e1 = elastic_1 + share * (t1 - elastic_1)
    e2 = elastic_2 + share * (t2 - elastic_2)
    if share == 1.0:
        e1 = t1
        e2 = t2
    return normal, spring, (t1, t2), slid, Bond((e1, e2), bonded, crushed, rise)


@jit
def spring_of(strengths, i, k_n, g, area, bond):
    """N of the normal spring of a point at a penetration ``g``, for instance that of the last step."""
    spring = k_n * (g + bond.rise - bond.crushed)
    if bond.bonded == 0.0 and spring < 0.0:
        return 0.0
    most = strengths.crushing[i] * area
    return most if spring > most else spring


class Losses(NamedTuple):
    """Energies that the springs of a point with strengths lost in a step (J)."""

    friction: float
    by_law: float  # friction loss by its law
    crushing: float
    fracture: float  # by breaking of the bond
    released: float  # by opening of the point
    stepping: float  # by opening or closing within the step
    dash: float  # in its dashpot, beyond the work on the growth of the penetration


@jit
def bonded_losses(strengths, i, area, friction, k_n, d, springs, shear, slid, change):
    """`Losses` of a point with the strengths ``i`` in a step.

    ``springs``: N of the normal spring a step ago and now, and N; ``d``: growth of the penetration (m); ``shear``: see
    `shear_loss`; ``slid``: slip path (m); ``change``: whether the bond broke, growth of the crushed depth and of the
    rise (m), whether the point released its shear.
    """
    before, spring, normal = springs
    broke, deeper, lift, opened = change
    across = 0.5 * (before + spring) * d - 0.5 * (spring * spring - before * before) / max(k_n, NONE)
    if broke:
        return Losses(0.0, 0.0, 0.0, shear + across, 0.0, 0.0, 0.0)
    crush = strengths.crushing[i] * area * deeper if deeper > 0.0 else 0.0
    if slid > 0.0:
        by_law = residual_strength(strengths, i, area, friction, normal) - strengths.dilation[i] * normal
        if lift > 0.0:  # the work of lifting comes out of friction, and the dashpot lengthens with the lift
            dash = (normal - spring) * (lift - deeper)
            return Losses(shear + across - crush - dash, by_law * slid, crush, 0.0, 0.0, 0.0, dash)
        return Losses(shear, by_law * slid, crush, 0.0, 0.0, across - crush, 0.0)
    return Losses(0.0, 0.0, crush, 0.0, shear if opened else 0.0, across - crush, 0.0)
