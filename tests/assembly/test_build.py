"""Assemblies: mass, dead loads, joint forces under dead load, and one clear message for every invalid scene."""

import dataclasses
import math

import numpy as np
import pytest

from dembrick.assembly.build import assemble, dead_joint_forces
from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.scenario.model import (
    Actuator,
    Block,
    DisplacementControl,
    DynamicControl,
    JointLaw,
    JointOverride,
    Load,
    Material,
    Scenario,
    YieldControl,
)

LAB = (0.3, 0.2, 0.1)
LAW = JointLaw("concave", 0.64, 1e10, 4e9)
LOWER = Block("lower", "tuff", LAB, (0.0, 0.0, -0.05), fixed=True)
UPPER = Block("upper", "tuff", LAB, (0.0, 0.0, 0.05))
JACK = Actuator("jack", "upper", (0.075, 0.0, 0.0), (0.0, 1.0, 0.0))


def scenario(*blocks, **other):
    values = {
        "title": "test",
        "gravity": (0.0, 0.0, -9.81),
        "joint": LAW,
        "materials": {"tuff": Material(1500.0)},
        "blocks": blocks or (LOWER, UPPER),
        "control": YieldControl(1e-3),
    }
    return Scenario(**values | other)


def refused(*parts, **other):
    """Return the message of a scenario that cannot be built; assert that it contains ``parts``."""
    blocks = [part for part in parts if isinstance(part, Block)]
    with pytest.raises(ScenarioError) as caught:
        assemble(scenario(*blocks, **other))
    message = str(caught.value)
    for part in parts:
        assert isinstance(part, Block) or part in message, message
    assert "\n" not in message
    return message


def moved(block, /, **changes):
    return dataclasses.replace(block, **changes)


# --- assemblies -------------------------------------------------------------------------------------------------------


def test_the_lab_scene():
    found = assemble(scenario(loads=(Load("upper", (0.0, 0.0, -378.71)),), actuators=(JACK,)))
    assert found.names == ("lower", "upper") and found.fixed.tolist() == [True, False]
    assert found.mass == pytest.approx([9.0, 9.0], rel=1e-15)
    a, b, c = LAB
    assert found.inertia[1] == pytest.approx(np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) * 9.0 / 12.0)
    assert found.dead_force[1] == pytest.approx([0, 0, -467.0]) and found.dead_torque[1] == pytest.approx([0, 0, 0])
    assert len(found.joints) == 1 and found.joints[0].law is LAW
    assert found.joint_force == pytest.approx(np.array([[0, 0, 467.0]])) and found.joint_force_exact
    assert found.contact_points[0].area == pytest.approx(np.full(4, 0.015))
    jacks = found.actuators
    assert (jacks.names, jacks.at.block.tolist(), jacks.weight.tolist()) == (("jack",), [1], [1.0])
    assert jacks.at.start(found.position) == pytest.approx(np.array([[0.075, 0, 0]]))
    assert jacks.at.arm == pytest.approx(np.array([[0.075, 0, -0.05]]))
    assert jacks.direction == pytest.approx(np.array([[0, 1, 0]]))
    assert found.warnings == ()


def test_loads_act_where_they_stand():
    loads = (Load("upper", (10.0, 0.0, 0.0), (0.15, 0.0, 0.1)), Load("upper", (0.0, 2.0, -300.0)))
    found = assemble(scenario(loads=loads))
    assert found.dead_force[1] == pytest.approx([10.0, 2.0, -300.0 - 9.0 * 9.81])
    assert found.dead_torque[1] == pytest.approx(np.cross([0.15, 0.0, 0.05], [10.0, 0.0, 0.0]))
    assert found.joint_force[0] == pytest.approx([-10.0, -2.0, 300.0 + 9.0 * 9.81])


def test_velocities_and_orientations_are_kept():
    turned = moved(
        UPPER, orientation=(np.sqrt(0.5), 0, 0, np.sqrt(0.5)), velocity=(1, 2, 3), angular_velocity=(0, 0, 4)
    )
    found = assemble(scenario(LOWER, turned))
    assert found.velocity[1].tolist() == [1, 2, 3] and found.angular_velocity[1].tolist() == [0, 0, 4]
    assert found.rotation[1] == pytest.approx(rotation_matrix(turned.orientation))
    assert np.linalg.norm(found.orientation, axis=1) == pytest.approx([1.0, 1.0], abs=1e-15)


