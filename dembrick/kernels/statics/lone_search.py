"""The search for the limit load of a joint between a free block and a fixed one, from equilibrium to equilibrium.

Elastic steps lead to first yield; from there each step is `GROWTH` or `DOUBLING` times the last, so that the memory of
the elastic forces fades as fast as steps grow. V is bounded at every equilibrium (`load_bounds`). If friction does not
depend on the load, the equilibrium minimises a convex function, and there is only one; else the bracket is an
indicator, formed as `simulation.statics.paths.bounds` does for assemblies.

A single search is a batch of one.
"""

from math import inf, sqrt

from dembrick._jit import entry, jit
from dembrick.kernels.math.vectors import put_vector
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics.load_bounds import (
    NEVER,
    STILL,
    Basis,
    Certificate,
    certify,
    converges,
    remaining_growth,
    shear_power,
    strict_bounds,
)
from dembrick.kernels.statics.lone_joint import (
    CONVERGED,
    FALLS,
    LOST,
    RESTING,
    RUNNING,
    UNLIMITED,
    accept,
    find_equilibrium,
    greatest_force,
    newton_step,
    size_of,
)

BALANCED, LEAST_BALANCED = 1e-3, 1e-11  # out-of-balance over joint force at equilibrium: over the tolerance; least
ELASTIC_STEPS = 4  # to an estimate of the limit load
EASY = 8  # iterations up to which a step may grow
LEAST_FRICTION = 1e-3  # friction coefficient in that estimate, at least
UNLIMITED_BEYOND = 1e4  # times the dead load: a load that grows further has no limit
YIELDING = 0.5  # part of the elastic slope of V below which steps grow
SHORTEST = 1e-6  # part of the longest step: with shorter ones the search is lost
MOST_EQUILIBRIA = 120  # in a path
GROWTH, DOUBLING = 4.0, 2.0  # factor of the next step, if friction does not depend on the load; if it does
AGAIN = 1.5  # factor on the estimated further growth or fall of V
FURTHEST = 2.0  # limit of the extrapolation, times the difference of tangent and secant
CAUTION = 0.5  # part of the tolerance that an indicator must meet, as it does not contain further drift


@jit
def basis_of(basis, j):
    """The `Basis` of joint ``j``."""
    return Basis(
        basis.unit[j], basis.dead[j], basis.centre[j], basis.rest, basis.scalars[j], basis.twist[j], basis.across[j]
    )


@jit
def certificate_of(lone, family, index, j, tolerance):
    """The `Certificate` of joint ``j`` for the ``tolerance`` of its bracket."""
    basis = basis_of(lone.basis, j)
    search = lone.search[j]
    strict = search.strict == 1
    return Certificate(
        1, strict, j, family, index, basis.unit, basis.dead, basis.scalars[1], basis.centre, basis.scalars[2],
        basis.scalars[3], basis.rest, basis.scalars[4] == 1.0, tolerance if strict else CAUTION * tolerance,
        lone.bracket[j], 1.0 / search.compliance, None, lone.twist[j], None,
    )  # fmt: skip


@jit
def begin_search(lone, family, index, j, room):
    """Prepare the bounds of V and the elastic steps of the search, at the equilibrium under the dead load."""
    search = lone.search[j]
    put_vector(lone.joints.step[j], 0.0, 0.0, 0.0)
    lone.joints.tilt[j, 0] = lone.joints.tilt[j, 1] = 0.0
    basis = basis_of(lone.basis, j)
    certify(lone.joints, lone.points, lone.areas, (family, index, j), lone.unit[j], lone.dead[j], basis)
    search.strict = basis.scalars[0]
    mu = families.friction_of(lone.points, lone.areas, family, index)
    unit = basis.unit
    shear = sqrt(unit[0] ** 2 + unit[1] ** 2) + abs(unit[2]) / basis.scalars[2]
    lone.bracket[j, 0] = 0.0
    lone.bracket[j, 1] = NEVER
    if mu == 0.0 and shear > 0.0:
        lone.bracket[j, 1] = 0.0
        search.status = CONVERGED
        return
    if not (shear > 0.0 and basis.scalars[3] > 0.0):  # the load only presses, or the joint is not pressed
        search.status = LOST
        return
    newton_step(lone, j, 1.0, inf, lone.stiffness[j], room)  # the elastic response to the unit load
    for i in range(6):
        search.compliance += lone.unit[j, i] * room.change[i]
        search.driven += lone.unit[j, i] * lone.base[j, i]
    for i in range(6):
        lone.direction[j, i] = room.change[i] / search.compliance
    strength = max(mu, LEAST_FRICTION) * basis.scalars[3] / shear
    search.start = search.driven
    search.step = strength * search.compliance / ELASTIC_STEPS
    search.longest = search.step
    search.status = RUNNING
    for i in range(3):
        lone.seen[j, i, 3] = NEVER


