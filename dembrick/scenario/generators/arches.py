"""Arches and domes: stones between radial joints, and the fixed stones that they spring from."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dembrick.scenario.blocks import Block, Quaternion, Vector, Voussoir
from dembrick.scenario.checks import assign, present, real, require, require_type
from dembrick.scenario.generators.stacks import (
    Frame,
    about_y,
    about_z,
    check_common,
    check_count,
    check_lengths,
    product,
    stone_of,
)


def _reach(radius: float, thickness: float) -> float:
    """How far the stones of a springing reach beyond those that rest on them, on either side (m)."""
    return min(0.5 * thickness, 0.5 * (radius - 0.5 * thickness))


@dataclass(frozen=True, slots=True)
class Arch:
    """A circular arch of ``voussoirs`` equal stones: mean ``radius``, ``thickness`` and ``depth`` in m.

    ``angle`` (deg) is the angle of embrace, 180 for a semicircle. ``position`` is the centre of the circle; the arch
    stands in the x-z plane (or along ``heading``, deg) with its crown above the centre, and its ``depth`` lies across,
    along y, half on either side of the centre. ``curved``: mass, centroid and inertia of the stones are those of pieces
    of a ring (:class:`dembrick.scenario.blocks.Voussoir`). ``abutments`` puts a fixed stone under
    each springing, wider than the arch; without them something else must carry it.

    Stones of ``material``, and of a ``group``, are called ``name``.1, ``name``.2, ... from the left springing (towards
    -x) to the right; the abutments name.left and name.right.
    """

    name: str
    material: str
    radius: float
    thickness: float
    depth: float
    voussoirs: int
    angle: float = 180.0
    curved: bool = False
    abutments: bool = True
    position: Vector = (0.0, 0.0, 0.0)
    heading: float = 0.0
    group: str | None = None

    def __post_init__(self):
        label = check_common(self, "arch")
        check_lengths(self, label, "radius", "thickness", "depth")
        require(self.thickness < 2.0 * self.radius, f"thickness{label}", self.thickness, "it must be below 2 radius")
        check_count(self, label, "voussoirs", 2)
        angle = real(f"angle{label}", self.angle)
        require(0.0 < angle < 360.0, f"angle{label}", angle, "the angle of embrace lies between 0 and 360 deg")
        require(angle < 180.0 * self.voussoirs, f"angle{label}", angle, "a voussoir spans less than 180 deg")
        assign(self, angle=angle)
        for key in ("curved", "abutments"):
            require_type(isinstance(getattr(self, key), bool), f"{key}{label}", getattr(self, key), "true or false")

    def count(self) -> int:
        return self.voussoirs + 2 * self.abutments

    def build(self) -> list[Block]:
        """The voussoirs from left to right, then the abutments."""
        frame = Frame(self.position, self.heading)
        stone = Voussoir(self.radius, self.thickness, self.depth, self.angle / self.voussoirs, self.curved)
        half, step = 0.5 * math.radians(self.angle), math.radians(self.angle) / self.voussoirs
        found = []
        for i in range(self.voussoirs):
            turn = product(frame.turn, about_y((i + 0.5 - 0.5 * self.voussoirs) * step))
            found.append(stone_of(self, str(i + 1), voussoir=stone, position=self.position, orientation=turn))
        if self.abutments:
            reach = _reach(self.radius, self.thickness)
            edges = (self.thickness, self.depth + 2.0 * reach, self.thickness + 2.0 * reach)
            for side, sign in (("left", -1.0), ("right", 1.0)):
                # in the plane of the springing, x points out of the arch at the right and into it at the left
                sine, cosine = math.sin(sign * half), math.cos(sign * half)
                out = sign * 0.5 * self.thickness
                centre = frame.point(self.radius * sine + out * cosine, 0.0, self.radius * cosine - out * sine)
                turn = product(frame.turn, about_y(sign * half))
                found.append(stone_of(self, side, box=edges, position=centre, orientation=turn, fixed=True))
        return found


@dataclass(frozen=True, slots=True)
class Dome:
    """A spherical dome: ``rings`` of ``blocks`` equal stones each; mean ``radius`` and ``thickness`` in m.

    ``angle`` (deg) reaches from the vertical axis down to the springing, 90 for a hemisphere; ``oculus`` (deg) from
    the axis to the rim of the open eye. Without an eye, rings end at a ``key`` (deg) and one key stone closes the
    dome. All joints are planes through the centre and stones of neighbouring rings stand above each other: only so
    do plane faces meet. The stones have plane faces: their corners lie on the two spheres. ``position`` is the centre
    of the sphere. A ring of fixed stones, thicker than the dome, carries the lowest ring (``springing`` = false
    leaves it out).

    The dome is turned by ``heading`` (deg). Stones of ``material``, and of a ``group``, are called
    ``name``.ring.number, rings from the springing up; the key stone name.key; the fixed ones name.springing.number.
    """

    name: str
    material: str
    radius: float
    thickness: float
    rings: int
    blocks: int
    angle: float = 90.0
    oculus: float | None = None
    key: float | None = None
    springing: bool = True
    position: Vector = (0.0, 0.0, 0.0)
    heading: float = 0.0
    group: str | None = None

    def __post_init__(self):
        label = check_common(self, "dome")
        check_lengths(self, label, "radius", "thickness")
        require(self.thickness < 2.0 * self.radius, f"thickness{label}", self.thickness, "it must be below 2 radius")
        check_count(self, label, "rings")
        check_count(self, label, "blocks", 3)
        angle = real(f"angle{label}", self.angle)
        require(0.0 < angle <= 120.0, f"angle{label}", angle, "it lies between 0 and 120; 90 is a hemisphere")
        assign(self, angle=angle)
        one = (self.oculus is None) != (self.key is None)
        require(one, f"oculus{label}", self.oculus, "give either oculus (an open eye) or key (a key stone), in deg")
        which = "key" if self.oculus is None else "oculus"
        rim = real(f"{which}{label}", getattr(self, which))
        require(0.0 < rim < min(angle, 60.0), f"{which}{label}", rim, f"it must lie between 0 and {min(angle, 60.0):g}")
        assign(self, **{which: rim})
        require_type(isinstance(self.springing, bool), f"springing{label}", self.springing, "true or false")

    def count(self) -> int:
        return self.blocks * (self.rings + self.springing) + (self.key is not None)

    def build(self) -> list[Block]:
        """The rings from the springing to the eye, the key stone, the fixed ring."""
        frame = Frame(self.position, self.heading)
        rim = math.radians(present(self.key if self.oculus is None else self.oculus))
        low, step = math.radians(self.angle), (math.radians(self.angle) - rim) / self.rings
        inner, outer = self.radius - 0.5 * self.thickness, self.radius + 0.5 * self.thickness
        turns = [product(frame.turn, about_z(2.0 * math.pi * k / self.blocks)) for k in range(self.blocks)]
        found = []
        for ring in range(self.rings):
            stone = self._stone(low - ring * step, low - (ring + 1) * step, inner, outer)
            found += self._ring(str(ring + 1), stone, turns)
        if self.key is not None:
            corners = tuple(
                self._corner(rim, (k + 0.5) * 2.0 * math.pi / self.blocks, r)
                for r in (inner, outer)
                for k in range(self.blocks)
            )
            found.append(stone_of(self, "key", vertices=corners, position=self.position, orientation=frame.turn))
        if self.springing:
            reach = _reach(self.radius, self.thickness)
            stone = self._stone(low + step, low, inner - reach, outer + reach)
            found += self._ring("springing", stone, turns, fixed=True)
        return found

    def _corner(self, polar: float, azimuth: float, radius: float) -> Vector:
        flat = radius * math.sin(polar)
        return (flat * math.cos(azimuth), flat * math.sin(azimuth), radius * math.cos(polar))

    def _stone(self, low: float, high: float, inner: float, outer: float) -> tuple[Vector, ...]:
        half = math.pi / self.blocks
        return tuple(self._corner(p, s * half, r) for r in (inner, outer) for p in (low, high) for s in (-1.0, 1.0))

    def _ring(self, name: str, stone: tuple[Vector, ...], turns: list[Quaternion], fixed: bool = False) -> list[Block]:
        return [
            stone_of(self, f"{name}.{k}", vertices=stone, position=self.position, orientation=turn, fixed=fixed)
            for k, turn in enumerate(turns, 1)
        ]
