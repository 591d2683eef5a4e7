"""Walls of coursed blocks: running bond, patterns, openings with lintels, returns at corners.

A course is a row of intervals along the axis of the wall. Every rule below works on intervals, so that openings,
corners and patterns meet in one place, and a piece that would be too short to lay is made up with its neighbour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
_SLIVER = 0.24  # of a block's length: a shorter piece is made up with its neighbour
_SAME = 1e-9  # of a block's length

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Opening:
    """A door or window: ``span`` (m, from the left end of the wall, or from its outer face along a return) in
    ``courses`` (first and last, from 1).

    ``lintel`` (m) spans it by one long block in the course above, with that much bearing on both sides.
    """

    span: tuple[float, float] = field(
        metadata=declare(
            "2 numbers",
            "from where to where, from the left end of the wall; in a return from the outer face of the wall",
            "m",
        )
    )
    courses: tuple[int, int] = field(metadata=declare("2 whole numbers", "first and last course, from 1", "1"))
    lintel: float | None = field(
        default=None, metadata=positive("m", "bearing of a lintel on either side; left out, there is none")
    )

    def __post_init__(self):
        span = vector("span", self.span, 2)
        require(span[0] < span[1], "span", span, "its end must lie right of its start")
        require_type(isinstance(self.courses, list | tuple), "courses", self.courses, "a list of 2 whole numbers")
        courses = tuple(self.courses)
        whole = len(courses) == 2 and all(isinstance(n, int) and not isinstance(n, bool) for n in courses)
        require_type(whole, "courses", self.courses, "a list of 2 whole numbers")
        require(1 <= courses[0] <= courses[1], "courses", courses, "at least 1, and the last not below the first")
        assign(self, span=span, courses=courses)
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Return:
    """A wall that turns the corner: at the ``end`` "left" or "right" of the wall, to the "front" or "back" ``side``
    (front: towards -y of a wall along x), ``blocks`` long from the outer face of the wall; ``openings``: of its
    own, behind the wall."""

    end: str = field(metadata=choice(("left", "right"), "at which end of the wall"))
    side: str = field(metadata=choice(("front", "back"), "to which side; front is towards -y of a wall along x"))
    blocks: int = field(metadata=count(2, "its length in blocks, from the outer face of the wall"))
    openings: tuple[Opening, ...] = field(default=(), metadata=tables(Opening, "doors and windows of the return"))

    def __post_init__(self):
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall along x (or ``heading``, deg), in running bond or by a pattern.

    ``block`` (length, thickness, height) in m. ``position`` is the left end of the wall's axis: middle of the
    thickness, at the bottom. ``courses`` of ``blocks`` each; every second course is shifted by ``bond`` of a block,
    and its ``ends`` are closed with "half" blocks or with "quoin" (a block and a half, in place of half and whole), or
    left "toothed". ``pattern`` gives the courses instead, bottom to top, repeated as often as ``courses`` asks: ``1``
    a block, ``h`` half of one, ``q`` one and a half, ``o`` a gap as long as a block, ``.`` as long as half; blanks
    do not count. ``base`` (m) adds a fixed slab, so thick and reaching so far beyond the wall.

    ``openings``: doors and windows; ``returns``: walls across its ends, in bond with it.

    Blocks of ``material``, and of a ``group``, are called ``name``.course.number, both from 1, from the bottom and from
    the left; those of a return name.left.course.number or name.right.course.number, from the corner on; the slab
    name.base.
    """

    name: str = field(metadata=NAME)
    material: str = field(metadata=MATERIAL)
    block: Vector = field(metadata=edges("length, thickness and height of a block"))
    courses: int | None = field(default=None, metadata=count(1, "number of courses"))
    blocks: int | None = field(default=None, metadata=count(1, "blocks in a course"))
    pattern: tuple[str, ...] | None = field(
        default=None,
        metadata=declare(
            "texts", "courses from the bottom, repeated: 1 a block, h half, q one and a half, o a gap of one, . of half"
        ),
    )
    bond: float = field(
        default=0.5,
        metadata=within(
            0.25, 0.75, "1", "shift of every second course, as a part of a block",
            "it must lie between 0.25 and 0.75 of a block",
        ),
    )  # fmt: skip
    ends: str = field(default="half", metadata=choice(ENDS, "how shifted courses end"))
    openings: tuple[Opening, ...] = field(default=(), metadata=tables(Opening, "doors and windows"))
    returns: tuple[Return, ...] = field(default=(), metadata=tables(Return, "walls that turn the corner"))
    base: float | None = field(default=None, metadata=positive("m", "thickness of a fixed slab below"))
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
            raise ScenarioError(f"returns{label}: a wall with a pattern has none; give courses and blocks instead")
        if len({corner.end for corner in self.returns}) < len(self.returns):
            raise ScenarioError(f"returns{label}: an end of a wall has one return at most")
        if self.returns and self.blocks is not None and self.blocks < 2:
            require(False, f"blocks{label}", self.blocks, "a wall with returns is at least 2 blocks long")
        if self.ends == "quoin" and self.blocks is not None:
            require(self.blocks >= 3, f"blocks{label}", self.blocks, "a wall with quoins is at least 3 blocks long")
        self._check_openings(self.openings, 0.0, self.length, label, "the wall")
        for corner in self.returns:
            who, reach = f"the {corner.end} return", corner.blocks * self.block[0]
            self._check_openings(corner.openings, self.block[1], reach, f" in {who}{label}", f"behind the wall, {who}")

    def _check_openings(self, openings: tuple[Opening, ...], start: float, stop: float, label: str, who: str) -> None:
        """ScenarioError for what is not cut out between ``start`` and ``stop`` (m) and within the courses."""
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

    @property
    def length(self) -> float:
        """Length of the wall along its axis (m)."""
        if self.pattern is not None:
            return self.block[0] * sum(PATTERN[piece][0] for piece in self.pattern[0])
        return self.block[0] * present(self.blocks)

    def count(self) -> int:
        """At most how many blocks the wall has, reckoned without laying any."""
        per_course = max(map(len, self.pattern)) if self.pattern is not None else present(self.blocks) + 1
        return (
            present(self.courses)
            * (per_course + sum(corner.blocks + 1 + len(corner.openings) for corner in self.returns))
            + 1
        )

    def build(self) -> list[Block]:
        """The blocks, from the bottom to the top, each course from the left; returns after the wall, the slab last."""
        left, right = (next((r for r in self.returns if r.end == end), None) for end in ("left", "right"))
        frame = Frame(self.position, self.heading)
        found: list[Block] = []
        for course in range(present(self.courses)):
            for number, piece in enumerate(self._course(course, left is not None, right is not None), 1):
                found.append(self._stone(f"{course + 1}.{number}", frame, course, piece))
        for corner in self.returns:
            branch = self._branch(corner)
            for course in range(present(self.courses)):
                start = self.block[1] if course % 2 == 0 else 0.0
                reach = corner.blocks * self.block[0]
                pieces = _filled(start, reach, self.block[0], self.block[0])
                pieces = _opened(pieces, corner.openings, course, (start, reach), self.block[0])
                for number, piece in enumerate(pieces, 1):
                    found.append(self._stone(f"{corner.end}.{course + 1}.{number}", branch, course, piece))
        if self.base is not None:
            found.append(self._slab(frame, self.base))
        return found

    def _stone(self, name: str, frame: Frame, course: int, piece: Interval) -> Block:
        length, thickness, height = self.block
        edge = piece[1] - piece[0]
        whole = round(2.0 * edge / length) * 0.5 * length  # equal blocks share one shape to the last bit
        if abs(edge - whole) <= _SAME * length:
            edge = whole
        place = frame.point(0.5 * (piece[0] + piece[1]), 0.0, (course + 0.5) * height)
        return stone_of(self, name, box=(edge, thickness, height), position=place, orientation=frame.turn)

    def _slab(self, frame: Frame, base: float) -> Block:
        """The fixed base under wall and returns."""
        length, thickness, _ = self.block
        front, back = -0.5 * thickness, 0.5 * thickness
        for corner in self.returns:
            reach = corner.blocks * length
            if corner.side == "front":
                front = min(front, 0.5 * thickness - reach)
            else:
                back = max(back, reach - 0.5 * thickness)
        centre = frame.point(0.5 * self.length, 0.5 * (front + back), -0.5 * base)
        edges = (self.length + 2.0 * base, back - front + 2.0 * base, base)
        return stone_of(self, "base", box=edges, position=centre, orientation=frame.turn, fixed=True)

    def _branch(self, corner: Return) -> Frame:
        """The frame of a return: it starts at the outer face of the wall, and its axis runs away from there."""
        half = 0.5 * self.block[1]
        x = half if corner.end == "left" else self.length - half
        y, turn = (-half, 90.0) if corner.side == "back" else (half, -90.0)
        return Frame(Frame(self.position, self.heading).point(x, y, 0.0), self.heading + turn)

    def _course(self, course: int, left: bool, right: bool) -> list[Interval]:
        """The pieces of one course of the wall itself, from the left."""
        length, thickness, _ = self.block
        if self.pattern is not None:
            pieces = _laid(self.pattern[course % len(self.pattern)], length)
        elif course % 2 == 0:
            pieces = _filled(0.0, self.length, length, length)
        else:
            # at a corner the return takes this course through
            start, stop = (thickness if left else 0.0), self.length - (thickness if right else 0.0)
            first = {"half": self.bond, "quoin": 1.0 + self.bond, "toothed": self.bond}[self.ends] * length
            pieces = _filled(start, stop, length if left else first, length)
            if self.ends == "toothed":
                pieces = [p for i, p in enumerate(pieces) if left or i > 0]
                pieces = pieces if right else pieces[:-1]
            elif self.ends == "quoin" and not right:
                pieces[-2:] = [(pieces[-2][0], pieces[-1][1])]
        return _opened(pieces, self.openings, course, (0.0, self.length), length)


