"""Input of limit analysis: the scenario of a quasi-static load, its assembly, and the names of blocks."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dembrick.assembly import build as assemblies
from dembrick.errors import ScenarioError
from dembrick.runs.logger import heard_by
from dembrick.runs.reading import load
from dembrick.scenario.checks import show
from dembrick.scenario.controls import EVERY_BLOCK
from dembrick.scenario.model import Scenario
from dembrick.simulation.limit_analysis import solver

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.simulation.limit_analysis.mechanism import Mechanism


def searched(scenario: Scenario) -> Scenario:
    """The scenario with the load that limit analysis looks at: of a tilt or a push in real time the quasi-static one,
    in the geometry of the start. ScenarioError if a stage before leaves another geometry."""
    settled = next((k for k, stage in enumerate(scenario.stages, 1) if stage.in_deformed_geometry), None)
    if settled is not None:
        kind = show(scenario.stages[settled - 1].kind)
        raise ScenarioError(
            f"limit analysis knows the geometry of the start, and stage {settled} of kind {kind} leaves another one: "
            "remove it, or take the search of dembrick run"
        )
    control: Any = scenario.control
    if getattr(control, "large_displacements", False):
        control = replace(control, large_displacements=False)
        scenario = replace(scenario, control=control, text=None)
    if control.drives != EVERY_BLOCK or not control.regime.real_time:
        return scenario
    without: dict[str, Any] = {} if control.push_direction is None else {"rate": None}
    return replace(scenario, control=replace(control, quasi_static=True, **without), text=None)


def assembled(
    given: Scenario | str | os.PathLike, began: float, report: Callable[[str], None] | None
) -> tuple[Scenario, Assembly, float]:
    """A scenario as limit analysis looks at it, its assembly, and the seconds that took; `report` hears warnings."""
    solver.require()
    scenario = searched(given if isinstance(given, Scenario) else load(given))
    assembly = assemblies.assemble(scenario)
    report = heard_by(report)
    if report:
        for warning in assembly.warnings:
            report(warning)
    return scenario, assembly, time.perf_counter() - began


def names_of(assembly: Assembly, mechanism: Mechanism | None) -> list[str]:
    """Names of the blocks that move in a mechanism."""
    return [] if mechanism is None else [assembly.names[i] for i in mechanism.blocks]
