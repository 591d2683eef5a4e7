"""History files on disks that fill up or disappear, and of killed runs: flushed data stay readable."""

import os
import random
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from dembrick import history
from dembrick.errors import WriteError
from dembrick.history import files, layout
from helpers import history_cases as cases
from helpers.places import TESTS

# --- failing disks ---

FULL = """
import resource, signal, sys
sys.path[:0] = {paths!r}
from helpers import history_cases as cases
from dembrick import history
from dembrick.errors import WriteError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from dembrick.history import writer
writer._RESERVE = 4096
out = history.HistoryWriter({path!r}, cases.SCENARIO, cases.assembly(), {{}}, hold=0.0)
out.append(cases.record(0, 10))
resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))
flushed = 10
try:
    for start in range(10, 100_000, 10):
        out.append(cases.record(start, start + 10))
        flushed = start + 10
except WriteError as error:
    print(flushed, error)
for attempt in range(2):
    try:
        out.finish("failed", {{}})
    except WriteError as error:
        print("finish:", error)
"""


def test_a_disk_that_fills_up(tmp_path):
    """A limit on the file size stands for a full disk: growing the file fails during HDF5's own writes."""
    path = str(tmp_path / "run.h5")
    code = FULL.format(paths=[str(TESTS), *sys.path], path=path)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    append, *finishes = done.stdout.splitlines()
    flushed, message = append.split(" ", 1)
    assert f"the {flushed} rows and 0 frames written before stay readable" in message and "File too large" in message
    assert len(finishes) == 2 and all("stay readable" in line for line in finishes)
    assert os.listdir(tmp_path) == ["run.h5"]
    with history.read(path) as found:
        assert found.status == "running" and found.n_row >= 20
        cases.check_rows(found, int(flushed))


def test_a_write_that_fails_in_the_reserved_space(tmp_path, monkeypatch):
    """No space left in the middle of a row: flushed rows stay, and the next attempt continues after them."""
    out = cases.open_writer(tmp_path / "run.h5", hold=0.0)
    out.append(cases.record(0, 6))
    put, calls = layout.put, []

    def full(*args):
        calls.append(1)
        if len(calls) > 4:
            raise OSError(28, "No space left on device")
        put(*args)

    monkeypatch.setattr(layout, "put", full)
    with pytest.raises(WriteError, match="No space left on device.*the 6 rows and 0 frames"):
        out.append(cases.record(6, 12))
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 6)
    monkeypatch.setattr(layout, "put", put)
    out.append(cases.record(12, 14))
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 14)


def test_a_folder_that_goes_away(tmp_path):
    (tmp_path / "gone").mkdir()
    out = cases.open_writer(tmp_path / "gone" / "run.h5", hold=0.0)
    out.append(cases.record(0, 6))
    (tmp_path / "gone" / "run.h5").unlink()
    (tmp_path / "gone").rmdir()
    with pytest.raises(WriteError, match="could not be written"):
        out.finish("yield", {})


def test_a_failed_rename_never_costs_rows(tmp_path, monkeypatch):
    """finish closes the running file before the rename; if the rename fails, nothing may replace the file any more."""
    out = cases.open_writer(tmp_path / "run.h5", hold=0.0)
    out.append(cases.record(0, 6))
    monkeypatch.setattr(files.os, "replace", lambda *_: (_ for _ in ()).throw(OSError(5, "Input/output error")))
    with pytest.raises(WriteError, match="Input/output error.*the 6 rows"):
        out.finish("yield", {})
    monkeypatch.undo()
    with pytest.raises(WriteError):
        out.finish("yield", {})
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 6)
    assert os.listdir(tmp_path) == ["run.h5"]


# --- kills ---

