"""Joint laws of a scenario: the default law and overrides for joints between some blocks; and custom laws.

A custom law is a Python function with its memory and parameters. A scenario file cannot name one, since scenarios run
no code; it is given to `runs.simulate.simulate`.
"""

from __future__ import annotations

import hashlib
import keyword
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any, overload

from dembrick.scenario.checks import assign, check_name, real, require, require_type
from dembrick.scenario.declared import check_keys, choice, declare, not_negative, positive
from dembrick.scenario.stages import stages_of

FORMULATIONS = ("concave", "corrected", "corrected-shear", "convex", "distributed")
PRESSURES = ("full", "effective", "linear")


@dataclass(frozen=True, slots=True)
class JointLaw:
    """Contact law of a joint: ``formulation``, coefficient of ``friction``, stiffness per area (``normal_stiffness``,
    ``shear_stiffness``, Pa/m).

    ``points`` (n along t1, m along t2) is for ``distributed`` only; None: chosen from the tolerance.
    ``pressure`` is for ``convex`` only. Strengths in Pa: ``cohesion`` and ``tensile_strength`` of a bond;
    ``residual_cohesion`` and ``residual_friction`` after it has broken, by slip or by opening (None: no cohesion, and
    the same friction); ``compressive_strength`` (None: no crushing). ``dilation``: uplift per slip.
    """

    formulation: str = field(
        metadata=choice(
            FORMULATIONS,
            "how a joint carries force: at its corners, at corners shrunk towards its centre, only shear at these, "
            "over its whole area, or at many points",
        )
    )
    friction: float = field(metadata=not_negative("1", "coefficient of Coulomb friction, tan(phi)"))
    normal_stiffness: float = field(metadata=positive("Pa/m", "penalty stiffness along the normal, per area"))
    shear_stiffness: float = field(metadata=positive("Pa/m", "penalty stiffness in the plane, per area"))
    points: tuple[int, int] | None = field(
        default=None,
        metadata=declare(
            '2 whole numbers >= 1, or "auto"',
            "distributed only: points along t1 and t2; left out, the tolerance decides",
            "1",
        ),
    )
    pressure: str = field(
        default="full",
        metadata=choice(
            PRESSURES,
            "convex only: where friction acts under bending: on the whole area, on the largest part centred on the "
            "resultant, or by the no-tension linear pressure",
        ),
    )
    cohesion: float = field(
        default=0.0,
        metadata=not_negative("Pa", "shear strength of the bond added to friction, per area; 0 is a dry joint"),
    )
    tensile_strength: float = field(
        default=0.0,
        metadata=not_negative("Pa", "tensile strength of the bond; never regained once broken", "cohesion / friction"),
    )
    dilation: float = field(
        default=0.0,
        metadata=not_negative(
            "1",
            "tangent of the dilation angle: rise over slip, for slips much smaller than asperities",
            "residual_friction",
        ),
    )
    residual_friction: float | None = field(
        default=None,
        metadata=not_negative("1", "friction after the first slip or opening; left out, it stays the same", "friction"),
    )
    residual_cohesion: float | None = field(
        default=None,
        metadata=not_negative(
            "Pa",
            "cohesion of the closed area after the first slip or opening; left out, none (a brittle bond); "
            "residual_cohesion = cohesion is a ductile joint",
            "cohesion",
        ),
    )
    compressive_strength: float | None = field(
        default=None,
        metadata=positive(
            "Pa",
            "pressure at which the joint crushes, without hardening; left out, it never crushes",
            "it must be greater than 0 Pa; leave it out if nothing crushes",
        ),
    )

    def __post_init__(self):
        check_keys(self)
        convex = self.pressure == "full" or self.formulation == "convex"
        require(convex, "pressure", self.pressure, "only formulation = 'convex' has a choice of pressure")
        if self.points is not None:
            self._check_points()
        self._check_strengths()

    def _check_strengths(self):
        mu, mu_r, c, c_r = self.friction, self.friction_after, self.cohesion, self.cohesion_after
        before = "the strength before slip"
        require(mu_r <= mu, "residual_friction", mu_r, f"it must not be above friction = {mu:g}, {before}")
        require(c_r <= c, "residual_cohesion", c_r, f"it must not be above cohesion = {c:g} Pa, {before}")
        least = "friction" if self.residual_friction is None else "residual_friction"
        bound = f"it must not be above {least} = {mu_r:g}, or slip would create energy"
        require(self.dilation <= mu_r, "dilation", self.dilation, bound)
        needed = mu * self.tensile_strength
        bound = (
            f"Coulomb's cone ends at cohesion / friction = {c / mu if mu else 0.0:g} Pa; "
            f"cohesion must be at least friction x tensile_strength = {needed:g} Pa"
        )
        require(needed <= c * (1.0 + 1e-12), "tensile_strength", self.tensile_strength, bound)

    @property
    def friction_after(self) -> float:
        """Friction coefficient after the first slip or opening."""
        return self.friction if self.residual_friction is None else self.residual_friction

    @property
    def cohesion_after(self) -> float:
        """Cohesion (Pa) after the first slip or opening."""
        return 0.0 if self.residual_cohesion is None else self.residual_cohesion

    @property
    def bonded(self) -> bool:
        """Whether there is a bond that can break: a strength that is lost at the first slip or opening."""
        return self.cohesion > 0.0 or self.tensile_strength > 0.0 or self.friction_after < self.friction

    @property
    def weakens(self) -> bool:
        """Whether part of the strength is lost at the first slip or opening."""
        return self.cohesion > self.cohesion_after or self.tensile_strength > 0.0 or self.friction > self.friction_after

    @property
    def dry(self) -> bool:
        """Whether the law is friction alone, equal before and after slip."""
        return not (self.bonded or self.dilation > 0.0 or self.compressive_strength is not None)

    def _check_points(self):
        value: Any = self.points
        value = value.tolist() if hasattr(value, "tolist") else value
        require(self.formulation == "distributed", "points", value, "only formulation = 'distributed' has points")
        whole = isinstance(value, list | tuple) and all(
            isinstance(n, Integral) and not isinstance(n, bool) for n in value
        )
        require_type(whole, "points", value, "a list of 2 whole numbers")
        require(len(value) == 2, "points", value, f"it must have 2 whole numbers, not {len(value)}")
        require(all(n >= 1 for n in value), "points", value, "both counts must be at least 1")
        require(value[0] * value[1] <= 1_000_000, "points", value, "at most a million points per joint")
        assign(self, points=(int(value[0]), int(value[1])))


