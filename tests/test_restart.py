"""Stop and restart: to the last bit the run that was never stopped, whatever stopped it."""

import ctypes
import dataclasses
import json
import os
import pkgutil
import random
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from dembrick import interruption, model, motion_run, scenario, stepping
from dembrick.cli import main
from dembrick.errors import HistoryError, NotConvergedError, WriteError
from dembrick.history import Checkpoint, Checkpoints, read
from dembrick.interruption import Interrupted
from dembrick.lab import lab_scenario
from dembrick.result import restart, simulate

SCENARIOS = Path(__file__).parent.parent / "scenarios"
PACKAGE = str(Path(__file__).parent.parent)


def case(name, formulation, tolerance=1e-3, **output):
    """A lab scenario that writes a checkpoint after every chunk; a curve is cut short."""
    given = lab_scenario(name, formulation, tolerance)
    if given.control.kind == "displacement":
        given = dataclasses.replace(given, control=model.DisplacementControl(1e-3, 1.5e-5))
    if formulation == "distributed":  # its points given: to place them is a search of its own, and stopped as one
        given = dataclasses.replace(given, joint=dataclasses.replace(given.joint, points=(6, 5)))
    return dataclasses.replace(given, output=model.Output(model.CHANNELS, checkpoint=0.0, **output))


@pytest.fixture
def stop_after(monkeypatch):
    """Chunks of one step, and a way to have a signal come after so many of them; without waiting for the disk."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    monkeypatch.setattr(stepping, "FIRST_WORK", 1)
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)

    def arm(chunks, signum=signal.SIGINT):
        left = [chunks]

        def requested():
            left[0] -= 1
            return signum if left[0] == 0 else 0

        monkeypatch.setattr(interruption, "requested", requested)

    return arm


def content(path):
    """Every dataset of a history, and its results and settings without the wall times and what names the file."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, node: found.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None)
        found["status"], found["settings"] = file.attrs["status"], json.loads(file.attrs["settings"])
        found["results"] = json.loads(file.attrs["results"])
    for key in ("wall", "history"):
        found["results"].pop(key, None)
    return found


def check_same(first, second):
    one, other = content(first), content(second)
    assert set(one) == set(other)
    for name, value in one.items():
        if isinstance(value, np.ndarray) and value.dtype != object:
            assert value.tobytes() == other[name].tobytes(), name
        else:
            assert np.array_equal(value, other[name]) if isinstance(value, np.ndarray) else value == other[name], name


@pytest.mark.parametrize("formulation", model.FORMULATIONS)
@pytest.mark.parametrize("name", ["set4a", "set4b_mid", "set4a_curve"])
def test_stop_and_restart_is_one_run(tmp_path, stop_after, name, formulation):
    """Stopped twice, once by each signal; rows, frames, results and settings are bit by bit those of one run."""
    given = case(name, formulation, rows=60, frames=30)
    whole = simulate(given, tmp_path / "whole.h5")
    path = tmp_path / "parts.h5"
    stop_after(5)
    with pytest.raises(Interrupted, match=f"after step 5 .*dembrick restart {path}") as stopped:
        simulate(given, path)
    assert stopped.value.exit_code == 130
    with read(path) as file:
        assert file.status == "interrupted" and file.n_row >= 1
    stop_after(4, signal.SIGTERM)
    with pytest.raises(Interrupted, match="after step 9") as stopped:
        restart(path)
    assert stopped.value.exit_code == 143
    assert len(Checkpoints(path).existing()) == 2
    stop_after(0)
    result = restart(path)
    assert result.yield_point == whole.yield_point and result.energy == whole.energy
    check_same(tmp_path / "whole.h5", path)
    assert sorted(os.listdir(tmp_path)) == ["parts.h5", "whole.h5"]  # no checkpoint stays behind


def test_a_search_that_takes_to_calming_can_be_stopped_there(tmp_path, stop_after):
    """After 256 steps an indicator is watched for longer: stopped right before and after that, nothing changes."""
    given = case("set4b_mid", "concave", 1e-6)
    given = dataclasses.replace(given, output=model.Output(checkpoint=1e9))  # only where it is stopped
    whole = simulate(given, tmp_path / "whole.h5")
    assert whole.replay.steps > 300
    for step in (256, 300):
        path = tmp_path / f"{step}.h5"
        stop_after(step)
        with pytest.raises(Interrupted, match=f"after step {step} "):
            simulate(given, path)
        stop_after(0)
        restart(path)
        check_same(tmp_path / "whole.h5", path)


