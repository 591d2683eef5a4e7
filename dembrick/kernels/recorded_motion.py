"""Blocks and joints of a recorded run in many frames at once: for pictures and exports, with no part in a simulation.

Quaternions (w, x, y, z) keep the digits of small rotations, rotation matrices do not. Frames f stand in front.
"""

from math import nan, sqrt

from dembrick._jit import entry, jit
from dembrick.kernels.math.quaternion import product, turning
from dembrick.kernels.math.vec3 import columns_times, cross, rows_times

# Of a joint's size: an opening below it is rounding.
TOUCHING = 1e-12
# Of a joint's size: an increment below it is rounding.
STILL = 1e-13
# Of the slip at the joint's rim: a part of an increment that is not there.
PURE = 1e-7
# The states of a joint.
CLOSED = 0
PARTLY_OPEN = 1
OPEN = 2


@entry
def carry(body, block, rotation, shift, points_out):
    """Points ``body`` (n, 3) in the axes of ``block`` (n,) under rotations (f, n_block, 3, 3) and shifts
    (f, n_block, 3) of the blocks, as ``points_out`` (f, n, 3)."""
    for k in range(shift.shape[0]):
        for i in range(block.size):
            b = block[i]
            p1, p2, p3 = rows_times(rotation[k, b], body[i, 0], body[i, 1], body[i, 2])
            points_out[k, i, 0] = p1 + shift[k, b, 0]
            points_out[k, i, 1] = p2 + shift[k, b, 1]
            points_out[k, i, 2] = p3 + shift[k, b, 2]


@entry
def ride(displacement, orientation, back, block_a, arm, origin, axes, origin_out, axes_out):
    """The points O (f, j, 3) of the blocks a and the joints' axes (f, j, 3, 3) as rows, world.

    ``displacement`` (f, n_block, 3), ``orientation`` (f, n_block, 4), ``back`` (n_block, 4): the inverse orientation
    at the start, when O stood at ``origin`` (j, 3), ``arm`` (j, 3) from the centroid of a, and the axes were ``axes``.
    """
    for k in range(displacement.shape[0]):
        for j in range(block_a.size):
            a = block_a[j]
            q = orientation[k, a]
            p = back[a]
            w, x, y, z = product(q[0], q[1], q[2], q[3], p[0], p[1], p[2], p[3])
            r1, r2, r3 = turning(w, x, y, z, arm[j, 0], arm[j, 1], arm[j, 2])
            origin_out[k, j, 0] = origin[j, 0] + displacement[k, a, 0] + r1
            origin_out[k, j, 1] = origin[j, 1] + displacement[k, a, 1] + r2
            origin_out[k, j, 2] = origin[j, 2] + displacement[k, a, 2] + r3
            for i in range(3):
                v = axes[j, i]
                r1, r2, r3 = turning(w, x, y, z, v[0], v[1], v[2])
                axes_out[k, j, i, 0] = v[0] + r1
                axes_out[k, j, i, 1] = v[1] + r2
                axes_out[k, j, i, 2] = v[2] + r3


