"""Untrusted files and folders: nothing hangs, no code runs, no control sequence reaches the terminal."""

import io
import json
import os
import sys

import h5py
import numpy as np
import pytest

from dembrick import _kernel_cache, history
from dembrick.assembly.build import assemble
from dembrick.cli import main
from dembrick.cli.console import Console, printable
from dembrick.errors import HistoryError, ScenarioError
from dembrick.geometry.mesh_file import convex_solids
from dembrick.runs import study as studies
from dembrick.runs.simulate import simulate
from dembrick.runs.study.draws import distribution
from dembrick.scenario import toml
from dembrick.views import plot
from helpers import history_cases as cases
from helpers.places import SCENARIOS

# --- the kernel cache -------------------------------------------------------------------------------------------------


def test_a_cache_folder_is_made_for_its_owner_alone(tmp_path):
    folder = tmp_path / "a" / "b"
    assert _kernel_cache.is_own(folder)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert _kernel_cache.is_own(folder)  # and accepted again


def test_a_cache_folder_that_others_can_write_or_own_is_not_taken(tmp_path, monkeypatch):
    """numba unpickles files in that folder: code of whoever wrote them would run."""
    planted = tmp_path / "planted"
    planted.mkdir()
    planted.chmod(0o777)
    assert not _kernel_cache.is_own(planted)
    planted.chmod(0o770)
    assert not _kernel_cache.is_own(planted)
    planted.chmod(0o755)
    assert _kernel_cache.is_own(planted)
    link = tmp_path / "link"
    link.symlink_to(planted, target_is_directory=True)
    assert not _kernel_cache.is_own(link)
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert not _kernel_cache.is_own(planted)


def test_the_next_folder_is_taken_where_one_is_not_safe(tmp_path, monkeypatch):
    """A base whose folders others may rename, unless it is sticky as /tmp is, and a planted folder in it."""
    base, home = tmp_path / "base", tmp_path / "home"
    for folder in (base, home):
        folder.mkdir()
    monkeypatch.setenv("DEMBRICK_CACHE_DIR", str(base))
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    assert _kernel_cache.cache_folder().parent == base
    base.chmod(0o777)
    assert _kernel_cache.cache_folder().parent == home / "dembrick"
    base.chmod(0o1777)
    assert _kernel_cache.cache_folder().parent == base
    _kernel_cache.cache_folder().chmod(0o777)
    assert _kernel_cache.cache_folder().parent == home / "dembrick"


# --- the terminal -----------------------------------------------------------------------------------------------------

EVIL = "\x1b]0;title\x07\x1b[31mred\x9b2J\u202egnp"


def test_control_characters_are_written_out():
    assert printable(EVIL) == r"\x1b]0;title\x07\x1b[31mred\x9b2J\u202egnp"
    assert printable("µm\t1\nnext") == "µm\t1\nnext"
    assert printable("a\ud800\r") == r"a\ud800\r"


@pytest.mark.parametrize("method", ["say", "remark", "error", "result"])
def test_nothing_of_them_reaches_a_terminal(method, capsys):
    console = Console(json=False, quiet=False, verbose=False)
    getattr(console, method)(*([{}, EVIL] if method == "result" else [EVIL]))
    out, err = capsys.readouterr()
    assert not set(out + err) & set("\x1b\x07\x9b\u202e") and r"\x1b]0;title" in out + err


@pytest.mark.parametrize("verb", ["info", "joints"])
def test_names_in_a_history_are_shown_without_their_escape_sequences(verb, tmp_path, capsys):
    path = tmp_path / "run.h5"
    cases.finished(path)
    with h5py.File(path, "r+") as file:
        names = file["geometry/blocks/name"]
        names[...] = [f"{EVIL}{i}" for i in range(len(names))]
        file.attrs["status"] = f"{EVIL}"
    main([verb, str(path)])
    out, err = capsys.readouterr()
    assert not set(out + err) & set("\x1b\x07\x9b\u202e")


# --- histories --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["formulation", "pressure"])
def test_words_of_joints_that_are_unknown(name, tmp_path):
    path = tmp_path / "run.h5"
    cases.finished(path)
    with h5py.File(path, "r+") as file:
        words = file[f"geometry/joints/{name}"]
        words[...] = ["convx"] * len(words)
    with (
        history.read(path) as found,
        pytest.raises(HistoryError, match=f"joints/{name} holds 'convx', which is not one"),
    ):
        _ = found.joints


# --- meshes -----------------------------------------------------------------------------------------------------------

PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
PLY += "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
MESHES = {
    "header without end": ("f.ply", "ply\nformat ascii 1.0\nelement vertex 8\n", "cannot be read as ply"),
    "cut in the header": ("f.ply", PLY[:60], "cannot be read as ply"),
    "cut in the data": ("f.ply", PLY, "cannot be read as ply"),
    "face of no corners": ("f.ply", PLY + "0\n", "fewer than three corners|cannot be read"),
    "ANSYS, cut": ("f.msh", "(0 header)\n(2 3)\n(10 (0 1 8 1 3))\n(10 (1 1 8 1 3)(\n0 0 0\n", "cannot be read as msh"),
    "gmsh, cut": ("f.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n1 0 0 0\n", "cannot be read as msh"),
    "gmsh, remarks": ("f.msh", "$Comments\nwithout end\n", "cannot be read as msh"),
}


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_file_that_is_cut_does_not_hang(name, tmp_path):
    file, text, said = MESHES[name]
    (tmp_path / file).write_text(text)
    with pytest.raises(ScenarioError, match=said):
        convex_solids(str(tmp_path / file))


def test_a_mesh_file_is_an_ordinary_file_of_bounded_size(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(ScenarioError, match="not an ordinary file"):
        convex_solids(str(tmp_path / "pipe.stl"))
    with open(tmp_path / "scan.stl", "wb") as file:
        file.truncate((16 << 20) + 1)
    with pytest.raises(ScenarioError, match="longer than 16 MiB"):
        convex_solids(str(tmp_path / "scan.stl"))


# --- studies ----------------------------------------------------------------------------------------------------------


def test_bounds_of_hundreds_of_digits():
    table = {"distribution": "uniform", "lower": int("1" * 500), "upper": 1.0}
    with pytest.raises(ScenarioError, match="draws.of.key: lower = .* must be a finite number"):
        distribution("key", table)


STUDY = """base = "base.toml"
[grid]
"joint.friction" = [0.5, 0.6, 0.7]
"""


@pytest.mark.parametrize(
    "damage",
    [
        lambda line: line[:20] + b"\xff" + line[21:],
        lambda line: b'{"case": 1}\n',
        lambda line: b'{"case": "1", "status": "yield", "V": 1.0}\n',
        lambda line: b'{"case": 1, "status": 3, "V": 1.0}\n',
        lambda line: b'{"case": 1, "status": "yield"}\n',
        lambda line: b'{"case": 1, "status": "yield", "V": "many"}\n',
        lambda line: b'{"case": 1, "status": "yield", "V": 1.0, "error": "\\ud800"}\n',
        lambda line: b'{"case": 1, "status": "yield", "V": 1.0, "error": "\\u0000"}\n',
        lambda line: b'{"case": 99, "status": "yield", "V": 1.0}\n',
        lambda line: b"[" * 100_000 + b"\n",
    ],
)
def test_a_damaged_row_of_a_study_is_run_again(damage, tmp_path):
    (tmp_path / "base.toml").write_text((SCENARIOS / "set4a.toml").read_text())
    (tmp_path / "study.toml").write_text(STUDY)
    folder = tmp_path / "out"
    studies.sweep(tmp_path / "study.toml", folder)
    before = [json.loads(line) for line in (folder / "rows_1_of_1.jsonl").read_text().splitlines()]
    lines = (folder / "rows_1_of_1.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "rows_1_of_1.jsonl").write_bytes(b"".join([*lines[:2], damage(lines[2]), *lines[3:]]))
    again = studies.sweep(tmp_path / "study.toml", folder)
    assert (again.ran, again.finished, again.failed) == (1, 3, 0)
    with h5py.File(folder / "table.h5") as table:
        np.testing.assert_array_equal(table["V"][:], [row["V"] for row in before[1:]])


def test_a_study_whose_base_is_a_pipe_does_not_wait(tmp_path):
    os.mkfifo(tmp_path / "base.toml")
    (tmp_path / "study.toml").write_text(STUDY)
    with pytest.raises(ScenarioError, match="not an ordinary file"):
        studies.load(tmp_path / "study.toml")


def test_letters_that_an_output_does_not_know_are_no_error(monkeypatch, tmp_path):
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(raw, encoding="ascii"))
    assert main(["info", str(tmp_path / "µ.h5")]) == 2
    sys.stderr.flush()
    assert rb"\xb5.h5: there is no such file" in raw.getvalue()


@pytest.mark.parametrize("edge", [1e-20, 1e-160, 1e-200, 1e-310])
def test_an_edge_of_next_to_nothing(edge):
    text = (SCENARIOS / "set4a.toml").read_text()
    assert text.count("[0.3, 0.2, 0.1]") == 2
    with pytest.raises(ScenarioError, match=f"block 'lower': it is {edge:.3g} m thick; it must be at least 1e-09 m"):
        assemble(toml.loads(text.replace("[0.3, 0.2, 0.1]", f"[0.3, 0.2, {edge!r}]")))


def test_a_name_that_looks_like_a_formula_is_drawn(tmp_path):
    text = (SCENARIOS / "set4a.toml").read_text()
    simulate(toml.loads(text.replace('title   = "', 'title   = "$\\\\frac{$ ')), tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as found:
        assert found.title.startswith("$\\frac{$")
        plot.save(plot.layout([found]), tmp_path / "layout.png")
