"""Numbers that engines start from are finite: a NaN would act as no load, and as friction without end."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import DivergedError

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

OF_BLOCKS = ("position", "rotation", "mass", "inertia", "velocity", "angular_velocity", "dead_force", "dead_torque")
OF_JOINTS = ("origin", "axes", "area", "arm_a", "arm_b")


def check_finite(assembly: Assembly) -> None:
    """DivergedError that names the block, joint or actuator of which a number is not finite. No comparison with a NaN
    holds, so that an engine that went on with one might call it balanced."""
    for name in OF_BLOCKS:
        _check(name, getattr(assembly, name), lambda i: f"block {assembly.names[i]!r}")
    joints = assembly.joints
    for name in OF_JOINTS:
        _check(name, getattr(joints, name), lambda i: f"joint {i + 1}")
    for law in {id(law): law for law in joints.law}.values():
        numbers = [law.friction, law.normal_stiffness, law.shear_stiffness, law.cohesion, law.tensile_strength]
        _check("law", np.array(numbers, float), partial(_of_law, law.formulation))
    actuators = assembly.actuators
    for name, values in (("arm", actuators.at.arm), ("direction", actuators.direction), ("weight", actuators.weight)):
        _check(name, values, lambda i: f"actuator {actuators.names[i]!r}")


def _check(what: str, values: np.ndarray, whose: Callable[[int], str]) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        i = int(np.argwhere(bad)[0][0])
        raise DivergedError(f"{what} of {whose(i)} is no finite number, so that nothing can be computed with it")


def _of_law(formulation: str, _: int) -> str:
    return f"a {formulation} joint"
