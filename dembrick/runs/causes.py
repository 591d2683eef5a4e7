"""Causes of cracks: which support has moved, and how, judged by the joints that are seen to be open.

A study asks for it by a table::

    title = "Which springing has moved?"
    base  = "arch.toml"                                     # the structure; its control plays no part

    [target]
    open     = [["arch.3", "arch.4"], ["arch.10", "arch.11"]]
    closed   = [["arch.right", "arch.20"]]                  # all other joints, if not given
    supports = ["arch.left", "arch.right"]                  # that may have moved: all, if not given
    displacement = { block = "arch.10", value = [0.0, 0.0, -0.01] }   # m, if observed
    doubt    = 0.05                                         # probability that a joint is observed wrongly

When a support yields a little, the reaction along its motion falls to the least that equilibrium allows, and the blocks
move in the mechanism dual to it (`limit_analysis.reactions.first_motion`): its joints open, the others stay closed.
Each support is moved by itself, along and about every axis and two of these at once (three in a plane of symmetry), and
every motion is scored by the joints: hits, misses (observed open, here closed) and false alarms.

If each joint is observed wrongly with a probability p, independently, a motion with m misses and false alarms is
((1 - p) / p)^m times less likely than one without; the confidence in a cause is its share of the likelihood of all
motions. Motions that open the same joints cannot be distinguished, and are one cause.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.history.files import write_whole
from dembrick.runs.limit import assembled
from dembrick.runs.simulate import simulate
from dembrick.runs.study.target import Target, read
from dembrick.scenario.checks import listed, nearest, show
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.model import Output
from dembrick.scenario.time_functions import Turn
from dembrick.simulation.limit_analysis.mechanism import joint_motions

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.model import Scenario
    from dembrick.simulation.limit_analysis.analysis import Standing
    from dembrick.simulation.limit_analysis.programme import Structure

OPENS = 0.02  # of the greatest opening: a joint that opens by less is closed
BLURRED = 4.0  # factor above and below that, within which a joint may be seen open or closed
SCATTER = 0.2  # of an observed displacement: standard deviation of the misfit of a motion
FOLLOWED = 2e-3  # of the structure's size: the motion of a support that is followed through equilibria
LIKELY = 0.1  # times as likely as the best: a likely cause
PLAIN = 1.0 / 3.0  # times as likely as the best that opens the same joints: a plainer motion comes before it
SHOWN = 3  # causes that are printed and drawn
_AXES = ("x", "y", "z")
COLUMNS = ("cause", "share", "weight", "hits", "misses", "false_alarms", "support", *_AXES, "rx", "ry", "rz", "amount")


class Motion(NamedTuple):
    """A motion of a ``support``: ``velocity`` (6,) of its centroid and rotation (1/m), and ``amount`` (m), the
    factor that fits an observed displacement (None without one)."""

    support: str
    velocity: np.ndarray
    amount: float | None

    def said(self) -> str:
        """The motion in words."""
        v, w = self.velocity[:3], self.velocity[3:]
        parts = []
        if v.any():
            way = " ".join(f"{'+' if x > 0.0 else '-'}{a}" for x, a in zip(v, _AXES, strict=True) if abs(x) > 1e-9)
            parts.append(f"moves along {way}")
        if w.any():
            way = " ".join(f"{'+' if x > 0.0 else '-'}{a}" for x, a in zip(w, _AXES, strict=True) if abs(x) > 1e-9)
            parts.append(f"turns about {way}")
        size = "" if self.amount is None else f", {1e3 * self.amount * float(np.linalg.norm(v)):.3g} mm"
        return f"{self.support} {' and '.join(parts)}{size}"

    def as_dict(self) -> dict:
        """As in the JSON output."""
        return {
            "support": self.support, "displacement": self.velocity[:3].tolist(),
            "rotation": self.velocity[3:].tolist(), "amount": self.amount,
        }  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """Motions that open the same joints. ``share``: its likelihood over that of all motions; ``weight``: likelihood of
    its best motion over the best of all; ``velocity`` (n, 6) of the blocks in its first motion, the plainest of the
    likely ones, and ``opening`` (j,) of the joints over the greatest; ``slides``: whether joints slide so far that
    their dilatancy, which stones do not have, matters."""

    motions: tuple[Motion, ...]
    share: float
    weight: float
    hits: int
    misses: tuple[str, ...]
    false_alarms: tuple[str, ...]
    velocity: np.ndarray
    opening: np.ndarray
    slides: bool

    @property
    def supports(self) -> tuple[str, ...]:
        """Supports of its motions, each once."""
        return tuple(dict.fromkeys(motion.support for motion in self.motions))

    @property
    def title(self) -> str:
        """Share and plainest motion, in a line."""
        more = f" (or {len(self.motions) - 1} similar motions)" if len(self.motions) > 1 else ""
        return f"{self.percent}: {self.motions[0].said()}{more}"

    @property
    def percent(self) -> str:
        """Its share in words."""
        return "less than 0.1 %" if self.share < 1e-3 else f"{100.0 * self.share:.3g} %"

    def as_dict(self) -> dict:
        """As in the JSON output."""
        return {
            "motions": [motion.as_dict() for motion in self.motions],
            "share": self.share,
            "weight": self.weight,
            "hits": self.hits,
            "misses": list(self.misses),
            "false_alarms": list(self.false_alarms),
            "slides": self.slides,
        }


@dataclass(frozen=True)
class Causes:
    """Answer of a study of causes for the open joints of a ``target`` on the ``assembly``: ``causes``, the likeliest
    first. ``judged`` (j,) int8: 1 for joints that are to be open, 0 closed, -1 not judged; ``tried``: number of
    motions, ``locked``: number of those without a mechanism; ``seconds``: computing time."""

    target: Target
    assembly: Assembly
    causes: tuple[Cause, ...]
    judged: np.ndarray
    tried: int
    locked: int
    seconds: float

    @property
    def likely(self) -> tuple[Cause, ...]:
        """Causes at least a tenth as likely as the best."""
        return tuple(cause for cause in self.causes if cause.weight >= LIKELY)

    @property
    def ambiguous(self) -> bool:
        """Whether the likely causes involve more than one support."""
        return len({name for cause in self.likely for name in cause.supports}) > 1

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick sweep --json``."""
        return {
            "title": self.target.title,
            "tried": self.tried,
            "locked": self.locked,
            "ambiguous": self.ambiguous,
            "causes": [cause.as_dict() for cause in self.causes],
            "wall": self.seconds,
        }

    def write(self, path: str | os.PathLike) -> None:
        """Write a CSV table with a line for each motion of each cause, the likeliest cause first."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(COLUMNS)
        for rank, cause in enumerate(self.causes, 1):
            numbers = [f"{cause.share:.6g}", f"{cause.weight:.6g}"]
            counts = [cause.hits, len(cause.misses), len(cause.false_alarms)]
            for motion in cause.motions:
                way = [f"{x:.6g}" for x in motion.velocity]
                amount = "" if motion.amount is None else f"{motion.amount:.6g}"
                table.writerow([rank, *numbers, *counts, motion.support, *way, amount])
        write_whole(path, text.getvalue(), "table")

    def text(self) -> str:
        """Text of the command line."""
        seen = int((self.judged == 1).sum())
        lines = [
            self.target.title,
            f"tried         {self.tried} motions of supports, {self.locked} of them locked; {self.seconds:.3g} s",
        ]
        for rank, cause in enumerate(self.causes[:SHOWN], 1):
            lines.append(f"cause {rank}       {cause.percent} of the likelihood: {cause.motions[0].said()}")
            wrong = [f"{name} stays closed" for name in cause.misses] + [f"{n} opens" for n in cause.false_alarms]
            lines.append(
                f"  joints      {cause.hits} of {seen} open" + (f"; {listed(wrong)}" if wrong else ", no other")
            )
            if len(cause.motions) > 1:
                others = listed([motion.said() for motion in cause.motions[1:]])
                lines.append(f"  or          {others}: the same joints open")
        if self.ambiguous:
            names = list(dict.fromkeys(name for cause in self.likely for name in cause.supports))
            lines.append(
                f"ambiguous     the target does not distinguish {' from '.join(names)}: observe more joints or blocks"
            )
        if any(cause.slides for cause in self.likely):
            lines.append(
                "slides        joints slide in likely causes, and limit analysis lets them dilate, which may open "
                "others: set target.paths = true to follow the motions"
            )
        if self.causes and (self.causes[0].misses or self.causes[0].false_alarms):
            lines.append("unexplained   no motion of one support opens exactly these joints")
        return "\n".join(lines)


def find(target: Target | str | os.PathLike, *, report: Callable[[str], None] | None = None) -> Causes:
    """Score every motion of a support by the joints that it opens; return `Causes`, the likeliest first.

    Raises ScenarioError for a target that names no joint or contradicts itself, and if no support can move;
    NotConvergedError if the structure does not stand; MissingDependency without the extra ``limit``.
    """
    from dembrick.simulation.limit_analysis.analysis import falls, prepared, standing

    target = target if isinstance(target, Target) else read(target)
    began = perf_counter()
    _, assembly, _ = assembled(target.scenario, began, report)
    judged = _judged(target, assembly)
    supports = _supports(target, assembly)
    block, seen = _watched(target, assembly)
    structure = prepared(assembly, along=() if seen is None else (seen,))
    follow = partial(_followed, target.scenario, assembly) if target.paths else partial(_by_limit_analysis, structure)
    stands = standing(structure)
    if not stands.stands:
        raise falls(assembly, stands)
    patterns: dict[bytes, list] = {}
    tried = locked = 0
    for support in supports:
        for velocity in _motions(structure, support):
            tried += 1
            followed = follow(stands, support, velocity)
            if followed is None:
                locked += 1
                continue
            moved, opening, slides = followed
            opens = opening > OPENS
            weight, amount = _agreement(opening, judged, target.doubt), None
            if seen is not None:
                amount, misfit = _amount(moved[block, :3], seen)
                if amount is None:
                    continue
                weight -= 0.5 * (misfit / SCATTER) ** 2
            motion = Motion(assembly.names[support], velocity, amount)
            patterns.setdefault(opens.tobytes(), []).append((weight, motion, moved, opening, slides))
    return Causes(target, assembly, _ranked(patterns, judged, assembly), judged, tried, locked, perf_counter() - began)


def _judged(target: Target, assembly: Assembly) -> np.ndarray:
    """1 for joints that are to be open, 0 for those that are to be closed, -1 for the rest (j,)."""
    joints, names = assembly.joints, list(assembly.names)
    between: dict[frozenset, list[int]] = {}
    for j, (a, b) in enumerate(zip(joints.block_a.tolist(), joints.block_b.tolist(), strict=True)):
        between.setdefault(frozenset((names[a], names[b])), []).append(j)
    judged = np.full(len(joints), 0 if target.closed is None else -1, np.int8)
    for pairs, value, key in ((target.closed or (), 0, "closed"), (target.open, 1, "open")):
        for pair in pairs:
            for name in pair:
                if name not in names:
                    raise ScenarioError(f"target.{key}: there is no block {show(name)}; {nearest(name, names)}")
            if frozenset(pair) not in between:
                raise ScenarioError(f"target.{key}: no joint lies between {show(pair[0])} and {show(pair[1])}")
            judged[between[frozenset(pair)]] = value
    both = {frozenset(pair) for pair in target.open} & {frozenset(pair) for pair in target.closed or ()}
    if both:
        raise ScenarioError(f"[target]: the joint between {' and '.join(sorted(both.pop()))} is both open and closed")
    return judged


def _supports(target: Target, assembly: Assembly) -> list[int]:
    """The fixed blocks that may have moved: those that a free block touches."""
    joints, names = assembly.joints, list(assembly.names)
    touching = set(joints.block_a.tolist()) | set(joints.block_b.tolist())
    able = [i for i in sorted(touching) if assembly.fixed[i]]
    for name in target.supports:
        if name not in names:
            raise ScenarioError(f"target.supports: there is no block {show(name)}; {nearest(name, names)}")
        if names.index(name) not in able:
            raise ScenarioError(f"target.supports: {show(name)} is not a support: fix it and let a free block touch it")
    chosen = [i for i in able if not target.supports or names[i] in target.supports]
    if len(able) < 2:
        raise ScenarioError("no support can have moved against another: the structure has only one; model its parts")
    return chosen


def _watched(target: Target, assembly: Assembly) -> tuple[int, np.ndarray | None]:
    """The block whose displacement was observed (-1 without one), and the displacement (3,) in m."""
    if target.seen is None:
        return -1, None
    name, value = target.seen
    if name not in assembly.names:
        raise ScenarioError(
            f"target.displacement: there is no block {show(name)}; {nearest(name, list(assembly.names))}"
        )
    return list(assembly.names).index(name), value


def _motions(structure: Structure, support: int) -> list[np.ndarray]:
    """Motions (6,) of a support to try: along and about each axis, both ways, and combinations of these: of all three
    in a plane, of two in space. A turn moves the farthest corner of the support's joints as far as a shift does."""
    frame, joints = structure.frame, structure.assembly.joints
    own = (joints.block_a == support) | (joints.block_b == support)
    size = float(np.linalg.norm(joints.origin[own] - structure.assembly.position[support], axis=1).max(initial=0.0))
    size += max(float(np.abs(joints[j].polygon).max()) for j in np.flatnonzero(own))
    shifts = [np.concatenate([way, np.zeros(3)]) for way in frame.forces]
    axes = [*shifts, *(np.concatenate([np.zeros(3), way / size]) for way in frame.moments)]
    most = len(axes) if len(axes) == 3 else 2
    motions = []
    for signs in itertools.product((-1.0, 0.0, 1.0), repeat=len(axes)):
        count = np.count_nonzero(signs)
        if 0 < count <= most:
            motions.append(np.array(signs) @ np.array(axes) / math.sqrt(count))
    return sorted(motions, key=lambda motion: (np.count_nonzero(motion), motion[3:].any()))


