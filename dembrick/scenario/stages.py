"""Stages: controls carried out one after the other, each starting from the state at the end of the one before.

``[[stages]]`` come first, ``[control]`` is the last. Loads, actuators, pressures, fills, ties and the laws of
``[[joints]]`` are active in all stages, or in those whose numbers they list.
"""

from __future__ import annotations

from dataclasses import replace
from numbers import Integral
from typing import TYPE_CHECKING, Any, NamedTuple

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import require, require_type, show
from dembrick.scenario.controls import ACTUATORS, Control
from dembrick.scenario.declared import Key, declare
from dembrick.scenario.regimes import ASK_FOR_REST

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

# lists of a scenario whose entries may be limited to some stages
IN_STAGES = ("loads", "actuators", "pressures", "fills", "ties", "joints")


def stage_numbers(key: str, value: Any) -> tuple[int, ...] | None:
    """Check numbers of stages, counted from 1; None means all of them."""
    if value is None:
        return None
    whole = isinstance(value, list | tuple) and all(isinstance(n, Integral) and not isinstance(n, bool) for n in value)
    require_type(whole, key, value, "a list of numbers of stages")
    require(len(value) > 0, key, value, "it must name at least one stage; leave it out for all of them")
    require(all(n >= 1 for n in value), key, value, "stages are counted from 1")
    return tuple(int(n) for n in value)


def stages_of(meaning: str) -> dict[str, Key]:
    """Metadata of the stages in which something is active."""
    return declare("whole numbers >= 1", meaning, "", lambda key, value, label: stage_numbers(key + label, value))


def controls_of(scenario: Scenario) -> tuple[Control, ...]:
    """The controls of all stages, that of ``[control]`` last."""
    return (*scenario.stages, scenario.control)


def in_deformed_geometry(controls: tuple[Control, ...]) -> tuple[Control, ...]:
    """The controls of all stages; searches after a stage in the deformed geometry are set to that geometry."""
    found: list[Control] = []
    for control in controls:
        deformed = bool(found) and found[-1].in_deformed_geometry
        if deformed and not control.regime.real_time:
            control = replace(control, large_displacements=True)  # type: ignore[type-var]
        found.append(control)
    return tuple(found)


def check_stages(scenario: Scenario) -> None:
    """Raise a ScenarioError for stages that cannot follow one another, and for numbers of stages that do not exist."""
    controls = controls_of(scenario)
    for number, control in enumerate(controls[:-1], 1):
        if control.regime.real_time and not control.regime.quasi_static:
            raise ScenarioError(
                f"stage {number} of kind {show(control.kind)} runs in real time, and only the last one can: make it "
                "[control]"
            )
    last = len(controls)
    for key in IN_STAGES:
        for number, entry in enumerate(getattr(scenario, key), 1):
            missing = next((n for n in entry.stages or () if n > last), None)
            if missing is not None:
                what = f"stages of {key.removesuffix('s')} number {number}"
                how = f"{last} with [control]" if last > 1 else "1, which is [control]; add [[stages]]"
                raise ScenarioError(f"{what} = {show(list(entry.stages))}: there is no stage {missing}, only {how}")
    if last == 1:
        return
    for number, control in enumerate(controls, 1):
        pressures = any(pressure.actuator for pressure in _of_stage(scenario.pressures, number))
        if control.drives == ACTUATORS and not (pressures or _of_stage(scenario.actuators, number)):
            raise ScenarioError(
                f"stage {number} of kind {show(control.kind)} drives actuators, but none acts in it; add its number "
                "to the stages of an actuator"
            )
        if not control.loads_vary and any(load.varies for load in _of_stage(scenario.loads, number)):
            raise ScenarioError(
                f"a load that varies with time acts in stage {number} of kind {show(control.kind)}, which allows none; "
                "give it the stages in which it acts"
            )
    _check_driven(scenario, controls)


def _check_driven(scenario: Scenario, controls: tuple[Control, ...]) -> None:
    """Raise a ScenarioError for an actuator, or a driven pressure, that no stage drives; where all its stages are of
    kind statics a remark suffices, that it carries nothing."""
    for entry in driven_entries(scenario):
        acting = acting_in(entry, controls)
        if any(one.drives == ACTUATORS for one in acting) or all(one.regime in ASK_FOR_REST for one in acting):
            continue
        numbers = [number for number in range(1, len(controls) + 1) if number in (entry.stages or (number,))]
        said = f"stage{'s' if len(acting) > 1 else ''} {' and '.join(map(str, numbers))} of kind "
        said += " and ".join(dict.fromkeys(show(control.kind) for control in acting))
        idle = f"{'have' if len(acting) > 1 else 'has'} no use for [[actuators]]; remove the one on {show(entry.block)}"
        if entry in scenario.pressures:
            drive = "drive" if len(acting) > 1 else "drives"
            idle = f"{drive} no pressure: remove actuator = true of the one on {show(entry.block)}"
        raise ScenarioError(f"{said} {idle}, or let it act in a stage of kind 'yield'")


def driven_entries(scenario: Scenario) -> tuple[Any, ...]:
    """The actuators of a scenario, and its driven pressures."""
    return (*scenario.actuators, *(pressure for pressure in scenario.pressures if pressure.actuator))


def acting_in(entry: Any, controls: tuple[Control, ...]) -> tuple[Control, ...]:
    """The controls of the stages in which an entry of a list is active."""
    return tuple(control for number, control in enumerate(controls, 1) if number in (entry.stages or (number,)))


def _of_stage(entries: tuple, number: int) -> tuple:
    return tuple(entry for entry in entries if entry.stages is None or number in entry.stages)


def at_stage(scenario: Scenario, number: int) -> Scenario:
    """One stage (counted from 1; `len(scenario.stages) + 1` is the last) as a scenario by itself: its control, and the
    loads, actuators, ties and joint laws that are active in it. Actuators are included only if the control drives
    them."""
    if not scenario.stages:
        return scenario
    control = controls_of(scenario)[number - 1]
    parts: dict[str, Any] = {
        key: tuple(replace(entry, stages=None) for entry in _of_stage(getattr(scenario, key), number))
        for key in IN_STAGES
    }
    laws = parts["joints"]
    named = [frozenset(law.between) for law in laws]
    parts["joints"] = tuple(law for i, law in enumerate(laws) if named[i] not in named[i + 1 :])  # the last holds
    if control.drives != ACTUATORS:
        parts["actuators"] = ()
        parts["pressures"] = tuple(pressure for pressure in parts["pressures"] if not pressure.actuator)
    return replace(scenario, control=control, stages=(), among=controls_of(scenario), text=None, **parts)


class TiesBefore(NamedTuple):
    """Relation between the ties of a stage and of the one before: the number before (``total``), and for each tie of
    the stage its index before (``of``), -1 for a new one."""

    total: int
    of: tuple[int, ...]


def ties_before(scenario: Scenario, number: int) -> TiesBefore | None:
    """Relation of the ties of the stage ``number`` to those of the stage before; None if they are the same."""
    before, now = (
        [k for k, tie in enumerate(scenario.ties) if tie.stages is None or n in tie.stages]
        for n in (number - 1, number)
    )
    if before == now:
        return None
    return TiesBefore(len(before), tuple(before.index(k) if k in before else -1 for k in now))


def laws_change(scenario: Scenario) -> bool:
    """Whether the law of any joint differs between stages."""
    return any(entry.stages is not None for entry in scenario.joints)
