"""All errors that users may see, each with the exit code of the command line.

Every message states the cause and the remedy in a sentence or two; the command line prints it without a traceback.
Exit codes: 1 no result, 2 invalid input or usage, 4 an optional dependency is missing.
"""

from importlib import import_module
from types import ModuleType


class DembrickError(Exception):
    """Base class of all errors addressed to the user; ``answer`` is the JSON object of the failed run."""

    exit_code = 1
    status = "failed"  # in the JSON object
    answer: dict | None = None


class ScenarioError(DembrickError):
    """The input does not describe a valid test: unknown key, wrong type, impossible value or geometry."""

    exit_code = 2


class OverlapError(ScenarioError):
    """Blocks overlap at the start; ``blocks`` are their indices in the scenario."""

    def __init__(self, message: str, blocks: tuple[int, ...] = ()):
        super().__init__(message)
        self.blocks = blocks


class StageFellError(ScenarioError):
    """An earlier stage fell, so that the next cannot start; ``result`` is the result of that stage."""

    def __init__(self, message: str, result=None):
        super().__init__(message)
        self.result = result


class HistoryError(DembrickError):
    """A history file cannot be read: missing, truncated, or not written by this package."""

    exit_code = 2


class OutputError(DembrickError):
    """An output path cannot be used: missing folder, or a finished history exists already."""

    exit_code = 2


class WriteError(DembrickError):
    """A write failed: no permission, read-only or full disk, folder removed."""


class DivergedError(DembrickError):
    """Time stepping diverged: NaN, runaway energy, or a block thrown far away."""


class NotConvergedError(DembrickError):
    """No result was reached; ``yield_point`` is the best bracket found, or None."""

    def __init__(self, message: str, yield_point=None):
        super().__init__(message)
        self.yield_point = yield_point


class UndecidedError(NotConvergedError):
    """Within the allowed effort neither equilibrium nor collapse under the dead loads was found."""

    status = "undecided"


class BracketError(DembrickError):
    """The bounds of a limit load contradict each other: an error of the program, never of the input."""


class EnergyAuditError(DembrickError):
    """The energy balance of a run is violated, or friction created energy."""


class MissingDependency(DembrickError):
    """An optional package or a system library is not installed."""

    exit_code = 4


def needed(package: str, what: str) -> ModuleType:
    """Import a ``package`` that may be missing; a MissingDependency then names ``what`` needs it."""
    try:
        return import_module(package)
    except ImportError as error:
        raise MissingDependency(f"{what} needs {package}; install it with: pip install {package}") from error


def of_joint_forces(ratio: float) -> str:
    """Words for a force over the joint forces, in a message on what is out of balance."""
    return f"{100.0 * ratio:.2g} % of the joint forces"
