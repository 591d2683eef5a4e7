"""Shapes made from the descriptions in a scenario; equal descriptions share one object."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.convex_hull import compound, hull, prism, voussoir
from dembrick.geometry.shapes import LARGEST, SMALLEST, Polyhedron, Shape, box
from dembrick.scenario.blocks import Block, Mesh, Part, Prism
from dembrick.scenario.checks import show


def shapes_of(blocks: Sequence[Block], path_of: Callable[[str], str] = str) -> tuple[Shape, ...]:
    """The shape of every block; a ScenarioError names the block whose description is invalid.

    ``path_of`` maps the name of a mesh file to its path.
    """
    known: dict[tuple, Shape] = {}
    shapes = []
    for block in blocks:
        solid = block.solid
        shape = known.get(solid)
        if shape is None:
            try:
                shape = known[solid] = _sized(*solid, path_of)
            except ScenarioError as error:
                raise ScenarioError(f"block {show(block.name)}: {error}") from None
        shapes.append(shape)
    return tuple(shapes)


def _sized(kind: str, description, path_of: Callable[[str], str]) -> Shape:
    """The shape, after a check that its size can be computed with."""
    with np.errstate(all="ignore"):  # volume and inertia of extreme sizes overflow
        try:
            shape = _shape(kind, description, path_of)
            size, corners = shape.diameter, shape.vertices
            spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
            thickness = 2.0 * float(spread[-1]) / math.sqrt(len(corners))  # the shortest edge of a box
        except (np.linalg.LinAlgError, ArithmeticError):
            size = thickness = math.nan
    if math.isnan(size) or math.isnan(thickness):
        raise ScenarioError(f"its lengths are too extreme; a block must be {SMALLEST:g} to {LARGEST:g} m across")
    if not SMALLEST <= size <= LARGEST:
        raise ScenarioError(f"it is {size:.3g} m across; it must be from {SMALLEST:g} to {LARGEST:g} m")
    if thickness < SMALLEST:
        raise ScenarioError(f"it is {thickness:.3g} m thick; it must be at least {SMALLEST:g} m")
    return shape


def _shape(kind: str, description, path_of: Callable[[str], str]) -> Shape:
    if kind == "parts":
        return _compound(description, path_of)
    solids = _convex(kind, description, path_of)
    if len(solids) == 1:
        return solids[0]
    return compound(solids, np.zeros((len(solids), 3)), [(1.0, 0.0, 0.0, 0.0)] * len(solids))


def _compound(parts: Sequence[Part], path_of: Callable[[str], str]) -> Shape:
    solids, positions, orientations = [], [], []
    for number, part in enumerate(parts):
        try:
            found = _convex(*part.solid, path_of)
        except ScenarioError as error:
            raise ScenarioError(f"parts[{number}]: {error}") from None
        solids += found
        positions += [part.position] * len(found)
        orientations += [part.orientation] * len(found)
    return compound(solids, positions, orientations)


def _convex(kind: str, description, path_of: Callable[[str], str]) -> list[Polyhedron]:
    """The convex parts of a solid; only a mesh may have several."""
    if kind == "box":
        return [box(description)]
    if kind == "vertices":
        return [hull(description)]
    if isinstance(description, Prism):
        return [prism(description.polygon, description.height)]
    if isinstance(description, Mesh):
        from dembrick.geometry.mesh_file import convex_solids  # only scenarios with meshes need the reader

        return convex_solids(path_of(description.file), description.metres)
    stone = description
    return [voussoir(stone.radius, stone.thickness, stone.depth, math.radians(stone.angle), stone.curved)]
