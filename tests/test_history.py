"""History files: what goes in comes out, at any moment, after kills, from full disks, and nothing from strangers."""

import json
import os
import random
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import history_cases as cases
import numpy as np
import pytest

from dembrick import history, model
from dembrick.errors import HistoryError, OutputError, WriteError
from dembrick.history import files, layout, writer

RESULTS = {"title": "two blocks", "V": np.float64(216.05), "list": np.arange(2), "none": None}


def open_writer(path, assembly=None, **options):
    return history.HistoryWriter(path, cases.SCENARIO, assembly or cases.assembly(), {"time_step": 1e-5}, **options)


def finished(path, **options):
    """A finished history of 20 rows and 4 frames at ``path``, with all channels."""
    with open_writer(path, channels=model.CHANNELS, **options) as out:
        out.append(cases.record(0, 20))
        out.append_frames(*cases.frames(0, 4), **cases.motion(0, 4))
        out.finish("yield", RESULTS)
    return path


def check_rows(found, stop, n_joint=1, n_actuator=1):
    """All series hold exactly rows 0 to stop of ``cases.record``."""
    expected = cases.record(0, stop, n_joint, n_actuator)
    assert found.n_row == stop
    for name in ("time", "load", "displacement", "unbalanced", "actuator_displacement", "actuator_force"):
        np.testing.assert_array_equal(getattr(found, name), expected[name], err_msg=name)
    for name in ("lower", "upper"):
        np.testing.assert_array_equal(found.series(name), expected[name], err_msg=name)
    for i, name in enumerate(("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip")):
        np.testing.assert_array_equal(found.joint(name), expected["joint"][:, :, i], err_msg=name)
    assert set(found.energy) == set(cases.ENERGIES)
    for name, values in found.energy.items():
        np.testing.assert_array_equal(values, expected["energy"][name], err_msg=name)


def check_frames(found, stop, assembly):
    """The frames are exactly 0 to stop of ``cases.frames``."""
    times, displacement, orientation = cases.frames(0, stop, len(assembly.names))
    assert found.n_frames == stop
    np.testing.assert_array_equal(found.frame_time, times)
    for k in range(stop):
        np.testing.assert_array_equal(found.frame_displacement(k), displacement[k])
        np.testing.assert_array_equal(found.frame_orientation(k), orientation[k])
        np.testing.assert_array_equal(found.frame_position(k), assembly.position + displacement[k])


# --- what goes in comes out ---


@pytest.mark.parametrize("hold", [0.0, 1e9])
def test_everything_comes_back(tmp_path, hold):
    assembly = cases.mixed_assembly()
    with open_writer(tmp_path / "run.h5", assembly, hold=hold) as out:
        for start, stop in ((0, 7), (7, 8), (8, 40)):
            out.append(cases.record(start, stop, 2, 0))
        out.append_frames(*cases.frames(0, 3, 3))
        out.append_frames(*cases.frames(3, 5, 3))
        out.finish("yield", RESULTS, {"rate": 2.0})
    assert os.listdir(tmp_path) == ["run.h5"]
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 40, 2, 0)
        check_frames(found, 5, assembly)
        assert found.frame_time[-1] == cases.frames(4, 5)[0][0]
        np.testing.assert_array_equal(found.frame_position(-1), found.frame_position(4))
        assert found.status == "yield"
        assert found.results == {"title": "two blocks", "V": 216.05, "list": [0, 1], "none": None}
        assert found.settings == {"time_step": 1e-5, "rate": 2.0}
        assert found.versions["numpy"] == np.__version__
        assert (found.title, found.scenario_text) == ("two blocks", cases.SCENARIO)
        assert found.names == found.block_names == assembly.names
        np.testing.assert_array_equal(found.block_fixed, assembly.fixed)
        np.testing.assert_array_equal(found.position0, assembly.position)
        np.testing.assert_array_equal(found.orientation0, assembly.orientation)
        for i, shape in enumerate(assembly.shapes):
            np.testing.assert_array_equal(found.block_vertices(i), shape.vertices)
            assert found.block_faces(i) == shape.faces
        for got, joint, points in zip(found.joints, assembly.joints, assembly.contact_points, strict=True):
            assert (got["block_a"], got["block_b"], got["host"]) == (joint.block_a, joint.block_b, joint.host)
            assert (got["formulation"], got["friction"]) == (joint.law.formulation, joint.law.friction)
            assert got["area"] == joint.area
            np.testing.assert_array_equal(got["origin"], joint.origin)
            np.testing.assert_array_equal(got["axes"], joint.axes)
            np.testing.assert_array_equal(got["polygon"], joint.polygon)
            for key, name in (("normal_arms", "normal_arm"), ("shear_arms", "shear_arm"), ("areas", "area")):
                np.testing.assert_array_equal(
                    got[key], getattr(points, name) if points else np.zeros_like(got[key][:0])
                )
        assert found.actuators == []


