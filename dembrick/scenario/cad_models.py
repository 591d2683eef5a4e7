"""Structures drawn in CAD: a file of many solids, each of which becomes a named block."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Part, Vector
from dembrick.scenario.checks import assign, nearest, require, require_type, show
from dembrick.scenario.declared import choice, declare, naming, not_negative
from dembrick.scenario.generators.stacks import (
    GROUP,
    HEADING,
    MATERIAL,
    NAME,
    POSITION,
    Frame,
    check_generator,
    stone_of,
)
from dembrick.scenario.units import LENGTHS

NEAR = 5e-3  # of the smallest solid: faces closer than this may have been meant to touch, which a remark says


@dataclass(frozen=True, slots=True)
class CadModel:
    """The solids of a CAD ``file`` (OBJ, STL, glTF, COMPAS JSON and others); a relative path starts at the scenario's
    folder. Each solid must be closed and becomes a block called ``name``.SOLID, of the ``material`` and in the
    ``group``; if it is not convex, the block consists of convex parts.

    ``unit``: unit of the lengths (m, cm, mm, in or ft). Facing faces of two solids that are closer than
    ``gap_tolerance`` (m) are moved onto one plane, so that they touch; remarks say how many. ``position`` and
    ``heading`` move and rotate the whole model. ``united``: lists of solids that form one rigid block each, named after
    the first (pieces of one stone drawn separately); it is a support if the file marks any of them as one.
    """

    name: str = field(metadata=NAME)
    file: str = field(
        metadata=naming(
            "a path", "OBJ, STL, glTF (.gltf, .glb), COMPAS JSON, PLY, .msh or .vtu file, beside the scenario"
        )
    )
    unit: str = field(metadata=choice(tuple(LENGTHS), "unit of the lengths in the file"))
    material: str = field(metadata=MATERIAL)
    gap_tolerance: float = field(
        default=0.0,
        metadata=not_negative(
            "m", "faces of two solids that face each other closer than this are moved onto one plane"
        ),
    )
    position: Vector = field(default=(0.0, 0.0, 0.0), metadata=POSITION)
    heading: float = field(default=0.0, metadata=HEADING)
    group: str | None = field(default=None, metadata=GROUP)
    united: tuple[tuple[str, ...], ...] = field(
        default=(), metadata=declare("lists of names", "solids that form one rigid block, named after the first")
    )

    def __post_init__(self):
        label = check_generator(self, "model")
        assign(self, united=self._checked_united(label))

    def _checked_united(self, label: str) -> tuple[tuple[str, ...], ...]:
        key, wanted = f"united{label}", "lists of names of solids"
        require_type(isinstance(self.united, list | tuple), key, self.united, wanted)
        for names in self.united:
            texts = isinstance(names, list | tuple) and all(isinstance(name, str) for name in names)
            require_type(texts, key, names, wanted)
            require(len(names) >= 2, key, names, "a united block needs at least 2 solids")
        every = [name for names in self.united for name in names]
        twice = next((name for name in every if every.count(name) > 1), None)
        require(twice is None, key, twice, "a solid can be named only once")
        return tuple(tuple(names) for names in self.united)

    def _block_of(self, solids, path: str) -> dict[str, tuple]:
        """Name of each block -> its solids, in the order of the file."""
        known = {solid.name: solid for solid in solids}
        first = {name: names[0] for names in self.united for name in names}
        for name in first:
            if name not in known:
                raise ScenarioError(f"{path}: united = {show(name)} is not the name of a solid; {nearest(name, known)}")
        found: dict[str, tuple] = {}
        for solid in solids:
            block = first.get(solid.name, solid.name)
            found[block] = (*found.get(block, ()), solid)
        return found

    def build(self, path: str) -> tuple[list[Block], list[str]]:
        """Return the blocks of the file at ``path``, and remarks on gaps."""
        stamp = os.stat(path).st_mtime_ns if os.path.isfile(path) else 0
        solids, closed, near = _read(path, stamp, LENGTHS[self.unit], self.gap_tolerance)
        frame = Frame(self.position, self.heading)
        blocks = []
        for name, members in self._block_of(solids, path).items():
            shape: dict[str, Any] = {"vertices": members[0].corners}
            if len(members) > 1:
                shape = {"parts": tuple(Part(vertices=solid.corners) for solid in members)}
            fixed = any(solid.fixed for solid in members)
            blocks.append(stone_of(self, name, position=frame.origin, orientation=frame.turn, fixed=fixed, **shape))
        remarks, who = [], f"model {show(self.name)}"
        if closed:
            remarks.append(
                f"{who}: {_pairs(closed)} up to {_millimetres(closed)} mm apart or overlapping were moved onto one "
                f"plane (gap_tolerance = {self.gap_tolerance:g} m)"
            )
        if near:
            first = max(near, key=lambda gap: gap.distance)
            a, b = solids[first.first[0]].name, solids[first.second[0]].name
            remarks.append(
                f"{who}: {_pairs(near)} up to {_millimetres(near)} mm apart or overlapping share no joint, "
                f"among them those of {show(a)} and {show(b)}; gap_tolerance = {_enough(first.distance):g} closes them"
            )
        return blocks, remarks


@lru_cache(maxsize=8)
def _read(path: str, stamp: int, scale: float, tolerance: float):
    """Return the solids of a file, the gaps that were closed and, without a tolerance, the gaps that may be unintended;
    ``stamp`` is the modification time of the file, for the cache."""
    from dembrick.geometry import cad_file, closed_gaps  # imported here, as only scenarios with models need the readers

    solids = cad_file.read(path, scale)
    if tolerance > 0.0:
        return *closed_gaps.close(solids, tolerance), []
    smallest = min(float((solid.corners.max(axis=0) - solid.corners.min(axis=0)).max()) for solid in solids)
    return solids, [], closed_gaps.gaps(solids, NEAR * smallest)


def _pairs(gaps) -> str:
    return f"{len(gaps)} pair{'s' if len(gaps) != 1 else ''} of faces"


def _millimetres(gaps) -> str:
    return f"{1e3 * max(gap.distance for gap in gaps):.3g}"


def _enough(distance: float) -> float:
    """A round tolerance that is slightly larger."""
    return float(f"{1.2 * distance:.1g}") if float(f"{1.2 * distance:.1g}") > distance else float(f"{2 * distance:.1g}")
