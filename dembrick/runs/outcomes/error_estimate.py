"""Error bars by refinement, for runs without a bracket or whose bracket does not cover all errors.

A run in real time, with joints of finite stiffness and a finite rate, stands for rigid blocks and, if it is driven to a
collapse, for a rate of zero. Each is refined separately, as the two errors may differ in sign, and the error is
extrapolated from the difference with the slowest convergence observed: with the rate to the power 2/3, the time that
blocks take to fall; with the stiffness to the power -1/3, for joints pressed on a strip along their toe, and a little
more for the powers that follow, without which the error of rocking convex joints was up to 2.4 % too small. Motions
that come to rest again need not converge steadily with the stiffness, and doubling it may change nothing by chance:
joints are also made 16 times as stiff, and the greater of both errors counts.

A search through equilibria has no rate, and its forces do not depend on the scale of stiffness. But the ratio of the
two stiffnesses decides how joints are loaded on the path, and so which limit friction without dilatancy leads to. That
ratio is unknown for dry joints: the search is repeated for several ratios, with both stiffnesses doubled and with steps
half as long; the least and greatest limit are the range that the path of the structure leaves open. Load histories that
lock forces in are tried as well (`path_dependence.histories`).

Equilibria in the deformed geometry have no rate either: their error is that of the stiffness and of the steps of the
path, which are halved; supports also move by half the acceleration on them.

Share of inertia in a load: a remark on rates at which a run in time shows more than the joints carry; and one on jacks
whose spring takes much of their displacement.

A head that starts at the rate v against an actuator of stiffness k, with a mass m behind it, carries up to v sqrt(k m)
more than the joints while the blocks take up its speed. V_peak - V is at most that. The controller of a pushover in
real time adds v w / g to the load factor, w being the frequency of its spring. A table that keeps tilting while blocks
fall shows an angle beyond the onset.
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
from dembrick.scenario.protocols import protocol_of
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

OF_RATE = 1.0 / (1.0 - 2.0 ** (-2.0 / 3.0))  # error over the change by halving the rate
OF_STIFFNESS = 1.05 / (1.0 - 2.0 ** (-1.0 / 3.0))  # and by doubling the stiffness
STIFFEST = 16.0  # times the stiffness, for blocks that move and come to rest
OF_STIFFEST = 2.5  # error over that change: 1.7 by the power -1/3, and more as change may begin late


RATIOS = (0.1, 0.4, 1.0, 4.0)  # shear over normal stiffness of dry joints, as far as they are known
_SAME = 1e-9  # relative difference below which two stiffnesses are equal


class Refinement(NamedTuple):
    """A refined scenario, the ``weight`` from its change of the answer to the error, and its steps over the usual ones.
    ``again``: it estimates the same error as the one before, and the greater counts."""

    scenario: Scenario
    weight: float
    steps: float = 1.0
    again: bool = False


def refinements(scenario: Scenario, several: bool = False) -> tuple[Refinement, ...]:
    """Refinements to compare ``scenario`` with; ScenarioError if the bracket of the limit load is the error bar.

    ``several``: several joints share the load, so that the limit of actuators may depend on the path as well.
    """
    control: Any = scenario.control
    if scenario.stages:
        raise ScenarioError("--refine estimates the error of a run without stages, and this one has [[stages]]")
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
    least certain block counts."""
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
    """The same scenario with the stiffness of all joints multiplied by ``times``."""

    def law(given: JointLaw) -> JointLaw:
        normal, shear = times * given.normal_stiffness, times * given.shear_stiffness
        return replace(given, normal_stiffness=normal, shear_stiffness=shear)

    return with_laws(scenario, law)


def with_laws(scenario: Scenario, law: Callable[[JointLaw], JointLaw]) -> Scenario:
    """The same scenario with another ``law`` in place of each of its joints."""
    joints = tuple(replace(entry, law=law(entry.law)) for entry in scenario.joints)
    return replace(scenario, joint=law(scenario.joint), joints=joints, text=None)


REMARKED = 0.05  # of V
FOLLOWED = 0.9  # of a turning point of the jack: blocks that reach less have left much of it to its spring


def spring_remark(result) -> str | None:
    """Remark on a test at a constant rate whose blocks stay behind the turning points of the jack, as its spring takes
    the rest; None for all others."""
    control, turns = result.scenario.control, getattr(result.run, "turns", None)
    displacement = np.asarray(result.rows.get("displacement", ()), float)
    if not (control.cyclic and control.regime is CONSTANT_RATE and turns and len(displacement)):
        return None
    heads = protocol_of(result.scenario).turns[1:]
    pairs = [(displacement[turn], head) for turn, head in zip(turns, heads, strict=True) if head != 0.0]
    reached, asked = min(pairs, key=lambda pair: pair[0] / pair[1])
    if reached / asked >= FOLLOWED:
        return None
    return (
        f"at a turning point of {1e6 * asked:.4g} um the blocks had moved by {1e6 * reached:.4g} um, as the spring of "
        "the jack takes the rest; if displacements are those of the blocks, give large_displacements = true, which "
        "prescribes them"
    )


def inertia_remark(result) -> str | None:
    """Remark on a run in which inertia carries more than ``REMARKED`` of V; None for all others."""
    control = result.scenario.control
    share = inertia_share(result)
    if share is None or not share > REMARKED:
        return None
    unit = "deg/s" if control.tilt_axis is not None else "m/s"
    part = f"{100.0 * share:.2g} % of V" if share < 1.0 else f"{known(share, 0.1 * share)} times V"
    return (
        f"control.rate = {control.rate:g} {unit} is fast: inertia carries about {part} as blocks accelerate; lower it"
    )


def inertia_share(result) -> float | None:
    """Greatest share of V that inertia may carry; None if no load is driven at a rate, or if V is only the last load of
    a cyclic test."""
    control: Any = result.scenario.control
    if isinstance(result, Result) and control.regime is CONSTANT_RATE:
        if control.cyclic and result.yield_point.bracket == "open":
            return None
        V, peak = result.yield_point.V, abs(result.yield_point.V_peak)
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