def test_laws_of_named_pairs():
    other = dataclasses.replace(LAW, friction=0.3)
    third = Block("third", "tuff", LAB, (0.0, 0.0, 0.15))
    found = assemble(scenario(LOWER, UPPER, third, joints=(JointOverride(("third", "upper"), other),)))
    laws = {(joint.block_a, joint.block_b): joint.law for joint in found.joints}
    assert laws == {(0, 1): LAW, (1, 2): other}


def test_contact_points_follow_the_tolerance_of_the_control():
    law = JointLaw("distributed", 0.64, 1e10, 4e9)
    third = Block("third", "tuff", LAB, (0.0, 0.0, 0.15))

    def count(tolerance, *blocks):
        return len(assemble(scenario(*blocks, joint=law, control=YieldControl(tolerance))).contact_points[0].area)

    assert count(1e-2, LOWER, UPPER, third) < 80 < 700 < count(1e-4, LOWER, UPPER, third)
    # the limit-load search for a single joint places its points again
    assert count(1e-2) < 80 < count(1e-3) == count(1e-4)
    curve = assemble(scenario(joint=law, control=DisplacementControl(rate=1e-4, travel=1e-3)))
    assert len(curve.contact_points[0].area) == len(assemble(scenario(joint=law)).contact_points[0].area)
    assert assemble(scenario(joint=JointLaw("convex", 0.64, 1e10, 4e9))).contact_points[:] == (None,)


def test_a_scene_far_away_keeps_its_forces_and_arms():
    shift = np.array([1000.0, -2000.0, 500.0])
    blocks = [moved(b, position=tuple(shift + b.position)) for b in (LOWER, UPPER)]
    near = assemble(scenario(actuators=(JACK,)))
    far = assemble(scenario(*blocks, actuators=(moved(JACK, point=tuple(shift + JACK.point)),)))
    assert far.joint_force == pytest.approx(near.joint_force, rel=1e-15)
    assert far.actuators.at.arm == pytest.approx(near.actuators.at.arm, abs=5e-13)


# --- joint forces -----------------------------------------------------------------------------------------------------


def test_a_stack_carries_the_blocks_above_each_joint():
    stack = [LOWER] + [Block(f"b{k}", "tuff", LAB, (0.0, 0.0, 0.05 + 0.1 * k)) for k in range(4)]
    found = assemble(scenario(*stack, loads=(Load("b2", (0.0, 5.0, -100.0)),)))
    weight = 9.0 * 9.81
    expected = [[0, -5, 4 * weight + 100], [0, -5, 3 * weight + 100], [0, -5, 2 * weight + 100], [0, 0, weight]]
    assert found.joint_force == pytest.approx(np.array(expected)) and found.joint_force_exact


def test_a_stack_written_from_the_top_down_carries_the_same():
    stack = [Block(f"b{k}", "tuff", LAB, (0.0, 0.0, 0.05 + 0.1 * k)) for k in range(2, -1, -1)] + [LOWER]
    found = assemble(scenario(*stack))
    normal = [force @ joint.axes[2] for joint, force in zip(found.joints, found.joint_force, strict=True)]
    assert sorted(normal) == pytest.approx([88.29, 2 * 88.29, 3 * 88.29])  # compression, though a lies above b


def test_a_hanging_block_pulls_whatever_the_order_of_the_blocks():
    for blocks in ((LOWER, UPPER), (UPPER, LOWER)):
        roof = [moved(b, position=tuple(-np.array(b.position))) for b in blocks]
        found = assemble(scenario(*roof))
        joint = found.joints[0]
        assert found.names[joint.block_a] == "lower" and found.joint_force[0] @ joint.axes[2] == pytest.approx(-88.29)


def test_a_wall_passes_its_weight_on_and_says_that_it_is_an_estimate():
    floor = Block("floor", "tuff", (3.0, 1.0, 0.1), (0.6, 0.0, -0.05), fixed=True)
    wall = [
        Block(f"{c}-{i}", "tuff", LAB, (0.3 * i + 0.15 * (c % 2), 0.0, 0.05 + 0.1 * c))
        for c in range(5)
        for i in range(4)
    ]
    found = assemble(scenario(floor, *wall))
    assert not found.joint_force_exact
    base = [k for k, joint in enumerate(found.joints) if joint.block_a == 0]
    assert found.joint_force[base].sum(axis=0) == pytest.approx([0, 0, 20 * 88.29], rel=1e-12)
    heads = [k for k, joint in enumerate(found.joints) if abs(joint.axes[2][0]) > 0.5]
    assert len(heads) == 15 and found.joint_force[heads] == pytest.approx(0.0)


