"""Effects that joint laws leave out of a collapse, in numbers: a law may carry more, or less, than stone would.

Each formulation simplifies a joint just where a collapse uses it. ``convex`` joints with ``full`` pressure keep the
friction and torsion strength of the whole polygon even if the resultant stands at an edge, where a linear pressure
leaves almost no torsion strength. ``corrected`` joints press at points drawn in by the factor s, and topple at that
share of the angle. ``distributed`` points stop short of the edge about which a block rocks. Each remark states the
bound of limit analysis with points at the true corners: no joint of linear pressure carries more (see
`limit_analysis.strength`). Blocks that rock on ``convex`` or ``distributed`` joints roll over a bed of springs at each
impact, and keep more of their speed than rigid blocks that strike on a corner (Housner 1963). Contacts that replace a
joint neither crush nor dilate, and do not follow a law of the user's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.contact_points import largest_edge_shortfall
from dembrick.theory.polygons import convex_hull

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

AT_EDGE = 0.95  # of the way from O to an edge: a resultant beyond it stands at the edge
ROCKS = 0.01  # rad: a greater turn is rocking, whatever the joints are
LIFTED = 20.0  # times the depth to which all weight presses a joint, over its width: a turn with a third of it pressed
_MOVES = 0.01  # of the greatest tilt or slip: a joint that moves less counts as still


@dataclass(frozen=True)
class LeftOut:
    """A remark. ``law``: formulation, or key of the law; ``joints``: numbers of the joints concerned; ``bound``: load
    factor with points at the true corners (infinite if unlimited, None if not computed); ``text``: a sentence."""

    law: str
    joints: np.ndarray
    bound: float | None
    text: str

    def as_dict(self) -> dict:
        """As in the JSON output."""
        bound = self.bound if self.bound is not None and np.isfinite(self.bound) else None
        return {"law": self.law, "joints": len(self.joints), "bound": bound, "text": self.text}


def left_out(
    assembly: Assembly,
    load_factor: float,
    resultants: np.ndarray,
    moves: np.ndarray,
    tilt: bool,
    bounded: bool = True,
) -> list[LeftOut]:
    """Remarks on effects that the laws leave out of a collapse at ``load_factor``; empty if there are none.

    ``resultants`` (j, >= 6): N, V_1, V_2, M_T, M_1, M_2 of the joints at the collapse; ``moves`` (j, 3): how far their
    rims slide, turn about the normal and tilt (m, any scale); ``tilt``: whether the factor is the tangent of a table's
    angle. ``bounded``: whether the bound is computed; it raises MissingDependency without the extra ``limit``.
    """
    joints = assembly.joints
    law = np.array([one.formulation for one in joints.law], dtype="U16")
    full = np.array([one.pressure == "full" for one in joints.law], bool)
    pressed = resultants[:, 0] > 1e-6 * resultants[:, 0].max(initial=0.0)
    slips, tilts = moves[:, :2].max(axis=1) * pressed, moves[:, 2] * pressed
    most = max(float(slips.max(initial=0.0)), float(tilts.max(initial=0.0)))
    slipping, rocking = slips > _MOVES * most, tilts > _MOVES * most
    at_edge = np.zeros(len(joints), bool)
    for j in np.flatnonzero((law == "convex") & full & slipping):
        at_edge[j] = _towards_edge(joints[j].polygon, resultants[j]) > AT_EDGE
    drawn_in, short = (law == "corrected") & rocking, (law == "distributed") & rocking
    if not (at_edge | drawn_in | short).any():
        return []
    from dembrick.simulation.limit_analysis import analysis

    bound = analysis.limit_load(assembly, corners=True, tilt=tilt).load_factor if bounded else None
    gap = largest_edge_shortfall(joints, assembly.contact_points)[0]
    told = {
        "convex": (
            at_edge,
            "slide or turn with the resultant at an edge, where full pressure keeps the torsional strength of the "
            "whole joint: with linear pressure",
        ),
        "corrected": (drawn_in, "rock about corrected points, which lie inside the edge: about the true edge"),
        "distributed": (
            short,
            f"rock about distributed points that stop {100.0 * gap:.2g} % short of the edge: about the true edge",
        ),
    }
    return [
        LeftOut(
            name, np.flatnonzero(meant), bound,
            f"{_count(int(meant.sum()))} {text} the limit is {_beside(bound, load_factor)}",
        )
        for name, (meant, text) in told.items()
        if meant.any()
    ]  # fmt: skip


def softened_impacts(assembly: Assembly, turned: np.ndarray) -> list[LeftOut]:
    """Remarks on impacts of blocks that rocked on beds of springs; empty if none did.

    ``turned`` (n,) rad: the greatest turn of each block in a run in real time.
    """
    joints = assembly.joints
    a, b = (np.array([getattr(joint, side) for joint in joints], np.int64) for side in ("block_a", "block_b"))
    weight = np.linalg.norm(assembly.dead_force[~np.asarray(assembly.fixed)], axis=1).sum()
    area, k_n = np.asarray(joints.area, float), np.array([one.normal_stiffness for one in joints.law], float)
    rocks = np.minimum(ROCKS, LIFTED * weight / (k_n * area * np.sqrt(area)))
    rocked = np.maximum(turned[a], turned[b]) > rocks
    law = np.array([one.formulation for one in joints.law], dtype="U16")
    found = []
    for name in ("convex", "distributed"):
        meant = np.flatnonzero(rocked & (law == name))
        if len(meant):
            text = (
                f"{_count(len(meant))} may rock on a bed of springs, which dissipates less at an impact than rigid "
                "blocks that strike on a corner (Housner): concave joints dissipate as much"
            )
            found.append(LeftOut(name, meant, None, text))
    return found


def replaced_joints(assembly: Assembly, joints: np.ndarray) -> list[LeftOut]:
    """Remarks on ``joints`` (j,), a mask, replaced by contacts that leave out a part of the joint law; empty without
    any."""
    laws = assembly.joints.law
    leave = {
        "compressive_strength": ([one.compressive_strength is not None for one in laws], "do not crush"),
        "dilation": ([one.dilation > 0.0 for one in laws], "do not dilate"),
        "custom_law": ([assembly.custom_law is not None] * len(laws), "have plain friction only"),
    }
    meant = {name: (np.flatnonzero(joints & np.array(own, bool)), what) for name, (own, what) in leave.items()}
    why = "passed to contacts, by large slip, rotation or opening or by an impact at the start; contacts"
    return [
        LeftOut(name, own, None, f"{_count(len(own))} {why} {what}") for name, (own, what) in meant.items() if len(own)
    ]


def _beside(bound: float | None, load_factor: float) -> str:
    if bound is None:
        return "different; dembrick limit gives its bounds"
    if not np.isfinite(bound):
        return "not bounded"
    over = f", {100.0 * (bound / load_factor - 1.0):+.2g} %" if load_factor > 0.0 else ""
    return f"at most {bound:.5g}{over}"


def _count(joints: int) -> str:
    return "1 joint" if joints == 1 else f"{joints} joints"


def _towards_edge(polygon: np.ndarray, resultant: np.ndarray) -> float:
    """Position of a joint's centre of pressure from O (0) to its nearest edge (1). For a joint of several pieces, the
    edges about which a block can rock count."""
    centre = np.array([resultant[5], -resultant[4]]) / resultant[0]
    hull = convex_hull(polygon)
    edge = np.roll(hull, -1, axis=0) - hull
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    return float((outward @ centre / (hull * outward).sum(axis=1)).max())
