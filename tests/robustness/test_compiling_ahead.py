"""A second process compiles what a first run will need later: its code is used, waited for, and it always ends."""

import math
import time
from dataclasses import replace

import pytest

from dembrick import _ahead, _file_locks, _kernel_cache
from dembrick.assembly.build import assemble
from dembrick.cli import main, warmup
from dembrick.errors import ScenarioError
from dembrick.kernels.dynamics.contact_forces import touch
from dembrick.kernels.dynamics.loop import Contacts, advance_bodies
from dembrick.runs import lab
from dembrick.runs import simulate as simulate_module
from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block, Prism
from dembrick.scenario.controls import DynamicControl, SettlementControl
from dembrick.simulation.dynamics import chunks, run
from dembrick.simulation.dynamics.recorder import Recorder
from helpers.second_process import python

KERNELS = """
from dembrick.kernels.math.vectors import product
from dembrick.kernels.math.vectors import cross

def misses_and_hits(kernel):
    return [sum(found.values()) for found in (kernel.called.stats.cache_misses, kernel.called.stats.cache_hits)]
"""
AHEAD = """
with _ahead.second_process(), _ahead.compile_ahead(lambda: {tasks}):
    product(*8 * [1.0])
    helper = _ahead._Known.helper.process
    ended = helper and helper.wait(60)
    cross(*6 * [1.0])
print(ended, *misses_and_hits(product), *misses_and_hits(cross))
"""
BESIDE = "[_ahead.compiling(cross, 6 * (1.0,))]"
MEET = """
import sys
from numba.core import event

class Stop(event.Listener):
    def on_start(self, event):
        print("{says}", flush=True)
        sys.stdin.readline()

    def on_end(self, event):
        pass

event.register("{what}", Stop())
product(*8 * [1.0])
print(*misses_and_hits(product))
"""
KILLED = """
from helpers.second_process import hold
helper = _ahead._Helper()
helper.start([(hold, {folder!r}, 1)])
print("started", flush=True)
input()
"""


def out(process):
    """Words that a script printed until it ended."""
    found, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return found.split()


def until(condition, what):
    """Wait for a condition that other processes bring about."""
    for _ in range(1200):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError(f"after a minute: not {what}")


@pytest.fixture
def allowed(monkeypatch):
    """Turn on compiling ahead, which the suite turns off, and pretend to have a second core."""
    monkeypatch.setenv(_ahead.SWITCH, "1")
    monkeypatch.setattr(_ahead, "cores", lambda: 2)


def test_what_the_second_process_compiled_is_found_and_a_warm_run_starts_none(tmp_path):
    cold = python(KERNELS + AHEAD.format(tasks=BESIDE), tmp_path)
    assert out(cold) == ["0", "1", "0", "0", "1"]  # cross: no miss and a hit
    warm = python(KERNELS + AHEAD.format(tasks=BESIDE), tmp_path)
    assert out(warm) == ["None", "0", "1", "0", "1"]


def test_a_second_process_that_dies_is_no_harm(tmp_path):
    code = "import os\n" + KERNELS + AHEAD.format(tasks=f"[(os._exit, 3), *{BESIDE}]")
    assert out(python(code, tmp_path)) == ["3", "1", "0", "1", "0"]


def test_two_processes_that_want_one_kernel_compile_it_once(tmp_path):
    """The first process stops as it begins to compile; the second waits and then loads what the first has compiled."""
    first = python(KERNELS + MEET.format(what="numba:compile", says="compiling"), tmp_path)
    assert first.stdout.readline() == "compiling\n"
    second = python(KERNELS + MEET.format(what=_kernel_cache.WAITING, says="waiting"), tmp_path)
    assert second.stdout.readline() == "waiting\n"
    first.stdin.write("\n" * 1000)  # it stops at every kernel that this kernel calls
    first.stdin.flush()
    assert out(first)[-2:] == ["1", "0"]
    second.stdin.write("\n")
    assert out(second) == ["0", "1"]


def test_nobody_waits_for_ever(tmp_path, monkeypatch):
    """A stopped process keeps its claim: after `PATIENCE` others compile what it was to compile."""
    monkeypatch.setattr(_kernel_cache, "PATIENCE", 0.1)
    folder = tmp_path / "claims"
    folder.mkdir()
    holder = python(f"from helpers.second_process import hold\nhold({str(folder)!r}, 1)", tmp_path)
    try:
        claims = _kernel_cache.Claims(folder / ".claims")
        until((folder / ".claims").exists, "claimed")
        until(lambda: not claims.take(1) or claims.let_go(1), "claimed")
        assert claims.take(2)
        claims.wait(1)
        assert not claims.take(1)
    finally:
        holder.kill()
        holder.wait()
    assert claims.take(1)  # a process that dies leaves no claim


@pytest.mark.parametrize("end", [None, KeyboardInterrupt])
def test_the_second_process_ends_with_the_command(allowed, end):
    with pytest.raises(end or ZeroDivisionError), _ahead.second_process():
        helper = _ahead._Known.helper
        helper.start([(time.sleep, 600.0)])
        process = helper.process
        assert process.poll() is None
        raise end or ZeroDivisionError
    assert process.returncode is not None and _ahead._Known.helper is None