@entry
def ride_in_plane(displacement, orientation, back, host, other, arm, origin, axes, shift, origin_out, axes_out):
    """The points O (f, j, 3) where resultants act, and their axes (f, j, 3, 3) as rows, world.

    As `ride`, but O rides on the ``host`` of the polygon, ``shift`` (f, j, 2) away from where it was on it, along its
    tangents; the normal is that of the ``other``'s face, and t1 that of the host laid into its plane.
    """
    for k in range(displacement.shape[0]):
        for j in range(host.size):
            h = host[j]
            q = orientation[k, h]
            p = back[h]
            w, x, y, z = product(q[0], q[1], q[2], q[3], p[0], p[1], p[2], p[3])
            t = axes[j, 0]
            s1 = shift[k, j, 0] * t[0] + shift[k, j, 1] * axes[j, 1, 0]
            s2 = shift[k, j, 0] * t[1] + shift[k, j, 1] * axes[j, 1, 1]
            s3 = shift[k, j, 0] * t[2] + shift[k, j, 1] * axes[j, 1, 2]
            r1, r2, r3 = turning(w, x, y, z, arm[j, 0] + s1, arm[j, 1] + s2, arm[j, 2] + s3)
            origin_out[k, j, 0] = origin[j, 0] + s1 + displacement[k, h, 0] + r1
            origin_out[k, j, 1] = origin[j, 1] + s2 + displacement[k, h, 1] + r2
            origin_out[k, j, 2] = origin[j, 2] + s3 + displacement[k, h, 2] + r3
            t1, t2, t3 = turning(w, x, y, z, t[0], t[1], t[2])
            t1 += t[0]
            t2 += t[1]
            t3 += t[2]
            o = other[j]
            q = orientation[k, o]
            p = back[o]
            w, x, y, z = product(q[0], q[1], q[2], q[3], p[0], p[1], p[2], p[3])
            n = axes[j, 2]
            n1, n2, n3 = turning(w, x, y, z, n[0], n[1], n[2])
            n1 += n[0]
            n2 += n[1]
            n3 += n[2]
            along = t1 * n1 + t2 * n2 + t3 * n3
            t1 -= along * n1
            t2 -= along * n2
            t3 -= along * n3
            size = sqrt(t1 * t1 + t2 * t2 + t3 * t3)
            out = axes_out[k, j]
            out[0, 0] = t1 / size
            out[0, 1] = t2 / size
            out[0, 2] = t3 / size
            out[1, 0], out[1, 1], out[1, 2] = cross(n1, n2, n3, out[0, 0], out[0, 1], out[0, 2])
            out[2, 0] = n1
            out[2, 1] = n2
            out[2, 2] = n3


@entry
def relative_motions(
    displacement, orientation, back, block_a, block_b, on_b, arm_a, arm_b, axes, turned, shift_out, turn_out, plane_out
):
    """Motion of b against a since the start, in the joint's axes riding on a.

    ``displacement`` (f, n_block, 3), ``orientation`` (f, n_block, 4), ``back`` (n_block, 4): the inverse orientation
    at the start, ``on_b`` (j,): whether the polygon rides on b, ``turned`` (n_block, 4): scratch. Outputs (f, j, 3)
    shift from the point O of a to the point O of b, (f, j, 4) quaternion of b, (f, j, 3) the opening as a linear
    function: its value at O and its slopes along t1 and t2.
    """
    for k in range(displacement.shape[0]):
        for i in range(back.shape[0]):
            q = orientation[k, i]
            turned[i, 0], turned[i, 1], turned[i, 2], turned[i, 3] = product(
                q[0], q[1], q[2], q[3], back[i, 0], back[i, 1], back[i, 2], back[i, 3]
            )
        for j in range(block_a.size):
            a = block_a[j]
            b = block_b[j]
            qa = turned[a]
            qb = turned[b]
            a1, a2, a3 = turning(qa[0], qa[1], qa[2], qa[3], arm_a[j, 0], arm_a[j, 1], arm_a[j, 2])
            b1, b2, b3 = turning(qb[0], qb[1], qb[2], qb[3], arm_b[j, 0], arm_b[j, 1], arm_b[j, 2])
            s1 = displacement[k, b, 0] - displacement[k, a, 0] + b1 - a1
            s2 = displacement[k, b, 1] - displacement[k, a, 1] + b2 - a2
            s3 = displacement[k, b, 2] - displacement[k, a, 2] + b3 - a3
            r1, r2, r3 = turning(qa[0], -qa[1], -qa[2], -qa[3], s1, s2, s3)
            s1, s2, s3 = rows_times(axes[j], s1 + r1, s2 + r2, s3 + r3)
            w, x, y, z = product(qa[0], -qa[1], -qa[2], -qa[3], qb[0], qb[1], qb[2], qb[3])
            x, y, z = rows_times(axes[j], x, y, z)
            shift_out[k, j, 0] = s1
            shift_out[k, j, 1] = s2
            shift_out[k, j, 2] = s3
            turn_out[k, j, 0] = w
            turn_out[k, j, 1] = x
            turn_out[k, j, 2] = y
            turn_out[k, j, 3] = z
            # along the normal of the face that the polygon does not ride on; R turns b, n = (0, 0, 1)
            if on_b[j]:  # n . (s + R p)
                plane_out[k, j, 0] = s3
                plane_out[k, j, 1] = 2.0 * (x * z - w * y)
                plane_out[k, j, 2] = 2.0 * (y * z + w * x)
            else:  # (s - p) . R n
                n1 = 2.0 * (x * z + w * y)
                n2 = 2.0 * (y * z - w * x)
                plane_out[k, j, 0] = s3 + s1 * n1 + s2 * n2 - s3 * 2.0 * (x * x + y * y)
                plane_out[k, j, 1] = -n1
                plane_out[k, j, 2] = -n2


