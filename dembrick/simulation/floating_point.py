"""Floating-point faults in engines: a division by zero or a number that is none ends the run, it never warns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dembrick.errors import DivergedError


@contextmanager
def faults_raised() -> Iterator[None]:
    """Within, numpy raises where it would warn of a division by zero or of an invalid operation, and the caller gets a
    DivergedError. Where such a thing is meant, an inner ``np.errstate`` says so."""
    try:
        with np.errstate(divide="raise", invalid="raise"):
            yield
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        raise DivergedError(
            f"a floating-point fault in the computation ({error}), so that there is no answer; try another "
            "control.tolerance or stiffness, and please report the scenario"
        ) from error


def not_nan(value: float, what: str) -> float:
    """The ``value``; DivergedError if it is NaN, with which every comparison would fail and ``max`` would say zero."""
    if math.isnan(value):
        raise DivergedError(f"{what} is no number, so that there is no answer; please report the scenario")
    return value