def test_the_channels_that_were_asked_for_come_back(tmp_path):
    assembly = cases.mixed_assembly()
    motion = cases.motion(0, 5, 3, 4)
    with open_writer(tmp_path / "all.h5", assembly, channels=model.CHANNELS) as out:
        out.append(cases.record(0, 5, 2, 0))
        out.append_frames(*cases.frames(0, 2, 3), **{name: value[:2] for name, value in motion.items()})
        out.append_frames(*cases.frames(2, 5, 3), **{name: value[2:] for name, value in motion.items()})
        with pytest.raises(ValueError, match="frames/contact_force"):
            out.append_frames(*cases.frames(5, 6, 3), **cases.motion(5, 6, 3, 5))
        out.finish("yield", RESULTS)
    with history.read(tmp_path / "all.h5") as found:
        for k in range(-1, 5):
            np.testing.assert_array_equal(found.frame_velocity(k), motion["velocity"][k])
            np.testing.assert_array_equal(found.frame_spin(k), motion["spin"][k])
            np.testing.assert_array_equal(found.frame_contact_force(k), motion["contact_force"][k])
        check_frames(found, 5, assembly)
        np.testing.assert_array_equal(found.block_mass, assembly.mass)
        np.testing.assert_array_equal(found.block_inertia, assembly.inertia)
    with open_writer(tmp_path / "few.h5", assembly, channels=("frames",)) as out:
        out.append(cases.record(0, 5, 2, 0))
        out.append_frames(*cases.frames(0, 5, 3), **motion)
        out.finish("yield", RESULTS)
    with history.read(tmp_path / "few.h5") as found:
        assert found.energy == {} and found.load.shape == (5,)
        check_frames(found, 5, assembly)
        assert found.frame_velocity(0) is found.frame_spin(0) is found.frame_contact_force(0) is None
        with pytest.raises(HistoryError, match="joint forces were not recorded.*output.channels"):
            found.joint("N")


def test_jacks_come_back(tmp_path):
    with history.read(finished(tmp_path / "run.h5")) as found:
        (jack,) = found.actuators
        assert (jack["name"], jack["block"], jack["weight"]) == ("jack", 1, 1.0)
        assert jack["point"].tolist() == [0.075, 0.0, 0.0] and jack["direction"].tolist() == [0.0, 1.0, 0.0]


def test_the_file_is_what_other_scripts_expect(tmp_path):
    """Plain h5py: names and shapes of the contract, units and a description on every dataset, exact lengths."""
    with h5py.File(finished(tmp_path / "run.h5")) as file:
        for name in ("time", "load", "displacement"):
            assert file[f"history/{name}"].shape == (20,)
        assert file["history/actuator_force"].shape == (20, 1)
        assert file["history/joint/M_T"].shape == (20, 1)
        assert file["frames/position"].shape == (4, 2, 3) and file["frames/orientation"].shape == (4, 2, 4)
        assert file["scenario"].asstr()[()] == cases.SCENARIO
        assert file.attrs["status"] == "yield" and file.attrs["format"] == layout.FORMAT
        assert json.loads(file.attrs["results"])["V"] == 216.05
        assert file["history/joint/M_T"].attrs["units"] == "N m"
        missing = []
        file.visititems(
            lambda name, node: (
                missing.append(name)
                if isinstance(node, h5py.Dataset) and not (node.attrs.get("units") and node.attrs.get("description"))
                else None
            )
        )
        assert missing == []


