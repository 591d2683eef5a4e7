"""Points of joints with a law of the user's own, in real time. The law is called by `kernels.joint.custom_law`."""

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import W, put_three, three, two
from dembrick.kernels.joint.custom_law import Custom, custom_law, energy_held


@jit
def rows_of(custom, point):
    """The rows of two points in `Corners.custom`, from number ``point`` on; None without any."""
    if custom is None:
        return None
    first, last = point * W, (point + 2) * W
    move, record, memory, answer = custom.move, custom.record, custom.memory, custom.answer
    return Custom(move[first:last], record[first:last], memory[first:last], custom.at, answer[first:last])


@jit
def answer_custom(work, pair, which, lane, arm, energy, force_out, custom, ledger):
    """`point_joints.answer` of a point with a law of the user's own, the ``which`` of the two of ``custom``. All that
    it does not hold counts as friction, in the ``ledger`` of its tile."""
    own, sheared = pair
    x = own[which].x[lane]
    y = own[which].y[lane]
    g0, gx, gy = three(work.depth, lane)
    d0, dx, dy = three(work.growth, lane)
    xs = arm * x
    ys = arm * y
    work.slid[which, lane] = 0.0
    if own[which].area[lane] == 0.0:  # no point, or one that was retired
        if force_out is not None:
            put_three(work.last[which], lane, (0.0, 0.0, 0.0))
        return x, y, xs, ys, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False
    p1, p2 = two(work.slip, lane)
    x1, x2 = two(work.slip_x, lane)
    y1, y2 = two(work.slip_y, lane)
    normal, spring, t1, t2, e1, e2, slid, lost = custom_law(
        custom, which * W + lane, g0 + x * gx + y * gy, d0 + x * dx + y * dy,
        p1 + xs * x1 + ys * y1, p2 + xs * x2 + ys * y2, work.normal[lane], work.damped[lane] - 1.0,
    )  # fmt: skip
    sheared[which].elastic[0, lane] = e1
    sheared[which].elastic[1, lane] = e2
    work.slid[which, lane] = slid
    if energy is not None:
        ledger.friction[lane] += lost
        ledger.by_law[lane] += lost
    if force_out is not None:
        put_three(work.last[which], lane, (t1, t2, normal))
    return x, y, xs, ys, t1, t2, normal, t1 - e1, t2 - e2, normal - spring, slid > 0.0


@jit
def energy_of(custom, corners, p):
    """Energy (J) that the points of joint ``p`` hold."""
    total = 0.0
    for i in range(corners.start[p + 1] - corners.start[p]):
        place = corners.place[p] + i * W
        if corners.points[place // W].area[place % W] > 0.0:
            total += energy_held(custom, place)
    return total
