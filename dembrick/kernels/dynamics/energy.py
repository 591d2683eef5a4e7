"""Energy balance of a run in real time: every term is integrated by itself, none is a residual.

Central differences balance exactly in this form: with the kinetic energy v(-1/2) M v(+1/2) / 2 at the instant of the
forces, its change over a step is the work of all forces by the trapezoidal rule over the motion of the step. So the
energies are those of the last forces, one step before the present positions of the blocks. Over a step in which the
slip or the closing of a contact grows by s, the work of a spring is (e + e') s / 2 and that of a dashpot (d + d') s /
2; a slip of q loses (e + e') q / 2. For a normal spring that opens or closes within a step, this work differs from the
energy stored by (<g>+ g' - <g'>+ g) k / 2, of the order of the square of the step. That is an error of the step, not
friction; it has its own term.
"""

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics import joint_families as families
from dembrick.kernels.dynamics.block_loads import multiplier_on
from dembrick.kernels.dynamics.rigid_bodies import gathered
from dembrick.kernels.dynamics.tiles import W, combined, dot, four, offset_of, sense_of, three
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.joint.ties import tie_losses
from dembrick.kernels.math.vectors import add_wrench, axes_of, cross, product, put_vector, rotate


@jit
def collect_losses(energy_terms, links, j):
    """Move the losses of a joint into its own energy terms, before its share changes."""
    share = energy_terms.share[j]
    ledger = energy_terms.ledger[links.place[j] // W]
    lane = links.place[j] % W
    energy_terms.damped[j] += share * ledger.dashpots[lane]
    energy_terms.least[j] = min(energy_terms.least[j], share * ledger.smallest[lane])
    lost = energy_terms.lost[j]
    lost.friction += share * ledger.friction[lane]
    lost.released += share * ledger.released[lane]
    lost.stepping += share * ledger.stepping[lane]
    lost.by_law += share * ledger.by_law[lane]
    lost.crushing += share * ledger.crushing[lane]
    lost.fracture += share * ledger.fracture[lane]
    ledger.dashpots[lane] = ledger.smallest[lane] = ledger.friction[lane] = ledger.released[lane] = 0.0
    ledger.stepping[lane] = ledger.by_law[lane] = ledger.crushing[lane] = ledger.fracture[lane] = 0.0


@entry
def collect_all_losses(energy_terms, links):
    """`collect_losses` for all joints."""
    for j in range(energy_terms.share.size):
        collect_losses(energy_terms, links, j)


@entry
def spring_energies(links, corners, faces, held_out, energy_out):
    """Energy (j,) J in the springs of every joint; for convex joints also N and its x and y moments (a, 3)."""
    for family in range(FAMILIES):
        for i in range(joint_count(corners, faces, family)):
            j = joint_of(corners, faces, family, i)
            energy_out[j] = families.spring_energy(links, corners, faces, family, i, held_out)


@jit
def seen_now(links, bodies, j):
    """`Links.seen` (9) of joint ``j`` at the present positions of the blocks."""
    tile = links.tiles[links.place[j] // W]
    lane = links.place[j] % W
    host, other = links.host[j], links.other[j]
    q, x = bodies.orientation, bodies.position
    p = product(q[other, 0], q[other, 1], q[other, 2], q[other, 3], *four(tile.plane, lane))
    t = product(q[host, 0], q[host, 1], q[host, 2], q[host, 3], *four(tile.tangents, lane))
    u, w, m = axes_of(p)
    e, g, n = axes_of(product(p[0], -p[1], -p[2], -p[3], *t))
    r = combined(three(tile.lever, lane), (0.0, 0.0, 0.0), e, g, n)
    d = x[host, 0] - x[other, 0], x[host, 1] - x[other, 1], x[host, 2] - x[other, 2]
    return (dot(d, u) + r[0], dot(d, w) + r[1], dot(d, m) + r[2], *e, *g)


@jit
def step_of_feet(offset, now, step):
    """Displacement (9) of the feet of points in the plane, where friction acts, by a ``step`` (9) from ``now``, all in
    the form of `Links.seen`; and the rotation about the plane's normal (rad)."""
    o = now[2] + 0.5 * step[2] - offset
    u1, u2, u3 = now[3] + 0.5 * step[3], now[4] + 0.5 * step[4], now[5] + 0.5 * step[5]
    r1, r2, r3 = cross(u1, u2, u3, step[3], step[4], step[5])
    about = dot((u1, u2, u3), cross(now[6], now[7], now[8], step[6], step[7], step[8]))  # r lacks the rotation about u
    r1 += about * u1
    r2 += about * u2
    r3 += about * u3
    v = now[8] + 0.5 * step[8]
    return (
        (step[0] - o * r2, step[1] + o * r1, step[2],
         step[3] - u3 * r2, step[4] + u3 * r1, step[5],
         step[6] - v * r2, step[7] + v * r1, step[8]),
        r3,
    )  # fmt: skip


@entry
def work_ahead(links, corners, faces, bodies, held, places, joints, worked):
    """Work (k,) in J on the springs of ``joints`` (k,) over the step since the last forces, if these stayed constant,
    into ``worked``; ``held``: see `spring_energies`, ``places``: `EnergyTerms.place`."""
    for i in range(joints.size):
        j = joints[i]
        seen = links.seen_tiles[links.place[j] // W]
        lane = links.place[j] % W
        now = (*three(seen.origin, lane), *three(seen.first, lane), *three(seen.second, lane))
        then = seen_now(links, bodies, j)
        step = (
            then[0] - now[0], then[1] - now[1], then[2] - now[2],
            then[3] - now[3], then[4] - now[4], then[5] - now[5],
            then[6] - now[6], then[7] - now[7], then[8] - now[8],
        )  # fmt: skip
        slip, turn = step_of_feet(offset_of(links, j), now, step)
        family, index = families.family_of(places[j])
        more = held, sense_of(links, j), offset_of(links, j), now, step, slip, turn
        worked[i] = families.work_ahead(corners, faces, family, index, *more)


@entry
def kinetic_energy(bodies, wrenches, g1, g2, g3, dt):
    """v(-1/2) M v(+1/2) / 2 of all free blocks (J), after the step; ``wrenches`` and loads are those of the step, g its
    gravity."""
    twice = 0.0
    for f in range(bodies.free.size):
        b = bodies.free[f]
        mass = bodies.mass[b]
        f1, f2, f3, t1, t2, t3 = gathered(bodies, b, wrenches, True, g1, g2, g3)
        v = bodies.velocity[b]
        w = bodies.spin[b]
        L = bodies.momentum[b]
        twice += v[0] * (mass * v[0] - dt * f1) + v[1] * (mass * v[1] - dt * f2) + v[2] * (mass * v[2] - dt * f3)
        twice += w[0] * (L[0] - dt * t1) + w[1] * (L[1] - dt * t2) + w[2] * (L[2] - dt * t3)
    return 0.5 * twice


@jit
def power(bodies, b, force):
    """Power (W) of a force and a couple (6,) at the centroid of block ``b``."""
    v = bodies.velocity[b]
    w = bodies.spin[b]
    return force[0] * v[0] + force[1] * v[1] + force[2] * v[2] + force[3] * w[0] + force[4] * w[1] + force[5] * w[2]


@jit
def add_load_work(energy_terms, bodies, loads, step, dt):
    """Add the work of the loads and pressures over the last step."""
    total = 0.0
    n_force = loads.block.size
    for k in range(n_force):
        b = loads.block[k]
        f = loads.force[step, k]
        last = energy_terms.load[k]
        total += power(bodies, b, last)
        r1, r2, r3 = rotate(bodies.orientation, b, loads.lever[k, 0], loads.lever[k, 1], loads.lever[k, 2])
        put_vector(last, f[0], f[1], f[2])
        last[3], last[4], last[5] = cross(r1, r2, r3, f[0], f[1], f[2])
        total += power(bodies, b, last)
    faces = loads.faces
    for q in range(faces.block.size):
        last = energy_terms.load[n_force + q]
        total += power(bodies, faces.block[q], last)
        for i in range(6):
            last[i] = multiplier_on(faces, q, loads.multiplier[step]) * faces.wrench[q, i]
        total += power(bodies, faces.block[q], last)
    energy_terms.total[0].loads += 0.5 * dt * total


@jit
def add_support_work(energy_terms, bodies, links, loads, dt):
    """Add the work of the moving supports on the structure over the last step."""
    total = 0.0
    for k in range(loads.support.size):
        b = loads.support[k]
        last = energy_terms.support[k]
        total += power(bodies, b, last)
        last[0], last[1], last[2], last[3], last[4], last[5] = gathered(bodies, b, links.wrenches, True, 0.0, 0.0, 0.0)
        total += power(bodies, b, last)
    energy_terms.total[0].loads -= 0.5 * dt * total


@jit
def add_contact_work(energy_terms, bodies, touching, dt):
    """Add the work of the new contacts on the blocks over the last step."""
    total = 0.0
    push = energy_terms.push
    for b in range(push.shape[0]):
        total += power(bodies, b, push[b])
        for i in range(6):
            push[b, i] = 0.0
    for t in range(touching.first.size):
        f = touching.force[t]
        m = touching.torque[t]
        c = touching.point[t]
        for side in range(2):
            part = touching.second[t] if side else touching.first[t]
            sense = 1.0 if side else -1.0
            b = touching.parts.owner[part]
            x = bodies.position[b]
            add_wrench(push[b], sense, f, m, (c[0] - x[0], c[1] - x[1], c[2] - x[2]))
    for b in range(push.shape[0]):
        total += power(bodies, b, push[b])
    energy_terms.total[0].contacts += 0.5 * dt * total


@jit
def add_handover_work(energy_terms, links, corners, faces, touching):
    """Add the energy of the springs of joints that new contacts took over in this step."""
    for t in range(touching.first.size):
        j = touching.joint[t]
        if j >= 0:
            share = 1.0 - touching.weight[t]
            if share != energy_terms.share[j]:
                collect_losses(energy_terms, links, j)
                family, index = families.family_of(energy_terms.place[j])
                energy = families.spring_energy(links, corners, faces, family, index, None)
                energy_terms.total[0].handed += (energy_terms.share[j] - share) * energy
                energy_terms.share[j] = share


@jit
def add_step(energy_terms, bodies, joints, ties, loads, meeting, touching, step, dt):
    """Add all terms except those of joints, after the forces of a step and before the blocks move; new contacts if
    ``meeting``.

    ``joints``: links, corners and faces. Returns the ratio of gravity's work over the last step to the momentum of a
    block: dt times its mean (3).
    """
    links, corners, faces = joints
    add_load_work(energy_terms, bodies, loads, step, dt)
    add_support_work(energy_terms, bodies, links, loads, dt)
    yielded, stepped = tie_losses(ties)
    energy_terms.total[0].ties_yielded += yielded
    energy_terms.total[0].ties_stepped += stepped
    if meeting:
        add_contact_work(energy_terms, bodies, touching, dt)
        add_handover_work(energy_terms, links, corners, faces, touching)
    g = loads.gravity[step]
    last = energy_terms.gravity
    half = 0.5 * dt
    if energy_terms.begun[0] == 0.0:  # there was no step before: discard all that was counted
        energy_terms.begun[0] = 1.0
        half = 0.0
        collect_all_losses(energy_terms, links)
        energy_terms.total[0].loads = 0.0
        energy_terms.total[0].ties_yielded = 0.0
        energy_terms.total[0].ties_stepped = 0.0
        energy_terms.total[0].handed = 0.0  # but a contact at the start of the run acts from then on
        for b in range(energy_terms.fallen.size):
            energy_terms.fallen[b] = 0.0
        for j in range(energy_terms.damped.size):
            energy_terms.damped[j] = 0.0
            energy_terms.least[j] = 0.0
            lost = energy_terms.lost[j]
            lost.friction = lost.released = lost.stepping = lost.by_law = lost.crushing = lost.fracture = 0.0
    m1 = half * (g[0] + last[0])
    m2 = half * (g[1] + last[1])
    m3 = half * (g[2] + last[2])
    for i in range(3):
        last[i] = g[i]
    return m1, m2, m3
