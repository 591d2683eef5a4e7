"""A disk that fills up during HDF5's own writes: an error instead of a crash, whatever the size."""

import os
import subprocess
import sys

import h5py
import numpy as np

from dembrick.history.hdf5_files import rewritten
from dembrick.history.layout import create
from dembrick.simulation.channels import Channel
from helpers.places import TESTS

# Every writer of HDF5 with a limit on the size of files, as on a full disk; one process tries many limits.
WRITERS = """
import faulthandler, resource, signal, sys
sys.dont_write_bytecode = True  # it would be cut off too, for all who come after
faulthandler.enable()
sys.path[:0] = {paths!r}
from helpers import history_cases as cases
from pathlib import Path
from dembrick import history
from dembrick.errors import WriteError
from dembrick.history import writer
from dembrick.runs.study import table
from dembrick.views import export
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
folder = {folder!r}

def finished(name):
    writer._PACK_FROM, writer._CHUNK = 1 << 10, 1 << 10
    out = history.HistoryWriter(folder + "/" + name, cases.SCENARIO, cases.assembly(), {{}}, force=True)
    out.append(cases.record(0, 300))
    out.append_frames(*cases.frames(0, 200))
    out.finish("yield", {{}})

def exported(name):
    export.to_vtkhdf(history.read(folder + "/run.h5"), folder + "/" + name + ".vtkhdf")

def tables(name):
    Path(folder, name).mkdir(exist_ok=True)
    row = {{"status": "yield", "V": 1.0, "joint.friction": 0.5, "error": "x" * 50}}
    rows = [row | {{"case": i}} for i in range(500)]
    head = {{"dembrick_study": 1, "digest": "d", "cases": 500}}
    Path(folder, name, "rows_1_of_1.jsonl").write_text("\\n".join(map(table.json.dumps, [head, *rows])) + "\\n")
    limit(size)
    table.write_tables(Path(folder, name), dict(digest="d", title="title"), ["joint.friction"])

def limit(size):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

finished("run.h5")
for write, largest in ((finished, 250_000), (exported, 400_000), (tables, 400_000)):
    failed = done = 0
    for step in range(1, 17):
        size = int(largest * step / 16.0)
        if write is not tables:
            limit(size)
        try:
            write(write.__name__)
            done += 1
        except WriteError as error:
            assert "File too large" in str(error), error
            failed += 1
        limit(resource.RLIM_INFINITY)
    print(failed, done)
"""


def test_a_full_disk_is_an_error(tmp_path):
    code = WRITERS.format(paths=[str(TESTS), *sys.path], folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    found = [[int(word) for word in line.split()] for line in done.stdout.splitlines()]
    assert len(found) == 3 and all(failed > 3 and succeeded > 0 for failed, succeeded in found)
    assert not [name for name in os.listdir(tmp_path) if name.endswith(".part")]


def test_what_is_written_through_python_reads_back(tmp_path):
    numbers = np.random.default_rng(1).random(100_000)
    with rewritten(tmp_path / "a.h5") as (file, check):
        file.create_dataset("x", data=numbers, chunks=(1000,), compression="gzip")
        file.attrs["word"] = "µ"
        check()
    with rewritten(tmp_path / "a.h5", "r+") as (file, _):
        file["x"][10:20] = 0.0
        file["y"] = np.arange(3)
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["x"][:10], numbers[:10])
        assert not file["x"][10:20].any() and file.attrs["word"] == "µ"
        np.testing.assert_array_equal(file["y"], [0, 1, 2])


def test_a_field_that_grows_is_reserved_where_it_is_said(tmp_path):
    field = Channel("history/x", "m", "a place", (3,))
    offsets = create(str(tmp_path / "a.h5"), {field: 50}, [], {"status": "running"}, {})
    with open(tmp_path / "a.h5", "r+b") as file:
        file.seek(offsets["history/x"])
        file.write(np.arange(150.0).tobytes())
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["history/x"], np.arange(150.0).reshape(50, 3))
        assert file.attrs["status"] == "running" and file["history/x"].attrs["units"] == "m"


PICTURES = """
import resource, signal, sys
sys.path[:0] = {paths!r}
import numpy as np
from matplotlib.figure import Figure
from dembrick.errors import WriteError
from dembrick.views.plot.style import save
from dembrick.views.render.images import write_png
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
figure, pixels = Figure(), np.random.default_rng(0).integers(0, 255, (200, 200, 3), np.uint8)
figure.add_subplot().plot([0, 1])
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
for name in ("a.png", "a.svg", "a.pdf", "b.png"):
    path = {folder!r} + "/" + name
    try:
        write_png(pixels, path) if name[0] == "b" else save(figure, path)
    except WriteError as error:
        print(error)
"""


def test_pictures_on_a_full_disk_say_why_and_nothing_else(tmp_path):
    code = PICTURES.format(paths=[str(TESTS), *sys.path], folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stderr == ""
    assert [line.count("File too large") for line in done.stdout.splitlines()] == [1, 1, 1, 1]
    assert not os.listdir(tmp_path)