def test_a_run_without_frames_or_rows(tmp_path):
    with open_writer(tmp_path / "rows.h5", channels=("joints", "energy")) as out:
        out.append(cases.record(0, 3))
        with pytest.raises(ValueError, match="without frames"):
            out.append_frames(*cases.frames(0, 1))
        out.finish("completed", {})
    with history.read(tmp_path / "rows.h5") as found:
        check_rows(found, 3)
        assert found.n_frames == 0 and len(found.frame_time) == 0
        assert found.title == "two blocks, one joint"
        with pytest.raises(IndexError):
            found.frame_position(0)
    with open_writer(tmp_path / "empty.h5") as out:
        out.finish("failed", {"error": "diverged"})
    with history.read(tmp_path / "empty.h5") as found:
        assert (found.n_row, found.n_frames, found.status) == (0, 0, "failed")
        assert found.load.shape == (0,) and found.joint("N").shape == (0, 1)


@pytest.mark.parametrize("hold", [0.0, 1e9])
def test_records_of_the_wrong_shape_are_refused_and_leave_no_trace(tmp_path, hold):
    with open_writer(tmp_path / "run.h5", hold=hold) as out:
        out.append(cases.record(0, 5))
        bad = cases.record(5, 9)
        bad["unbalanced"] = bad["unbalanced"][:2]
        with pytest.raises(ValueError, match="history/unbalanced"):
            out.append(bad)
        with pytest.raises(ValueError, match="energies"):
            out.append(cases.record(5, 9, energies=("kinetic",)))
        with pytest.raises(ValueError, match="frames/orientation"):
            times, displacement, orientation = cases.frames(0, 2)
            out.append_frames(times, displacement, orientation[:, :, :3])
        out.append(cases.record(5, 9))
        out.finish("yield", {})
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 9)
        assert found.n_frames == 0


def test_long_series_are_packed_where_that_pays_and_survive_growing(tmp_path, monkeypatch):
    """Zeros are packed, noise is not; the reserved space is outgrown several times; slabs are smaller than the file."""
    monkeypatch.setattr(writer, "_RESERVE", 4096)
    monkeypatch.setattr(writer, "_SLAB", 40_000)
    monkeypatch.setattr(writer, "_PACK_FROM", 40_000)
    monkeypatch.setattr(writer, "_CHUNK", 3_000)
    rng = np.random.default_rng(1)
    noise, turn = rng.normal(size=(900, 2, 3)), rng.normal(size=(900, 2, 4))
    with open_writer(tmp_path / "run.h5", hold=0.0) as out:
        for start in range(0, 9000, 900):
            out.append(cases.record(start, start + 900))
            k = start // 10
            out.append_frames(np.arange(k, k + 90.0), 0.0 * noise[k : k + 90], turn[k : k + 90])
        out.finish("yield", {})
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 9000)
        np.testing.assert_array_equal(found.frame_time, np.arange(900.0))
        for k in (0, 89, 90, 511, 899):
            np.testing.assert_array_equal(found.frame_orientation(k), turn[k])
            assert not found.frame_displacement(k).any()
        np.testing.assert_array_equal(found.series("load", 8990, 8995), 100.0 + np.arange(8990.0, 8995.0))
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["frames/displacement"].compression == "gzip"
        assert file["frames/orientation"].compression is None
        assert file["history/time"].shape == (9000,)


# --- running, finished, in the way ---


