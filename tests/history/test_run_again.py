"""A history holds the input files of its scenario: it runs again without them, bit for bit the same."""

import dataclasses
import json
import shutil

import h5py
import numpy as np
import pytest

import dembrick
from dembrick.cli import main
from dembrick.errors import HistoryError
from helpers import cad_files
from helpers.restart_cases import content, stop_at_look
from helpers.scenario_text import header

BOXES = {"ground": ((-500.0, -500.0, -100.0), (1500.0, 800.0, 0.0)), "post": ((0.0, 0.0, 0.0), (200.0, 300.0, 600.0))}
STONE = "\n".join(
    ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {axis}" for axis in "xyz"), "element face 12"]
    + ["property list uchar int vertex_indices", "end_header"]
    + [f"{x} {y} {z}" for z in (-0.1, 0.1) for y in (-0.2, 0.2) for x in (-0.2, 0.2)]
    + [f"3 {a} {b} {c}" for a, b, c in cad_files.TRIANGLES]
)
SCENE = (
    header("concave", 0.5, 1e8)
    + """
supports = []
[[models]]
name = "cad"
file = "scene.gltf"
unit = "m"
material = "stone"
[[blocks]]
name = "cap"
material = "stone"
position = [0.1, 0.15, 0.7]
mesh = "meshes/cap stone.ply"
[[loads]]
block = "cap"
force = [40.0, 0.0, 0.0]
history = "push.csv"
[control]
kind = "base-motion"
duration = 0.1
direction = [1.0, 0.0, 0.0]
file = "../records/quake.csv"
quantity = "acceleration"
[output]
checkpoint = 0.0
"""
)


def folder_of(place):
    """A scenario with a CAD scene and its buffer, a mesh in a subfolder, a record in a sibling folder, a load."""
    here = place / "work"
    (here / "meshes").mkdir(parents=True)
    (place / "records").mkdir()
    cad_files.gltf(here / "scene.gltf", BOXES)
    beside_buffer(here / "scene.gltf")
    (here / "meshes" / "cap stone.ply").write_text(STONE)
    time = np.arange(0.0, 0.4, 0.01)
    quake, push = np.sin(20.0 * time), np.cos(9.0 * time)
    (place / "records" / "quake.csv").write_text(table("acceleration [m/s2]", time, quake))
    (here / "push.csv").write_text(table("factor [1]", time, push))
    (here / "shaken.toml").write_text(SCENE.replace("supports = []", ""))
    return here / "shaken.toml"


def beside_buffer(path):
    """Move the buffer of a scene into its own file, with a space in its name."""
    import base64

    scene = json.loads(path.read_text())
    (buffer,) = scene["buffers"]
    (path.parent / "the data.bin").write_bytes(base64.b64decode(buffer["uri"].partition(",")[2]))
    buffer["uri"] = "the%20data.bin"
    path.write_text(json.dumps(scene))


def table(title, time, values):
    rows = "\n".join(f"{t:.9g},{value:.9g}" for t, value in zip(time, values, strict=True))
    return f"time [s],{title}\n{rows}\n"


def fixed(path):
    """The scenario with the ground solid of the CAD scene as a support."""
    text = path.read_text()
    path.write_text('supports = ["cad.ground"]\n' + text)
    return path


def same_numbers(first, second):
    one, other = content(first), content(second)
    for found in (one, other):
        found["settings"].pop("scenario")
        found["results"].pop("scenario")
    assert set(one) == set(other)
    for name, value in one.items():
        numbers = isinstance(value, np.ndarray) and value.dtype.kind != "O"
        same = value.tobytes() == other[name].tobytes() if numbers else np.array_equal(value, other[name])
        assert same, name


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """A history in its own folder; the input files of its scenario are gone."""
    place = tmp_path_factory.mktemp("origin")
    path = fixed(folder_of(place))
    alone = tmp_path_factory.mktemp("alone") / "run.h5"
    dembrick.simulate(path, alone, progress=False)
    shutil.rmtree(place)
    return alone


def test_a_history_runs_again_where_nothing_else_is(moved, folder, capsys):
    assert main(["run", str(moved), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)["history"]
    same_numbers(moved, again)
    assert main(["run", again, "--json", "--out", "third.h5"]) == 0  # the second history holds the files too
    same_numbers(moved, "third.h5")


def test_python_and_the_other_commands_take_a_history_as_a_scenario(moved, folder, capsys):
    scenario = dembrick.load(moved)
    assert [block.name for block in scenario.all_blocks] == ["cap", "cad.ground", "cad.post"]
    dembrick.simulate(moved, "again.h5", progress=False)
    same_numbers(moved, "again.h5")
    with dembrick.read_history(moved) as history:
        assert {one.name: one.place for one in history.inputs if one.place != "the data.bin"} == {
            "push.csv": "push.csv",
            "../records/quake.csv": "quake.csv",
            "meshes/cap stone.ply": "cap_stone.ply",
            "scene.gltf": "scene.gltf",
        }
    assert main(["check", str(moved)]) == 0
    changed = dataclasses.replace(scenario, title="another")
    assert dembrick.simulate(changed, progress=False).displacement[-1].any()


def test_a_record_that_set_names_is_looked_for_beside_the_history(moved, folder, capsys):
    here = folder / "run.h5"
    shutil.copy(moved, here)
    assert main(["run", "run.h5", "--set", "control.file=still.csv", "--out", "still.h5"]) == 2
    assert "still.csv: there is no such file" in capsys.readouterr().err
    (folder / "still.csv").write_text(table("acceleration [m/s2]", np.arange(0.0, 0.4, 0.01), np.zeros(40)))
    assert main(["run", "run.h5", "--set", "control.file=still.csv", "--out", "still.h5"]) == 0
    with dembrick.read_history(here) as shaken, dembrick.read_history(folder / "still.h5") as still:
        assert not np.array_equal(shaken.displacement, still.displacement)


def test_a_stopped_run_goes_on_with_the_record_that_it_began_with(moved, tmp_path):
    path = fixed(folder_of(tmp_path))
    stopped = tmp_path / "stopped.h5"
    stop_at_look(dembrick.load(path), stopped, 3)
    shutil.rmtree(tmp_path / "records")
    (tmp_path / "work" / "push.csv").write_text("gone wrong")
    dembrick.restart(stopped, progress=False)
    same_numbers(moved, stopped)


@pytest.mark.parametrize("place", ["../../evil.csv", "/evil.csv", "a/../../b", "..", "", "c:\\x"])
def test_a_file_that_leads_out_of_its_folder_is_refused(moved, tmp_path, place):
    path = tmp_path / "strange.h5"
    shutil.copy(moved, path)
    with h5py.File(path, "r+") as file:
        file["files/place"][0] = place
    with pytest.raises(HistoryError, match=r"strange\.h5: the files of its scenario cannot be read"):
        dembrick.load(path)


def test_a_history_without_files_has_none(tmp_path):
    path = tmp_path / "set4a.h5"
    dembrick.simulate("set4a", path, progress=False)
    with dembrick.read_history(path) as history, h5py.File(path) as file:
        assert history.inputs == [] and "files" not in file
