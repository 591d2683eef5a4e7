"""A joint law of the user's own, compiled: its address for the kernels, and the rows that it works on.

It is compiled by itself, anew in every process. No kernel is compiled with it, so that none in the cache can hold one
law or another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from dembrick._pointer_law import ANSWERS, PointerLaw
from dembrick.errors import ScenarioError
from dembrick.kernels.joint.custom_law import Custom
from dembrick.scenario.custom_laws import ANSWER, MOVE, RECORD, CustomLaw
from dembrick.scenario.joint_laws import JointLaw

_NO_TEXT = ("Failed in", "During", "File ", "def ", "<source", "^")  # begin lines of numba that tell of itself


def rows_of(law: CustomLaw, laws: Sequence[JointLaw], area: np.ndarray) -> Custom:
    """Rows of contact points with the scenario's ``laws`` and tributary areas (c,) in m2, at rest.

    Raises ScenarioError if the law does not compile, does not answer with four numbers, or not with finite ones at
    rest.
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
    )


@cache  # for as long as the process lives, since a kernel may call it at any time
def _compiled(function: Callable, memory: tuple[str, ...], parameters: tuple[str, ...]) -> PointerLaw:
    names = (MOVE, (*RECORD, *parameters), (*ANSWER, *memory))
    try:
        return PointerLaw(function, [np.dtype([(name, float) for name in each]) for each in names])
    except Exception as error:  # numba raises what it likes for a field that there is not
        name = getattr(function, "__name__", "law")
        raise ScenarioError(
            f"the joint law {name} does not compile: {_cause(error)}; it must take (move, law, memory) and return four "
            "numbers, the normal force, two shear forces and the energy held, by what numba knows of Python"
        ) from error


def _cause(error: Exception) -> str:
    """The line of numba's message that says what is wrong."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith(_NO_TEXT)]
    return (told or lines or ["no reason given"])[0].rstrip(".")


def _try(law: CustomLaw, compiled: PointerLaw) -> None:
    """ScenarioError if the law has no finite answer for a point of 1 m2 that rests open."""
    rest = _at_rest(law, [JointLaw("concave", 0.5, 1.0, 1.0)], np.ones(1), compiled.at)
    try:
        compiled(rest.move[0], rest.record[0], rest.memory[0], rest.answer[0])
    except (TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise ScenarioError(f"the joint law {law.name} fails for an open point at rest: {error}") from error
    if not np.isfinite(rest.answer).all():
        raise ScenarioError(
            f"the joint law {law.name} answers with {rest.answer[0].tolist()} for an open point at rest: its forces "
            "and its energy must be finite"
        )