TILT = """
kind = "tilt"
axis = [1.0, 0.0, 0.0]
rate = 10.0
displacement = 0.002
"""


@pytest.mark.parametrize("pressure", ["effective", "linear"])
def test_pressures_that_follow_the_bending_go_on_too(tmp_path, stop_after, pressure):
    """Their state has a part in a part: the pressed polygons of the convex joints."""
    given = case("set4a_mid", "convex", rows=60, frames=30)
    given = dataclasses.replace(given, joint=dataclasses.replace(given.joint, pressure=pressure))
    whole = simulate(given, tmp_path / "whole.h5")
    stop_after(5)
    with pytest.raises(Interrupted):
        simulate(given, tmp_path / "parts.h5")
    stop_after(0)
    assert restart(tmp_path / "parts.h5").yield_point == whole.yield_point
    check_same(tmp_path / "parts.h5", tmp_path / "whole.h5")


PUSH = """
kind = "pushover"
direction = [1.0, 0.0, 0.0]
quasi_static = false
rate = 1.0e-2
displacement = 0.002
"""


@pytest.mark.parametrize("formulation", ["concave", "convex", "distributed"])
@pytest.mark.parametrize("control", [TILT, PUSH], ids=["tilt", "push"])
def test_a_run_to_collapse_in_real_time_goes_on_too(tmp_path, stop_after, formulation, control):
    """A block that hangs over the edge of the other, so that polygons are cut; stopped at rest and in motion."""
    text = (SCENARIOS / "set4a.toml").read_text().replace('"convex"', f'"{formulation}"')
    text = text[: text.index("[[loads]]")] + "[control]" + control
    text = text.replace("position = [0.0, 0.0, 0.05]", "position = [0.01, 0.02, 0.05]")
    given = scenario.loads(text + "[output]\nrows = 400\nframes = 100\ncheckpoint = 1e9\n")
    whole = simulate(given, tmp_path / "whole.h5")
    assert whole.status == "collapse" and whole.run.motion.steps > 1000
    n_row = len(whole.rows["time"])
    for row in (1, n_row // 2, n_row - 3):
        path = tmp_path / f"{row}.h5"
        stop_after(row)
        with pytest.raises(Interrupted, match="dembrick restart"):
            simulate(given, path)
        stop_after(0)
        assert restart(path).collapse == whole.collapse
        check_same(tmp_path / "whole.h5", path)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_run_in_real_time_stops_between_two_rows(tmp_path, stop_after, monkeypatch, formulation):
    """Where a row is many steps of a large scene, nobody waits for it."""
    monkeypatch.setattr(motion_run, "AT_ONCE", 60)  # 20 steps of two blocks and a joint
    given = scenario.load(
        SCENARIOS / "rocking_block.toml", ["control.duration=0.4", f"joint.formulation={formulation}"]
    )
    given = dataclasses.replace(given, output=model.Output(model.CHANNELS, rows=20, frames=10, checkpoint=1e9))
    stop_after(0)
    whole = simulate(given, tmp_path / "whole.h5")
    every = whole.run.motion.steps // 20
    assert every > 60 and len(whole.rows["time"]) in (21, 22)
    for looks in (1, 2, 17):
        path = tmp_path / f"{looks}.h5"
        stop_after(looks)
        with pytest.raises(Interrupted) as stopped:
            simulate(given, path)
        assert int(str(stopped.value).split()[3]) % every  # not at a row
        stop_after(0)
        restart(path)
        check_same(tmp_path / "whole.h5", path)


# --- signals and kills ---

LONG = """
[output]
channels = ["joints", "energy", "frames", "velocity", "contacts"]
rows = 2000
frames = 2000
checkpoint = {checkpoint}
"""


@pytest.fixture(scope="module")
def long_run(tmp_path_factory):
    """A scenario that takes some seconds, and the history of it uninterrupted."""
    folder = tmp_path_factory.mktemp("long")
    text = (SCENARIOS / "set4a_curve.toml").read_text().replace('"convex"', '"concave"')
    text = text.replace("rate   = 1.0e-5", "rate   = 1.0e-6").replace("travel = 2.5e-5", "travel = 2.0e-4")
    (folder / "long.toml").write_text(text + LONG.format(checkpoint=0.02))
    simulate(folder / "long.toml", folder / "whole.h5")
    return folder


SLOW = """
import sys, time
from dembrick import interruption
from dembrick.cli import main
looked = interruption.requested
interruption.requested = lambda: (time.sleep(0.05), looked())[1]
sys.exit(main())
"""  # some seconds, however fast the run is: a signal comes long before the end


def dembrick(*arguments, code="import sys; from dembrick.cli import main; sys.exit(main())", **options):
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": PACKAGE},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def wait_for(condition, child, what):
    """Wait until ``condition`` holds while the child lives."""
    deadline = time.monotonic() + 600
    while not condition():
        assert child.poll() is None, f"the child ended before {what}: {child.stderr.read()}"
        assert time.monotonic() < deadline, what
        time.sleep(0.005)


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_and_restart_finishes_it(tmp_path, long_run, signum):
    path = tmp_path / "run.h5"
    child = dembrick("run", str(long_run / "long.toml"), "--out", str(path), "--json", code=SLOW)
    wait_for(lambda: Checkpoints(path).existing(), child, "a checkpoint")
    child.send_signal(signum)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 128 + signum
    assert json.loads(out) == {"status": "interrupted", "history": str(path)}
    (line,) = err.splitlines()
    assert line.startswith("interrupted after step") and line.endswith(f"go on with: dembrick restart {path}")
    with read(path) as file:
        assert file.status == "interrupted" and 0 < file.n_row and file.n_frames == file.n_row
        assert file.settings["scenario"] == str(long_run / "long.toml")
    done = dembrick("restart", str(path), "--json")
    out, err = done.communicate(timeout=120)
    assert done.returncode == 0, err
    assert json.loads(out)["status"] == "completed" and "going on from step" in err
    check_same(long_run / "whole.h5", path)
    assert os.listdir(tmp_path) == ["run.h5"]


def test_a_second_signal_kills_at_once(tmp_path, long_run, monkeypatch):
    """Whatever the first one is waiting for: here a checkpoint that never comes to its end."""
    code = f"""
import signal, sys, time
from dembrick import keeper
from dembrick.cli import main
keeper.Keeper.keep = lambda *_: (print("waiting", flush=True), time.sleep(60))
sys.exit(main(["run", {str(long_run / "long.toml")!r}, "--out", {str(tmp_path / "run.h5")!r}]))
"""
    child = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": PACKAGE}, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout.readline() == "waiting\n"
    child.send_signal(signal.SIGTERM)
    time.sleep(0.2)
    child.send_signal(signal.SIGTERM)
    child.communicate(timeout=20)
    assert child.returncode == -signal.SIGTERM  # 143 to a shell


@pytest.mark.parametrize("late", ["dembrick.judge.theory_of", "dembrick.history.HistoryWriter.finish"])
def test_a_signal_that_finds_the_answer_there_leaves_it_whole(tmp_path, capsys, monkeypatch, late):
    """While it is compared with theory, and while it is written."""
    (tmp_path / "set4a.toml").write_text(scenario.dumps(case("set4a", "concave")))
    path, original = tmp_path / "run.h5", pkgutil.resolve_name(late)

    def signalled(*arguments):
        signal.raise_signal(signal.SIGTERM)
        return original(*arguments)

    monkeypatch.setattr(late, signalled)
    assert main(["run", str(tmp_path / "set4a.toml"), "--out", str(path), "--json"]) == 143
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == "yield"
    assert err == "interrupted after the work was done; nothing is missing\n"
    with read(path) as file:
        assert file.status == "yield"


def test_a_signal_that_a_callback_swallows_is_not_lost(tmp_path, capsys, monkeypatch):
    """A compiler that is called back raises an error of its own then; what comes out is the interrupt, and no more."""
    given = case("set4a", "concave")
    (tmp_path / "set4a.toml").write_text(scenario.dumps(given))

    def compiling(*_):
        callback = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))
        callback()
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("dembrick.replay.seat", compiling)
    path = tmp_path / "run.h5"
    assert main(["run", str(tmp_path / "set4a.toml"), "--out", str(path)]) == 143
    assert capsys.readouterr().err == f"interrupted; go on with: dembrick restart {path}\n"
    with read(path) as file:
        assert file.status == "interrupted"
    with pytest.raises(RuntimeError, match="a fault"), interruption.handled():
        raise RuntimeError("a fault")


