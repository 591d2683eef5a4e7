"""History files: data read equal data written, during the run and after it, and in little memory."""

import json
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.errors import HistoryError, OutputError, WriteError
from dembrick.history import files, layout, writer
from dembrick.scenario import controls, model
from helpers import history_cases as cases
from helpers.places import TOOLS

# --- data read equal data written ---


@pytest.mark.parametrize("hold", [0.0, 1e9])
def test_everything_comes_back(tmp_path, hold):
    assembly = cases.mixed_assembly()
    with cases.open_writer(tmp_path / "run.h5", assembly, hold=hold) as out:
        for start, stop in ((0, 7), (7, 8), (8, 40)):
            out.append(cases.record(start, stop, 2, 0))
        out.append_frames(*cases.frames(0, 3, 3))
        out.append_frames(*cases.frames(3, 5, 3))
        out.finish("yield", cases.RESULTS, {"rate": 2.0})
    assert os.listdir(tmp_path) == ["run.h5"]
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 40, 2, 0)
        cases.check_frames(found, 5, assembly)
        assert found.frame_time[-1] == cases.frames(4, 5)[0][0]
        np.testing.assert_array_equal(found.frame("position", -1), found.frame("position", 4))
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
    with cases.open_writer(tmp_path / "all.h5", assembly, channels=model.CHANNELS, control=cases.CONSTANT_RATE) as out:
        out.append(cases.record(0, 5, 2, 0))
        out.append_frames(*cases.frames(0, 2, 3), **{name: value[:2] for name, value in motion.items()})
        out.append_frames(*cases.frames(2, 5, 3), **{name: value[2:] for name, value in motion.items()})
        with pytest.raises(ValueError, match="frames/contact_force"):
            out.append_frames(*cases.frames(5, 6, 3), **cases.motion(5, 6, 3, 5))
        out.finish("yield", cases.RESULTS)
    with history.read(tmp_path / "all.h5") as found:
        for k in range(-1, 5):
            np.testing.assert_array_equal(found.frame("velocity", k), motion["velocity"][k])
            np.testing.assert_array_equal(found.frame("spin", k), motion["spin"][k])
            np.testing.assert_array_equal(found.frame("contact_force", k), motion["contact_force"][k])
        cases.check_frames(found, 5, assembly)
        np.testing.assert_array_equal(found.block_mass, assembly.mass)
        np.testing.assert_array_equal(found.block_inertia, assembly.inertia)
    with cases.open_writer(tmp_path / "few.h5", assembly, channels=("frames",)) as out:
        out.append(cases.record(0, 5, 2, 0))
        out.append_frames(*cases.frames(0, 5, 3), **motion)
        out.finish("yield", cases.RESULTS)
    with history.read(tmp_path / "few.h5") as found:
        assert found.energy == {} and found.load.shape == (5,)
        cases.check_frames(found, 5, assembly)
        assert found.frame("velocity", 0) is found.frame("spin", 0) is found.frame("contact_force", 0) is None
        with pytest.raises(HistoryError, match="joint forces were not recorded.*output.channels"):
            found.joint("N")


@pytest.mark.parametrize("hold", [0.0, 10.0])
def test_new_contacts_come_back_however_many_a_frame_has(tmp_path, monkeypatch, hold):
    """Written a few frames at a time while the file grows, and continued after a kill at any of them."""
    monkeypatch.setattr(writer, "_RESERVE", 3000)
    channels = model.CHANNELS

    def add(out, start, stop):
        out.append(cases.moving_record(start, stop))
        met = cases.new_contacts(start, stop)
        moved = cases.motion(start, stop) | cases.moved(start, stop)
        out.append_frames(*cases.frames(start, stop), **moved, new_contacts=met)

    with cases.open_writer(tmp_path / "run.h5", hold=hold, channels=channels, control=cases.MOTION) as out:
        for start in range(0, 300, 5):
            add(out, start, start + 5)
            if hold == 0.0 and start % 50 == 0:
                with history.read(tmp_path / "run.h5") as found:
                    assert found.status == "running"
                    cases.check_new_contacts(found, start + 5)
        with pytest.raises(ValueError, match="new_contacts/force has shape"):
            wrong = cases.new_contacts(300, 305) | {"force": np.zeros((2, 3))}
            moved = cases.motion(300, 305) | cases.moved(300, 305)
            out.append_frames(*cases.frames(300, 305), **moved, new_contacts=wrong)
    left = history.read(tmp_path / "run.h5")
    assert left.n_frames == 300 and (left.new_contacts_before(0), left.new_contacts_before(4)) == (0, 6)
    with history.HistoryWriter.resume(left, cases.assembly(), {}, channels, 203, 203, cases.MOTION) as out:
        add(out, 203, 401)
        out.finish("completed", {})
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 401)
        cases.check_new_contacts(found, 401)
        names = ("joint_shift", "contact_arm", "contact_area")
        shift, arm, area = (found.frame_values(name, 7, 8)[0].tolist() for name in names)
        assert shift == [[7.0, 7.0]] and area == [7.0, 8.0, 9.0, 10.0]
        assert arm == [[7.0, 7.5], [8.0, 8.5], [9.0, 9.5], [10.0, 10.5]]
        with pytest.raises(IndexError):
            found.frame_new_contacts(0, 402)
    with h5py.File(tmp_path / "run.h5") as file:
        met = file["frames/new_contacts"]
        assert len(met["force"]) == met["end"][-1] == (np.arange(401) % 4).sum() and met["blocks"].dtype == np.int64
    with history.read(cases.finished(tmp_path / "other.h5")) as found:
        assert found.frame_new_contacts(0, 4) is None and not found.has_new_contacts


