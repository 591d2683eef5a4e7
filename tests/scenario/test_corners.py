"""Walls that meet at corners: their volume, their bond, their common slab, and the strength that the bond adds."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.runs.limit import limit
from dembrick.scenario import toml
from dembrick.scenario.controls import TiltControl
from dembrick.scenario.generators import Opening, Return, Wall
from dembrick.scenario.model import JointLaw, JointOverride, Material
from helpers.scenario_text import header
from helpers.stone_scenes import of_stone

DENSITY = 2000.0
BLOCK = (0.4, 0.2, 0.2)
ROUGH = JointLaw("concave", 2.0, 1e10, 4e9)


def scene(*walls, law=ROUGH, axis=(1.0, 0.0, 0.0)):
    return of_stone(law, TiltControl(axis=axis), materials={"stone": Material(DENSITY)}, walls=walls)


def house(block=BLOCK, blocks=(6, 5), order="senw", **south):
    """Four walls of one block size around a rectangle with its outer corner at the origin, defined in this order."""
    length, thickness, _ = block
    (wide, deep), half = (length * n for n in blocks), 0.5 * thickness
    common = {"material": "stone", "block": block, "courses": 4}
    walls = {
        "s": Wall("south", blocks=blocks[0], position=(0.0, half, 0.0), base=0.2, **common | south),
        "n": Wall("north", blocks=blocks[0], position=(0.0, deep - half, 0.0), **common),
        "e": Wall("east", blocks=blocks[1], position=(wide - half, 0.0, 0.0), heading=90.0, **common),
        "w": Wall("west", blocks=blocks[1], position=(half, 0.0, 0.0), heading=90.0, **common),
    }
    return [walls[name] for name in order]


def boxes(assembly):
    """Lower and upper corners of the bounding boxes of the free blocks (m), by name."""
    return {
        name: (corners.min(axis=0), corners.max(axis=0))
        for i, name in enumerate(assembly.names)
        if not assembly.fixed[i]
        for corners in [assembly.position[i] + assembly.shapes[i].vertices @ assembly.rotation[i].T]
    }


def owner(found, point):
    """Name of the wall with a block around the point; fails unless there is exactly one such block."""
    (name,) = [name for name, (low, high) in found.items() if (low < point).all() and (point < high).all()]
    return name.split(".")[0]


# --- volumes, teeth, bond ---------------------------------------------------------------------------------------------

SIZES = {
    "half a block thick": ((0.4, 0.2, 0.2), (6, 5)),
    "bricks": ((0.25, 0.12, 0.065), (8, 7)),
    "thick": ((0.3, 0.25, 0.15), (7, 4)),
    "thin": ((0.5, 0.11, 0.2), (4, 4)),
    "short": ((0.4, 0.2, 0.2), (2, 3)),
}


@pytest.mark.parametrize("order", ["snew", "senw", "wens"])
@pytest.mark.parametrize("size", SIZES)
def test_four_walls_fill_their_plan_and_are_toothed(size, order):
    """The blocks have the volume of the walls, none overlap (which assembling checks), and the square of each corner
    belongs to the two walls in alternating courses."""
    block, blocks = SIZES[size]
    length, thickness, height = block
    wide, deep = (length * n for n in blocks)
    found = assemble(scene(*house(block, blocks=blocks, order=order)))
    solid = (wide * deep - (wide - 2 * thickness) * (deep - 2 * thickness)) * 4 * height
    assert found.mass[~found.fixed].sum() == pytest.approx(solid * DENSITY, rel=1e-12)
    at, half = boxes(found), 0.5 * thickness
    for low, high in at.values():  # inside the outline and outside the yard
        assert (low[:2] > -1e-12).all() and high[0] < wide + 1e-12 and high[1] < deep + 1e-12
        inside = (thickness - 1e-12 < low[0]) and high[0] < wide - thickness + 1e-12
        assert not (inside and thickness - 1e-12 < low[1] and high[1] < deep - thickness + 1e-12)
    for (x, along_y), (y, along_x) in itertools.product(
        ((half, "west"), (wide - half, "east")), ((half, "south"), (deep - half, "north"))
    ):
        turns = [owner(at, (x + 1e-4, y + 1e-4, (course + 0.5) * height)) for course in range(4)]
        first, other = sorted((along_x, along_y), key=lambda name: order.index(name[0]))
        assert turns == [first, other, first, other]


@pytest.mark.parametrize("order", ["snew", "senw"])
@pytest.mark.parametrize("size", SIZES)
def test_no_head_joint_lies_above_another(size, order):
    """Head joints, and faces where a wall ends against the other, are at least a tenth of a block away from those of
    the course below."""
    block, blocks = SIZES[size]
    at = boxes(assemble(scene(*house(block, blocks=blocks, order=order))))
    for wall, axis, reach in (("south", 0, blocks[0]), ("north", 0, blocks[0]), ("east", 1, blocks[1])):
        courses = []
        for course in range(4):
            own = [pair for name, pair in at.items() if name.startswith(f"{wall}.{course + 1}.")]
            faces = {round(float(end[axis]), 9) for pair in own for end in pair}
            courses.append(sorted(faces - {0.0, round(reach * block[0], 9)}))
        for below, above in itertools.pairwise(courses):
            assert below and above
            assert min(abs(a - b) for a in above for b in below) > 0.1 * block[0]


@pytest.mark.parametrize("order", ["snew", "senw"])
def test_door_and_windows_are_cut_out(order):
    """The missing mass is that of the openings, also if a lintel ends at the wall that runs through the corner."""
    door, window = Opening((0.9, 1.5), (1, 3), lintel=0.3), Opening((0.3, 0.7), (2, 2), lintel=0.2)
    plain = assemble(scene(*house(order=order)))
    found = assemble(scene(*house(order=order, openings=(door, window))))
    missing = plain.mass.sum() - found.mass.sum()
    assert missing == pytest.approx((0.6 * 3 + 0.4) * 0.2 * 0.2 * DENSITY, rel=1e-12)
    at = boxes(found)
    over_the_window = next(
        (low[0], high[0]) for name, (low, high) in at.items() if name.startswith("south.3.") and low[0] < 0.5 < high[0]
    )
    assert over_the_window == pytest.approx((0.1, 0.9))
    over_the_door = next(
        (low[0], high[0]) for name, (low, high) in at.items() if name.startswith("south.4.") and low[0] < 1.2 < high[0]
    )
    assert over_the_door == pytest.approx((0.6, 1.8))
    near_the_corner = assemble(scene(*house(order=order, openings=(Opening((0.3, 0.7), (1, 1), lintel=0.2),))))
    low = min(low[0] for name, (low, _) in boxes(near_the_corner).items() if name.startswith("south.2."))
    assert low == pytest.approx(0.2)


def test_a_house_may_head_anywhere():
    straight = assemble(scene(*house()))
    c, s = math.cos(math.radians(33.0)), math.sin(math.radians(33.0))
    turned = [
        replace(
            wall,
            heading=wall.heading + 33.0,
            position=(
                2.0 + c * wall.position[0] - s * wall.position[1],
                -1.0 + s * wall.position[0] + c * wall.position[1],
                0.5,
            ),
        )
        for wall in house()
    ]
    found = assemble(scene(*turned))
    assert found.names == straight.names
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert found.position == pytest.approx(straight.position @ rotation.T + (2.0, -1.0, 0.5), abs=1e-12)
    areas = [sorted(round(joint.area, 9) for joint in one.joints) for one in (found, straight)]
    assert areas[0] == areas[1]


def test_a_wall_goes_on_above_a_lower_one():
    """Above the lower wall all corner squares belong to the higher one, which is in running bond up to its end."""
    walls = [
        Wall("high", "stone", BLOCK, 6, 4, base=0.2),
        Wall("low", "stone", BLOCK, 3, 3, position=(0.1, -0.1, 0.0), heading=90.0),
    ]
    found = assemble(scene(*walls))
    assert found.mass[~found.fixed].sum() == pytest.approx((1.6 * 6 + 1.0 * 3) * 0.2 * 0.2 * DENSITY, rel=1e-12)
    at = boxes(found)
    turns = [owner(at, (0.1001, 0.0001, (course + 0.5) * 0.2)) for course in range(6)]
    assert turns == ["high", "low", "high", "high", "high", "high"]
    lengths = [round(float(high[0] - low[0]), 9) for name, (low, high) in at.items() if name.startswith("high.6.")]
    assert lengths == [0.2, 0.4, 0.4, 0.4, 0.2]


def test_a_return_is_a_wall_at_the_corner():
    """A wall with a return and two walls that meet at the corner give the same blocks in the same places."""
    (one,) = [assemble(scene(Wall("w", "stone", BLOCK, 5, 4, base=0.2, returns=(Return("left", "back", 3),))))]
    two = assemble(
        scene(
            Wall("w", "stone", BLOCK, 5, 4, base=0.2),
            Wall("w.left", "stone", BLOCK, 5, 3, position=(0.1, -0.1, 0.0), heading=90.0),
        )
    )
    assert dict(zip(one.names, one.position.tolist(), strict=True)) == dict(
        zip(two.names, two.position.tolist(), strict=True)
    )


# --- the slab ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["snew", "wens"])
def test_walls_that_meet_stand_on_one_slab(order):
    walls = [replace(wall, base=0.2) for wall in house(order=order)]
    for scenario in (scene(*walls), scene(*house(order=order))):
        found = assemble(scenario)
        (slab,) = np.flatnonzero(found.fixed)
        corners = found.position[slab] + found.shapes[slab].vertices @ found.rotation[slab].T
        assert corners.min(axis=0) == pytest.approx([-0.2, -0.2, -0.2])
        assert corners.max(axis=0) == pytest.approx([2.6, 2.2, 0.0])
    assert found.names[slab] == "south.base"


def test_walls_that_only_touch_share_a_slab_too_and_others_do_not():
    near = Wall("b", "stone", BLOCK, 2, 3, position=(0.0, 0.2, 0.0), base=0.2)
    far = replace(near, name="c", position=(0.0, 5.0, 0.0))
    found = assemble(scene(Wall("a", "stone", BLOCK, 2, 3, base=0.2), near, far))
    fixed = [found.names[i] for i in np.flatnonzero(found.fixed)]
    assert fixed == ["a.base", "c.base"]
    volumes = [found.shapes[i].volume for i in np.flatnonzero(found.fixed)]
    assert volumes == pytest.approx([1.6 * 0.8 * 0.2, 1.6 * 0.6 * 0.2])


# --- strength of the bond ---------------------------------------------------------------------------------------------


def facade(bonded: bool, *smooth: str):
    """A front wall of 6 blocks by 5 courses and two cross walls behind it, in bond or with straight joints, tilted
    towards the front; ``smooth``: cross walls whose joints with the front have no friction."""
    common = {"material": "stone", "block": BLOCK, "courses": 5, "heading": 90.0, "base": 0.2}
    start = -0.1 if bonded else 0.1
    walls = (
        Wall("front", "stone", BLOCK, 5, 6, base=0.2),
        Wall("left", blocks=3, position=(0.1, start, 0.0), **common),
        Wall("right", blocks=3, position=(2.3, start, 0.0), **common),
    )
    joints = tuple(JointOverride(("front", name), replace(ROUGH, friction=0.0)) for name in smooth)
    return replace(scene(*walls), joints=joints)


def test_a_corner_in_bond_holds_more_than_two_walls_apart():
    """Without friction at the corners the front topples alone at t/h. In bond it must also lift the ends of the cross
    walls, which resists more than friction on straight joints. A wall with returns is as strong as three walls."""
    apart, straight, bonded = (
        limit(scenario).load_factor for scenario in (facade(False, "left", "right"), facade(False), facade(True))
    )
    assert apart == pytest.approx(0.2 / 1.0, rel=1e-6)
    assert bonded > 1.5 * straight > 1.5 * apart
    returns = (Return("left", "back", 3), Return("right", "back", 3))
    as_returns = scene(Wall("front", "stone", BLOCK, 5, 6, base=0.2, returns=returns))
    assert limit(as_returns).load_factor == pytest.approx(bonded, rel=1e-9)


# --- refusals ---------------------------------------------------------------------------------------------------------

TOML = (
    header()
    + """
