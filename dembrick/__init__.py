"""Discrete elements for dry-stacked masonry: limit loads with error bars, collapse, settlement, shaking.

    >>> import dembrick
    >>> result = dembrick.simulate("scenarios/set4a.toml")
    >>> result.yield_point.V, result.yield_point.half_width
    >>> wall = dembrick.Wall("wall", "stone", block=(0.3, 0.2, 0.1), courses=12, blocks=6)

Heavy dependencies are imported only when a name is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # for editors and type checkers, which do not follow lazy imports
    from dembrick import theory as theory
    from dembrick.errors import BracketError as BracketError
    from dembrick.errors import DembrickError as DembrickError
    from dembrick.errors import DivergedError as DivergedError
    from dembrick.errors import EnergyAuditError as EnergyAuditError
    from dembrick.errors import HistoryError as HistoryError
    from dembrick.errors import MissingDependency as MissingDependency
    from dembrick.errors import NotConvergedError as NotConvergedError
    from dembrick.errors import OutputError as OutputError
    from dembrick.errors import OverlapError as OverlapError
    from dembrick.errors import ScenarioError as ScenarioError
    from dembrick.errors import StageFellError as StageFellError
    from dembrick.errors import UndecidedError as UndecidedError
    from dembrick.errors import WriteError as WriteError
    from dembrick.history import History as History
    from dembrick.history import read_history as read_history
    from dembrick.runs.causes import Causes as Causes
    from dembrick.runs.causes import find_causes as find_causes
    from dembrick.runs.domain import simulate_domain as simulate_domain
    from dembrick.runs.lab import replay_lab as replay_lab
    from dembrick.runs.limit import LimitResult as LimitResult
    from dembrick.runs.limit import limit as limit
    from dembrick.runs.limit_cases import StandingResult as StandingResult
    from dembrick.runs.outcomes.load_path_result import LoadPathResult as LoadPathResult
    from dembrick.runs.outcomes.motion_result import MotionResult as MotionResult
    from dembrick.runs.outcomes.result import Result as Result
    from dembrick.runs.outcomes.statics_result import StaticsResult as StaticsResult
    from dembrick.runs.reactions import ReactionResult as ReactionResult
    from dembrick.runs.reactions import reaction as reaction
    from dembrick.runs.reading import load as load
    from dembrick.runs.simulate import restart as restart
    from dembrick.runs.simulate import restart_at as restart_at
    from dembrick.runs.simulate import simulate as simulate
    from dembrick.runs.steps import Step as Step
    from dembrick.runs.steps import steps as steps
    from dembrick.runs.study import Outcome as Outcome
    from dembrick.runs.study import Study as Study
    from dembrick.runs.study import sweep as sweep
    from dembrick.runs.study.executors import ClusterError as ClusterError
    from dembrick.runs.theory_check import Theory as Theory
    from dembrick.scenario import generators as generators
    from dembrick.scenario.blocks import Mesh as Mesh
    from dembrick.scenario.blocks import Part as Part
    from dembrick.scenario.blocks import Prism as Prism
    from dembrick.scenario.blocks import Voussoir as Voussoir
    from dembrick.scenario.cad_models import CadModel as CadModel
    from dembrick.scenario.controls import BaseMotionControl as BaseMotionControl
    from dembrick.scenario.controls import DisplacementControl as DisplacementControl
    from dembrick.scenario.controls import DynamicControl as DynamicControl
    from dembrick.scenario.controls import PushoverControl as PushoverControl
    from dembrick.scenario.controls import SettlementControl as SettlementControl
    from dembrick.scenario.controls import StaticsControl as StaticsControl
    from dembrick.scenario.controls import TiltControl as TiltControl
    from dembrick.scenario.controls import YieldControl as YieldControl
    from dembrick.scenario.generators import Arch as Arch
    from dembrick.scenario.generators import Dome as Dome
    from dembrick.scenario.generators import Opening as Opening
    from dembrick.scenario.generators import Return as Return
    from dembrick.scenario.generators import Stack as Stack
    from dembrick.scenario.generators import Wall as Wall
    from dembrick.scenario.joint_laws import CustomLaw as CustomLaw
    from dembrick.scenario.joint_laws import JointLaw as JointLaw
    from dembrick.scenario.joint_laws import JointOverride as JointOverride
    from dembrick.scenario.joint_laws import joint_law as joint_law
    from dembrick.scenario.model import Actuator as Actuator
    from dembrick.scenario.model import Block as Block
    from dembrick.scenario.model import ControlPoint as ControlPoint
    from dembrick.scenario.model import Load as Load
    from dembrick.scenario.model import Material as Material
    from dembrick.scenario.model import Output as Output
    from dembrick.scenario.model import Scenario as Scenario
    from dembrick.scenario.model import Solver as Solver
    from dembrick.scenario.pressures import Fill as Fill
    from dembrick.scenario.pressures import Pressure as Pressure
    from dembrick.scenario.regimes import Control as Control
    from dembrick.scenario.ties import Tie as Tie
    from dembrick.scenario.ties import TieEnd as TieEnd
    from dembrick.scenario.time_functions import Pulse as Pulse
    from dembrick.scenario.time_functions import Sine as Sine
    from dembrick.scenario.time_functions import SupportPath as SupportPath
    from dembrick.scenario.time_functions import Turn as Turn
    from dembrick.scenario.toml import dumps as dumps
    from dembrick.scenario.toml import loads as loads
    from dembrick.simulation.interrupts import Interrupted as Interrupted
    from dembrick.simulation.statics.yield_point import YieldPoint as YieldPoint
    from dembrick.views import plot as plot
    from dembrick.views import render as render
    from dembrick.views.export import export as export

__version__ = "0.1.0"

_NAMES = {  # by module
    "dembrick": "theory",
    "dembrick.errors": "BracketError DembrickError DivergedError EnergyAuditError HistoryError "
    "MissingDependency NotConvergedError OutputError OverlapError ScenarioError "
    "StageFellError UndecidedError WriteError",
    "dembrick.history": "History read_history",
    "dembrick.runs.causes": "Causes find_causes",
    "dembrick.runs.domain": "simulate_domain",
    "dembrick.runs.lab": "replay_lab",
    "dembrick.runs.limit": "LimitResult limit",
    "dembrick.runs.limit_cases": "StandingResult",
    "dembrick.runs.outcomes.load_path_result": "LoadPathResult",
    "dembrick.runs.outcomes.motion_result": "MotionResult",
    "dembrick.runs.reactions": "ReactionResult reaction",
    "dembrick.runs.reading": "load",
    "dembrick.runs.outcomes.result": "Result",
    "dembrick.runs.simulate": "restart restart_at simulate",
    "dembrick.runs.outcomes.statics_result": "StaticsResult",
    "dembrick.runs.steps": "Step steps",
    "dembrick.runs.study": "Outcome Study sweep",
    "dembrick.runs.study.executors": "ClusterError",
    "dembrick.runs.theory_check": "Theory",
    "dembrick.scenario": "generators",
    "dembrick.scenario.blocks": "Mesh Part Prism Voussoir",
    "dembrick.scenario.cad_models": "CadModel",
    "dembrick.scenario.controls": "BaseMotionControl DisplacementControl DynamicControl PushoverControl "
    "SettlementControl StaticsControl TiltControl YieldControl",
    "dembrick.scenario.generators": "Arch Dome Opening Return Stack Wall",
    "dembrick.scenario.joint_laws": "CustomLaw JointLaw JointOverride joint_law",
    "dembrick.scenario.model": "Actuator Block ControlPoint Load Material Output Scenario Solver",
    "dembrick.scenario.pressures": "Fill Pressure",
    "dembrick.scenario.regimes": "Control",
    "dembrick.scenario.ties": "Tie TieEnd",
    "dembrick.scenario.time_functions": "Pulse Sine SupportPath Turn",
    "dembrick.scenario.toml": "dumps loads",
    "dembrick.simulation.interrupts": "Interrupted",
    "dembrick.simulation.statics.yield_point": "YieldPoint",
    "dembrick.views": "plot render",
    "dembrick.views.export": "export",
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}
_MODULES = ("generators", "plot", "render", "theory")
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module 'dembrick' has no attribute {name!r}")
    from importlib import import_module

    if name in _MODULES:
        return import_module(f"{_HOMES[name]}.{name}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__():
    return sorted(__all__)
