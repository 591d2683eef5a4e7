"""Runs that are stopped: their scenarios, child processes that receive signals, and a comparison of two histories."""

import dataclasses
import itertools
import json
import math
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import h5py
import numpy as np
import pytest

from dembrick.history import read
from dembrick.runs import stages
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
from dembrick.scenario import model
from dembrick.simulation import interrupts
from dembrick.simulation.interrupts import Interrupted
from dembrick.simulation.session import Session


def case(name, formulation, tolerance=1e-3, checkpoint=0.0, **output):
    """A lab scenario with a checkpoint after every chunk, or every ``checkpoint`` seconds; a curve is cut short."""
    given = lab_scenario(name, formulation, tolerance)
    if given.control.kind == "displacement":
        given = dataclasses.replace(given, control=model.DisplacementControl(1e-3, 1.5e-5))
    if formulation == "distributed":  # points given: placing them is a search of its own, which would be stopped too
        given = dataclasses.replace(given, joint=dataclasses.replace(given.joint, points=(6, 5)))
    return dataclasses.replace(given, output=model.Output(model.CHANNELS, checkpoint=checkpoint, **output))


def content(path):
    """All datasets of a history, with its results and settings but for the name of the file and wall times, also those
    of stages."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, node: found.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None)
        found["status"], found["settings"] = file.attrs["status"], json.loads(file.attrs["settings"])
        found["results"] = json.loads(file.attrs["results"])
    for results in (found["results"], *found["results"].get("stages", ())):
        for key in ("wall", "history"):
            results.pop(key, None)
    return found


def check_same(first, second):
    one, other = content(first), content(second)
    assert set(one) == set(other)
    for name, value in one.items():
        if isinstance(value, np.ndarray) and value.dtype != object:
            assert value.tobytes() == other[name].tobytes(), name
        else:
            assert np.array_equal(value, other[name]) if isinstance(value, np.ndarray) else value == other[name], name


@contextmanager
def signal_at_look(number, signum=signal.SIGINT, match=None):
    """Signal a run the ``number``-th time that it checks for signals; the interrupt's message must match ``match``."""
    looks = itertools.count(1)
    with pytest.MonkeyPatch.context() as patch, pytest.raises(Interrupted, match=match) as stopped:
        patch.setattr(interrupts, "requested", lambda: signum if next(looks) == number else 0)
        yield stopped


def stop_at_look(given, path, number):
    """Simulate until a signal arrives at the ``number``-th time that the run checks for one."""
    with signal_at_look(number):
        simulate(given, path)


@contextmanager
def counted_looks():
    """A list that grows each time the run checks for a signal; none arrives."""
    looks = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interrupts, "requested", lambda: looks.append(0) or 0)
        yield looks


def rewritten(checkpoint, **changes):
    """The checkpoint with some arrays replaced by values or by functions of them (None: removed); checksums fit."""
    with np.load(checkpoint) as found:
        arrays = dict(found)
    arrays |= {name: change(arrays[name]) if callable(change) else change for name, change in changes.items()}
    with open(checkpoint, "wb") as file:
        np.savez(file, **{name: value for name, value in arrays.items() if value is not None})


def rows_of(path):
    """Number of rows in a history; -1 if there is no file yet."""
    if not path.exists():
        return -1
    with read(path) as file:
        return file.n_row


@contextmanager
def told_of_checkpoints(tell, often=True):
    """Call ``tell`` after every checkpoint of a staged run: its position, and whether a stage has been completed.

    ``often``: checkpoints are due at every pause, whatever the scenario says.
    """
    original, pause = stages.Stages._keeping, Session.pause

    def due(self, run, within=False):
        self.last_kept = -math.inf
        pause(self, run, within)

    def keeping(self, session, between=False):
        keep = original(self, session, between)

        def kept(arrays, where):
            keep(arrays, where)
            tell(where, between or self.done > 0)

        return None if keep is None else kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages.Stages, "_keeping", keeping)
        patch.setattr(Session, "pause", due if often else pause)
        yield


def stop_in_stages(given, path, stop, often=True):
    """Simulate until ``stop`` of the arguments that `told_of_checkpoints` passes is true."""

    def tell(where, later):
        if stop(where, later):
            raise Interrupted(15, "stopped")

    with told_of_checkpoints(tell, often), pytest.raises(Interrupted):
        simulate(given, path, force=True)


SLOW = """
import sys, time
from dembrick.simulation import interrupts as interruption
from dembrick.cli import main
looked = interruption.requested
interruption.requested = lambda: (time.sleep(0.05), looked())[1]
sys.exit(main())
"""  # takes some seconds however fast the machine is, so a signal arrives long before the end


def dembrick(*arguments, code="import sys; from dembrick.cli import main; sys.exit(main())", **options):
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def wait_for(condition, child, what):
    """Wait until ``condition`` is true while the child process is alive."""
    deadline = time.monotonic() + 600
    while not condition():
        assert child.poll() is None, f"the child ended before {what}: {child.stderr.read()}"
        assert time.monotonic() < deadline, what
        time.sleep(0.02)
