"""Walls, stacks, arches, domes: numbers of blocks and joints, positions, names and groups, and refusals."""

import math
from collections import Counter

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.scenario import memory, toml
from dembrick.scenario.blocks import Block, Prism
from dembrick.scenario.generators import Arch, Dome, Opening, Return, Stack, Wall
from dembrick.scenario.model import JointLaw, JointOverride, Load, Material, YieldControl
from helpers.scenario_text import header
from helpers.stone_scenes import of_stone

LAW = JointLaw("concave", 0.65, 1e10, 4e9)
STONE = (0.4, 0.2, 0.175)
DENSITY = 2000.0

TOML = 'supports = ["wall.1"]' + header(friction=0.64, normal_stiffness=1e10, density=1500.0)
TOML += """
[[joints]]
between  = ["wall.2", "wall.3"]
friction = 0.3

[[walls]]
name     = "wall"
material = "stone"
block    = [0.3, 0.2, 0.1]
courses  = 5
blocks   = 6
openings = [{ span = [0.6, 1.2], courses = [2, 3], lintel = 0.15 }]
returns  = [{ end = "right", side = "back", blocks = 4 }]

[[loads]]
block = "wall.5"
force = [0.0, 0.0, -100.0]

[[actuators]]
name      = "jack"
block     = "wall.5.1"
point     = [0.1, 0.0, 0.45]
direction = [1.0, 0.0, 0.0]

[control]
kind = "yield"
"""


def scene(**parts):
    return of_stone(LAW, YieldControl(), materials={"tuff": Material(DENSITY)}, **parts)


def laid(*walls, **parts):
    return assemble(scene(walls=walls, **parts))


def joints_between(assembly):
    return Counter((j.block_a, j.block_b) for j in assembly.joints)


# --- walls ------------------------------------------------------------------------------------------------------------

W3 = {"E": "1111", "U": "h111h", "v": "h1 o 1h", "w": "1h o h1"}
FERRIS_TIN_LOI = {
    1: (("h1111h", "11111"), 6, 33, 83),
    2: (("h1111h", "11111"), 10, 55, 141),
    3: (tuple(W3[c] for c in "EUEvwvwvEUE"), 11, 46, 102),
}


@pytest.mark.parametrize("number", FERRIS_TIN_LOI)
def test_the_walls_of_ferris_and_tin_loi(number):
    pattern, courses, blocks, joints = FERRIS_TIN_LOI[number]
    found = laid(Wall("w", "tuff", STONE, pattern=pattern, courses=courses, base=0.2))
    assert (int((~found.fixed).sum()), len(found.joints)) == (blocks, joints)
    spans = np.array([np.ptp(j.polygon, axis=0).max() for j in found.joints])
    assert set(np.round(spans, 12)) <= {0.2, 0.4}  # beds of half a block in depth or length, head joints


def test_running_bond_closed_with_halves():
    """Of 10 courses of 10 blocks, every second has 9 blocks and two halves; 106 blocks with the slab."""
    wall = Wall("wall", "tuff", (0.3, 0.2, 0.1), courses=10, blocks=10, base=0.1)
    found = laid(wall)
    assert len(found.names) == 106 and wall.count() >= 106
    volumes = np.array([shape.volume for shape in found.shapes])
    assert volumes[:-1].sum() == pytest.approx(10 * 10 * 0.006, rel=1e-12)
    # head joints: 9 in whole courses, 10 in the others; beds: 10 on the slab, 20 between two courses
    assert len(found.joints) == 5 * 9 + 5 * 10 + 10 + 9 * 20
    assert {j.gap for j in found.joints} == {0.0}
    assert found.names[10] == "wall.2.1" and found.shapes[10].volume == pytest.approx(0.003)
    assert found.position[10] == pytest.approx([0.075, 0.0, 0.15])
    assert found.position[found.names.index("wall.3.7")] == pytest.approx([1.95, 0.0, 0.25])


def test_quoins_and_toothed_ends():
    halves, quoins, toothed = (
        laid(Wall("w", "tuff", STONE, courses=2, blocks=5, ends=ends, base=0.2))
        for ends in ("half", "quoin", "toothed")
    )
    edges = [[round(2 * s.volume / np.prod(STONE)) for s in a.shapes[5:-1]] for a in (halves, quoins, toothed)]
    assert edges == [[1, 2, 2, 2, 2, 1], [3, 2, 2, 3], [2, 2, 2, 2]]
    assert toothed.position[5] == pytest.approx([0.4, 0.0, 0.2625])


