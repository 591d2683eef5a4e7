"""Blocks come to rest: loads that come at once, springs that are slow or stiff.

By hand: a block on a floor with friction, W = 313.92 N, mu = 0.5, and a tie or a cable in the plane of its joint. A
load that grew slowly leaves friction at mu W and the rest in the tie; a relaxation swings past that by a third.
"""

import pytest

import dembrick
from dembrick.scenario import toml
from helpers.scenario_text import block, header, jack

pytestmark = pytest.mark.usefixtures("few")

W = 0.4 * 0.4 * 0.1 * 2000.0 * 9.81
HOLDS = 0.5 * W
POST = block("post", (1.0, 0.0, 0.3), (0.2, 0.2, 0.6), "fixed = true")
LARGE = "large_displacements = true\n"


def scene(more, formulation="convex", law="", held=""):
    floor = block("floor", (0.0, 0.0, -0.1), (4.0, 4.0, 0.2), "fixed = true")
    stone = block("stone", (0.0, 0.0, 0.05), (0.4, 0.4, 0.1), held)
    return toml.loads(header(formulation, 0.5, 1e10, keys=law) + floor + stone + more)


def tie(other, ends, stiffness, keys="tension_only = false\n"):
    ends = [
        f'{{ block = "{name}", point = {list(point)} }}' for name, point in zip((other, "stone"), ends, strict=True)
    ]
    return f"[[ties]]\nbetween = [{', '.join(ends)}]\nstiffness = {stiffness}\n{keys}"


def load(force):
    return f'[[loads]]\nblock = "stone"\nforce = [{force}, 0.0, 0.0]\npoint = [0.0, 0.0, 0.0]\n'


@pytest.mark.parametrize("stiffness, geometry, within", [
    (1e5, LARGE, 1e-4), (1e6, LARGE, 1e-4), *((k, "", 1e-9) for k in (1e6, 3e7, 1e8)),
])  # fmt: skip
def test_a_load_that_friction_and_a_tie_share(stiffness, geometry, within):
    """In the geometry of the start ties as stiff as the joint swing with the momentum of the relaxation."""
    post = POST + tie("post", [(0.9, 0.0, 0.0), (0.2, 0.0, 0.0)], stiffness)
    found = dembrick.simulate(scene(f'{post}{load(-200.0)}[control]\nkind = "statics"\n{geometry}'))
    assert found.as_dict()["ties"][0]["tension"] == pytest.approx(200.0 - HOLDS, rel=within)


@pytest.mark.parametrize("control", [
    f'[control]\nkind = "statics"\n{LARGE}',
    '[control]\nkind = "dynamic"\nduration = 0.01\n',
    '[control]\nkind = "settlement"\nsupports = ["far"]\ndisplacement = [0.0, 0.0, -0.001]\n',
])  # fmt: skip
def test_what_bears_less_than_its_strength_keeps_nothing(control):
    """No friction: the tie carries 90 N of its 100. Before real time joints stick, and take nearly all of it."""
    far = block("far", (-1.5, -1.5, 0.1), (0.2, 0.2, 0.2), "fixed = true")
    cable = tie("post", [(0.9, 0.0, 0.0), (0.2, 0.0, 0.0)], 1e4, "strength = 100.0\n")
    given = toml.loads(
        toml.dumps(scene(f"{far}{POST}{cable}{load(-90.0)}{control}")).replace("friction = 0.5", "friction = 0.0")
    )
    (found,) = dembrick.simulate(given).as_dict()["ties"]
    assert found["yielded"] == 0.0
    if "dynamic" not in control:
        assert found["tension"] == pytest.approx(90.0, rel=1e-5)


