"""Scenarios of stones under gravity: a test states only what it varies."""

from collections.abc import Iterable

from dembrick.scenario.model import Block, Control, JointLaw, Material, Scenario

STONE = {"stone": Material(2000.0)}
GRAVITY = (0.0, 0.0, -9.81)


def law(formulation="concave", friction=0.64, stiffness=1e10, **more) -> JointLaw:
    """A joint law whose shear stiffness is 0.4 times its normal ``stiffness`` (Pa/m)."""
    return JointLaw(formulation, friction, stiffness, 0.4 * stiffness, **more)


def of_stone(joint: JointLaw, control: Control, blocks: Iterable[Block] = (), **more) -> Scenario:
    """Blocks of ``stone`` under one joint law; ``more`` adds or replaces fields of the scenario."""
    default = {"title": "test", "gravity": GRAVITY, "materials": STONE}
    return Scenario(**default | more, joint=joint, control=control, blocks=tuple(blocks))