def test_a_wall_may_stand_anywhere_and_head_anywhere():
    straight = laid(Wall("w", "tuff", STONE, courses=4, blocks=5, base=0.2))
    turned = laid(Wall("w", "tuff", STONE, courses=4, blocks=5, base=0.2, position=(3.0, -2.0, 1.0), heading=110.0))
    assert joints_between(turned) == joints_between(straight)
    c, s = math.cos(math.radians(110)), math.sin(math.radians(110))
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert turned.position == pytest.approx(straight.position @ rotation.T + (3.0, -2.0, 1.0), abs=1e-12)
    along_y = laid(Wall("w", "tuff", STONE, courses=4, blocks=5, base=0.2, heading=90.0))
    assert (along_y.position[:, 0] == 0.0).all()  # exactly straight


def test_openings_are_cut_out_and_spanned():
    openings = (Opening((0.9, 1.7), (2, 3), lintel=0.2),)
    plain = laid(Wall("w", "tuff", STONE, courses=5, blocks=6, base=0.2))
    found = laid(Wall("w", "tuff", STONE, courses=5, blocks=6, base=0.2, openings=openings))
    missing = plain.mass.sum() - found.mass.sum()
    assert missing == pytest.approx(0.8 * 2 * 0.2 * 0.175 * DENSITY, rel=1e-12)
    low, high = (found.position[:, 0] + sign * 0.5 * np.array([np.ptp(s.vertices[:, 0]) for s in found.shapes])
                 for sign in (-1.0, 1.0))  # fmt: skip
    for i, name in enumerate(found.names):
        course = name.split(".")[1]
        if course in "23":
            assert high[i] < 0.9 + 1e-12 or low[i] > 1.7 - 1e-12
        if course == "4" and low[i] < 1.3 < high[i]:
            assert (low[i], high[i]) == pytest.approx((0.7, 1.9))  # the lintel has a bearing of 0.2 m on either side
    edges = np.array([np.ptp(s.vertices[:, 0]) for s in found.shapes[:-1]])
    assert edges.min() > 0.24 * 0.4 - 1e-12  # no block is too short to lay


@pytest.mark.parametrize("thickness", [0.2, 0.13])
def test_returns_are_bonded_at_the_corner(thickness):
    """The corner square belongs to the wall and to the return in alternating courses, and no blocks overlap."""
    block = (0.4, thickness, 0.175)
    returns = (Return("left", "back", 4), Return("right", "front", 5))
    found = laid(Wall("w", "tuff", block, courses=4, blocks=6, base=0.2, returns=returns))
    plan = (6 * 0.4 + 4 * 0.4 + 5 * 0.4 - 2 * thickness) * thickness
    assert found.mass[:-1].sum() == pytest.approx(plan * 4 * 0.175 * DENSITY, rel=1e-12)
    corner = (0.5 * thickness, 0.0)
    owners = []
    for course in range(4):
        for i, name in enumerate(found.names):
            local = found.rotation[i].T @ (np.array([*corner, (course + 0.5) * 0.175]) - found.position[i])
            if (np.abs(local) < 0.5 * np.ptp(found.shapes[i].vertices, axis=0)).all():
                owners.append(name.split(".")[1] == "left")
    assert owners == [False, True, False, True]
    assert all(j.area > 1e-6 for j in found.joints) and {j.gap for j in found.joints} == {0.0}


@pytest.mark.parametrize("side", ["back", "front"])
def test_openings_in_a_return_are_cut_out_and_spanned(side):
    """The volume lacks the window, no block lies in it, its lintel has a bearing, and the corner stays bonded."""
    window = Opening((0.7, 1.3), (2, 3), lintel=0.25)
    plain, found = (
        laid(Wall("w", "tuff", STONE, courses=5, blocks=4, base=0.2, returns=(Return("right", side, 5, openings),)))
        for openings in ((), (window,))
    )
    assert plain.mass.sum() - found.mass.sum() == pytest.approx(0.6 * 2 * 0.2 * 0.175 * DENSITY, rel=1e-12)
    away = 1.0 if side == "back" else -1.0
    for i, name in enumerate(found.names):
        corners = found.position[i] + found.shapes[i].vertices @ found.rotation[i].T
        along = away * corners[:, 1] + 0.1  # m, from the outer face of the wall
        if name.startswith("w.right.") and name.split(".")[2] in "23":
            assert along.max() < 0.7 + 1e-12 or along.min() > 1.3 - 1e-12
        if name.startswith("w.right.4.") and along.min() < 1.0 < along.max():
            assert (along.min(), along.max()) == pytest.approx((0.45, 1.55))
    of_wall = [name for name in plain.names if not name.startswith("w.right.")]
    assert of_wall == [name for name in found.names if not name.startswith("w.right.")]
    assert all(j.area > 1e-6 for j in found.joints) and {j.gap for j in found.joints} == {0.0}


