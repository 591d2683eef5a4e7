"""From a scenario to what drives its dynamic run; opens the CSV files that it names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.simulation.dynamics import time_histories
from dembrick.simulation.dynamics.driving import Driving

RESOLVED = 4.0  # time steps in the period of a load: fewer would make another load of it


def driving_of(scenario, assembly, time_step: float) -> Driving:
    """Gravity, loads and the motion of the supports; ScenarioError where a history is not fit for the run.

    A file is looked for beside the scenario.
    """
    control = scenario.control
    duration, place = getattr(control, "duration", 0.0), f"{scenario.path}: " if scenario.path else ""
    number = {name: i for i, name in enumerate(assembly.names)}
    blocks, levers, forces, factors = [], [], [], []
    for count, load in enumerate(scenario.loads, 1):
        factor = None
        if load.sine is not None:
            period = 1.0 / load.sine.frequency
            if period < RESOLVED * time_step:
                raise ScenarioError(
                    f"{place}load number {count}: sine.frequency = {load.sine.frequency:g} Hz swings in {period:.3g} "
                    f"s, and the time step is {time_step:.3g} s; lower the frequency, or solver.step_factor"
                )
            factor = time_histories.sine(load.sine)
        if load.history is not None:
            factor = time_histories.linear(_samples(scenario, load.history, duration, time_step))
        for block in scenario.groups.get(load.block) or (number[load.block],):
            arm = np.zeros(3) if load.point is None else np.array(load.point, float) - assembly.position[block]
            blocks.append(block)
            levers.append(assembly.rotation[block].T @ arm)
            forces.append(load.force)
            factors.append(factor)
    driving = {
        "gravity": np.array(scenario.gravity, float),
        "block": np.array(blocks, np.int64),
        "lever": np.array(levers, float).reshape(-1, 3),
        "force": np.array(forces, float).reshape(-1, 3),
        "factor": tuple(factors),
    }
    if control.kind == "tilt":
        driving["tilt"] = (np.array(control.axis, float), float(np.radians(control.rate)))
    if control.kind == "base-motion":
        driving["direction"] = np.array(control.direction, float)
        if control.sine is not None:
            driving["support_velocity"] = time_histories.sine_velocity(control.sine, control.quantity)
        elif control.pulse is not None:
            driving["support_velocity"] = time_histories.pulse_velocity(control.pulse, control.quantity)
        else:
            samples = _samples(scenario, control.file, duration, time_step)
            driving["support_velocity"] = time_histories.sampled_velocity(samples, control.quantity)
    return Driving(**driving)


def _samples(scenario, file: str, duration: float, time_step: float) -> time_histories.Samples:
    folder = Path(scenario.path).parent if scenario.path else Path()
    samples = time_histories.read_samples(folder / file, duration)
    if samples.step < time_step:
        raise ScenarioError(
            f"{samples.path}: its step of {samples.step:.3g} s is shorter than the time step {time_step:.3g} s of the "
            "run, which would step over samples; resample it, or lower solver.step_factor"
        )
    return samples