def test_a_running_history_is_readable_at_every_moment(tmp_path):
    assembly = cases.assembly()
    out = open_writer(tmp_path / "run.h5", hold=0.0)
    for k in range(5):
        out.append(cases.record(10 * k, 10 * k + 10))
        out.append_frames(*cases.frames(k, k + 1))
        with history.read(tmp_path / "run.h5") as found:
            assert found.status == "running" and found.results == {}
            check_rows(found, 10 * k + 10)
            check_frames(found, k + 1, assembly)
        with h5py.File(tmp_path / "run.h5") as plain:  # locks as any other program does; the writer goes on
            assert plain["written"][:].tolist() == [10 * k + 10, k + 1]
            out.flush()
    out.finish("completed", {})
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "completed"
        check_rows(found, 50)


def test_a_short_run_stays_in_memory_and_close_writes_it(tmp_path):
    out = open_writer(tmp_path / "run.h5", hold=1e9)
    out.append(cases.record(0, 4))
    with history.read(tmp_path / "run.h5") as found:  # what a kill would leave
        assert (found.status, found.n_row, found.n_frames, found.begun) == ("running", 0, 0, False)
    out.close()
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "running"
        check_rows(found, 4)
    with pytest.raises(WriteError, match="closed"):
        out.finish("yield", {})
    with pytest.raises(ValueError, match="closed"):
        out.append(cases.record(4, 5))


def test_an_error_in_the_run_keeps_its_rows(tmp_path):
    with pytest.raises(ZeroDivisionError), open_writer(tmp_path / "run.h5") as out:
        out.append(cases.record(0, 4))
        raise ZeroDivisionError
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 4)


def test_a_finished_history_needs_force(tmp_path):
    path = finished(tmp_path / "run.h5")
    before = path.read_bytes()
    with pytest.raises(OutputError, match="--force"):
        open_writer(path)
    assert path.read_bytes() == before
    with open_writer(path, force=True) as out:
        assert path.read_bytes() == before  # nothing is lost before there is something to put in its place
        out.append(cases.record(0, 2))
        out.finish("completed", {})
    with history.read(path) as found:
        check_rows(found, 2)


def test_a_crashed_or_empty_file_gives_way_but_not_a_stranger(tmp_path):
    path = tmp_path / "run.h5"
    path.touch()
    out = open_writer(path, hold=0.0)
    out.append(cases.record(0, 2))
    out.close()
    finished(path)
    stranger = tmp_path / "thesis.txt"
    stranger.write_text("three years of work")
    with pytest.raises(OutputError, match="not a history.*--force"):
        open_writer(stranger)
    assert stranger.read_text() == "three years of work"


def test_what_killed_processes_left_is_cleared_away(tmp_path):
    """A half-written neighbour goes once its process is gone; that of a living one, and other files, stay."""
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left, stay = f".run.h5.{gone.pid}.part", {f".run.h5.{os.getppid()}.part", ".other.h5.1.part", ".run.h5.x.part"}
    for name in {left} | stay:
        (tmp_path / name).write_text("half")
    finished(tmp_path / "run.h5")
    assert set(os.listdir(tmp_path)) == {"run.h5"} | stay


def test_a_link_is_followed_to_its_file(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "run.h5").symlink_to(tmp_path / "disk" / "real.h5")
    finished(tmp_path / "run.h5")
    assert (tmp_path / "run.h5").is_symlink()
    assert os.listdir(tmp_path / "disk") == ["real.h5"]


def test_paths_that_cannot_be_used(tmp_path, monkeypatch):
    with pytest.raises(OutputError, match="folder .* does not exist"):
        open_writer(tmp_path / "no" / "run.h5")
    with pytest.raises(OutputError, match="this is a folder"):
        open_writer(tmp_path)
    with pytest.raises(OutputError, match="too long"):
        open_writer(tmp_path / ("x" * 300))
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="not an ordinary file"):
        open_writer(tmp_path / "pipe")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files.os, "open", refuse)  # root, who may run this test, is refused nothing
    with pytest.raises(WriteError, match="cannot be written .Permission denied"):
        open_writer(tmp_path / "run.h5")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(WriteError, match="Permission denied"):
            open_writer(tmp_path / "run.h5")
    finally:
        tmp_path.chmod(0o700)


