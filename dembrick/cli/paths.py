"""Where output goes: ``--out``, or ``results/`` in the current folder."""

from __future__ import annotations

import os
from pathlib import Path

from dembrick.errors import OutputError, WriteError

RESULTS = "results"


def default_output(name: str) -> str:
    """``results/name``, with the folder made if missing."""
    make_folder(RESULTS)
    return os.path.join(RESULTS, name)


def make_folder(folder: str | os.PathLike, parents: bool = False) -> Path:
    """The folder, made if missing; its parent must exist."""
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True, parents=parents)
    except FileNotFoundError as error:
        raise OutputError(f"{path}: its parent folder does not exist; make it first or choose another path") from error
    except FileExistsError as error:
        raise OutputError(f"{path}: this is a file, not a folder; choose another path") from error
    except OSError as error:
        raise WriteError(f"{path}: the folder cannot be made ({error.strerror}); choose another path") from error
    return path
