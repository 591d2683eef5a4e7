"""Progress of a long command: a bar on a terminal, elsewhere an occasional line.

The first line comes after ten seconds, others at intervals that double up to ten minutes, to keep long logs short.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dembrick.cli.streams import print_error
from dembrick.simulation.expected_cost import duration

if TYPE_CHECKING:
    from dembrick.simulation.session import Progress

WIDTH = 24  # of a bar
FIRST_LINE, LONGEST_PAUSE = 10.0, 600.0  # s, between lines where there is no terminal
RECENT = 10.0  # s, over which the rate is averaged
OFTEN = 0.1  # s, between two updates of a bar
COMPILING = "compiling (first run of this kind: half a minute; later runs reuse the result)"


class Meter:
    """Shows the progress of a command on standard error; ``printable`` makes text safe for a terminal."""

    def __init__(self, printable: Callable[[str], str], quiet: bool):
        self.bar = sys.stderr.isatty() and not quiet
        self._quiet, self._printable = quiet, printable
        self._began = self._shown = time.monotonic()
        self._next, self._pause = self._began + FIRST_LINE, FIRST_LINE
        self._stage, self._seen = "", [(self._began, 0)]  # times, and how much of the stage was done
        self._drawn = False

    def count(self, done: int, total: int, what: str) -> None:
        """Show how many cases, directions or frames are done: by a bar on a terminal, elsewhere by lines."""
        self._show(done, total, f"{done}/{total} {what}")

    def run(self, progress: Progress) -> None:
        """Show the progress of a run."""
        rate = self._rate(progress)
        total = "" if progress.total is None else f" of {'at most ' if progress.at_most else ''}{progress.total:.6g}"
        parts = [f"{progress.stage} {progress.done:.6g}{total}"]
        if progress.time is not None:
            parts.append(f"t = {progress.time:.4g} s")
        if rate > 0.0:
            parts.append(f"{rate:.3g} per second")
            if progress.total is not None:
                left = duration((progress.total - progress.done) / rate)
                parts.append(f"{'at most ' if progress.at_most else ''}{left} left")
        self._show(progress.done, progress.total, ", ".join(parts))

    def _rate(self, progress: Progress) -> float:
        """Steps per second over about the last ten seconds, as compilation may have slowed those before."""
        now = time.monotonic()
        if self._stage != progress.stage:
            self._stage, self._seen = progress.stage, [(now, progress.done)]
        while len(self._seen) > 2 and now - self._seen[1][0] > RECENT:
            del self._seen[0]
        since, done = self._seen[0]
        if now - self._seen[-1][0] > 0.1 * RECENT:
            self._seen.append((now, progress.done))
        return (progress.done - done) / (now - since) if now > since else 0.0

    def busy(self, text: str) -> None:
        """Show the current activity, on a terminal only."""
        if self.bar:
            self._draw(f"{text} ...")

    def stage(self, text: str) -> None:
        """Show an activity of unknown duration at once, on a terminal or not."""
        self.busy(text)
        if not self.bar and not self._quiet:
            self._line(text)

    def clear(self) -> None:
        """Remove the bar before something else is printed."""
        if self._drawn:
            print_error("\r\033[K", end="")
            self._drawn = False

    def _show(self, done: float, total: float | None, text: str) -> None:
        now = time.monotonic()
        over = total is not None and done >= total
        if self.bar and over:
            self.clear()
        elif self.bar and (not self._drawn or now - self._shown >= OFTEN):
            filled = int(WIDTH * done // max(total, 1)) if total is not None else 0
            bar = "" if total is None else f"[{'#' * filled}{'.' * (WIDTH - filled)}] "
            self._shown = now
            self._draw(bar + text)
        elif not self.bar and not self._quiet and not over and now >= self._next:
            self._pause = min(2.0 * self._pause, LONGEST_PAUSE)
            self._next = now + self._pause
            self._line(text)

    def _draw(self, text: str) -> None:
        room = max(20, shutil.get_terminal_size().columns - 1)
        print_error(f"\r\033[K{self._printable(text)[:room]}", end="")
        self._drawn = True

    def _line(self, text: str) -> None:
        print_error(self._printable(text))


@contextmanager
def telling_of_compilation(tell: Callable[[str], None]) -> Iterator[None]:
    """Context in which ``tell`` is called once if kernels are compiled, by this process or by one that it waits for;
    not if they are loaded from the cache."""
    from dembrick._jit import hearing
    from dembrick._kernel_cache import WAITING

    said: list[str] = []

    def begun() -> None:
        if not said:
            said.append(COMPILING)
            tell(COMPILING)

    with hearing(("numba:compile", WAITING), begun):
        yield
