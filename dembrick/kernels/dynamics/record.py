"""The record of a run in real time: resultants of the joints, and the out-of-balance forces."""

from math import isnan, nan, sqrt

from dembrick._jit import jit
from dembrick.kernels.dynamics import joint_families as families
from dembrick.kernels.dynamics.tiles import ACTION, W, sense_of, three, wrench_at
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.math.vectors import cross, rows_times


@jit
def write_resultants(bodies, links, corners, faces, out):
    """N, V_1, V_2, M_T, M_1, M_2 (action on b about O) and slip of every joint into ``out`` (j, 7), of the last forces.

    The axes are t1, that of the host laid into the plane, t2 and the normal from a to b; slip is the length of its
    path, averaged over the points of a joint by their areas (m).
    """
    for j in range(links.host.size):
        u = links.axes[links.plane[j]]
        R = bodies.rotation[links.other[j]]
        u1, u2, u3 = rows_times(R, u[0, 0], u[0, 1], u[0, 2])
        w1, w2, w3 = rows_times(R, u[1, 0], u[1, 1], u[1, 2])
        n1, n2, n3 = cross(u1, u2, u3, w1, w2, w3)
        R = bodies.rotation[links.host[j]]
        t = links.axes[links.tangents[j]]
        x1, x2, x3 = rows_times(R, t[0, 0], t[0, 1], t[0, 2])
        y1, y2, y3 = rows_times(R, t[1, 0], t[1, 1], t[1, 2])
        z1, z2, z3 = cross(x1, x2, x3, y1, y2, y3)
        l1, l2, l3 = three(links.tiles[links.place[j] // W].lever, links.place[j] % W)
        r1 = l1 * x1 + l2 * y1 + l3 * z1
        r2 = l1 * x2 + l2 * y2 + l3 * z2
        r3 = l1 * x3 + l2 * y3 + l3 * z3
        along = x1 * n1 + x2 * n2 + x3 * n3
        x1 -= along * n1
        x2 -= along * n2
        x3 -= along * n3
        size = sqrt(x1 * x1 + x2 * x2 + x3 * x3)
        x1 /= size
        x2 /= size
        x3 /= size
        y1, y2, y3 = cross(n1, n2, n3, x1, x2, x3)
        wrench = links.wrenches[wrench_at(links, j)]
        c1, c2, c3 = cross(r1, r2, r3, wrench[0], wrench[1], wrench[2])
        # the wrench acts on the host, which is b where sense is +1; the joint holds b against V and M
        sense = sense_of(links, j)
        f1 = sense * wrench[0]
        f2 = sense * wrench[1]
        f3 = sense * wrench[2]
        m1 = sense * (wrench[3] - c1)
        m2 = sense * (wrench[4] - c2)
        m3 = sense * (wrench[5] - c3)
        out[j, 0] = n1 * f1 + n2 * f2 + n3 * f3
        out[j, 1] = -(x1 * f1 + x2 * f2 + x3 * f3)
        out[j, 2] = -(y1 * f1 + y2 * f2 + y3 * f3)
        out[j, 3] = -(n1 * m1 + n2 * m2 + n3 * m3)
        out[j, 4] = -(x1 * m1 + x2 * m2 + x3 * m3)
        out[j, 5] = -(y1 * m1 + y2 * m2 + y3 * m3)
    for family in range(FAMILIES):
        for i in range(joint_count(corners, faces, family)):
            out[joint_of(corners, faces, family, i), 6] = families.mean_slip(corners, faces, family, i)


@jit
def unbalanced_ratio(bodies, links, g1, g2, g3):
    """Greatest out-of-balance force on a free block under gravity g, over the greatest joint force; 1 without any.

    NaN if a force is one, which no greatest value would show.
    """
    worst = largest = total = 0.0
    wrenches = links.wrenches
    for f in range(bodies.free.size):
        b = bodies.free[f]
        f1 = bodies.mass[b] * g1 + bodies.applied[b, 0]
        f2 = bodies.mass[b] * g2 + bodies.applied[b, 1]
        f3 = bodies.mass[b] * g3 + bodies.applied[b, 2]
        for k in range(bodies.side_start[b], bodies.side_start[b + 1]):
            w = (bodies.side[k] >> 1) * ACTION
            sign = 1.0 if bodies.side[k] & 1 else -1.0
            f1 += sign * wrenches[w]
            f2 += sign * wrenches[w + 1]
            f3 += sign * wrenches[w + 2]
        out = f1 * f1 + f2 * f2 + f3 * f3
        worst, total = max(worst, out), total + out
    for j in range(links.host.size):
        w = links.place[j] * ACTION
        largest = max(largest, wrenches[w] ** 2 + wrenches[w + 1] ** 2 + wrenches[w + 2] ** 2)
    if isnan(total):
        return nan
    return sqrt(worst / largest) if largest > 0.0 else 1.0
