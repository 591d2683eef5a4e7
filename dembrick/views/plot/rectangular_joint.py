"""Rectangular joints with the loads of points of their yield domains, and the domains under such loads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick import theory
from dembrick.errors import ScenarioError
from dembrick.views.plot.paths import ALONG, direction_in_words

if TYPE_CHECKING:
    from dembrick.theory.approximations import InteractionCurve

SAME = 1e-3  # relative difference of data of two joints, or of strengths, below which they count as equal
_PURE = 1e-6  # of the strength: a smaller shear force or torsion counts as zero


class RectangularJoint(NamedTuple):
    """Joint for which a domain is drawn: edges ``a`` and ``b`` along t1 and t2 (m), friction, normal force (N),
    cohesion (Pa), ``direction`` of the shear force in t1, t2 for positive torsion, ``eccentricity`` of N in t1, t2 from
    the middle (m), and ``pressure`` of the convex formulation."""

    a: float
    b: float
    friction: float
    normal_force: float
    cohesion: float = 0.0
    direction: tuple[float, float] = (0.0, 1.0)
    eccentricity: tuple[float, float] = (0.0, 0.0)
    pressure: str = "full"

    @property
    def centred(self) -> bool:
        """Whether N acts in the middle."""
        return math.hypot(*self.eccentricity) <= SAME * max(self.a, self.b)

    @property
    def pressed_at(self) -> str:
        """Point where N acts, in words; empty if it is the middle."""
        x, y = (1e3 * own for own in self.eccentricity)
        return "" if self.centred else f" at ({x:.3g}, {y:.3g}) mm"

    @property
    def sheared(self) -> str:
        """The line along which the shear force acts, in words."""
        back = self.direction[0] < -ALONG or (abs(self.direction[0]) <= ALONG and self.direction[1] < 0.0)
        return direction_in_words([-part for part in self.direction] if back else self.direction)

    @property
    def strength(self) -> float:
        """V_0 (N)."""
        return self.cohesion * self.a * self.b + self.friction * self.normal_force


@lru_cache(maxsize=64)
def domain_curve(formulation: str, joint: RectangularJoint) -> InteractionCurve:
    """The domain of a formulation; for ``distributed`` that of the whole area, the limit of infinitely many points."""
    name, pressure = ("convex", "linear") if formulation == "distributed" else (formulation, joint.pressure)
    centre = None if joint.centred else joint.eccentricity
    if joint.centred or name != "convex":
        pressure = "full"
    return theory.interaction_curve(name, *joint[:5], direction=joint.direction, centre=centre, pressure=pressure)


def domain_curves(formulations: Sequence[str], joint: RectangularJoint) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """V and M_T of the domain of each formulation, by its name, with its pressure if that is not the paper's."""
    found = {}
    for name in formulations:
        curve = domain_curve(name, joint)
        follows = name == "convex" and joint.pressure != "full" and not joint.centred
        found[f"{name}, {joint.pressure} pressure" if follows else name] = curve.V, curve.M_T
    return found


def shown(formulations: Sequence[str], rows: Sequence[Mapping], joint: RectangularJoint) -> list[str]:
    """The formulations whose domains are drawn. Under eccentric N all domains differ, so those of the drawn points are
    added, and formulations whose contact points lie so far inwards that N would tip the block are left out."""
    if joint.centred:
        return list(formulations)
    own, found = [row["formulation"] for row in rows], []
    for name in dict.fromkeys([*formulations, *own]):
        try:
            domain_curve(name, joint)
        except ScenarioError:
            if name in own:
                raise
        else:
            found.append(name)
    return found


def shear_of(row: Mapping) -> float:
    """The shear force (N) of a point."""
    return math.hypot(row["V_1"], row["V_2"])


def under_points(joint: RectangularJoint, rows: Sequence[Mapping]) -> RectangularJoint:
    """The joint under the load of the first point that has a shear force and a torsion, else of the first one."""
    return under(joint, max(rows, key=lambda row: all(_parts(joint, row))), joint)


def under(joint: RectangularJoint, row: Mapping, like: RectangularJoint) -> RectangularJoint:
    """The joint under the load of a point. Torsion is made positive, since a limit surface is symmetric under reversal
    of all forces. Data that a point without shear force or torsion leaves open are those of the joint ``like``."""
    sheared, twisted = _parts(joint, row)
    direction = like.direction
    if sheared:
        own = np.array([row["V_1"], row["V_2"]]) / shear_of(row)
        if row["M_T"] < 0.0 if twisted else own @ direction < 0.0:
            own = -own
        direction = float(own[0]), float(own[1])
    pressure = row.get("pressure") or "full" if row["formulation"] == "convex" else like.pressure
    found = joint._replace(direction=direction, eccentricity=tuple(row.get("eccentricity") or (0.0, 0.0)))
    if found.centred:
        return found._replace(eccentricity=(0.0, 0.0), pressure="full")
    return found._replace(pressure=pressure)


def _parts(joint: RectangularJoint, row: Mapping) -> tuple[bool, bool]:
    """Whether a point has a shear force, and a torsion."""
    least = _PURE * joint.strength
    return shear_of(row) > least, abs(row["M_T"]) > least * max(joint.a, joint.b)


def require_one_curve(rows: Sequence[Mapping], joint: RectangularJoint, formulations: Sequence[str]) -> None:
    """ScenarioError if points belong to other curves than those of the joint, because their shear force or N acts
    elsewhere, or to unknown ones: an intact bond can be in tension, which changes the stress under eccentric N."""
    for row in rows:
        own = under(joint, row, joint)
        named = row.get("history") or "a point"
        if not own.centred and (row.get("brittle") or (row["formulation"] == "distributed" and own.cohesion > 0.0)):
            raise ScenarioError(
                f"{named}: the domain of a bonded joint under N{own.pressed_at} is not drawn here; use --kind path"
            )
        if own[5:] != joint[5:] and not _alike(own, joint, shown(formulations, [row], own)):
            raise ScenarioError(
                f"{named} belongs to another yield domain than the others: its V acts {own.sheared} and its N"
                f"{own.pressed_at or ' in the middle'}, theirs {joint.sheared} and"
                f"{joint.pressed_at or ' in the middle'}; draw each by itself, or all with --kind path"
            )


def _alike(one: RectangularJoint, other: RectangularJoint, formulations: Sequence[str]) -> bool:
    """Whether two loads of a joint have the same domains, as mirror images do."""
    try:
        curves = [domain_curves(formulations, joint) for joint in (one, other)]
    except ScenarioError:  # the other N would tip it over
        return False
    strengths = one.strength * np.array([[1.0], [max(one.a, one.b)]])
    pairs = zip(*(curve.values() for curve in curves), strict=True)
    return all(np.allclose(a / strengths, b / strengths, rtol=0.0, atol=SAME) for a, b in pairs)


def torsion_strength(formulation: str, joint: RectangularJoint) -> float:
    """M_T0 (N m); for ``distributed`` that of the whole area, the limit of infinitely many points."""
    return domain_curve(formulation, joint).M_T0


def same_shape(formulations: Sequence[str], joint: RectangularJoint) -> list[list[str]]:
    """Groups of formulations with the same non-dimensional curve: with centred N, moving the contact points inwards
    scales M_T and M_T0 alike."""
    if not joint.centred:
        return [[name] for name in formulations]
    alike = [name for name in formulations if name in ("concave", "corrected", "corrected-shear")]
    groups: list[list[str]] = []
    for name in formulations:
        if name not in alike:
            groups.append([name])
        elif name == alike[0]:
            groups.append(alike)
    return groups
