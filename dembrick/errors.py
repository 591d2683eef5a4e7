"""The errors a user can meet, each with the exit code of the command that shows it.

Every message names the cause and the remedy in one sentence or two; the command line prints it without a
traceback. Exit codes: 1 no answer, 2 invalid input or usage, 4 an optional dependency is missing.
"""

from importlib import import_module
from types import ModuleType


class DembrickError(Exception):
    """Base of all errors that are addressed to the user; ``answer`` is the JSON object of the run that failed."""

    exit_code = 1
    status = "failed"  # of the JSON object
    answer: dict | None = None


class ScenarioError(DembrickError):
    """The input cannot describe a test: unknown key, wrong type, impossible value or geometry."""

    exit_code = 2


class OverlapError(ScenarioError):
    """Blocks that share volume at the start; ``blocks`` are their numbers in the scenario."""

    def __init__(self, message: str, blocks: tuple[int, ...] = ()):
        super().__init__(message)
        self.blocks = blocks


class HistoryError(DembrickError):
    """A history file that cannot be read: missing, truncated, or not one of ours."""

    exit_code = 2


class OutputError(DembrickError):
    """An output path that cannot be used: missing folder, a finished history in the way."""

    exit_code = 2


class WriteError(DembrickError):
    """A write that failed: no permission, a read-only disk, a disk that is full, a folder that is gone."""


class DivergedError(DembrickError):
    """The time stepping left the physical range: NaN, runaway energy, a block thrown away."""


class NotConvergedError(DembrickError):
    """The answer was not reached; ``yield_point`` carries the best bracket found, if there is one."""

    def __init__(self, message: str, yield_point=None):
        super().__init__(message)
        self.yield_point = yield_point


class UndecidedError(NotConvergedError):
    """The dead loads are seen neither to be balanced nor to bring blocks down within the effort made."""

    status = "undecided"


class BracketError(DembrickError):
    """The bounds of a limit load contradict each other: a fault of the program, never of the input."""


class EnergyAuditError(DembrickError):
    """The energy balance of a run is off, or friction created energy."""


class MissingDependency(DembrickError):
    """An optional package or a system library is not installed."""

    exit_code = 4


def needed(package: str, what: str) -> ModuleType:
    """The module of a ``package`` that may be missing; MissingDependency then says ``what`` needs it."""
    try:
        return import_module(package)
    except ImportError as error:
        raise MissingDependency(f"{what} needs {package}; install it with: pip install {package}") from error