@dataclass(frozen=True, slots=True)
class JointOverride:
    """A ``law`` for the joints ``between`` two named blocks or groups, in place of the default.

    A group given twice means the joints inside it. If several overrides apply to a joint, the last one holds.
    ``stages``: numbers of the stages in which the override holds, None for all.
    """

    between: tuple[str, str] = field(metadata=declare("2 names", "the two blocks or groups whose joints have this law"))
    law: JointLaw = field(metadata=declare("keys of [joint]", "what differs from the default law"))
    stages: tuple[int, ...] | None = field(
        default=None, metadata=stages_of("the stages in which it holds; left out, all")
    )

    def __post_init__(self):
        pair = self.between
        require_type(isinstance(pair, list | tuple), "between", pair, "a list of two block names (or groups)")
        require(len(pair) == 2, "between", pair, f"it must name two blocks, not {len(pair)}")
        assign(self, between=tuple(check_name(f"between[{i}]", name) for i, name in enumerate(pair)))
        require_type(isinstance(self.law, JointLaw), "law", self.law, "a JointLaw")
        check_keys(self)


MOVE = ("penetration", "growth", "slip_1", "slip_2")  # of a contact point, m
RECORD = ("area", "normal_stiffness", "shear_stiffness", "friction")  # m2, N/m, N/m, 1
ANSWER = ("normal", "shear_1", "shear_2", "energy")  # N, N, N, J


@dataclass(frozen=True, slots=True)
class CustomLaw:
    """A user-defined law of contact points, made by `joint_law` and given to `simulate` to replace the scenario's laws.

    ``function``: a function of (move, law, memory), in plain Python that numba can compile, or compiled already
    (numba.njit). It returns the normal force (N, compression positive), the two shear forces (N, positive in the sense
    of the slip that they oppose) and the elastic energy of its springs (J). Dashpots are added by the program.

    ``memory``: names of the history variables of each point, zero at the start. ``parameters``: numbers by name, which
    the function finds in ``law``. Raises ScenarioError for invalid names and numbers.
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
        """The same law with some parameters changed; it is not recompiled."""
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
        """Record of the law for a history: name, memory, parameters, and a hash of the function's code."""
        code = getattr(self.plain, "__code__", None)
        parts = () if code is None else (code.co_code, repr(code.co_names), repr(code.co_varnames), _constants(code))
        digest = hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:16]
        return {"name": self.name, "memory": list(self.memory), "parameters": dict(self.parameters), "code": digest}


def described(told: Mapping) -> str:
    """One-line description of a law, from `CustomLaw.as_dict` or the record in a history."""
    given = told.get("parameters")
    numbers = ", ".join(f"{name} = {value:g}" for name, value in given.items()) if isinstance(given, Mapping) else ""
    return f"{told.get('name')}, of Python{f' ({numbers})' if numbers else ''}"


@overload
def joint_law(function: Callable, /, *, memory: str | Iterable[str] = (), **parameters: float) -> CustomLaw: ...
@overload
def joint_law(*, memory: str | Iterable[str] = (), **parameters: float) -> Callable[[Callable], CustomLaw]: ...
def joint_law(function=None, /, *, memory=(), **parameters):
    """Make a `CustomLaw` of a function, directly or as a decorator.

    >>> @dembrick.joint_law(memory=["slipped"], slip_distance=1e-3, lost=0.4)
    ... def weakening(move, law, memory): ...
    """
    if function is None:
        return lambda one: joint_law(one, memory=memory, **parameters)
    return CustomLaw(function, (memory,) if isinstance(memory, str) else tuple(memory), parameters)


def _constants(code) -> str:
    """The constants of a function's code, without memory addresses of inner functions."""
    return repr([None if hasattr(one, "co_code") else one for one in code.co_consts])


def _check_names(key: str, names: tuple, taken: tuple[str, ...]) -> None:
    for name in names:
        require_type(isinstance(name, str), key, name, "a Python name")
        usable = name.isidentifier() and not keyword.iskeyword(name) and not name.startswith("_")
        require(usable, key, name, "it must be a valid Python name")
        require(name not in taken, key, name, f"these names are reserved: {', '.join(taken)}")
    require(len(set(names)) == len(names), key, list(names), "a name is listed twice")