def test_the_second_process_ends_with_the_first_when_that_is_killed(tmp_path):
    claims = _kernel_cache.Claims(tmp_path / ".claims")
    first = python(KILLED.format(folder=str(tmp_path)), tmp_path)
    assert first.stdout.readline() == "started\n"
    until((tmp_path / ".claims").exists, "at work")
    until(lambda: not claims.take(1) or claims.let_go(1), "at work")
    first.kill()
    first.wait()
    until(lambda: claims.take(1), "ended")


def test_no_second_process_without_a_core_a_shared_cache_or_locks(allowed, monkeypatch, tmp_path):
    assert _ahead.possible()
    for module, name, value in (
        (_ahead, "cores", lambda: 1),
        (_kernel_cache, "CACHE_FOLDER", tmp_path),  # a cache of this process alone
        (_file_locks, "fcntl", None),
    ):
        with monkeypatch.context() as changed:
            changed.setattr(module, name, value)
            assert not _ahead.possible()
    monkeypatch.setenv(_ahead.SWITCH, "0")
    with _ahead.second_process():
        assert _ahead._Known.helper is None


def arguments_of(kernel):
    """Names of the arguments of a kernel."""
    code = kernel.__wrapped__.__code__
    return code.co_varnames[: code.co_argcount]


@pytest.mark.parametrize("formulation", warmup.FORMULATIONS)
def test_what_contacts_do_is_compiled_ahead_for_what_the_loop_calls_it_with(monkeypatch, formulation):
    """The task that a run submits compiles the contact forces for the types that the loop has when blocks meet."""
    tasks = []

    def heard(wanted):
        tasks.extend(wanted())
        return _ahead.compile_ahead(wanted)

    monkeypatch.setattr(chunks, "compile_ahead", heard)
    scene = warmup._scene(formulation, DynamicControl(2e-3), warmup.LOW, warmup.THROWN)
    assert simulate(scene).run.motion.contact_detection.touching is not None
    ((function, *kernel, types),) = tasks
    assert function is _ahead.compile_kernel and kernel == [touch.__module__, "touch"]
    assert types in touch.called.overloads
    found = []
    for one in advance_bodies.called.overloads:
        loop = dict(zip(arguments_of(advance_bodies), one, strict=True))
        loop |= dict(zip(Contacts._fields, loop["contacts"].types, strict=True))
        found.append(tuple(loop[argument] for argument in arguments_of(touch)))
    assert types in found


def test_the_second_process_starts_with_the_first_kernel_of_a_settlement(monkeypatch, tmp_path):
    """The loop is compiled first, within `compile_ahead`; the kernels of rows while the second process is at work."""
    order = []

    def started(wanted):
        order.append("loop")
        return _ahead.compile_ahead(wanted)

    def looked(recorder, compiled=Recorder.compile):
        order.append("rows")
        compiled(recorder)
        raise KeyboardInterrupt

    monkeypatch.setattr(chunks, "compile_ahead", started)
    monkeypatch.setattr(Recorder, "compile", looked)
    scene = warmup._scene("concave", SettlementControl(("floor",), displacement=(0.0, 0.0, -1e-3)), warmup.LOW)
    with pytest.raises(KeyboardInterrupt):
        simulate(scene, tmp_path / "a.h5")
    assert order == ["loop", "rows"]


def test_compiling_ahead_takes_no_room_for_contacts_of_blocks_of_many_faces():
    """The storage of a contact grows with the square of a block's faces: a run without contacts does without it."""
    outline = tuple((0.5 * math.cos(0.1 * i), 0.5 * math.sin(0.1 * i)) for i in range(60))
    drum = Block("drum", "stone", prism=Prism(outline, 1.0), position=(0.0, 0.0, 0.5))
    scene = warmup._scene("concave", DynamicControl(1e-3))
    moving = run.prepare(assemble(replace(scene, blocks=(*scene.blocks, drum))), scene.control, 0.5)
    blank = moving.contact_detection.blank(moving.polygons)
    assert len(blank.scratch.depth) == 36  # for two boxes


def test_commands_that_simulate_allow_it(allowed, monkeypatch, tmp_path):
    seen = []

    def simulated(*_, **__):
        seen.append(_ahead._Known.helper)
        raise ScenarioError("that was all")

    monkeypatch.setattr(simulate_module, "simulate", simulated)
    assert main(["run", "set4a", "--out", str(tmp_path / "a.h5")]) == 2
    assert seen[0] is not None and seen[0].process is None and _ahead._Known.helper is None


def test_the_lab_rehearses_what_it_replays_itself(monkeypatch):
    replayed, tasks = [], []

    def replay(scenario, *_, **__):
        replayed.append(scenario)
        raise KeyboardInterrupt

    def heard(wanted):
        tasks.extend(wanted())
        return _ahead.compile_ahead(wanted)

    monkeypatch.setattr(lab, "simulate", replay)
    monkeypatch.setattr(lab, "compile_ahead", heard)
    with pytest.raises(KeyboardInterrupt):
        lab.replay_lab(curves=False)
    assert tasks == [(lab._rehearse, [("set2a", "convex")])]
    with pytest.raises(KeyboardInterrupt):
        lab._rehearse(lab.AHEAD)
    first, rehearsed = replayed
    assert first.title == rehearsed.title and first.joint != rehearsed.joint
