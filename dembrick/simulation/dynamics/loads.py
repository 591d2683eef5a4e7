"""Loads of a dynamic run as functions of time: gravity, dead loads, and the motion of the supports.

The run is computed in the frame of the supports. A tilting table turns gravity and the loads the other way (its rate is
low, so accelerations from its rotation are neglected); shaking supports apply their reversed acceleration to
every block. Shaken supports enter by the velocity they gain in each step, so that a history is integrated exactly,
including jumps. Settling supports move in that frame. Pressures follow the present faces, those of fluids by
the present height of each point: on a tilting table, its height in the world; a fluid moves with supports that
shake. `driving_of` reads the CSV files of a scenario.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.assembly.actuators import NO_VECTORS, NOWHERE, Attached
from dembrick.assembly.surface_pressures import NO_POLYGONS, PressurePolygons
from dembrick.errors import ScenarioError
from dembrick.kernels.dynamics.block_loads import PressedFaces
from dembrick.kernels.dynamics.loop import Loads
from dembrick.scenario.regimes import ACTUATORS, EVERY_BLOCK, REAL_TIME
from dembrick.scenario.support_controls import BaseMotionControl
from dembrick.scenario.text_files import require_file
from dembrick.simulation.dynamics import time_histories
from dembrick.simulation.dynamics.paths.driven_loads import NO_HEAD, DrivenLoads, Head
from dembrick.simulation.dynamics.support_motion import AT_REST, PrescribedMotion, SupportMotion, support_motion
from dembrick.simulation.dynamics.time_histories import Curve

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario
    from dembrick.simulation.dynamics.integrator import Motion

NOTHING_MOVES = AT_REST.between(np.zeros(1), 1.0)
AHEAD = 512  # steps whose loads are computed together
SLIGHT = 1 << 16  # (loads and moving supports) x steps up to which loads are computed ahead
OF_STEPS = "force", "gravity", "multiplier", "height"  # fields of `Loads` with an entry per step
OF_SUPPORTS = "place", "orientation", "velocity", "spin", "moved"  # and those of moving supports
RESOLVED = 10.0  # least number of time steps in the period of a load


@dataclass(frozen=True)
class Driving:
    """Gravity (3,), loads and the motion of the supports.

    ``force`` (k, 3; N, world) of the loads at the points ``at``, ``factor``: a curve for each or None. ``tilt``:
    axis, and a curve of the angle, rad. ``support_velocity``: directions (3,), and curves of the speed along them,
    m/s; the record shows the acceleration along the first. ``supports``: those that move relative to the others, and
    ``share``: share of their paths as a function of time. ``driven``: the load system whose ``multiplier`` V, a
    function of time, a load path increases; the forces of its jacks are the last of the loads, except for a
    table, which tilts to atan(V); ``head``: actuator head for which the loop finds V. ``pressed``: faces under
    pressures; ``middle`` (3,): the world point from which positions are measured, m. ``constant``: whether nothing
    depends on time.
    """

    gravity: np.ndarray
    at: Attached = NOWHERE
    force: np.ndarray = field(default_factory=NO_VECTORS.copy)
    factor: tuple[Curve | None, ...] = ()
    tilt: tuple[np.ndarray, Curve] | None = None
    support_velocity: tuple[tuple[np.ndarray, Curve], ...] = ()
    supports: SupportMotion = AT_REST
    share: Curve = np.zeros_like
    driven: DrivenLoads | None = None
    multiplier: Curve = np.zeros_like
    head: Head | None = None
    pressed: PressurePolygons = NO_POLYGONS
    middle: np.ndarray = field(default_factory=lambda: np.zeros(3))
    constant: bool = False

    @property
    def start(self) -> np.ndarray:
        """Positions of the points of the load system before V grows (k, 3), m; empty without one."""
        return self.force[:0] if self.driven is None else self.driven.start

    @property
    def n_load(self) -> int:
        """Number of forces and pressed polygons: each has its own row in the energy balance."""
        return len(self.at) + len(self.pressed.block)

    @property
    def by_time_alone(self) -> bool:
        """Whether loads and gravity depend on time alone, and no support moves."""
        return self.tilt is None and self.driven is None and not len(self.supports)

    def is_slight(self, steps: int) -> bool:
        """Whether the loads of so many ``steps`` are cheap to compute ahead, and the loop does not find V itself."""
        return self.head is None and steps * (1 + len(self.at) + len(self.supports)) <= SLIGHT

    @cached_property
    def _faces(self) -> PressedFaces:
        pressed = vars(self.pressed)
        return PressedFaces(**pressed, wrench=np.zeros((len(self.pressed.block), 6)))

    def loads(self, times: np.ndarray, dt: float, supports: PrescribedMotion | None = None) -> Loads:
        """Arguments of the loop for the steps at ``times`` (s,); ``supports``: their motion, if known."""
        gravity, force = self.forces(times, dt)
        supports = self.prescribed(times, dt) if supports is None else supports
        return Loads(
            np.zeros(1, np.int64),
            self.at.block,
            self.at.lever,
            force,
            gravity,
            *supports,
            self._faces,
            self.multiplier(times),
            self.height(times),
            NO_HEAD if self.head is None or self.driven is None else self.head.at(times, self.driven, self._faces),
        )

    def height(self, times: np.ndarray) -> np.ndarray:
        """Coefficients (h_1, h_2, h_3, h_0) (s, 4) of the height h x + h_0 of a point x, measured from the middle of
        the scene; a tilting table turns the vertical, in its frame, the other way."""
        up = np.repeat([[0.0, 0.0, 1.0]], len(times), axis=0)
        if self.tilt is not None:
            axis, angle = self.tilt
            up = turned_back(up, axis, np.cos(angle(times))[:, None], np.sin(angle(times))[:, None])
        return np.column_stack([up, up @ self.middle])

    def forces(self, times: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Gravity (s, 3) in m/s2 and load forces (s, k, 3) in N for the steps at ``times`` (s,)."""
        gravity, force = (np.repeat(vectors[None], len(times), axis=0) for vectors in (self.gravity, self.force))
        for k, curve in enumerate(self.factor):
            if curve is not None:
                force[:, k] *= curve(times)[:, None]
        if self.tilt is None and self.driven is not None:
            force[:, len(self.factor) :] *= self.multiplier(times)[:, None, None]
        if self.tilt is not None:
            axis, angle = self.tilt
            cosine, sine = np.cos(angle(times)), np.sin(angle(times))
            gravity = turned_back(gravity, axis, cosine[:, None], sine[:, None])
            if len(self.at):
                force = turned_back(force, axis, cosine[:, None, None], sine[:, None, None])
        for direction, velocity in self.support_velocity:
            after, before = velocity(np.concatenate([times + 0.5 * dt, times - 0.5 * dt])).reshape(2, -1)
            gravity = gravity - ((after - before) / dt)[:, None] * direction
        return gravity, np.ascontiguousarray(force)

    def prescribed(self, times: np.ndarray, dt: float) -> PrescribedMotion:
        """The motion of supports in consecutive steps that begin at ``times`` (s,)."""
        if not len(self.supports):
            return NOTHING_MOVES
        return self.supports.between(self.share(np.append(times[:1], times + dt)), dt)

    def load(self, time: float, dt: float, gravity: np.ndarray | None = None) -> float:
        """Load in the record: the multiplier of a load system, load factor of a tilt, acceleration of shaken supports
        (m/s2), else zero. ``gravity`` (3,): at that time, if known."""
        if self.driven is not None:
            return float(self.multiplier(np.array([time]))[0])
        if self.tilt is not None:
            return math.tan(min(float(self.tilt[1](np.array([time]))[0]), math.radians(89.999)))
        if self.support_velocity:
            gravity = self.forces(np.array([time]), dt)[0][0] if gravity is None else gravity
            return float((self.gravity - gravity) @ self.support_velocity[0][0])
        return 0.0