@pytest.mark.parametrize("error", [Interrupted(signal.SIGINT), NotConvergedError("no equilibrium")])
def test_a_run_is_complete_whatever_becomes_of_its_error_estimate(tmp_path, monkeypatch, error):
    given = scenario.load(SCENARIOS / "oppenheim.toml")

    def estimate(_):
        raise error

    monkeypatch.setattr("dembrick.result._refined_factor", estimate)
    path = tmp_path / "run.h5"
    with pytest.raises(type(error), match=f"error.*; the run itself .* is complete in {path}"):
        simulate(given, path, refine=True)
    with read(path) as file:
        assert file.status == "collapse" and file.results["collapse"]["error_estimate"] is None


def rows_of(path):
    if not path.exists():
        return -1
    with read(path) as file:
        return file.n_row


def test_killed_and_restarted_again_and_again(tmp_path, long_run):
    """Killed before the first row, then at random moments of the time loop, and in the end let finish."""
    path, rng, numbers = tmp_path / "run.h5", random.Random(4), []
    for kill, rows in enumerate((0, 1, rng.randrange(300, 900), rng.randrange(900, 1800))):
        command = ["restart", str(path)] if kill else ["run", str(long_run / "long.toml"), "--out", str(path)]
        child = dembrick(*command, code=SLOW)
        wait_for(lambda rows=rows: rows_of(path) >= rows, child, f"row {rows}")
        time.sleep(rng.uniform(0.0, 0.1))
        child.kill()
        child.communicate()
        with read(path) as file:
            assert file.status == "running" and file.n_row >= rows
        numbers += [Checkpoint(one).about["number"] for one in Checkpoints(path).existing()]
    print(f"checkpoints found after the kills: numbers {numbers}")
    assert numbers and main(["restart", str(path), "--quiet"]) == 0
    check_same(long_run / "whole.h5", path)


