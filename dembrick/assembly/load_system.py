"""Load systems on every block: a share of its weight sideways, and rotating gravity on a tilting table.

**Pushover.** Every free block is pushed at its centroid by V times its weight along a direction: V is the load factor.

**Tilt.** On a table rotated by psi about a horizontal axis a, gravity seen from the table rotates in the opposite
sense: a dead force F normal to a becomes cos(psi) F - sin(psi) a x F. Friction without cohesion and no-tension joints
have no scale of force: blocks that carry some loads also carry these times any positive factor. Division by cos(psi)
turns the loads on the tilted table into those on the level table plus tan(psi) times -a x F at the same points. A
quasi-static tilt is therefore a search for the limit V of that load system, and the blocks collapse at the table angle
atan(V); this includes exactly the decrease of normal gravity by cos(psi). Pressures rotate with the faces of the blocks
and not with gravity, so this search excludes them; load paths in the deformed geometry do include them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

_ALONG = 1e-9  # of a force: a smaller part along the axis is rounding


def load_system(scenario: Scenario, loads, position, mass, fixed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces at load factor 1 for a pushover or a tilt: block (k,), point (k, 3) in the world and force (k, 3).

    ``loads``: the dead loads besides gravity (:class:`dembrick.assembly.loads.PointLoads`); ``position`` (n, 3) of the
    centroids, ``mass`` and ``fixed`` (n,). Raises ScenarioError if nothing drives the blocks, or if the scenario has
    something that this load system excludes.
    """
    control, free = scenario.control, np.flatnonzero(~fixed)
    if scenario.actuators:
        raise ScenarioError(f"control kind {show(control.kind)} has no use for [[actuators]]; remove them")
    if any(pressure.actuator for pressure in scenario.pressures):
        raise ScenarioError(
            f"control kind {show(control.kind)} drives no pressure: remove actuator = true, or use kind 'yield'"
        )
    if control.pushes_as_tilted and scenario.pressures:
        raise ScenarioError(
            "a quasi-static tilt turns loads like gravity, but [[pressures]] stay normal to the faces of blocks that "
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
        raise ScenarioError("nothing drives the blocks: give gravity or loads, and leave a block free")
    return np.array(block, np.int64)[acting], np.array(point)[acting], forces[acting]


def pushed(direction, gravity: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Force (n, 3) on each of n blocks at the load factor 1; ScenarioError without gravity."""
    weight = float(np.linalg.norm(gravity))
    if not weight > 0.0:
        raise ScenarioError("gravity is zero, but a pushover pushes by shares of the weight: give gravity")
    return mass[:, None] * weight * np.asarray(direction, float)


def tilted(axis, force: np.ndarray, what: str) -> np.ndarray:
    """Forces (n, 3) that a tilt adds at tan(psi) = 1: -a x F. Raises ScenarioError if a force has a component along the
    axis, which does not rotate."""
    axis, force = np.asarray(axis, float), np.asarray(force, float)
    along = np.abs(force @ axis)
    if (along > _ALONG * np.linalg.norm(force, axis=-1)).any():
        raise ScenarioError(
            f"{what} has a component along control.axis, which a tilt does not turn: a quasi-static tilt needs an axis "
            "at right angles to gravity and to every load; use quasi_static = false, with a rate and a displacement, "
            "as the last stage, or let that load act in other stages only"
        )
    return -np.cross(axis, force)
