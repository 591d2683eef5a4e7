"""Runs with a joint law of the user's own: which scenarios allow one, and how their histories record it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dembrick.errors import HistoryError, ScenarioError
from dembrick.scenario.controls import CONSTANT_RATE, LIMIT_LOAD, REAL_TIME
from dembrick.scenario.joint_laws import CustomLaw

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.history import History
    from dembrick.scenario.model import Scenario

SETTING = "custom_law"  # of a history: holds `CustomLaw.as_dict`
REGIMES = (LIMIT_LOAD, CONSTANT_RATE, REAL_TIME)  # whose loops call the law step by step


def with_law(assembly: Assembly, scenario: Scenario, law: Any, refine: bool = False, bound: bool = False) -> Assembly:
    """The assembly with joints that follow ``law``: a `CustomLaw`, or a function as a law without parameters; unchanged
    if it is None. ScenarioError if no step-by-step loop would call it."""
    if law is None:
        return assembly
    law = law if isinstance(law, CustomLaw) else CustomLaw(law)
    _refuse(assembly, scenario, law.name)
    if refine or bound:
        asked = "refine" if refine else "bound"
        raise ScenarioError(f"{asked} = True cannot use the joint law {law.name}; leave it out")
    return replace(assembly, custom_law=law)


def _refuse(assembly: Assembly, scenario: Scenario, name: str) -> None:
    """Raise ScenarioError for a scenario that cannot have a law of the user's own."""
    if scenario.control.regime not in REGIMES:
        raise ScenarioError(
            f'control.kind = "{scenario.control.kind}" of this scenario goes from equilibrium to equilibrium, and a '
            f"joint law of one's own is followed only through a motion, step by step: give the law {name} to "
            'kind = "displacement" with a rate, to a run in real time (kind = "dynamic", "base-motion", or "tilt" with '
            'a rate), or to kind = "yield" of blocks that each stand on fixed ones alone'
        )
    if scenario.stages:
        raise ScenarioError(
            f"the law {name} cannot be given to a scenario with stages, because the first stages do not call it"
        )
    laws = list({id(one): one for one in assembly.joints.law}.values())
    if any(one.formulation == "convex" for one in laws):
        raise ScenarioError(
            f'the law {name} is one of contact points, and a joint here has formulation = "convex", which has none: '
            'use "concave", "corrected" or "distributed" with points'
        )
    if any(not one.dry for one in laws):
        raise ScenarioError(
            f"the law {name} takes the place of the scenario's: leave out cohesion, tensile_strength, dilation, "
            "compressive_strength and residuals, and give such numbers as parameters of the law"
        )


def settings_of(assembly: Assembly) -> dict:
    """Settings of a history that describe the law; empty without one."""
    return {} if assembly.custom_law is None else {SETTING: assembly.custom_law.as_dict()}


def require_repeatable(history: History) -> None:
    """HistoryError if a run followed a law of the user's own, which no file holds."""
    found = history.settings.get(SETTING)
    if isinstance(found, Mapping):
        raise HistoryError(
            f"{history.path}: its joints followed the law {found.get('name')} of a user's Python, which no file holds; "
            "run it again there: dembrick.simulate(scenario, history, law=...)"
        )