def test_a_run_killed_before_its_first_checkpoint_starts_anew(tmp_path, capsys):
    given = case("set4a", "concave")
    whole = simulate(given, tmp_path / "whole.h5")
    (tmp_path / "set4a.toml").write_text(scenario.dumps(given))
    code = f"""
import os
from dembrick import keeper
from dembrick.cli import main
keeper.Keeper.session = lambda *_: os.kill(os.getpid(), 9)
main(["run", {str(tmp_path / "set4a.toml")!r}, "--out", {str(tmp_path / "run.h5")!r}])
"""
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": PACKAGE}, timeout=120)
    assert done.returncode == -9
    with read(tmp_path / "run.h5") as file:
        assert (file.status, file.begun, file.n_row, file.title) == ("running", False, 0, given.title)
    assert main(["info", str(tmp_path / "run.h5")]) == 0
    assert "running" in capsys.readouterr().out
    result = restart(tmp_path / "run.h5", report=print)
    assert "from the beginning" in capsys.readouterr().out
    assert result.yield_point == whole.yield_point
    np.testing.assert_array_equal(result.rows["load"], whole.rows["load"])


# --- checkpoints that cannot be used ---


@pytest.fixture
def stopped(tmp_path, stop_after):
    """A run that was stopped after nine steps, with its two checkpoints, and the whole run beside it."""
    given = case("set4a", "concave")
    simulate(given, tmp_path / "whole.h5")
    stop_after(9)
    with pytest.raises(Interrupted):
        simulate(given, tmp_path / "run.h5")
    stop_after(0)
    return tmp_path / "run.h5"


def by_step(path):
    """The two checkpoint files, the newest last."""
    return sorted(Checkpoints(path).existing(), key=lambda one: Checkpoint(one).about["number"])


