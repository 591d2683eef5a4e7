"""Fixtures that tests of runs request by name."""

import pytest

from dembrick.simulation.dynamics.paths import driven_path, load_path


@pytest.fixture
def few(monkeypatch):
    """Fewer equilibria on the path of settlements and of driven displacements."""
    monkeypatch.setattr(load_path, "EQUILIBRIA", 6)
    monkeypatch.setattr(load_path, "HALVINGS", 3)
    monkeypatch.setattr(load_path, "WITHIN", 1.0)
    monkeypatch.setattr(driven_path, "EQUILIBRIA", 12)
