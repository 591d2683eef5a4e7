"""Where the contact points of a lone distributed joint stand while its limit load is searched.

The points need only be right for the torsion centre of the limit load, which nobody knows before. So the search goes
on in rounds: from points on rays from O a rough limit load gives a centre, points on rays from there give a better one,
until the gap between points and continuum is within half the tolerance all around the last centre, as far as that has
moved. Then the replay proper runs with these points. A joint that does not stay closed gets the lattice of
``quadrature`` instead, as does every joint of an assembly and every test in which the centre wanders.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import ray_quadrature
from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.quadrature import ContactPoints, contact_points
from dembrick.errors import NotConvergedError
from dembrick.simulation.statics import limit_load

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

COUNTS = ((2, 2), (3, 2), (3, 3), (4, 3), (4, 4), (5, 5))  # rays a piece of an edge, points a piece of a ray
_FEW = 3  # of them are tried while another round may still bring a better centre
_ROUGH = (1e-2, 1e-3, 1e-4, 1e-5, 0.0)  # tolerances of the rounds, as far as the one asked for is finer
_SETTLED = 3e-3  # of the polygon's size: a centre known as well as that is worth any number of points
_AROUND = 4  # directions in which the gap is looked at around the centre


def place_points(assembly: Assembly, tolerance: float, step_factor: float):
    """The assembly with its contact points placed for a limit load to ``tolerance``, and the loop seconds that took.

    Anything but a single ``distributed`` joint without ``points`` of its own comes back as it is.
    """
    if len(assembly.joints) != 1:
        return assembly, 0.0
    joint = assembly.joints[0]
    if joint.law.formulation != "distributed" or joint.law.points is not None:
        return assembly, 0.0
    pieces = joint.pieces or (joint.polygon,)
    centre, seconds = np.zeros(2), 0.0
    points = ray_quadrature.rays_over(pieces, centre, *COUNTS[0])
    for rough in _ROUGH:
        try:
            run = limit_load.find_limit_load(_with(assembly, *points), max(rough, tolerance), step_factor)
        except NotConvergedError:
            break
        seconds += run.loop_seconds
        if not (run.state.points.normal > 0.0).all():
            break
        if run.yield_point.torsion_centre is None:  # pure shear: areas add up, and no point is better than another
            return _with(assembly, *points), seconds
        last, centre = centre, np.array(run.yield_point.torsion_centre)
        opening, tilt_1, tilt_2 = run.state.joints.opening[0]
        pressure = (-opening, tilt_2, -tilt_1)
        moved = float(np.hypot(*(centre - last)))
        # V is stationary in the centre, so that a relative error of V belongs to the square root of it in the centre
        size = float(np.abs(joint.polygon).max())
        unsure = min(moved, float(np.sqrt(max(rough, tolerance))) * size)
        exact = _moments(pieces, centre, unsure, pressure)
        settled = rough <= tolerance or unsure <= _SETTLED * size
        for counts in COUNTS if settled else COUNTS[:_FEW]:
            points = ray_quadrature.rays_over(pieces, centre, *counts)
            if _worst_gap(points, pressure, exact) <= 0.5 * tolerance:
                return _with(assembly, *points), seconds
    lattice = contact_points(joint, tolerance)
    return dataclasses.replace(assembly, contact_points=PointTable.of((lattice,))), seconds


def _with(assembly: Assembly, arms, areas):
    """The assembly with these contact points."""
    return dataclasses.replace(assembly, contact_points=PointTable.of((ContactPoints(arms, arms, areas),)))


def _moments(pieces, centre, radius: float, pressure) -> list[tuple[np.ndarray, float]]:
    """Friction moments of the continuum under a linear pressure, about the centre and ``radius`` around it."""
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    ring = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return [
        (c, ray_quadrature.friction_moment(*ray_quadrature.fine_rays(pieces, c), c, pressure))
        for c in np.concatenate([centre[None], ring])
    ]


def _worst_gap(points, pressure, exact) -> float:
    """Largest relative gap between the points' friction moments and the ``exact`` ones of the continuum."""
    return max(abs(ray_quadrature.friction_moment(*points, c, pressure) / moment - 1.0) for c, moment in exact)