# --- stacks, arches, domes --------------------------------------------------------------------------------------------


def test_a_stack_of_boxes_and_a_column_of_drums():
    found = assemble(scene(stacks=(Stack("pile", "tuff", 4, box=(0.3, 0.2, 0.1), base=0.1, heading=30.0),)))
    assert found.names == ("pile.1", "pile.2", "pile.3", "pile.4", "pile.base") and len(found.joints) == 4
    assert [j.area for j in found.joints] == pytest.approx([0.06] * 4)
    drum = Prism([(0.2 * math.cos(k * math.pi / 8), 0.2 * math.sin(k * math.pi / 8)) for k in range(16)], 0.25)
    column = assemble(scene(stacks=(Stack("column", "tuff", 3, prism=drum, base=0.1, position=(1.0, 2.0, 3.0)),)))
    area = 8 * 0.04 * math.sin(math.pi / 8)
    assert [j.area for j in column.joints] == pytest.approx([area] * 3) and len(column.joints[0].polygon) == 16
    assert column.position[:3, 2] == pytest.approx([3.125, 3.375, 3.625])


@pytest.mark.parametrize("angle", [180.0, 157.5, 60.0, 240.0])
@pytest.mark.parametrize("curved", [False, True])
def test_an_arch_has_radial_joints_and_springs_from_two_more(angle, curved):
    n, radius, thickness, depth = 11, 2.0, 0.3, 0.5
    arch = Arch("arch", "tuff", radius, thickness, depth, n, angle, curved, position=(5.0, 1.0, -1.0), heading=20.0)
    found = assemble(scene(arches=(arch,)))
    assert len(found.joints) == n + 1 and {j.gap for j in found.joints} == {0.0}
    assert [j.area for j in found.joints] == pytest.approx([thickness * depth] * (n + 1))
    assert sorted(found.names[i] for i in np.flatnonzero(found.fixed)) == ["arch.left", "arch.right"]
    step = math.radians(angle) / n
    ring = math.radians(angle) * radius * thickness * depth * DENSITY
    chords = n * math.sin(step) * radius * thickness * depth * DENSITY  # trapezia between the radial joints
    assert found.mass[:n].sum() == pytest.approx(ring if curved else chords, rel=1e-12)
    # joints are radial: their planes contain the centre of the arch
    for joint in found.joints:
        assert joint.axes[2] @ (joint.origin - (5.0, 1.0, -1.0)) == pytest.approx(0.0, abs=1e-12)
        assert math.dist(joint.origin, (5.0, 1.0, -1.0)) == pytest.approx(radius)
    assert (found.position[0] - (5.0, 1.0, -1.0)) @ [math.cos(math.radians(20)), math.sin(math.radians(20)), 0] < 0


def test_a_dome_meets_face_to_face_everywhere():
    n, rings, radius, thickness = 16, 6, 1.0, 0.1
    found = assemble(scene(domes=(Dome("dome", "tuff", radius, thickness, rings, n, key=8.0),)))
    assert len(found.names) == n * rings + 1 + n
    assert len(found.joints) == n * rings * 2 + n and max(abs(j.gap) for j in found.joints) < 1e-12
    # the corners of the stones lie on the sphere, so the stones weigh a little less than the shell
    shell = 2.0 / 3.0 * math.pi * (1.05**3 - 0.95**3) * DENSITY
    assert 0.95 * shell < found.mass[~found.fixed].sum() < shell
    finer = assemble(scene(domes=(Dome("dome", "tuff", radius, thickness, 4 * rings, 4 * n, key=2.0),)))
    assert finer.mass[~finer.fixed].sum() == pytest.approx(shell, rel=4e-3)
    eye = assemble(scene(domes=(Dome("dome", "tuff", radius, thickness, rings, n, oculus=20.0),)))
    assert len(eye.joints) == n * rings * 2 and "dome.key" not in eye.names


# --- names, groups, text ----------------------------------------------------------------------------------------------


