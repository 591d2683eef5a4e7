"""The next equilibrium of an assembly by an interior-point method, if Newton's method on the laws finds no way.

Where many contact points open, close and slip within one step, the tangent of the laws says little of the end of the
step. Here every point keeps its forces and what belongs to them as unknowns of their own: the normal force N and the
opening z, the shear force T, the slip p and a bound w of its length,

    N / k_n - z = penetration,                    N z = mu,
    T / k_s + p = T_0 / k_s + motion in shear,    (f N, T) o (w, -p) = (mu, 0)

with the product of second-order cones, (a, b) o (c, d) = (a c + b.d, a d + c b). Inside, N, z, w > 0, |T| < f N and
|p| < w. As mu tends to zero this is the law of dry friction, without dilatancy, implicit over the step; before, it is
smooth, and steps by Newton's method in all unknowns go far (Mehrotra, SIAM J. Optim. 2 (1992) 575; cones in the scaling
of Nesterov and Todd, SIAM J. Optim. 8 (1998) 324). The unknowns of a point are eliminated from its own equations, so
that the tangent has the pattern of the stiffness. It takes ten to thirty factorisations however many points there are.
It may fail: as friction without dilatancy is no problem of least energy, the path to mu = 0 may turn back.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from dembrick.simulation.statics.newton import PIVOT, Equilibria
from dembrick.simulation.statics.path_state import PathState
from dembrick.simulation.statics.sparse_equations import inner
from dembrick.simulation.statics.state import State

MOST_STEPS = 30  # Newton steps for one equilibrium
FIRST = 0.1  # of the mean normal force times the driven displacement of the step: mu to start from
LAST = 1e-6  # of the elastic energy of a point: mu to end with
LEAST_NORMAL = 0.05  # of the mean normal force, to start from
INSIDE, SHORT = 0.9, 0.15  # of the way to the boundary; steps shorter than that are tried otherwise
LEAST_CUT, CUT = 1e-3, 0.7  # least and greatest factor by which a step is to lessen mu
GUESSABLE = 0.1  # steps to mu = 0 that come further than that tell how they curve
CENTRED, NEARLY = 0.8, 0.3  # least product of a point over the mean: no need to centre; out of balance, need to
HELD = 1e-12  # of the elastic stiffness, added to the tangent
NEAR = 0.02  # out-of-balance over joint forces, of the laws: from there Newton's method is worth a trial
BALANCED = 1e-6  # out-of-balance over the heaviest block


def applies(state: State) -> bool:
    """Whether all joints are dry contact points, and there are no ties."""
    return state.points is not None and state.areas is None and state.points.strengths is None and state.ties is None


class Unknowns(NamedTuple):
    """Those of the c contact points, or a change of them."""

    normal: np.ndarray  # (c,) N
    opening: np.ndarray  # (c,) m
    shear: np.ndarray  # (c, 2) N
    slip: np.ndarray  # (c, 2) m
    bound: np.ndarray  # (c,) m, of the length of the slip

    def moved(self, change: Unknowns, part: float) -> Unknowns:
        """These and a part of a change."""
        return Unknowns(*(now + part * more for now, more in zip(self, change, strict=True)))


class Change(NamedTuple):
    """A Newton step: of the motion (6 f,), of V, and of the points; ``force`` is f N and T of the points, ``length``
    w and -p (c, 3)."""

    motion: np.ndarray
    V: float
    points: Unknowns
    force: np.ndarray
    length: np.ndarray


class InteriorPoint:
    """Finds equilibria of the state of a ``search`` from the memory of the last one."""

    def __init__(self, search: Equilibria):
        self.search, points = search, search.state.points
        self.points, self.count = points, len(search.state.joints.block_a)
        self.joint = np.repeat(points.joint, np.diff(points.start))
        self.friction = np.repeat(points.friction, np.diff(points.start))
        none, one = np.zeros(len(self.joint)), np.ones(len(self.joint))
        penetration = (none, none, -one, -points.y_n, points.x_n, none)
        shear = (one, none, none, none, none, -points.y_s), (none, one, none, none, none, points.x_s)
        self.seen = np.stack([np.stack(row, axis=1) for row in (penetration, *shear)], axis=1)  # (c, 3, 6)

    def next_equilibrium(self, way: PathState) -> float | None:
        """V of the equilibrium that comes next on a path, None if none is found."""
        self.search.attempt(way.motion, way.V)
        found = self.find(way.motion + way.step * way.direction, way.V, way.step)
        if found is None:
            return None
        self.search.attempt(*found)
        return self.search.find(*found)[0] if self.search.out_of_balance() < NEAR else None

    def find(self, motion: np.ndarray, V: float, step: float) -> tuple[np.ndarray, float] | None:
        """Motion (6 f,) and V of an equilibrium at the driven displacement of ``motion``, which is ``step`` (m) beyond
        the last one, whose normal forces are those of now; None where the equations are singular or nothing presses."""
        mean = float(self.points.normal.mean())
        if not mean > 0.0:
            return None
        now = self._start(mean, FIRST * mean * step)
        last = LAST * mean**2 / float(self.points.k_n.mean())
        for _ in range(MOST_STEPS):
            equations = _Equations(self, now, motion, V)
            if equations.mean <= 3.0 * last and equations.unbalanced <= BALANCED:
                break
            if not equations.factorised():
                return None
            change, part = equations.step(last)
            motion, V, now = motion + part * change.motion, V + part * change.V, now.moved(change.points, part)
        return motion, V

    def _start(self, mean: float, product: float) -> Unknowns:
        """Inside, at the normal forces of now and the shear forces of the last equilibrium, as near as may be."""
        memory = self.search.trial.points
        normal = np.maximum(self.points.normal, LEAST_NORMAL * mean)
        shear, strength = np.stack([memory.elastic_1, memory.elastic_2], axis=1), self.friction * normal
        size = np.sqrt((shear**2).sum(axis=1))
        shear *= np.minimum(1.0, CUT * strength / np.maximum(size, 1e-300))[:, None]
        bound = product * strength / _determinant(np.column_stack([strength, shear]))
        return Unknowns(normal, product / normal, shear, shear * (bound / strength)[:, None], bound)

    def joint_motion(self, motion: np.ndarray) -> np.ndarray:
        """Motion (j, 6) of b against a at every joint, in its axes."""
        state, trial = self.search.state, self.search.trial
        self.search.move(motion)
        blocks = np.concatenate([state.blocks.displacement, state.blocks.rotation], axis=1)
        of_b = np.einsum("jik,jk->ji", trial.seen_b, blocks[state.joints.block_b])
        return of_b - np.einsum("jik,jk->ji", trial.seen_a, blocks[state.joints.block_a])

    def at_joints(self, values: np.ndarray) -> np.ndarray:
        """Sums over the points of every joint."""
        sums = np.zeros((self.count, *values.shape[1:]))
        sums[self.points.joint] = np.add.reduceat(values, self.points.start[:-1], axis=0)
        return sums

    def on_blocks(self, forces: np.ndarray) -> np.ndarray:
        """Out-of-balance (6 f,) that ``forces`` (c, 3) of the points, N and T, leave."""
        joints, trial, search = self.search.state.joints, self.search.trial, self.search
        at_joints = self.at_joints(np.einsum("cik,ci->ck", self.seen, forces))
        total = np.zeros((len(search.state.blocks.displacement), 6))
        for ends, seen, sign in ((joints.block_a, trial.seen_a, 1.0), (joints.block_b, trial.seen_b, -1.0)):
            found = np.einsum("jik,ji->jk", seen, at_joints)
            for k in range(6):
                total[:, k] += sign * np.bincount(ends, found[:, k], minlength=len(total))
        return search.factor.pattern.to_rows(total[search.free])


class _Equations:
    """Those of all unknowns, linear about those of ``now``."""

    def __init__(self, owner: InteriorPoint, now: Unknowns, motion: np.ndarray, V: float):
        self.owner, self.now, search, points = owner, now, owner.search, owner.points
        state, memory = search.state, search.trial.points
        moved, base = owner.joint_motion(motion), search.trial.base
        moved[:, 2] += state.joints.gap
        moved[:, [0, 1, 5]] -= base[:, [0, 1, 5]]
        at_points = np.einsum("cik,ck->ci", owner.seen, moved[owner.joint])
        self.force = np.column_stack([owner.friction * now.normal, now.shear])
        self.length = np.column_stack([now.bound, -now.slip])
        # what the elastic springs miss, and what the blocks do
        self.missing_normal = at_points[:, 0] - now.normal / points.k_n + now.opening
        before = np.stack([memory.elastic_1, memory.elastic_2], axis=1)
        self.missing_shear = at_points[:, 1:] - now.slip + (before - now.shear) / points.k_s[:, None]
        dead = np.concatenate([state.blocks.dead_force, state.blocks.dead_torque], axis=1)[search.free]
        self.residual = search.factor.pattern.to_rows(dead) + V * search.load
        self.residual += owner.on_blocks(np.column_stack([now.normal, now.shear]))
        self.unbalanced = float(np.abs(self.residual).max()) / search.heaviest
        self.mean = _mean_product(now, owner.friction)

    def factorised(self) -> bool:
        """Factorise the tangent of the blocks; False if it is singular."""
        owner, now, search = self.owner, self.now, self.owner.search
        search.pause()
        search.iterations += 1
        began = time.perf_counter()
        self.scaling = _Scaling(self.force, self.length)
        self.give_normal = 1.0 / (1.0 / owner.points.k_n + now.opening / now.normal)
        both = self.scaling.square  # dlength = ... - both dforce
        a = 1.0 / owner.points.k_s + both[:, 1, 1]
        b, d = both[:, 1, 2], 1.0 / owner.points.k_s + both[:, 2, 2]
        give = np.empty((len(a), 2, 2))
        give[:, 0, 0], give[:, 0, 1], give[:, 1, 0], give[:, 1, 1] = d, -b, -b, a
        self.give_shear = give / (a * d - b * b)[:, None, None]
        # shear force a newton more of N
        self.by_normal = -np.einsum("cij,cj->ci", self.give_shear, both[:, 1:, 0]) * owner.friction[:, None]
        tangent = np.zeros((len(a), 3, 3))
        tangent[:, 0, 0], tangent[:, 1:, 1:] = self.give_normal, self.give_shear
        tangent[:, 1:, 0] = self.by_normal * self.give_normal[:, None]
        self.tangent = tangent
        at_points = np.einsum("cij,cjl->cil", tangent, owner.seen)
        trial = search.trial
        trial.tangent[:] = owner.at_joints(np.einsum("cik,cil->ckl", owner.seen, at_points))
        trial.tangent[:] += HELD * trial.stiffness
        made = search.tangent.make(trial.seen_a, trial.seen_b, trial.tangent, PIVOT, np.zeros_like(self.residual))
        search.phases["equations"] += time.perf_counter() - began
        return made < 0

    def step(self, last: float) -> tuple[Change, float]:
        """A step towards smaller products, not below ``last``, and the part of it that stays inside."""
        straight = self._change(0.0)
        far = min(1.0, self._room(straight))
        ahead = _mean_product(self.now.moved(straight.points, far), self.owner.friction)
        guessed = far > GUESSABLE
        cut = min(max((ahead / self.mean) ** 3, LEAST_CUT), CUT) if guessed else CUT
        change = self._change(max(cut * self.mean, last), straight if guessed else None)
        part = min(1.0, INSIDE * self._room(change))
        if part < SHORT:
            centred = _least_product(self.now, self.force, self.length) / self.mean
            if centred < NEARLY or (centred < CENTRED and self.unbalanced > BALANCED):
                change = self._change(self.mean)
                return change, min(1.0, INSIDE * self._room(change))
            other = self._change(CUT * self.mean)
            longer = min(1.0, INSIDE * self._room(other))
            if longer > part:
                return other, longer
        return change, part

    def _change(self, product: float, guess: Change | None = None) -> Change:
        """The Newton step that is to make all products ``product``; ``guess`` is one that tells their curvature."""
        owner, now, search = self.owner, self.now, self.owner.search
        wanted = product - now.normal * now.opening
        scaled = self.scaling.wanted(product, guess)
        if guess is not None:
            wanted -= guess.points.normal * guess.points.opening
        rest_normal = self.give_normal * (self.missing_normal + wanted / now.normal)
        rest_shear = np.einsum("cij,cj->ci", self.give_shear, self.missing_shear + scaled[:, 1:])
        rest_shear += self.by_normal * rest_normal[:, None]
        began = time.perf_counter()
        search.answers[:] = self.residual + owner.on_blocks(np.column_stack([rest_normal, rest_shear])), search.load
        search.tangent.solve(search.answers)
        search.phases["equations"] += time.perf_counter() - began
        by_residual, by_load = search.answers
        V = -inner(search.load, by_residual) / inner(search.load, by_load)
        motion = by_residual + V * by_load
        at_points = np.einsum("cik,ck->ci", owner.seen, owner.joint_motion(motion)[owner.joint])
        normal = self.give_normal * at_points[:, 0] + rest_normal
        shear = np.einsum("cij,cj->ci", self.tangent[:, 1:, :], at_points) + rest_shear
        force = np.column_stack([owner.friction * normal, shear])
        length = scaled - np.einsum("cij,cj->ci", self.scaling.square, force)
        opening = (wanted - now.opening * normal) / now.normal
        return Change(motion, V, Unknowns(normal, opening, shear, -length[:, 1:], length[:, 0]), force, length)

    def _room(self, change: Change) -> float:
        """How much of a change may be made until a point comes to the boundary."""
        now, change_of = self.now, change.points
        most = max(
            float((-change_of.normal / now.normal).max()),
            float((-change_of.opening / now.opening).max()),
            _reached(self.force, change.force),
            _reached(self.length, change.length),
        )
        return 1.0 / most if most > 0.0 else np.inf


class _Scaling:
    """Nesterov and Todd's scaling W of pairs of vectors inside second-order cones: W length = W^-1 force."""

    def __init__(self, force: np.ndarray, length: np.ndarray):
        of_force, of_length = np.sqrt(_determinant(force)), np.sqrt(_determinant(length))
        one, other = force / of_force[:, None], length / of_length[:, None]
        between = np.sqrt(0.5 * (1.0 + (one * other).sum(axis=1)))
        middle = (one + SIGNS * other) / (2.0 * between)[:, None]
        size = np.sqrt(of_force / of_length)
        back = SIGNS * middle
        self.square = (2.0 * back[:, :, None] * back[:, None, :] - np.diag(SIGNS)) / (size**2)[:, None, None]
        half = middle + np.array([1.0, 0.0, 0.0])
        self.half, self.size = half / np.sqrt(2.0 * half[:, :1]), size
        self.both = self.forth(length)

    def forth(self, x: np.ndarray) -> np.ndarray:
        """W x."""
        return self.size[:, None] * (2.0 * self.half * (self.half * x).sum(axis=1)[:, None] - SIGNS * x)

    def back(self, x: np.ndarray) -> np.ndarray:
        """W^-1 x."""
        half = SIGNS * self.half
        return (2.0 * half * (half * x).sum(axis=1)[:, None] - SIGNS * x) / self.size[:, None]

    def wanted(self, product: float, guess: Change | None) -> np.ndarray:
        """Change of the lengths (c, 3), at forces held, that makes all products ``product``."""
        right = -_product(self.both, self.both)
        right[:, 0] += product
        if guess is not None:
            right -= _product(self.back(guess.force), self.forth(guess.length))
        both = self.both
        first = (both[:, 0] * right[:, 0] - (both[:, 1:] * right[:, 1:]).sum(axis=1)) / _determinant(both)
        rest = (right[:, 1:] - first[:, None] * both[:, 1:]) / both[:, :1]
        return self.back(np.column_stack([first, rest]))


