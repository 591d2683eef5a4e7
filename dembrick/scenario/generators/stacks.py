"""Stacks of equal blocks; and the local frame in which any generated structure is placed, rotated about the vertical
and translated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Prism, Quaternion, Vector
from dembrick.scenario.checks import check_name, one_line, present, require, vector
from dembrick.scenario.declared import Key, check_keys, count, declare, naming, number, positive, table, vector_of

# keys that all generators have
NAME = naming("text", "name of the structure, with which the names of its blocks begin")
MATERIAL = naming("a material", "what its blocks are made of")
POSITION = vector_of("m", "where it stands")
HEADING = number("deg", "direction of its axis about z; zero is along x")
GROUP = naming("text", "a further group that its blocks belong to")


def edges(meaning: str) -> dict[str, Key]:
    """Metadata of the edge lengths of a box (m)."""

    def check(key: str, value, label: str) -> Vector:
        x, y, z = found = vector(key, value, label=label)
        require(min(found) > 0.0, f"{key}{label}", found, "every edge must be longer than 0 m")
        return x, y, z

    return declare("3 numbers > 0", meaning, "m", check)


@dataclass(frozen=True, slots=True)
class Stack:
    """A stack of ``blocks`` equal blocks, each a ``box`` (edges, m) or a ``prism``, such as a column of drums.

    ``position`` is the foot of the stack: the origin of the shape, at the bottom of the lowest block. ``base`` (m)
    adds a fixed slab of that thickness, which extends as far beyond the stack. The whole is rotated by ``heading``
    (deg). Blocks, of ``material`` and in the ``group`` if one is given, are called ``name``.1, ``name``.2, ... from the
    bottom up, the slab name.base.
    """

    name: str = field(metadata=NAME)
    material: str = field(metadata=MATERIAL)
    blocks: int = field(metadata=count(1, "number of blocks"))
    box: Vector | None = field(default=None, metadata=edges("edge lengths of each block"))
    prism: Prism | None = field(default=None, metadata=table(Prism, "or the prism of each, for instance a drum"))
    base: float | None = field(default=None, metadata=positive("m", "thickness of a fixed slab below"))
    position: Vector = field(default=(0.0, 0.0, 0.0), metadata=POSITION)
    heading: float = field(default=0.0, metadata=HEADING)
    group: str | None = field(default=None, metadata=GROUP)

    def __post_init__(self):
        label = check_generator(self, "stack")
        if (self.box is None) == (self.prism is None):
            raise ScenarioError(f"a shape is missing or given twice{label}; give it one of box, prism")

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


def about_z(angle: float) -> Quaternion:
    """Quaternion of a rotation by ``angle`` (rad) about the vertical."""
    return (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))


def about_y(angle: float) -> Quaternion:
    """Quaternion of a rotation by ``angle`` (rad) about y, which takes z towards x."""
    return (math.cos(0.5 * angle), 0.0, math.sin(0.5 * angle), 0.0)


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The rotation ``q`` followed by the rotation ``p``."""
    (a, b, c, d), (w, x, y, z) = p, q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


class Frame:
    """Local frame of a structure: origin at ``position``, x along ``heading`` (deg, from the world's x towards y)."""

    def __init__(self, position: Vector, heading: float):
        quarters, rest = divmod(heading, 90.0)
        if rest == 0.0:  # multiples of 90 deg are exact
            cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
        else:
            cosine, sine = math.cos(math.radians(heading)), math.sin(math.radians(heading))
        self.origin, self.cosine, self.sine = position, cosine, sine
        self.turn = about_z(math.radians(heading))

    def point(self, x: float, y: float, z: float) -> Vector:
        """World coordinates of a point in local coordinates."""
        (ox, oy, oz), c, s = self.origin, self.cosine, self.sine
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)


def check_generator(generator, kind: str) -> str:
    """Check the keys of a generator of a ``kind``; return the label for messages, which contains its name."""
    label = f" of {kind} '{one_line('name', check_name('name', generator.name))}'"
    check_keys(generator, label)
    return label


def stone_of(generator, name: str, **description) -> Block:
    """A block of a generator, with its material and group, and its name as a prefix."""
    return Block(f"{generator.name}.{name}", generator.material, group=generator.group, **description)
