"""Arches and domes: stones between radial joints, and the fixed springers that carry them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dembrick.scenario.angles import OF_SPRINGING, in_degrees, in_radians
from dembrick.scenario.blocks import Block, Quaternion, Vector, Voussoir
from dembrick.scenario.checks import present, real, require
from dembrick.scenario.declared import Key, count, declare, positive, truth
from dembrick.scenario.generators.stacks import (
    GROUP,
    HEADING,
    MATERIAL,
    NAME,
    POSITION,
    Frame,
    about_y,
    about_z,
    check_generator,
    product,
    stone_of,
)


def degrees(most: float, meaning: str, bound: str, closed: bool = False) -> dict[str, Key]:
    """Metadata of an angle (deg) between 0 and ``most``, including ``most`` if the range is ``closed``."""

    def check(key: str, value, label: str) -> float:
        angle = real(key + label, value)
        require(0.0 < angle < most or (closed and angle == most), key + label, angle, bound)
        return angle

    return declare(f"0 to {most:g}", meaning, "deg", check)


def _reach(radius: float, thickness: float) -> float:
    """How far the springers extend on either side beyond the stones that they carry (m)."""
    return min(0.5 * thickness, 0.5 * (radius - 0.5 * thickness))


@dataclass(frozen=True, slots=True)
class Arch:
    """A circular arch of ``voussoirs`` equal stones: mean ``radius``, ``thickness`` and ``depth`` in m.

    ``angle`` (deg) is the angle of embrace, 180 for a semicircle. ``position`` is the centre of the circle; the arch
    stands in the x-z plane (or along ``heading``, deg) with its crown above the centre; its ``depth`` extends along y,
    half on either side of the centre. ``curved``: mass, centroid and inertia of the stones are those of ring segments
    (:class:`dembrick.scenario.blocks.Voussoir`). ``abutments`` puts a fixed stone, wider than the arch, under each
    springing; without them something else must carry the arch.

    The stones, of ``material`` and in the ``group`` if one is given, are called ``name``.1, ``name``.2, ... from the
    left springing (towards -x) to the right; the abutments name.left and name.right.
    """

    name: str = field(metadata=NAME)
    material: str = field(metadata=MATERIAL)
    radius: float = field(metadata=positive("m", "mean radius"))
    thickness: float = field(metadata=positive("m", "thickness of the ring, below twice the radius"))
    depth: float = field(metadata=positive("m", "length out of the plane"))
    voussoirs: int = field(metadata=count(2, "number of stones"))
    angle: float = field(
        default=180.0,
        metadata=degrees(
            360.0, "angle of embrace; 180 is a semicircle", "the angle of embrace must lie between 0 and 360 deg"
        ),
    )
    curved: bool = field(default=False, metadata=truth("weight, centroid and inertia of pieces of a ring"))
    abutments: bool = field(default=True, metadata=truth("a fixed stone under each springing"))
    position: Vector = field(default=(0.0, 0.0, 0.0), metadata=POSITION)
    heading: float = field(default=0.0, metadata=HEADING)
    group: str | None = field(default=None, metadata=GROUP)

    def __post_init__(self):
        label = check_generator(self, "arch")
        require(
            self.thickness < 2.0 * self.radius, f"thickness{label}", self.thickness, "it must be below twice the radius"
        )
        each = self.angle / self.voussoirs
        require(each < 180.0, f"angle{label}", self.angle, "a voussoir spans less than 180 deg")

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
                # in the plane of the springing, x points out of the arch at the right springing and into it at the left
                sine, cosine = math.sin(sign * half), math.cos(sign * half)
                out = sign * 0.5 * self.thickness
                centre = frame.point(self.radius * sine + out * cosine, 0.0, self.radius * cosine - out * sine)
                turn = product(frame.turn, about_y(sign * half))
                found.append(stone_of(self, side, box=edges, position=centre, orientation=turn, fixed=True))
        return found


@dataclass(frozen=True, slots=True)
class Dome:
    """A spherical dome: ``rings`` of ``blocks`` equal stones each; mean ``radius`` and ``thickness`` in m.

    ``angle`` (deg) is measured from the vertical axis to the springing, 90 for a hemisphere; ``oculus`` (deg) from the
    axis to the rim of the oculus. Without an oculus, the rings end at the angle ``key`` (deg) and one keystone closes
    the dome. The corners of the stones lie on the two spheres, and their faces are plane: therefore all joints are
    planes through the centre, and stones of neighbouring rings stand directly above each other. ``position`` is the
    centre of the sphere. A ring of fixed stones, thicker than the dome, carries the lowest ring (``springing`` = false
    leaves it out).

    The dome is rotated by ``heading`` (deg). Stones, of ``material`` and in the ``group`` if one is given, are called
    ``name``.ring.number, with rings counted from the springing up; the keystone name.key; the fixed ones
    name.springing.number.
    """

    name: str = field(metadata=NAME)
    material: str = field(metadata=MATERIAL)
    radius: float = field(metadata=positive("m", "mean radius"))
    thickness: float = field(metadata=positive("m", "thickness of the shell, below twice the radius"))
    rings: int = field(metadata=count(1, "number of rings"))
    blocks: int = field(metadata=count(3, "stones in a ring"))
    angle: float = field(
        default=90.0,
        metadata=degrees(
            120.0,
            "angle from the axis to the springing; 90 is a hemisphere",
            "it must lie between 0 and 120; 90 is a hemisphere",
            closed=True,
        ),
    )
    oculus: float | None = field(
        default=None,
        metadata=degrees(60.0, "angle from the axis to the rim of an open eye", "it must lie between 0 and 60"),
    )
    key: float | None = field(
        default=None,
        metadata=degrees(
            60.0, "or the angle from the axis to the rim of the key stone", "it must lie between 0 and 60"
        ),
    )
    springing: bool = field(default=True, metadata=truth("a ring of fixed stones below"))
    position: Vector = field(default=(0.0, 0.0, 0.0), metadata=POSITION)
    heading: float = field(default=0.0, metadata=HEADING)
    group: str | None = field(default=None, metadata=GROUP)

    def __post_init__(self):
        label = check_generator(self, "dome")
        require(
            self.thickness < 2.0 * self.radius, f"thickness{label}", self.thickness, "it must be below twice the radius"
        )
        one = (self.oculus is None) != (self.key is None)
        require(one, f"oculus{label}", self.oculus, "give either oculus (an open eye) or key (a key stone), in deg")
        which, rim = ("key", present(self.key)) if self.oculus is None else ("oculus", self.oculus)
        turned = f"; angle = {in_degrees(self.angle)}" if in_radians(self.angle, OF_SPRINGING) else ""
        bound = f"it must lie between 0 and {min(self.angle, 60.0):g}{turned}"
        require(rim < self.angle, f"{which}{label}", rim, bound)

    def count(self) -> int:
        return self.blocks * (self.rings + self.springing) + (self.key is not None)

    def build(self) -> list[Block]:
        """The rings from the springing to the oculus, the keystone, the fixed ring."""
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
