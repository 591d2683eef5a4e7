"""Load systems that act on every block: a share of its weight sideways, and gravity that turns on a tilting table.

**Pushover.** Every free block is pushed at its centroid by V times its weight along a direction: V is the load factor.

**Tilt.** A table that has turned by psi about a horizontal axis a turns gravity, seen from the table, the other way: a
dead force F at right angles to a becomes cos(psi) F - sin(psi) a x F. Friction without cohesion and joints without
tension know no scale of force: blocks that carry cos(psi) times some loads carry these loads as well. Divided by
cos(psi), the loads of the tilted table are those of the level one with tan(psi) times -a x F on top, at the same
points. So a quasi-static tilt is a search for the limit V of that load system, and the table stands at atan(V) when the
blocks come down: that gravity's part along the joints' normals falls by cos(psi) is in it exactly. Pressures turn with
the faces of the table's blocks and not with gravity, so this search knows none; paths in the deformed geometry do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

_ALONG = 1e-9  # of a force: a part along the axis that is rounding


def load_system(scenario: Scenario, loads, position, mass, fixed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces of the load factor 1: block (k,), point (k, 3) in the world and force (k, 3), of a scenario of that kind.

    ``loads``: the dead loads besides gravity (:class:`dembrick.assembly.loads.PointLoads`); ``position`` (n, 3) of the
    centroids, ``mass`` and ``fixed`` (n,). Raises ScenarioError if nothing drives the blocks, or something that does
    not go with it is asked for.
    """
    control, free = scenario.control, np.flatnonzero(~fixed)
    if scenario.actuators:
        raise ScenarioError(f"control kind {show(control.kind)} has no use for [[actuators]]; remove them")
    if any(pressure.actuator for pressure in scenario.pressures):
        raise ScenarioError(
            f"control kind {show(control.kind)} drives no pressure: remove actuator = true, or take kind 'yield'"
        )
    if control.pushes_as_tilted and scenario.pressures:
        raise ScenarioError(
            "a quasi-static tilt turns loads as gravity, and [[pressures]] stay normal to the faces of blocks that "
            "tilt: use large_displacements = true, or a rate with quasi_static = false"
        )
    gravity = np.array(scenario.gravity, float)
    block, point = list(free), list(position[free])
    if control.push_direction is not None:
        force = list(pushed(control.push_direction, gravity, mass[free]))
    else:
        force = list(tilted(control.tilt_axis, mass[free, None] * gravity, "gravity"))
        columns = loads.at.block, loads.at.arm, loads.force, loads.what, loads.given
        for member, arm, load, what, given in zip(*columns, strict=True):
            if not fixed[member] and given >= 0:
                block.append(member)
                point.append(position[member] + arm)
                force.append(tilted(control.tilt_axis, load, what))
    forces = np.array(force, float).reshape(-1, 3)
    acting = (forces != 0.0).any(axis=1)
    if not acting.any():
        raise ScenarioError("nothing drives the blocks: give gravity, or loads, and let a block be free")
    return np.array(block, np.int64)[acting], np.array(point)[acting], forces[acting]


def pushed(direction, gravity: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Force (n, 3) on each of n blocks at the load factor 1; ScenarioError without gravity."""
    weight = float(np.linalg.norm(gravity))
    if not weight > 0.0:
        raise ScenarioError("gravity is zero, and a pushover pushes by shares of the weight: give gravity")
    return mass[:, None] * weight * np.asarray(direction, float)


def tilted(axis, force: np.ndarray, what: str) -> np.ndarray:
    """Forces (n, 3) that a tilt adds for tan(psi) = 1: -a x F. ScenarioError if the tilt does not turn them all
    alike."""
    axis, force = np.asarray(axis, float), np.asarray(force, float)
    along = np.abs(force @ axis)
    if (along > _ALONG * np.linalg.norm(force, axis=-1)).any():
        raise ScenarioError(
            f"{what} has a part along control.axis, which a tilt does not turn: a quasi-static tilt needs an axis at "
            "right angles to gravity and to every load; use quasi_static = false, with a rate and a displacement, as "
            "the last stage, or let that load act in other stages only"
        )
    return -np.cross(axis, force)
