"""Structures drawn in CAD: a file of many solids, each of which becomes a named block."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import lru_cache

from dembrick.scenario.blocks import Block, Vector
from dembrick.scenario.checks import assign, check_name, one_of, real, require, show
from dembrick.scenario.generators.placing import Frame, check_common, stone_of
from dembrick.scenario.units import LENGTHS

_NEAR = 5e-3  # of the smallest solid: faces nearer than this may have been meant to touch, and a remark says so


@dataclass(frozen=True, slots=True)
class CadModel:
    """The solids of a CAD ``file`` (OBJ, STL, glTF, COMPAS JSON and others), beside the scenario unless the path says
    else. Each must be closed and convex, and becomes a block called name.SOLID.

    ``unit`` of its lengths: m, cm, mm, in or ft. Faces of two solids that look at each other nearer than
    ``gap_tolerance`` (m) come to lie on one plane, so that they touch; remarks say how many. ``position`` and
    ``heading`` move and turn the whole.
    """

    name: str
    file: str
    unit: str
    material: str
    gap_tolerance: float = 0.0
    position: Vector = (0.0, 0.0, 0.0)
    heading: float = 0.0
    group: str | None = None

    def __post_init__(self):
        label = check_common(self, "model")
        check_name(f"file{label}", self.file)
        one_of(f"unit{label}", self.unit, tuple(LENGTHS))
        tolerance = real(f"gap_tolerance{label}", self.gap_tolerance)
        require(tolerance >= 0.0, f"gap_tolerance{label}", tolerance, "it must be at least 0 m")
        assign(self, gap_tolerance=tolerance)

    def build(self, path: str) -> tuple[list[Block], list[str]]:
        """The blocks of the file at ``path``, and remarks on gaps."""
        stamp = os.stat(path).st_mtime_ns if os.path.isfile(path) else 0
        solids, closed, near = _read(path, stamp, LENGTHS[self.unit], self.gap_tolerance)
        frame = Frame(self.position, self.heading)
        blocks = [
            stone_of(self, s.name, vertices=s.corners, position=frame.origin, orientation=frame.turn, fixed=s.fixed)
            for s in solids
        ]
        remarks, who = [], f"model {show(self.name)}"
        if closed:
            remarks.append(
                f"{who}: {_pairs(closed)} up to {_millimetres(closed)} mm apart or inside one another were put on one "
                f"plane (gap_tolerance = {self.gap_tolerance:g} m)"
            )
        if near:
            first = max(near, key=lambda gap: gap.distance)
            a, b = solids[first.first[0]].name, solids[first.second[0]].name
            remarks.append(
                f"{who}: {_pairs(near)} up to {_millimetres(near)} mm apart or inside one another share no joint, "
                f"those of {show(a)} and {show(b)} among them; gap_tolerance = {_enough(first.distance):g} closes them"
            )
        return blocks, remarks


@lru_cache(maxsize=8)
def _read(path: str, stamp: int, scale: float, tolerance: float):
    """Solids of a file, the gaps that were closed, and without a tolerance those that might have been meant to be;
    ``stamp`` is when it was written."""
    from dembrick.geometry import cad_file, closed_gaps  # only scenes with models pay for the readers

    solids = cad_file.read(path, scale)
    if tolerance > 0.0:
        return *closed_gaps.close(solids, tolerance), []
    smallest = min(float((solid.corners.max(axis=0) - solid.corners.min(axis=0)).max()) for solid in solids)
    return solids, [], closed_gaps.gaps(solids, _NEAR * smallest)


def _pairs(gaps) -> str:
    return f"{len(gaps)} pair{'s' if len(gaps) != 1 else ''} of faces"


def _millimetres(gaps) -> str:
    return f"{1e3 * max(gap.distance for gap in gaps):.3g}"


def _enough(distance: float) -> float:
    """A round tolerance that is a little larger."""
    return float(f"{1.2 * distance:.1g}") if float(f"{1.2 * distance:.1g}") > distance else float(f"{2 * distance:.1g}")
