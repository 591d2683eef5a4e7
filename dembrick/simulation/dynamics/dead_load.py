"""Dead-load equilibrium before a dynamic run, by dynamic relaxation with local damping; and which blocks find none.

A fall is judged by joints and not by displacements: the settlements of a tall tower add up, and one small block must
not set the bound for all. A joint has come apart if its blocks have moved relative to each other by more than a
fraction of its size plus its elastic displacement; a block that no chain of sound joints connects to a support falls.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import contextmanager, nullcontext

import numpy as np

from dembrick.errors import DembrickError, NotConvergedError, UndecidedError, of_joint_forces
from dembrick.kernels.dynamics.law_memory import FORGETTING, SEARCHING
from dembrick.kernels.dynamics.loop import RUNNING, Limits
from dembrick.scenario.checks import listed, show
from dembrick.simulation import interrupts
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.chunks import advance_chunk
from dembrick.simulation.dynamics.integrator import (
    LONGEST_MOVE,
    NO_LIMIT,
    Motion,
    joint_forces,
    stop,
    update_history_at_rest,
)
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.state import MovingState, out_of_balance
from dembrick.simulation.session import Session

LOCAL_DAMPING = 0.8
STEP = 0.7  # of the time step: local damping makes forces against the motion 1.8 times as large; for those of springs,
FIRM_STEP = 1.0 / (1.0 + LOCAL_DAMPING)  # and for those of dashpots too
BALANCED = 1e-9  # of the greatest force on any block: out-of-balance force at which each block rests
OWN = 1e-7  # of the greatest force on that block: the same for light blocks
LEAST = 1e-6  # of the greatest force on any block: what a block without forces of its own is compared with
ROUNDING = 4.0  # of the force error by rounded positions: least tolerance
APART = 0.02  # of a joint's size: if joints cannot slip, a joint that has moved further has come apart
SLID = 1.0  # of its size: the same if joints may slip
ELASTIC = 4.0  # times the elastic displacement of the closed joint under its force, in addition to that
MOST_STEPS = 200_000  # of one attempt, at the usual time step
USUAL = 0.9  # of the critical time step: default of solver.step_factor
CHUNK = 256  # steps between two checks for equilibrium
# steps without rest or fall, after which statics in the geometry of the start decides on a fall, and joints that open
REFEREE = 20_000  # lose their shear, with which they may open and close for ever
STICKING = 1e9  # friction of joints that may not slip


def find_equilibrium(
    motion: Motion,
    driving: Driving,
    sticking: bool = False,
    resume: Callable[[], None] | None = None,
    pause: Callable[[], None] | None = None,
) -> float:
    """Bring the blocks to rest under the dead loads at time zero; displacements are measured from there.

    Blocks that no chain of joints connects to a support stay where they are. Returns the out-of-balance force left on
    one of the others, over the forces on it. With ``sticking`` no joint slips meanwhile, so that a block that slides
    from the start begins with its weight on the joint. Blocks that overturn even so are fixed where they were drawn
    while the others come to rest, and begin to fall when time starts: ``motion.falling``. Without ``sticking`` such
    blocks raise NotConvergedError, which names them; blocks that neither rest nor fall, UndecidedError. Bonds do not
    break meanwhile, whatever their forces.

    ``pause`` is called between two chunks of steps, ``motion.dead_load_steps`` in all so far; ``resume`` restores
    state and steps of such a point. A state that a settlement left is at rest already, unless its loads have changed.
    """
    if motion.settled:
        joint_forces(motion, driving)
        return unbalanced(motion.state, driving, ~np.asarray(motion.assembly.fixed))[0]
    drawn = keep(motion)
    supported = _supported(motion.state)
    slack = (APART if sticking else SLID) * motion.polygons.size
    with stuck(motion) if sticking else nullcontext(), held_bonds(motion), searching(motion):
        if resume is not None:
            resume()
        attempt = _Attempt(motion, driving, supported, slack, None if sticking else APART * motion.polygons.size)
        attempt.compile()
        with interrupts.deferred():
            while True:
                falls = attempt.relax(pause)
                if not falls.any():
                    break
                if not sticking:
                    raise _fallen(motion, falls)
                put_back(motion, drawn)
                motion.falling |= falls
                motion.attempt[:] = motion.dead_load_steps, -1.0
        bodies = motion.state.bodies
        stop(bodies)
        update_history_at_rest(motion, driving)
    if not (sticking or attempt.ratio <= attempt.enough):
        raise UndecidedError(
            f"undecided under the dead loads: after {motion.dead_load_steps} steps of relaxation "
            f"{of_joint_forces(attempt.ratio)} are still out of balance, and no joint has come apart; a run of kind "
            '"statics" may decide it by Newton\'s method, and softer joints converge in fewer steps'
        )
    bodies.start[:] = bodies.position
    return attempt.ratio


def most_steps(motion: Motion) -> int:
    """Most steps of a relaxation: more if the time step is smaller than usual."""
    return round(MOST_STEPS * max(1.0, USUAL * motion.critical_time_step / motion.time_step))


class _Attempt:
    """Relaxation with falling blocks fixed; ``slack`` (j,): how far joints may move (m) before they have come apart;
    ``slack_of_fall``: the same once statics in the geometry of the start proves a fall (None: without that check)."""

    def __init__(
        self,
        motion: Motion,
        driving: Driving,
        supported: np.ndarray,
        slack: np.ndarray,
        slack_of_fall: np.ndarray | None = None,
    ):
        self.motion, self.driving, self.supported, self.slack = motion, driving, supported, slack
        self._slack_of_fall = slack_of_fall
        self._dt = STEP * motion.time_step
        self._limits = Limits(displacement=NO_LIMIT, longest=LONGEST_MOVE * motion.smallest)

    def compile(self) -> None:
        """Compile the loop before signals are deferred."""
        self._advance(self.motion.state.bodies, 0)

    def _advance(self, bodies, n_steps: int) -> tuple[int, int]:
        return advance_chunk(
            self.motion, bodies, self.driving, np.zeros(n_steps), self._limits, LOCAL_DAMPING, self._dt
        )

    def relax(self, pause: Callable[[], None] | None) -> np.ndarray:
        """Relax until the blocks rest; return the blocks (n,) that fall, none if all stand.

        After the first fall is detected the relaxation goes on as long again, so that slower parts of the mechanism
        show.
        """
        motion, begun = self.motion, self.motion.dead_load_steps
        self.ratio, self.enough = 0.0, BALANCED
        none = np.zeros(len(self.supported), bool)
        standing = self.supported & ~motion.falling
        bodies = motion.state.bodies
        held = bodies._replace(free=bodies.free[standing[bodies.free]])
        if not (len(held.free) and len(motion.state.links.host)):
            return none
        most = most_steps(motion)
        while motion.dead_load_steps - motion.attempt[0] < most:
            if pause is not None and motion.dead_load_steps > begun:
                pause()
            late = motion.dead_load_steps - motion.attempt[0] >= REFEREE
            motion.laws = FORGETTING if late else SEARCHING
            status, done = self._advance(held, CHUNK)
            motion.dead_load_steps += done
            self.ratio, self.enough = unbalanced(motion.state, self.driving, standing)
            if self._slack_of_fall is not None and motion.dead_load_steps - motion.attempt[0] >= REFEREE:
                if _falls_as_drawn(motion, self.driving):
                    self.slack = self._slack_of_fall
                self._slack_of_fall = None
            falls = standing & ~self._tied()
            if falls.any():
                spent = motion.dead_load_steps - motion.attempt[0]
                if motion.attempt[1] < 0.0:
                    motion.attempt[1] = spent
                if spent >= 2.0 * motion.attempt[1] or status != RUNNING:
                    return falls
            elif self.ratio <= self.enough or status != RUNNING:
                return none
        return standing & ~self._tied()

    def _tied(self) -> np.ndarray:
        """Which blocks (n,) are connected to a fixed block by joints that have not come apart."""
        moved = self.motion.polygons.moved()
        if (moved <= self.slack).all():
            return self.supported
        compliance = _compliance(self.motion.state)
        force = np.sqrt((self.motion.state.links.wrench[:, :3] ** 2).sum(axis=1))
        sound = moved <= self.slack + ELASTIC * force * compliance
        return _supported(self.motion.state, sound)


def _falls_as_drawn(motion: Motion, driving: Driving) -> bool:
    """Whether statics proves that the blocks fall under constant loads in the geometry of the start."""
    from dembrick.simulation.statics.rest.dead_load import (
        find_rest,  # imported here as its kernels are rarely needed
    )

    if any(curve is not None for curve in driving.factor):
        return False
    try:
        return find_rest(motion.assembly, Session()).rest.stands is False
    except DembrickError:  # undecided: too large, or too few contact points
        return False


def _arrays(motion: Motion) -> list[np.ndarray]:
    return [motion.travel, motion.polygons.shift, motion.polygons.whole, *motion.state.arrays]


def keep(motion: Motion) -> list[np.ndarray]:
    """Copies of all arrays that a relaxation changes, for `put_back`."""
    return [array.copy() for array in _arrays(motion)]


def put_back(motion: Motion, drawn: list[np.ndarray]) -> None:
    """Restore the state as ``drawn``, but keep the present strengths and the room that cutting has made."""
    strengths = joint_families.strengths(motion.state)
    for array, value in zip(_arrays(motion), drawn, strict=True):
        array[tuple(slice(0, n) for n in value.shape)] = value
    joint_families.put_strengths(motion.state, strengths)


@contextmanager
def stuck(motion: Motion):
    """Context in which no joint or new contact slips."""
    state, touching = motion.state, motion.contact_detection.touching
    own, at_contacts = joint_families.strengths(state), None if touching is None else touching.friction.copy()
    joint_families.stick(state, STICKING)
    if touching is not None:
        touching.friction[:] = STICKING
    try:
        yield
    finally:
        joint_families.put_strengths(state, own)
        if touching is not None:
            touching.friction[:] = at_contacts


@contextmanager
def searching(motion: Motion):
    """Context in which joint laws do not update their history, as blocks swing past their equilibrium."""
    laws, motion.laws = motion.laws, SEARCHING
    try:
        yield
    finally:
        motion.laws = laws


@contextmanager
def held_bonds(motion: Motion):
    """Context in which no bond breaks: those that the dead loads break do so when time begins."""
    joint_families.keep_bonds_intact(motion.state, True)
    try:
        yield
    finally:
        joint_families.keep_bonds_intact(motion.state, False)


def _compliance(state: MovingState) -> np.ndarray:
    """Upper bound of the compliance (m/N) of every closed joint (j,) at its corners."""
    stiffness, reach = joint_families.stiffness(state), state.links.reach.astype(float)
    diagonal = np.einsum("jii->ji", stiffness)
    bending = 0.5 * (diagonal[:, 3] + diagonal[:, 4])
    bending -= np.hypot(0.5 * (diagonal[:, 3] - diagonal[:, 4]), stiffness[:, 3, 4])
    terms = [1.0 / np.maximum(k, 1e-300) for k in (diagonal[:, 0], diagonal[:, 2])]
    terms += [reach**2 / np.maximum(k, 1e-300) for k in (bending, diagonal[:, 5])]
    return np.minimum(sum(terms), 1e150)


def _fallen(motion: Motion, falls: np.ndarray) -> NotConvergedError:
    names = [show(motion.assembly.names[i]) for i in np.flatnonzero(falls)]
    return NotConvergedError(
        f"no equilibrium under the dead loads: {listed(names)} slide or overturn before the run "
        "begins; check loads, friction and supports"
    )


def unsupported(state: MovingState, sound: np.ndarray | None = None) -> np.ndarray:
    """Which blocks (n,) no chain of joints, only ``sound`` ones (j,) if given, connects to a support."""
    return ~_supported(state, sound)


def _supported(state: MovingState, sound: np.ndarray | None = None) -> np.ndarray:
    """Which blocks (n,) a chain of joints, only ``sound`` ones (j,) if given, connects to a fixed block."""
    links, n = state.links, len(state.bodies.mass)
    host, other = (links.host, links.other) if sound is None else (links.host[sound], links.other[sound])
    tied = np.ones(n, bool)
    tied[state.bodies.free] = False
    while True:
        before = tied.sum()
        tied[host[tied[other]]] = True
        tied[other[tied[host]]] = True
        if tied.sum() == before:
            return tied


def unbalanced(state: MovingState, driving: Driving, standing: np.ndarray) -> tuple[float, float]:
    """Out-of-balance of the worst ``standing`` free block (n,) over the greatest force on that block, and the tolerance
    on it: `BALANCED` of the greatest force on any of them, at most `OWN` of the block's, since a light block may stand
    beside heavy ones; or what rounding of positions causes in its joints, if that is more.

    A moment counts as the force that causes it at the block's reach. The forces on a block are those of its joints, its
    weight and the resultant of other actions.
    """
    gravity, _ = driving.forces(np.zeros(1), 1.0)
    force, torque = out_of_balance(state, gravity[0])
    bodies, links = state.bodies, state.links
    free = bodies.free[standing[bodies.free]]
    left = np.maximum(np.linalg.norm(force, axis=1), np.linalg.norm(torque, axis=1) / bodies.reach)[free]
    if not left.any():
        return 0.0, BALANCED
    carried = np.linalg.norm(links.wrench[:, :3], axis=1)
    actions = np.linalg.norm(bodies.applied[:, :3], axis=1)  # contacts and ties among them
    own = np.maximum(actions, bodies.mass * np.linalg.norm(gravity[0]))
    for block in (links.host, links.other):
        np.maximum.at(own, block.astype(np.intp), carried)
    own = np.maximum(own[free], left)
    greatest = own.max()
    own = np.maximum(own, LEAST * greatest)
    enough = np.maximum(np.minimum(BALANCED * greatest / own, OWN), of_rounding(state)[free] / own)
    worst = int(np.argmax(left / own / enough))
    return float(left[worst] / own[worst]), float(enough[worst])


def of_rounding(state: MovingState) -> np.ndarray:
    """Error (n,) N of the forces on each block by rounding of positions: those of its stiffest joint, or of contacts
    on all of its section if it has no closed joint."""
    bodies, stiffness = state.bodies, joint_families.normal_stiffness(state)
    farthest, own = float(np.abs(bodies.position).max()), np.zeros(len(bodies.mass))
    for block in (state.links.host, state.links.other):
        np.maximum.at(own, block.astype(np.intp), stiffness)
    touching = math.pi * bodies.reach**2 * joint_families.greatest_modulus(state)
    touching = np.minimum(touching, stiffness.max(initial=0.0))
    return ROUNDING * np.finfo(float).eps * farthest * np.where(own > 0.0, own, touching)
