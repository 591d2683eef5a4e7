"""Joint families in statics: functions over all joints of a state, whatever families it has.

A family is a module (`point_joints`, `area_joints`) with a common set of functions, and a field of `State`; its kernels
are the module of the same name in `kernels.statics`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.kernels.joint.families import AREAS, POINTS
from dembrick.kernels.joint.geometry import CLOSED
from dembrick.kernels.statics.area_joints import Areas
from dembrick.kernels.statics.point_joints import Points
from dembrick.simulation.checkpoint_arrays import arrays_of, flattened
from dembrick.simulation.statics import area_joints, point_joints

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

MANY = 0.1  # of the overloaded bonds: so many may break at once
ALIKE = 1e-6  # of the loads: bonds that fail within this of another break with it
STICKING = 1e9  # friction of joints that may not slip, and its ratio to that without a bond
FAMILIES: dict[str, ModuleType] = {"points": point_joints, "areas": area_joints}  # fields of a state


def at_rest(assembly: Assembly) -> tuple[Points | None, Areas | None]:
    """The joints of all families of an assembly, at rest: the fields of a state."""
    return point_joints.at_rest(assembly), area_joints.at_rest(assembly)


def of_cases(shapes, cases) -> tuple[Points | None, Areas | None]:
    """The joints of a batch of ``cases``, from those of its distinct shapes in the fields of ``shapes``."""
    points = None if shapes.points is None else point_joints.of_cases(shapes.points, cases)
    areas = None if shapes.areas is None else area_joints.of_cases(shapes.areas, cases)
    return points, areas


def normal_sums(state) -> np.ndarray:
    """`Energy.normal` (p, 7) of the point joints."""
    return np.zeros((0, 7)) if state.points is None else point_joints.normal_sums(state.points)


def present(state) -> Iterator[tuple[ModuleType, Any]]:
    """The module and the joints of every family that a scene has."""
    for name, module in FAMILIES.items():
        joints = getattr(state, name)
        if joints is not None:
            yield module, joints


def number(state) -> int:
    """The number by which kernels know the only family of a scene."""
    return POINTS if state.areas is None else AREAS


def has_areas(state) -> bool:
    """Whether a scene has convex joints."""
    return state.areas is not None


def friction(state) -> np.ndarray:
    """Friction coefficient (j,) of every joint."""
    found = np.zeros(len(state.joints.block_a))
    for _, joints in present(state):
        found[joints.joint] = joints.friction
    return found


def stiffness(state) -> np.ndarray:
    """Elastic stiffness (j, 6, 6) of every closed joint against (d1, d2, dn, r1, r2, rn) of b at O."""
    found = np.zeros((len(state.joints.block_a), 6, 6))
    for module, joints in present(state):
        found[joints.joint] = module.stiffness(joints)
    return found


def reach(state) -> np.ndarray:
    """Greatest distance from O at which each joint carries shear (j,) in m."""
    found = np.zeros(len(state.joints.block_a))
    for module, joints in present(state):
        distance = np.hypot(*module.shear_corners(joints))
        found[joints.joint] = np.maximum.reduceat(distance, joints.start[:-1])
    return found


def torsion_radius(state) -> np.ndarray:
    """Torsion strength over V_0 of each joint (j,) in m, or less."""
    found = np.full(len(state.joints.block_a), np.inf)
    for module, joints in present(state):
        found[joints.joint] = module.torsion_radius(joints)
    return found


def entries(state) -> int:
    """Number of contact entries that the kernels process per evaluation: a measure of their time."""
    return sum(module.entries(joints) for module, joints in present(state))


def contact_points(state) -> int:
    """Number of contact points of all joints."""
    return 0 if state.points is None else len(state.points.k_n)


def slip_twists(state) -> np.ndarray:
    """Slip twist (j, 3) of each joint in the last step."""
    found = state.joints.step.copy()
    for module, joints in present(state):
        found[joints.joint] = module.slip_twists(joints, found[joints.joint])
    return found


def follows_bending(state) -> bool:
    """Whether the friction of a convex joint follows the bending."""
    return state.areas is not None and state.areas.pressed is not None


def memory(state) -> dict[str, Any]:
    """History of the joints: for every field of `FAMILIES` a copy with its own history, or None."""
    found = dict.fromkeys(FAMILIES)
    for name, module in FAMILIES.items():
        joints = getattr(state, name)
        if joints is not None:
            found[name] = joints._replace(**{field: _copied(getattr(joints, field)) for field in module.MEMORY})
    return found


def changing(state) -> Iterator[np.ndarray]:
    """Arrays of the joints that a step may change: their history, and results of the last evaluation."""
    for module, joints in present(state):
        fields = (getattr(joints, name) for name in (*module.MEMORY, *module.FOUND))
        yield from arrays_of(value for value in fields if value is not None)


def _copied(value):
    """A copy of an array, of a named tuple of arrays, or None."""
    return type(value)(*map(_copied, value)) if isinstance(value, tuple) else None if value is None else value.copy()


def memory_arrays(part) -> dict[str, np.ndarray]:
    """The arrays of `memory`, kept in the fields of ``part``, by name."""
    found: dict[str, np.ndarray] = {}
    for name, module in FAMILIES.items():
        joints = getattr(part, name)
        if joints is not None:
            kept = {field: getattr(joints, field) for field in module.MEMORY}
            found |= {f"{name}.{field}": array for field, array in kept.items() if isinstance(array, np.ndarray)}
            found |= flattened({f"{name}.{field}": part for field, part in kept.items() if isinstance(part, tuple)})
    return found


def has_strengths(state) -> bool:
    """Whether any joint has more strength than friction, or dilates, or crushes."""
    return any(joints.strengths is not None for _, joints in present(state))


def is_custom(state) -> bool:
    """Whether the joints follow a user-defined law."""
    return state.points is not None and state.points.custom is not None


def keep_bonds_intact(state, held: bool) -> None:
    """Keep bonds intact if their failure would lose strength (``held``), or let bonds break again."""
    for _, joints in present(state):
        if joints.strengths is not None:
            joints.strengths.held[:] = held


@contextmanager
def stuck(state):
    """Context in which no joint slips."""
    arrays = [joints.friction for _, joints in present(state)]
    arrays += [joints.strengths.residual for _, joints in present(state) if joints.strengths is not None]
    own = [array.copy() for array in arrays]
    for array in arrays:
        array[:] = STICKING
    try:
        yield
    finally:
        for array, values in zip(arrays, own, strict=True):
            array[:] = values


def bonds(state) -> list[np.ndarray]:
    """Copies of the intact parts of the bonds of each family."""
    return [bonds.bonded.copy() for bonds in _bonds(state)]


def without_first(state, before: np.ndarray) -> list[np.ndarray]:
    """`bonds` without those that fail first while their reserves (m, 2) in N fall in proportion to the loads from those
    ``before`` to the present ones: a single one and its equals, or a tenth of many."""
    now = reserves(state)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(now < 0.0, np.maximum(before, 0.0) / (np.maximum(before, 0.0) - now), np.inf)
    share = np.where(np.isnan(share), 1.0, share).min(axis=1)
    most = np.sort(share)[max(1, int(MANY * np.isfinite(share).sum())) - 1]
    goes, found, first = share <= (1.0 + ALIKE) * most, bonds(state), 0
    for held in found:
        held[goes[first : first + len(held)]] = 0.0
        first += len(held)
    return found


def break_bonds(part, held: list[np.ndarray]) -> None:
    """Break all bonds of the joints in the fields of ``part`` that are broken in ``held``, see `bonds`."""
    for now, then in zip(_bonds(part), held, strict=True):
        np.minimum(now.bonded, then, out=now.bonded)


def _bonds(part) -> list:
    """The bonds of each family in the fields of ``part`` that has any."""
    return [joints.bonds for _, joints in present(part) if joints.bonds is not None]


def reserves(state) -> np.ndarray:
    """Reserves of all bonds in tension and in shear (m, 2), infinite if there is none; N."""
    found = [module.reserve(joints) for module, joints in present(state) if joints.strengths is not None]
    return np.concatenate([np.zeros((0, 2)), *found])


def overloaded(state) -> np.ndarray:
    """Which bonds are overloaded in tension and in shear (m, 2)."""
    return reserves(state) < 0.0


def tensile_strengths(state) -> np.ndarray:
    """Tensile strength of every bond (m,) in N, in the order of `reserves`."""
    found = [module.tensile_strength(joints) for module, joints in present(state) if joints.strengths is not None]
    return np.concatenate([np.zeros(0), *found])


def greatest_strength(state) -> np.ndarray:
    """Greatest force (j,) in N that the bonds of every joint may carry in addition to friction."""
    found = np.zeros(len(state.joints.block_a))
    for module, joints in present(state):
        found[joints.joint] = module.greatest_strength(joints)
    return found


def cohesion_of_sliding(state) -> np.ndarray:
    """Residual cohesion (j,) in N of every joint that slides closed, in addition to friction."""
    found = np.zeros(len(state.joints.block_a))
    for module, joints in present(state):
        if joints.strengths is not None:
            found[joints.joint] = joints.strengths.residual_cohesion * module.whole_area(joints)
    return found


def compressive_strength(state) -> np.ndarray:
    """Compressive strength of every joint (j,) in Pa, infinite if it never crushes."""
    found = np.full(len(state.joints.block_a), np.inf)
    for _, joints in present(state):
        if joints.strengths is not None:
            found[joints.joint] = joints.strengths.crushing
    return found


def crushing_work(state, before) -> float:
    """Work dissipated by crushing since the `memory` in the fields of ``before`` (J)."""
    return sum(
        module.crushing_work(getattr(state, name), getattr(before, name))
        for name, module in FAMILIES.items()
        if getattr(state, name) is not None
    )


def slid(state, before, least: float = 0.0) -> bool:
    """Whether any joint has slid by more than ``least`` (m) since the `memory` ``before``."""
    joints = ((getattr(state, name), getattr(before, name)) for name in FAMILIES)
    return any(now is not None and (now.slip - then.slip > least).any() for now, then in joints)


def gave_way(state, before) -> bool:
    """Whether any joint has slid, broken or crushed since the `memory` ``before``."""
    deeper = any((now.crushed > then.crushed).any() for now, then in zip(_bonds(state), _bonds(before), strict=True))
    return slid(state, before) or broke(state, before) or deeper


def broke(state, before) -> bool:
    """Whether any bond has broken since the `memory` ``before``."""
    return any((now.bonded < then.bonded).any() for now, then in zip(_bonds(state), _bonds(before), strict=True))


def opened(state, before: np.ndarray) -> bool:
    """Whether any contact point or corner without a bond has opened further since the openings ``before`` (j, 3)."""
    for module, joints in present(state):
        counts = np.diff(joints.start)
        j, free = np.repeat(joints.joint, counts), True
        if joints.strengths is not None:
            free = module.tensile_strength(joints) * joints.bonds.bonded == 0.0
            free = free if len(free) == len(j) else np.repeat(free, counts)
        x, y = module.corners(joints)
        gap, then = (seen[j, 0] + seen[j, 1] * y - seen[j, 2] * x for seen in (state.joints.opening, before))
        if (free & (gap > np.maximum(then, 0.0))).any():
            return True
    return False


def friction_work(state, before) -> float:
    """Work dissipated by friction since the `memory` in the fields of ``before``, with the present forces (J)."""
    normal = state.joints.resultant[:, 0]
    work = 0.0
    for name, module in FAMILIES.items():
        joints = getattr(state, name)
        if joints is not None:
            work += module.friction_work(joints, getattr(before, name), normal[joints.joint])
    return work


def closes_gaps(state, base: np.ndarray) -> bool:
    """Whether any gap at a contact point or corner has decreased, beyond rounding, since the joints had moved by
    ``base`` (j, 6): such a mechanism moves at a constant load only until the gap has closed, and is no limit."""
    opening, change = state.joints.opening, state.joints.relative - base
    found, widened = [], []
    for module, joints in present(state):
        j = np.repeat(joints.joint, np.diff(joints.start))
        x, y = module.corners(joints)
        found.append(opening[j, 0] + opening[j, 1] * y - opening[j, 2] * x)
        widened.append(change[j, 2] + change[j, 3] * y - change[j, 4] * x)
    gap, wider = np.concatenate(found), np.concatenate(widened)
    fastest = max(float(np.abs(wider).max()), float(np.abs(change[:, :2]).max()))
    return bool(((gap > CLOSED * fastest) & (wider < -CLOSED * fastest)).any())
