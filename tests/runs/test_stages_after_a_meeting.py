"""Stages after one in which a block was pushed into another: the new contact keeps its force."""

import math

import pytest

import dembrick
from dembrick.scenario import toml
from helpers.scenario_text import block, header, jack

pytestmark = pytest.mark.usefixtures("few")

MU, GRAVITY = 0.3, 9.81
GAP, TRAVEL = 2e-3, 3e-3
PUSHED = f'[[stages]]\nkind = "displacement"\nlarge_displacements = true\ntravel = {TRAVEL}\n'


def after(formulation, control, more=""):
    """Two blocks of .3 by .2 by .1 m; the first is pushed across the gap into the second, then comes ``control``."""
    points = "points = [3, 2]\n" if formulation == "distributed" else ""
    text = header(formulation, MU, 1e9, keys=points)
    text += block("base", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    text += block("first", (0.0, 0.0, 0.05)) + block("second", (0.3 + GAP, 0.0, 0.05))
    text += jack("first", (-0.15, 0.0, 0.02), more="stages = [1]") + more
    return dembrick.simulate(toml.loads(f"{text}{PUSHED}[control]\n{control}"))


@pytest.mark.parametrize("formulation", ["convex", "concave", "distributed"])
def test_the_energy_of_blocks_that_are_let_go_in_time_balances(formulation):
    """Springs of joints and contact release some hundredths of a millijoule, which dashpots and friction dissipate."""
    found = after(formulation, 'kind = "dynamic"\nduration = 0.1\n[output]\nrows = 200\nchannels = ["energy"]\n')
    energy = found.rows["energy"]
    let_go = float(energy["kinetic"][0] - energy["elastic"][-1] - energy["new_contacts"][-1])  # of the leap-frog scheme
    assert let_go > 1e-5
    assert energy["dashpots"][-1] + energy["friction"][-1] == pytest.approx(let_go, rel=1e-3)
    assert energy["kinetic"][-1] < 1e-9 * let_go


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_blocks_that_met_stand_where_they_were_let_go(formulation):
    """They return only by micrometres, as springs unload; a concave joint and a contact need a shorter time step."""
    found = after(formulation, 'kind = "statics"\nlarge_displacements = true\n')
    assert found.status == "stands"
    assert found.motion.displacement[1:, 0] == pytest.approx([-2.06e-6, -0.99e-6], abs=1e-7)


@pytest.mark.parametrize(
    "control",
    [
        'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]',
        'kind = "pushover"\ndirection = [-1.0, 0.0, 0.0]',
        'kind = "tilt"\naxis = [0.0, 1.0, 0.0]',
    ],
    ids=["pushed on", "pushed back", "tilted"],
)
def test_blocks_that_met_slide_at_their_friction(control):
    found = after("concave", f"{control}\nlarge_displacements = true\n").collapse
    share = math.tan(math.radians(found["angle"])) if found["angle"] else found["load_factor"]
    assert share == pytest.approx(MU, rel=1e-3)


def test_a_jack_on_the_other_block_pulls_it_away():
    """V is the friction of that block alone, as new contacts carry no tension."""
    pull = jack("second", (0.3 + GAP + 0.15, 0.0, 0.02), more="stages = [2]").replace('"jack"', '"other"')
    found = after("concave", 'kind = "displacement"\nlarge_displacements = true\ntravel = 1e-3\n', pull)
    assert found.run.path[-1, 1] == pytest.approx(MU * 12.0 * GRAVITY, rel=1e-5)
