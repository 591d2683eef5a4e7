"""The limit load of an assembly by following its equilibrium: no inertia, no waiting.

An assembly stores much elastic displacement before anything gives way, a tower more than its joints do by orders of
magnitude, and what has given way must be steered by the small forces that are left. So each step asks for the next
equilibrium outright: the driven displacement is given, the motion of all blocks and V are found by Newton's method on
the laws themselves, implicit in the friction (backward Euler), in the geometry of the start. While everything is
elastic a step is exact; once a mechanism moves, V is that of the mechanism for steps of any length, and they are
doubled until the memory of the elastic forces, and the strip of a convex joint that rocks, have become nothing.

Where blocks snap from one state into another, no further equilibrium lies near. Then they are let go: with a part of
the elastic stiffness as a drag at each joint they drift to where they come to rest, the driven displacement held.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dembrick.elastic import Factor
from dembrick.errors import ScenarioError
from dembrick.kernels.bracket import MISSING, NEVER, STILL, Certificate, instant_bounds
from dembrick.kernels.energy import ELASTIC, EXTERNAL, FRICTION, elastic_energy
from dembrick.kernels.record import write_row
from dembrick.kernels.tangent import Trial, newton_directions, remember, try_motion
from dembrick.recorder import Recorder
from dembrick.simulation import State, joint_stiffness, to_joint
from dembrick.yield_point import joint_reach

ELASTIC_STEPS = 16  # to the limit load, as far as that can be guessed
MOST_EQUILIBRIA = 400
MOST_ITERATIONS = 20  # of Newton's method for one of them
EASY, HARD = 6, 12  # iterations up to which a step may grow, from which it shrinks
GROWTH = 2.0  # of an easy step
SHRINKING = 0.5  # of a step that finds no equilibrium
SHORTEST = 1e-6  # of what the blocks have given way: steps below it lead nowhere
BACKTRACKS = 8  # of one iteration
BALANCED = 1e-2  # of the tolerance: out-of-balance over joint forces at an equilibrium
LEAST_BALANCED = 1e-9
YIELDING = 0.5  # of the elastic slope of V: below it steps may grow
MOST_DECAY = 0.95  # of what V grows while the blocks give way twice as far, over the same before
TURNING = 0.02  # of the longest step so far: where none but shorter ones find equilibrium, the blocks are let go
JUMP = 0.25  # of it: the step by which the jacks go on meanwhile
MOST_JUMPS, MOST_DRIFTS, MOST_DRAG = 20, 300, 1e4  # of a path; steps of one; drag over elastic stiffness
CLOSED = 1e-3  # of the fastest relative motion of a step: gaps and their closing below it are none
HELD = 1e-10  # of the elastic stiffness, added to the tangent
DIFFERENCE = 1e-6  # of the elastic move of a joint, by which its tangent is taken
MOST_ENTRIES = 60_000_000  # of the equations: 480 MB


@dataclass
class Path:
    """A followed path: whether the bracket became narrow enough, Newton iterations and equilibria it took."""

    converged: bool
    iterations: int
    equilibria: int


def follow(
    state: State,
    load: np.ndarray,
    factor: Factor,
    certificate: Certificate,
    strength: float,
    recorder: Recorder | None = None,
    goal: float = 0.0,
) -> Path:
    """Push the seated ``state`` by the unit ``load`` (n, 6) to its limit, or until no further equilibrium is found.

    ``strength`` is a guess of the limit load. The bracket ends up in ``certificate``; every equilibrium is recorded,
    its number for a time. The path goes on until a block has moved by ``goal`` (m).
    """
    return _Follower(state, load, factor, certificate, recorder).run(strength, goal)


def prepare(state: State, load: np.ndarray, factor: Factor, certificate: Certificate, recorder: Recorder | None):
    """Compile what `follow` needs, or load it from the cache, and leave the ``state`` as it is."""
    follower = _Follower(state, load, factor, certificate, recorder)
    remember(follower.trial, state.joints, state.points, state.areas)
    follower.compile()


def elastic_moves(state: State) -> np.ndarray:
    """By how much each joint gives way elastically before it slides or opens (j,) in m.

    A joint that carries nothing yet counts as if it carried the most that any joint of its blocks does.
    """
    joints = state.joints
    carried = np.zeros(len(state.blocks.displacement))
    for ends in (joints.block_a, joints.block_b):
        np.maximum.at(carried, ends, joints.resultant[:, 0])
    carried[np.setdiff1d(np.arange(len(carried)), state.blocks.free)] = 0.0
    normal = np.maximum(carried[joints.block_a], carried[joints.block_b])
    stiffness = joint_stiffness(state)
    if not normal.max() > 0.0:
        return 1e-6 * joint_reach(state)
    normal = np.maximum(normal, 1e-3 * normal.max())
    friction = np.zeros(len(normal))
    for family in (state.points, state.areas):
        if family is not None:
            friction[family.joint] = family.friction
    return normal * np.maximum(1.0 / stiffness[:, 2, 2], friction / stiffness[:, 0, 0])


def _new_trial(state: State, load: np.ndarray, factor: Factor) -> Trial:
    joints, free = state.joints, state.blocks.free
    count = len(joints.block_a)
    row = np.full(len(state.blocks.displacement), -1)
    row[free] = factor.place
    seen_a, seen_b = to_joint(joints.axes, joints.arm_a), to_joint(joints.axes, joints.arm_b)
    ends = np.stack([row[joints.block_a], row[joints.block_b]])
    half_width = int(np.abs(ends[0] - ends[1])[(ends >= 0).all(axis=0)].max(initial=0)) + 5
    rows = 6 * len(free)
    if rows * (3 * half_width + 1) > MOST_ENTRIES:
        raise ScenarioError(
            f"{len(free)} free blocks in a wide assembly are too many for a quasi-static search: its equations would "
            f"take {8e-9 * rows * (3 * half_width + 1):.2g} GB; push a smaller part, or use a dynamic kind of control"
        )
    sixes = (factor.place[:, None] + np.arange(6)).ravel()
    along = np.zeros(rows)
    along[sixes] = load[free].ravel()
    points = 0 if state.points is None else len(state.points.k_s)
    areas = 0 if state.areas is None else len(state.areas.joint)
    return Trial(
        seen_a=seen_a,
        seen_b=seen_b,
        row=row.astype(np.int64),
        reach=joint_reach(state),
        move=DIFFERENCE * elastic_moves(state),
        stiffness=joint_stiffness(state),
        drag=np.array([0.0, HELD]),
        base=np.zeros((count, 6)),
        elastic_1=np.zeros(points),
        elastic_2=np.zeros(points),
        point_slip=np.zeros(points),
        elastic=np.zeros((areas, 3)),
        twist=np.zeros((areas, 3)),
        area_slip=np.zeros(areas),
        force=np.zeros((7, 6)),
        tangent=np.zeros((count, 6, 6)),
        half_width=half_width,
        band=np.zeros((rows, 3 * half_width + 1)),
        residual=np.zeros(rows),
        load=along,
        by_residual=np.zeros(rows),
        by_load=np.zeros(rows),
    )


class _Follower:
    def __init__(self, state: State, load, factor: Factor, certificate: Certificate, recorder):
        self.state, self.factor, self.certificate, self.recorder = state, factor, certificate, recorder
        self.free = state.blocks.free
        self.rows = factor.place[:, None] + np.arange(6)
        self.trial = _new_trial(state, load, factor)
        self.weight = float(np.abs(state.jacks.weight).sum())
        self.answer = np.empty(self.rows.size)
        self.answer[self.rows] = factor.answer(load[self.free])
        self.compliance = float(self.trial.load @ self.answer)
        self.balanced = max(BALANCED * certificate.tolerance, LEAST_BALANCED)
        self.iterations = 0
        self.external = self.friction = self.seated = 0.0
        if recorder is not None:
            self.seated = elastic_energy(state.blocks, state.joints, state.points, state.areas)
        # inelastic displacement, V, lower and upper bound, whether a gap is closing
        self.seen: list[tuple[float, float, float, float, bool]] = []

    def compile(self) -> None:
        """Call every kernel once, at the motion of now."""
        state = self.state
        self._try(self._motion(), 0.0, True)
        newton_directions(self.trial, state.joints)
        instant_bounds(state.blocks, state.joints, state.points, state.areas, 0.0, 0.0, 1.0)
        if self.recorder is not None:
            self._write()
            self.recorder.record.count[:] = 0

    def run(self, strength: float, goal: float) -> Path:
        state, trial = self.state, self.trial
        remember(trial, state.joints, state.points, state.areas)
        motion = self._motion()
        self.seated_at = state.blocks.displacement.copy()
        self.V, self.driven = 0.0, float(trial.load @ motion) / self.weight
        self.start = self.driven
        self.seen = [(0.0, 0.0, 0.0, NEVER, False)]
        state.jacks.drive[:2] = self.driven
        self._record()
        step = strength * self.compliance / self.weight / ELASTIC_STEPS
        longest = step
        direction, gain = self.answer / self.compliance * self.weight, self.weight / self.compliance
        equilibria = calm = jumps = kept = 0
        usual, spare = step, None
        while equilibria < MOST_EQUILIBRIA and step > SHORTEST * longest:
            V, iterations = self._equilibrium(motion + step * direction, self.V + step * gain)
            if V is None and spare is not None:
                direction, gain, spare = *spare, None
                continue
            if V is None:
                step, calm = SHRINKING * step, -2
                if step > TURNING * usual:
                    continue
                # the path turns back: let go, and see where the blocks come to rest
                jumps, step = jumps + 1, JUMP * usual
                V = self._let_go(motion + step * direction, self.V) if jumps <= MOST_JUMPS else None
                if V is None:
                    break
            equilibria += 1
            now = self._motion()
            change, slope = now - motion, (V - self.V) / step
            self._accept(change, V, step)
            motion = now
            if jumps == kept:
                direction, gain, spare, usual = change / step, slope, None, max(usual, step)
            else:
                # the blocks found their mechanism, or fell back into an elastic state: either may be the way on
                direction, gain, spare = change / step, 0.0, (direction, gain)
                self.seen[-1], kept = (*self.seen[-1][:3], NEVER, True), jumps
            longest = max(longest, self.seen[-1][0])
            if self._judged() and self._moved() >= goal:
                return Path(True, self.iterations, equilibria)
            calm += 1
            if iterations >= HARD:
                step *= SHRINKING
            elif iterations <= EASY and calm > 0 and slope <= YIELDING * self.weight / self.compliance:
                step *= GROWTH
        return Path(False, self.iterations, equilibria)

    def _motion(self) -> np.ndarray:
        motion = np.empty(self.rows.size)
        blocks = self.state.blocks
        motion[self.rows] = np.concatenate([blocks.displacement[self.free], blocks.rotation[self.free]], axis=1)
        return motion

    def _moved(self) -> float:
        """How far the block that moved most has moved since the start of the path (m)."""
        return float(np.linalg.norm(self.state.blocks.displacement - self.seated_at, axis=1).max())

    def _try(self, motion: np.ndarray, V: float, with_tangent: bool) -> float:
        """Out-of-balance of a motion under the load V: the square root of the elastic energy that it would give (J)."""
        state = self.state
        blocks = state.blocks
        rows = motion[self.rows]
        blocks.displacement[self.free], blocks.rotation[self.free] = rows[:, :3], rows[:, 3:]
        try_motion(
            self.trial, blocks, state.joints, state.points, state.areas, state.jacks, V, with_tangent
        )  # fmt: skip
        residual = self.trial.residual[self.rows]
        return math.sqrt(max(0.0, float((residual * self.factor.answer(residual)).sum())))

    def _ratio(self) -> float:
        """Out-of-balance force or moment over the greatest joint force, the worst block."""
        resultant = self.state.joints.resultant
        largest = float(np.sqrt((resultant[:, :3] ** 2).sum(axis=1)).max())
        residual = self.trial.residual[self.rows]
        worst = max(
            float(np.sqrt((residual[:, :3] ** 2).sum(axis=1)).max()),
            float(np.sqrt((residual[:, 3:] ** 2).sum(axis=1)).max()) / float(self.trial.reach.max()),
        )
        return worst / largest if largest > 0.0 else 1.0

    def _equilibrium(self, motion: np.ndarray, V: float) -> tuple[float | None, int]:
        """V of the equilibrium at the driven displacement of ``motion``, near it; None where none is found."""
        trial = self.trial
        size = self._try(motion, V, True)
        for iteration in range(MOST_ITERATIONS):
            if not math.isfinite(size):
                return None, iteration
            if self._ratio() <= self.balanced:
                return V, iteration
            self.iterations += 1
            if not newton_directions(trial, self.state.joints):
                return None, iteration
            along = float(trial.load @ trial.by_load)
            change_V = -float(trial.load @ trial.by_residual) / along
            change = trial.by_residual + change_V * trial.by_load
            part, best = 1.0, (math.inf, 0.0)
            for _ in range(BACKTRACKS):
                found = self._try(motion + part * change, V + part * change_V, False)
                if found < best[0]:
                    best = (found, part)
                if found < (1.0 - 0.1 * part) * size:
                    break
                part *= 0.5
            if best[1] == 0.0:
                return None, iteration
            motion, V = motion + best[1] * change, V + best[1] * change_V
            size = self._try(motion, V, True)
        return None, MOST_ITERATIONS

    def _let_go(self, motion: np.ndarray, V: float) -> float | None:
        """V of the equilibrium that the blocks drift to at the driven displacement of ``motion``; None without one.

        In every step of the drift a part of the elastic stiffness drags at each joint; it fades as they come to rest.
        """
        trial, state, drag = self.trial, self.state, 1.0
        for _ in range(MOST_DRIFTS):
            trial.drag[:] = drag, drag
            found, iterations = self._equilibrium(motion, V)
            trial.drag[:] = 0.0, HELD
            if found is None:
                drag *= 4.0
                if drag > MOST_DRAG:
                    break
                continue
            V, motion = found, self._motion()
            self.friction += self._dissipated()
            remember(trial, state.joints, state.points, state.areas)
            self._try(motion, V, False)
            if self._ratio() <= self.balanced:
                return V
            if iterations <= EASY:
                drag *= 0.5
        return None

    def _accept(self, change: np.ndarray, V: float, step: float) -> None:
        """Keep an equilibrium: memory, jacks, and the bounds of this instant."""
        state, blocks = self.state, self.state.blocks
        rows = change[self.rows]
        blocks.velocity[self.free], blocks.spin[self.free] = rows[:, :3], rows[:, 3:]
        self.friction += self._dissipated()
        moved = step * self.weight
        self.external += 0.5 * (self.V + V) * moved
        self.external += float((blocks.dead_force * blocks.velocity + blocks.dead_torque * blocks.spin).sum())
        closing = self._closes_gaps()
        remember(self.trial, state.joints, state.points, state.areas)
        self.V, self.driven = V, self.driven + step
        jacks = state.jacks
        turned = np.cross(blocks.rotation[jacks.block], jacks.arm)
        jacks.displacement[:] = ((blocks.displacement[jacks.block] + turned) * jacks.direction).sum(axis=1)
        jacks.drive[:3] = self.driven, self.driven, V
        if V > jacks.drive[3]:
            jacks.drive[3:5] = V, self.driven
        lower, upper = instant_bounds(
            blocks, state.joints, state.points, state.areas, V, moved, 1.0
        )  # fmt: skip
        given = self.driven - self.start - V * self.compliance / self.weight
        self.seen.append((given, V, float(lower), float(upper), closing))

    def _closes_gaps(self) -> bool:
        """Whether any open contact point or corner has come nearer since the last equilibrium, more than by rounding.

        Such a mechanism moves at a constant V only until the gap has closed, and is no limit.
        """
        state, joints = self.state, self.state.joints
        change = joints.relative - self.trial.base
        gaps, widened = [], []
        for family, x, y in ((state.points, "x_n", "y_n"), (state.areas, "x", "y")):
            if family is not None:
                j = np.repeat(family.joint, np.diff(family.start))
                x, y = getattr(family, x), getattr(family, y)
                gaps.append(joints.opening[j, 0] + joints.opening[j, 1] * y - joints.opening[j, 2] * x)
                widened.append(change[j, 2] + change[j, 3] * y - change[j, 4] * x)
        gap, wider = np.concatenate(gaps), np.concatenate(widened)
        fastest = max(float(np.abs(wider).max()), float(np.abs(change[:, :2]).max()))
        return bool(((gap > CLOSED * fastest) & (wider < -CLOSED * fastest)).any())

    def _dissipated(self) -> float:
        """Work that friction takes from the last equilibrium to this one, by the forces of this one (J)."""
        state, trial, work = self.state, self.trial, 0.0
        if state.points is not None:
            p = state.points
            friction = np.repeat(p.friction, np.diff(p.start))
            work += float((friction * p.normal * (p.slip - trial.point_slip)).sum())
        if state.areas is not None:
            a = state.areas
            work += float((a.friction * state.joints.resultant[a.joint, 0] * (a.slip - trial.area_slip)).sum())
        return work

    def _judged(self) -> bool:
        """Fold the bounds into the bracket; True when it is narrow enough and V is that of a mechanism.

        The bounds are those since the blocks had given way half as far. What V grew meanwhile shows how much is still
        missing where a contact shrinks for ever (a convex joint that rocks): the sum of all growths to come, each
        smaller than the last as the last was than the one before.
        """
        seen, bracket = self.seen, self.certificate.bracket
        given, V = seen[-1][:2]
        half = next((i for i in range(len(seen) - 1, -1, -1) if seen[i][0] <= 0.5 * given), 0)
        quarter = next((i for i in range(half, -1, -1) if seen[i][0] <= 0.25 * given), 0)
        growth, before = V - seen[half][1], seen[half][1] - seen[quarter][1]
        decay = min(MOST_DECAY, growth / before) if before > 0.0 else 0.0
        recent = seen[half + 1 :] or seen[-1:]
        bracket[0] = max(0.0, min(s[2] for s in recent))
        bracket[1] = max(s[3] for s in recent) + max(MISSING, decay / (1.0 - decay)) * max(growth, 0.0)
        self._record()
        # over half the way and over the last step, V must grow more slowly than the elastic structure would let it
        moved = given - seen[half][0]
        limit = (
            0.0 < seen[quarter][0]
            and not any(s[4] for s in recent)
            and growth <= STILL * self.weight / self.compliance * moved
        )
        width = 2.0 * self.certificate.tolerance * bracket[0]
        return limit and bracket[1] - bracket[0] <= width and width > 0.0

    def _record(self) -> None:
        if self.recorder is not None:
            self._write()
            self.recorder.drain()

    def _write(self) -> None:
        """Add the equilibrium of now to the record."""
        state, record = self.state, self.recorder.record
        lower, upper = self.certificate.bracket
        energy = record.energy[record.count[0]]
        energy[:] = 0.0
        energy[ELASTIC] = elastic_energy(state.blocks, state.joints, state.points, state.areas) - self.seated
        energy[EXTERNAL], energy[FRICTION] = self.external, self.friction
        number = max(0, len(self.seen) - 1)
        write_row(
            record, number, float(number), state.blocks, state.joints, state.points, state.jacks, 0.0, lower, upper,
            False,
        )  # fmt: skip
