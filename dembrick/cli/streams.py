"""Standard output and standard error, which may be closed, full, or a pipe whose reader has gone."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from dembrick.errors import WriteError


def open_closed() -> None:
    """Open the null device for streams that were closed before the start; else a file opened later takes their number
    and gets their output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            with suppress(OSError):
                os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - until the process ends


def mute(stream) -> None:
    """Redirect a stream to the null device: its buffer can no longer be written, and Python would try at exit."""
    with suppress(OSError, ValueError):  # no file at all, as in a test
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def print_output(text: str) -> None:
    """Print on standard output. WriteError if that cannot be written, BrokenPipeError if its reader has gone."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        mute(sys.stdout)
        reason = getattr(error, "strerror", None) or error
        raise WriteError(f"standard output could not be written ({reason})") from None


def print_error(text: str, end: str = "\n") -> None:
    """Print on standard error, ignoring errors: a lost remark must not cost the answer."""
    try:
        print(text, end=end, file=sys.stderr, flush=True)
    except (OSError, ValueError):
        mute(sys.stderr)
