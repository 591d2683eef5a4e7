"""Whether a structure stands under its dead loads: one equilibrium, no actuator (`find_rest`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.statics.energy import ELASTIC, elastic_energy
from dembrick.kernels.statics.record import write_row
from dembrick.simulation.expected_cost import STATICS_STEPS, relaxation_seconds
from dembrick.simulation.session import Plan, Session
from dembrick.simulation.statics import ties
from dembrick.simulation.statics.dead_load import Rest, rest
from dembrick.simulation.statics.elastic_factor import elastic_factor, equations, touches_itself
from dembrick.simulation.statics.handover import starting_state
from dembrick.simulation.statics.reactions import reactions
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.stiffness import block_stiffness

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


@dataclass
class Standing:
    """What was found: `Rest` and the state in which the search ended."""

    rest: Rest
    state: State
    settings: dict
    energy = None
    yield_point = None  # no load was increased
    phases = None

    @property
    def reactions(self) -> np.ndarray:
        """Of the supports (s, 6), see `statics.reactions`."""
        return reactions(self.state)

    @property
    def ties(self) -> tuple[np.ndarray, np.ndarray]:
        """Tension (t,) N of the ties at the end, and the elongation (t,) m that they keep."""
        return self.state.ties.tension, self.state.ties.yielded

    @property
    def compile_seconds(self) -> float:
        """Spent on compiling, or on loading what was compiled."""
        return self.rest.compile_seconds

    @property
    def loop_seconds(self) -> float:
        """Spent on the equilibrium."""
        return self.rest.loop_seconds


def find_rest(assembly: Assembly, session: Session) -> Standing:
    """The equilibrium of an assembly under its dead loads, or the blocks that fall; the record is its one row."""
    state = starting_state(assembly, session.start)
    factor = elastic_factor(state, assembly.position) if touches_itself(state) else None
    found = rest(state, block_stiffness(state, shared=2.0), factor, session)
    if session.observe is not None:
        recorder = Recorder(state, session, 1, 1, 1, assembly.control_points)
        energy = recorder.record.energy[0]
        energy[:] = 0.0
        energy[ELASTIC] = elastic_energy(state.joints, state.points, state.areas, None)
        blocks, joints, points, areas = state.blocks, state.joints, state.points, state.areas
        write_row(
            recorder.record, 0, 0.0, blocks, joints, points, areas, state.actuators, None, 0.0, 0.0, 0.0, 0.0, True
        )
        ties.write(state, recorder.record)
        recorder.drain()
    return Standing(found, state, {"steps": found.steps})


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
