"""Where the cases of a study run: in this process, in local worker processes, or on an existing Dask cluster.

All three take a stream of chunks of cases and yield the rows of a chunk as soon as it is done. No more chunks are
submitted at a time than keep the workers busy, so that memory does not grow with the study.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from dembrick.errors import DembrickError, MissingDependency, ScenarioError

Chunk = list[tuple]
_AHEAD = 2  # chunks submitted per worker
_ONE_THREAD = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class ClusterError(DembrickError):
    """A scheduler that does not answer, or a cluster that lost its workers."""


def run_here(function: Callable, chunks: Iterable[Chunk], *arguments) -> Iterator[list[dict]]:
    """Run one chunk after the other in this process."""
    for chunk in chunks:
        yield function(*arguments, chunk)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Context in which new processes compute with one thread, as workers share the cores."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _by_one_thread(function: Callable, *arguments) -> list[dict]:
    """Call ``function`` with one thread, in a worker of a cluster."""
    for name, value in _ONE_THREAD.items():
        os.environ.setdefault(name, value)
    return function(*arguments)


def run_local(function: Callable, chunks: Iterable[Chunk], jobs: int, *arguments) -> Iterator[list[dict]]:
    """Run in ``jobs`` worker processes of one thread each, spawned so that it works on every system."""
    import multiprocessing

    others = set(multiprocessing.active_children())
    # workers ignore a signal from the terminal; this process, which gets it too, acts on it
    alone = signal.SIGINT, signal.SIG_IGN
    chunks = iter(chunks)
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), signal.signal, alone) as pool:
        pending: set[Future] = set()
        try:
            while True:
                while len(pending) < _AHEAD * jobs and (chunk := next(chunks, None)) is not None:
                    with _one_thread():  # a chunk starts a worker if none is idle; this process keeps its threads
                        pending.add(pool.submit(function, *arguments, chunk))
                if not pending:
                    return
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except BrokenProcessPool as error:
            raise DembrickError(
                "a worker process died (killed, or out of memory); finished cases are kept: repeat the command, "
                "with fewer --jobs if memory was short"
            ) from error
        except BaseException:
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()  # do not wait for running cases when a study is stopped
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def run_on_cluster(
    function: Callable, chunks: Iterable[Chunk], scheduler: str, timeout: float, *arguments
) -> Iterator[list[dict]]:
    """Run on the workers of a Dask scheduler, given by address or by a scheduler file.

    Dask reruns a chunk if its worker is lost; only returned rows are kept, so that no case is lost and none counts
    twice. Raises ClusterError if the scheduler does not answer, or has no worker, within ``timeout`` seconds.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise MissingDependency(
            "--scheduler needs Dask, which is not installed: pip install 'dembrick[cluster]'"
        ) from None
    where = {"scheduler_file": scheduler} if os.path.isfile(scheduler) else {"address": scheduler}
    if not os.path.isfile(scheduler) and ":" not in scheduler:
        raise ScenarioError(
            f"--scheduler {scheduler!r} is neither a scheduler file nor an address such as tcp://10.0.0.1:8786"
        )
    try:
        client = Client(**where, timeout=timeout, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ClusterError(
            f"the scheduler {scheduler} did not answer within {timeout:g} s ({type(error).__name__}): check that it "
            "runs, and its address; finished cases are kept"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=timeout)
        except TimeoutError as error:
            raise ClusterError(
                f"the scheduler {scheduler} has had no worker for {timeout:g} s: start workers"
            ) from error
        chunks = iter(chunks)

        def submit():
            chunk = next(chunks, None)
            return (
                None
                if chunk is None
                else client.submit(_by_one_thread, function, *arguments, chunk, pure=False, retries=3)
            )

        ahead = _AHEAD * max(1, sum(client.nthreads().values()))
        first = [future for _ in range(ahead) if (future := submit()) is not None]
        queue = as_completed(first, loop=client.loop)  # not that of another client in this process
        for future in queue:
            rows = future.result()
            future.release()
            if (following := submit()) is not None:
                queue.add(following)
            yield rows