def test_the_other_checkpoint_serves_where_the_newest_is_damaged(stopped, capsys):
    older, newest = by_step(stopped)
    assert [Checkpoint(one).about["number"] for one in (older, newest)] == [8, 9]
    whole = Path(newest).read_bytes()
    Path(newest).write_bytes(whole[: len(whole) // 2])
    restart(stopped, report=print)
    assert "step 8" in capsys.readouterr().out
    check_same(stopped.parent / "whole.h5", stopped)


def test_a_flipped_bit_is_noticed(stopped):
    """Anywhere in the numbers: the checksums of the archive see it."""
    _, newest = by_step(stopped)
    whole = Path(newest).read_bytes()
    with zipfile.ZipFile(newest) as archive:
        entry = archive.getinfo("state.blocks.velocity.npy")
        at = entry.header_offset + len(whole[entry.header_offset :].split(b"}")[0]) + 60
    rng, noticed = random.Random(1), 0
    for place in [at, *(rng.randrange(len(whole)) for _ in range(60))]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << rng.randrange(8)
        Path(newest).write_bytes(damaged)
        try:
            checkpoint = Checkpoint(newest)
            for name in ("state.blocks.velocity", "loop"):
                checkpoint.array(name, np.zeros((2, 3)) if "." in name else np.zeros(2))
        except HistoryError as error:
            assert newest in str(error) and "\n" not in str(error)
            noticed += 1
            if place == at:
                first = noticed
    assert first == 1 and noticed > 45  # the rest falls on dates and names of the archive, which nobody reads


def rewritten(path, **changes):
    """The checkpoint with some arrays replaced (None: left out), all checksums right."""
    with np.load(path) as found:
        arrays = dict(found)
    arrays |= changes
    with open(path, "wb") as file:
        np.savez(file, **{name: value for name, value in arrays.items() if value is not None})


def about(path, **changes):
    found = {**Checkpoint(path).about, **changes}
    return np.frombuffer(json.dumps(found).encode(), np.uint8)


STRANGE = {
    "of another shape": lambda one: rewritten(one, **{"state.blocks.velocity": np.zeros((3, 3))}),
    "of another type": lambda one: rewritten(one, **{"state.blocks.velocity": np.zeros((2, 3), np.float32)}),
    "missing": lambda one: rewritten(one, **{"state.blocks.velocity": None}),
    "an object": lambda one: rewritten(one, **{"state.blocks.velocity": np.array([{}], object)}),
    "an index that leads elsewhere": lambda one: rewritten(one, **{"state.points.start": np.array([0, 10**6])}),
    "a joint of nothing": lambda one: rewritten(one, **{"state.joints.block_a": np.array([7])}),
    "in other axes order": lambda one: rewritten(one, **{"state.blocks.velocity": np.asfortranarray(np.ones((2, 3)))}),
    "of a step before the first": lambda one: rewritten(one, loop=np.array([-5.0, 1e-5])),
    "of half a step": lambda one: rewritten(one, loop=np.array([7.5, 1e-5])),
    "of no step": lambda one: rewritten(one, loop=np.array([np.nan, 1e-5])),
    "of no time step": lambda one: rewritten(one, loop=np.array([9.0, np.nan])),
    "of another run": lambda one: rewritten(one, about=about(one, run="0123456789abcdef")),
    "of another scenario": lambda one: rewritten(one, about=about(one, scenario="0" * 64)),
    "of another version": lambda one: rewritten(one, about=about(one, kernels="0" * 16)),
    "of a newer format": lambda one: rewritten(one, about=about(one, format=99)),
    "without counts": lambda one: rewritten(one, about=about(one, rows="many")),
    "with absurd counts": lambda one: rewritten(one, about=about(one, rows=10**15)),
    "with negative counts": lambda one: rewritten(one, about=about(one, frames=-1)),
    "a list": lambda one: rewritten(one, about=np.frombuffer(b"[1]", np.uint8)),
    "no JSON": lambda one: rewritten(one, about=np.frombuffer(b"{", np.uint8)),
    "deep": lambda one: rewritten(one, about=np.frombuffer(b"[" * 100_000, np.uint8)),
    "empty": lambda one: Path(one).write_bytes(b""),
    "text": lambda one: Path(one).write_text("hello"),
    "compressed": lambda one: np.savez_compressed(one + ".npz", zeros=np.zeros(10**6)) or os.replace(one + ".npz", one),
    "a folder": lambda one: (os.unlink(one), os.mkdir(one)),
    "a header without end": lambda one: bare(one, b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 65535),
    "an absurd shape": lambda one: bare(
        one, npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 3), }")
    ),
    "a call in the header": lambda one: bare(one, npy_header("__import__('os').getcwd()")),
}


def npy_header(text):
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def bare(path, raw):
    """Put raw bytes in the place of one array."""
    with zipfile.ZipFile(path) as found:
        entries = {name: found.read(name) for name in found.namelist()}
    entries["state.blocks.velocity.npy"] = raw
    with zipfile.ZipFile(path, "w") as out:
        for name, content in entries.items():
            out.writestr(name, content)


