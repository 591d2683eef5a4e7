"""Runs from equilibrium to equilibrium: no time passes between two of them, so nothing has a velocity or an energy."""

import pytest

import dembrick
from dembrick import history
from dembrick.errors import HistoryError
from dembrick.views import render
from dembrick.views.export import layers
from dembrick.views.motion.blocks import Poses, block_quantities


@pytest.mark.parametrize("stem, times", [("set4a", False), ("arch", False), ("set4a_curve", True)])
def test_velocities_are_of_motions_alone(stem, times, tmp_path):
    path, said = tmp_path / "run.h5", []
    result = dembrick.simulate(dembrick.load(stem, ["output.rows=20", "output.frames=6"]), path)
    with history.read(path) as found:
        assert found.counts_equilibria is not times
        assert ("velocity" in result.frames, found.frame("velocity", 1) is not None) == (times, times)
        quantities = block_quantities(found, Poses.read(found, 0, 3), 0, 3)
        assert ("velocity" in quantities, "kinetic_energy" in quantities) == (times, times)
        layers.Picture(found, said.append, ["blocks"])
        assert said == []  # nothing is missing
        if not times:
            with pytest.raises(HistoryError, match="blocks have no velocity"):
                render.picture(found, tmp_path / "a.png", color="energy", size=(160, 120))
