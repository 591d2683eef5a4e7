"""Walls that meet at a corner: laid in bond on one slab; in each course one wall runs through and the other stops.

Position decides which walls meet: the ends of two walls overlap, each ending at the outer face of the other. Walls that
overlap in any other way are refused, with the position at which the second would fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Vector
from dembrick.scenario.checks import present
from dembrick.scenario.generators.stacks import Frame, stone_of
from dembrick.scenario.generators.walls import Corner, Corners, Wall

SAME = 1e-6  # of a block's length: faces closer than this coincide
LEAST_LAP = 0.1  # of a block's length: least lap of a block beyond a corner, and beyond the head joint below

Plan = tuple[float, float, float, float]  # least and greatest x, least and greatest y (m)
Ends = dict[int, list[Corner | None]]


def lay(walls: Sequence[Wall]) -> list[Block]:
    """The blocks of all walls: each wall from the bottom to the top, then its returns, then its slab.

    Raises a ScenarioError for walls that overlap and are not in bond.
    """
    every = [part for wall in walls for part in (wall, *wall.branches())]
    ends: Ends = {i: [None, None] for i in range(len(every))}
    meeting = []
    for i, j in combinations(range(len(every)), 2):
        if _lie_in_one_another(every[i], every[j]):
            _join(every, i, j, ends)
            meeting.append((i, j))
    slabs = _slabs(every, meeting)
    found: list[Block] = []
    number = 0
    for wall in walls:
        own = range(number, number := number + 1 + len(wall.returns))
        for i in own:
            corners = (ends[i][0], ends[i][1])
            _check_openings(every[i], corners)
            found += every[i].stones(corners)
        if own[0] in slabs:
            found.append(slabs[own[0]])
    return found


# --- which walls meet -------------------------------------------------------------------------------------------------


def _lie_in_one_another(one: Wall, other: Wall) -> bool:
    """Whether two walls overlap, in plan and in height."""
    near = SAME * one.block[0]
    low, high = max(one.position[2], other.position[2]), min(_top(one), _top(other))
    if high - low <= near:
        return False
    for seen, by in ((one, other), (other, one)):  # separating axes: two rectangles are apart if they are along one
        plan, own = _plan(seen, by), _plan(by, by)
        if min(plan[1], own[1]) - max(plan[0], own[0]) <= near or min(plan[3], own[3]) - max(plan[2], own[2]) <= near:
            return False
    return True


def _top(wall: Wall) -> float:
    return wall.position[2] + present(wall.courses) * wall.block[2]


def _plan(wall: Wall, of: Wall) -> Plan:
    """The rectangle of a wall, along and across the axis of another wall ``of``, from the left end of that."""
    frame, half = Frame(wall.position, wall.heading), 0.5 * wall.block[1]
    own = Frame((0.0, 0.0, 0.0), -of.heading)
    xs, ys = [], []
    for x in (0.0, wall.length):
        for y in (-half, half):
            px, py, _ = frame.point(x, y, 0.0)
            u, v, _ = own.point(px - of.position[0], py - of.position[1], 0.0)
            xs.append(u)
            ys.append(v)
    return min(xs), max(xs), min(ys), max(ys)


def _join(every: Sequence[Wall], i: int, j: int, ends: Ends) -> None:
    """Give both walls their corner; raise a ScenarioError if they are not in bond there."""
    first, second = every[i], every[j]
    label = f"walls '{first.name}' and '{second.name}'"
    across = (second.heading - first.heading) % 180.0
    if abs(across - 90.0) > 1e-6:
        angle = min(across, 180.0 - across)
        raise ScenarioError(
            f"{label} overlap at {angle:g} deg, but only walls at right angles can meet in bond: turn "
            f"'{second.name}', or move it until it only touches '{first.name}'"
        )
    for wall in (first, second):
        if wall.pattern is not None:
            raise ScenarioError(
                f"{label} overlap, but a wall with a pattern cannot meet another in bond: give '{wall.name}' "
                "courses and blocks instead, or move it until the walls only touch"
            )
    near = SAME * min(first.block[0], second.block[0])
    if abs(first.block[2] - second.block[2]) > near or abs(first.position[2] - second.position[2]) > near:
        heights = f"courses of {first.block[2]:g} and {second.block[2]:g} m"
        raise ScenarioError(
            f"{label} meet with {heights} from z = {first.position[2]:g} and {second.position[2]:g} m: in bond "
            "their courses must begin at one height and be equally high"
        )
    _check_lap(first, second)
    _check_lap(second, first)
    at_first, along = _end_of(first, second)
    at_second, across_by = _end_of(second, first)
    if abs(along) > near or abs(across_by) > near:
        raise ScenarioError(_misplaced(first, second, along, across_by))
    for number, end, other, parity in ((i, at_first, second, 1), (j, at_second, first, 0)):
        there = ends[number][end]
        if there is not None:
            raise ScenarioError(
                f"walls '{there.other}' and '{other.name}' both meet the {('left', 'right')[end]} end of wall "
                f"'{every[number].name}', which has room for one: move one of them until it only touches"
            )
        ends[number][end] = Corner(other.name, other.block[1], present(other.courses), parity)


def _check_lap(wall: Wall, other: Wall) -> None:
    """Raise a ScenarioError if blocks of ``wall`` cannot be toothed into ``other``."""
    length, thickness = wall.block[0], other.block[1]
    least, most = LEAST_LAP * length, (1.0 - LEAST_LAP) * length
    if not least <= thickness <= most:
        raise ScenarioError(
            f"walls '{wall.name}' and '{other.name}' meet, but blocks {length:g} m long cannot be toothed into a wall "
            f"{thickness:g} m thick: at a corner it must be between {least:g} and {most:g} m thick"
        )
    if present(wall.blocks) < 2:
        raise ScenarioError(
            f"walls '{wall.name}' and '{other.name}' meet, but '{wall.name}' is one block long; it needs at least 2"
        )


def _end_of(wall: Wall, other: Wall) -> tuple[int, float]:
    """End of ``wall`` (0 left, 1 right) at which ``other`` crosses it, and its offset (m, along the wall)."""
    start, stop, _, _ = _plan(other, wall)
    left, right = start, stop - wall.length
    return (0, left) if abs(left) <= abs(right) else (1, right)


def _misplaced(first: Wall, second: Wall, along: float, across: float) -> str:
    """Error message with a remedy for two walls that overlap away from their ends, by ``along`` (m, on the first wall)
    and ``across`` (m, on the second)."""
    lead = f"walls '{first.name}' and '{second.name}' overlap"
    if max(abs(along), abs(across)) > max(first.block[0], second.block[0]):
        return (
            f"{lead} away from their ends, but walls meet in bond at corners only: let one end at the face of the "
            "other (a straight joint), or describe the stretch on either side as a separate wall"
        )
    x, y, z = Frame(first.position, first.heading).point(-along, 0.0, 0.0)
    step = (x - first.position[0], y - first.position[1])
    dx, dy, _ = Frame((0.0, 0.0, 0.0), second.heading).point(across, 0.0, 0.0)
    place = tuple(
        float(f"{value:.9g}") + 0.0
        for value in (second.position[0] + step[0] + dx, second.position[1] + step[1] + dy, second.position[2])
    )
    return (
        f"{lead}, but at a corner in bond each must end at the outer face of the other: give '{second.name}' "
        f"position = {list(place)}"
    )


def _check_openings(wall: Wall, corners: Corners) -> None:
    """Raise a ScenarioError for an opening that extends into a corner."""
    left, right = (0.0 if corner is None else corner.thickness for corner in corners)
    near = SAME * wall.block[0]
    for opening in wall.openings:
        start, stop = opening.span
        if start < left - near or stop > wall.length - right + near:
            raise ScenarioError(
                f"span of an opening of wall '{wall.name}' = {list(opening.span)} reaches into a corner: between its "
                f"corners the wall reaches from {left:g} to {wall.length - right:g} m"
            )


# --- the slab ---------------------------------------------------------------------------------------------------------


def _slabs(every: Sequence[Wall], meeting: Sequence[tuple[int, int]]) -> dict[int, Block]:
    """The fixed bases, by the number of the wall they are named after: one for all walls that meet, or whose slabs
    would overlap, named after the first of these that states a base."""
    groups = [{i} for i in range(len(every))]
    for i, j in meeting:
        _unite(groups, i, j)
    changed = True
    while changed:
        changed = False
        based = [(group, _based(every, group)) for group in groups]
        for (one, a), (other, b) in combinations([(group, base) for group, base in based if base is not None], 2):
            if _slabs_overlap(every, one, a, other, b):
                _unite(groups, a, b)
                changed = True
                break
    return {owner: _slab(every, group, owner) for group in groups if (owner := _based(every, group)) is not None}


def _unite(groups: list[set[int]], i: int, j: int) -> None:
    one = next(group for group in groups if i in group)
    other = next(group for group in groups if j in group)
    if one is not other:
        one |= other
        groups.remove(other)


def _based(every: Sequence[Wall], group: set[int]) -> int | None:
    """The first wall of a group that states a base; raise a ScenarioError if another states a different one."""
    stated = [i for i in sorted(group) if every[i].base is not None]
    for i in stated[1:]:
        if every[i].base != every[stated[0]].base:
            names = f"'{every[stated[0]].name}' and '{every[i].name}'"
            raise ScenarioError(
                f"walls {names} stand on one slab, but have base = {every[stated[0]].base} and {every[i].base}: "
                "give base only once"
            )
    return stated[0] if stated else None


def _slabs_overlap(every: Sequence[Wall], one: set[int], a: int, other: set[int], b: int) -> bool:
    """Whether the slabs of two groups have one height and direction, and would overlap."""
    first, second = every[a], every[b]
    turned = (second.heading - first.heading) % 90.0
    if min(turned, 90.0 - turned) > 1e-6 or first.position[2] != second.position[2] or first.base != second.base:
        return False  # if they overlap nevertheless, they are refused like any two blocks
    reach = present(first.base)
    p, q = _around(every, one, first, reach), _around(every, other, first, reach)
    near = SAME * first.block[0]
    return min(p[1], q[1]) - max(p[0], q[0]) > near and min(p[3], q[3]) - max(p[2], q[2]) > near


def _around(every: Sequence[Wall], group: set[int], of: Wall, reach: float) -> Plan:
    """Bounding rectangle of walls, along and across the axis of a wall, ``reach`` (m) wider on each side."""
    left, right, front, back = zip(*(_plan(every[i], of) for i in group), strict=True)
    return min(left) - reach, max(right) + reach, min(front) - reach, max(back) + reach


def _slab(every: Sequence[Wall], group: set[int], owner: int) -> Block:
    wall = every[owner]
    base = present(wall.base)
    left, right, front, back = _around(every, group, wall, base)
    frame = Frame(wall.position, wall.heading)
    centre: Vector = frame.point(0.5 * (left + right), 0.5 * (front + back), -0.5 * base)
    edges = (right - left, back - front, base)
    return stone_of(wall, "base", box=edges, position=centre, orientation=frame.turn, fixed=True)
