"""SIGINT and SIGTERM: a time loop ends after its chunk, anything else at once; a second signal kills.

If a signal arrives when a run has finished computing, its results are still written first.

Signals belong to the process, so their state is kept here once. Without ``handled`` nothing changes:
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
    """A signal ended the run; the simulation so far is on disk if a history was requested."""

    def __init__(self, signum: int, message: str = "interrupted"):
        super().__init__(message)
        self.signum = signum

    @property
    def exit_code(self) -> int:
        """130 for SIGINT, 143 for SIGTERM, as shells have it."""
        return 128 + self.signum


class _Known:
    signum = 0  # of a signal that has arrived and is not handled yet
    deferring = False


def requested() -> int:
    """The number of the signal that asked to stop, 0 for none."""
    return _Known.signum


@contextmanager
def deferred() -> Iterator[None]:
    """Context in which a signal is only noted: the caller must check ``requested`` every second or so."""
    before, _Known.deferring = _Known.deferring, True
    try:
        yield
    finally:
        _Known.deferring = before


@contextmanager
def handled() -> Iterator[None]:
    """Context in which SIGINT and SIGTERM raise Interrupted, or wait for the end of a chunk if deferred.

    A compiler that is interrupted by the exception swallows it and fails with one of its own, which is turned into
    Interrupted here.
    """
    _Known.signum = 0
    try:
        before = {number: signal.signal(number, _note) for number in SIGNALS}
    except ValueError:  # not the main thread, which alone can handle signals
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
    """Hook for exceptions that Python cannot raise; that of a signal, which is noted anyway, is not printed."""
    if not isinstance(unraisable.exc_value, Interrupted):
        sys.__unraisablehook__(unraisable)


def _note(signum: int, _frame) -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)  # the next one kills the process
    _Known.signum = signum
    if not _Known.deferring:
        raise Interrupted(signum)
