"""How much of a load is inertia: a remark on rates at which a run in time shows more than what the joints carry.

A head that starts at the rate v against an actuator of stiffness k, with a mass m behind it, carries up to v sqrt(k m)
more than the joints do while the blocks take up its speed. What V_peak is above V is that at the most. The controller
of a pushover in real time adds v w / g to the load factor, w being the frequency of its spring. A table that tilts on
while blocks fall shows an angle beyond the onset.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dembrick.assembly.actuators import effective_mass
from dembrick.runs.result import Result
from dembrick.scenario.checks import present
from dembrick.scenario.controls import CONSTANT_RATE, EVERY_BLOCK, REAL_TIME
from dembrick.views.summary import known

REMARKED = 0.05  # of V


def inertia_remark(result) -> str | None:
    """A sentence for a run whose load is inertia by more than ``REMARKED`` of V; None for all others."""
    control = result.scenario.control
    share = inertia_share(result)
    if share is None or not share > REMARKED:
        return None
    unit = "deg/s" if control.tilt_axis is not None else "m/s"
    part = f"{100.0 * share:.2g} % of V" if share < 1.0 else f"{known(share, 0.1 * share)} times V"
    return (
        f"control.rate = {control.rate:g} {unit} is fast: inertia carries about {part} while blocks speed up; lower it"
    )


def inertia_share(result) -> float | None:
    """The load of inertia over V, at its greatest; None if no load is driven at a rate."""
    control: Any = result.scenario.control
    if isinstance(result, Result) and control.regime is CONSTANT_RATE:
        V, peak = result.yield_point.V, result.yield_point.V_peak
        stiffness = result.run.settings["actuator_stiffness"]
        most = control.rate * math.sqrt(stiffness * effective_mass(result.assembly))
        return min(most, peak - V) / V if V else None
    drives = control.drives == EVERY_BLOCK and control.regime is REAL_TIME
    collapse = result.collapse if drives else None
    if collapse is None or not collapse["load_factor"] > 0.0:
        return None
    if control.tilt_axis is not None:
        return 1.0 - math.tan(math.radians(collapse["onset"])) / collapse["load_factor"]
    g = float(np.linalg.norm(result.scenario.gravity))
    return present(control.rate) * math.sqrt(g / present(control.displacement)) / g / collapse["load_factor"]