def _checked_pattern(pattern, label: str) -> tuple[str, ...]:
    pattern = [pattern] if isinstance(pattern, str) else pattern
    require_type(isinstance(pattern, list | tuple), f"pattern{label}", pattern, "a list of texts, one a course")
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
        bound = f"it is {length:g} blocks long and pattern[0] {lengths[0]:g}; fill it with o or ."
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


def _filled(start: float, stop: float, first: float, length: float) -> list[Interval]:
    """Pieces from ``start`` to ``stop``: one of length ``first``, then whole blocks, the last as long as it must be."""
    number = max(0, math.ceil((stop - start - first) / length - _SAME))
    joints = [start, *(start + first + i * length for i in range(number)), stop]
    return _made_up(list(zip(joints[:-1], joints[1:], strict=True)), length)


def _opened(
    pieces: list[Interval], openings: tuple[Opening, ...], course: int, ends: Interval, length: float
) -> list[Interval]:
    """The pieces of a course (from 0) that reaches between ``ends``, cut at openings and bridged by their lintels."""
    for opening in openings:
        if opening.courses[0] <= course + 1 <= opening.courses[1]:
            pieces = _without(pieces, opening.span, length)
        elif opening.lintel is not None and course == opening.courses[1]:
            span = (max(ends[0], opening.span[0] - opening.lintel), min(ends[1], opening.span[1] + opening.lintel))
            pieces = sorted([*_without(pieces, span, length), span])
    return pieces


def _without(pieces: list[Interval], span: Interval, length: float) -> list[Interval]:
    """The pieces cut where ``span`` is taken out."""
    start, stop = span
    rest = [(s, min(e, start)) for s, e in pieces if s < start] + [(max(s, stop), e) for s, e in pieces if e > stop]
    return _made_up([(s, e) for s, e in rest if e - s > _SAME * length], length)


def _made_up(pieces: list[Interval], length: float) -> list[Interval]:
    """Pieces too short to lay, made up with the neighbour that they touch: one piece of both, or two equal ones."""
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
