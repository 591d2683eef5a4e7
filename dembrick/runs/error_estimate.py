"""Error bars by refinement, for runs that have no bracket or whose bracket does not tell all.

A run in real time, with joints of some stiffness and driven at some rate, stands for rigid blocks and, where it drives
to a collapse, for a rate of zero. Each is refined by itself, because the two errors may differ in sign, and a
difference counts for an error that fades as slowly as has been seen: with the rate to the power 2/3, the time that
what has begun to fall takes; with the stiffness to the power -1/3, at joints that press a strip along their toe.

A search through equilibria knows no rate, and its forces no scale of stiffness, but the ratio of the two stiffnesses
decides how joints are loaded on the way, and so to which limit friction without dilatancy is led. Nobody knows that
ratio for a dry joint: the search is made for several, for both stiffnesses doubled and by steps half as long, and the
least and greatest limit are the range that the structure's own path leaves open. Histories that lock forces in are
tried beside them (`locked_in`).

Equilibria in the deformed geometry know no rate either: their error is that of the stiffness and of the steps of the
path, which are halved; supports also move by half the acceleration on them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.controls import (
    CONSTANT_RATE,
    DEAD_LOAD,
    DEFORMED_REST,
    DRIVEN_PATH,
    LIMIT_LOAD,
    LOAD_PATH,
    PATH_FOLLOWING,
    SETTLEMENT,
)
from dembrick.scenario.model import JointLaw, Scenario

OF_RATE = 1.0 / (1.0 - 2.0 ** (-2.0 / 3.0))  # error over the difference that half the rate makes
OF_STIFFNESS = 1.0 / (1.0 - 2.0 ** (-1.0 / 3.0))  # and twice the stiffness


RATIOS = (0.1, 0.4, 1.0, 4.0)  # shear over normal stiffness of dry joints, as far as they are known
_SAME = 1e-9  # relative difference of two stiffnesses that is none


class Refinement(NamedTuple):
    """A refined scenario, the error over the difference that it makes, and the steps of its path over the usual."""

    scenario: Scenario
    weight: float
    steps: float = 1.0


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
    if rate := getattr(control, "rate", None):
        slower = replace(scenario, control=replace(control, rate=0.5 * rate), text=None)
        found.append(Refinement(slower, OF_RATE))
    return tuple(found)


def error_of(scenario: Scenario, found, refined: Sequence) -> float:
    """The error of an answer, given those of the `refinements`: load factors, or displacements (n, 3), m, of which the
    block that is least certain counts."""
    return sum(
        refinement.weight * float(np.linalg.norm(np.atleast_2d(np.asarray(other) - found), axis=1).max())
        for refinement, other in zip(refinements(scenario), refined, strict=True)
    )


def with_ratio(scenario: Scenario, ratio: float) -> Scenario:
    """The same scenario with a shear stiffness of ``ratio`` times the normal stiffness in all joints."""
    return with_laws(scenario, lambda law: replace(law, shear_stiffness=ratio * law.normal_stiffness))


def _has_ratio(scenario: Scenario, ratio: float) -> bool:
    laws = (scenario.joint, *(entry.law for entry in scenario.joints))
    return all(abs(law.shear_stiffness / (ratio * law.normal_stiffness) - 1.0) <= _SAME for law in laws)


def stiffer(scenario: Scenario) -> Scenario:
    """The same scenario with twice the stiffness of all joints."""

    def law(given: JointLaw) -> JointLaw:
        normal, shear = 2.0 * given.normal_stiffness, 2.0 * given.shear_stiffness
        return replace(given, normal_stiffness=normal, shear_stiffness=shear)

    return with_laws(scenario, law)


def with_laws(scenario: Scenario, law: Callable[[JointLaw], JointLaw]) -> Scenario:
    """The same scenario with another ``law`` in place of each of its joints."""
    joints = tuple(replace(entry, law=law(entry.law)) for entry in scenario.joints)
    return replace(scenario, joint=law(scenario.joint), joints=joints, text=None)
