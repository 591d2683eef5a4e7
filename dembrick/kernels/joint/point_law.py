"""The law of a contact point: a no-tension normal spring and Coulomb friction, each spring with a dashpot beside it.

Both engines call `point_law` once a point and step, or `bonded_law` in scenes where any point has more strength than
friction gives it, or dilates, or crushes. Sign of all shear quantities: the action on block b (in dynamics
the host), which is also the direction in which it slips; the joint pushes back with the opposite.

- Normal: N = k_n (g + viscous d'), never negative and zero if g <= 0; d' is `dashpots.dashpot_growth`.
- Shear: spring and dashpot in parallel, both behind a slider of strength mu N. The trial force is the elastic force
  before plus k_s (1 + viscous) times the slip of the step; beyond mu N it returns along its own direction.
- Memory: the elastic shear force, in N. An open point (N = 0) carries nothing and remembers nothing: a point that
  closes again begins without shear. (A decay over the dashpot's time instead, k_s / c, would let the regularisation
  decide what a joint remembers; as the dashpot gets smaller it tends to this rule.)
- `slip` is the irreversible part of the shear displacement, as a path length: the plastic increment of each step added
  up while the point is closed. What an open point moves past is no slip.

The dry law has one branch, so that a point that sticks takes no root and no division. It holds nothing but arithmetic:
in a loop over the lanes of a tile the compiler does it for all lanes, by wide instructions, and keeps those that slide.

With strengths (cohesion c, tensile strength f_t, compressive strength f_c, dilation tan psi, residual friction mu_r and
cohesion c_r; areas A) a point remembers besides whether its *bond* holds, the depth by which it was crushed, and its
rise by dilation. The normal spring then has the length g + rise - crushed. In this order:

1. A bond breaks in tension if the spring pulls more than f_t A; without a bond a spring that does not press is open.
2. What presses more than f_c A crushes by the rest, and goes on with f_c A.
3. The bond breaks in shear beyond c A + mu N. From then on, in the same evaluation, the strength is c_r A + mu_r N; a
   bond that breaks while it pulls leaves nothing.
4. Slip ds lifts by tan psi ds, by its length and not its sense, and N grows with it: slip and lift of a step are one
   solution. So a point that has come apart by less than its slip lifts it has not opened.

A bond that breaks lets its springs go at once: no dashpot holds them back.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.joint.dashpots import dashpot_growth

NONE = 1e-140  # as good as zero, in a divisor


@jit
def coulomb(elastic, slip, k, damped, share, cap):
    """Return mapping of Coulomb friction at a point, radial, spring and dashpot in parallel behind the slider.

    ``elastic`` (2): memory (N); ``slip`` (2): increment of the relative displacement (m); ``k`` N/m; ``damped``: one
    plus dashpot force over spring force for the same increment; ``share``: one over that; ``cap`` = mu N (N). Returns
    the shear force (2), the elastic part of it that stays (2) and the length of the plastic increment (m), which points
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
        both = 1.0 / (size * divisor)  # one over size and one over the stiffness by one division
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
    (N); ``springs``: k_n, k_s (N/m); ``dashpots``: over spring force along the normal, one plus that in shear, one over
    that. Returns N, the shear force (2), the new memory (2) and the slip path of the step (m).
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
def shear_loss(before, after, slip, k):
    """Work of a step that the shear spring of a point does not give back (J): friction, or released.

    A spring that was loaded from e (``before``, 2) to e' (``after``) while the point moved by s (``slip``) took
    (e + e') s / 2 and holds (e'^2 - e^2) / 2k more. The rest went into friction, or was let go if the point has opened.
    """
    divisor = max(k, NONE)
    q1 = k * slip[0] - (after[0] - before[0])
    q2 = k * slip[1] - (after[1] - before[1])
    return 0.5 * ((before[0] + after[0]) * q1 + (before[1] + after[1]) * q2) / divisor


