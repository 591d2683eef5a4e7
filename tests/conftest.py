"""What several test modules ask for by name."""

import os
from pathlib import Path

import pytest

import dembrick
from dembrick.simulation.statics import stepper

pytest.register_assert_rewrite("helpers")

# A subprocess takes the package under test, not a checkout that it happens to be started in, which would be compiled
# once more.
os.environ["PYTHONSAFEPATH"] = "1"
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(Path(dembrick.__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
)

# Python's bytecode of the package is made once, not by each of them.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A worker a core: threads of the linear algebra would wait for one another, which takes both cores at once. The workers
# and what they start read it as numpy is imported, which comes later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Both cores are busy with tests: no command compiles ahead in a second process (see docs/howto/speed.md).
os.environ["DEMBRICK_COMPILE_AHEAD"] = "0"

# What compiles or runs longest goes first, searches beside motions: two workers then compile different kernels.
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
    """Order files by `FIRST`, the others after them as they were found."""

    def rank(item) -> int:
        path = item.path.as_posix()
        return next((i for i, name in enumerate(FIRST) if path.endswith(f"/tests/{name}")), len(FIRST))

    items.sort(key=rank)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder, in which the test works."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def stop_after(monkeypatch):
    """Chunks of one step, without waiting for the disk; and what has a signal come after so many of them."""
    from helpers.restart_cases import signal_at_look

    monkeypatch.setattr(os, "fsync", lambda _: None)
    monkeypatch.setattr(stepper, "FIRST_WORK", 1)
    monkeypatch.setattr(stepper, "CHUNK_SECONDS", 0.0)
    return signal_at_look
