"""Arrays of joint laws for the kernels of both engines: the elastic stiffness of a closed joint (6 x 6), strengths
other than friction, room for the pressed parts of convex joints whose friction follows the bending, and a user-defined
law.

A user-defined law is compiled separately, once in every process, and kernels get its address. No kernel is compiled
with it, so the cache of kernels does not depend on the law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import numpy as np

from dembrick._pointer_law import ANSWERS, PointerLaw
from dembrick.errors import ScenarioError
from dembrick.kernels.joint.custom_law import Custom
from dembrick.kernels.joint.point_law import Strengths
from dembrick.kernels.joint.pressure import Pressed
from dembrick.scenario.joint_laws import ANSWER, MOVE, RECORD, CustomLaw, JointLaw
from dembrick.scenario.model import PRESSURES


def elastic_stiffness(shear: Sequence, normal: Sequence) -> np.ndarray:
    """Stiffness (..., 6, 6) against (d1, d2, dn, r1, r2, rn) of b at O in the axes of the joint.

    ``shear`` and ``normal``: sums, or integrals, of the spring stiffness times 1, x, y, x^2, y^2 and x y about O, each
    an array of the shape (...) or a number. A point at (x, y) moves by d1 - rn y and d2 + rn x along the joint, and by
    dn + r1 y - r2 x across it.
    """
    s, s_x, s_y, s_xx, s_yy, _ = shear
    n, n_x, n_y, n_xx, n_yy, n_xy = normal
    k = np.zeros((*np.shape(s), 6, 6))
    entries = (
        (0, 0, s), (1, 1, s), (0, 5, -s_y), (1, 5, s_x), (5, 5, s_xx + s_yy),
        (2, 2, n), (2, 3, n_y), (2, 4, -n_x), (3, 3, n_yy), (4, 4, n_xx), (3, 4, -n_xy),
    )  # fmt: skip
    for row, column, value in entries:
        k[..., row, column] = k[..., column, row] = value
    return k


def about_start(resultants: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The ``resultants`` (..., 6 or more) N, V_1, V_2, M_T, M_1, M_2 of joints with their moments about O of the start;
    ``shift`` (..., 2) m: where O of now, about which they are, lies from there along t1 and t2."""
    found, (s_1, s_2) = resultants.copy(), np.moveaxis(shift, -1, 0)
    N, V_1, V_2 = np.moveaxis(resultants[..., :3], -1, 0)
    found[..., 3] += s_1 * V_2 - s_2 * V_1
    found[..., 4] -= s_2 * N
    found[..., 5] += s_1 * N
    return found


def has_strengths(laws: Iterable[JointLaw]) -> bool:
    """Whether any of the ``laws`` has more strength than friction."""
    return any(not law.dry for law in {id(law): law for law in laws}.values())  # many joints, few laws


def strengths_of(laws: Sequence[JointLaw]) -> Strengths | None:
    """Strengths of joints with these ``laws``, one entry each; None if all are dry."""
    if not has_strengths(laws):
        return None
    return Strengths(
        cohesion=np.array([law.cohesion for law in laws]),
        tension=np.array([law.tensile_strength for law in laws]),
        crushing=np.array([np.inf if (f_c := law.compressive_strength) is None else f_c for law in laws], float),
        dilation=np.array([law.dilation for law in laws]),
        residual_cohesion=np.array([law.cohesion_after for law in laws]),
        residual=np.array([law.friction_after / law.friction if law.friction else 1.0 for law in laws]),
        held=np.zeros(1),
    )


def bonded_at_start(laws: Sequence[JointLaw]) -> np.ndarray:
    """1 if a joint has a bond that may break, else 0."""
    return np.array([float(law.bonded) for law in laws])


def repeated(strengths: Strengths, counts: np.ndarray) -> Strengths:
    """Strengths with an entry for every contact point, from those of joints with ``counts`` (s,) points."""
    each = {name: np.repeat(value, counts) for name, value in strengths._asdict().items() if name != "held"}
    return strengths._replace(**each)


