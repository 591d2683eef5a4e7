"""Reactions of supports and forces of joints by limit analysis: reaction(scenario, ...) -> ReactionResult."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs.limit_cases import assembled, at_start, failure, finite
from dembrick.runs.logger import heard_by
from dembrick.runs.outcomes.result import heading
from dembrick.runs.reading import load
from dembrick.scenario.checks import listed, nearest, show
from dembrick.scenario.model import Scenario
from dembrick.simulation.limit_analysis.analysis import refuse_gap
from dembrick.simulation.limit_analysis.mechanism import names_of
from dembrick.simulation.limit_analysis.optimum import LITTLE
from dembrick.simulation.limit_analysis.reactions import Extreme, reaction_range

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

ROUNDING = 1e-8  # of the joint forces on a support: what the cone solver leaves of a zero
ACROSS = 0.05  # cosine of a direction that points neither to the blocks nor away from them


@dataclass
class ReactionResult:
    """Reaction that ``support`` exerts on the other blocks along ``direction``: its ``least`` and ``greatest`` value
    (N) over all equilibria of a ``scenario`` and its ``assembly``; ``wall``: seconds.

    ``towards``: cosine between ``direction`` and the vector from the support to the centre of the free blocks. ``on``:
    the block or group on which ``support``, of any blocks, acts through the joints between the two; None for a support.
    """

    scenario: Scenario
    assembly: assemblies.Assembly
    support: str
    direction: tuple[float, ...]
    least: Extreme
    greatest: Extreme
    wall: dict
    towards: float = 0.0
    on: str | None = None

    def __repr__(self) -> str:
        ends = f"{self.least.value:.6g} to {self.greatest.value:.6g} N"
        return f"<ReactionResult {self.scenario.title!r}: {self.support}, {ends}>"

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick limit --reaction --json``."""

        def end(extreme: Extreme) -> dict:
            return {
                "value": finite(extreme.value),
                "reached": finite(extreme.reached),
                "bound": finite(extreme.bound),
                "unlimited": math.isinf(extreme.value),
                "mechanism": None if extreme.mechanism is None else extreme.mechanism.kind,
                "blocks": names_of(self.assembly, extreme.mechanism),
            }

        return {
            **heading(self.scenario, self.assembly),
            "status": "reaction",
            "support": self.support,
            "on": self.on,
            "direction": list(self.direction),
            "least": end(self.least),
            "greatest": end(self.greatest),
            "push": self.push,
            "flow": "associative",
            "wall": self.wall,
        }

    @property
    def push(self) -> dict | None:
        """Push of the support on the other blocks: its ``least`` and ``greatest`` size (N, None if unlimited), its
        direction (``along``, (3,)), and its ``side``: "inward", towards them, "outward", away from them, or None if it
        is across; None if it may push either way, or not at all."""
        low, high = self.least.value, self.greatest.value
        if low < 0.0 < high or low == high == 0.0:
            return None
        sign = -1.0 if low < 0.0 else 1.0
        least, greatest = sorted((abs(low), abs(high)))
        facing = sign * self.towards
        side = None if abs(facing) < ACROSS else "inward" if facing > 0.0 else "outward"
        along = [sign * part + 0.0 for part in self.direction]
        return {"least": finite(least), "greatest": finite(greatest), "along": along, "side": side}

    def _push_text(self) -> str:
        """Sentence on what the signs of the two values mean."""
        push, who = self.push, "the support" if self.on is None else self.support
        whom, them = ("the other blocks", "them") if self.on is None else (self.on, "it")
        if self.least.value == self.greatest.value == 0.0:
            return f"{who} pushes {whom} neither along this direction nor against it"
        if push is None:
            return f"{who} may push {whom} along this direction (positive) or against it (negative)"
        sides = {"inward": f", inward (towards {them})", "outward": f", outward (away from {them})", None: ""}
        side = sides[push["side"]]
        most = "without limit" if push["greatest"] is None else f"at most {push['greatest']:.6g} N"
        least = "without limit" if push["least"] is None else f"at least {push['least']:.6g} N"
        return f"{who} pushes {whom} along {named(push['along'])}{side}: {least}, {most}"

    def text(self) -> str:
        """Text of the command line."""
        on = "the other blocks" if self.on is None else self.on
        what = "reaction" if self.on is None else "joint force"
        lines = [self.scenario.title, f"{what:13} of {self.support} along {self.direction} on {on}"]
        for label, end in (("least", self.least), ("greatest", self.greatest)):
            if math.isinf(end.value):
                lines.append(f"{label:13} unlimited: the blocks are locked between their supports")
                continue
            by = ""
            if (moved := end.mechanism) is not None:
                by = f", by {moved.kind} of {listed(names_of(self.assembly, moved))}"
            lines.append(f"{label:13} {end.value:.9g} N (balanced {end.reached:.9g}, bound {end.bound:.9g}){by}")
        return "\n".join([*lines, f"push          {self._push_text()}"])


