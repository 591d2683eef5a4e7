"""One law of ties: small displacements and moving geometry give the same tensions and plastic elongations."""

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.kernels.joint.ties import stretch, tie_energy, tie_losses
from dembrick.scenario.controls import StaticsControl
from dembrick.scenario.model import Block
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.simulation.moving_ties import at_ends, moving_ties
from dembrick.simulation.statics import ties
from dembrick.simulation.statics.state import initial_state
from helpers.stone_scenes import law, of_stone

KINDS = {
    "cable": {},
    "pre-stressed cable": {"prestress": 50.0, "strength": 120.0},
    "bar": {"tension_only": False},
    "bar that yields": {"tension_only": False, "strength": 80.0},
}


def tied(**kind):
    blocks = (
        Block("lower", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
        Block("upper", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05)),
    )
    ends = TieEnd("lower", (0.05, 0.0, -0.1)), TieEnd("upper", (0.05, 0.0, 0.1))
    return assemble(of_stone(law("concave", 0.6, 1e9), StaticsControl(), blocks, ties=(Tie(ends, 1e5, **kind),)))


@pytest.mark.parametrize("kind", KINDS)
def test_both_engines_stretch_a_tie_alike(kind):
    """A random history of stretching and shortening; the energy balance closes at every step."""
    assembly = tied(**KINDS[kind])
    state, moving = initial_state(assembly), moving_ties(assembly.ties, assembly.position, assembly.rotation)
    rng, work, lost = np.random.default_rng(7), 0.0, 0.0
    begun, before = tie_energy(moving), 0.0
    for e in rng.normal(0.0, 2e-3, 60):
        state.blocks.displacement[1, 2] = e
        ties.pull(state)
        yielded = ties.remember(state)
        last = float(moving.now[0].tension)
        stretch(moving, 0, False, 0.0, 0.0, 0.2 + e)
        assert moving.now[0].length == pytest.approx(0.2 + e, rel=1e-15)
        assert moving.now[0].tension == pytest.approx(state.ties.tension[0], rel=1e-9, abs=1e-9)
        assert moving.now[0].yielded == pytest.approx(state.ties.yielded[0], rel=1e-9, abs=1e-15)
        assert ties.energy(state) == pytest.approx(tie_energy(moving), rel=1e-9, abs=1e-12)
        wrench = ties.on_blocks(state)
        np.testing.assert_allclose(at_ends(moving, 2)[1], wrench[1], rtol=1e-9, atol=1e-9)
        taken, stepped = tie_losses(moving)
        work += 0.5 * (last + moving.now[0].tension) * (e - before)
        lost, before = lost + taken + stepped, e
        assert tie_energy(moving) - begun == pytest.approx(work - lost, abs=1e-9)
        assert yielded >= -1e-12
    assert (state.ties.yielded[0] != 0.0) == ("strength" in KINDS[kind])
    assert state.ties.least[0] <= state.ties.tension[0] <= state.ties.strength[0]
