"""Collapses on paths of equilibria: each is followed once from each equilibrium, as it is always the same."""

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.simulation.dynamics.paths import load_path
from helpers.scenario_text import block, header

PUSH, TILT = 'kind = "pushover"\ndirection = [0.0, 1.0, 0.0]\n', 'kind = "tilt"\naxis = [1.0, 0.0, 0.0]\n'


@pytest.mark.parametrize("tolerance, again", [(2e-3, False), (1e-3, True)])
@pytest.mark.parametrize("control", [PUSH, TILT], ids=["push", "tilt"])
def test_no_attempt_is_made_twice(monkeypatch, control, tolerance, again):
    """Two slabs slide at V = mu = 0.6. If the last attempt is a collapse, it is the recorded one, and is not followed
    ``again`` from the same equilibrium, which took a third of the steps; it is from a nearer equilibrium."""
    attempts, follow = [], load_path.LoadPath._gone

    def count(path, parameter, before):
        attempts.append((path.reached, parameter, path.careful))
        return follow(path, parameter, before)

    monkeypatch.setattr(load_path.LoadPath, "_gone", count)
    text = header("concave", 0.6, 1e10) + block("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    text += block("lower", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1)) + block("upper", (0.0, 0.0, 0.16), (0.3, 0.21, 0.12))
    found = simulate(
        toml.loads(f"{text}[control]\n{control}tolerance = {tolerance}\nlarge_displacements = true\n", "slabs.toml")
    )
    assert len(set(attempts)) == len(attempts)
    assert ([parameter for _, parameter, _ in attempts].count(attempts[-1][1]) == 2) == again
    point = found.yield_point
    assert point.V_lower <= 0.6 <= point.V_upper and point.mechanism == "sliding"
    # the last frames are those of the fall, to the distance at which blocks have collapsed
    moved = np.linalg.norm(found.frames["displacement"][:, 1:], axis=2).max(axis=1)
    last = int(np.searchsorted(moved, 1e-3))
    assert len(moved) - last >= 7 and (np.diff(moved[last:]) > 0.0).all()
    assert moved[-1] > load_path.NEAR * 0.1 > moved[-2]
