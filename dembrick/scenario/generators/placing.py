"""Where a generated structure stands: a frame of its own, turned about the vertical and moved."""

from __future__ import annotations

import math

from dembrick.scenario.blocks import Block, Quaternion, Vector
from dembrick.scenario.checks import assign, assign_positive, check_name, one_line, real, require, require_type, vector


def about_z(angle: float) -> Quaternion:
    """Quaternion of a turn by ``angle`` (rad) about the vertical."""
    return (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))


def about_y(angle: float) -> Quaternion:
    """Quaternion of a turn by ``angle`` (rad) about y, which takes z towards x."""
    return (math.cos(0.5 * angle), 0.0, math.sin(0.5 * angle), 0.0)


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The turn ``q`` followed by the turn ``p``."""
    (a, b, c, d), (w, x, y, z) = p, q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


class Frame:
    """Coordinates of a structure: origin at ``position``, x along ``heading`` (deg, from the world's x towards y)."""

    def __init__(self, position: Vector, heading: float):
        quarters, rest = divmod(heading, 90.0)
        if rest == 0.0:  # a wall along y is straight to the last bit
            cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarters) % 4]
        else:
            cosine, sine = math.cos(math.radians(heading)), math.sin(math.radians(heading))
        self.origin, self.cosine, self.sine = position, cosine, sine
        self.turn = about_z(math.radians(heading))

    def point(self, x: float, y: float, z: float) -> Vector:
        """World coordinates of a point of the structure."""
        (ox, oy, oz), c, s = self.origin, self.cosine, self.sine
        return (ox + c * x - s * y, oy + s * x + c * y, oz + z)


def check_common(generator, kind: str) -> str:
    """Check what every generator has: name, material, group, position, heading; returns the label for messages."""
    label = f" of {kind} '{one_line('name', check_name('name', generator.name))}'"
    check_name(f"material{label}", generator.material)
    if generator.group is not None:
        check_name(f"group{label}", generator.group)
    assign(
        generator,
        position=vector("position", generator.position, label=label),
        heading=real(f"heading{label}", generator.heading),
    )
    return label


def stone_of(generator, name: str, **description) -> Block:
    """A block of a generator, of its material and group, with its name before its own."""
    return Block(f"{generator.name}.{name}", generator.material, group=generator.group, **description)


def check_lengths(generator, label: str, *keys: str) -> None:
    """Each of ``keys`` is a length (m) above 0, or None if that is allowed."""
    for key in keys:
        if getattr(generator, key) is not None:
            assign_positive(generator, key, "m", label)


def check_count(generator, label: str, key: str, least: int = 1) -> None:
    """``key`` is a whole number of at least ``least``."""
    value = getattr(generator, key)
    whole = isinstance(value, int) and not isinstance(value, bool)
    require_type(whole, f"{key}{label}", value, "a whole number")
    require(value >= least, f"{key}{label}", value, f"it must be at least {least}")
