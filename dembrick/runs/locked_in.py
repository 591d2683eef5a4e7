"""Limit loads of the same structure after a history that has left forces locked into its joints.

Friction keeps what a load has squeezed together after the load has gone. Three histories are tried, each ending at rest
under the dead loads alone, from where the search then begins: the dead loads come on without friction; the load is
first reversed, nearly to its limit; the joints that slide in the mechanism, or graze their neighbour in it, are pressed
together and let go.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import build
from dembrick.errors import NotConvergedError
from dembrick.runs.outcomes.error_estimate import RATIOS, with_laws, with_ratio
from dembrick.scenario.model import Scenario
from dembrick.simulation.session import Session
from dembrick.simulation.statics import dead_load
from dembrick.simulation.statics.paths.other_paths import grazing_joints
from dembrick.simulation.statics.state import State

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.simulation.statics.load_system import Replay

# the limit load of a scenario by a number of steps over the usual, of an assembly in place of its own, from a state
Search = Callable[..., float]
REVERSED = 0.9  # of the limit of the reversed load
PRESSED = (2.0, 0.5, 0.1)  # of the weight of all blocks: what presses a joint, less if the blocks do not stand it


class NoSuchHistory(NotConvergedError):
    """A history that the blocks do not stand."""


def histories(run: Replay, scenario: Scenario, search: Search) -> list[Callable[[], float]]:
    """The limit loads of ``scenario`` after other histories, to be called; each may raise NotConvergedError, and
    NoSuchHistory if the blocks do not stand it."""
    found: list[Callable[[], float]]
    found = [partial(_after_smooth_rest, scenario, search), partial(_after_reversed_load, scenario, search)]
    states = [run.state] if run.left is None else [run.state, run.left]
    pressed = np.unique(np.concatenate([grazing_joints(state) for state in states]))
    if len(pressed):
        softest = with_ratio(scenario, max(RATIOS))
        found += [partial(_after_pressing, one, search, pressed) for one in (scenario, softest)]
    return found


def _after_smooth_rest(scenario: Scenario, search: Search) -> float:
    smooth = with_laws(scenario, lambda law: replace(law, friction=0.0, residual_friction=None))
    return search(scenario, 1.0, start=_rest(build.assemble(smooth)))


def _after_reversed_load(scenario: Scenario, search: Search) -> float:
    assembly = build.assemble(scenario)
    actuators = assembly.actuators
    back = replace(assembly, actuators=replace(actuators, direction=-actuators.direction))
    V = search(scenario, 1.0, back)
    wrench = actuators.at.on_blocks(actuators.force, len(assembly.names))
    return search(scenario, 1.0, start=_let_go(assembly, -REVERSED * V * wrench))


def _after_pressing(scenario: Scenario, search: Search, joints: np.ndarray) -> float:
    assembly = build.assemble(scenario)
    table, wrench = assembly.joints, np.zeros((len(assembly.names), 6))
    normal = table.axes[joints, 2]
    for block, sign in ((table.block_a[joints], 1.0), (table.block_b[joints], -1.0)):
        arm = table.origin[joints] - assembly.position[block]
        np.add.at(wrench, block, sign * np.concatenate([normal, np.cross(arm, normal)], axis=1))
    weight = float(np.linalg.norm(assembly.dead_force[~assembly.fixed], axis=1).sum())
    for times in PRESSED:
        try:
            start = _let_go(assembly, times * weight * wrench)
        except NoSuchHistory:
            continue
        return search(scenario, 1.0, start=start)
    raise NoSuchHistory("the blocks do not stand it that their joints are pressed together")


def _let_go(assembly: Assembly, wrench: np.ndarray) -> State:
    """The rest that is left after ``wrench`` (n, 6), N and N m, has acted on the blocks and gone."""
    force, torque = assembly.dead_force + wrench[:, :3], assembly.dead_torque + wrench[:, 3:]
    return _rest(assembly, _rest(replace(assembly, dead_force=force, dead_torque=torque)))


def _rest(assembly: Assembly, start: State | None = None) -> State:
    """The equilibrium under the dead loads; NotConvergedError without one."""
    found = dead_load.find_rest(assembly, Session(start=start))
    if found.rest.stands is not True:
        raise NoSuchHistory("the blocks do not stand this history")
    return found.state
