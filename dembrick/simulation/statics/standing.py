"""Whether a structure stands under its dead loads: one equilibrium, no actuator (`find_rest`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.expected_cost import STATICS_STEPS, relaxation_seconds
from dembrick.simulation.session import Plan, Session
from dembrick.simulation.statics.dead_load import Rest, rest
from dembrick.simulation.statics.elastic_factor import elastic_factor, equations, touches_itself
from dembrick.simulation.statics.handover import starting_state
from dembrick.simulation.statics.reactions import Ended
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.stiffness import block_stiffness

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


@dataclass
class Standing(Ended):
    """Result of a search for rest: `Rest`, the state in which it ended, and seconds of compiling and of relaxing."""

    rest: Rest
    state: State
    settings: dict
    compile_seconds: float
    loop_seconds: float
    energy = None
    yield_point = None  # no load was increased
    phases = None


def find_rest(assembly: Assembly, session: Session) -> Standing:
    """The equilibrium of an assembly under its dead loads, the blocks that fall, or neither; recorded in one row."""
    state = starting_state(assembly, session.start, session.ties_before)
    factor = elastic_factor(state, assembly.position) if touches_itself(state) else None
    found = rest(state, block_stiffness(state, shared=2.0), assembly.position, factor, session)
    if session.observe is not None:
        recorder = Recorder(state, session, 1, 1, 1, assembly.control_points)
        recorder.write_equilibrium(state, 0, None, 0.0, np.zeros(2))
        recorder.drain()
    return Standing(found, state, {"steps": found.steps}, found.compile_seconds, found.loop_seconds)


def plan(assembly: Assembly) -> Plan:
    """The plan of it, without running any of it."""
    n, j = len(assembly.names), len(assembly.joints)
    points = sum(len(p.area) for p in assembly.contact_points if p is not None)
    memory = 8 * (100 * n + 100 * j + 12 * points)
    state = initial_state(assembly)
    if not touches_itself(state):
        return Plan(1.0, 1.0, 1, memory, relaxation_seconds(1, j))
    memory += equations(state, assembly.position).bytes(factors=1)
    return Plan(1.0, 1.0, STATICS_STEPS, memory, relaxation_seconds(STATICS_STEPS, j))
