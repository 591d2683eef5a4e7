"""Compile ahead: while a first run compiles one kernel, a second process compiles what it will want later.

The command line allows it (`second_process`), and a run says what it will want (`meanwhile`). The second process is
started when the first kernel is not found in the cache, so that a run that finds its kernels there pays nothing. It
puts what it compiles into the cache (`_kernel_cache`); a run that comes to a kernel before it is done waits for it
there, and compiles it itself where the second process died. It ends with the first one, however that ends.
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

SWITCH = "DEMBRICK_COMPILE_AHEAD"  # 0 in the environment: no second process
COMMAND = "import pickle, sys; sys.path[:], tasks = pickle.load(sys.stdin.buffer); "
COMMAND += "from dembrick._ahead import work; work(tasks)"

Task = tuple  # a function that a module has by its name, and its arguments
Wanted = Callable[[], list[Task]]


class _Helper:
    """The second process, and what it is to do if a kernel is compiled."""

    def __init__(self):
        self.process: subprocess.Popen | None = None
        self.wanted: Wanted | None = None

    def begin(self) -> None:
        """Start the second process, as a kernel is compiled."""
        wanted, self.wanted = self.wanted, None
        if wanted is not None and (self.process is None or self.process.poll() is not None):
            tasks = wanted()
            if tasks:
                self.start(tasks)

    def start(self, tasks: list[Task]) -> None:
        """Start a process that does the ``tasks``, one after the other; where that fails the run does without."""
        self.stop()
        told = pickle.dumps((sys.path, pickle.dumps(tasks)))
        silent = subprocess.DEVNULL
        with suppress(OSError):
            command = [sys.executable, "-c", COMMAND]
            self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silent, stderr=silent)
            self.process.stdin.write(told)
            self.process.stdin.flush()  # and stays open: its end is the end of this process

    def stop(self) -> None:
        """End it; what it has compiled is kept."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            with suppress(OSError):
                self.process.stdin.close()
            self.process = None


class _Known:
    helper: _Helper | None = None  # within `second_process`


@contextmanager
def second_process() -> Iterator[None]:
    """Within, this process may start another one that compiles, if there is a core for it and a cache to share."""
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
    """Whether a second process would help: two cores, the cache a folder that others find, and locks in it."""
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
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def meanwhile(wanted: Wanted) -> Iterator[None]:
    """Within, a second process does the tasks that ``wanted`` returns if a kernel has to be compiled."""
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
    """The task of compiling a kernel for such ``arguments``."""
    types = tuple(kernel.called.typeof_pyval(argument) for argument in arguments)
    return compile_kernel, kernel.__module__, kernel.__name__, types


def compile_kernel(module: str, name: str, types: tuple) -> None:
    """Compile a kernel for arguments of these types into the cache, if it is not there."""
    getattr(import_module(module), name).called.compile(types)


def work(tasks: bytes) -> None:
    """Work of the second process. A signal from the terminal reaches both processes: the first one acts on it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # a compiler keeps most of what it makes
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    try:
        for function, *arguments in pickle.loads(tasks):
            function(*arguments)
    finally:
        os._exit(0)  # at once: a thread is still reading


def _end_with_the_first() -> None:
    os.read(0, 1)  # nothing comes: it returns when the first process is gone
    os._exit(0)