class LoadsAhead:
    """Cache of loads computed ahead for many steps: a run of few blocks takes longer to find its loads than to step.

    Loads that depend on time alone are the same to the last bit however many are computed together, so more are
    computed than requested. Not so if supports move, a table tilts or a load path grows, nor for a new driving, which
    may be another one at the next call. If `Driving.constant`, loads are computed once.
    """

    def __init__(self) -> None:
        self._driving: Driving | None = None
        self._found: Loads | None = None
        self._first, self._dt = 0, 0.0

    def of(self, driving: Driving, first: int, count: int, dt: float) -> Loads:
        """Loads of ``count`` steps from the step ``first`` on, and perhaps of more; of fewer if only some of these
        steps are cached and loads do not depend on time alone."""
        known, self._driving = self._driving is driving and dt == self._dt, driving
        found, begin = self._found, 0 if driving.constant else first - self._first
        alone = known and driving.by_time_alone
        least = count if alone or driving.constant else 1
        if not known or found is None or not 0 <= begin <= len(found.gravity) - least:
            self._first, self._dt, begin = first, dt, 0
            steps = max(count, AHEAD) + 1 if alone else count
            found = self._found = driving.loads((first + np.arange(steps)) * dt, dt)
        if not begin:
            return found
        fields = OF_STEPS + OF_SUPPORTS if len(driving.supports) else OF_STEPS
        return found._replace(**{name: getattr(found, name)[begin:] for name in fields})

    def gravity(self, driving: Driving, step: int, dt: float) -> np.ndarray | None:
        """Gravity (3,) at the beginning of a step, None if it is not cached."""
        found, at = self._found, 0 if driving.constant else step - self._first
        if found is None or driving is not self._driving or dt != self._dt or not 0 <= at < len(found.gravity):
            return None
        return found.gravity[at]


