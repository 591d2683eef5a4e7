"""The last equilibrium before a run in real time that follows a stage.

The laws of a stage hold from its beginning: joints that are too weak for what they bear give way first, under the loads
of the stage before (`stage_loads`). The loads that change with the stage act when time begins, at once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import NotConvergedError
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.scenario.controls import StaticsControl
from dembrick.scenario.model import Output
from dembrick.simulation.dynamics import checkpoint, run
from dembrick.simulation.dynamics.dead_load import find_equilibrium, keep, put_back, searching
from dembrick.simulation.dynamics.integrator import Motion, detect_initial_contacts
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.paths.load_path import LoadPath
from dembrick.simulation.dynamics.paths.stage_loads import PendingLoads, Wrenches
from dembrick.simulation.dynamics.support_motion import AT_REST
from dembrick.simulation.session import Kept, Session

if TYPE_CHECKING:
    from dembrick.scenario.stages import TiesBefore
    from dembrick.simulation.statics.state import State

FALL_FROM_THERE = (
    "with the joint laws of this stage no equilibrium was found under the loads of the stage before: the motion begins "
    "at the last equilibrium, and blocks move from there as joints give way at once"
)


class GivingWay(LoadPath):
    """Path of a single equilibrium: joints have given way to the laws of a stage whose loads do not act yet."""

    loads_wait = True

    def refuse_collapse_under_dead_loads(self, stood: Bodies) -> None:
        """The collapse is no error: it happens in real time."""
        self.stands = False


def begin_at_rest(moving: Motion, driving: Driving, session: Session, step_factor: float) -> None:
    """Bring the blocks of a run in real time to the last equilibrium before its loads ``driving``, from where the stage
    before has left them; reported if there is none with the joint laws of now. Raises Interrupted."""
    left, still, new = session.start, _at_time_zero(driving), None
    quiet = Session(output=Output(channels=()), tell=session.tell, report=session.report)
    if left is not None and not isinstance(left, Kept):
        new = unborne(moving, driving, left, session.ties_before)
        pending = _pending(moving, still, new)
        pending.shares = 0.0, 1.0
        past = run.RunHistory(moving, None)
        find_equilibrium(moving, pending.held_off(still), sticking=True, pause=lambda: quiet.pause(past))
        moving.settled = True
        moving.upright[:] = moving.state.bodies.orientation
    if _pending(moving, still, new).weakened:
        detect_initial_contacts(moving)
        last = Kept(run.RunHistory(moving, None).snapshot() | moving.contact_detection.snapshot())
        checkpoint.start_on(moving, _given_way(moving, still, new, last, step_factor, quiet) or last)


def _pending(moving: Motion, still: Driving, new: Wrenches | None) -> PendingLoads:
    """Forces that joints lose at the present positions, and loads that wait, without a trace in the joint history."""
    stood = keep(moving)
    with searching(moving):
        pending = PendingLoads(moving, still, new, wait=True)
    put_back(moving, stood)
    return pending


def _given_way(
    moving: Motion, still: Driving, new: Wrenches | None, last: Kept, step_factor: float, session: Session
) -> Kept | None:
    """State after joints have given way from the ``last`` equilibrium; None, and reported, if there is none."""
    control = StaticsControl(large_displacements=True)
    resting = run.prepare(moving.assembly, control, step_factor)
    checkpoint.start_on(resting, last)
    run.ask_for(resting, session.output, still)
    path = GivingWay(resting, control, still, session)
    path.new_loads = new
    try:
        path.begin(None)
    except NotConvergedError:
        path.stands = False
    if not path.stands and session.report is not None:
        session.report(FALL_FROM_THERE)
    return path.kept if path.stands else None


def _at_time_zero(driving: Driving) -> Driving:
    """Constant loads: those of time zero, with supports at rest."""
    _, force = replace(driving, tilt=None, support_velocity=()).forces(np.zeros(1), 1.0)
    none = (None,) * len(driving.factor)
    return replace(
        driving, force=force[0], factor=none, tilt=None, support_velocity=(), supports=AT_REST, constant=True
    )


def unborne(moving: Motion, driving: Driving, left: State, before: TiesBefore | None) -> Wrenches:
    """Forces (f, 3) and torques (f, 3) of the loads ``driving`` at time zero on the free blocks that joints and ties of
    ``left``, a state in the geometry of the start, do not bear: those that come or go with the stage after it."""
    from dembrick.simulation.statics import joint_families  # imported here for its kernels
    from dembrick.simulation.statics.handover import starting_state
    from dembrick.simulation.statics.newton import Trials

    state, at = starting_state(moving.assembly, left, before), driving.at
    trials = Trials(state, 6 * np.arange(len(state.blocks.free)))
    trials.remember()
    joint_families.keep_bonds_intact(state, True)
    with joint_families.stuck(state):
        trials.stay()
    varies = _at_time_zero(driving).force - driving.force  # statics has no time: there loads act in full
    force, torque = state.blocks.force.copy(), state.blocks.torque.copy()
    np.add.at(force, at.block, varies)
    np.add.at(torque, at.block, np.cross(at.arm, varies))
    return force[state.blocks.free], torque[state.blocks.free]
