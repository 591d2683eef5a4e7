"""Driven relaxation: blocks are pushed on in explicit steps with the elastic stiffness of the assembly as inertia.

If many blocks slide and snap at once, equilibria lie so close to each other that Newton's method takes thousands of
steps, or finds none. With an inertia M = K, the elastic stiffness, all modes of the closed structure have the
frequency 1, those of the yielding structure lower ones, and explicit steps of about that size
are stable whatever opens, slides or closes (dynamic relaxation: Underwood, in Computational Methods for Transient
Analysis, 1983, 245). K is factorised once; a step costs one substitution and the joint forces.

The head moves at a steady rate and then slows down by halving, so that the contributions of inertia and dashpots to V
die out. Its travel is measured in elastic displacements at the present load.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from dembrick.errors import DivergedError
from dembrick.kernels.state import Energy, ScaledInertia
from dembrick.kernels.statics.load_bounds import NEVER
from dembrick.kernels.statics.loop import Drive, advance
from dembrick.kernels.statics.state import State as KernelState
from dembrick.simulation.statics.critical_step import critical_time_step
from dembrick.simulation.statics.elastic_factor import rounded_inertia
from dembrick.simulation.statics.load_system import VISCOUS, steady_drive
from dembrick.simulation.statics.newton import Equilibria
from dembrick.simulation.statics.paths.path_state import PathState
from dembrick.simulation.statics.sparse_equations import Factors
from dembrick.simulation.statics.state import State, for_kernels, new_energy

STEP_FACTOR = 0.9  # of the critical time step
STEADY, HALVINGS, HALVING = 256, 8, 96  # steps at a steady rate; then number of halvings, and steps over each
LATE = 4 * HALVING  # last steps, over which the range of V is recorded
FAR, FARTHEST = 64.0, 256.0  # least and greatest travel of a push, in elastic displacements at the present load
NEAR = 0.02  # out-of-balance over joint forces below which Newton's method is tried
CHUNK = 32  # steps between two checks for signals
STEPS = STEADY + HALVINGS * HALVING


class Pushed(NamedTuple):
    """Outcome of a push: V at its end, its least and greatest value in the last part (N), the driven displacement (m),
    the motion of the free blocks (6 f,) and of the joints (j, 6) in that part, and energies (J): work of the actuators,
    and dissipation by friction and by dashpots."""

    V: float
    least: float
    greatest: float
    driven: float
    motion: np.ndarray
    slip: np.ndarray
    external: float
    friction: float
    lost: float


class DrivenRelaxation:
    """Pushes ``state`` on by its actuators; ``factor``: of its elastic stiffness; ``slope`` (N/m): elastic slope of V
    against the driven displacement. ``pushed``: outcome of the last push; ``seconds`` of all pushes, and
    ``compile_seconds``."""

    pushed: Pushed

    def __init__(self, state: State, factor: Factors, slope: float):
        self.state, self.slope, self._factor = state, slope, factor
        self.seconds = self.compile_seconds = 0.0
        # with the actuator no mode is faster than sqrt(2): its stiffness is that of the structure against the load
        self.dt = STEP_FACTOR * critical_time_step(math.sqrt(2.0), VISCOUS)

    @cached_property
    def inertia(self) -> ScaledInertia:
        """Inertia equal to the elastic stiffness of the structure."""
        none = np.zeros((0, 6, 6))
        return ScaledInertia(none, none, rounded_inertia(self._factor))

    def push(self, search: Equilibria, way: PathState) -> float:
        """V after a push from the last equilibrium of ``way``, by about the inelastic displacement so far.

        The result is the equilibrium nearby, if there is one; else the remaining out-of-balance reduces the lower
        bound. Raises DivergedError.
        """
        state = self.state
        search.attempt(way.motion, way.V)
        elastic = max(way.V / self.slope, way.elastic)
        far = min(max(FAR * elastic, way.seen[-1][0]), FARTHEST * elastic)
        pushed = self.pushed = self.drive(far, search.motion, search.pause)
        search.remember()
        way.pushes, way.step = way.pushes + 1, pushed.driven - way.driven
        way.friction, way.lost = way.friction + pushed.friction, way.lost + pushed.lost
        weights = float(np.abs(state.actuators.weight).sum())
        way.external += pushed.external - 0.5 * (way.V + pushed.V) * way.step * weights
        motion, V, found = search.motion(), pushed.V, None
        search.attempt(motion, V)
        if search.out_of_balance() <= NEAR:
            found, way.tried = search.find(motion, V)
            way.iterations = search.iterations
        if found is None:
            search.attempt(motion, V)
        return V if found is None else found

    def _advance(self, step: int, steps: int, state: KernelState, drive: Drive, energy: Energy) -> None:
        """Advance by so many ``steps``, without any guard."""
        advance(step, steps, self.dt, state, self.inertia, None, drive, None, None, energy, None)

    def show_what_moves(self, rows: np.ndarray) -> None:
        """Store the motion of the last part of the push, which is that of the mechanism, in the state; ``rows`` (f, 6):
        of the free blocks in the equations."""
        blocks, joints, moved = self.state.blocks, self.state.joints, self.pushed.motion[rows]
        joints.step[:], joints.tilt[:] = self.pushed.slip[:, [0, 1, 5]], self.pushed.slip[:, 3:5]
        blocks.velocity[blocks.free], blocks.spin[blocks.free] = moved[:, :3], moved[:, 3:]

    def drive(self, distance: float, motion: Callable[[], np.ndarray], pause: Callable[[], None]) -> Pushed:
        """Drive the actuators on by about ``distance`` (m) from the present equilibrium.

        ``motion`` returns that of the free blocks; ``pause`` is called after every chunk. Raises DivergedError.
        """
        state, dt = self.state, self.dt
        blocks, now = state.blocks, state.actuators.driven[0]
        blocks.velocity[:] = blocks.spin[:] = 0.0
        began, V = float(now.displacement), float(now.load)
        now.head = began + V / self.slope
        slowing = 0.5 ** (1.0 / HALVING)
        rate = distance / (STEADY + 1.0 / (1.0 - slowing)) / dt
        drive = steady_drive(rate, dt, self.slope)._replace(steady=STEADY, slowing=slowing)
        energy = new_energy(state)
        whole, peak = for_kernels(state), (float(now.peak), float(now.peak_at))
        started = time.perf_counter()
        self._advance(1, 0, whole, drive, energy)  # no step: compiles, or loads the cache
        ready = time.perf_counter()
        before, seen = motion(), state.joints.relative.copy()
        for step in range(0, STEPS, CHUNK):
            if step == STEPS - LATE:
                now.greatest, now.least = -NEVER, NEVER
                before, seen = motion(), state.joints.relative.copy()
            self._advance(step, CHUNK, whole, drive, energy)
            if not (math.isfinite(now.load) and np.isfinite(blocks.velocity).all()):
                raise DivergedError("driven relaxation diverged; please report this scenario")
            pause()
        greatest, least = float(now.greatest), float(now.least)
        now.peak, now.peak_at = peak
        self.compile_seconds += ready - started
        self.seconds += time.perf_counter() - ready
        work, weights = energy.work[0], float(np.abs(state.actuators.weight).sum())
        spring = 0.5 * weights / self.slope * (float(now.load) ** 2 - V**2)
        return Pushed(
            V=float(now.load),
            least=least,
            greatest=greatest,
            driven=float(now.displacement),
            motion=motion() - before,
            slip=state.joints.relative - seen,
            external=float(work.head - work.actuator_damping - spring),
            friction=float(work.sliding),
            lost=float(work.damping),
        )
