"""Settings and fixtures that several test modules share."""

import os
from pathlib import Path

import pytest

import dembrick
from dembrick.simulation.statics import stepper

pytest.register_assert_rewrite("helpers")

# A subprocess imports the package under test, not a checkout in its working directory, which would be compiled again.
os.environ["PYTHONSAFEPATH"] = "1"
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(Path(dembrick.__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
)

# Python's bytecode of the package is written once, not by every subprocess.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Three workers on two cores: if two of them wait until a third has compiled a kernel, no core should be idle for long.
# Threads of the linear algebra would compete with them. The workers and their subprocesses read this variable when they
# import numpy, which happens later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Both cores are busy with tests, so no command compiles ahead in a second process (see docs/howto/speed.md).
os.environ["DEMBRICK_COMPILE_AHEAD"] = "0"

# The files that compile or run longest go first, searches and motions in turn: workers compile different kernels.
FIRST = (
    "statics/test_batch.py",
    "dynamics/test_closed_form_motions.py",
    "statics/test_limit_load.py",
    "dynamics/test_motion_runs.py",
    "statics/test_constant_rate.py",
    "kernels/test_contact_friction.py",
    "statics/test_pressures.py",
    "dynamics/test_restitution.py",
    "robustness/test_restart_path_following.py",
    "dynamics/test_threads.py",
    "dynamics/test_impacts.py",
    "runs/test_verification.py",
    "robustness/test_restart.py",
    "views/test_plot.py",
    "cli/test_progress.py",
)


def pytest_collection_modifyitems(items):
    """Run the files of `FIRST` first, in that order, and the others after them in the order of collection."""

    def rank(item) -> int:
        path = item.path.as_posix()
        return next((i for i, name in enumerate(FIRST) if path.endswith(f"/tests/{name}")), len(FIRST))

    items.sort(key=rank)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Empty working directory of the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def few(monkeypatch):
    """Fewer equilibria on the path of settlements and of driven displacements."""
    from helpers.few_equilibria import few_equilibria

    few_equilibria(monkeypatch)


@pytest.fixture
def stop_after(monkeypatch):
    """Run in chunks of one step without waiting for the disk; return the context that interrupts after so many."""
    from helpers.restart_cases import signal_at_look

    monkeypatch.setattr(os, "fsync", lambda _: None)
    monkeypatch.setattr(stepper, "FIRST_WORK", 1)
    monkeypatch.setattr(stepper, "CHUNK_SECONDS", 0.0)
    return signal_at_look
