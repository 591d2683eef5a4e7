"""Strengths of the joints of an assembly, of contact points and of area joints, in newtons.

A contact point (area A_i) carries -f_t A_i <= N_i <= f_c A_i and |t_i| <= c A_i + mu N_i. An area joint, ``convex``
with ``full`` pressure, carries a no-tension pressure for N, M_1 and M_2, of at most f_c if it crushes, and
(V_1, V_2, M_T) inside the limit surface of its polygon, scaled by c A + mu N. These sets are convex, which is all that
the theorems of limit analysis require. Those of ``effective`` and ``linear`` pressure are not: their friction depends
on the pressed part, and a mixture of two states of pressure may not attain the mixture of their frictions. The smallest
convex set around them is that of points at the corners of the polygon: a linear pressure may shrink to any corner, and
points at the corners together carry all that a point inside can (mu |v + w x r| is convex along the
joint, so it is greatest at a corner). They are bounded by ``concave`` points, to which ``distributed`` points tend
as they fill the polygon up to its rim.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dembrick.assembly.contact_points import PointTable, place_points
from dembrick.assembly.joints import JointTable
from dembrick.geometry import friction_integrals, polygons

_ANY = 1e-3  # tolerance of a quadrature that is not used


@dataclass(frozen=True)
class Material:
    """Strengths of every joint (j,): ``friction``; ``cohesion``, ``tension`` and ``crushing`` in Pa, the last one
    infinite if nothing crushes."""

    friction: np.ndarray
    cohesion: np.ndarray
    tension: np.ndarray
    crushing: np.ndarray

    @staticmethod
    def of(joints: JointTable) -> Material:
        """Initial strengths of the joints' laws, before any slip or opening."""
        laws = joints.law
        return Material(
            friction=np.array([law.friction for law in laws], float),
            cohesion=np.array([law.cohesion for law in laws], float),
            tension=np.array([law.tensile_strength for law in laws], float),
            crushing=np.array([np.inf if (f_c := law.compressive_strength) is None else f_c for law in laws], float),
        )

    def scaled(self, factor: float) -> Material:
        """The same friction, and all other strengths times ``factor``."""
        return replace(
            self,
            cohesion=factor * self.cohesion,
            tension=factor * self.tension,
            crushing=factor * self.crushing,
        )

    @property
    def dry(self) -> bool:
        """Whether there is only friction, so that strengths are proportional to forces."""
        return not (self.cohesion.any() or self.tension.any() or np.isfinite(self.crushing).any())


@dataclass(frozen=True)
class Points:
    """Contact points: ``joint`` (p,), ``normal_arm`` and ``shear_arm`` (p, 2) from O in the joint's axes (m),
    ``friction``, and in N ``adhesion`` c A_i, ``tension`` f_t A_i, ``crushing`` f_c A_i (p,)."""

    joint: np.ndarray
    normal_arm: np.ndarray
    shear_arm: np.ndarray
    area: np.ndarray
    friction: np.ndarray
    adhesion: np.ndarray
    tension: np.ndarray
    crushing: np.ndarray


@dataclass(frozen=True)
class Areas:
    """Area joints: ``joint`` (a,); corners ``corner`` (v, 2) from O in the joint's axes (m), ``start`` (a + 1,) each;
    ``area``; ``radius`` the torsion strength over V_0 and ``gyration`` the root mean square distance from O (a,) in m;
    ``far`` (a, 42), see `friction_integrals.far_moments`; the strengths as for `Points`, of the whole area."""

    joint: np.ndarray
    corner: np.ndarray
    start: np.ndarray
    area: np.ndarray
    radius: np.ndarray
    gyration: np.ndarray
    second: np.ndarray
    far: np.ndarray
    friction: np.ndarray
    adhesion: np.ndarray
    tension: np.ndarray
    crushing: np.ndarray

    def __len__(self) -> int:
        return len(self.joint)

    @property
    def crushes(self) -> np.ndarray:
        """The area joints (c,) that have a compressive strength."""
        return np.flatnonzero(np.isfinite(self.crushing))

    @property
    def owner(self) -> np.ndarray:
        """The area joint of every corner (v,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))


def bounded_by_corners(joints: JointTable) -> np.ndarray:
    """Which joints (j,) have a set of forces that is not convex, and are replaced by points at their corners."""
    return np.array([law.formulation == "convex" and law.pressure != "full" for law in joints.law], bool)


def corner_points(joints: JointTable, chosen: np.ndarray, other: PointTable) -> tuple[JointTable, PointTable]:
    """The joints, with the law ``concave`` for those ``chosen`` (j,), and the contact points of all; ``other``: those
    of the rest."""
    if not chosen.any():
        return joints, other
    law = tuple(
        replace(given, formulation="concave", pressure="full", points=None) if at_corners else given
        for given, at_corners in zip(joints.law, chosen.tolist(), strict=True)
    )
    joints = replace(joints, law=law)
    if chosen.all():
        return joints, place_points(joints, _ANY)
    alone = place_points(replace(joints, law=tuple(replace(one, formulation="concave", pressure="full", points=None)
                                                   for one in law)), _ANY)  # fmt: skip
    return joints, PointTable.of([alone[j] if chosen[j] else other[j] for j in range(len(joints))])


def point_strengths(table: PointTable, material: Material) -> Points:
    """The contact points of all joints that have points."""
    joint = np.repeat(np.arange(len(table)), np.diff(table.start))
    return Points(
        joint=joint,
        normal_arm=np.asarray(table.normal_arm, float),
        shear_arm=np.asarray(table.shear_arm, float),
        area=np.asarray(table.area, float),
        friction=material.friction[joint],
        adhesion=material.cohesion[joint] * table.area,
        tension=material.tension[joint] * table.area,
        crushing=material.crushing[joint] * table.area,
    )


def area_strengths(joints: JointTable, table: PointTable, material: Material) -> Areas:
    """The area joints, which have a resultant in place of points."""
    chosen = np.flatnonzero(table.resultant)
    counts = np.diff(joints.start)[chosen]
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    corner = joints.corner[np.repeat(joints.start[chosen] - start[:-1], counts) + np.arange(start[-1])]
    area, second = joints.area[chosen], np.empty((len(chosen), 3))
    radius, far = np.empty(len(chosen)), np.empty((len(chosen), 42))
    for numbers, shapes in joints.by_corners(chosen):
        some = np.searchsorted(chosen, numbers)
        second[some] = np.stack(polygons.second_moments(shapes), axis=1)
        radius[some] = friction_integrals.area_radius(shapes)
        far[some] = friction_integrals.far_moments(shapes)
    return Areas(
        joint=chosen,
        corner=corner,
        start=start,
        area=area,
        radius=radius,
        gyration=np.sqrt((second[:, 0] + second[:, 1]) / area) if len(chosen) else np.zeros(0),
        second=second,
        far=far,
        friction=material.friction[chosen],
        adhesion=material.cohesion[chosen] * area,
        tension=material.tension[chosen] * area,
        crushing=material.crushing[chosen] * area,
    )
