"""The actuators of a scene as one load system, and its setup on the dead-load equilibrium."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.state import Energy
from dembrick.kernels.statics.load_bounds import Certificate
from dembrick.kernels.statics.loop import Drive
from dembrick.scenario.checks import show
from dembrick.scenario.controls import Control
from dembrick.scenario.model import Output
from dembrick.simulation.channels import Sizes, bytes_of, recorded
from dembrick.simulation.expected_cost import loop_seconds
from dembrick.simulation.session import Plan, Session
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.critical_step import Dashpots, block_inertia, dashpots
from dembrick.simulation.statics.elastic_factor import elastic_factor, touches_itself
from dembrick.simulation.statics.handover import starting_state
from dembrick.simulation.statics.paths.limit_state import carrying
from dembrick.simulation.statics.recorder import Ended
from dembrick.simulation.statics.rest.dead_load import dead_load_equilibrium
from dembrick.simulation.statics.state import State, load_vectors, zero_actuators
from dembrick.simulation.statics.stepper import Loop
from dembrick.simulation.statics.stiffness import held_stiffness
from dembrick.simulation.statics.yield_point import YieldPoint, carried_by, certificate, in_equilibrium, read_off

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

# Numerical choices; results do not depend on them beyond the tolerance, as a test verifies.
VISCOUS = 0.5  # dashpot force over spring force for the same increment, in contacts and actuator, while searching
ACTUATOR_STIFFNESS = 1.0  # stiffness of the actuator over that of the joints along the load
MEAN_WEIGHT = 1.0 / 16.0  # of the latest step in the running mean of a block's velocity
RAMP = 8  # steps over which the head accelerates
MOST_STEPS_AT_RATE = 2_000_000_000  # of a constant-rate test
FINEST = 0.25  # longest move of the head in a step of such a test, over the elastic displacement at friction 1


class After(NamedTuple):
    """End of a path beyond its limit: the blocks that move there, their mechanism, the greatest displacement since the
    dead-load equilibrium (m), and the load there."""

    blocks: tuple[int, ...]
    mechanism: str
    displacement: float
    load: float


@dataclass
class Replay(Ended):
    """A finished search or test: the yield point, the state at the limit, settings that the program chose, and
    computing times (s).

    ``left``: the final state, if that is another; ``after``: the motion there, if other blocks move than at the limit;
    ``critical_time_step``: None for a sequence of equilibria, in which no time passes.
    """

    yield_point: YieldPoint
    state: State
    converged: bool
    steps: int
    time_step: float
    critical_time_step: float | None
    simulated_time: float | None
    unbalanced: float
    compile_seconds: float
    loop_seconds: float
    energy: Energy | None = None
    settings: dict = field(default_factory=dict)
    moved: np.ndarray | None = None  # (n, 3) m, since the dead-load equilibrium
    left: State | None = None  # final state
    reached: State | None = None  # of rocking convex joints: the first state that carried nearly the limit load
    after: After | None = None
    phases: dict | None = None  # s, of the loop, if it was timed by phase
    turns: tuple[int, ...] | None = None  # rows at which the segments of a protocol end
    broke: bool = False  # of a constant-rate test: whether bonds broke, in an order that may depend on the rate


class LoadSystem:
    """The actuators as one load system: unit load, compliance of the joints against it, actuator stiffness."""

    def __init__(self, assembly: Assembly, session: Session | None = None):
        if not len(assembly.actuators.at):
            raise ScenarioError("no [[actuators]]: the test needs at least one")
        self.assembly = assembly
        self.state = starting_state(assembly, *((session.start, session.ties_before) if session else (None, None)))
        blocks = self.state.blocks
        pressed = blocks.dead_force[blocks.free].any() or blocks.dead_torque[blocks.free].any()
        if not (pressed or joint_families.has_strengths(self.state)):
            raise ScenarioError(
                "gravity is zero and there are no [[loads]], so nothing presses the joints and friction carries "
                "nothing: give gravity, or loads that press"
            )
        self.stiffness = held_stiffness(assembly, self.state)
        self.load = load_vectors(self.state)
        self.weight = float(np.abs(self.state.actuators.weight).sum())
        loaded = sorted(set(self.state.actuators.block.tolist()) & set(self.state.blocks.free.tolist()))
        if not len(loaded):
            raise ScenarioError("every actuator pushes a fixed block, so nothing can move; let one push a free block")
        load = self.load[loaded]
        self.compliance = float((load * np.linalg.solve(self.stiffness[loaded], load[..., None])[..., 0]).sum())
        if not self.compliance > 0.0:
            pushed = load_vectors(self.state, guides=False)[loaded].any(axis=1)
            if pushed.any():
                block = show(assembly.names[loaded[int(pushed.argmax())]])
                raise ScenarioError(
                    f"the actuators push block {block} only against its guide, so nothing limits them: turn one, or "
                    "free the guided direction"
                )
            raise ScenarioError("the actuators cancel out: together they push and twist no block; check directions")
        self.actuator_stiffness = ACTUATOR_STIFFNESS * self.weight / self.compliance
        # the actuator as a bound on the stiffness of each loaded block
        self.actuator = np.zeros_like(self.stiffness)
        self.actuator[loaded] = len(loaded) * self.actuator_stiffness / self.weight * load[:, :, None] * load[:, None]

    def dashpots(self) -> Dashpots:
        """Dashpots for physical inertia, with the critical time step that includes them and the actuator."""
        return dashpots(self.state, block_inertia(self.assembly), self.actuator)

    def plan(self, dt: float, steps: int, rows: int, control: Control, output: Output, exact: bool = False) -> Plan:
        """Plan of ``steps`` of ``dt`` (s) that write so many ``rows``."""
        sizes, fields = Sizes.of(self.assembly), recorded(self.assembly, output.channels, control)
        memory = 8 * (96 * sizes.block + 90 * sizes.joint + 12 * sizes.point)
        memory += bytes_of(fields, rows, min(rows, output.frames))
        seconds = loop_seconds(steps, sizes.joint, sizes.point)
        return Plan(dt, self.dashpots().critical_time_step, steps, memory, seconds, exact)

    def dead_strength(self) -> float:
        """Rough V (N) that friction 1 would resist under the dead loads at the joints of the loaded blocks."""
        joints, assembly = self.state.joints, self.assembly
        normal = np.abs(np.einsum("ji,ji->j", assembly.joint_force, joints.axes[:, 2]))
        at = np.isin(joints.block_a, self.state.actuators.block) | np.isin(joints.block_b, self.state.actuators.block)
        lever = max(float(np.linalg.norm(arm, axis=1).max()) for arm in (joints.arm_a, joints.arm_b))
        unit = np.linalg.norm(self.load[:, :3], axis=1).max() + np.linalg.norm(self.load[:, 3:], axis=1).max() / lever
        return float(normal[at].sum()) / float(unit)

    def time_step(self, most: float, rate: float) -> float:
        """``most`` (s), or less if the head would outrun the elastic displacement of the joints: blocks would jump."""
        give = self.dead_strength() * self.compliance / self.weight
        return min(most, FINEST * give / rate) if give > 0.0 else most


class Setup(LoadSystem):
    """The load system on the dead-load equilibrium, with the certificate of its limit load.

    ``by_equilibria``: whether the search follows a path of equilibria, which needs the ``factor`` of the elastic
    stiffness.
    """

    def __init__(
        self, assembly: Assembly, tolerance: float, session: Session | None = None, by_equilibria: bool = False
    ):
        super().__init__(assembly, session)
        whole = by_equilibria or touches_itself(self.state)
        self.factor = elastic_factor(self.state, assembly.position) if whole else None
        found = dead_load_equilibrium(self.state, self.stiffness, assembly, self.factor, session)
        if self.state.ties is not None:  # some may be slack
            self.factor = elastic_factor(self.state, assembly.position)
        self.unbalanced = found.unbalanced
        self.compile_seconds, self.loop_seconds = found.compile_seconds, found.loop_seconds
        self.displacement_at_start = self.state.blocks.displacement.copy()
        zero_actuators(self.state)
        self.certificate: Certificate = certificate(
            self.state, self.load, self.actuator_stiffness / ACTUATOR_STIFFNESS, tolerance
        )

    def finished(self, converged: bool, loop: Loop, critical: float, compiled: float, settings: dict) -> Replay:
        """Result of the search or test; ``compiled``: seconds of compiling after the dead-load equilibrium."""
        point, state = read_off(loop.state, loop.certificate, self.assembly.names, loop.inertia is not None), loop.state
        if loop.inertia is None and point.V is not None:
            state = carrying(state, point.V)
            point = replace(carried_by(point, state), limit_at=loop.step * loop.dt, actuator_load=point.V)
        elif loop.certificate.strict and point.bracket == "certified":
            point = in_equilibrium(point, loop.certificate)
        return Replay(
            yield_point=point,
            state=state,
            left=loop.state,
            converged=converged,
            steps=loop.step,
            time_step=loop.dt,
            critical_time_step=critical,
            simulated_time=loop.step * loop.dt,
            unbalanced=self.unbalanced,
            compile_seconds=self.compile_seconds + compiled,
            loop_seconds=self.loop_seconds + loop.seconds,
            energy=loop.energy,
            settings=settings,
            moved=loop.state.blocks.displacement - self.displacement_at_start,
        )

    @staticmethod
    def settings(drive: Drive) -> dict:
        """Settings that the program chose, for the history file."""
        return {
            "actuator_stiffness": drive.stiffness,
            "jack_dashpot": drive.dashpot,
            "contact_dashpot_ratio": drive.viscous_s,
            "ramp": drive.ramp,
        }


def steady_drive(rate: float, dt: float, stiffness: float) -> Drive:
    """The load system driven at a steady ``rate`` in steps of ``dt``, with the ``stiffness`` (N/m) of the actuators and
    the dashpots of a search."""
    return Drive(
        rate=rate,
        ramp=RAMP * dt,
        steady=MOST_STEPS_AT_RATE,
        slowing=1.0,
        stiffness=stiffness,
        dashpot=VISCOUS * stiffness * dt,
        viscous_n=VISCOUS,
        viscous_s=VISCOUS,
        damping=0.0,
        mean_weight=MEAN_WEIGHT,
        until=np.zeros(0, np.int64),
        ways=np.zeros(0),
    )


def rough_strength(state: State, certificate: Certificate, load: np.ndarray) -> float:
    """Scale of V (N), to a factor of a few: the load that slides and twists the joints of the loaded blocks."""
    loaded = set(state.actuators.block.tolist())
    joints = state.joints
    own = np.isin(joints.block_a, list(loaded)) | np.isin(joints.block_b, list(loaded))
    carried = np.maximum(joint_families.friction(state), 1e-3) * joints.resultant[:, 0]
    capacity = float((carried + joint_families.greatest_strength(state))[own].sum())
    unit = certificate.unit
    if np.any(unit):
        return capacity / (float(np.hypot(unit[0], unit[1])) + abs(float(unit[2])) / certificate.radius)
    lever = max(float(np.linalg.norm(arm, axis=1).max()) for arm in (state.joints.arm_a, state.joints.arm_b))
    forces = np.linalg.norm(load[:, :3], axis=1).max() + np.linalg.norm(load[:, 3:], axis=1).max() / lever
    return capacity / float(forces)
