"""Joint families in real time: functions over all joints of a state, whatever families it has.

A family is a module (`point_joints`, `area_joints`) with a common set of functions, and a field of `MovingState`; its
kernels are the module of the same name in `kernels.dynamics`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.kernels.dynamics.area_tiles import Faces
from dembrick.kernels.dynamics.point_joints import Corners
from dembrick.simulation.dynamics import area_joints, point_joints

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

FAMILIES: dict[str, ModuleType] = {"corners": point_joints, "faces": area_joints}  # fields of a state


def at_rest(assembly: Assembly, turn: np.ndarray, way: np.ndarray) -> tuple[Corners | None, Faces | None]:
    """The joints of all families of an assembly, at rest: the fields of a state. ``turn`` and ``way`` (j,) of all
    joints: see `memory_order.in_turn` and `memory_order.ways`."""
    corners = point_joints.at_rest(assembly, turn, way)
    return corners, area_joints.at_rest(assembly, turn, way, 0 if corners is None else len(corners.used))


def present(state) -> Iterator[tuple[ModuleType, Any]]:
    """The module and the joints of every family that a scene has."""
    for name, module in FAMILIES.items():
        joints = getattr(state, name)
        if joints is not None:
            yield module, joints


def places(state) -> np.ndarray:
    """`EnergyTerms.place` (j,): number of each joint among the point joints, or -1 less that among the convex ones."""
    found = np.zeros(len(state.links.host), np.int64)
    if state.corners is not None:
        found[state.corners.joint] = np.arange(len(state.corners.joint))
    if state.faces is not None:
        found[state.faces.joint] = -1 - np.arange(len(state.faces.joint))
    return found


def springs(state, with_laws: bool = True) -> tuple[Corners | None, Faces | None]:
    """Joints of a state without fields that do not affect the energy of their springs, and without their laws unless
    ``with_laws``: a kernel is compiled for the types of all its arguments."""
    corners, faces = state.corners, state.faces
    if corners is not None:
        corners = corners._replace(force=None)
    if faces is not None:
        faces = faces._replace(pressed=None)
    if with_laws:
        return corners, faces
    return (
        None if corners is None else corners._replace(strengths=None, bonds=None, custom=None),
        None if faces is None else faces._replace(strengths=None, bonds=None),
    )


def stiffness(state) -> np.ndarray:
    """Elastic stiffness (j, 6, 6) of the closed joints against (d1, d2, dn, r1, r2, rn) at O, in the plane's axes."""
    found = np.zeros((len(state.links.host), 6, 6))
    for module, joints in present(state):
        found[joints.joint] = module.stiffness(joints)
    return found


def normal_stiffness(state) -> np.ndarray:
    """Normal stiffness of every closed joint (j,) N/m."""
    found = np.zeros(len(state.links.host))
    for module, joints in present(state):
        found[joints.joint] = module.normal_stiffness(joints)
    return found


def greatest_modulus(state) -> float:
    """Greatest normal stiffness per area of any joint (Pa/m)."""
    return max((float(joints.k_n.max()) for _, joints in present(state)), default=0.0)


def arrays(state) -> list[np.ndarray]:
    return [array for module, joints in present(state) for array in module.arrays(joints)]


def memory(state) -> list[np.ndarray]:
    """All arrays of the joints but those of forces that are only recorded."""
    return [array for module, joints in present(state) for array in module.memory(joints)]


def take_memory(state, left) -> None:
    """Copy the history of the joints from ``left``, a state of statics."""
    sense = state.links.sense
    if state.corners is not None:
        point_joints.take_memory(state.corners, left.points, sense)
    if state.faces is not None:
        area_joints.take_memory(state.faces, left.areas, sense)


def strengths(state) -> list[tuple]:
    """Copies of the friction of every family, and of its other strengths but `held`, none if all joints are dry."""
    return [
        (module.friction(joints), [] if joints.strengths is None else [each.copy() for each in joints.strengths[:-1]])
        for module, joints in present(state)
    ]


def put_strengths(state, values: Iterable[tuple]) -> None:
    """Set friction and strengths of the joints to those of `strengths`."""
    for (module, joints), (friction, others) in zip(present(state), values, strict=True):
        if not np.array_equal(module.friction(joints), friction):
            module.put_friction(joints, friction)
        for own, value in zip(joints.strengths or (), others, strict=False):
            own[...] = value


def stick(state, friction: float) -> None:
    """Give all joints so much ``friction``, with and without a bond."""
    for module, joints in present(state):
        module.put_friction(joints, friction)
        if joints.strengths is not None:
            joints.strengths.residual[:] = 1.0


def has_strengths(state) -> bool:
    """Whether any joint has more strength than friction, or dilates, or crushes."""
    return any(joints.strengths is not None for _, joints in present(state))


def of_several_parts(state) -> bool:
    """Whether a family has nested tuples of arrays, as those of strengths, of pressures that follow the bending, or of
    a user-defined law: numba cannot pass these to threads."""
    return any(isinstance(field, tuple) for _, joints in present(state) for field in joints)


def keep_bonds_intact(state, held: bool) -> None:
    """Keep bonds intact if their failure would lose strength (``held``), or let bonds break again."""
    for _, joints in present(state):
        if joints.strengths is not None:
            joints.strengths.held[:] = held


def bonded(state) -> np.ndarray:
    """The part of the area of every joint (j,) whose bond is intact."""
    found = np.zeros(len(state.links.host))
    for module, joints in present(state):
        found[joints.joint] = module.bonded(joints)
    return found


def bonds(state) -> np.ndarray:
    """How many bonds of every joint (j,) hold: of its points, or of the whole of it."""
    found = np.zeros(len(state.links.host), np.int64)
    for module, joints in present(state):
        found[joints.joint] = module.bonds(joints)
    return found


def contact_points(state) -> int:
    """Number of contact points of all joints."""
    return 0 if state.corners is None else int(state.corners.start[-1])


def convex_joints(state) -> np.ndarray:
    """The numbers (a,) of the convex joints."""
    return np.zeros(0, np.int64) if state.faces is None else state.faces.joint


def outlines(state) -> int:
    """Number of polygons of convex joints for which there is room."""
    return 0 if state.faces is None else len(state.faces.count)


def rooms(state, snapshot) -> int:
    """Number of polygons of convex joints for which a state needs room before ``snapshot`` is restored."""
    return 0 if state.faces is None else area_joints.rooms(state.faces, snapshot)


def check_restored(state, path) -> None:
    """Raise HistoryError if indices restored from the checkpoint ``path`` are out of bounds."""
    for module, joints in present(state):
        module.check_restored(joints, path)
