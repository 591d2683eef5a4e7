"""Fewer equilibria on the paths of settlements and of driven displacements."""

import pytest

from dembrick.simulation.dynamics.paths import driven_path, load_path


def few_equilibria(patch: pytest.MonkeyPatch) -> None:
    """Let settlements have six equilibria and three short ones before them, and travels six that begin less gently."""
    patch.setattr(load_path, "EQUILIBRIA", 6)
    patch.setattr(load_path, "HALVINGS", 3)
    patch.setattr(load_path, "WITHIN", 1.0)
    patch.setattr(driven_path, "EQUILIBRIA", 6)
    patch.setattr(driven_path, "FIRST", 2.0**-6)