def _by_limit_analysis(
    structure: Structure, stands: Standing, support: int, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Velocities (n, 6) of all blocks as a support begins to move, the openings (j,) of joints, and whether these rise
    by sliding; None if locked."""
    from dembrick.simulation.limit_analysis.reactions import first_motion

    mechanism = first_motion(structure, stands, support, velocity)
    return None if mechanism is None else (mechanism.velocity, *_opening(structure.assembly, mechanism.relative))


def _followed(
    scenario: Scenario, assembly: Assembly, _: Standing, support: int, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """As `_by_limit_analysis`, by a path of equilibria in the deformed geometry over a small part of the structure's
    size; None if the structure collapses on the path or finds no equilibrium."""
    amount = FOLLOWED * float(np.ptp(assembly.position, axis=0).max())
    v, w = amount * velocity[:3], amount * velocity[3:]
    size = float(np.linalg.norm(w))
    control = SettlementControl(
        (assembly.names[support],),
        tuple(v.tolist()) if v.any() else None,
        Turn(tuple((w / size).tolist()), math.degrees(size)) if size else None,
    )
    try:
        given = replace(scenario, control=control, output=Output(("frames",)))
        result = simulate(given, progress=False)
    except NotConvergedError:
        return None
    if result.collapse is not None:
        return None
    moved = np.zeros((len(assembly.names), 6))
    moved[:, :3] = np.asarray(result.frames["displacement"][-1])
    turn = rotation_matrix(result.frames["orientation"][-1]) @ np.swapaxes(assembly.rotation, 1, 2)
    skew = 0.5 * (turn - np.swapaxes(turn, 1, 2))  # rotation vector of small turns
    moved[:, 3:] = skew[:, [2, 0, 1], [1, 2, 0]]
    moved /= amount
    return moved, *_opening(assembly, joint_motions(assembly, moved), slides=False)


def _opening(assembly: Assembly, relative: np.ndarray, slides: bool = True) -> tuple[np.ndarray, bool]:
    """Opening (j,) of each joint at its widest corner over the widest of all, for motions (j, 6) as in `Mechanism`;
    and whether any joint dilates by sliding as far as would count as an opening.

    In limit analysis joints dilate by friction times slip, which stones do not: that is subtracted if ``slides``.
    """
    joints = assembly.joints
    friction = np.array([law.friction if slides else 0.0 for law in joints.law])
    widest, risen = np.zeros(len(joints)), 0.0
    for numbers, outlines in joints.by_corners():
        d1, d2, dn, r1, r2, rn = relative[numbers].T[:, :, None]
        x, y = outlines[:, :, 0], outlines[:, :, 1]
        rise = friction[numbers][:, None] * np.hypot(d1 - rn * y, d2 + rn * x)
        risen = max(risen, float(rise.max(initial=0.0)))
        widest[numbers] = (dn + r1 * y - r2 * x - rise).max(axis=1)
    most = float(widest.max(initial=0.0))
    return widest / most if most > 0.0 else widest, risen > OPENS * most


def _agreement(opening: np.ndarray, judged: np.ndarray, doubt: float) -> float:
    """Log-likelihood of seeing the joints as ``judged`` (j,) if they open as in a mechanism: one that opens by much
    less than `OPENS` is seen open with probability ``doubt``, one that opens by much more with 1 - doubt."""
    far = np.log(np.maximum(opening, 1e-300) / OPENS) / math.log(BLURRED)
    seen_open = doubt + (1.0 - 2.0 * doubt) * np.clip(0.5 + 0.5 * far, 0.0, 1.0)
    return float(np.log(seen_open[judged == 1]).sum() + np.log(1.0 - seen_open[judged == 0]).sum())


def _amount(moved: np.ndarray, seen: np.ndarray) -> tuple[float | None, float]:
    """Amount (m) of a support's motion that best fits the displacement ``seen`` (3,) of a block, if a unit of it moves
    the block by ``moved`` (3,), and the relative misfit; None if it moves the block the other way."""
    square = float(moved @ moved)
    amount = float(moved @ seen) / square if square > 0.0 else 0.0
    if amount <= 0.0:
        return None, math.inf
    return amount, float(np.linalg.norm(seen - amount * moved) / np.linalg.norm(seen))


def _ranked(patterns: dict[bytes, list], judged: np.ndarray, assembly: Assembly) -> tuple[Cause, ...]:
    """The causes in order of likelihood, each of all motions that open the same joints."""
    if not patterns:
        return ()
    top = max(weight for found in patterns.values() for weight, *_ in found)
    total = sum(math.exp(weight - top) for found in patterns.values() for weight, *_ in found)
    names, joints = assembly.names, assembly.joints
    causes = []
    for found in patterns.values():
        weight = max(one[0] for one in found)
        found.sort(key=lambda one: (one[0] < weight + math.log(PLAIN), *_plain(one[1].velocity, assembly.gravity)))
        _, _, velocity, opening, slides = found[0]
        opens = opening > OPENS

        def of(chosen: np.ndarray) -> tuple[str, ...]:
            pairs = zip(joints.block_a[chosen].tolist(), joints.block_b[chosen].tolist(), strict=True)
            return tuple(f"{names[a]} / {names[b]}" for a, b in pairs)

        causes.append(
            Cause(
                motions=tuple(motion for _, motion, *_ in found),
                share=sum(math.exp(one[0] - top) for one in found) / total,
                weight=math.exp(weight - top),
                hits=int((opens & (judged == 1)).sum()),
                misses=of(~opens & (judged == 1)),
                false_alarms=of(opens & (judged == 0)),
                velocity=velocity,
                opening=opening,
                slides=slides,
            )
        )
    return tuple(sorted(causes, key=lambda cause: (-cause.weight, -cause.share)))


def _plain(velocity: np.ndarray, gravity) -> tuple:
    """Sort key of equally likely motions: along an axis before turns and combinations, down before up."""
    return np.count_nonzero(velocity), bool(velocity[3:].any()), -float(np.asarray(gravity) @ velocity[:3])


find_causes = find  # its name at the top of the package