@pytest.mark.parametrize("edit", STRANGE.values(), ids=STRANGE)
def test_a_strange_checkpoint_gives_one_sentence_and_leaves_the_history_alone(stopped, edit):
    for one in by_step(stopped):
        edit(one)
    before = content(stopped)
    with pytest.raises(HistoryError) as caught:
        restart(stopped)
    message = str(caught.value)
    assert str(stopped) in message and "\n" not in message and len(message) < 400 + 2 * len(str(stopped))
    after = content(stopped)
    assert after["history/load"].tobytes() == before["history/load"].tobytes()


def test_a_history_with_fewer_rows_than_its_checkpoint_is_refused(stopped):
    for one in by_step(stopped):
        rewritten(one, about=about(one, rows=50))
    with pytest.raises(HistoryError, match="the run had written 50"):
        restart(stopped)


def test_a_run_that_is_over_is_not_restarted(tmp_path):
    simulate(case("set4a", "concave"), tmp_path / "run.h5")
    with pytest.raises(HistoryError, match=r"this run is over \(status yield\)"):
        restart(tmp_path / "run.h5")


def test_checkpoints_of_an_earlier_run_are_not_taken(tmp_path, stopped):
    """The same file name, run anew: what lies about of before is not gone on from."""
    left = [Path(one).read_bytes() for one in Checkpoints(stopped).paths]
    with pytest.raises(KeyboardInterrupt):
        interrupted_at_once(case("set4b", "concave"), stopped)
    for one, content_before in zip(Checkpoints(stopped).paths, left, strict=True):
        Path(one).write_bytes(content_before)
    with pytest.raises(HistoryError, match="another run"):
        restart(stopped)


def interrupted_at_once(given, path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dembrick.result._replayed", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        simulate(given, path, force=True)


def test_a_disk_that_fills_up_leaves_something_to_go_on_with(tmp_path, stop_after, monkeypatch):
    """The history cannot be written any more: exit code 1, and when there is room again the run goes on."""
    given = case("set4a", "concave")
    simulate(given, tmp_path / "whole.h5")
    path = tmp_path / "run.h5"
    stop_after(0)
    from dembrick.history import writer

    put, calls = writer._put, []

    def full(*args):
        calls.append(1)
        if len(calls) > 150:
            raise OSError(28, "No space left on device")
        put(*args)

    monkeypatch.setattr(writer, "_put", full)
    with pytest.raises(WriteError, match=f"No space left on device.*dembrick restart {path}") as caught:
        simulate(given, path)
    assert caught.value.answer["status"] == "failed" and caught.value.exit_code == 1
    monkeypatch.setattr(writer, "_put", put)
    with read(path) as file:
        assert file.status == "running" and file.n_row > 0
    restart(path)
    check_same(tmp_path / "whole.h5", path)


def test_a_checkpoint_that_cannot_be_written_ends_the_run_and_keeps_the_one_before(tmp_path, stop_after, monkeypatch):
    given = case("set4a", "concave")
    simulate(given, tmp_path / "whole.h5")
    stop_after(0)
    savez, calls = np.savez, []

    def full(file, **arrays):
        calls.append(1)
        if len(calls) > 5:
            file.write(b"half of it")
            raise OSError(28, "No space left on device")
        savez(file, **arrays)

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(WriteError, match="the checkpoint could not be written .No space left"):
        simulate(given, tmp_path / "run.h5")
    monkeypatch.setattr(np, "savez", savez)
    assert [Checkpoint(one).about["number"] for one in by_step(tmp_path / "run.h5")] == [4, 5]
    restart(tmp_path / "run.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "run.h5")


def test_a_history_is_enough_to_run_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    given = case("set4a", "concave")
    simulate(given, tmp_path / "first.h5")
    assert main(["run", "first.h5", "--quiet"]) == 0
    assert os.listdir(tmp_path / "results") == ["first.h5"]
    first, again = content("first.h5"), content("results/first.h5")
    assert again["results"].pop("scenario") == "first.h5" and first["results"].pop("scenario") == given.path
    assert first["results"] == again["results"]
    assert first["history/load"].tobytes() == again["history/load"].tobytes()
    assert main(["run", "first.h5", "--set", "joint.friction=0.32", "--json", "--out", "half.h5"]) == 0
    out = capsys.readouterr().out
    half = json.loads(out[out.index("\n{") if not out.startswith("{") else 0 :])
    assert half["yield_point"]["V"] == pytest.approx(0.5 * first["results"]["yield_point"]["V"], rel=1e-2)