SIGNS = np.array([1.0, -1.0, -1.0])


def _determinant(x: np.ndarray) -> np.ndarray:
    """x_0^2 - |x_1|^2 (c,) of vectors (c, 3): positive inside the cone."""
    return x[:, 0] ** 2 - x[:, 1] ** 2 - x[:, 2] ** 2


def _product(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """x o y (c, 3)."""
    return np.column_stack([(x * y).sum(axis=1), x[:, :1] * y[:, 1:] + y[:, :1] * x[:, 1:]])


def _reached(x: np.ndarray, change: np.ndarray) -> float:
    """One over the greatest part of a change of vectors (c, 3) that keeps all inside the cone; not positive where any
    part does."""
    along = change[:, 0] * x[:, 0] - change[:, 1] * x[:, 1] - change[:, 2] * x[:, 2]
    inside = _determinant(x)
    root = along**2 - _determinant(change) * inside
    return float(np.where(root < 0.0, 0.0, (np.sqrt(np.maximum(root, 0.0)) - along) / inside).max())


def _mean_product(now: Unknowns, friction: np.ndarray) -> float:
    """Mean of what should become mu, over normal and shear of all points."""
    shear = friction * now.normal * now.bound - (now.shear * now.slip).sum(axis=1)
    return 0.5 * float((now.normal * now.opening).mean() + shear.mean())


def _least_product(now: Unknowns, force: np.ndarray, length: np.ndarray) -> float:
    """The least of them."""
    shear = np.sqrt(np.maximum(_determinant(force) * _determinant(length), 0.0))
    return min(float((now.normal * now.opening).min()), float(shear.min()))
