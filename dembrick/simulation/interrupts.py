"""SIGINT and SIGTERM: a time loop ends after its chunk, anything else at once; a second signal kills.

A signal that comes when a run has its answer finds the answer written first.

Signals belong to the process, so what is known of them is kept here once. Without ``handled`` nothing changes:
Python raises KeyboardInterrupt wherever it is.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from dembrick.errors import DembrickError

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupted(KeyboardInterrupt):
    """A signal ended the run; what was simulated is on disk where a history was asked for."""

    def __init__(self, signum: int, message: str = "interrupted"):
        super().__init__(message)
        self.signum = signum

    @property
    def exit_code(self) -> int:
        """130 for SIGINT, 143 for SIGTERM, as shells have it."""
        return 128 + self.signum


class _Known:
    signum = 0  # that came and was not acted on yet
    deferring = False


def requested() -> int:
    """The number of the signal that asked to stop, 0 for none."""
    return _Known.signum


@contextmanager
def deferred() -> Iterator[None]:
    """Within, a signal is only noted: whoever enters here looks at ``requested`` every second or so."""
    before, _Known.deferring = _Known.deferring, True
    try:
        yield
    finally:
        _Known.deferring = before


@contextmanager
def handled() -> Iterator[None]:
    """Within, SIGINT and SIGTERM raise Interrupted, or wait for the end of a chunk where they are deferred.

    A compiler that is called back in the middle of its work swallows the exception and fails with one of its own, which
    comes out as Interrupted here.
    """
    _Known.signum = 0
    try:
        before = {number: signal.signal(number, _note) for number in SIGNALS}
    except ValueError:  # not the main thread: signals are none of our business
        yield
        return
    unraisable, sys.unraisablehook = sys.unraisablehook, _silent
    try:
        yield
    except Exception as error:
        meant = caused(error)
        if meant is error:
            raise
        raise meant from error
    finally:
        sys.unraisablehook = unraisable
        for number, handler in before.items():
            signal.signal(number, handler)
        _Known.signum = 0


def caused(error: BaseException) -> BaseException:
    """Interrupted in place of an error of another library that came after a signal; else the error itself."""
    ours = isinstance(error, DembrickError | Interrupted)
    return error if ours or not requested() else Interrupted(requested())


def _silent(unraisable) -> None:
    """Hook of Python for exceptions that cannot be raised; one of a signal, which is known anyway, is not printed."""
    if not isinstance(unraisable.exc_value, Interrupted):
        sys.__unraisablehook__(unraisable)


def _note(signum: int, _frame) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)  # the next one kills, whatever is going on
    _Known.signum = signum
    if not _Known.deferring:
        raise Interrupted(signum)
