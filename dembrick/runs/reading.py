"""Scenarios from files: TOML, the names of shipped ones, and histories, which hold their scenario and what it reads."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

from dembrick.scenario import toml

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario


def load(path: str | os.PathLike, overrides: Iterable[str] = (), regular: bool = False) -> Scenario:
    """Read a scenario: a TOML file, a history (with the files that its run read), or a shipped scenario by its name if
    there is no such file.

    ``overrides`` are ``key.path=value`` texts, as for ``--set``. ``regular``: refuse a pipe, which a user may well read
    from, but which no other file may name.
    """
    path = os.fsdecode(path)
    if not is_hdf5(path):
        return toml.load(path, overrides, regular)
    from dembrick.history import read  # and h5py: for histories only

    with read(path) as history:
        return history.scenario(path, overrides)


def is_hdf5(path: str) -> bool:
    """Whether a file is a history and not a text, by its first bytes; a pipe gives them once, and is none."""
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as file:
            return file.read(8) == b"\x89HDF\r\n\x1a\n"
    except OSError:
        return False  # whoever reads the scenario says why