[control]
kind = "tilt"
axis = [1.0, 0.0, 0.0]

[[walls]]
name     = "south"
material = "stone"
block    = [0.4, 0.2, 0.2]
courses  = 4
blocks   = 6
base     = 0.2

[[walls]]
name     = "west"
material = "stone"
block    = [0.4, 0.2, 0.2]
courses  = 4
blocks   = 5
position = [0.1, -0.1, 0.0]
heading  = 90.0
"""
)
REFUSED = {
    "courses": ("block    = [0.4, 0.2, 0.2]\ncourses  = 4\nblocks   = 5",
                "block    = [0.4, 0.2, 0.25]\ncourses  = 4\nblocks   = 5",
                "courses of 0.2 and 0.25 m from z = 0 and 0 m: in bond their courses must begin at one height"),
    "height": ("[0.1, -0.1, 0.0]", "[0.1, -0.1, 0.1]", "from z = 0 and 0.1 m"),
    "thickness": ("block    = [0.4, 0.2, 0.2]\ncourses  = 4\nblocks   = 5",
                  "block    = [0.4, 0.4, 0.2]\ncourses  = 4\nblocks   = 5",
                  "blocks 0.4 m long cannot be toothed into a wall 0.4 m thick: at a corner it must be between 0.04 "
                  "and 0.36 m thick"),
    "angle": ("heading  = 90.0", "heading  = 60.0", "overlap at 60 deg, but only walls at right angles"),
    "parallel": ("heading  = 90.0", "heading  = 0.0", "overlap at 0 deg"),
    "off its end": ("[0.1, -0.1, 0.0]", "[0.15, -0.05, 0.0]",
                    "give 'west' position = [0.1, -0.1, 0.0]"),
    "a cross wall": ("[0.1, -0.1, 0.0]", "[1.3, -0.1, 0.0]", "away from their ends, but walls meet in bond at corners"),
    "a cross": ("[0.1, -0.1, 0.0]", "[1.3, -1.0, 0.0]", "away from their ends, but walls meet in bond at corners"),
    "pattern": ("courses  = 4\nblocks   = 5", 'pattern = ["1111", "h111h"]',
                "a wall with a pattern cannot meet another"),
    "one block": ("blocks   = 5", "blocks   = 1", "'west' is one block long; it needs at least 2"),
    "opening": ("heading  = 90.0", "heading  = 90.0\nopenings = [{ span = [0.1, 0.6], courses = [1, 2] }]",
                "opening of wall 'west' = [0.1, 0.6] reaches into a corner: between its corners the wall reaches from "
                "0.2 to 2 m"),
    "two at an end": ("base     = 0.2", "base     = 0.2\nreturns = [{ end = \"left\", side = \"front\", blocks = 3 }]",
                      "both meet the left end of wall 'south', which has room for one"),
    "two bases": ("heading  = 90.0", "heading  = 90.0\nbase     = 0.3",
                  "stand on one slab, but have base = 0.2 and 0.3: give base only once"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case):
    assert assemble(toml.loads(TOML)).fixed.sum() == 1
    given, written, told = REFUSED[case]
    assert given in TOML
    with pytest.raises(ScenarioError) as error:
        toml.loads(TOML.replace(given, written))
    assert told in str(error.value)
