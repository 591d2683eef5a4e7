"""Rows recorded in batches equal rows recorded one by one, bit for bit, and none is lost when a run ends or stops."""

import dataclasses

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.kernels.math.sums import room_for_halves, sum_in_pairs
from dembrick.runs.drivers import _set_up
from dembrick.scenario import shipped, toml
from dembrick.simulation.dynamics import loads, recorder, run
from dembrick.simulation.dynamics.loads import LoadsAhead
from dembrick.simulation.dynamics.recorder import Recorder, joined
from dembrick.simulation.session import Session
from helpers.scenario_text import block, header

OVER_AN_EDGE = (
    header("{formulation}", title="A block slides over the edge of its floor, another stays on its own")
    + block("below", (0.0, 0.0, 0.05), more="fixed = true")
    + block("over", (0.0, 0.0, 0.15), more="velocity = [0.9, 0.0, 0.0]")
    + block("beside", (0.0, 1.0, 0.05), more="fixed = true")
    + block("still", (0.0, 1.0, 0.15))
    + """
[control]
kind = "dynamic"
duration = 0.08
[output]
rows = 200
frames = 20
"""
)
SHAKEN = ["control.duration=0.05", "output.rows=300", "output.frames=40"]


def observed(scenario, most=None):
    """All rows and frames that the observer of a run gets, and the number of calls; the run stops at step ``most``."""
    calls = []

    def observe(rows, frames):
        calls.append((rows, frames))

    moving, driving = _set_up(scenario, assemble(scenario))
    run.ask_for(moving, scenario.output, driving)
    session = Session(observe, scenario.output)
    if most is not None:
        session.tell = lambda progress: stop_at(most, moving, scenario)
        session.last_told = -np.inf
    try:
        run.run(moving, scenario.control, driving, session)
    except ZeroDivisionError:
        assert most is not None
    return joined([rows for rows, _ in calls]), joined([frames for _, frames in calls if frames]), len(calls)


def stop_at(most, moving, scenario):
    if moving.steps >= most:
        raise ZeroDivisionError


def same(one, other):
    assert one.keys() == other.keys()
    for name, value in one.items():
        if isinstance(value, dict):
            same(value, other[name])
        else:
            np.testing.assert_array_equal(value, other[name])


@pytest.mark.parametrize("stem", ["newmark_pulse", "arch_shaken", "rocking_block"])
def test_rows_together_are_the_rows_one_by_one(monkeypatch, stem):
    scenario = toml.load(shipped.folder() / f"{stem}.toml", SHAKEN)
    together, frames, calls = observed(scenario)
    monkeypatch.setattr(recorder, "TOGETHER", 1)
    monkeypatch.setattr(loads, "AHEAD", 1)
    alone, own_frames, each = observed(scenario)
    assert calls < 0.2 * each == 0.2 * len(alone["time"])
    assert len(alone["time"]) >= 300 and len(own_frames["time"]) >= 40
    same(together, alone)
    same(frames, own_frames)


@pytest.mark.parametrize("formulation", ["convex", "concave", "distributed"])
def test_rows_are_of_the_joints_as_they_are_once_polygons_were_cut(monkeypatch, formulation):
    """Rows hold the joints after the cut: blocks share a polygon until one slides over an edge and gets its own."""
    scenario = toml.loads(OVER_AN_EDGE.format(formulation=formulation))
    together, _, calls = observed(scenario)
    with monkeypatch.context() as changed:
        changed.setattr(recorder, "TOGETHER", 1)
        changed.setattr(loads, "AHEAD", 1)
        alone, _, each = observed(scenario)
    assert calls < 0.2 * each == 0.2 * len(alone["time"])
    same(together, alone)
    monkeypatch.setattr(recorder, "in_one_thread", lambda motion: False)  # Python takes every row
    taken, _, _ = observed(scenario)
    same(together, taken)


def test_an_error_in_the_run_loses_no_row(monkeypatch):
    scenario = toml.load(shipped.folder() / "newmark_pulse.toml", SHAKEN)
    whole, _, _ = observed(scenario)
    monkeypatch.setattr("dembrick.simulation.session.TOLD_EVERY", 0.0)
    steps = round(whole["time"][130] / whole["time"][1]) * round(whole["time"][1] / first_step(scenario))
    cut, _, _ = observed(scenario, most=steps)
    assert len(cut["time"]) == 131
    np.testing.assert_array_equal(cut["time"], whole["time"][:131])
    np.testing.assert_array_equal(cut["joint"], whole["joint"][:131])