def reaction(
    scenario: Scenario | str | os.PathLike,
    support: str,
    direction,
    *,
    report: Callable[[str], None] | None = None,
) -> ReactionResult:
    """Least and greatest reaction of a ``support``, a fixed block or a group, along ``direction`` under the dead loads;
    with a ``support`` A/B, force that block or group A exerts on B through the joints between them, such as the thrust
    at a springing on a pier.

    For a scenario with stages that change the geometry: before the first of these. Errors as for
    :func:`limit`.
    """
    began = time.perf_counter()
    way = np.array(direction, float)
    if way.shape != (3,) or not np.isfinite(way).all() or not way.any():
        raise ScenarioError(f"direction = {direction!r} must be three numbers, not all of them 0")
    start, remark = at_start(scenario if isinstance(scenario, Scenario) else load(scenario))
    given, assembly, built = assembled(start, began, report)
    if remark and (heard := heard_by(report)):
        heard(remark)
    asked = _asked(support, given, assembly)
    way = way / np.linalg.norm(way)
    try:
        found = reaction_range(assembly, asked.blocks, way, asked.joints)
    except NotConvergedError as error:
        error.answer = failure(given, error)
        raise
    least, greatest = map(_without_rounding, found)
    wall = {"build": built, "total": time.perf_counter() - began}
    centres = assembly.position - assembly.position[asked.blocks].mean(axis=0)
    mean = np.average(centres[asked.others], axis=0, weights=assembly.mass[asked.others])
    towards = float(way @ mean) / max(float(np.linalg.norm(mean)), np.finfo(float).tiny)
    direction = tuple(way.tolist())
    return ReactionResult(given, assembly, asked.name, direction, least, greatest, wall, towards, asked.on)


class _Asked(NamedTuple):
    """Whose force is asked for: that of the ``blocks`` (k,) on the ``others`` (m,), through ``joints`` (j,) bool or
    all; their names."""

    blocks: np.ndarray
    others: np.ndarray
    joints: np.ndarray | None
    name: str
    on: str | None


def _asked(name: str, scenario: Scenario, assembly: Assembly) -> _Asked:
    """The blocks of a support, or of A/B; names of blocks may contain a slash. ScenarioError if there are none."""
    number = {own: i for i, own in enumerate(assembly.names)}

    def members(called: str) -> np.ndarray:
        found = scenario.groups.get(called) or ((number[called],) if called in number else ())
        return np.array(found, np.int64)

    block_a, block_b = assembly.joints.block_a, assembly.joints.block_b
    sides = [name]
    if not len(members(name)):
        cuts = [i for i, letter in enumerate(name) if letter == "/"]
        pairs = [(name[:cut].strip(), name[cut + 1 :].strip()) for cut in cuts]
        sides = next(([one, on] for one, on in pairs if len(members(one)) and len(members(on))), [name])
    if len(sides) == 2:
        (one, on), (blocks, others) = sides, map(members, sides)
        joints = (np.isin(block_a, blocks) & np.isin(block_b, others)) | (
            np.isin(block_a, others) & np.isin(block_b, blocks)
        )
        if np.isin(blocks, others).any() or not joints.any():
            raise ScenarioError(f"there is no joint between {show(one)} and {show(on)}")
        return _Asked(blocks, others, joints, one, on)
    if not len(members(name)):
        raise ScenarioError(f"there is no block or group {show(name)}; {nearest(name, [*number, *scenario.groups])}")
    fixed = members(name)[assembly.fixed[members(name)]]
    if not len(fixed):
        raise ScenarioError(
            f"{show(name)} is not fixed, so it has no reaction: name a support, or two blocks or groups as A/B for the "
            "force of A on B in the joints between them"
        )
    if not (np.isin(block_a, fixed) | np.isin(block_b, fixed)).any():
        raise ScenarioError(f"no free block touches {show(name)}, so it has no reaction")
    return _Asked(fixed, np.flatnonzero(~assembly.fixed), None, name, None)


def range_along(scenario: Scenario, assembly: Assembly) -> dict:
    """``settlement.limit_analysis``: least and greatest reaction along the motion (N; None if unlimited) that
    equilibrium allows before the supports move. Raises as :func:`reaction` does."""
    (path,) = scenario.control.support_paths
    moving = np.unique([i for name in path.supports for i in scenario.members(name)])
    way = np.array(path.displacement)
    ends = reaction_range(assembly, moving, -way / np.linalg.norm(way))  # the action on the structure is opposite
    least = LITTLE * float(np.abs(assembly.dead_force[~assembly.fixed]).sum())  # guides may carry all but rounding
    for end in ends:
        if math.isfinite(end.value):
            low, high = sorted((end.reached, end.bound))
            refuse_gap(low, high, max(end.carried, least), "a reaction")
    return {name: finite(end.value) for name, end in zip(("least", "greatest"), ends, strict=True)}


def named(direction: Sequence[float]) -> str:
    """Text for a direction: its axis, such as -x, or its three components."""
    for axis, name in enumerate("xyz"):
        if abs(direction[axis]) == 1.0:
            return f"{'-' if direction[axis] < 0.0 else '+'}{name}"
    return f"({', '.join(f'{part:.4g}' for part in direction)})"


def _without_rounding(end: Extreme) -> Extreme:
    """``end`` with values set to zero if they are rounding errors relative to the forces that its support carries."""
    reached, bound = (0.0 if abs(value) <= ROUNDING * end.carried else value for value in (end.reached, end.bound))
    return replace(end, reached=reached, bound=bound)