@jit
def positive_area(corners, plane, less):
    """Area of the part of a convex polygon (m, 2) where the linear function ``plane`` (3,) exceeds ``less``."""
    m = corners.shape[0]
    area = base1 = base2 = 0.0
    found = False
    px = corners[m - 1, 0]
    py = corners[m - 1, 1]
    at_p = plane[0] + plane[1] * px + plane[2] * py - less
    for lap in range(2):  # the first finds a point of the cut: seen from there, the cut itself spans no area
        for i in range(m):
            qx = corners[i, 0]
            qy = corners[i, 1]
            at_q = plane[0] + plane[1] * qx + plane[2] * qy - less
            x1 = px
            y1 = py
            x2 = qx
            y2 = qy
            if (at_p > 0.0) != (at_q > 0.0):
                t = at_p / (at_p - at_q)
                cx = px + t * (qx - px)
                cy = py + t * (qy - py)
                if not found:
                    base1 = cx
                    base2 = cy
                    found = True
                if at_p > 0.0:
                    x2 = cx
                    y2 = cy
                else:
                    x1 = cx
                    y1 = cy
            if lap == 1 and (at_p > 0.0 or at_q > 0.0):
                area += (x1 - base1) * (y2 - base2) - (y1 - base2) * (x2 - base1)
            px = qx
            py = qy
            at_p = at_q
    return 0.5 * area


@entry
def openings(plane, polygon, size, area, opening_out, state_out, share_out):
    """Distance of the faces at the corners of the polygons (j, m, 2), from the ``plane`` of `relative_motions`.

    Outputs (f, j, m) m, negative where the faces press; (f, j) the state; (f, j) the part of the joint's area over
    which they are apart by more than rounding. Joints with fewer than m corners repeat the last one.
    """
    m = polygon.shape[1]
    for k in range(plane.shape[0]):
        for j in range(size.size):
            p = plane[k, j]
            rounding = TOUCHING * size[j]
            apart = 0
            for i in range(m):
                opening = p[0] + p[1] * polygon[j, i, 0] + p[2] * polygon[j, i, 1]
                opening_out[k, j, i] = opening
                if opening > rounding:
                    apart += 1
            if apart == 0:
                state_out[k, j] = CLOSED
                share_out[k, j] = 0.0
            elif apart == m:
                state_out[k, j] = OPEN
                share_out[k, j] = 1.0
            else:
                state_out[k, j] = PARTLY_OPEN
                share_out[k, j] = positive_area(polygon[j], p, rounding) / area[j]


