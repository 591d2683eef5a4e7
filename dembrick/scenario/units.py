"""Units that a table of numbers may be written in, by the quantity, and what each is worth in SI."""

from __future__ import annotations

STANDARD_GRAVITY = 9.80665  # m/s2: the unit "g", whatever the gravity of a scenario

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}  # units of drawings, in metres
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "acceleration": {"m/s2": 1.0, "cm/s2": 1e-2, "mm/s2": 1e-3, "Gal": 1e-2, "g": STANDARD_GRAVITY},
    "force": {"N": 1.0, "kN": 1e3, "MN": 1e6},
    "factor": {"1": 1.0, "-": 1.0, "%": 1e-2},
}
_SAME = str.maketrans({"²": "2", "μ": "µ", "−": "-", " ": None, "^": None, "*": None})  # noqa: RUF001
_SPELLED = {"sec": "s", "m/s/s": "m/s2", "cm/s/s": "cm/s2", "mm/s/s": "mm/s2", "gal": "Gal", "micron": "µm"}


def size_of(quantity: str, unit: str) -> float | None:
    """What a unit of the quantity is worth in SI; None if it is no unit of that quantity."""
    unit = unit.translate(_SAME)
    return UNITS[quantity].get(_SPELLED.get(unit, unit))


def known(quantity: str) -> str:
    """The units of a quantity, for a message."""
    return ", ".join(UNITS[quantity])
