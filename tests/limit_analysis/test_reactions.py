"""Least and greatest reactions of supports against statics, and against the linear programme of an arch."""

import math

import pytest

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs.limit import limit
from dembrick.runs.reactions import ReactionResult, reaction
from dembrick.runs.reading import load
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.generators import Arch, Wall
from dembrick.scenario.model import Scenario
from dembrick.simulation import limit_analysis
from dembrick.simulation.limit_analysis.reactions import Extreme
from helpers import pushed_assemblies as scenes
from helpers.scenario_text import block, header
from helpers.stone_scenes import law, of_stone


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("friction, greatest", [(0.7, 3526.24740), (0.5, 3452.8997), (0.4, 2762.3198)])
def test_the_thrust_of_an_arch(formulation, friction, greatest):
    scenario = scenes.arch(law(formulation, friction), (1.0, 0.0, 0.0))
    found = reaction(scenario, "arch.right", (-2.0, 0.0, 0.0))
    assert found.least.value == pytest.approx(2130.36785, rel=1e-7)
    assert found.greatest.value == pytest.approx(greatest, rel=1e-7)
    assert found.least.bound <= found.least.reached and found.greatest.reached <= found.greatest.bound
    assert found.least.mechanism.kind == "rocking"
    mirrored = reaction(scenario, "arch.right", (1.0, 0.0, 0.0))
    assert mirrored.greatest.value == pytest.approx(-2130.36785, rel=1e-7)
    for one in (found, mirrored):
        assert (one.push["along"], one.push["side"]) == ([-1.0, 0.0, 0.0], "inward")
        assert (one.push["least"], one.push["greatest"]) == pytest.approx((2130.36785, greatest), rel=1e-7)
        said = "support pushes the other blocks along -x, inward (towards them): at least 2130.37 N, at most"
        assert f"push          the {said}" in one.text() and one.as_dict()["push"] == one.push


@pytest.mark.parametrize(
    "ends, push",
    [
        ((-3.0, -1.0), (1.0, 3.0, [-1.0, 0.0, 0.0], "outward")),
        ((1.0, math.inf), (1.0, None, [1.0, 0.0, 0.0], "inward")),
        ((-1.0, 2.0), None),
    ],
)
def test_a_push_is_told_without_signs(ends, push):
    """The blocks' centre lies in the direction +x of the support."""
    low, high = (Extreme(value, value, value, None) for value in ends)
    found = ReactionResult(None, None, "left", (1.0, 0.0, 0.0), low, high, {}, towards=0.8)
    assert found.push == (
        None if push is None else dict(zip(("least", "greatest", "along", "side"), push, strict=True))
    )
    told = found._push_text()
    assert ("either" in told or "or against it" in told) == (push is None) and ("without limit" in told) == (
        high.value > 1e9
    )


def test_what_is_zero_is_told_as_zero():
    """The reactions of all supports together are the weight, with no component along the span."""
    found = reaction(load("arch"), "arch", (-1.0, 0.0, 0.0))
    for end in (found.least, found.greatest):
        assert end.value == end.reached == end.bound == 0.0
    assert "greatest      0 N (balanced 0, bound 0)" in found.text()
    assert (
        "push          the support pushes the other blocks neither along this direction nor against it" in found.text()
    )


def test_a_springing_that_sinks():
    found = reaction(scenes.arch(law(friction=0.7), (1.0, 0.0, 0.0)), "arch.right", (0.0, 0.0, 1.0))
    assert found.least.value == pytest.approx(6565.6696, rel=1e-7)


@pytest.mark.parametrize(
    "stones, angle, thrust, greatest", [(21, 180.0, 2113.66950, 3526.49507), (21, 140.0, 2122.77539, None)]
)
def test_the_thrust_of_other_arches(stones, angle, thrust, greatest):
    """An arch with a key stone, both sides of which are hinges, and one of 140 deg."""
    arch = Arch("arch", "stone", 1.5, 0.3, 0.5, stones, angle)
    given = of_stone(law(friction=0.7), DynamicControl(1.0), arches=(arch,))
    found = reaction(given, "arch.right", (-1.0, 0.0, 0.0))
    assert found.least.value == pytest.approx(thrust, rel=1e-6)
    if greatest is not None:
        assert found.greatest.value == pytest.approx(greatest, rel=1e-6)


