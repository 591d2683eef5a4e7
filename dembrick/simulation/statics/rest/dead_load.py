"""Equilibrium under the dead loads, before any actuator moves: solved for directly, without inertia.

Relaxation with the elastic stiffness finds most equilibria in a few steps. If it fails, the blocks start again from
their initial positions by viscous motion (`viscous_rest`), which ends at rest or proves that they fall. If it shows
neither, the result is undecided.

`find_rest` decides whether a structure stands under its dead loads: one equilibrium, no actuator.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import NotConvergedError, UndecidedError, of_joint_forces
from dembrick.scenario.checks import listed
from dembrick.simulation import load_increments
from dembrick.simulation.expected_cost import STATICS_STEPS, relaxation_seconds
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.session import Plan, Session
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.elastic_factor import elastic_factor, equations, touches_itself
from dembrick.simulation.statics.handover import (
    carried,
    come_to_rest,
    depends_on_size,
    show_falling,
    starting_state,
)
from dembrick.simulation.statics.recorder import Ended, Recorder
from dembrick.simulation.statics.rest.relaxation import UNBALANCED, Relaxation
from dembrick.simulation.statics.sparse_equations import Factors
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.stiffness import elastic_motion_alone, held_stiffness
from dembrick.simulation.statics.yield_point import mechanism_of, moving_blocks

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


MOST_STEPS = 300  # of relaxation: if there is no equilibrium by then, viscous motion takes over
FIRST_STEPS = 30  # without momentum, for blocks on fixed ones
MOMENTUM = 0.9  # share of the last move that is kept, if blocks stand on free blocks
PRESSES = 1e-9  # of the dead load of a block: a joint with a smaller force counts as unloaded
DECIDES = (
    "dembrick limit decides it if no admissible forces balance the loads (it falls) or if nothing slides; softer or "
    "stiffer joints may decide it too"
)


@dataclass(frozen=True)
class Rest:
    """Result of a search for equilibrium under the dead loads: whether the blocks stand (None: undecided), the
    out-of-balance over the joint forces and the number of steps; the mechanism and the numbers of falling blocks;
    seconds of compiling and of relaxing; the number of load ``increments``, and the error of forces that this and the
    previous stages leave, over the greatest on a block (``path_error``) and in N (``force_error``); ``weakened``: with
    the present joint laws no equilibrium was found under the loads of the stage before.
    """

    stands: bool | None
    unbalanced: float
    steps: int
    mechanism: str | None
    blocks: tuple[int, ...]
    compile_seconds: float
    loop_seconds: float
    increments: int = 1
    path_error: float = 0.0
    force_error: float = 0.0
    weakened: bool = False


def dead_load_equilibrium(
    state: State,
    stiffness: np.ndarray,
    assembly: Assembly,
    factor: Factors | None = None,
    session: Session | None = None,
) -> Rest:
    """`rest` of blocks that must stand. Raises NotConvergedError, which names the blocks that fall, and UndecidedError
    if neither an equilibrium nor a fall is found."""
    found = rest(state, stiffness, assembly.position, factor, session)
    if found.stands is None:
        raise UndecidedError(f"{undecided(found)}; no actuator has moved yet. {DECIDES}")
    if not found.stands:
        raise NotConvergedError(
            f"{does_not_stand(found, assembly.names)} under the dead loads, before the test begins: on this path "
            f"{of_joint_forces(found.unbalanced)} stay out of balance, and only a built-in squeeze, as from "
            "pre-stress, could balance them. Check loads, friction and supports"
        )
    return found


def does_not_stand(found: Rest, names) -> str:
    """Message on which blocks fall, and by which mechanism."""
    moving = [names[i] for i in found.blocks]
    falls = "falls" if len(moving) == 1 else "fall"
    return f"does not stand: {listed(moving)} {falls} by {found.mechanism}"


def undecided(found: Rest) -> str:
    """Message on a search that neither finds an equilibrium nor a mechanism."""
    return (
        f"undecided under the dead loads: neither an equilibrium nor a mechanism of a fall was found in {found.steps} "
        f"steps; {of_joint_forces(found.unbalanced)} are still out of balance"
    )


def _own_law_undecided(state: State, steps: int, ratio: float) -> str:
    """Message on joints with a user-defined law for which relaxation finds no equilibrium."""
    blocks, pressing = state.blocks, float(np.abs(state.joints.resultant[:, :3]).max(initial=0.0))
    if pressing > PRESSES * float(np.abs(blocks.dead_force[blocks.free]).max(initial=0.0)):
        what, remedy = (
            f"{of_joint_forces(ratio)} are still out of balance",
            "a run without it decides for friction alone",
        )
    else:
        what = "no joint is compressed and forces are still out of balance"
        remedy = "compress the joints: use guides that are free along their normals, or loads and ties that lift less"
    return (
        f"undecided under the dead loads: after {steps} steps of relaxation {what}, and Newton's method, which would "
        f"decide it, cannot use a custom joint law; {remedy}"
    )


def rest(
    state: State,
    stiffness: np.ndarray,
    position: np.ndarray,
    factor: Factors | None = None,
    session: Session | None = None,
) -> Rest:
    """The equilibrium of ``state`` under its dead loads, or the mechanism by which it falls.

    The blocks are relaxed until the out-of-balance forces are ``UNBALANCED`` of the joint forces. If free blocks touch
    only fixed ones, each moves by the elastic response of its own ``stiffness`` (n, 6, 6) to its out-of-balance force:
    a single Newton step is usually enough. Otherwise the whole assembly moves by its elastic response, with the
    ``factor`` of its stiffness: first a plain step, then steps with momentum, which is dropped whenever it does
    negative work. If this fails, viscous motion starts again from the initial state; ``position`` (n, 3): centroids.
    ``session`` keeps checkpoints and may restart from one. Raises Interrupted, and UndecidedError if relaxation does
    not converge with a user-defined law.

    Joint forces are found in one implicit step, as if all loads grew together from zero. If joints carried other loads
    before and slide, or if bonds break, loads are applied in increments (`load_increments`). Bonds stay intact until
    the blocks rest; those that fail first then break, and the others must carry the loads without them.
    """
    blocks = state.blocks
    began, before = time.perf_counter(), 0.0 if session is None else session.force_error
    alone = not touches_itself(state)
    if not alone and factor is None:
        raise ValueError("free blocks that touch each other need the factor of their stiffness")
    bonded = joint_families.has_strengths(state)
    if bonded and not (blocks.dead_force.any() or blocks.dead_torque.any()):
        return Rest(True, 0.0, 0, None, (), 0.0, 0.0)  # bonds without loads
    carries, memory = bool(state.joints.relative.any()), SimpleNamespace(**joint_families.memory(state))
    # if a lone block does not come to rest at once, its joint has opened and is softer than the closed joint whose
    # stiffness each step uses
    rounds = ((FIRST_STEPS, 0.0), (MOST_STEPS, MOMENTUM)) if alone else ((MOST_STEPS, MOMENTUM),)
    answer = elastic_motion_alone(state, stiffness) if factor is None else factor.elastic_motion
    relaxation = Relaxation(state, answer, rounds, lambda: factor or elastic_factor(state, position))
    compiled = time.perf_counter()
    session = relaxation.session_of(session or Session())
    ratio, steps = relaxation.run(session)
    stands, mechanism, moving = not_nan(ratio, "the out-of-balance force under the dead loads") <= UNBALANCED, None, ()
    if not stands and not relaxation.over and not moving_blocks(state):
        stands, ratio = True, 0.0  # there is no force at all: no gravity and no loads
    if not stands and joint_families.is_custom(state):
        raise UndecidedError(_own_law_undecided(state, steps, ratio))
    if not stands:
        relaxation.start_again()
        stands, ratio, more = relaxation.by_viscous_motion(session)
        steps += more
    increments, error = 1, math.inf if relaxation.own_way else 0.0
    alike = not (bonded and joint_families.gave_way(state, memory)) and not depends_on_size(state)
    if carries or not alike:  # blocks that fall in one step may stand if loads are applied gradually
        increments, error, more = relaxation.by_increments(session, memory, bool(stands))
        steps += more
        if not stands and increments > 1:
            stands, ratio = True, relaxation.out_of_balance()
    if stands is False:
        mechanism, moving = mechanism_of(state), moving_blocks(state)
        show_falling(state)
    done = time.perf_counter()
    seconds = compiled - began, done - compiled
    if stands:
        come_to_rest(state)
    errors = load_increments.both_errors(error, before, float(np.abs(carried(state)).max(initial=0.0)))
    return Rest(stands, ratio, steps, mechanism, moving, *seconds, increments, *errors, relaxation.weakened)


@dataclass
class Standing(Ended):
    """Result of `find_rest`: `Rest`, the final state, and seconds of compiling and of relaxing."""

    rest: Rest
    state: State
    settings: dict
    compile_seconds: float
    loop_seconds: float
    energy = None
    phases = None


def find_rest(assembly: Assembly, session: Session) -> Standing:
    """The equilibrium of an assembly under its dead loads, the blocks that fall, or neither; recorded in one row."""
    state = starting_state(assembly, session.start, session.ties_before)
    stiffness = held_stiffness(assembly, state)
    factor = elastic_factor(state, assembly.position) if touches_itself(state) else None
    found = rest(state, stiffness, assembly.position, factor, session)
    load_increments.report_error(session.report, found.increments, found.path_error, found.weakened)
    if session.observe is not None:
        recorder = Recorder(state, session, 1, 1, 1, assembly.control_points)
        recorder.write_equilibrium(state, 0, 0.0, np.zeros(2), framed=True)
        recorder.drain()
    return Standing(found, state, {"steps": found.steps}, found.compile_seconds, found.loop_seconds)


def plan(assembly: Assembly) -> Plan:
    """Plan of `find_rest`, without running any of it."""
    n, j = len(assembly.names), len(assembly.joints)
    points = sum(len(p.area) for p in assembly.contact_points if p is not None)
    memory = 8 * (100 * n + 100 * j + 12 * points)
    state = initial_state(assembly)
    if not touches_itself(state):
        return Plan(1.0, 1.0, 1, memory, relaxation_seconds(1, j))
    memory += equations(state, assembly.position).bytes(factors=1)
    return Plan(1.0, 1.0, STATICS_STEPS, memory, relaxation_seconds(STATICS_STEPS, j))