@pytest.mark.parametrize("formulation, law", [("concave", ""), ("distributed", "points = [4, 4]\n")])
@pytest.mark.parametrize("share", [0.6, 0.95])
def test_a_joint_below_its_compressive_strength_does_not_crush(formulation, law, share):
    law += f"compressive_strength = {W / 0.16 / share}\n"
    found = dembrick.simulate(scene(f'[control]\nkind = "statics"\n{LARGE}', formulation, law))
    assert found.frames["displacement"][-1][1][2] == pytest.approx(-W / (1e10 * 0.16), rel=1e-5)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("law, strength", [
    ("residual_friction = 0.3\n", HOLDS), ("cohesion = 500.0\n", HOLDS + 80.0),
    ("cohesion = 500.0\nresidual_cohesion = 100.0\nresidual_friction = 0.3\n", HOLDS + 80.0),
])  # fmt: skip
@pytest.mark.parametrize("stage", ["", "stages = [2]\n"])
def test_a_bond_holds_what_it_can_bear(formulation, law, strength, stage):
    """It would not hold twice that, as which a load that comes at once acts."""
    before = f'[[stages]]\nkind = "statics"\n{LARGE}' if stage else ""
    for share, stands in ((0.95, True), (1.05, False)):
        pushed = load(share * strength) + stage + before
        found = dembrick.simulate(scene(f'{pushed}[control]\nkind = "statics"\n{LARGE}', formulation, law))
        assert found.status == ("stands" if stands else "falls")


def test_a_support_that_pulls_a_block_by_a_cable():
    """The bar of a refined run holds mu W, of which next to nothing is lost on the way."""
    mover = block("mover", (-1.0, 0.0, 0.2), (0.2, 0.2, 0.2), "fixed = true")
    cable = tie("mover", [(-0.9, 0.0, 0.1), (-0.2, 0.0, 0.1)], 2e5, "")
    pull = '[control]\nkind = "settlement"\nsupports = ["mover"]\ndisplacement = [-0.002, 0.0, 0.0]\n'
    found = dembrick.simulate(scene(mover + cable + pull, "concave", held='held = ["ry"]\n'), refine=True)
    settlement = found.as_dict()["settlement"]
    assert abs(settlement["reaction"] + HOLDS) <= settlement["reaction_error"] < 1e-4 * HOLDS


def test_a_block_that_pulls_another_by_a_cable():
    other = block("other", (-1.0, 0.0, 0.05), (0.4, 0.4, 0.1))
    cable = tie("other", [(-0.8, 0.0, 0.0), (-0.2, 0.0, 0.0)], 1e5, "")
    push = jack("other", (-1.2, 0.0, 0.0), (-1.0, 0.0, 0.0))
    drive = f'[control]\nkind = "displacement"\nrate = 1e-3\ntravel = 0.01\n{LARGE}'
    found = dembrick.simulate(scene(other + cable + push + drive, "concave"))
    assert found.yield_point.V == pytest.approx(2.0 * HOLDS, rel=1e-5)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_swing_breaks_no_bond(formulation):
    """A block on two beds as stiff as each other: at V = 2 c A + mu W the weaker bond breaks, and the other takes twice
    what it bore, of the 2.05 times that it can. Blocks that swing past their rest by a tenth of that would break it."""
    beds = "".join(
        block(name, (x, 0.0, 0.05), (0.2, 0.4, 0.1), "fixed = true") for name, x in (("a", -0.1), ("b", 0.1))
    )
    stone = block("stone", (0.0, 0.0, 0.15), (0.4, 0.4, 0.1), 'held = ["rx", "ry", "rz"]\n')
    strong = '[[joints]]\nbetween = ["b", "stone"]\ncohesion = 2050.0\n'
    push = jack("stone", (-0.2, 0.0, 0.1), (1.0, 0.0, 0.0)) + f'[control]\nkind = "yield"\n{LARGE}'
    found = dembrick.simulate(
        toml.loads(header(formulation, 0.1, 1e10, keys="cohesion = 1000.0\n") + beds + stone + strong + push)
    )
    lower, upper = found.yield_point.V_lower, found.yield_point.V_upper
    assert lower * (1.0 - 1e-6) <= 2050.0 * 0.08 + 0.1 * W <= upper * (1.0 + 1e-6)