def test_a_block_beside_a_support_hands_its_weight_to_the_joint_below():
    side = Block("side", "tuff", LAB, (0.3, 0.0, 0.05), fixed=True)
    found = assemble(scenario(LOWER, UPPER, side))
    below = [joint.block_a == 0 or joint.block_b == 0 for joint in found.joints]
    assert found.joint_force[below][0] == pytest.approx([0, 0, 88.29], rel=1e-9) and not found.joint_force_exact


def test_dead_forces_without_joints():
    force, exact = dead_joint_forces([], [True], np.zeros((1, 3)))
    assert force.shape == (0, 3) and exact


# --- refusals ---------------------------------------------------------------------------------------------------------


def test_overlap_names_the_blocks_and_the_depth():
    refused(LOWER, moved(UPPER, position=(0.0, 0.0, 0.04)), "lower", "upper", "overlap by 0.01 m")
    third = Block("third", "tuff", LAB, (0.05, 0.0, 0.145))
    refused(LOWER, moved(UPPER, position=(0.0, 0.0, 0.03)), third, "overlap by 0.02 m; they")
    lower = moved(third, position=(0.0, 0.0, 0.125))
    refused(LOWER, moved(UPPER, position=(0.0, 0.0, 0.03)), lower, "by 0.02 m (1 more pair overlaps less); they")
    message = refused(LOWER, UPPER, moved(third, position=(0.0, 0.0, 0.13)), moved(third, name="fourth"))
    assert "2 more pairs" in message and "third" in message and "fourth" in message
    twin = moved(LOWER, name="twin")
    refused(
        LOWER, twin, UPPER, "overlap by 0.1 m; they are supports: make one fixed block of both, or one of them smaller"
    )
    assert "they touch if" not in refused(LOWER, twin, UPPER)
    assemble(scenario(LOWER, moved(UPPER, position=(0.0, 0.0, 0.05 - 1e-7))))  # touching, to the stated tolerance


def test_an_overlap_says_which_way_out():
    """Moving the block as the message says leaves the blocks touching: one joint and no overlap."""
    for place, told in (
        ((0.0, 0.0, 0.04), "'upper' moves by 0.01 m along +z"),
        ((0.0, 0.19, -0.05), "'upper' moves by 0.01 m along +y"),
        ((-0.28, 0.0, -0.05), "'upper' moves by 0.02 m along -x"),
    ):
        message = refused(LOWER, moved(UPPER, position=place), told)
        words = message.split(" moves by ")[1].split()
        way = float(words[0]) * np.array([0.0 + (words[3][1] == axis) for axis in "xyz"])
        freed = np.array(place) + (way if words[3][0] == "+" else -way)
        assert len(assemble(scenario(LOWER, moved(UPPER, position=tuple(freed)))).joints) == 1
    refused(moved(UPPER, position=(0.0, 0.0, 0.04)), LOWER, "'upper' moves by 0.01 m along +z")  # not the support
    turn = {"orientation": (math.cos(math.pi / 12), 0.0, 0.0, math.sin(math.pi / 12))}  # 30 degrees
    beside = moved(UPPER, position=(0.28 * math.cos(math.pi / 6), 0.14, -0.05), **turn)
    refused(moved(LOWER, **turn), beside, "'upper' moves by [0.0173205, 0.01, 0] m")


def test_nothing_fixed():
    refused(moved(LOWER, fixed=False), UPPER, "no block is fixed", "fixed = true")


