"""Blocks not at rest after relaxation start again from their exact initial state, in every array except counters."""

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.scenario.controls import StaticsControl
from dembrick.scenario.model import Block, JointLaw, Scenario
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.simulation.checkpoint_arrays import flattened
from dembrick.simulation.statics.elastic_factor import elastic_factor
from dembrick.simulation.statics.rest import dead_load, relaxation
from dembrick.simulation.statics.state import initial_state
from dembrick.simulation.statics.stiffness import block_stiffness
from helpers.stone_scenes import of_stone


def leaning(formulation: str, ties=(), **law) -> Scenario:
    """Two blocks on a floor, the upper one too far out to stand."""
    points = {"points": (4, 4)} if formulation == "distributed" else {}
    return of_stone(
        JointLaw(formulation, 0.3, 1e10, 4e9, **points, **law),
        StaticsControl(),
        (
            Block("floor", "stone", (2.0, 0.5, 0.2), (0.0, 0.0, -0.1), fixed=True),
            Block("lower", "stone", (0.6, 0.5, 0.2), (0.0, 0.0, 0.1)),
            Block("upper", "stone", (0.6, 0.5, 0.2), (0.4, 0.0, 0.3)),
        ),
        ties=tuple(ties),
    )


TIE = Tie((TieEnd("floor", (-0.8, 0.0, 0.0)), TieEnd("upper", (0.1, 0.0, 0.3))), 1e5, strength=200.0)
STRENGTHS = {"cohesion": 1e3, "tensile_strength": 1e2}
SCENES = {
    "concave": leaning("concave"),
    "convex": leaning("convex"),
    "distributed": leaning("distributed"),
    "bonded": leaning("concave", **STRENGTHS),
    "bonded convex": leaning("convex", **STRENGTHS),
    "tied": leaning("concave", [TIE]),
    "tied convex": leaning("convex", [TIE], compressive_strength=1e6),
}


class Begun(Exception):
    """Raised when viscous motion begins, with its initial state."""


@pytest.mark.parametrize("kind", SCENES)
def test_everything_is_as_it_was(kind, monkeypatch):
    def begin(state, *_):
        raise Begun({name: array.copy() for name, array in flattened({"state": state}).items()})

    monkeypatch.setattr(relaxation, "ViscousMotion", begin)
    assembly = assemble(SCENES[kind])
    state = initial_state(assembly)
    start = {name: array.copy() for name, array in flattened({"state": state}).items()}
    factor = elastic_factor(state, assembly.position)
    with pytest.raises(Begun) as begun:
        dead_load.rest(state, block_stiffness(state, shared=2.0), assembly.position, factor)
    (found,) = begun.value.args
    assert found.keys() == start.keys()
    counted = {"state.areas.evaluations"}  # a counter of work, which is not reset
    for name in found.keys() - counted:
        np.testing.assert_array_equal(found[name], start[name], err_msg=name)