def test_jacks_come_back(tmp_path):
    with history.read(cases.finished(tmp_path / "run.h5")) as found:
        (jack,) = found.actuators
        assert (jack["name"], jack["kind"], jack["block"], jack["weight"]) == ("jack", "actuator", 1, 1.0)
        assert jack["point"].tolist() == [0.075, 0.0, 0.0] and jack["direction"].tolist() == [0.0, 1.0, 0.0]


def test_the_file_is_what_other_scripts_expect(tmp_path):
    """By plain h5py: documented names and shapes, units and a description on every dataset, exact lengths."""
    with h5py.File(cases.finished(tmp_path / "run.h5")) as file:
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


def test_the_record_of_a_run_in_real_time_counts_new_contacts(tmp_path):
    """The control decides; a record without them is refused."""
    with cases.open_writer(tmp_path / "run.h5", control=cases.MOTION) as out:
        for start in (0, 4):
            out.append(cases.moving_record(start, start + 4))
        with pytest.raises(ValueError, match="history/energy/released"):
            out.append(cases.record(8, 12))
        out.finish("completed", {})
    with history.read(tmp_path / "run.h5") as found:
        assert found.in_real_time and found.new_contacts.tolist() == [0.0, 1.0, 2.0, 3.0] * 2
    with history.read(cases.finished(tmp_path / "other.h5")) as found:
        assert not found.in_real_time and not found.new_contacts.any() and len(found.new_contacts) == found.n_row
        assert "new_contacts" not in found.series_names("history")


def everything_in(path):
    """All objects in a file by h5py: their attributes and, for datasets, type, shape and values."""
    found = {}

    def visit(name, node):
        found[name] = {key: (type(value), value) for key, value in node.attrs.items()}
        if isinstance(node, h5py.Dataset):
            values = node.asstr()[...] if h5py.check_string_dtype(node.dtype) else node[...]
            found[name] |= {"": (node.dtype, node.shape, node.chunks, values.tolist())}

    with h5py.File(path) as file:
        visit("/", file)
        file.visititems(visit)
    return found


def test_a_run_without_frames_or_rows(tmp_path):
    with cases.open_writer(tmp_path / "rows.h5", channels=("joints", "energy")) as out:
        out.append(cases.record(0, 3))
        with pytest.raises(ValueError, match="without frames"):
            out.append_frames(*cases.frames(0, 1))
        out.finish("completed", {})
    with history.read(tmp_path / "rows.h5") as found:
        cases.check_rows(found, 3)
        assert found.n_frames == 0 and len(found.frame_time) == 0
        assert found.title == "two blocks, one joint"
        with pytest.raises(IndexError):
            found.frame("position", 0)
    with cases.open_writer(tmp_path / "empty.h5") as out:
        out.finish("failed", {"error": "diverged"})
    with history.read(tmp_path / "empty.h5") as found:
        assert (found.n_row, found.n_frames, found.status) == (0, 0, "failed")
        assert found.load.shape == (0,) and found.joint("N").shape == (0, 1)


