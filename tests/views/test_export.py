"""Exports: file names, tables, layers, refusals, and files left by an interrupted export."""

import csv
import os

import numpy as np
import pytest

from dembrick import history
from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.cli import main
from dembrick.errors import HistoryError, MissingDependency, OutputError, ScenarioError, WriteError
from dembrick.views import export
from dembrick.views.export import pvd, text, vtkhdf
from helpers import history_cases as cases
from helpers.exported import N_FRAME, THREE, make
from helpers.places import tool_module


@pytest.mark.parametrize("ending", ["vtkhdf", "csv"])
def test_files_are_named_from_where_they_were_asked_for(tmp_path, monkeypatch, ending):
    """Names follow the path that was given, and relative paths stay relative; links give the name of their target."""
    found = make(tmp_path)
    (tmp_path / "here" / "sub").mkdir(parents=True)
    (tmp_path / "here" / f"link.{ending}").symlink_to(tmp_path / f"there.{ending}")
    monkeypatch.chdir(tmp_path / "here")
    assert export.export(found, f"out.{ending}")[0] == f"out.{ending}"
    assert export.export(found, os.path.join("sub", f"out.{ending}"))[0] == os.path.join("sub", f"out.{ending}")
    assert export.export(found, tmp_path / f"out.{ending}")[0] == str(tmp_path / f"out.{ending}")
    assert export.export(found, f"link.{ending}")[0] == os.path.realpath(tmp_path / f"there.{ending}")


def test_an_export_says_that_new_contacts_were_not_recorded(tmp_path):
    remarks = []
    export.to_vtkhdf(cases.without_new_contacts(tmp_path / "run.h5"), tmp_path / "out.vtkhdf", remarks.append)
    assert sum("new contacts" in remark and '"contacts" in output.channels' in remark for remark in remarks) == 1


def test_csv_reads_back_exactly(tmp_path):
    export.export(make(tmp_path, n_row=20), tmp_path / "out.csv")
    with open(tmp_path / "out.csv", newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    table = dict(zip(head, np.array(rows, float).T, strict=True))
    expected = cases.record(0, 20, 2, 0)
    assert len(rows) == 20
    np.testing.assert_array_equal(table["time [s]"], expected["time"])
    np.testing.assert_array_equal(table["load [N]"], expected["load"])
    np.testing.assert_array_equal(table["displacement [m]"], expected["displacement"])
    np.testing.assert_array_equal(table["unbalanced [1]"], expected["unbalanced"])
    np.testing.assert_array_equal(table["M_T upper/wedge, small [N m]"], expected["joint"][:, 1, 3])
    np.testing.assert_array_equal(table["slip lower/upper [m]"], expected["joint"][:, 0, 6])
    np.testing.assert_array_equal(table["friction energy [J]"], expected["energy"]["friction"])
    assert all(title.endswith("]") for title in head)


def test_csv_names_the_jacks_and_is_read_in_pieces(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "_ROWS", 7)
    found = make(tmp_path, cases.assembly(), n_row=20)
    export.to_csv(found, tmp_path / "out.csv")
    lines = (tmp_path / "out.csv").read_text().splitlines()
    for title, values in (
        ("force of jack [N]", found.series("actuator_force")),
        ("displacement of jack [m]", found.series("actuator_displacement")),
    ):
        column = lines[0].split(",").index(title)
        assert [float(line.split(",")[column]) for line in lines[1:]] == values[:, 0].tolist()
    assert (found.series("actuator_force") != found.series("actuator_displacement"))[1:].all()


def test_two_joints_of_the_same_blocks_get_numbers(tmp_path):
    assembly = cases.assembly()
    assembly.joints = JointTable.of([*assembly.joints] * 2)
    assembly.contact_points = PointTable.of([*assembly.contact_points] * 2)
    export.to_csv(make(tmp_path, assembly), tmp_path / "out.csv")
    head = (tmp_path / "out.csv").read_text().splitlines()[0]
    assert "N lower/upper #0 [N]" in head and "N lower/upper #1 [N]" in head


@pytest.mark.parametrize("name", ["out.xyz", "out", "out.h5"])
def test_an_unknown_ending_names_the_known_ones(tmp_path, name):
    with pytest.raises(OutputError, match=r"\.vtkhdf, \.pvd, \.csv"):
        export.export(make(tmp_path), tmp_path / name)


@pytest.mark.parametrize("ending", ["vtkhdf", "pvd", "csv"])
def test_a_path_that_cannot_be_used(tmp_path, ending):
    found = make(tmp_path)
    with pytest.raises(OutputError, match="does not exist"):
        export.export(found, tmp_path / "no" / "no" / f"x.{ending}")
    (tmp_path / f"folder.{ending}").mkdir()
    with pytest.raises(OutputError, match="folder"):
        export.export(found, tmp_path / f"folder.{ending}")


def test_no_frames_no_motion(tmp_path):
    found = make(tmp_path, n_frame=0)
    for name in ("x.vtkhdf", "x.pvd"):
        with pytest.raises(HistoryError, match="no frames"):
            export.export(found, tmp_path / name)
    export.export(found, tmp_path / "x.csv")


def test_an_export_that_breaks_off_leaves_nothing(tmp_path, monkeypatch):
    found = make(tmp_path)
    before = sorted(os.listdir(tmp_path))

    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(vtkhdf, "_put", broken)
    with pytest.raises(WriteError, match="No space left"):
        export.export(found, tmp_path / "x.vtkhdf")
    assert sorted(os.listdir(tmp_path)) == before


def test_a_series_that_breaks_off_leaves_an_earlier_one(tmp_path, monkeypatch):
    """An export that fails half way removes its list, so that it cannot refer to frames of another export."""
    found, write, calls = make(tmp_path, channels=("frames",)), pytest.importorskip("meshio").write, []
    export.export(found, tmp_path / "x.pvd")
    before = sorted(os.listdir(tmp_path))

    def broken(*args, **options):
        calls.append(args)
        if len(calls) > 3:
            raise OSError(28, "No space left on device")
        write(*args, **options)

    monkeypatch.setattr("meshio.write", broken)
    with pytest.raises(WriteError, match="No space left"):
        export.export(found, tmp_path / "x.pvd")
    assert sorted(os.listdir(tmp_path)) == before
    layers = [f"x{layer}_{k:05d}.vtu" for layer in ("", "_joints") for k in range(N_FRAME)]
    assert sorted(os.listdir(tmp_path / "x_frames")) == sorted(layers)


def test_a_list_that_breaks_off_leaves_an_earlier_series(tmp_path, monkeypatch):
    """If the disk is full when the last list is written, all files of the earlier series are unchanged."""
    found = make(tmp_path, channels=("frames",))
    export.export(found, tmp_path / "x.pvd")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()}
    write = pvd._list

    def broken(target, files, times):
        if "joints" in target:
            raise OSError(28, "No space left on device")
        write(target, files, times)

    monkeypatch.setattr(pvd, "_list", broken)
    with pytest.raises(WriteError, match="No space left"):
        export.export(found, tmp_path / "x.pvd")
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()} == before


