"""Whether rigid blocks stand under their dead loads, by limit analysis: stands(scenario) -> StandingResult."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dembrick.runs.limit_scenario import assembled, names_of
from dembrick.runs.result import heading
from dembrick.scenario.model import Scenario
from dembrick.simulation.limit_analysis import analysis

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

SQUEEZE = "forces that balance the dead loads exist; blocks find none that need a squeeze which only pre-stress gives"


@dataclass
class StandingResult:
    """Result of limit analysis of the dead loads of a ``scenario`` and its ``assembly`` alone. ``found``: with the
    least out-of-balance and the mechanism; ``wall``: seconds."""

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
        mechanism = self.found.mechanism
        return {
            **heading(self.scenario),
            "status": self.status,
            "statics": {
                "stands": self.found.stands,
                "unbalanced": self.found.unbalanced,
                "mechanism": None if mechanism is None else mechanism.kind,
                "blocks": names_of(self.assembly, mechanism),
            },
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

    The static theorem: if none do, no rigid blocks stand; if some do, elastic joints may still not find them. Raises
    ScenarioError for input that is no test, NotConvergedError if the solver fails, MissingDependency without the extra
    ``limit``.
    """
    began = time.perf_counter()
    given, assembly, built = assembled(scenario, began, report)
    found = analysis.standing(analysis.prepared(assembly))
    wall = {"build": built, "total": time.perf_counter() - began}
    return StandingResult(given, assembly, found, wall)