class Strengths(NamedTuple):
    """Strengths of joints beside friction, an entry a joint (s,) or a law of joints; None in scenes without any."""

    cohesion: ndarray  # (s,) Pa, while the bond holds
    tension: ndarray  # (s,) Pa
    crushing: ndarray  # (s,) Pa, infinite if nothing crushes
    dilation: ndarray  # (s,) rise over slip
    residual_cohesion: ndarray  # (s,) Pa, of a closed point without a bond
    residual: ndarray  # (s,) residual friction over friction
    held: ndarray  # (1,) 1 while no bond breaks that would let go of something: while an equilibrium is looked for


@jit
def breaks_at_once(strengths, i):
    """Whether a bond that breaks in shear while it presses lets go of something (brittle), or carries on (ductile)."""
    return strengths.residual_cohesion[i] < strengths.cohesion[i] or strengths.residual[i] < 1.0


@jit
def bond_strength(strengths, i, area, friction, normal):
    """Shear strength (N) while the bond holds: c A + mu N."""
    return strengths.cohesion[i] * area + friction * normal


@jit
def residual_strength(strengths, i, area, friction, normal):
    """Shear strength (N) without a bond, if it presses: c_r A + mu_r N."""
    return strengths.residual_cohesion[i] * area + strengths.residual[i] * friction * normal


@jit
def shear_strength(strengths, i, area, bonded, friction, normal):
    """Shear strength (N) under N = ``normal`` of a point, or what scales the limit surface of an area, by its bond."""
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
    """Answer of `bonded_law` for a point without a bond that does not press."""
    return 0.0, spring, (0.0, 0.0), 0.0, Bond((0.0, 0.0), 0.0, crushed, rise)


@jit
def bonded_law(g, d, slip, springs, friction, dashpots, strengths, i, area, bond):
    """Force of a contact point with the strengths ``i``, and its new memory.

    ``area`` (m2) tributary; ``bond``: its `Bond`; the rest as in `point_law`. Returns N (negative in tension), N of the
    spring alone, the shear force (2), the slip path of the step (m), and the memory.
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
    if spring > most:  # spring and dashpot are one behind the other with what crushes, and with what lifts
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
        if brittle:  # by its springs alone, which store what it takes: dashpots break nothing
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
        if brittle:  # the springs go at once, and no dashpot acts in this step
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
        if normal > most:  # what is crushed lifts no further
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
    """N of the normal spring of a point for a penetration ``g``, that of a step ago for instance."""
    spring = k_n * (g + bond.rise - bond.crushed)
    if bond.bonded == 0.0 and spring < 0.0:
        return 0.0
    most = strengths.crushing[i] * area
    return most if spring > most else spring


class Losses(NamedTuple):
    """Energies that a step took from the springs of a point with strengths (J)."""

    friction: float
    by_law: float  # the friction by its law
    crushing: float
    fracture: float  # by a bond that broke
    released: float  # let go by a point that opened
    stepping: float  # by opening or closing within the step
    dash: float  # by its dashpot, more than by the growth of the penetration


@jit
def bonded_losses(strengths, i, area, friction, k_n, d, springs, shear, slid, change):
    """`Losses` of a point with the strengths ``i`` in a step.

    ``springs``: N of the normal spring a step ago and now, and N; ``d``: growth of the penetration (m); ``shear``: see
    `shear_loss`; ``slid``: slip path (m); ``change``: whether the bond broke, by how much the crushed depth and the
    rise grew (m), whether the point let go of its shear.
    """
    before, spring, normal = springs
    broke, deeper, lift, opened = change
    across = 0.5 * (before + spring) * d - 0.5 * (spring * spring - before * before) / max(k_n, NONE)
    if broke:
        return Losses(0.0, 0.0, 0.0, shear + across, 0.0, 0.0, 0.0)
    crush = strengths.crushing[i] * area * deeper if deeper > 0.0 else 0.0
    if slid > 0.0:
        by_law = residual_strength(strengths, i, area, friction, normal) - strengths.dilation[i] * normal
        if lift > 0.0:  # what lifts takes its work from friction, and the dashpot lengthens with it
            dash = (normal - spring) * (lift - deeper)
            return Losses(shear + across - crush - dash, by_law * slid, crush, 0.0, 0.0, 0.0, dash)
        return Losses(shear, by_law * slid, crush, 0.0, 0.0, across - crush, 0.0)
    return Losses(0.0, 0.0, crush, 0.0, shear if opened else 0.0, across - crush, 0.0)
