"""How supports are moved: by a displacement and a turn, straight from the start to the end."""

from __future__ import annotations

from dataclasses import dataclass

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import (
    assign,
    check_name,
    direction,
    present,
    real,
    require,
    require_type,
    show,
    vector,
)

STEEPEST_TURN = 90.0  # deg


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn by ``angle`` (deg) about ``axis`` (right-hand rule) through ``point`` (m, world, at the start).

    Without a ``point`` each support turns about its own centroid.
    """

    axis: Vector
    angle: float
    point: Vector | None = None

    def __post_init__(self):
        angle = real("angle", self.angle)
        bound = f"it must lie between -{STEEPEST_TURN:g} and {STEEPEST_TURN:g} deg, and not be 0"
        require(0.0 < abs(angle) <= STEEPEST_TURN, "angle", angle, bound)
        assign(self, axis=direction("axis", self.axis), angle=angle)
        if self.point is not None:
            assign(self, point=vector("point", self.point))


@dataclass(frozen=True, slots=True)
class SupportPath:
    """The motion of ``supports``, blocks or groups: ``displacement`` (m, at the end) and ``rotation``, which grow
    together; the point of the rotation moves with the displacement."""

    supports: tuple[str, ...]
    displacement: Vector | None = None
    rotation: Turn | None = None

    def __post_init__(self):
        require_type(isinstance(self.supports, list | tuple), "supports", self.supports, "a list of names")
        assign(self, supports=tuple(check_name(f"supports[{i}]", name) for i, name in enumerate(self.supports)))
        require(len(self.supports) > 0, "supports", self.supports, "it must name a block or a group that moves")
        require_type(self.rotation is None or isinstance(self.rotation, Turn), "rotation", self.rotation, "a Turn")
        if self.displacement is not None:
            assign(self, displacement=vector("displacement", self.displacement))
        moves = self.rotation is not None or (self.displacement is not None and any(present(self.displacement)))
        if not moves:
            names = ", ".join(show(name) for name in self.supports)
            raise ScenarioError(f"supports {names}: they need a displacement or a rotation that is not zero")