@entry
def torsion_centres(shift, turn, shift_end, turn_end, size, centre_out):
    """Where b turned about from one motion (f, j) to another: (f, j, 2) from O in the joint's axes riding on a.

    The fixed point of a plane rotation by delta about c: c = middle of the shifts + cot(delta / 2) / 2 times the
    increment turned by a right angle; cot(delta / 2) = w / z of the quaternion. NaN if nothing moved, where the
    increment is pure shear, and where it is mostly a tilt.
    """
    for k in range(shift.shape[0]):
        for j in range(size.size):
            p = turn[k, j]
            q = turn_end[k, j]
            w, x, y, z = product(q[0], q[1], q[2], q[3], p[0], -p[1], -p[2], -p[3])
            step1 = shift_end[k, j, 0] - shift[k, j, 0]
            step2 = shift_end[k, j, 1] - shift[k, j, 1]
            turned = 2.0 * abs(z) * size[j]
            shifted = sqrt(step1 * step1 + step2 * step2)
            tilted = 2.0 * sqrt(x * x + y * y) * size[j]
            if turned > PURE * shifted and turned > STILL * size[j] and tilted <= max(turned, shifted):
                half = 0.5 * w / z
                centre_out[k, j, 0] = shift[k, j, 0] + 0.5 * step1 - half * step2
                centre_out[k, j, 1] = shift[k, j, 1] + 0.5 * step2 + half * step1
            else:
                centre_out[k, j, 0] = nan
                centre_out[k, j, 1] = nan


@entry
def normal_parts(force, axes, start, normal_out):
    """Normal forces (f, c) N, none of them negative, of the forces (f, c, 3) on b in the contact points.

    Joint j has the points ``start[j]:start[j + 1]`` and the ``axes`` (f, j, 3, 3).
    """
    for k in range(axes.shape[0]):
        for j in range(axes.shape[1]):
            n = axes[k, j, 2]
            for i in range(start[j], start[j + 1]):
                f = force[k, i]
                normal_out[k, i] = max(f[0] * n[0] + f[1] * n[1] + f[2] * n[2], 0.0)


@entry
def shared_normals(plane, whole, start, arm, area, normal_out):
    """Normal forces (f, c) N in points at ``arm`` (c, 2): the joint's N, ``whole`` (f, j), shared by tributary area
    and penetration (see ``plane`` of `relative_motions`), by area alone where no point is pressed."""
    for k in range(plane.shape[0]):
        for j in range(plane.shape[1]):
            p = plane[k, j]
            pressed = total = 0.0
            for i in range(start[j], start[j + 1]):
                share = area[i] * max(-(p[0] + p[1] * arm[i, 0] + p[2] * arm[i, 1]), 0.0)
                normal_out[k, i] = share
                pressed += share
                total += area[i]
            for i in range(start[j], start[j + 1]):
                if pressed > 0.0:
                    normal_out[k, i] *= whole[k, j] / pressed
                else:
                    normal_out[k, i] = whole[k, j] * area[i] / total


@entry
def resultant_points(resultant, origin, axes, force_out, point_out):
    """The force on b (f, j, 3) N in the world of N, V_1, V_2, M_T, M_1, M_2 ..., ``resultant`` (f, j, 7), and where
    it passes through the plane of the joint: (f, j, 3) m, at O where the joint carries no N."""
    for k in range(resultant.shape[0]):
        for j in range(resultant.shape[1]):
            r = resultant[k, j]
            e1 = e2 = 0.0
            if r[0] > 0.0:
                e1 = r[5] / r[0]
                e2 = -r[4] / r[0]
            # the joint holds b against V_1 and V_2 and carries it with N
            f1, f2, f3 = columns_times(axes[k, j], -r[1], -r[2], r[0])
            p1, p2, p3 = columns_times(axes[k, j], e1, e2, 0.0)
            force_out[k, j, 0] = f1
            force_out[k, j, 1] = f2
            force_out[k, j, 2] = f3
            point_out[k, j, 0] = origin[k, j, 0] + p1
            point_out[k, j, 1] = origin[k, j, 1] + p2
            point_out[k, j, 2] = origin[k, j, 2] + p3
