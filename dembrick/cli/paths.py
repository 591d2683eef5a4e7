"""Where output goes: ``--out``, or ``results/`` in the current folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from dembrick.errors import OutputError, WriteError

RESULTS = "results"
FIGURES = (".png", ".svg", ".pdf")


def default_output(name: str, is_free: Callable[[str], bool] | None = None) -> str:
    """Path ``results/name``; the folder is created if missing.

    If ``is_free`` is False for a path, because another scenario's output is there: ``name_2``, ``name_3``, ...
    """
    make_folder(RESULTS)
    stem, ending = os.path.splitext(name)
    path, number = os.path.join(RESULTS, name), 1
    while is_free is not None and not is_free(path):
        number += 1
        path = os.path.join(RESULTS, f"{stem}_{number}{ending}")
    return path


FRAME = "frame at the limit, the last, or by number, negative from the end (default: peak of a search, else last)"


def require_ending(path: str, endings: Sequence[str], what: str) -> None:
    """Raise OutputError unless a path has one of the ``endings`` with which ``what`` is written."""
    if os.path.splitext(path)[1].lower() not in endings:
        raise OutputError(f"{path}: {what} must have the ending {' or '.join(endings)}")


def frame_of(text: str) -> int | str:
    """Frame that ``--frame`` names: peak, last or a number."""
    return text if text in ("peak", "last") else int(text)


def add_set(parser) -> None:
    """Add the option to change keys of a scenario."""
    parser.add_argument(
        "--set", metavar="KEY.PATH=VALUE", action="append", default=[], help="change a key of the scenario"
    )


def add_force(parser) -> None:
    """Add the option to replace an existing file."""
    parser.add_argument("--force", action="store_true", help="replace an existing file, whatever it holds")


def make_folder(folder: str | os.PathLike) -> Path:
    """Create a folder if missing, and return it; its parent must exist."""
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True)
    except FileNotFoundError as error:
        raise OutputError(f"{path}: its parent folder does not exist; make it first or choose another path") from error
    except FileExistsError as error:
        raise OutputError(f"{path}: this is a file, not a folder; choose another path") from error
    except OSError as error:
        raise WriteError(f"{path}: the folder cannot be made ({error.strerror}); choose another path") from error
    return path
