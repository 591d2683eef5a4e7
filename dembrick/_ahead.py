"""Ahead-of-time compilation: while a first run compiles one kernel, a second process compiles those needed later.

The command line enables this (`second_process`), and a run states what it will need (`compile_ahead`). The second
process starts when the first kernel is not found in the cache, so that a run that finds its kernels there pays nothing.
It stores what it compiles in the cache (`_kernel_cache`). A run that reaches a kernel before it is ready waits for it
there, and compiles it itself if the second process died. The second process ends with the first, however that ends.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module

from dembrick import _file_locks, _kernel_cache
from dembrick._jit import WHY_PUBLIC, hearing
from dembrick._kernel_sources import compiler_hash

SWITCH = "DEMBRICK_COMPILE_AHEAD"  # 0 in the environment disables the second process
COMMAND = "import pickle, sys; sys.path[:], tasks = pickle.load(sys.stdin.buffer); "
COMMAND += "from dembrick._ahead import work; work(tasks)"

Task = tuple  # a function at the top level of a module, and its arguments
Wanted = Callable[[], list[Task]]


class _Helper:
    """The second process, and its tasks if a kernel is compiled."""

    def __init__(self):
        self.process: subprocess.Popen | None = None
        self.wanted: Wanted | None = None

    def begin(self) -> None:
        """Start the second process when a kernel is compiled."""
        wanted, self.wanted = self.wanted, None
        if wanted is not None and (self.process is None or self.process.poll() is not None):
            tasks = wanted()
            if tasks:
                self.start(tasks)

    def start(self, tasks: list[Task]) -> None:
        """Start a process that executes the ``tasks`` in order; if that fails, the run continues without it."""
        self.stop()
        told = pickle.dumps((sys.path, pickle.dumps(tasks)))
        silent = subprocess.DEVNULL
        with suppress(OSError):
            command = [sys.executable, "-c", COMMAND]
            self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silent, stderr=silent)
            self.process.stdin.write(told)
            self.process.stdin.flush()  # and is not closed: its end of file signals the end of this process

    def stop(self) -> None:
        """End the process; what it has compiled remains in the cache."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            with suppress(OSError):
                self.process.stdin.close()
            self.process = None


class _Known:
    helper: _Helper | None = None  # set within `second_process`


@contextmanager
def second_process() -> Iterator[None]:
    """Context in which this process may start a second one that compiles, if there is a core and a shared cache."""
    if not possible() or _Known.helper is not None:
        yield
        return
    helper = _Known.helper = _Helper()
    try:
        with hearing(("numba:compile",), helper.begin):
            yield
    finally:
        _Known.helper = None
        helper.stop()


def possible() -> bool:
    """Whether a second process would help: needs two cores, a cache folder that it finds too, and file locks."""
    kept = _kernel_cache.CACHE_FOLDER.name == compiler_hash()
    return (
        os.environ.get(SWITCH) != "0"
        and not WHY_PUBLIC
        and cores() > 1
        and kept
        and _file_locks.known()
        and bool(sys.executable)
    )


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def compile_ahead(wanted: Wanted) -> Iterator[None]:
    """Context in which a second process executes the tasks returned by ``wanted`` if a kernel has to be compiled."""
    helper = _Known.helper
    if helper is None or helper.wanted is not None:
        yield
        return
    helper.wanted = wanted
    try:
        yield
    finally:
        helper.wanted = None


def compiling(kernel, arguments: tuple) -> Task:
    """Task: compile a kernel for arguments of the types of these."""
    types = tuple(kernel.called.typeof_pyval(argument) for argument in arguments)
    return compile_kernel, kernel.__module__, kernel.__name__, types


def compile_kernel(module: str, name: str, types: tuple) -> None:
    """Compile a kernel for arguments of these types into the cache, unless it is there."""
    getattr(import_module(module), name).called.compile(types)


def work(tasks: bytes) -> None:
    """Main function of the second process. It ignores SIGINT, which the terminal sends to both processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # nearly all objects of a compiler live on
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    try:
        for function, *arguments in pickle.loads(tasks):
            function(*arguments)
    finally:
        os._exit(0)  # immediately, as a thread is blocked in a read


def _end_with_the_first() -> None:
    os.read(0, 1)  # returns only at end of file, when the first process has ended
    os._exit(0)