def turned_back(vectors: np.ndarray, axis: np.ndarray, cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """``vectors`` (..., 3) in a frame that has turned about the unit ``axis`` (Rodrigues' formula)."""
    along = (vectors @ axis)[..., None] * axis
    x, y, z = axis
    beside = vectors @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # axis x v
    return along + cosine * (vectors - along) - sine * beside


def driving_of(scenario: Scenario, moving: Motion) -> Driving:
    """Gravity, loads and the motion of the supports from their present positions; ScenarioError if a history does not
    suit the run.

    Paths of files are relative to the scenario.
    """
    assembly, time_step = moving.assembly, moving.time_step
    control = scenario.control
    duration, place = control.duration, f"{scenario.path}: " if scenario.path else ""
    loads, given = assembly.point_loads, assembly.point_loads.given >= 0
    factors: dict[int, Curve | None] = dict.fromkeys(range(len(scenario.loads) + len(scenario.fills)))
    for index, load in enumerate(scenario.loads):
        if load.sine is not None:
            _refuse_unresolved(f"{place}load number {index + 1}: sine.frequency", load.sine.frequency, time_step)
            factors[index] = time_histories.sine(load.sine)
        if load.history is not None:
            path = require_file(scenario, f"history of load number {index + 1}", load.history)
            factors[index] = time_histories.linear(_samples(path, "factor", load.columns, duration, time_step))
    driving: dict[str, Any] = {
        "gravity": np.array(scenario.gravity, float),
        "at": loads.at[given],
        "force": loads.force[given],
        "factor": tuple(factors[index] for index in loads.given[given]),
        "pressed": assembly.pressed,
        "middle": moving.state.middle,
    }
    if control.tilt_axis is not None and control.regime is REAL_TIME:
        driving["tilt"] = (np.array(control.tilt_axis, float), lambda times: np.radians(control.rate) * times)
    if isinstance(control, BaseMotionControl):
        driving["support_velocity"] = tuple(
            (np.array(direction, float), _support_velocity(scenario, control, file, columns, time_step))
            for direction, file, columns in control.components
        )
    driving["supports"] = supports = support_motion(scenario, assembly, moving.state.bodies)
    if control.in_deformed_geometry and control.drives in (ACTUATORS, EVERY_BLOCK):
        driven = driving["driven"] = DrivenLoads.of(assembly, moving.state)
        if control.tilt_axis is None:
            jacks, force = driven.jacks
            driving["at"], driving["force"] = driving["at"].and_then(jacks), np.concatenate([driving["force"], force])
    if len(supports) and control.rate is not None:
        driving["share"] = lambda times: np.clip(control.rate / supports.length * times, 0.0, 1.0)
    return Driving(**driving)


def _support_velocity(
    scenario: Scenario, control: BaseMotionControl, file: str | None, columns, time_step: float
) -> Curve:
    """Velocity (m/s) of the supports along one direction."""
    if control.sine is not None:
        _refuse_unresolved("control.sine.frequency", control.sine.frequency, time_step)
        curve = time_histories.sine_velocity(control.sine, control.quantity)
    elif control.pulse is not None:
        curve = time_histories.pulse_velocity(control.pulse, control.quantity)
    else:
        path = require_file(scenario, "control.file", file)
        samples = _samples(path, control.quantity, columns, control.duration, time_step, may_end=True)
        if samples.time[-1] < control.duration:
            time_histories.must_end_at_rest(samples, control.quantity)
        if control.baseline:
            samples = time_histories.with_baseline(samples)
        curve = time_histories.sampled_velocity(samples, control.quantity)
    return lambda t: control.scale * curve(t)


def _refuse_unresolved(key: str, frequency: float, time_step: float) -> None:
    """ScenarioError if the frequency (Hz) under a ``key`` is too great for the time step (s)."""
    if 1.0 < RESOLVED * time_step * frequency:
        raise ScenarioError(
            f"{key} = {frequency:g} Hz has a period of {1.0 / frequency:.3g} s, too short for the time step of "
            f"{time_step:.3g} s; lower the frequency or solver.step_factor"
        )


def _samples(
    path: str, quantity: str, columns, duration: float, time_step: float, may_end: bool = False
) -> time_histories.Samples:
    samples = time_histories.read_samples(path, duration, quantity, columns, may_end)
    if samples.step < time_step:
        raise ScenarioError(
            f"{samples.path}: its step of {samples.step:.3g} s is shorter than the time step {time_step:.3g} s of "
            "the run, which would skip samples; resample the file, or lower solver.step_factor"
        )
    return samples