def first_step(scenario):
    return _set_up(scenario, assemble(scenario))[0].time_step


def test_a_snapshot_finds_every_row_passed_on():
    scenario = toml.load(shipped.folder() / "newmark_pulse.toml", SHAKEN)
    scenario = dataclasses.replace(scenario, output=dataclasses.replace(scenario.output, checkpoint=0.0))
    times, kept = [], []
    moving, driving = _set_up(scenario, assemble(scenario))
    run.ask_for(moving, scenario.output, driving)
    session = Session(lambda rows, frames: times.extend(rows["time"]), scenario.output)
    session.keep = lambda arrays, where: times and kept.append((len(times), times[-1], arrays["loop"][:2].prod()))
    run.run(moving, scenario.control, driving, session)
    assert len(kept) > 200
    for count, (n, last, now) in enumerate(kept, 2):
        assert n == count and last == pytest.approx(now, rel=1e-14)


def test_large_rows_do_not_wait(monkeypatch):
    monkeypatch.setattr(recorder, "MOST_WAITING", 100)
    rows, _, calls = observed(toml.load(shipped.folder() / "newmark_pulse.toml", SHAKEN))
    assert calls == len(rows["time"]) >= 300


@pytest.mark.parametrize("channels", [("joints", "energy", "frames"), ("frames", "velocity")])
def test_the_loop_writes_the_rows_that_it_passes(monkeypatch, channels):
    """Python takes only a few rows: the last, those that are requested, and those with frames of velocities."""
    scenario = toml.load(shipped.folder() / "newmark_pulse.toml", SHAKEN)
    scenario = dataclasses.replace(scenario, output=dataclasses.replace(scenario.output, channels=channels))
    taken, take = [], Recorder.take

    def counted(self, last=False, equilibrium=None):
        taken.append(self._moving.steps)
        take(self, last, equilibrium)

    monkeypatch.setattr(Recorder, "take", counted)
    monkeypatch.setattr(recorder, "HELD", 10.0)  # however slow the machine
    rows, frames, _ = observed(scenario)
    assert len(rows["time"]) >= 300 and len(frames["time"]) >= 40
    assert len(taken) < (0.1 if "velocity" not in channels else 0.25) * len(rows["time"])
    np.testing.assert_allclose(np.diff(rows["time"])[:-1], rows["time"][1], rtol=1e-9)
    np.testing.assert_array_equal(frames["time"][:-1], rows["time"][:: 300 // 40][: len(frames["time"]) - 1])


@pytest.mark.parametrize("n", [0, 1, 7, 8, 100, 129, 1000, 5003])
def test_sums_in_pairs_are_those_of_numpy(n):
    values = np.random.default_rng(n).normal(size=n) * 10.0 ** np.arange(n % 7, n % 7 + n).clip(0, 9)
    assert sum_in_pairs(values, room_for_halves()) == values.sum()


@pytest.mark.parametrize(
    "motion",
    [
        "sine = { amplitude = 2.0, frequency = 3.0, phase = 0.3 }",
        'quantity = "velocity"\nsine = { amplitude = 2.0, frequency = 3.0 }',
        "pulse = { amplitude = 4.9, duration = 0.02, start = 0.01 }",
    ],
)
def test_loads_found_ahead_are_those_of_each_step(motion):
    text = (shipped.folder() / "newmark_pulse.toml").read_text()
    text = text.replace("pulse = { amplitude = 4.905, duration = 0.2 }", motion)
    load = '[[loads]]\nblock = "block"\nforce = [3.0, 0.0, -9.0]\nsine = { amplitude = 1.0, frequency = 7.0 }\n'
    scenario = toml.loads(text.replace("[control]", f"{load}\n[control]"))
    moving, driving = _set_up(scenario, assemble(scenario))
    ahead, dt = LoadsAhead(), moving.time_step
    none = driving.prescribed(np.zeros(1), dt)
    for first, count in ((0, 4), (4, 4), (8, 3), (11, 7), (500, 9), (509, 6), (30, 2), (32, 64)):
        found = ahead.of(driving, first, count, dt)
        alone = driving.loads((first + np.arange(count)) * dt, dt, none)
        for name in ("force", "gravity", "multiplier", "height"):
            array = getattr(found, name)
            assert array.flags.c_contiguous
            np.testing.assert_array_equal(array[:count], getattr(alone, name))
        gravity = ahead.gravity(driving, first + count, dt)
        if gravity is not None:
            np.testing.assert_array_equal(gravity, driving.forces(np.array([(first + count) * dt]), dt)[0][0])
