"""Points of joints with a law of the user's own, in searches and constant-rate tests. The law is called by
`kernels.joint.custom_law`.
"""

from dembrick._jit import jit
from dembrick.kernels.joint.custom_law import custom_law, shear_power
from dembrick.kernels.state import BY_LAW, DAMPING, SLIDING
from dembrick.kernels.statics.dashpots import dashpot_work


@jit
def custom_forces(custom, points, p, motion, viscous, energy):
    """`point_joints.forces` of a joint with a law of the user's own; all that it does not hold counts as friction."""
    g0, gx, gy = motion.depth
    d0, dx, dy = motion.growth
    p1, p2, pr = motion.slip
    n = m1 = m2 = v1 = v2 = mt = slip = weight = 0.0
    still_n = still_1 = still_2 = c1 = c2 = cm = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        x = points.x_n[i]
        y = points.y_n[i]
        xs = points.x_s[i]
        ys = points.y_s[i]
        k = points.k_s[i]
        g = g0 + gy * y + gx * x
        d = d0 + dy * y + dx * x
        normal, spring, t1, t2, e1, e2, slid, lost = custom_law(
            custom, i, g, d, p1 - pr * ys, p2 + pr * xs, viscous[0], viscous[1]
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
        slip += k * points.slip[i]
        weight += k
        if energy is not None:
            still_n += spring
            still_1 -= y * spring
            still_2 += x * spring
            c1 += t1 - e1
            c2 += t2 - e2
            cm += xs * (t2 - e2) - ys * (t1 - e1)
            energy.work[SLIDING] += lost
            energy.work[BY_LAW] += lost
    if energy is not None:
        energy.work[DAMPING] += 0.5 * dashpot_work(
            energy.dash[points.joint[p]], (c1, c2, cm), (n - still_n, m1 - still_1, m2 - still_2), motion
        )
    return n, v1, v2, mt, m1, m2, slip / weight


@jit
def power_taken(custom, points, p, q1, q2, qr):
    """What the shear forces of point joint ``p`` take of a twist (N m for m, m, rad)."""
    total = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        total += shear_power(custom, i, q1 - qr * points.y_s[i], q2 + qr * points.x_s[i])
    return total
