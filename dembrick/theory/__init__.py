"""Closed forms and limit analysis, used to check the simulation and independent of it: the simulation imports none.

Conventions: joint axes (t1, t2, n) about the joint's centroid O; forces (V_1, V_2) and torsion M_T act on the block on
the +n side, M_T positive counter-clockwise; a force (f1, f2) at eccentricity (e1, e2) has m = f2 e1 - f1 e2.
"""

from dembrick.theory.approximations import (
    approximate_domain,
    interaction_curve,
    surface_along,
    torsion_strength,
)
from dembrick.theory.formulations import (
    Formulation,
    formulation_law,
    point_formulation,
    polygon_formulation,
    rectangle_formulation,
)
from dembrick.theory.limit_load import gauge, limit_load, limit_loads
from dembrick.theory.limit_surface import Law, convex, linear_pressure, points
from dembrick.theory.overturning import closed_until, limit_load_at_height, overturning_load
from dembrick.theory.response_spectrum import response_spectrum

__all__ = [
    "Formulation",
    "Law",
    "approximate_domain",
    "closed_until",
    "convex",
    "formulation_law",
    "gauge",
    "interaction_curve",
    "limit_load",
    "limit_load_at_height",
    "limit_loads",
    "linear_pressure",
    "overturning_load",
    "point_formulation",
    "points",
    "polygon_formulation",
    "rectangle_formulation",
    "response_spectrum",
    "surface_along",
    "torsion_strength",
]