def test_a_wall_in_a_file():
    found = toml.loads(TOML)
    assembly = assemble(found)
    assert found.groups["wall.1"] == tuple(range(6)) and found.groups["wall"] == tuple(range(len(found.all_blocks)))
    assert [b.name for b in found.all_blocks if b.fixed] == [f"wall.1.{k}" for k in range(1, 7)]
    course = [found.all_blocks[i].name for i in found.groups["wall.5"]]
    weights = assembly.mass * 9.81
    for i, name in enumerate(assembly.names):
        extra = 100.0 if name in course else 0.0
        assert assembly.dead_force[i] == pytest.approx([0.0, 0.0, -weights[i] - extra])
    laws = {
        tuple(sorted((assembly.names[j.block_a].rpartition(".")[0], assembly.names[j.block_b].rpartition(".")[0]))):
        j.law.friction for j in assembly.joints
    }  # fmt: skip
    assert laws["wall.2", "wall.3"] == 0.3 and laws["wall.3", "wall.4"] == 0.64 and laws["wall.2", "wall.2"] == 0.64
    assert toml.loads(toml.dumps(found)) == found
    assert toml.loads(TOML, overrides=["walls.wall.courses=7"]).all_blocks[-1].name == "wall.right.7.4"


def test_every_shape_and_generator_survives_the_text():
    blocks = (
        Block("p", "tuff", prism=Prism([(0, 0), (1, 0), (0, 1)], 0.5), position=(0, 0, 10), group="loose stones"),
        Block("t", "tuff", vertices=[(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1 / 3)], fixed=True),
    )
    found = scene(
        blocks=blocks,
        walls=(Wall("w", "tuff", STONE, 3, 4, openings=(Opening((0.4, 0.8), (2, 2)),), position=(9, 9, 0), base=0.1),),
        stacks=(Stack("s", "tuff", 2, prism=Prism([(0, 0), (1, 0), (0, 1)], 0.5), position=(20, 0, 0)),),
        arches=(Arch("a", "tuff", 2.0, 0.3, 0.5, 7, 157.5, True, position=(40, 0, 0)),),
        domes=(Dome("d", "tuff", 2.0, 0.3, 3, 8, oculus=20.0, position=(60, 0, 0)),),
        joints=(JointOverride(("w", "w"), LAW),),
        loads=(Load("loose stones", (0, 0, -1)),),
        supports=("s.1",),
    )
    again = toml.loads(toml.dumps(found) + '\n[[actuators]]\nname = "j"\nblock = "w.3.1"\n'
                           "point = [9.1, 9, 0.5]\ndirection = [1, 0, 0]\n")  # fmt: skip
    for key in ("blocks", "walls", "stacks", "arches", "domes", "joints", "loads", "supports", "all_blocks", "groups"):
        assert getattr(again, key) == getattr(found, key), key


