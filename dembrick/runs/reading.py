"""Read scenarios: TOML files, shipped ones by name, and histories, which hold their scenario and the files it reads."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from dembrick.errors import HistoryError
from dembrick.runs import custom_law
from dembrick.scenario import toml

if TYPE_CHECKING:
    from dembrick.history import History
    from dembrick.scenario.model import Scenario
    from dembrick.scenario.overrides import Overrides

WENT_ON = "went_on"  # setting of a history: the history that its run continued, and from what time


def load(path: str | os.PathLike, overrides: Overrides = (), regular: bool = False) -> Scenario:
    """Read a scenario: a TOML file, a history (with the files that its run read), or a shipped scenario by its name if
    there is no such file.

    ``overrides`` are ``key.path=value`` texts, as for ``--set``, or a mapping of key paths to values. ``regular``:
    refuse a pipe, which a user may name, but no other file may.
    """
    path = os.fsdecode(path)
    if not is_hdf5(path):
        return toml.load(path, overrides, regular)
    from dembrick.history import read  # imports h5py, for histories only

    with read(path) as history:
        require_repeatable(history)
        return history.scenario(path, overrides)


def came_from(settings: Mapping) -> dict:
    """Settings of a history that name the history that its run continued; empty if none."""
    found = settings.get(WENT_ON)
    return {WENT_ON: found} if isinstance(found, dict) else {}


def require_repeatable(history: History) -> None:
    """Raise HistoryError if a run cannot be repeated from its scenario alone: it continued another run, or followed a
    joint law of the user's own."""
    custom_law.require_repeatable(history)
    found = came_from(history.settings).get(WENT_ON)
    if found:
        raise HistoryError(
            f"{history.path}: this run continued {found.get('file')} at {found.get('at')}, and its scenario alone "
            f"cannot repeat it; use that history: dembrick restart {found.get('file')} --at {found.get('at')} --set "
            "... --out NEW.h5"
        )


def is_hdf5(path: str) -> bool:
    """Whether a file is a history, by its first bytes; False for a pipe, which can be read only once."""
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return file.read(8) == b"\x89HDF\r\n\x1a\n"
    except OSError:
        return False  # reading the scenario reports why
