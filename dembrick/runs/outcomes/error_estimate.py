"""Error bars by refinement, for runs that have no bracket or whose bracket does not tell all.

A run in real time, with joints of some stiffness and driven at some rate, stands for rigid blocks and, where it drives
to a collapse, for a rate of zero. Each is refined by itself, because the two errors may differ in sign, and a
difference counts for an error that fades as slowly as has been seen: with the rate to the power 2/3, the time that
what has begun to fall takes; with the stiffness to the power -1/3, at joints that press a strip along their toe, and a
little more for the powers that follow: convex joints that rock lacked up to 2.4 % of their error. What moves and comes
to rest again need not change steadily as joints get stiffer, and twice the stiffness may change nothing by chance:
joints are made 16 times as stiff too, and the greater of both errors counts.

A search through equilibria knows no rate, and its forces no scale of stiffness, but the ratio of the two stiffnesses
decides how joints are loaded on the way, and so to which limit friction without dilatancy is led. Nobody knows that
ratio for a dry joint: the search is made for several, for both stiffnesses doubled and by steps half as long, and the
least and greatest limit are the range that the structure's own path leaves open. Histories that lock forces in are
tried beside them (`path_dependence.histories`).

Equilibria in the deformed geometry know no rate either: their error is that of the stiffness and of the steps of the
path, which are halved; supports also move by half the acceleration on them.

How much of a load is inertia: a remark on rates at which a run in time shows more than what the joints carry.

A head that starts at the rate v against an actuator of stiffness k, with a mass m behind it, carries up to v sqrt(k m)
more than the joints do while the blocks take up its speed. What V_peak is above V is that at the most. The controller
of a pushover in real time adds v w / g to the load factor, w being the frequency of its spring. A table that tilts on
while blocks fall shows an angle beyond the onset.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dembrick.assembly.actuators import effective_mass
from dembrick.errors import ScenarioError
from dembrick.runs.outcomes.result import Result
from dembrick.scenario.checks import present
from dembrick.scenario.model import JointLaw, Scenario
from dembrick.scenario.regimes import (
    COLLAPSE,
    CONSTANT_RATE,
    DEAD_LOAD,
    DEFORMED_REST,
    DRIVEN_PATH,
    EVERY_BLOCK,
    LIMIT_LOAD,
    LOAD_PATH,
    PATH_FOLLOWING,
    REAL_TIME,
    SETTLEMENT,
)
from dembrick.views.summary import known

OF_RATE = 1.0 / (1.0 - 2.0 ** (-2.0 / 3.0))  # error over the difference that half the rate makes
OF_STIFFNESS = 1.05 / (1.0 - 2.0 ** (-1.0 / 3.0))  # and twice the stiffness
STIFFEST = 16.0  # times the stiffness, of blocks that move and come to rest
OF_STIFFEST = 2.5  # error over that difference: 1.7 by the power -1/3, and more as change may begin late


RATIOS = (0.1, 0.4, 1.0, 4.0)  # shear over normal stiffness of dry joints, as far as they are known
_SAME = 1e-9  # relative difference of two stiffnesses that is none


class Refinement(NamedTuple):
    """A refined scenario, the error over the difference that it makes, and the steps of its path over the usual.
    ``again``: it tells of the same error as the one before, and the greater counts."""

    scenario: Scenario
    weight: float
    steps: float = 1.0
    again: bool = False


def refinements(scenario: Scenario, several: bool = False) -> tuple[Refinement, ...]:
    """Refinements with which ``scenario`` is compared; ScenarioError if the bracket of the limit load is the error bar.

    ``several``: several joints share the load, so that the limit of actuators may depend on the path as well.
    """
    control: Any = scenario.control
    if scenario.stages:
        raise ScenarioError("--refine estimates the error of a run that starts from rest, and this one has [[stages]]")
    if control.regime in (DEAD_LOAD, DEFORMED_REST):
        raise ScenarioError('a run of kind "statics" tells whether the blocks stand; --refine has nothing to estimate')
    if control.regime is CONSTANT_RATE or (control.regime is LIMIT_LOAD and not several):
        raise ScenarioError(
            f'a run of kind "{control.kind}" has the bracket of its limit load for an error bar; --refine is for limit '
            "loads of several joints, tilt, pushover, base-motion and dynamic"
        )
    if control.regime in (SETTLEMENT, LOAD_PATH, DRIVEN_PATH):
        return Refinement(stiffer(scenario), OF_STIFFNESS), Refinement(scenario, 1.0, 0.5)
    if control.regime in (PATH_FOLLOWING, LIMIT_LOAD):
        others = [with_ratio(scenario, ratio) for ratio in RATIOS if not _has_ratio(scenario, ratio)]
        paths = [Refinement(other, 1.0) for other in (*others, stiffer(scenario))]
        return (*paths, Refinement(scenario, 1.0, 0.5))
    found = [Refinement(stiffer(scenario), OF_STIFFNESS)]
    if control.ends_with != COLLAPSE:
        found.append(Refinement(stiffer(scenario, STIFFEST), OF_STIFFEST, again=True))
    if rate := control.rate:
        slower = replace(scenario, control=replace(control, rate=0.5 * rate), text=None)
        found.append(Refinement(slower, OF_RATE))
    return tuple(found)


def error_of(scenario: Scenario, found, refined: Sequence) -> float:
    """The error of an answer, given those of the `refinements`: load factors, or displacements (n, 3), m, of which the
    block that is least certain counts."""
    errors: list[float] = []
    for refinement, other in zip(refinements(scenario), refined, strict=True):
        error = refinement.weight * float(np.linalg.norm(np.atleast_2d(np.asarray(other) - found), axis=1).max())
        errors.append(max(errors.pop(), error) if refinement.again else error)
    return sum(errors)


def with_ratio(scenario: Scenario, ratio: float) -> Scenario:
    """The same scenario with a shear stiffness of ``ratio`` times the normal stiffness in all joints."""
    return with_laws(scenario, lambda law: replace(law, shear_stiffness=ratio * law.normal_stiffness))


def _has_ratio(scenario: Scenario, ratio: float) -> bool:
    laws = (scenario.joint, *(entry.law for entry in scenario.joints))
    return all(abs(law.shear_stiffness / (ratio * law.normal_stiffness) - 1.0) <= _SAME for law in laws)


def stiffer(scenario: Scenario, times: float = 2.0) -> Scenario:
    """The same scenario with so many times the stiffness of all joints."""

    def law(given: JointLaw) -> JointLaw:
        normal, shear = times * given.normal_stiffness, times * given.shear_stiffness
        return replace(given, normal_stiffness=normal, shear_stiffness=shear)

    return with_laws(scenario, law)


def with_laws(scenario: Scenario, law: Callable[[JointLaw], JointLaw]) -> Scenario:
    """The same scenario with another ``law`` in place of each of its joints."""
    joints = tuple(replace(entry, law=law(entry.law)) for entry in scenario.joints)
    return replace(scenario, joint=law(scenario.joint), joints=joints, text=None)


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