REFUSED = {
    "pattern piece": (("courses  = 5\nblocks   = 6", 'pattern = ["11x"]'), "pattern[0]", "not x"),
    "pattern lengths": (("courses  = 5\nblocks   = 6", 'pattern = ["11", "h1"]'), "pattern[1]", "1.5 blocks long"),
    "pattern and blocks": (("courses  = 5", 'pattern = ["11"]'), "contradicts its pattern"),
    "no courses": (("courses  = 5\n", ""), "missing key 'courses'", "of wall 'wall'"),
    "courses 0": (("courses  = 5", "courses = 0"), "courses of wall 'wall' = 0", "at least 1"),
    "opening outside": (("[0.6, 1.2]", "[0.6, 2.2]"), "span of an opening of wall 'wall'", "0 to 1.8 m"),
    "opening above": (("courses = [2, 3]", "courses = [2, 5]"), "the wall has 5 courses", "lintel needs one above"),
    "opening in the corner": (("blocks = 4 }", "blocks = 4, openings = [{ span = [0.1, 0.6], courses = [1, 2] }] }"),
                              "span of an opening in the right return of wall 'wall'", "behind the wall"),
    "opening above a return": (("blocks = 4 }", "blocks = 4, openings = [{ span = [0.4, 0.8], courses = [1, 9] }] }"),
                               "courses of an opening in the right return", "the wall has 5 courses"),
    "lintel in an opening": (
        ("lintel = 0.15 }]", "lintel = 0.15 }, { span = [1.3, 1.5], courses = [4, 4] }]"),
        "the lintel over 0.6 to 1.2 m lies in course 4, where another opening is from 1.3 to 1.35 m", "shorten",
    ),
    "lintel in a lintel": (
        ("lintel = 0.15 }]", "lintel = 0.15 }, { span = [1.4, 1.6], courses = [1, 3], lintel = 0.1 }]"),
        "the lintel over 0.6 to 1.2 m lies in course 4, where another lintel is from 1.3 to 1.35 m", "shorten",
    ),
    "opening key": (("lintel = 0.15", "lintle = 0.15"), "unknown key 'lintle' in openings[0] in [[walls]] number 1",
                    "'lintel'"),
    "return end": (('end = "right"', 'end = "top"'), "end = 'top' is not one of left, right", "returns[0]"),
    "supports": (('["wall.1"]', '["wall.9"]'), "supports = 'wall.9' is not the name of a block or a group"),
    "between": (('"wall.2", "wall.3"', '"wall.2", "wall.4"'), "no joint between these groups", "do not touch"),
    "load": (('block = "wall.5"\nforce', 'block = "wal.5"\nforce'), "'wal.5'", "'wall.5'"),
    "jack on a group": (('"wall.5.1"', '"wall.5"'), "actuator 'jack'", "is a group", "name one block of it"),
    "point on a group": (("force = [0.0, 0.0, -100.0]", "force = [0.0, 0.0, -100.0]\npoint = [0, 0, 0]"),
                         "load number 1 has a point", "group 'wall.5'"),
    "material": (('material = "stone"\nblock', 'material = "tufa"\nblock'), "material of block 'wall.1.1' = 'tufa'"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(case):
    (old, new), *fragments = REFUSED[case]
    assert old in TOML
    with pytest.raises(ScenarioError) as caught:
        assemble(toml.loads(TOML.replace(old, new), "test.toml"))
    message = str(caught.value)
    assert all(line.startswith(("test.toml", "missing key", "unknown key")) for line in message.split("\n"))
    for fragment in fragments:
        assert fragment in message, message


def test_names_must_not_mean_two_things():
    wall = Wall("w", "tuff", STONE, 2, 3, base=0.1)
    for name in ("w.1.1", "w.base"):
        with pytest.raises(ScenarioError, match="two blocks are named"):
            scene(walls=(wall,), blocks=(Block(name, "tuff", (1, 1, 1), (0, 0, 9)),))
    with pytest.raises(ScenarioError, match="names a block and a group"):
        scene(walls=(wall,), blocks=(Block("b", "tuff", (1, 1, 1), (0, 0, 9), group="w.1.1"),))
    with pytest.raises(ScenarioError, match="no joint with itself"):
        scene(walls=(wall,), joints=(JointOverride(("w.1.1", "w.1.1"), LAW),))


def test_blocks_without_number_are_refused_before_they_are_laid():
    with pytest.raises(ScenarioError, match="walls.w: .* would make 1000001000001 blocks: at most 1000000 can"):
        scene(walls=(Wall("w", "tuff", STONE, courses=1_000_000, blocks=1_000_000),))
    for generator in (
        {"stacks": (Stack("s", "tuff", 10**10, box=STONE),)},
        {"arches": (Arch("a", "tuff", 1.0, 0.1, 0.1, 10**10),)},
        {"domes": (Dome("d", "tuff", 1.0, 0.1, 10**5, 10**5, key=1.0),)},
    ):
        with pytest.raises(ScenarioError, match="= 100000.* would make 1000.*at most 1000000 can be built"):
            scene(**generator)


def test_memory_is_known_on_this_system(monkeypatch):
    assert memory.available() > 10**8
    monkeypatch.setattr(memory, "available", lambda: 2 * 10**8)
    with pytest.raises(ScenarioError, match="0.2 GB are free"):
        memory.check_memory([("w", 25_000)])
    memory.check_memory([("w", 5_000)])
    monkeypatch.setattr(memory, "available", lambda: None)
    memory.check_memory([("w", 10**6)])


def test_more_blocks_than_anyone_waits_for_are_refused_with_their_key(monkeypatch):
    """Too many blocks are refused at once, before they are built, even if the memory is not known."""
    monkeypatch.setattr(memory, "available", lambda: None)
    with pytest.raises(ScenarioError, match="walls.w: courses = 100000 and blocks = 10 would make 1100001 blocks"):
        scene(walls=(Wall("w", "tuff", STONE, courses=100_000, blocks=10, ends="half"),))