# --- failing disks ---

FULL = """
import resource, signal, sys
sys.path[:0] = {paths!r}
import history_cases as cases
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
    """A limit on the size of files stands for the full disk: growing fails in the middle of HDF5's own writes."""
    path = str(tmp_path / "run.h5")
    code = FULL.format(paths=[str(Path(__file__).parent), *sys.path], path=path)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    append, *finishes = done.stdout.splitlines()
    flushed, message = append.split(" ", 1)
    assert f"the {flushed} rows and 0 frames written before stay readable" in message and "File too large" in message
    assert len(finishes) == 2 and all("stay readable" in line for line in finishes)
    assert os.listdir(tmp_path) == ["run.h5"]
    with history.read(path) as found:
        assert found.status == "running" and found.n_row >= 20
        check_rows(found, int(flushed))


def test_a_write_that_fails_in_the_reserved_space(tmp_path, monkeypatch):
    """No space left in the middle of a row: what was flushed stays, and the next attempt goes on from there."""
    out = open_writer(tmp_path / "run.h5", hold=0.0)
    out.append(cases.record(0, 6))
    put, calls = writer._put, []

    def full(*args):
        calls.append(1)
        if len(calls) > 4:
            raise OSError(28, "No space left on device")
        put(*args)

    monkeypatch.setattr(writer, "_put", full)
    with pytest.raises(WriteError, match="No space left on device.*the 6 rows and 0 frames"):
        out.append(cases.record(6, 12))
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 6)
    monkeypatch.setattr(writer, "_put", put)
    out.append(cases.record(12, 14))
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 14)


def test_a_folder_that_goes_away(tmp_path):
    (tmp_path / "gone").mkdir()
    out = open_writer(tmp_path / "gone" / "run.h5", hold=0.0)
    out.append(cases.record(0, 6))
    (tmp_path / "gone" / "run.h5").unlink()
    (tmp_path / "gone").rmdir()
    with pytest.raises(WriteError, match="could not be written"):
        out.finish("yield", {})


def test_a_failed_rename_never_costs_rows(tmp_path, monkeypatch):
    """finish closes the running file before the rename; if that fails, nothing may replace the file any more."""
    out = open_writer(tmp_path / "run.h5", hold=0.0)
    out.append(cases.record(0, 6))
    monkeypatch.setattr(files.os, "replace", lambda *_: (_ for _ in ()).throw(OSError(5, "Input/output error")))
    with pytest.raises(WriteError, match="Input/output error.*the 6 rows"):
        out.finish("yield", {})
    monkeypatch.undo()
    with pytest.raises(WriteError):
        out.finish("yield", {})
    with history.read(tmp_path / "run.h5") as found:
        check_rows(found, 6)
    assert os.listdir(tmp_path) == ["run.h5"]


# --- kills ---

CHILD = """
import sys
sys.path[:0] = {paths!r}
import history_cases as cases
from dembrick import history
from dembrick.history import writer
writer._RESERVE = 20_000  # many growths
n = {n_block}
from dembrick.model import CHANNELS
out = history.HistoryWriter({path!r}, cases.SCENARIO, cases.many_blocks(n), {{}}, False, CHANNELS, hold=0.0)
print("start", flush=True)
rows = frames = 0
for round in range(10**6):
    out.append(cases.record(rows, rows + 1 + round % 7))
    rows += 1 + round % 7
    print(rows, frames, flush=True)
    if round % 2:
        out.append_frames(*cases.frames(frames, frames + 1, n), **cases.motion(frames, frames + 1, n))
        frames += 1
        print(rows, frames, flush=True)
    if round % 40 == 39:
        out.finish("completed", {{}})
        print("finished", rows, frames, flush=True)
        out = history.HistoryWriter({path!r}, cases.SCENARIO, cases.many_blocks(n), {{}}, True, CHANNELS, hold=0.0)
        rows = frames = 0
"""


