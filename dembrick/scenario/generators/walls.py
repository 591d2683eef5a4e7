"""Walls of coursed blocks: running bond, patterns, openings with lintels, returns; how a course ends at a corner.

A course is a list of intervals along the axis of the wall. All rules below work on intervals: openings, corners and
patterns are combined in one place, and a piece that is too short to lay is merged with its neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import permutations

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Vector
from dembrick.scenario.checks import assign, present, require, require_type, show, vector
from dembrick.scenario.declared import check_keys, choice, count, declare, positive, tables, within
from dembrick.scenario.generators.stacks import (
    GROUP,
    HEADING,
    MATERIAL,
    NAME,
    POSITION,
    Frame,
    check_generator,
    edges,
    stone_of,
)

ENDS = ("half", "quoin", "toothed")
PATTERN = {"1": (1.0, True), "h": (0.5, True), "q": (1.5, True), "o": (1.0, False), ".": (0.5, False)}
_SLIVER = 0.24  # of a block's length: a shorter piece is merged with its neighbour
_SAME = 1e-9  # of a block's length: smaller differences are zero

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Opening:
    """A door or window: ``span`` (m, from the left end of the wall, or in a return from the wall's outer face) in
    ``courses`` (first and last, from 1).

    ``lintel`` (m) puts one long block over it in the course above, with that bearing length on both sides.
    """

    span: tuple[float, float] = field(
        metadata=declare(
            "2 numbers",
            "start and end, from the left end of the wall; in a return from the outer face of the wall",
            "m",
        )
    )
    courses: tuple[int, int] = field(metadata=declare("2 whole numbers", "first and last course, from 1", "1"))
    lintel: float | None = field(
        default=None, metadata=positive("m", "bearing of a lintel on either side; left out, no lintel")
    )

    def __post_init__(self):
        span = vector("span", self.span, 2)
        require(span[0] < span[1], "span", span, "its end must lie to the right of its start")
        require_type(isinstance(self.courses, list | tuple), "courses", self.courses, "a list of 2 whole numbers")
        courses = tuple(self.courses)
        whole = len(courses) == 2 and all(isinstance(n, int) and not isinstance(n, bool) for n in courses)
        require_type(whole, "courses", self.courses, "a list of 2 whole numbers")
        require(1 <= courses[0] <= courses[1], "courses", courses, "at least 1, and the last not below the first")
        assign(self, span=span, courses=courses)
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Return:
    """A wall around the corner: at the ``end`` "left" or "right" of the wall, towards the "front" or "back" ``side``
    (front: -y for a wall along x), with a length of ``blocks`` blocks from the outer face of the wall; ``openings``:
    its own, behind the wall."""

    end: str = field(metadata=choice(("left", "right"), "end of the wall at which it stands"))
    side: str = field(metadata=choice(("front", "back"), "side to which it runs; front is -y of a wall along x"))
    blocks: int = field(metadata=count(2, "its length in blocks, from the outer face of the wall"))
    openings: tuple[Opening, ...] = field(default=(), metadata=tables(Opening, "doors and windows of the return"))

    def __post_init__(self):
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Corner:
    """The other wall at one end of a wall, with its name ``other``, ``thickness`` (m) and height in ``courses``.
    ``parity``: remainder by 2 of the courses (from 0) in which the other wall runs through."""

    other: str
    thickness: float
    courses: int
    parity: int

    def cuts(self, course: int) -> bool:
        """Whether the other wall runs through in this course (from 0)."""
        return course < self.courses and course % 2 == self.parity


Corners = tuple[Corner | None, Corner | None]  # at the left and the right end; None: a free end


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall along x (or ``heading``, deg), in running bond or by a pattern.

    ``block`` (length, thickness, height) in m. ``position`` is the left end of the wall's axis: middle of the
    thickness, at the bottom. There are ``courses`` of ``blocks`` each; every second course is shifted by ``bond`` of a
    block, and its ``ends`` are closed with "half" blocks or with "quoin" (a block and a half, instead of a half and a
    whole one), or left "toothed". ``pattern`` gives the courses instead, bottom to top, repeated up to the number of
    ``courses``: ``1`` a block, ``h`` half a block, ``q`` one and a half, ``o`` a gap of one block, ``.`` a gap of half
    a block; blanks are ignored. ``base`` (m) adds a fixed slab of that thickness, which extends as far beyond the wall.

    ``openings``: doors and windows; ``returns``: walls across its ends, in bond with it. Two walls whose ends overlap,
    each ending at the outer face of the other, meet at a corner in bond: the wall that is written first runs through in
    the first, third, ... course, the other in the second, fourth, ..., counted in the lower wall. Walls that meet, and
    those whose slabs would overlap, stand on one slab.

    Blocks, of ``material`` and in the ``group`` if one is given, are called ``name``.course.number, both from 1, from
    the bottom and from the left; those of a return name.left.course.number or name.right.course.number, from the corner
    on; the slab name.base.
    """

    name: str = field(metadata=NAME)
    material: str = field(metadata=MATERIAL)
    block: Vector = field(metadata=edges("length, thickness and height of a block"))
    courses: int | None = field(default=None, metadata=count(1, "number of courses"))
    blocks: int | None = field(default=None, metadata=count(1, "blocks in a course"))
    pattern: tuple[str, ...] | None = field(
        default=None,
        metadata=declare(
            "texts",
            "courses from the bottom, repeated: 1 a block, h half, q one and a half, o a gap of one, . a gap of half",
        ),
    )
    bond: float = field(
        default=0.5,
        metadata=within(
            0.25, 0.75, "1", "shift of every second course, as a fraction of a block",
            "it must lie between 0.25 and 0.75 of a block",
        ),
    )  # fmt: skip
    ends: str = field(default="half", metadata=choice(ENDS, "how shifted courses end"))
    openings: tuple[Opening, ...] = field(default=(), metadata=tables(Opening, "doors and windows"))
    returns: tuple[Return, ...] = field(default=(), metadata=tables(Return, "walls that turn the corner"))
    base: float | None = field(
        default=None, metadata=positive("m", "thickness of a fixed slab below; one for all walls that meet")
    )
    position: Vector = field(default=(0.0, 0.0, 0.0), metadata=POSITION)
    heading: float = field(default=0.0, metadata=HEADING)
    group: str | None = field(default=None, metadata=GROUP)

    def __post_init__(self):
        label = check_generator(self, "wall")
        if self.pattern is None:
            for key in ("courses", "blocks"):
                if getattr(self, key) is None:
                    raise ScenarioError(f"missing key '{key}'{label}; give courses and blocks, or a pattern")
        elif self.blocks is not None:
            raise ScenarioError(f"blocks = {show(self.blocks)}{label} contradicts its pattern; keep one of the two")
        else:
            assign(self, pattern=_checked_pattern(self.pattern, label))
        if self.courses is None:
            assign(self, courses=len(present(self.pattern)))
        self._check_extras(label)

    def _check_extras(self, label: str) -> None:
        if self.returns and self.pattern is not None:
            raise ScenarioError(
                f"returns{label}: a wall with a pattern cannot have any; give courses and blocks instead"
            )
        if len({corner.end for corner in self.returns}) < len(self.returns):
            raise ScenarioError(f"returns{label}: an end of a wall can have only one return")
        if self.returns and self.blocks is not None and self.blocks < 2:
            require(False, f"blocks{label}", self.blocks, "a wall with returns must be at least 2 blocks long")
        if self.ends == "quoin" and self.blocks is not None:
            require(
                self.blocks >= 3, f"blocks{label}", self.blocks, "a wall with quoins must be at least 3 blocks long"
            )
        self._check_openings(self.openings, 0.0, self.length, label, "the wall")
        for corner in self.returns:
            who, reach = f"the {corner.end} return", corner.blocks * self.block[0]
            self._check_openings(corner.openings, self.block[1], reach, f" in {who}{label}", f"behind the wall, {who}")

    def _check_openings(self, openings: tuple[Opening, ...], start: float, stop: float, label: str, who: str) -> None:
        """Raise a ScenarioError unless openings lie between ``start`` and ``stop`` (m) and within the courses."""
        courses = present(self.courses)
        for opening in openings:
            inside = start * (1.0 - _SAME) <= opening.span[0] and opening.span[1] <= stop * (1.0 + _SAME)
            require(inside, f"span of an opening{label}", opening.span, f"{who} reaches from {start:g} to {stop:g} m")
            require(
                opening.courses[1] <= (courses if opening.lintel is None else courses - 1),
                f"courses of an opening{label}",
                opening.courses,
                f"the wall has {self.courses} courses, and a lintel needs one above the opening",
            )
        for one, other in permutations(openings, 2):
            if one.lintel is None:
                continue
            above, bears = one.courses[1] + 1, (one.span[0] - one.lintel, one.span[1] + one.lintel)
            opened = other.courses[0] <= above <= other.courses[1]
            meets = other.lintel is not None and other.courses[1] == one.courses[1]
            reach = other.lintel if meets and other.lintel is not None else 0.0
            low, high = max(bears[0], other.span[0] - reach), min(bears[1], other.span[1] + reach)
            if (opened or meets) and high - low > _SAME * self.block[0]:
                what, ends = "opening" if opened else "lintel", f"{one.span[0]:g} to {one.span[1]:g} m"
                raise ScenarioError(
                    f"openings{label}: the lintel over {ends} lies in course {above}, where another {what} is from "
                    f"{low:.6g} to {high:.6g} m; move an opening, or shorten the bearing of the lintel"
                )

    @property
    def length(self) -> float:
        """Length of the wall along its axis (m)."""
        if self.pattern is not None:
            return self.block[0] * sum(PATTERN[piece][0] for piece in self.pattern[0])
        return self.block[0] * present(self.blocks)

    def count(self) -> int:
        """Upper bound of the number of blocks, without building the wall."""
        per_course = max(map(len, self.pattern)) if self.pattern is not None else present(self.blocks) + 1
        return (
            present(self.courses)
            * (per_course + sum(corner.blocks + 1 + len(corner.openings) for corner in self.returns))
            + 1
        )

    def branches(self) -> tuple[Wall, ...]:
        """The returns, as walls that start at the corner."""
        place, half = Frame(self.position, self.heading), 0.5 * self.block[1]
        found = []
        for corner in self.returns:
            x = half if corner.end == "left" else self.length - half
            y, turn = (-half, 90.0) if corner.side == "back" else (half, -90.0)  # from the outer face of this wall
            found.append(
                replace(
                    self,
                    name=f"{self.name}.{corner.end}",
                    blocks=corner.blocks,
                    ends="half",
                    openings=corner.openings,
                    returns=(),
                    base=None,
                    position=place.point(x, y, 0.0),
                    heading=self.heading + turn,
                )
            )
        return tuple(found)

    def stones(self, corners: Corners) -> list[Block]:
        """The blocks of the wall itself, course by course from the bottom, each from the left."""
        frame = Frame(self.position, self.heading)
        return [
            self._stone(f"{course + 1}.{number}", frame, course, piece)
            for course in range(present(self.courses))
            for number, piece in enumerate(self._course(course, corners), 1)
        ]

    def _stone(self, name: str, frame: Frame, course: int, piece: Interval) -> Block:
        length, thickness, height = self.block
        edge = piece[1] - piece[0]
        whole = round(2.0 * edge / length) * 0.5 * length  # rounded, so that equal blocks share one shape exactly
        if abs(edge - whole) <= _SAME * length:
            edge = whole
        place = frame.point(0.5 * (piece[0] + piece[1]), 0.0, (course + 0.5) * height)
        return stone_of(self, name, box=(edge, thickness, height), position=place, orientation=frame.turn)

    def _course(self, course: int, corners: Corners) -> list[Interval]:
        """The pieces of one course, from the left."""
        length, whole = self.block[0], self.length
        if self.pattern is not None:
            pieces, ends = _laid(self.pattern[course % len(self.pattern)], length), (0.0, whole)
        else:
            left, right = (_depth(corner, course) for corner in corners)
            pieces, ends = self._bonded(course, corners), (left, whole - right)
        return _opened(pieces, self.openings, course, ends, length)

    def _bonded(self, course: int, corners: Corners) -> list[Interval]:
        """The pieces of one course in running bond.

        Courses alternate: one of whole blocks from face to face, and one with a block fewer between two shifted ends.
        An end is shifted by the wall that runs through there or, if it is free, by a closer according to ``bond``.
        Between corners that are shifted alternately, all courses have the same number of blocks. The pieces of a course
        have equal lengths, so that each head joint is between two of the course below.
        """
        closers = [part * self.block[0] for part in (self.bond, 1.0 - self.bond)]
        shifts, free = [], []
        for corner, other, closer in zip(corners, reversed(corners), closers, strict=True):
            beside = corner or other
            shifted = course % 2 == (1 if beside is None else beside.parity)
            depth = _depth(corner, course)
            free.append(shifted and depth == 0.0)
            shifts.append(closer if free[-1] else depth)
        start, stop = shifts[0], self.length - shifts[1]
        fewer = min(shifts) > 0.0
        if (left := corners[0]) and (right := corners[1]) and left.parity != right.parity:
            fewer = left.thickness + right.thickness > (1.0 + _SAME) * self.block[0]
        number = present(self.blocks) - fewer
        pieces = _equal(start, stop, number, self.block[0])
        if free[0] and self.ends != "toothed":
            pieces = [(0.0, start), *pieces]
        if free[1] and self.ends != "toothed":
            pieces = [*pieces, (pieces[-1][1] if pieces else start, self.length)]
        if self.ends == "quoin":
            pieces = [(pieces[0][0], pieces[1][1]), *pieces[2:]] if free[0] else pieces
            pieces = [*pieces[:-2], (pieces[-2][0], pieces[-1][1])] if free[1] else pieces
        return pieces


def _depth(corner: Corner | None, course: int) -> float:
    """Length (m) by which a course (from 0) is cut at an end, by the wall that runs through there."""
    return corner.thickness if corner is not None and corner.cuts(course) else 0.0


def _checked_pattern(pattern, label: str) -> tuple[str, ...]:
    pattern = [pattern] if isinstance(pattern, str) else pattern
    require_type(isinstance(pattern, list | tuple), f"pattern{label}", pattern, "a list of texts, one per course")
    require(len(pattern) > 0, f"pattern{label}", pattern, "it needs at least one course")
    rows = []
    for i, row in enumerate(pattern):
        key = f"pattern[{i}]{label}"
        require_type(isinstance(row, str), key, row, "a text")
        row = "".join(row.split())
        strange = sorted(set(row) - set(PATTERN))
        require(not strange, key, row, f"a course is written with {' '.join(PATTERN)}, not {' '.join(strange)}")
        require(any(PATTERN[piece][1] for piece in row), key, row, "a course needs at least one block")
        rows.append(row)
    lengths = [sum(PATTERN[piece][0] for piece in row) for row in rows]
    for i, length in enumerate(lengths):
        same = length == lengths[0]
        bound = f"it is {length:g} blocks long, but pattern[0] {lengths[0]:g}; fill it with o or ."
        require(same, f"pattern[{i}]{label}", rows[i], bound)
    return tuple(rows)


def _laid(row: str, length: float) -> list[Interval]:
    """The blocks of one course of a pattern."""
    pieces, halves = [], 0
    for piece in row:
        size, solid = PATTERN[piece]
        end = halves + round(2.0 * size)
        if solid:
            pieces.append((0.5 * length * halves, 0.5 * length * end))
        halves = end
    return pieces


def _equal(start: float, stop: float, number: int, length: float) -> list[Interval]:
    """``number`` equal pieces between two places, exactly of ``length`` if they fit."""
    if abs(stop - start - number * length) <= _SAME * length:
        joints = [start + i * length for i in range(number + 1)]
    else:
        joints = [*(start + i * (stop - start) / number for i in range(number)), stop]
    return list(zip(joints[:-1], joints[1:], strict=True))


def _opened(
    pieces: list[Interval], openings: tuple[Opening, ...], course: int, ends: Interval, length: float
) -> list[Interval]:
    """The pieces of a course (from 0) between ``ends``, cut at openings, with the lintels of those below."""
    for opening in openings:
        if opening.courses[0] <= course + 1 <= opening.courses[1]:
            pieces = _without(pieces, opening.span, length)
        elif opening.lintel is not None and course == opening.courses[1]:
            span = (max(ends[0], opening.span[0] - opening.lintel), min(ends[1], opening.span[1] + opening.lintel))
            pieces = sorted([*_without(pieces, span, length), span])
    return pieces


def _without(pieces: list[Interval], span: Interval, length: float) -> list[Interval]:
    """The pieces with ``span`` cut out."""
    start, stop = span
    rest = [(s, min(e, start)) for s, e in pieces if s < start] + [(max(s, stop), e) for s, e in pieces if e > stop]
    return _made_up([(s, e) for s, e in rest if e - s > _SAME * length], length)


def _made_up(pieces: list[Interval], length: float) -> list[Interval]:
    """Merge each piece that is too short to lay with a neighbour that it touches, into one piece or two equal ones."""
    pieces = list(pieces)
    i = 0
    while i < len(pieces):
        start, stop = pieces[i]
        if stop - start < _SLIVER * length:
            for k in (i - 1, i):  # the neighbour on the left, then the one on the right
                if 0 <= k < len(pieces) - 1 and abs(pieces[k][1] - pieces[k + 1][0]) <= _SAME * length:
                    both = (pieces[k][0], pieces[k + 1][1])
                    middle = 0.5 * (both[0] + both[1])
                    fits = both[1] - both[0] <= 1.01 * length
                    pieces[k : k + 2] = [both] if fits else [(both[0], middle), (middle, both[1])]
                    break
        i += 1
    return pieces
