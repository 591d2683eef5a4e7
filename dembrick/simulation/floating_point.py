"""Floating-point faults in engines: a division by zero or an invalid number ends the run with an error, not a
warning.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dembrick.errors import DivergedError


@contextmanager
def faults_raised() -> Iterator[None]:
    """Context in which numpy raises for a division by zero or an invalid operation, which becomes a DivergedError.
    Intended ones are exempted by an inner ``np.errstate``."""
    try:
        with np.errstate(divide="raise", invalid="raise"):
            yield
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        raise DivergedError(
            f"no answer because of a floating-point error ({error}); try another control.tolerance or stiffness, and "
            "please report the scenario"
        ) from error


def not_nan(value: float, what: str) -> float:
    """The ``value``; DivergedError if it is NaN, which would fail every comparison and could get lost in ``max``."""
    if math.isnan(value):
        raise DivergedError(f"no answer because {what} is not a number; please report the scenario")
    return value
