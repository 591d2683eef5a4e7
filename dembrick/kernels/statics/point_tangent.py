"""The tangent of dry contact points: derivatives of the forces of a point joint with respect to its motion."""

from dembrick._jit import jit


@jit
def exact_tangent(strengths, custom, points, memory, p, out):
    """`dry_tangent`; False if the points have strengths or a user-defined law."""
    if strengths is not None:
        return False
    if custom is not None:
        return False
    dry_tangent(points, memory, p, out)
    return True


@jit
def dry_tangent(points, memory, p, out):
    """dt/du (6, 6) of `kernels.statics.newton` of point joint ``p`` into ``out``, at the result of `forces` from
    ``memory``, undamped.

    A point has the penetration g = -dn - y r1 + x r2 and slips by (d1 - rn y_s, d2 + rn x_s). If it sticks it carries
    t = e + k s; if it slides, t = c n with the trial force T = e + k s, n = T / |T| and c = mu N, hence dt = (c / |T|)
    k (1 - n n) ds + mu n dN.
    """
    for i in range(6):
        for k in range(6):
            out[i, k] = 0.0
    mu = points.friction[p]
    for i in range(points.start[p], points.start[p + 1]):
        normal = points.normal[i]
        if not normal > 0.0:
            continue
        x = points.x_n[i]
        y = points.y_n[i]
        k_n = points.k_n[i]
        out[2, 2] += k_n
        out[2, 3] += k_n * y
        out[2, 4] -= k_n * x
        out[3, 3] += k_n * y * y
        out[3, 4] -= k_n * x * y
        out[4, 4] += k_n * x * x
        xs = points.x_s[i]
        ys = points.y_s[i]
        k = points.k_s[i]
        slid = points.slip[i] - memory.slip[i]
        k11 = k22 = k
        k12 = 0.0
        if slid > 0.0:
            cap = mu * normal
            k11 = k22 = 0.0
            if cap > 0.0:
                n1 = points.elastic_1[i] / cap
                n2 = points.elastic_2[i] / cap
                kept = k * cap / (cap + k * slid)
                k11 = kept * (1.0 - n1 * n1)
                k22 = kept * (1.0 - n2 * n2)
                k12 = -kept * n1 * n2
                # N grows by -k_n dn - k_n y r1 + k_n x r2
                mt = xs * n2 - ys * n1
                for column, grown in ((2, -mu * k_n), (3, -mu * k_n * y), (4, mu * k_n * x)):
                    out[0, column] += grown * n1
                    out[1, column] += grown * n2
                    out[5, column] += grown * mt
        # slip (d1 - rn y_s, d2 + rn x_s); M_T = x_s t2 - y_s t1
        r1 = k12 * xs - k11 * ys
        r2 = k22 * xs - k12 * ys
        out[0, 0] += k11
        out[0, 1] += k12
        out[1, 1] += k22
        out[0, 5] += r1
        out[1, 5] += r2
        out[5, 5] += xs * r2 - ys * r1
    out[1, 0] = out[0, 1]
    out[5, 0] = out[0, 5]
    out[5, 1] = out[1, 5]
    out[3, 2] = out[2, 3]
    out[4, 2] = out[2, 4]
    out[4, 3] = out[3, 4]