@pytest.mark.parametrize("hold", [0.0, 1e9])
def test_records_of_the_wrong_shape_are_refused_and_leave_no_trace(tmp_path, hold):
    with cases.open_writer(tmp_path / "run.h5", hold=hold) as out:
        out.append(cases.record(0, 5))
        bad = cases.record(5, 9)
        bad["unbalanced"] = bad["unbalanced"][:2]
        with pytest.raises(ValueError, match="history/unbalanced"):
            out.append(bad)
        with pytest.raises(ValueError, match="history/energy/elastic: the record has no such channel"):
            out.append(cases.record(5, 9, names=("kinetic",)))
        with pytest.raises(ValueError, match="frames/orientation"):
            times, displacement, orientation = cases.frames(0, 2)
            out.append_frames(times, displacement, orientation[:, :, :3])
        out.append(cases.record(5, 9))
        out.finish("yield", {})
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 9)
        assert found.n_frames == 0


def test_long_series_are_packed_where_that_pays_and_survive_growing(tmp_path, monkeypatch):
    """Zeros are compressed, noise is not; the reserved space is outgrown several times; slabs are small."""
    monkeypatch.setattr(writer, "_RESERVE", 4096)
    monkeypatch.setattr(writer, "_SLAB", 40_000)
    monkeypatch.setattr(writer, "_PACK_FROM", 40_000)
    monkeypatch.setattr(writer, "_CHUNK", 3_000)
    rng = np.random.default_rng(1)
    noise, turn = rng.normal(size=(900, 2, 3)), rng.normal(size=(900, 2, 4))
    with cases.open_writer(tmp_path / "run.h5", hold=0.0) as out:
        for start in range(0, 9000, 900):
            out.append(cases.record(start, start + 900))
            k = start // 10
            out.append_frames(np.arange(k, k + 90.0), 0.0 * noise[k : k + 90], turn[k : k + 90])
        out.finish("yield", {})
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 9000)
        np.testing.assert_array_equal(found.frame_time, np.arange(900.0))
        for k in (0, 89, 90, 511, 899):
            np.testing.assert_array_equal(found.frame("orientation", k), turn[k])
            assert not found.frame("displacement", k).any()
        np.testing.assert_array_equal(found.series("load", 8990, 8995), 100.0 + np.arange(8990.0, 8995.0))
    with h5py.File(tmp_path / "run.h5") as file:
        assert file["frames/displacement"].compression == "gzip"
        assert file["frames/orientation"].compression is None
        assert file["history/time"].shape == (9000,)


# --- running files, finished files, files in the way ---


def test_a_running_history_is_readable_at_every_moment(tmp_path):
    assembly = cases.assembly()
    out = cases.open_writer(tmp_path / "run.h5", hold=0.0)
    for k in range(5):
        out.append(cases.record(10 * k, 10 * k + 10))
        out.append_frames(*cases.frames(k, k + 1))
        with history.read(tmp_path / "run.h5") as found:
            assert found.status == "running" and found.results == {}
            cases.check_rows(found, 10 * k + 10)
            cases.check_frames(found, k + 1, assembly)
        with h5py.File(tmp_path / "run.h5") as plain:  # locks the file as any other program does; the writer continues
            assert plain["written"][:].tolist() == [10 * k + 10, k + 1]
            out.flush()
    out.finish("completed", {})
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "completed"
        cases.check_rows(found, 50)


@pytest.mark.parametrize(
    ("control", "counts"),
    [
        (controls.YieldControl(large_displacements=True), True),
        (controls.DisplacementControl(1e-3, 1e-2, large_displacements=True), True),
        (controls.StaticsControl(large_displacements=True), True),
        (controls.SettlementControl(("floor",), (1e-3, 0.0, 0.0)), True),
        (controls.PushoverControl((1.0, 0.0, 0.0)), True),
        (controls.DisplacementControl(1e-3, 1e-2), False),
        (controls.DynamicControl(1.0), False),
    ],
)
def test_times_of_a_killed_path_are_numbers_of_equilibria(tmp_path, control, counts):
    """Also if the run was killed before it could record their number."""
    out = cases.open_writer(tmp_path / "run.h5", cases.mixed_assembly(), hold=1e9, control=control)
    out.close()
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "running" and found.counts_equilibria == counts


def test_a_short_run_stays_in_memory_and_close_writes_it(tmp_path):
    out = cases.open_writer(tmp_path / "run.h5", hold=1e9)
    out.append(cases.record(0, 4))
    with history.read(tmp_path / "run.h5") as found:  # the file that a kill would leave
        assert (found.status, found.n_row, found.n_frames, found.begun) == ("running", 0, 0, False)
    out.close()
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "running"
        cases.check_rows(found, 4)
    with pytest.raises(WriteError, match="closed"):
        out.finish("yield", {})
    with pytest.raises(ValueError, match="closed"):
        out.append(cases.record(4, 5))