def kill_and_read(folder, rng):
    """Kill a writing child at a random moment; everything it had reported as flushed must be there, and right."""
    n_block, path = 20, folder / "run.h5"
    code = CHILD.format(paths=[str(Path(__file__).parent), *sys.path], path=str(path), n_block=n_block)
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
        if done and found.status == "running":  # the next history had taken its place already
            rows = frames = 0
        elif not done and found.status == "completed":  # killed between finishing and saying so
            assert found.n_row == rows
        assert rows <= found.n_row <= rows + 7 and frames <= found.n_frames <= frames + 1
        check_rows(found, found.n_row)
        check_frames(found, found.n_frames, assembly)
        motion = cases.motion(0, found.n_frames, n_block)
        for k in range(found.n_frames):
            np.testing.assert_array_equal(found.frame_velocity(k), motion["velocity"][k])
            np.testing.assert_array_equal(found.frame_spin(k), motion["spin"][k])
            np.testing.assert_array_equal(found.frame_contact_force(k), motion["contact_force"][k])
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
    kills(tmp_path, 12)


@pytest.mark.slow
def test_fifty_kills_at_random_moments(tmp_path):
    kills(tmp_path, 50)


# --- files from elsewhere ---


def test_a_cut_file_is_refused_at_every_length(tmp_path):
    whole = finished(tmp_path / "run.h5").read_bytes()
    cut = tmp_path / "cut.h5"
    for length in [0, 1, 7, 8, 100, *range(1000, len(whole), 4999), len(whole) - 1]:
        cut.write_bytes(whole[:length])
        with pytest.raises(HistoryError) as caught:
            history.read(cut)
        assert str(cut) in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_replaced_while_it_is_read(tmp_path):
    """A run puts a new file in the place of the old one; who has the old one open reads on."""
    path = finished(tmp_path / "run.h5")
    with history.read(path) as found:
        (tmp_path / "other").write_bytes(b"short")
        os.replace(tmp_path / "other", path)
        assert len(found.block_names) == found.n_block == 2
        assert found.position0.shape == (2, 3)


def read_all(path):
    """Touch everything that a history offers."""
    with history.read(path) as found:
        for name in dir(type(found)):
            if not name.startswith("_"):
                getattr(found, name)
        for name in layout.JOINT_CHANNELS:
            found.joint(name)
        for i in range(found.n_block):
            found.block_vertices(i), found.block_faces(i)
        for k in range(found.n_frames):
            found.frame_position(k), found.frame_displacement(k), found.frame_orientation(k)
            found.frame_velocity(k), found.frame_spin(k), found.frame_contact_force(k)


def replaced(name, make):
    """An edit of the file that puts something else in the place of a dataset."""

    def edit(file, folder):
        del file[name]
        make(file, name, folder)

    return edit


def outside(folder):
    """A file that must not be read: another history's worth of numbers."""
    with h5py.File(folder / "outside.h5", "w") as other:
        other["secret"] = np.arange(20.0)
    np.arange(20.0).tofile(folder / "outside.raw")
    return folder


def external_storage(file, name, folder):
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_external(os.fsencode(outside(folder) / "outside.raw"), 0, 160)
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple((20,)), how)


def virtual(file, name, folder):
    source = h5py.VirtualLayout((20,), float)
    source[:] = h5py.VirtualSource(outside(folder) / "outside.h5", "secret", (20,))
    file.create_virtual_dataset(name, source)


def soft(file, name, _folder):
    file[name] = h5py.SoftLink("/history/time")


def external(file, name, folder):
    file[name] = h5py.ExternalLink(str(outside(folder) / "outside.h5"), "secret")


def put(value, **options):
    return lambda file, name, _folder: file.create_dataset(name, data=value, **options)


def absurd(shape, **options):
    return lambda file, name, _folder: file.create_dataset(name, shape, float, **options)


def set_attribute(name, value):
    return lambda file, _folder: file.attrs.__setitem__(name, value)