@pytest.mark.parametrize(
    "courses, blocks, bounds",
    [(6, 6, {0.5: 2636.93, 0.64: 2338.37, 0.8: 2071.39}), (4, 4, {0.5: 1255.68, 0.64: 1113.51, 0.8: 969.59})],
)
def test_bricks_on_a_slab_that_sinks(courses, blocks, bounds):
    """Running bond on two slabs that meet in its middle: the least reaction of one of them."""
    middle = 0.2 * blocks
    slabs = tuple(
        Block(name, "stone", (middle + 0.4, 0.6, 0.2), (x, 0.0, -0.1), fixed=True)
        for name, x in (("left", 0.5 * middle - 0.2), ("right", 1.5 * middle + 0.2))
    )
    wall = Wall("wall", "stone", (0.4, 0.2, 0.2), courses, blocks, ends="half", position=(0.0, 0.0, 0.0))
    for friction, bound in bounds.items():
        given = of_stone(law(friction=friction), DynamicControl(1.0), slabs, walls=(wall,))
        assert reaction(given, "right", (0.0, 0.0, 1.0)).least.value == pytest.approx(bound, rel=1e-5)


def beam_on_three(width=0.2) -> Scenario:
    """A block of 3000 N on three supports at -1, 0 and 1 m, each ``width`` wide."""
    weight = 3000.0 / (2000.0 * 9.81 * 2.2 * 0.5)
    blocks = [Block("beam", "stone", box=(2.2, 0.5, weight), position=(0.0, 0.0, 0.5 * weight))]
    for name, x in (("left", -1.0), ("middle", 0.0), ("right", 1.0)):
        blocks.append(Block(name, "stone", box=(width, 0.5, 0.2), position=(x, 0.0, -0.1), fixed=True))
    return of_stone(law(), DynamicControl(1.0), blocks)


def test_a_rigid_beam_on_three_supports():
    """The middle support may carry everything or nothing; an end may carry nothing or, if pushed up, as much as lifts
    the beam off the middle: it presses at its inner edge, .9 m from the centroid, the other at its outer, 1.1 m."""
    middle = reaction(beam_on_three(), "middle", (0.0, 0.0, 1.0))
    assert middle.least.value == pytest.approx(0.0, abs=1e-4)
    assert middle.greatest.value == pytest.approx(3000.0, rel=1e-7)
    right = reaction(beam_on_three(), "right", (0.0, 0.0, 1.0))
    assert right.least.value == pytest.approx(0.0, abs=1e-4)
    assert right.greatest.value == pytest.approx(3000.0 * 1.1 / (0.9 + 1.1), rel=1e-7)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_the_force_of_a_joint_between_free_blocks(formulation):
    """At any joint of an arch the thrust of its springings, and at the springing beside the abutment its reaction."""
    scenario = scenes.arch(law(formulation, 0.7), (1.0, 0.0, 0.0))
    found = reaction(scenario, "arch.13 / arch.12", (-1.0, 0.0, 0.0))
    ends = found.least.value, found.greatest.value
    assert ends == pytest.approx((2130.36785, 3526.24740), rel=1e-7)
    assert (found.support, found.on, found.push["side"]) == ("arch.13", "arch.12", "inward")
    assert found.push["least"] == ends[0] and found.as_dict()["on"] == "arch.12"
    assert f"push          arch.13 pushes arch.12 along -x, inward (towards it): at least {ends[0]:.6g}" in found.text()
    beside = [reaction(scenario, name, (0.0, 0.0, 1.0)) for name in ("arch.right", "arch.right/arch.20")]
    assert beside[0].least.value == pytest.approx(beside[1].least.value, rel=1e-7)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_the_force_of_one_joint_beside_others(formulation):
    """A bonded beam on two bonded stones, each on a support: of the stone that carries it, the joint above has the
    range of the beam on its supports, and the one below the weight of the stone besides."""
    bonded = law(formulation, 0.6, cohesion=1e3, tensile_strength=1e3)
    blocks = [Block("beam", "stone", (2.2, 0.5, 0.2), (0.0, 0.0, 0.3))]
    for name, x in (("left", -1.0), ("right", 1.0)):
        blocks.append(Block(f"{name} stone", "stone", (0.2, 0.5, 0.2), (x, 0.0, 0.1)))
        blocks.append(Block(name, "stone", (0.2, 0.5, 0.2), (x, 0.0, -0.1), fixed=True))
    given = of_stone(bonded, DynamicControl(1.0), blocks)
    above, below = (reaction(given, name, (0.0, 0.0, 1.0)) for name in ("right stone/beam", "right/right stone"))
    stone = 2000.0 * 9.81 * 0.2 * 0.5 * 0.2
    for upper, lower in ((above.least, below.least), (above.greatest, below.greatest)):
        assert lower.value - upper.value == pytest.approx(stone, rel=1e-6)
    assert above.least.value + above.greatest.value == pytest.approx(11.0 * stone, rel=1e-6)


@pytest.mark.parametrize(
    "name, fault",
    [
        ("beam", "'beam' is not fixed, so it has no reaction: name a support, or two blocks or groups as A/B for"),
        ("left/right", "there is no joint between 'left' and 'right'"),
        ("left/beams", "no block or group 'left/beams'"),
    ],
)
def test_what_has_no_force_is_refused(name, fault):
    with pytest.raises(ScenarioError, match=fault):
        reaction(beam_on_three(), name, (0.0, 0.0, 1.0))