def test_an_error_in_the_run_keeps_its_rows(tmp_path):
    with pytest.raises(ZeroDivisionError), cases.open_writer(tmp_path / "run.h5") as out:
        out.append(cases.record(0, 4))
        raise ZeroDivisionError
    with history.read(tmp_path / "run.h5") as found:
        cases.check_rows(found, 4)


def test_a_finished_history_needs_force(tmp_path):
    path = cases.finished(tmp_path / "run.h5")
    before = path.read_bytes()
    with pytest.raises(OutputError, match="--force"):
        cases.open_writer(path)
    assert path.read_bytes() == before
    with cases.open_writer(path, force=True) as out:
        assert path.read_bytes() == before  # the old file stays until there is data to replace it
        out.append(cases.record(0, 2))
        out.finish("completed", {})
    with history.read(path) as found:
        cases.check_rows(found, 2)


def test_a_crashed_or_empty_file_gives_way_but_not_a_stranger(tmp_path):
    path = tmp_path / "run.h5"
    path.touch()
    out = cases.open_writer(path, hold=0.0)
    out.append(cases.record(0, 2))
    out.close()
    cases.finished(path)
    stranger = tmp_path / "thesis.txt"
    stranger.write_text("three years of work")
    with pytest.raises(OutputError, match="not a history.*--force"):
        cases.open_writer(stranger)
    assert stranger.read_text() == "three years of work"


def test_what_killed_processes_left_is_cleared_away(tmp_path):
    """A half-written temporary file goes once its process has ended; those of living ones, and other files, stay."""
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left, stay = f".run.h5.{gone.pid}.part", {f".run.h5.{os.getppid()}.part", ".other.h5.1.part", ".run.h5.x.part"}
    for name in {left} | stay:
        (tmp_path / name).write_text("half")
    cases.finished(tmp_path / "run.h5")
    assert set(os.listdir(tmp_path)) == {"run.h5"} | stay


def test_a_link_is_followed_to_its_file(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "run.h5").symlink_to(tmp_path / "disk" / "real.h5")
    cases.finished(tmp_path / "run.h5")
    assert (tmp_path / "run.h5").is_symlink()
    assert os.listdir(tmp_path / "disk") == ["real.h5"]


def test_a_folder_that_is_missing_is_made(tmp_path, monkeypatch):
    """One missing folder is created, as for a sweep or a run without --out; if two are missing, the path is refused."""
    monkeypatch.chdir(tmp_path)
    assert history.check_output("results/run.h5") == str(tmp_path / "results" / "run.h5")
    with pytest.raises(OutputError, match="folder .*/no does not exist"):
        history.check_output("no/no/run.h5")
    assert os.listdir(tmp_path) == ["results"]


def test_paths_that_cannot_be_used(tmp_path, monkeypatch):
    with pytest.raises(OutputError, match="folder .* does not exist"):
        cases.open_writer(tmp_path / "no" / "no" / "run.h5")
    with pytest.raises(OutputError, match="this is a folder"):
        cases.open_writer(tmp_path)
    with pytest.raises(OutputError, match="too long"):
        cases.open_writer(tmp_path / ("x" * 300))
    with pytest.raises(OutputError, match="too long"):
        cases.open_writer(tmp_path / ("x" * 300) / "run.h5")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="not an ordinary file"):
        cases.open_writer(tmp_path / "pipe")

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files.os, "open", refuse)  # root, who may run this test, has all permissions
    with pytest.raises(WriteError, match="cannot be written .Permission denied"):
        cases.open_writer(tmp_path / "run.h5")


# --- memory ---


def test_reading_takes_no_more_than_asked(tmp_path):
    """One frame of 40 MB of frames, in a process allowed less than 20 MB beyond the memory for opening the file."""
    assembly, n_block, n_frame = cases.many_blocks(500), 500, 1000
    noise = np.random.default_rng(2).normal(size=(n_frame, n_block, 7))  # cannot be compressed
    with cases.open_writer(tmp_path / "run.h5", assembly, hold=0.0) as out:
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
print(found.status, found.n_frames, found.frame("position", 777)[3].tolist())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    position = assembly.position[3] + noise[777, 3, :3]
    assert done.stdout.strip() == f"completed 1000 {position.tolist()}", done.stderr


def test_a_long_run_holds_a_few_frames_only(tmp_path):
    """A run of 1,000 blocks writes 1,000 frames, 128 MB of numbers, within 40 MB beyond the memory for one frame."""
    code = f"""
import resource, sys
sys.path[:0] = {[str(TOOLS), *sys.path]!r}
import bench_history as bench
bench.run(bench.pairs(1000, 10, 1), {str(tmp_path / "first.h5")!r})
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