STRANGE = {
    "not ours": lambda file, _: file.attrs.clear(),
    "newer": set_attribute("format", 99),
    "format as text": set_attribute("format", "one"),
    "format as a list": set_attribute("format", [1, 2]),
    "status as number": set_attribute("status", 3),
    "status empty": set_attribute("status", h5py.Empty("f8")),
    "results not JSON": set_attribute("results", "{"),
    "results a list": set_attribute("results", "[1]"),
    "results deep": set_attribute("results", "[" * 100_000),
    "settings a number": set_attribute("settings", 5),
    "soft link": replaced("history/load", soft),
    "external link": replaced("history/load", external),
    "external group": replaced("history/joint", external),
    "external frames": replaced("frames", external),
    "external storage": replaced("history/load", external_storage),
    "virtual": replaced("history/load", virtual),
    "external scenario": replaced("scenario", external),
    "external vertices": replaced("geometry/blocks/vertices", external),
    "missing": replaced("history/load", lambda *_: None),
    "missing group": replaced("geometry", lambda *_: None),
    "group for dataset": replaced("history/load", lambda file, name, _: file.create_group(name)),
    "dataset for group": replaced("history/joint", put(np.zeros(3))),
    "short": replaced("history/load", put(np.zeros(19))),
    "too many axes": replaced("history/load", put(np.zeros((20, 2)))),
    "wrong width": replaced("history/joint/N", put(np.zeros((20, 2)))),
    "text": replaced("history/load", put(["a"] * 20)),
    "compound": replaced("history/load", put(np.zeros(20, [("a", "f8"), ("b", "f8")]))),
    "absurd length": replaced("history/load", absurd((10**15,), chunks=(1024,))),
    "absurd width": replaced("frames/position", absurd((4, 10**9, 3), chunks=(1, 1024, 3))),
    "absurd blocks": replaced("geometry/blocks/vertices", absurd((10**15, 3), chunks=(1024, 3))),
    "foreign filter": replaced("history/load", put(np.zeros(20), compression="lzf", chunks=(20,))),
    "written negative": lambda file, _: file["written"].__setitem__(0, -1),
    "written beyond": lambda file, _: file["written"].__setitem__(0, 21),
    "written frames": lambda file, _: file["written"].__setitem__(1, 2**62),
    "written scalar": replaced("written", put(4)),
    "scenario as number": replaced("scenario", put(4)),
    "face beyond": lambda file, _: file["geometry/blocks/corner"].__setitem__(3, 8),
    "face negative": lambda file, _: file["geometry/blocks/corner"].__setitem__(3, -1),
    "starts backwards": lambda file, _: file["geometry/blocks/vertex_start"].__setitem__(1, 17),
    "no faces": replaced("geometry/blocks/corner_start", put(np.zeros(0, int))),
    "not a number": lambda file, _: file["geometry/blocks/position"].__setitem__((0, 0), np.nan),
    "joint of nothing": lambda file, _: file["geometry/joints/blocks"].__setitem__((0, 0), 7),
    "jack on nothing": lambda file, _: file["geometry/actuators/block"].__setitem__(0, 2),
    "control point on nothing": lambda file, _: file["geometry/control_points/block"].__setitem__(0, -1),
    "control points without names": lambda file, _: file.__delitem__("geometry/control_points/name"),
    "contacts too short": replaced("frames/contact_force", put(np.zeros((4, 3, 3)))),
    "absurd contacts": replaced("geometry/joints/point", absurd((10**15, 5), chunks=(1024, 5))),
    "absurd velocity": replaced("frames/velocity", absurd((10**12, 2, 3), chunks=(64, 2, 3))),
    "external spin": replaced("frames/spin", external),
    "soft contacts": replaced("frames/contact_force", soft),
    "external mass": replaced("geometry/blocks/mass", external),
    "inertia of another shape": replaced("geometry/blocks/inertia", put(np.zeros((2, 3)))),
    "mass not a number": lambda file, _: file["geometry/blocks/mass"].__setitem__(1, np.nan),
    "names as bytes": replaced("geometry/blocks/name", put(np.array([b"\xff", b"\xfe"]))),
}


