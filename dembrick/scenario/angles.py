"""Angles of a scenario, in degrees, that look as if they were given in radians."""

from __future__ import annotations

import math

OF_SPRINGING = math.pi / 12.0  # rad: arches and domes span a multiple of it, as a rule
NEAR_TURN = 3e-3  # of an angle: as near to a part of a turn in radians as one written with three digits


def in_radians(angle: float, least: float) -> bool:
    """Whether an angle is a multiple of ``least`` (rad), up to a whole turn."""
    parts = round(abs(angle) / least)
    return 0 < parts * least < 2.1 * math.pi and abs(abs(angle) - parts * least) <= NEAR_TURN * abs(angle)


def in_degrees(angle: float) -> str:
    """An angle (deg) that may have been meant in radians, with what to write then."""
    return f"{angle:g} is in degrees, {math.radians(angle):.3g} rad; for {angle:g} rad write {math.degrees(angle):.4g}"
