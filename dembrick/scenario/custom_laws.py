"""A joint law of the user's own: a function of Python, and what it remembers and is told.

No scenario file names one, since a scenario runs no code; it is given to `runs.simulate.simulate`.
"""

from __future__ import annotations

import hashlib
import keyword
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, overload

from dembrick.scenario.checks import assign, real, require, require_type

MOVE = ("penetration", "growth", "slip_1", "slip_2")  # of a contact point, m
RECORD = ("area", "normal_stiffness", "shear_stiffness", "friction")  # m2, N/m, N/m, 1
ANSWER = ("normal", "shear_1", "shear_2", "energy")  # N, N, N, J


@dataclass(frozen=True, slots=True)
class CustomLaw:
    """A law of contact points, given to `simulate` in place of that of the scenario's joints; made by `joint_law`.

    ``function``: of (move, law, memory), plain Python that numba can compile, or compiled already (numba.njit). It
    returns the normal force (N, pressing positive), the two shear forces (N, in the sense of the slip that they oppose)
    and the energy that its springs hold (J), without dashpots, which the program adds.

    ``memory``: names of the numbers that it remembers at each point, zero at the start. ``parameters``: numbers by name
    that it finds in ``law``. Raises ScenarioError for names and numbers that are none.
    """

    function: Callable
    memory: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self):
        require_type(callable(self.function), "law", self.function, "a function of (move, law, memory)")
        names: Any = (self.memory,) if isinstance(self.memory, str) else self.memory
        require_type(isinstance(names, Iterable), "memory", names, "a list of names")
        names = tuple(names)
        _check_names("memory", names, ANSWER)
        require_type(isinstance(self.parameters, Mapping), "parameters", self.parameters, "numbers by name")
        _check_names("parameters", tuple(self.parameters), RECORD)
        assign(self, memory=names, parameters={name: real(name, value) for name, value in self.parameters.items()})

    def with_parameters(self, **changed: float) -> CustomLaw:
        """The same law with other numbers for some of its parameters: it is not compiled again."""
        for name in changed:
            known = ", ".join(self.parameters) or "none"
            require(name in self.parameters, "parameters", name, f"this law has no such parameter; it has {known}")
        return replace(self, parameters={**self.parameters, **changed})

    @property
    def plain(self) -> Callable:
        """The function in plain Python."""
        return getattr(self.function, "py_func", self.function)

    @property
    def name(self) -> str:
        """Name of the function."""
        return getattr(self.plain, "__name__", "law")

    def as_dict(self) -> dict:
        """What a history says of it: name, memory, parameters, and a hash of the function's own code."""
        code = getattr(self.plain, "__code__", None)
        parts = () if code is None else (code.co_code, repr(code.co_names), repr(code.co_varnames), _constants(code))
        digest = hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:16]
        return {"name": self.name, "memory": list(self.memory), "parameters": dict(self.parameters), "code": digest}


def described(told: Mapping) -> str:
    """A law in a line, from what `CustomLaw.as_dict` or a history says of it."""
    given = told.get("parameters")
    numbers = ", ".join(f"{name} = {value:g}" for name, value in given.items()) if isinstance(given, Mapping) else ""
    return f"{told.get('name')}, of Python{f' ({numbers})' if numbers else ''}"


@overload
def joint_law(function: Callable, /, *, memory: str | Iterable[str] = (), **parameters: float) -> CustomLaw: ...
@overload
def joint_law(*, memory: str | Iterable[str] = (), **parameters: float) -> Callable[[Callable], CustomLaw]: ...
def joint_law(function=None, /, *, memory=(), **parameters):
    """Make a `CustomLaw` of a function, or be its decorator.

    >>> @dembrick.joint_law(memory=["slipped"], slip_distance=1e-3, lost=0.4)
    ... def weakening(move, law, memory): ...
    """
    if function is None:
        return lambda one: joint_law(one, memory=memory, **parameters)
    return CustomLaw(function, (memory,) if isinstance(memory, str) else tuple(memory), parameters)


def _constants(code) -> str:
    """The constants of a function, without the addresses of functions in it."""
    return repr([None if hasattr(one, "co_code") else one for one in code.co_consts])


def _check_names(key: str, names: tuple, taken: tuple[str, ...]) -> None:
    for name in names:
        require_type(isinstance(name, str), key, name, "a name of Python")
        usable = name.isidentifier() and not keyword.iskeyword(name) and not name.startswith("_")
        require(usable, key, name, "it must be a name of Python")
        require(name not in taken, key, name, f"the program's own are {', '.join(taken)}")
    require(len(set(names)) == len(names), key, list(names), "a name stands in it twice")