@jit
def bounds_now(lone, family, index, j, certificate, v, moved, left):
    """Lower and upper bound of V at the present equilibrium, at ``v`` (N): strict; or else an indicator, by the present
    normal forces and a last step of the driven displacement ``moved`` (m), widened by the work of ``left``, the
    out-of-balance (N)."""
    if certificate.strict:
        return strict_bounds(certificate, lone, v)
    q = lone.joints.step[j]
    n = lone.joints.resultant[j, 0]
    excess = families.dissipation_now(lone.points, lone.areas, family, index, n, q[0], q[1], q[2])
    hidden = 0.0
    for i in range(3):
        hidden += lone.direction[j, i] ** 2 + (lone.reach[j] * lone.direction[j, i + 3]) ** 2
    hidden = left * sqrt(hidden)
    return v - hidden, max(v, v + (excess - shear_power(lone.joints, j)) / moved) + hidden


@jit
def update_bracket(lone, j, certificate, lower, upper, closing):
    """Update the bracket of joint ``j`` by the bounds of the present equilibrium; whether it is narrow enough.

    An indicator covers the equilibria since the joint had yielded half as far, and the change of V that its growth or
    fall in the meantime lets expect (`remaining_growth`). It counts once V grows far less than the elastic joint would
    let it, and no gap is ``closing``.
    """
    bracket = lone.bracket[j]
    limit = True
    if certificate.strict:
        bracket[0] = max(bracket[0], lower)
        bracket[1] = min(bracket[1], upper)
    else:
        early = lone.seen[j, 0]
        half = lone.seen[j, 1]
        now = lone.seen[j, 2]
        search = lone.search[j]
        if now[0] >= 2.0 * half[0] and now[0] > 0.0:
            for k in range(4):
                early[k] = half[k]
                half[k] = now[k]
        else:
            half[2] = min(half[2], now[2])
            half[3] = max(half[3], now[3])
        now[0] = search.driven - search.start - search.load * search.compliance
        now[1] = search.load
        now[2] = lower
        now[3] = upper
        growth = now[1] - half[1]
        more = AGAIN * remaining_growth(growth, half[1] - early[1])
        bracket[0] = max(0.0, min(half[2], lower) + min(more, 0.0))
        bracket[1] = max(half[3], upper) + max(more, 0.0)
        doubled = early[0] > 0.0 and now[0] >= 2.0 * half[0]
        slow = converges(growth, half[1] - early[1], now[1] - lower, now[1])
        limit = doubled and not closing and slow and growth <= STILL * (now[0] - half[0]) / search.compliance
    width = 2.0 * certificate.tolerance * bracket[0]
    return limit and bracket[1] - bracket[0] <= width and width > 0.0


