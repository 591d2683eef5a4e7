"""A run in real time as a Python loop: the state at intervals, loads set in the loop, an end at any time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dembrick.assembly.actuators import Attached
from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.kernels.dynamics.loop import REACHED, Limits
from dembrick.runs.reading import load
from dembrick.scenario.checks import real, require, show
from dembrick.scenario.model import Scenario
from dembrick.simulation.dynamics import loads as loads_of
from dembrick.simulation.dynamics import run
from dembrick.simulation.dynamics.checkpoint import RunHistory
from dembrick.simulation.dynamics.integrator import NO_LIMIT, advance, present_velocities
from dembrick.simulation.dynamics.state import joint_resultants
from dembrick.simulation.session import Session

Forces = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Step:
    """The state of n blocks at a ``time`` (s), seen from the supports: SI units, world axes.

    ``position``, ``displacement`` from the start, ``velocity`` and ``spin`` (n, 3) of the centroids in the order of
    ``names``, ``orientation`` (n, 4) quaternions (w, x, y, z); ``load`` as in the record of such a run;
    ``joint_forces`` (j, 7): N, V_1, V_2, M_T, M_1, M_2 and slip of each joint.
    """

    time: float
    load: float
    names: tuple[str, ...]
    position: np.ndarray
    displacement: np.ndarray
    orientation: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    joint_forces: np.ndarray

    def of(self, name: str) -> int:
        """The row of a block; ScenarioError if there is none of that name."""
        if name not in self.names:
            raise ScenarioError(f"there is no block {show(name)}")
        return self.names.index(name)


def steps(
    scenario: Scenario | str | os.PathLike,
    every: float,
    loads: Callable[[Step], Forces | None] | None = None,
) -> Iterator[Step]:
    """Run a scenario in real time; yield its state at the start and then every ``every`` seconds (whole time steps).

    ``loads`` is called with each state and returns forces on the centroids of free blocks (N, by name), which act
    until the next state; blocks that it leaves out have none. Leave the loop to end the run early; a tilt ends by
    itself when a block has moved by ``control.displacement``. Nothing is written. Raises ScenarioError for a control
    that is not in real time, and the errors of a run.
    """
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    control = scenario.control
    if control.regime.quasi_static or control.push_direction is not None:
        raise ScenarioError(
            f"steps need a run in real time, but control kind {show(control.kind)} is a search for equilibria; use "
            "kind dynamic or base-motion, or a tilt with quasi_static = false"
        )
    every = real("every", every)
    require(every > 0.0, "every", every, "it must be longer than 0 s")
    return _iterate(scenario, every, loads)


def _iterate(scenario: Scenario, every: float, loads) -> Iterator[Step]:
    assembly, control = assemble(scenario), scenario.control
    moving = run.prepare(assembly, control, scenario.solver.step_factor)
    driving = loads_of.driving_of(scenario, moving)
    own = len(driving.at)
    if loads is not None:
        free = np.flatnonzero(~np.asarray(assembly.fixed))
        driving = replace(
            driving,
            at=driving.at.and_then(Attached.to(assembly, free, np.zeros((len(free), 3)))),
            force=np.concatenate([driving.force, np.zeros((len(free), 3))]),
            factor=(*driving.factor, *[None] * len(free)),
        )
        rows = {assembly.names[block]: own + k for k, block in enumerate(free)}
    run.ask_for(moving, scenario.output, driving)
    run.start(moving, control, driving, RunHistory(moving, None), Session())
    total = run.most_steps(moving, control, None, driving)
    goal = NO_LIMIT if control.furthest is None else control.furthest
    limits = Limits(displacement=goal, longest=0.1 * float(moving.state.bodies.reach.min()))
    stride, status = max(1, round(every / moving.time_step)), None
    while True:
        step = _state_of(moving, driving)
        yield step
        if moving.steps >= total or status == REACHED:
            return
        if loads is not None:
            force = driving.force.copy()
            force[own:] = 0.0
            for name, given in _forces(loads(step)).items():
                if name not in rows:
                    raise ScenarioError(f"loads name {show(name)}, which is not a free block")
                force[rows[name]] = given
            driving = replace(driving, force=force)  # a new object: the old one may hold loads found ahead
        status = advance(moving, driving, min(stride, total - moving.steps), limits)


def _forces(given) -> dict[str, np.ndarray]:
    """Checked forces of a callback: three finite numbers (N) per block, else ScenarioError."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ScenarioError(f"loads returned {_shown(given)}; it must return a table of forces by block name, or None")
    found = {}
    for name, force in given.items():
        try:
            numbers = np.array(force)
        except ValueError:  # lists of lists of different lengths
            numbers = np.zeros(0)
        if numbers.dtype.kind not in "iuf" or numbers.shape != (3,) or not np.isfinite(numbers).all():
            raise ScenarioError(
                f"loads gives block {show(name)} the force {_shown(force)}; it must be three numbers (N): x, y and z"
            )
        found[name] = numbers.astype(float)
    return found


def _shown(value) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _state_of(moving, driving) -> Step:
    bodies, assembly = moving.state.bodies, moving.assembly
    moved = bodies.position - (assembly.position - moving.state.middle)
    velocity, spin = present_velocities(moving, driving)
    return Step(
        time=moving.time,
        load=driving.load(moving.time, moving.time_step),
        names=tuple(assembly.names),
        position=assembly.position + moved,
        displacement=moved,
        orientation=bodies.orientation.copy(),
        velocity=velocity,
        spin=spin,
        joint_forces=joint_resultants(moving.state),
    )
