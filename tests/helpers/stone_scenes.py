"""Scenarios of stones under gravity: a test says what it is about, all else is the same everywhere."""

from collections.abc import Iterable

from dembrick.scenario.model import Block, Control, JointLaw, Material, Scenario

STONE = {"stone": Material(2000.0)}
GRAVITY = (0.0, 0.0, -9.81)


def law(formulation="concave", friction=0.64, stiffness=1e10, **more) -> JointLaw:
    """A joint law whose shear stiffness is 0.4 of its normal ``stiffness`` (Pa/m)."""
    return JointLaw(formulation, friction, stiffness, 0.4 * stiffness, **more)


def of_stone(joint: JointLaw, control: Control, blocks: Iterable[Block] = (), **more) -> Scenario:
    """Blocks of ``stone`` under one joint law; ``more``: further fields of the scenario, or other values of these."""
    default = {"title": "test", "gravity": GRAVITY, "materials": STONE}
    return Scenario(**default | more, joint=joint, control=control, blocks=tuple(blocks))