CHILD = """
import sys
sys.path[:0] = {paths!r}
from helpers import history_cases as cases
from dembrick import history
from dembrick.history import writer
writer._RESERVE = 20_000  # many growths
n = {n_block}
from dembrick.scenario.model import CHANNELS
options = dict(channels=CHANNELS, hold=0.0, control=cases.MOTION)
out = history.HistoryWriter({path!r}, cases.SCENARIO, cases.many_blocks(n), {{}}, False, **options)
print("start", flush=True)
rows = frames = 0
for round in range(10**6):
    out.append(cases.moving_record(rows, rows + 1 + round % 7))
    rows += 1 + round % 7
    print(rows, frames, flush=True)
    if round % 2:
        met = cases.new_contacts(frames, frames + 1)
        shifted = dict(joint_shift=[[[0.0, 0.0]]], contact_arm=[[[0.0, 0.0]] * 4], contact_area=[[1.0] * 4])
        moved = cases.motion(frames, frames + 1, n)
        out.append_frames(*cases.frames(frames, frames + 1, n), **moved, **shifted, new_contacts=met)
        frames += 1
        print(rows, frames, flush=True)
    if round % 40 == 39:
        out.finish("completed", {{}})
        print("finished", rows, frames, flush=True)
        out = history.HistoryWriter({path!r}, cases.SCENARIO, cases.many_blocks(n), {{}}, True, **options)
        rows = frames = 0
"""


def kill_and_read(folder, rng):
    """Kill a writing child at a random moment; all that it reported as flushed must be there, and right."""
    n_block, path = 20, folder / "run.h5"
    code = CHILD.format(paths=[str(TESTS), *sys.path], path=str(path), n_block=n_block)
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, bufsize=0) as child:
        assert child.stdout.readline() == b"start\n"
        deadline = time.monotonic() + rng.uniform(0.0, 0.25)
        told = b""
        while (left := deadline - time.monotonic()) > 0:
            if select.select([child.stdout], [], [], left)[0]:
                told += os.read(child.stdout.fileno(), 1 << 16)
        child.send_signal(signal.SIGKILL)
        told += child.stdout.read()
    reports = [line.split() for line in told.decode().split("\n")[:-1]]  # whole lines only
    if not reports:
        assert not path.exists() or history.read(path).n_row >= 0
        return 0
    done, rows, frames = reports[-1][0] == "finished", int(reports[-1][-2]), int(reports[-1][-1])
    assembly = cases.many_blocks(n_block)
    with history.read(path) as found:
        if done and found.status == "running":  # the next history had already taken its place
            rows = frames = 0
        elif not done and found.status == "completed":  # killed between finishing and reporting it
            assert found.n_row == rows
        assert rows <= found.n_row <= rows + 7 and frames <= found.n_frames <= frames + 1
        cases.check_rows(found, found.n_row)
        cases.check_frames(found, found.n_frames, assembly)
        motion = cases.motion(0, found.n_frames, n_block)
        for k in range(found.n_frames):
            np.testing.assert_array_equal(found.frame("velocity", k), motion["velocity"][k])
            np.testing.assert_array_equal(found.frame("spin", k), motion["spin"][k])
            np.testing.assert_array_equal(found.frame("contact_force", k), motion["contact_force"][k])
        if found.n_frames:
            cases.check_new_contacts(found, found.n_frames)
    return len(reports)


def kills(folder, count):
    rng = random.Random(20)
    lengths = []
    for i in range(count):
        (folder / str(i)).mkdir()
        lengths.append(kill_and_read(folder / str(i), rng))
    print(f"reports before the kill, of {count} kills: {sorted(lengths)}")
    assert max(lengths) > 20


def test_kills_at_random_moments(tmp_path):
    kills(tmp_path, 8)


@pytest.mark.slow
def test_fifty_kills_at_random_moments(tmp_path):
    kills(tmp_path, 50)


# --- reasons ---


def test_reason_out_of_hdf5():
    error = OSError(28, "Unable to create file (open failed: errno = 28, error message = 'no space left on device')")
    assert files.reason(error) == "No space left on device"
    assert files.reason(OSError(13, "Permission denied")) == "Permission denied"
    assert files.reason(RuntimeError("first\nsecond")) == "first" and files.reason(RuntimeError()) == "RuntimeError"