def test_a_block_on_nothing_and_what_it_misses():
    refused(LOWER, moved(UPPER, position=(0.0, 0.0, 0.052)), "upper", "rests on nothing", "lower", "0.002 m away")
    refused(LOWER, moved(UPPER, position=(0.0, 0.0, 5.0)), "upper", "rests on nothing", "face to face")
    ledge = moved(LOWER, name="ledge", box=(0.3, 0.2, 0.1), position=(0.2, 0.0, -0.051), fixed=True)
    half = moved(LOWER, box=(0.1, 0.2, 0.1))
    message = refused(half, ledge, moved(UPPER, position=(0.0, 0.0, 0.0503)), "rests on nothing", "0.0003 m away")
    assert "lower" in message
    above = Block("third", "tuff", LAB, (0.0, 0.0, 0.153))
    message = refused(LOWER, moved(UPPER, position=(0.0, 0.0, 0.053)), above, "rests on nothing", "0.003 m away")
    assert "upper" in message and "1 more" in message
    angle = 1e-3
    tilted = moved(UPPER, orientation=(np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0), position=(0.0, 0.0, 0.0502))
    assert "lower" in refused(LOWER, tilted, "upper", "rests on nothing")


def test_points_outside_their_block():
    refused("jack", "upper", "0.05 m outside", actuators=(moved(JACK, point=(0.2, 0.0, 0.0)),))
    refused("load number 2", "upper", "0.01 m outside",
            loads=(Load("upper", (0, 0, -1.0)), Load("upper", (0, 0, -1.0), (0.0, 0.11, 0.05))))  # fmt: skip
    for point in ((0.15, 0.1, 0.1), (-0.15, 0.0, 0.0), (0.15 + 1e-7, 0.0, 0.05)):
        assemble(scenario(actuators=(moved(JACK, point=point),)))
    refused("outside", actuators=(moved(JACK, point=(0.15 + 1e-6, 0.0, 0.05)),))
    turned = moved(UPPER, orientation=(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    assemble(scenario(LOWER, turned, actuators=(moved(JACK, point=(0.0, 0.15, 0.05)),)))
    refused(LOWER, turned, "0.05 m outside", actuators=(moved(JACK, point=(0.15, 0.0, 0.05)),))


def test_a_jack_on_a_support():
    refused("jack", "lower", "fixed", actuators=(moved(JACK, block="lower"),))


def test_laws_for_pairs_that_do_not_touch():
    third = Block("third", "tuff", LAB, (0.0, 0.0, 0.15))
    between = (JointOverride(("lower", "third"), LAW),)
    refused(LOWER, UPPER, third, "[[joints]]", "lower", "third", "do not touch", joints=between)
    refused(LOWER, UPPER, moved(LOWER, name="third", position=(0.3, 0.0, -0.05)), "both are fixed", joints=between)


def test_joints_too_soft_for_their_load():
    """N = 467 N on 0.06 m2: N/(kn A) is 1e-2 of 0.2 m at kn = 3.892e6 Pa/m, as is V_0/(ks A) at ks = 2.491e6 Pa/m."""
    loads = (Load("upper", (0.0, 0.0, -378.71)),)

    def law(kn, ks):
        return JointLaw("concave", 0.64, kn, ks)

    limit_n, limit_s = 467.0 / (0.06 * 0.2 * 1e-2), 0.64 * 467.0 / (0.06 * 0.2 * 1e-2)
    refused("lower", "upper", "467 N", "0.0101", "raise normal_stiffness", loads=loads, joint=law(limit_n / 1.01, 4e9))
    refused("298.88 N", "0.0101", "raise shear_stiffness", loads=loads, joint=law(1e10, limit_s / 1.01))
    found = assemble(scenario(loads=loads, joint=law(limit_n * 1.01, limit_s * 1.01)))
    assert len(found.warnings) == 1 and "normal_stiffness and shear_stiffness" in found.warnings[0]
    for kn, ks, count in ((9.9, 11.0, 1), (11.0, 9.9, 1), (10.1, 10.1, 0)):
        assert len(assemble(scenario(loads=loads, joint=law(limit_n * kn, limit_s * ks))).warnings) == count


def test_messages_name_the_file():
    with pytest.raises(ScenarioError, match=r"^scene\.toml: blocks"):
        assemble(scenario(LOWER, moved(UPPER, position=(0.0, 0.0, 0.04)), path="scene.toml"))


def test_kinds_that_need_no_support():
    """Scenes without supports and with falling blocks are accepted under dynamic controls."""
    free = DynamicControl(1.0)
    found = assemble(scenario(moved(UPPER, position=(0.0, 0.0, 1.0)), control=free))
    assert not len(found.joints) and found.joint_force.shape == (0, 3) and not found.joint_force_exact
    assert assemble(scenario(LOWER, moved(UPPER, position=(0.0, 0.0, 1.0)), control=free)).contact_points[:] == ()