def test_a_wide_range_of_an_end_is_no_answer(monkeypatch):
    """With an error of one per cent, the bounds of mechanism and forces are further apart than an answer allows."""
    exact = limit_analysis.bounds.least_cost
    monkeypatch.setattr(
        limit_analysis.bounds, "least_cost", lambda *given: (0.99 * exact(*given)[0] - 0.01, exact(*given)[1])
    )
    with pytest.raises(NotConvergedError, match="the bounds .* of a reaction are further apart than 0.0001 of it"):
        reaction(beam_on_three(), "middle", (0.0, 0.0, 1.0))


def test_a_block_locked_between_walls_has_no_greatest_reaction():
    blocks = (
        Block("floor", "stone", box=(2.0, 1.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True),
        Block("left", "stone", box=(0.2, 1.0, 0.4), position=(-0.3, 0.0, 0.2), fixed=True),
        Block("right", "stone", box=(0.2, 1.0, 0.4), position=(0.3, 0.0, 0.2), fixed=True),
        Block("stone", "stone", box=(0.4, 0.4, 0.4), position=(0.0, 0.0, 0.2)),
    )
    scenario = of_stone(law(), DynamicControl(1.0), blocks)
    found = reaction(scenario, "right", (-1.0, 0.0, 0.0))
    assert found.least.value == pytest.approx(0.0, abs=1e-4)
    assert math.isinf(found.greatest.value)
    assert found.as_dict()["greatest"]["unlimited"]
    assert math.isinf(reaction(scenario, "floor", (0.0, 0.0, 1.0)).greatest.value)


SPREADS = ["control.displacement=[0.002, 0.0, 0.0]"]
FIRST_SPREADS = [
    'stages=[{ kind = "settlement", supports = ["arch.right"], displacement = [0.002, 0.0, 0.0] }]',
    'control={ kind = "tilt", axis = [0.0, 1.0, 0.0] }',
]


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_whose_guides_carry_its_weight(formulation):
    """No other load acts on it, so along y nothing pushes; along z its guide may press it down without limit."""
    floor = block("floor", (0.0, 0.0, -0.05), (1.0, 1.0, 0.1), "fixed = true")
    guided = block("guided", (0.0, 0.0, 0.05), more='held = ["x", "z"]')
    scenario = toml.loads(header(formulation) + floor + guided + '[control]\nkind = "statics"\n')
    for direction, greatest in (((0.0, 1.0, 0.0), 0.0), ((0.0, 0.0, 1.0), math.inf)):
        found = reaction(scenario, "floor", direction)
        assert (found.least.value, found.greatest.value) == (0.0, greatest)


def test_the_thrust_before_a_springing_spreads():
    """A stage that leaves the initial geometry does not prevent the thrust in it; a load after that stage is refused,
    and the message names the option for the thrust."""
    heard = []
    found = reaction(load("arch_spread", FIRST_SPREADS), "arch.right", (-1.0, 0.0, 0.0), report=heard.append)
    assert found.least.value == pytest.approx(2130.36785, rel=1e-7)
    assert found.greatest.value == pytest.approx(3526.24740, rel=1e-7)
    assert "those of stage 1 of kind 'settlement', before anything has moved" in heard[-1]
    with pytest.raises(ScenarioError, match="before it moved, --reaction SUPPORT --direction X,Y,Z"):
        limit(load("arch_spread", FIRST_SPREADS))


def test_limit_analysis_beside_a_spreading_arch():
    """Once the arch has begun to spread its thrust is the least; at rest it lies between least and greatest."""
    found = simulate(load("arch_spread", SPREADS), bound=True, progress=False)
    allowed = found.settlement["limit_analysis"]
    assert allowed["least"] == pytest.approx(2130.36785, rel=1e-7)
    assert allowed["greatest"] == pytest.approx(3526.24740, rel=1e-7)
    assert found.settlement["least"]["reaction"] == pytest.approx(allowed["least"], rel=3e-4)
    assert allowed["least"] < found.settlement["at_rest"] < allowed["greatest"]
    path, settled = found.run.path, found.settlement
    assert settled["at_rest"] == settled["greatest"]["reaction"] == path[:, 1].max(), "the start counts too"
    assert "2130.37 N to 3526.25 N (before the supports moved, by limit analysis)" in " ".join(found.text().split())
    turns = ["control.rotation={ angle = 1.0, axis = [0.0, 1.0, 0.0], point = [1.5, 0.0, 0.0] }", *SPREADS]
    with pytest.raises(ScenarioError, match="supports that move along one line from the initial geometry"):
        simulate(load("arch_spread", turns), bound=True, progress=False)
