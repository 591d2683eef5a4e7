"""Guards of a run: quantities that the time loop monitors, and messages when it stops.

They also decide whether the load of a constant-rate test is steady: only a steady load is a limit load.

The load of an uncertified test may still rise at the end of its travel, or oscillate about its static value: the mean
of neither is a limit load. The time loop sums V and its square over equal stretches of the travel (``kernels.guard``).
A load that falls after its peak is no error: V is then the residual load.

The limit load is defined in the geometry of the start, and the head has moved away from it. The drift of V during the
travel is known from its second half; extrapolated back to the start, it is part of the bracket. While blocks rock, the
pressed strip shrinks with the root of the tilt, which hides the drift: the fit of V has both as terms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.assembly.broad_phase import bodies_of, close_pairs, overlap_depths
from dembrick.assembly.joints import TOLERANCE, JointTable
from dembrick.errors import DivergedError, NotConvergedError
from dembrick.geometry.clipping import clip
from dembrick.geometry.polygons import area
from dembrick.geometry.rotations import rotation_matrix
from dembrick.geometry.shapes import Shape, parts_of
from dembrick.kernels.statics.loop import DIVERGED, RUNAWAY, TIMES, Guard
from dembrick.simulation.statics.state import State, turned_blocks
from dembrick.simulation.statics.yield_point import YieldPoint

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


DROPPED = 0.5  # of the least dimension of a block: a block that has dropped by more has fallen
LESS = 0.01  # of the area of a joint: a test that ignores a greater loss of area over an edge reports it
OVERHANG = 0.05  # and refuses if the loss is greater than this
OVERLAP = 1e-3  # of a block's diameter: greatest overlap of blocks without a joint in such a test
STILL_THERE = 1e-3  # of the least dimension: for smaller displacements the joints are those of the start
LONGEST_MOVE = 0.1  # of the smallest block: a step that moves a block further has diverged
LOOK = 64  # steps between two checks of the energy, at most; a power of two
STRETCHES = 64  # of a constant-rate test, over which its load is summed


def new_guard(assembly: Assembly, state: State, steps: int | None = None) -> Guard:
    """The guard of a run that starts from ``state``, all blocks at rest, for so many ``steps`` (None: unknown)."""
    look, stretch = LOOK, 1 << 62
    if steps is not None:
        wanted = max(1, steps // STRETCHES)
        look = min(LOOK, 1 << (wanted.bit_length() - 1))
        stretch = look * (wanted // look)
    return Guard(
        longest=LONGEST_MOVE * float(assembly.least_size.min()),
        mask=look - 1,
        stretch=stretch,
        weights=float(np.abs(state.actuators.weight).sum()),
        turned=turned_blocks(state),
        start=np.zeros(2),
        work=np.zeros(2),
        sums=np.zeros(3),
        load=np.zeros((1 if steps is None else -(-steps // stretch), 3)),
    )


def refuse_divergence(status: int, assembly: Assembly, state: State, steps: int, dt: float, critical: float) -> None:
    """Raise DivergedError if a guard ended the run, with the block, its joint, the time and the time step.

    ``status`` is that of the loop, ``critical`` the critical time step (s).
    """
    if status not in (DIVERGED, RUNAWAY):
        return
    blocks, joints = state.blocks, state.joints
    speed = np.abs(blocks.velocity).max(axis=1) + np.abs(blocks.spin).max(axis=1)
    lost = np.flatnonzero(~np.isfinite(speed))
    if len(lost):
        b, did = int(lost[0]), "has a velocity that is not a number"
    elif status == RUNAWAY:
        b = _most_energy(assembly, state)
        did = f"moves where the blocks have more than {TIMES:g} times the energy that dead loads and actuators put in"
    else:
        b = int(np.argmax(np.abs(blocks.velocity).max(axis=1)))
        did = f"moved more than {LONGEST_MOVE:g} of the smallest block in one step"
    fall = came_down(assembly, state)
    if fall:
        raise DivergedError(f"{fall} (step {steps}, t = {steps * dt:.4g} s)")
    raise DivergedError(
        f"the run diverged at step {steps} (t = {steps * dt:.4g} s): block {assembly.names[b]!r} "
        f"({_joint_of(b, assembly, joints)}) {did}; the time step {dt:.3g} s is {dt / critical:.2f} of the critical "
        "one. Lower solver.step_factor, or check the load"
    )


def came_down(assembly: Assembly, state: State) -> str | None:
    """Message on free blocks that have dropped by more than half of their least dimension, as in a fall, beyond which
    the joints of the start are not valid; None without any."""
    weight = float(np.linalg.norm(assembly.gravity))
    if not weight > 0.0:
        return None
    drop = state.blocks.displacement @ (np.asarray(assembly.gravity, float) / weight)
    low = np.flatnonzero(~np.asarray(assembly.fixed) & (drop > DROPPED * assembly.least_size))
    if not len(low):
        return None
    deepest = int(low[np.argmax(drop[low])])
    more = f" (and {len(low) - 1} more)" if len(low) > 1 else ""
    return (
        f"block {assembly.names[deepest]!r}{more} has dropped by {drop[deepest]:.3g} m: a constant-rate test keeps "
        "its initial joints and ends where blocks fall; shorten control.travel (the record is valid up to "
        'the fall), or simulate the fall with control.kind = "dynamic"'
    )


def other_joints(assembly: Assembly, state: State, travel: float) -> str | None:
    """Remark on the joint that has lost the greatest share of its area over an edge after a ``travel`` (m) of the head,
    if that is more than `LESS`, as a constant-rate test does not cut joints. Raises NotConvergedError if it is more
    than `OVERHANG`, or if blocks without a joint meet, as such a test detects no new contacts."""
    least = float(assembly.least_size.min())
    if not _farthest(assembly, state) > STILL_THERE * least:
        return None
    lost, (deep, pair) = overhang(assembly, state), meeting(assembly, state)
    part, after = float(lost.max(initial=0.0)), f"after a travel of {travel:.3g} m"
    if part > LESS:
        joint = assembly.joints[int(np.argmax(lost))]
        a, b = (assembly.names[i] for i in (joint.block_a, joint.block_b))
        hangs = f"{after} {100.0 * part:.2g} % of the joint between {a!r} and {b!r} hang over an edge"
    if part > OVERHANG:
        found, short = hangs, f"{travel * OVERHANG / part:.2g} m"
    elif pair:
        a, b = (assembly.names[i] for i in pair)
        found = f"{after} blocks {a!r} and {b!r}, which have no joint, overlap by {deep:.2g} m"
        short = f"less than {travel:.2g} m"
    else:
        return f"{hangs}, but a constant-rate test keeps the whole area of its joints" if part > LESS else None
    if fall := came_down(assembly, state):
        raise NotConvergedError(f"no limit load: {fall}")
    raise NotConvergedError(
        f"{found}, but a constant-rate test keeps its initial joints, so its load is that of another structure: "
        f"shorten control.travel to {short}, or set control.large_displacements = true, which cuts joints and "
        "detects contacts"
    )


def in_the_way(assembly: Assembly, state: State, factor: float) -> str | None:
    """Remark on what would invalidate a constant-rate test if its travel were longer by ``factor``, with the motion
    extrapolated: blocks that meet, or a joint that hangs over an edge; None if nothing."""
    blocks, start = state.blocks, np.asarray(assembly.orientation)
    for part in np.geomspace(1.0, factor, 1 + math.ceil(math.log2(factor))).tolist():
        turned = start + part * (blocks.orientation - start)
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        ahead = state._replace(blocks=blocks._replace(displacement=part * blocks.displacement, orientation=turned))
        _, pair = meeting(assembly, ahead)
        if pair:
            a, b = (assembly.names[i] for i in pair)
            return f"blocks {a!r} and {b!r}, which have no joint, would meet"
        if float(overhang(assembly, ahead).max(initial=0.0)) > OVERHANG:
            return "a joint would hang over an edge"
    return None


def _farthest(assembly: Assembly, state: State) -> float:
    """Upper bound of the displacement of any point of a block (m)."""
    blocks = state.blocks
    reach = np.array([float(np.linalg.norm(shape.vertices, axis=1).max()) for shape in assembly.shapes])
    turned = np.abs((blocks.orientation * assembly.orientation).sum(axis=1)).clip(0.0, 1.0)
    return float((np.linalg.norm(blocks.displacement, axis=1) + 2.0 * reach * np.arccos(turned)).max())


def meeting(assembly: Assembly, state: State) -> tuple[float, tuple[int, ...]]:
    """Greatest overlap (m) of two blocks whose parts have no joint between them, and their numbers; none if they
    overlapped as much at the start, or by less than `OVERLAP` of the smaller one."""
    joints, start = JointTable.of(assembly.joints), np.asarray(assembly.position)
    before = bodies_of(assembly.shapes, start, rotation_matrix(assembly.orientation))
    bodies = before.moved(start + state.blocks.displacement, rotation_matrix(state.blocks.orientation))
    first = np.searchsorted(before.owner, np.arange(len(start)))
    known = np.sort(np.column_stack([first[joints.block_a] + joints.part_a, first[joints.block_b] + joints.part_b]))
    pairs, fixed = close_pairs(bodies, 0.0), np.asarray(assembly.fixed)
    owners = before.owner[pairs]
    pairs = pairs[(owners[:, 0] != owners[:, 1]) & ~fixed[owners].all(axis=1)]
    pairs = pairs[~np.isin(pairs @ [len(before.owner), 1], known @ [len(before.owner), 1])]
    if not len(pairs):
        return 0.0, ()
    deep = overlap_depths(bodies, pairs) - np.maximum(overlap_depths(before, pairs), 0.0)
    over = deep - OVERLAP * before.table.diameter[pairs].min(axis=1)
    k = int(np.argmax(over))
    return (float(deep[k]), tuple(before.owner[pairs[k]].tolist())) if over[k] > 0.0 else (0.0, ())


def overhang(assembly: Assembly, state: State) -> np.ndarray:
    """Part (j,) of the area of each joint that no longer lies on the face of the other block."""
    joints, blocks = JointTable.of(assembly.joints), state.blocks
    at_start, now = (rotation_matrix(q) for q in (assembly.orientation, blocks.orientation))
    place = np.asarray(assembly.position) + blocks.displacement
    lost = np.zeros(len(joints))
    for j in range(len(joints)):
        joint = joints[j]
        host, a_is_other = joint.host, joint.host == joint.block_b
        other, part = (joint.block_a, joint.part_a) if a_is_other else (joint.block_b, joint.part_b)
        axes = joint.axes @ at_start[other]  # of the other's body
        faces = _faces(assembly.shapes[other], part, axes[2] if a_is_other else -axes[2], axes[:2])
        corners = joint.origin + joint.polygon @ joint.axes[:2] - assembly.position[host]
        moved = corners @ at_start[host] @ now[host].T + place[host] - place[other]
        before = (corners + assembly.position[host] - assembly.position[other]) @ at_start[other] @ axes[:2].T
        after = moved @ now[other] @ axes[:2].T
        whole, left = (sum(_common_area(polygon, face) for face in faces) for polygon in (before, after))
        lost[j] = 1.0 - left / whole
    return lost


def _faces(shape: Shape, part: int, outward: np.ndarray, axes: np.ndarray) -> list[np.ndarray]:
    """Corners (m, 2), along two ``axes`` of the body and counter-clockwise about their normal, of the face of a
    ``part`` with the normal ``outward``, and of coplanar faces of other parts."""
    found, parts = [], parts_of(shape)
    middle, own = parts[part]
    level = float(((middle + own.vertices) @ outward).max())
    for middle, one in parts:
        number = int(np.argmax(one.face_normals @ outward))
        corners = middle + one.vertices[list(one.faces[number])]
        flat = TOLERANCE * float(np.ptp(shape.vertices, axis=0).max())
        if one.face_normals[number] @ outward > 1.0 - TOLERANCE and (abs(corners @ outward - level) <= flat).all():
            plane = corners @ axes.T
            found.append(plane if outward @ np.cross(*axes) > 0.0 else plane[::-1])
    return found


def _common_area(polygon: np.ndarray, face: np.ndarray) -> float:
    """Area (m2) of the intersection of a polygon and a face, both convex and counter-clockwise."""
    corners, count = clip(polygon[None], face[None])
    return float(area(corners[0, : count[0]])) if count[0] else 0.0


def _most_energy(assembly: Assembly, state: State) -> int:
    """The free block with the greatest kinetic energy, by its physical inertia."""
    blocks, free = state.blocks, state.blocks.free
    moment = np.trace(np.asarray(assembly.inertia)[free], axis1=1, axis2=2) / 3.0
    energy = np.asarray(assembly.mass)[free] * (blocks.velocity[free] ** 2).sum(axis=1)
    return int(free[np.argmax(energy + moment * (blocks.spin[free] ** 2).sum(axis=1))])


def _joint_of(b: int, assembly: Assembly, joints) -> str:
    """The joint of block ``b`` with the greatest force, or with one that is not finite, for a message."""
    mine = np.flatnonzero((joints.block_a == b) | (joints.block_b == b))
    if not len(mine):
        return "no joint"
    force = np.linalg.norm(joints.resultant[mine, :3], axis=1)
    j = mine[np.argmax(np.where(np.isfinite(force), force, np.inf))]
    return f"joint {assembly.names[joints.block_a[j]]}-{assembly.names[joints.block_b[j]]}"


STEADY = 1e-2  # of the mean load: accepted oscillation (rms) and missing growth
MISSING = 5.5  # times the growth from the third to the last quarter: growth still to come of 1 - c/sqrt(u)
DRIFT = 1.5  # factor on the fitted drift since the start of the travel, for what the fit does not include
SLOW = 0.1  # elastic slips per critical time step: a slower head does not make the load oscillate
NEAR = 1e-2  # of the joint's reach: displacement within which the geometry is that of the start
WILD = 0.1  # of the load: oscillation (rms), or deficit of load, beyond which the integration of a slow test is unsound
LESS_FAST = 0.1  # greatest rate that is advised over the present one; of the slow rate: no slower head helps
TWICE, MOST = 2.0, 100.0  # times the travel: the least and the most that is advised at once
ROUNDING = 1e-9  # of the first digit
BY_SEARCH = 'take control.kind = "yield", which finds the limit load in the geometry of the start'
FEWEST = 8  # stretches of the travel that must have been summed


def _late(guard: Guard) -> tuple[float, float, float]:
    """Over the second half of the travel: oscillation of the load about its linear trend (rms), the end of the trend,
    and its gain over the whole travel (N)."""
    steps, mean, square = guard.load[guard.load[:, 0] > 0.0].T
    mean, square = mean / steps, square / steps
    done = (np.cumsum(steps) - 0.5 * steps) / steps.sum()
    half = done > 0.5
    line = np.polyfit(done[half], mean[half], 1)
    trend = np.polyval(line, done[half])
    # mean of (V - trend)^2 over each stretch
    spread = square[half] - 2.0 * mean[half] * trend + trend**2
    swing = float(np.sqrt(max(np.average(spread, weights=steps[half]), 0.0)))
    return swing, float(np.polyval(line, 1.0)), float(line[0])


def _rocking_limit(guard: Guard) -> float:
    """A (N) of the load A + B / sqrt(u) + C u fitted over the second half of the travel u.

    C u is the loss of load of a rigid block as it turns. The strip on which it turns has the length
    sqrt(2 N / (k_n b theta)), and N acts a third of that inside the edge: the term of B.
    """
    steps, sums = guard.load[guard.load[:, 0] > 0.0].T[:2]
    done = (np.cumsum(steps) - 0.5 * steps) / steps.sum()
    half, root = done > 0.5, np.sqrt(steps)
    terms = np.stack([np.ones_like(done), done**-0.5, done], axis=1) * root[:, None]
    return float(np.linalg.lstsq(terms[half], (sums / root)[half])[0][0])


def refuse_unsound(point: YieldPoint, guard: Guard, pace: float, reach: float) -> None:
    """Raise NotConvergedError if the curve of a slow certified test is unsound: its load oscillates, or stays below the
    bracket.

    ``pace``: elastic slips of the head per critical time step, ``reach`` (m) of the joint. The load of a fast test may
    oscillate, and a block that has moved far may carry less; the bracket of the start is valid all the same.
    """
    if pace > SLOW or point.displacement > NEAR * reach or np.count_nonzero(guard.load[:, 0]) < FEWEST:
        return
    (swing, load, _), allowed = _late(guard), WILD * point.V_lower
    if not (swing <= allowed and load >= point.V_lower - allowed):
        raise NotConvergedError(
            f"over the second half of a slow test V swings by {swing:.3g} N (rms) towards {load:.6g} N, and at least "
            f"{point.V_lower:.6g} N is reached at the limit: the time step does not resolve this motion; lower "
            "solver.step_factor",
            point,
        )


def swings(point: YieldPoint, guard: Guard) -> str | None:
    """Remark on the curve of a certified test whose load oscillates, as in stick-slip; else None. The bracket is valid
    all the same."""
    if np.count_nonzero(guard.load[:, 0]) < FEWEST:
        return None
    swing = _late(guard)[0]
    if not swing > STEADY * point.V_lower:
        return None
    return (
        f"over the second half of the travel V swings by {swing:.3g} N (rms), so V_peak = {point.V_peak:.6g} N is a "
        "peak of these swings, not a strength; the bracket of V holds"
    )


class Course(NamedTuple):
    """Data of a constant-rate test: its ``travel`` (m) and ``rate`` (m/s), the rate below which the load does not
    oscillate over that load (``calm``, m/s/N), and the load below which it counts as zero (``least``, N)."""

    travel: float
    rate: float
    calm: float
    least: float


def slower(rate: float) -> str:
    """Advice to lower the rate to this (m/s), to one digit, rounded down."""
    digit = 10.0 ** math.floor(math.log10(rate) + ROUNDING)
    return f"lower control.rate, say to {digit * math.floor(rate / digit + ROUNDING):.1g} m/s"


def longer(travel: float, factor: float) -> str:
    """Advice to lengthen a ``travel`` (m) by ``factor``, to one digit, rounded up."""
    wanted = factor * travel
    digit = 10.0 ** math.floor(math.log10(wanted))
    return f"lengthen control.travel, say to {digit * math.ceil(wanted / digit - ROUNDING):.1g} m"


def further(travel: float, factor: float, ahead: Callable[[float], str | None]) -> str:
    """Advice to lengthen a ``travel`` (m) by ``factor``, or another one if something is in the way."""
    way = ahead(factor)
    return f"on a longer travel {way}: {BY_SEARCH}" if way else longer(travel, factor)


def steady(
    point: YieldPoint, guard: Guard, course: Course, ahead: Callable[[float], str | None] = lambda factor: None
) -> YieldPoint:
    """``point`` whose V is the mean load of the last quarter; NotConvergedError if the load is not steady.

    The bracket includes V and its extrapolation to the geometry of the start. The tolerance on oscillation and growth
    is relative to V, or to the least load of the ``course`` if that is more. A head faster than `SLOW` makes the load
    oscillate, a slower one does not, whatever the travel. The growth still to come of a rising load falls with the root
    of the travel, which tells how long it must be, unless something is in the way that far ``ahead`` (returns a remark
    for a travel longer by a factor).
    """
    steps, mean, square = guard.load[guard.load[:, 0] > 0.0].T
    travel = course.travel
    if len(steps) < FEWEST:
        raise NotConvergedError(
            f"{int(steps.sum())} steps are too few to tell whether the load is steady; {longer(travel, TWICE)}", point
        )
    mean, (swing, _, gain) = mean / steps, _late(guard)
    done = (np.cumsum(steps) - 0.5 * steps) / steps.sum()
    last, half = done > 0.75, done > 0.5
    V = float(np.average(mean[last], weights=steps[last]))
    growth = V - float(np.average(mean[half & ~last], weights=steps[half & ~last]))
    at_start = [V - DRIFT * float(np.average(done[last], weights=steps[last])) * gain]
    if point.mechanism == "rocking":
        at_start.append(V + DRIFT * (_rocking_limit(guard) - V))
    above = None if point.V_upper is None else max(point.V_upper, V, *at_start)
    point = replace(point, V=V, V_lower=min(point.V_lower, V, max(0.0, min(at_start))), V_upper=above)
    load = max(abs(V), course.least)
    allowed, calm = STEADY * load, course.calm * load
    if swing <= allowed and MISSING * growth <= allowed:
        return point
    rises = MISSING * growth > allowed
    fast = swing > allowed and course.rate > (calm if rises else LESS_FAST * calm)
    what = "still rises" if rises and not fast else f"swings by {swing:.3g} N (rms)"
    factor = min(max(TWICE, (MISSING * max(growth, 0.0) / allowed) ** 2), MOST)
    advice = slower(min(calm, LESS_FAST * course.rate)) if fast else BY_SEARCH
    if rises and not fast:
        advice = further(travel, factor, ahead)
    raise NotConvergedError(
        f"no limit load: over the second half of the travel V {what} about {V:.6g} N, {growth:+.3g} N in its last "
        f"quarter; {advice}",
        point,
    )