def test_the_history_is_not_overwritten(tmp_path):
    make(tmp_path).close()
    os.rename(tmp_path / "run.h5", tmp_path / "run.csv")
    with pytest.raises(OutputError, match="history itself"):
        export.export(history.read(tmp_path / "run.csv"), tmp_path / "run.csv")


def test_meshio_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "meshio", None)
    with pytest.raises(MissingDependency, match="pip install"):
        export.export(make(tmp_path), tmp_path / "x.pvd")


@pytest.mark.parametrize("only, names", [(["joints"], THREE[1:2]), (["blocks", "contacts"], THREE[::2])])
def test_only_some_layers(tmp_path, capsys, only, names):
    found = make(tmp_path)
    code = main(["export", found.path, "--to", str(tmp_path / "out.vtkhdf"), "--layers", *only])
    assert code == 0 and capsys.readouterr().out.replace("written", "").split() == [
        str(tmp_path / name) for name in names
    ]
    assert sorted(os.listdir(tmp_path)) == sorted([*names, "run.h5"])
    with pytest.raises(ScenarioError, match="blocks, joints, contacts"):
        export.export(found, tmp_path / "x.vtkhdf", only=["block"])


def test_the_benchmark_of_pictures_makes_up_histories_that_are_exported(tmp_path):
    """The smallest walls of every kind that the benchmark measures can be exported."""
    bench = tool_module("bench_pictures")
    assert len(bench.WALLS) == 3
    for name, (formulation, channels) in bench.WALLS.items():
        path, target = tmp_path / f"{name}.h5", tmp_path / f"{name}.vtkhdf"
        bench.made_up(path, 4, bench.CHUNK + 2, formulation, channels)
        with history.read(path) as found:
            assert found.n_frames == bench.CHUNK + 2 and found.in_real_time
        assert main(["export", str(path), "--to", str(target), "--quiet"]) == 0
        assert target.exists()
