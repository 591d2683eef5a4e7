"""What tests of runs ask for by name."""

import pytest

from dembrick.simulation.dynamics.paths import driven_path, load_path


@pytest.fixture
def few(monkeypatch):
    """Fewer equilibria of settlements and of driven paths on the way."""
    monkeypatch.setattr(load_path, "EQUILIBRIA", 6)
    monkeypatch.setattr(load_path, "HALVINGS", 3)
    monkeypatch.setattr(load_path, "WITHIN", 1.0)
    monkeypatch.setattr(driven_path, "EQUILIBRIA", 12)
