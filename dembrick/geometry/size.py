"""Sizes of blocks that doubles can compute with: far beyond what anyone builds, far within what a double holds."""

from __future__ import annotations

from dembrick.errors import ScenarioError

SMALLEST, LARGEST = 1e-9, 1e9  # m: of a block


def check_size(size: float) -> None:
    """ScenarioError if a block is ``size`` (m) across and cannot be."""
    if not SMALLEST <= size <= LARGEST:
        raise ScenarioError(f"it is {size:.3g} m across; from {SMALLEST:g} to {LARGEST:g} m are taken")