@pytest.mark.parametrize("edit", STRANGE.values(), ids=STRANGE)
def test_a_strange_file_gives_one_sentence(tmp_path, edit):
    path = finished(tmp_path / "run.h5")
    read_all(path)
    with h5py.File(path, "r+") as file:
        edit(file, tmp_path)
    with pytest.raises(HistoryError) as caught:
        read_all(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message and len(message) < 300 + len(str(path))


def test_flipped_bytes_never_give_another_error(tmp_path):
    """Random damage is either noticed with our own error, or falls on numbers and reads as other numbers."""
    whole = finished(tmp_path / "run.h5").read_bytes()
    rng = random.Random(3)
    bad, noticed = tmp_path / "bad.h5", 0
    for _ in range(150):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 20)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        bad.write_bytes(damaged)
        try:
            read_all(bad)
        except HistoryError:
            noticed += 1
    print(f"noticed {noticed} of 150")
    assert noticed > 10


def test_other_things_than_files(tmp_path):
    (tmp_path / "note.h5").write_text("hello")
    for name, words in (("nothing.h5", "no such file"), (".", "not a file"), ("note.h5", "not an HDF5 file")):
        with pytest.raises(HistoryError, match=words):
            history.read(tmp_path / name)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(HistoryError, match="not a file"):
        history.read(tmp_path / "pipe")


def test_reading_takes_no_more_than_asked(tmp_path):
    """One frame out of 40 MB of frames, in a process that may not have 20 MB more than it needs to open the file."""
    assembly, n_block, n_frame = cases.many_blocks(500), 500, 1000
    noise = np.random.default_rng(2).normal(size=(n_frame, n_block, 7))  # so that nothing can be packed
    with open_writer(tmp_path / "run.h5", assembly, hold=0.0) as out:
        out.append(cases.record(0, 5))
        for k in range(0, n_frame, 50):
            out.append_frames(np.arange(k, k + 50.0), noise[k : k + 50, :, :3], noise[k : k + 50, :, 3:])
        out.finish("completed", {})
    assert (tmp_path / "run.h5").stat().st_size > 25e6
    code = f"""
import resource, sys
sys.path[:0] = {sys.path!r}
from dembrick import history
history.read({str(tmp_path / "run.h5")!r}).close()
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 20_000_000,) * 2)
found = history.read({str(tmp_path / "run.h5")!r})
print(found.status, found.n_frames, found.frame_position(777)[3].tolist())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    position = assembly.position[3] + noise[777, 3, :3]
    assert done.stdout.strip() == f"completed 1000 {position.tolist()}", done.stderr


def test_a_long_run_holds_a_few_frames_only(tmp_path):
    """A run of 1,000 blocks writes 1,000 frames, 128 MB of numbers, within 40 MB of what it needs without a record."""
    code = f"""
import resource, sys
sys.path[:0] = {[str(Path(__file__).parent.parent / "tools"), *sys.path]!r}
import bench_history as bench
bench.run(bench.pairs(1000, 1000, 1))
bench.run(bench.pairs(10, 300, 300), {str(tmp_path / "small.h5")!r})
before = bench.megabytes()
bench.run(bench.pairs(1000, 1000, 1000), {str(tmp_path / "run.h5")!r})
print(bench.read({str(tmp_path / "run.h5")!r}).n_frames, bench.megabytes() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    frames, megabytes = done.stdout.split()
    print(f"{frames} frames, {megabytes} MB more")
    assert int(frames) >= 990 and float(megabytes) < 40


def test_reason_out_of_hdf5():
    error = OSError(28, "Unable to create file (open failed: errno = 28, error message = 'no space left on device')")
    assert files.reason(error) == "No space left on device"
    assert files.reason(OSError(13, "Permission denied")) == "Permission denied"
    assert files.reason(RuntimeError("first\nsecond")) == "first" and files.reason(RuntimeError()) == "RuntimeError"
