"""Strengths of joints beside friction, from their laws to the arrays of the kernels, for both engines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from dembrick.kernels.joint.point_law import Strengths
from dembrick.scenario.joint_laws import JointLaw


def has_strengths(laws: Iterable[JointLaw]) -> bool:
    """Whether any of the ``laws`` gives a joint more than friction."""
    return any(not law.dry for law in {id(law): law for law in laws}.values())  # many joints, few laws


def strengths_of(laws: Sequence[JointLaw]) -> Strengths | None:
    """Strengths of joints with these ``laws``, an entry each; None if all are dry."""
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
    """An entry of each strength for every contact point, from those of joints with so many points (s,)."""
    each = {name: np.repeat(value, counts) for name, value in strengths._asdict().items() if name != "held"}
    return strengths._replace(**each)


def sliding_strength(strengths: Strengths | None, area, friction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Force against which slip does work (N), an entry for each of ``strengths``, from N (N) and the ``area`` that
    carries it.

    What slides has no bond, and what rises by dilation takes the work of that from friction.
    """
    if strengths is None:
        return friction * normal
    return strengths.residual_cohesion * area + (strengths.residual * friction - strengths.dilation) * normal
