"""From what a scenario says of a shape to the shape: equal descriptions share one object."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dembrick.blocks import Block, Prism, Voussoir
from dembrick.checks import show
from dembrick.errors import ScenarioError
from dembrick.polyhedra import hull, prism, voussoir
from dembrick.shapes import Polyhedron, box


def shapes_of(blocks: Sequence[Block]) -> tuple[Polyhedron, ...]:
    """The shape of every block; ScenarioError names the block whose description makes none."""
    known: dict[tuple, Polyhedron] = {}
    shapes = []
    for block in blocks:
        solid = block.solid
        shape = known.get(solid)
        if shape is None:
            try:
                shape = known[solid] = _shape(*solid)
            except ScenarioError as error:
                raise ScenarioError(f"block {show(block.name)}: {error}") from None
        shapes.append(shape)
    return tuple(shapes)


def _shape(kind: str, description) -> Polyhedron:
    if kind == "box":
        return box(description)
    if kind == "vertices":
        return hull(description)
    if isinstance(description, Prism):
        return prism(description.polygon, description.height)
    assert isinstance(description, Voussoir)
    stone = description
    return voussoir(stone.radius, stone.thickness, stone.depth, math.radians(stone.angle), stone.curved)
