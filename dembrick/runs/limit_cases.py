"""Preparation of limit analysis: the scenario with a quasi-static load, its assembly and names of blocks; and whether
rigid blocks stand under their dead loads, stands(scenario) -> StandingResult.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from dembrick.assembly import build as assemblies
from dembrick.errors import DembrickError, ScenarioError
from dembrick.runs.logger import heard_by
from dembrick.runs.outcomes.result import heading
from dembrick.runs.reading import load
from dembrick.scenario.checks import show
from dembrick.scenario.controls import EVERY_BLOCK, LIMIT_LOAD, PATH_FOLLOWING
from dembrick.scenario.model import Scenario
from dembrick.scenario.regimes import SETTLEMENT
from dembrick.scenario.stages import at_stage
from dembrick.simulation.limit_analysis import analysis, solver

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


def searched(scenario: Scenario) -> Scenario:
    """The scenario for limit analysis: in the geometry of the start, with the quasi-static load for a tilt or a push in
    real time. ScenarioError if an earlier stage changes the geometry."""
    settled = _first_deformed_stage(scenario)
    if settled is not None:
        kind = show(scenario.stages[settled - 1].kind)
        raise ScenarioError(
            f"limit analysis uses the initial geometry, but stage {settled} of kind {kind} changes it: remove this "
            "stage, use dembrick run, or find the reaction of a support before it moved, --reaction SUPPORT "
            "--direction X,Y,Z"
        )
    control: Any = scenario.control
    if control.large_displacements:
        control = replace(control, large_displacements=False)
        scenario = replace(scenario, control=control, text=None)
    if control.drives != EVERY_BLOCK or not control.regime.real_time:
        return scenario
    without: dict[str, Any] = {} if control.push_direction is None else {"rate": None}
    return replace(scenario, control=replace(control, quasi_static=True, **without), text=None)


def at_start(scenario: Scenario) -> tuple[Scenario, str | None]:
    """The scenario up to the first stage that changes the geometry, and a remark on that; None if no stage does."""
    settled = _first_deformed_stage(scenario)
    if settled is None:
        return scenario, None
    kind = show(scenario.stages[settled - 1].kind)
    return at_stage(scenario, settled), (
        f"limit analysis uses the initial geometry: dead loads, ties and joint laws are those of stage {settled} of "
        f"kind {kind}, before anything has moved"
    )


def _first_deformed_stage(scenario: Scenario) -> int | None:
    """Number of the first stage that changes the geometry; None if none does."""
    return next((k for k, stage in enumerate(scenario.stages, 1) if stage.in_deformed_geometry), None)


def check_bound(scenario: Scenario) -> None:
    """Raise ScenarioError for a run that limit analysis cannot bound, MissingDependency without its solver."""
    control = scenario.control
    if control.regime is SETTLEMENT:
        paths = control.support_paths
        if len(paths) > 1 or paths[0].rotation is not None or _first_deformed_stage(scenario) is not None:
            raise ScenarioError(
                "--bound of a settlement is for supports that move along one line from the initial geometry; for "
                "any direction use 'dembrick limit SCENARIO --reaction SUPPORT --direction X,Y,Z'"
            )
    elif control.regime not in (LIMIT_LOAD, PATH_FOLLOWING):
        raise ScenarioError(
            f'--bound is for searches of a limit load and settlements, and a run of kind "{control.kind}" is none'
        )
    solver.require()


def assembled(
    given: Scenario | str | os.PathLike, began: float, report: Callable[[str], None] | None
) -> tuple[Scenario, Assembly, float]:
    """A scenario for limit analysis, its assembly, and the seconds since ``began``; ``report`` receives warnings."""
    solver.require()
    scenario = searched(given if isinstance(given, Scenario) else load(given))
    assembly = assemblies.assemble(scenario)
    report = heard_by(report)
    if report:
        for warning in assembly.warnings:
            report(warning)
    return scenario, assembly, time.perf_counter() - began


def failure(scenario: Scenario, error: DembrickError) -> dict:
    """The JSON object of limit analysis that gave no answer."""
    return heading(scenario) | {"status": "failed", "error": str(error)} | (error.answer or {})


def finite(value: float) -> float | None:
    """``value``, None if it is infinite."""
    return value if math.isfinite(value) else None


SQUEEZE = "forces that balance the dead loads exist; blocks do not develop forces that need a squeeze from pre-stress"


@dataclass
class StandingResult:
    """Result of limit analysis under the dead loads alone, of a ``scenario`` and its ``assembly``. ``found``:
    the answer with the least out-of-balance force and the mechanism; ``wall``: seconds."""

    scenario: Scenario
    assembly: Assembly
    found: analysis.Standing
    wall: dict

    @property
    def status(self) -> str:
        """ "stands" or "falls"; both are answers."""
        return "stands" if self.found.stands else "falls"

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick limit --json`` for ``kind = "statics"``."""
        return {
            **heading(self.scenario, self.assembly),
            "status": self.status,
            "statics": analysis.statics(self.assembly, self.found),
            "remarks": [SQUEEZE] if self.found.stands else [],
            "wall": self.wall,
        }

    def text(self) -> str:
        """Text of the command line."""
        if self.found.stands:
            answer = ["answer        stands under its dead loads (limit analysis)", f"remark        {SQUEEZE}"]
        else:
            answer = [f"answer        {analysis.falls(self.assembly, self.found)}"]
        return "\n".join([self.scenario.title, *answer])


def stands(scenario: Scenario | str | os.PathLike, *, report: Callable[[str], None] | None = None) -> StandingResult:
    """Whether any joint forces within their strengths balance the dead loads of a scenario, whatever its control.

    By the static theorem, blocks fall if there are none; if there are some, elastic joints may not reach them. Raises
    ScenarioError for input that is no test, NotConvergedError if the solver fails, MissingDependency without the extra
    ``limit``.
    """
    began = time.perf_counter()
    given, assembly, built = assembled(scenario, began, report)
    found = analysis.standing(analysis.prepared(assembly))
    wall = {"build": built, "total": time.perf_counter() - began}
    return StandingResult(given, assembly, found, wall)
