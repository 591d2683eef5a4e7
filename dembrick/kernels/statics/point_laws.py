"""Points of joints that are not dry, in searches and constant-rate tests: their forces and their losses. With strengths
by `kernels.joint.point_law.bonded_law`, or by a user-defined law, called by `kernels.joint.custom_law`.
"""

from dembrick._jit import jit
from dembrick.kernels.joint.custom_law import custom_law, shear_power
from dembrick.kernels.joint.dashpots import dashpot_work
from dembrick.kernels.joint.point_law import Bond, bonded_law, bonded_losses, shear_loss, slip_weight, spring_of


@jit
def bonded_force(strengths, bonds, points, p, i, here, viscous, energy):
    """Forces of point ``i`` of joint ``p`` by its strengths, for ``here``: its penetration, its growth in the step, and
    its slip (2). Updates its bond; returns N, N of the spring alone, the shear force (2), that of the spring (2), and
    the slip path of the step."""
    g, d, slip = here
    mu, k, k_n, area = points.friction[p], points.k_s[i], points.k_n[i], bonds.area[i]
    damped = 1.0 + viscous[1]
    bond = Bond((points.elastic_1[i], points.elastic_2[i]), bonds.bonded[i], bonds.crushed[i], bonds.rise[i])
    normal, spring, (t1, t2), slid, now = bonded_law(
        g, d, slip, (k_n, k), mu, (viscous[0], damped, 1.0 / damped), strengths, p, area, bond
    )
    bonds.bonded[i] = now.bonded
    bonds.crushed[i] = now.crushed
    bonds.rise[i] = now.rise
    bonds.spring[i] = spring
    if energy is not None:
        before = spring_of(strengths, p, k_n, g - d, area, bond)
        opened = normal == 0.0 and (bond.elastic[0] != 0.0 or bond.elastic[1] != 0.0)
        lost = bonded_losses(
            strengths, p, area, mu, k_n, d, (before, spring, normal),
            shear_loss(bond.elastic, now.elastic, slip, k), slid,
            (now.bonded < bond.bonded, now.crushed - bond.crushed, now.rise - bond.rise, opened),
        )  # fmt: skip
        energy.work[0].sliding += lost.friction
        energy.work[0].by_law += lost.by_law
        energy.work[0].least = min(energy.work[0].least, lost.friction)
        energy.work[0].crushing += lost.crushing
        energy.work[0].fracture += lost.fracture
        energy.work[0].damping += lost.released + lost.dash
    return normal, spring, t1, t2, now.elastic[0], now.elastic[1], slid


@jit
def custom_force(custom, i, here, viscous, energy):
    """`bonded_force` by a user-defined law; all energy that it does not store counts as friction."""
    g, d, slip = here
    normal, spring, t1, t2, e1, e2, slid, lost = custom_law(
        custom, i, g, d, slip[0], slip[1], viscous[0], viscous[1], False
    )
    if energy is not None:
        energy.work[0].sliding += lost
        energy.work[0].by_law += lost
    return normal, spring, t1, t2, e1, e2, slid


@jit
def point_force(strengths, bonds, custom, points, p, i, here, viscous, energy):
    """`bonded_force` by the law of the points; one of ``strengths`` and ``custom`` is None."""
    if custom is not None:
        answered = custom_force(custom, i, here, viscous, energy)
    if strengths is not None:
        answered = bonded_force(strengths, bonds, points, p, i, here, viscous, energy)
    return answered


@jit
def forces_not_dry(strengths, bonds, custom, points, p, motion, viscous, energy):
    """`point_joints.forces` of a joint in a scene that is not dry; its losses are summed point by point."""
    g0, gx, gy = motion.depth
    d0, dx, dy = motion.growth
    p1, p2, pr = motion.slip
    n = m1 = m2 = v1 = v2 = mt = rubbed = carried = 0.0
    still_n = still_1 = still_2 = c1 = c2 = cm = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        x = points.x_n[i]
        y = points.y_n[i]
        xs = points.x_s[i]
        ys = points.y_s[i]
        here = g0 + gy * y + gx * x, d0 + dy * y + dx * x, (p1 - pr * ys, p2 + pr * xs)
        normal, spring, t1, t2, e1, e2, slid = point_force(
            strengths, bonds, custom, points, p, i, here, viscous, energy
        )
        points.normal[i] = normal
        points.elastic_1[i] = e1
        points.elastic_2[i] = e2
        n += normal
        m1 -= y * normal
        m2 += x * normal
        v1 += t1
        v2 += t2
        mt += xs * t2 - ys * t1
        points.slip[i] += slid
        weight = slip_weight(normal, t1, t2)
        rubbed += weight * slid
        carried += weight
        if energy is not None:
            still_n += spring
            still_1 -= y * spring
            still_2 += x * spring
            c1 += t1 - e1
            c2 += t2 - e2
            cm += xs * (t2 - e2) - ys * (t1 - e1)
    if rubbed > 0.0:
        points.path[p] += rubbed / carried
    if energy is not None:
        energy.work[0].damping += 0.5 * dashpot_work(
            energy.dash[points.joint[p]], (c1, c2, cm), (n - still_n, m1 - still_1, m2 - still_2), motion
        )
    return n, v1, v2, mt, m1, m2, points.path[p]


@jit
def power_taken(custom, points, p, q1, q2, qr):
    """Work of the shear forces of point joint ``p`` on a twist (N m for m, m, rad)."""
    total = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        total += shear_power(custom, i, q1 - qr * points.y_s[i], q2 + qr * points.x_s[i])
    return total