@jit
def predict_rocking(lone, j, before, now, v_before, v, room):
    """Predict the next equilibrium of a convex joint that rocks; False if it does not rock.

    After an inelastic displacement g, the strip under pressure has the width c / sqrt(g), and its edge is closed by a
    multiple of sqrt(g): the motion is A g + B sqrt(g). From g to h its mean rate is A + B / (sqrt(g) + sqrt(h)),
    between the secant of the last step and the present tangent. ``before`` and ``now``: g at the last two equilibria,
    with V of ``v_before`` and ``v`` (N).
    """
    if not (0.0 < before < now and v_before < v):
        return False
    for i in range(6):
        room.forces[6, i] = lone.dead[j, i]
    if not newton_step(lone, j, 1.0, inf, room.tangent, room):
        return False
    along = 0.0
    for i in range(6):
        along += lone.unit[j, i] * room.change[i]
    if not along > 0.0:
        return False
    step = lone.search[j].step
    at_tangent = 0.5 / sqrt(now)
    at_secant = 1.0 / (sqrt(before) + sqrt(now))
    ahead = 1.0 / (sqrt(now) + sqrt(now + step))
    part = max((ahead - at_tangent) / (at_secant - at_tangent), -FURTHEST)
    for i in range(6):
        tangent = room.change[i] / along
        lone.direction[j, i] = tangent + part * (lone.direction[j, i] - tangent)
    return True


@jit
def follow(lone, family, index, j, most, tolerance, room):
    """Find the equilibrium of joint ``j`` under the dead load, and at most ``most`` more, until the bracket of V is
    within ``tolerance``."""
    search = lone.search[j]
    balanced = max(BALANCED * tolerance, LEAST_BALANCED)
    heaviest = UNLIMITED_BEYOND * size_of(lone.dead[j], lone.reach[j])
    last = search.equilibria + most
    while search.status <= RUNNING and search.equilibria < last + (search.status == RESTING):
        resting = search.status == RESTING
        step = search.step
        for i in range(6):
            room.motion[i] = lone.base[j, i] + step * lone.direction[j, i]
        target = inf if resting else search.driven + step
        found, v, slip, iterations, left = find_equilibrium(
            lone,
            family,
            index,
            j,
            search.load,
            target,
            LEAST_BALANCED if resting or search.strict == 1 else balanced,
            room,
        )
        search.iterations += iterations
        if not found and search.extrapolated == 1:
            search.extrapolated = 0
            for i in range(6):
                lone.direction[j, i] = lone.secant[j, i]
            continue
        if not found:
            search.step = 0.5 * step
            if search.step <= SHORTEST * search.longest:
                search.status = FALLS if resting else LOST
            continue
        if not resting:
            for i in range(6):
                lone.direction[j, i] = (room.motion[i] - lone.base[j, i]) / step
        closing = families.closes_gap(
            lone.points, lone.areas, family, index, lone.joints.gap[j], lone.base[j], room.motion
        )
        search.unbalanced = left / greatest_force(lone, j, room.forces[6])
        accept(lone, family, index, j, slip, room)
        if resting:
            begin_search(lone, family, index, j, room)
            continue
        slope = (v - search.load) / step
        search.load = v
        search.driven += step
        search.moved = step
        search.longest = max(search.longest, step)
        if v > search.peak:
            search.peak = v
            search.peak_at = search.driven
        search.equilibria += 1
        certificate = certificate_of(lone, family, index, j, tolerance)
        lower, upper = bounds_now(lone, family, index, j, certificate, v, step, left)
        if update_bracket(lone, j, certificate, lower, upper, closing):
            search.status = CONVERGED
        elif search.equilibria >= MOST_EQUILIBRIA:
            search.status = LOST
        elif v * size_of(lone.unit[j], lone.reach[j]) > heaviest:
            search.status = UNLIMITED
        if slope * search.compliance <= YIELDING and iterations <= EASY:
            search.step = (GROWTH if certificate.strict else DOUBLING) * step
        search.extrapolated = 0
        if families.pressure_retreats(lone.points, lone.areas, family) and not certificate.strict:
            for i in range(6):
                lone.secant[j, i] = lone.direction[j, i]
            given = search.driven - search.start - v * search.compliance
            before = given - step * (1.0 - slope * search.compliance)
            if predict_rocking(lone, j, before, given, v - slope * step, v, room):
                search.extrapolated = 1


@entry
def search_joints(first, last, lone, most, tolerance, room):
    """`follow` the joints ``first`` to ``last`` - 1, one after another."""
    family = families.only_family(lone.points, lone.areas)
    for j in range(first, last):
        follow(lone, family, j, j, most, tolerance, room)
