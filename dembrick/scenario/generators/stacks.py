"""Stacks: equal blocks on one another."""

from __future__ import annotations

from dataclasses import dataclass

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Prism, Vector
from dembrick.scenario.checks import assign, present, require, require_type, vector
from dembrick.scenario.generators.placing import Frame, check_common, check_count, check_lengths, stone_of


@dataclass(frozen=True, slots=True)
class Stack:
    """``blocks`` equal blocks on one another: a ``box`` (edges, m) or a ``prism`` each, a column of drums.

    ``position`` is the foot of the stack: the origin of the shape, at the bottom of the lowest block. ``base`` (m)
    adds a fixed slab, so thick and reaching so far beyond the stack. The whole is turned
    by ``heading`` (deg). Blocks of ``material``, and of a ``group``, are called ``name``.1, ``name``.2, ... from the
    bottom, the slab name.base.
    """

    name: str
    material: str
    blocks: int
    box: Vector | None = None
    prism: Prism | None = None
    base: float | None = None
    position: Vector = (0.0, 0.0, 0.0)
    heading: float = 0.0
    group: str | None = None

    def __post_init__(self):
        label = check_common(self, "stack")
        check_count(self, label, "blocks")
        if (self.box is None) == (self.prism is None):
            raise ScenarioError(f"a shape is missing or given twice{label}; give it one of box, prism")
        if self.box is not None:
            assign(self, box=vector("box", self.box, label=label))
            require(min(self.box) > 0.0, f"box{label}", self.box, "every edge must be longer than 0 m")
        else:
            require_type(isinstance(self.prism, Prism), f"prism{label}", self.prism, "a Prism")
        check_lengths(self, label, "base")

    def count(self) -> int:
        return self.blocks + (self.base is not None)

    def build(self) -> list[Block]:
        """The blocks from the bottom to the top, the slab last."""
        frame = Frame(self.position, self.heading)
        if self.box is not None:
            height, (x, y) = self.box[2], (0.5 * self.box[0], 0.5 * self.box[1])
            reach = (-x, x, -y, y)
        else:
            prism = present(self.prism)
            height = prism.height
            xs, ys = zip(*prism.polygon, strict=True)
            reach = (min(xs), max(xs), min(ys), max(ys))
        found = [
            stone_of(self, str(k + 1), box=self.box, prism=self.prism, position=place, orientation=frame.turn)
            for k, place in enumerate(frame.point(0.0, 0.0, (k + 0.5) * height) for k in range(self.blocks))
        ]
        if self.base is not None:
            left, right, front, back = reach
            edges = (right - left + 2.0 * self.base, back - front + 2.0 * self.base, self.base)
            centre = frame.point(0.5 * (left + right), 0.5 * (front + back), -0.5 * self.base)
            found.append(stone_of(self, "base", box=edges, position=centre, orientation=frame.turn, fixed=True))
        return found