def sliding_strength(strengths: Strengths | None, area, friction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Force by which slip dissipates work (N), one entry for each of ``strengths``, from N (N) and the ``area``.

    Sliding joints have no bond any more, and the work of dilation is subtracted from that of friction.
    """
    if strengths is None:
        return friction * normal
    return strengths.residual_cohesion * area + (strengths.residual * friction - strengths.dilation) * normal


_NO_TEXT = ("Failed in", "During", "File ", "def ", "<source", "^")  # begin lines of numba on its own internals


def rows_of(law: CustomLaw, laws: Sequence[JointLaw], area: np.ndarray) -> Custom:
    """Rows of contact points with the scenario's ``laws`` and tributary areas (c,) in m2, at rest.

    Raises ScenarioError if the law does not compile, does not return four numbers, or not finite ones at rest.
    """
    compiled = _compiled(law.function, law.memory, tuple(law.parameters))
    _try(law, compiled)
    return _at_rest(law, laws, area, compiled.at)


def _at_rest(law: CustomLaw, laws: Sequence[JointLaw], area: np.ndarray, at: np.ndarray) -> Custom:
    own = np.array([(one.normal_stiffness, one.shear_stiffness, one.friction) for one in laws]).reshape(-1, 3)
    record = np.column_stack([area, area * own[:, 0], area * own[:, 1], own[:, 2]])
    more = np.tile(np.array(list(law.parameters.values()), float), (len(area), 1))
    return Custom(
        move=np.zeros((len(area), len(MOVE))),
        record=np.ascontiguousarray(np.hstack([record, more])),
        memory=np.zeros((len(area), ANSWERS + len(law.memory))),
        at=at,
        answer=np.zeros((len(area), ANSWERS)),
        since=np.zeros((len(area), 3)),
        tried=np.zeros((len(area), ANSWERS + len(law.memory))),
    )


@cache  # for as long as the process lives, since a kernel may call it at any time
def _compiled(function: Callable, memory: tuple[str, ...], parameters: tuple[str, ...]) -> PointerLaw:
    names = (MOVE, (*RECORD, *parameters), (*ANSWER, *memory))
    try:
        return PointerLaw(function, [np.dtype([(name, float) for name in each]) for each in names])
    except Exception as error:  # numba raises various errors for a missing field
        name = getattr(function, "__name__", "law")
        raise ScenarioError(
            f"the joint law {name} does not compile: {_cause(error)}; it must take (move, law, memory) and return "
            "four numbers (normal force, two shear forces, stored energy), in the Python that numba can compile"
        ) from error


def _cause(error: Exception) -> str:
    """The line of numba's message with the cause of the error."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith(_NO_TEXT)]
    return (told or lines or ["no reason given"])[0].rstrip(".")


def _try(law: CustomLaw, compiled: PointerLaw) -> None:
    """Raise ScenarioError if the law returns no finite result for an open point of 1 m2 at rest."""
    rest = _at_rest(law, [JointLaw("concave", 0.5, 1.0, 1.0)], np.ones(1), compiled.at)
    try:
        compiled(rest.move[0], rest.record[0], rest.memory[0], rest.answer[0])
    except (TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise ScenarioError(f"the joint law {law.name} fails for an open point at rest: {error}") from error
    if not np.isfinite(rest.answer).all():
        raise ScenarioError(
            f"the joint law {law.name} returns {rest.answer[0].tolist()} for an open point at rest: forces and "
            "energy must be finite"
        )


def check_pressures(joints, chosen: np.ndarray) -> None:
    """Raise ScenarioError if a ``chosen`` joint of a `JointTable` has a kind of pressure that its polygon does not
    allow."""
    for j in chosen.tolist():
        if joints.law[j].pressure == "effective" and j in joints.pieces:
            raise ScenarioError(
                'pressure = "effective" needs convex joints, and a joint here consists of several pieces: use "linear"'
            )


def pressed_parts(pressures: Sequence[str], corners: Sequence[int]) -> Pressed | None:
    """Arrays for the pressed parts of convex joints, filled by the first evaluation; None if all pressures are full."""
    if all(pressure == "full" for pressure in pressures):
        return None
    room = [2 * m + 2 for m in corners]  # every edge of the reflected polygon can add a corner
    a, total = len(room), sum(room)
    return Pressed(
        kind=np.array([PRESSURES.index(pressure) for pressure in pressures], np.int64),
        pieces=np.ones(a, np.int64),
        start=np.cumsum([0, *room[:-1]]).astype(np.int64),
        count=np.zeros(a, np.int64),
        x=np.zeros(total),
        y=np.zeros(total),
        spare_x=np.zeros(total),
        spare_y=np.zeros(total),
        centre=np.zeros((a, 2)),
        density=np.zeros((a, 3)),
        reach=np.zeros(a),
        radius=np.ones(a),
    )


def room_of(part: Pressed) -> np.ndarray:
    """Number of corners for which each pressed part has room (a,)."""
    return np.diff(np.append(part.start, len(part.x)))
