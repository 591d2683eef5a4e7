"""The command line: exit codes, one JSON object on standard output, places of output files, no tracebacks."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

import dembrick
from dembrick import history
from dembrick.assembly.actuators import KINDS
from dembrick.cli import check, main
from dembrick.runs import lab
from dembrick.scenario import shipped
from dembrick.simulation.interrupts import Interrupted

SET_4A = str((shipped.folder() / "set4a.toml").resolve())
ROW_KEYS = [
    "set",
    "formulation",
    "load_height",
    "V",
    "V_lower",
    "V_upper",
    "bracket",
    "V_peak",
    "theory",
    "error_vs_theory",
    "printed",
    "experiment",
    "difference_vs_experiment_percent",
    "loop",
    "history",
]
RUN_KEYS = [
    "scenario",
    "title",
    "formulation",
    "status",
    "yield_point",
    "theory",
    "steps",
    "time_step",
    "critical_time_step",
    "simulated_time",
    "wall",
    "history",
]


pytestmark = pytest.mark.usefixtures("folder")  # every test runs in an empty folder


@pytest.fixture
def call(capsys):
    """Run the command line; return exit code, standard output and standard error, which never has a traceback."""

    def run(*arguments: str):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # argparse
            code = stop.code
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return code, out, err

    return run


def test_run_json(call, folder):
    code, out, err = call("run", SET_4A, "--json")
    data = json.loads(out)
    assert (code, err) == (0, "")
    assert set(RUN_KEYS) <= set(data)
    assert data["yield_point"]["V"] == pytest.approx(216.054938, rel=1e-3)
    assert data["history"] == os.path.join("results", "set4a.h5")
    assert history.read(folder / data["history"]).status == data["status"] == "yield"
    assert call("run", SET_4A, "--quiet")[0] == 0  # it replaces its own earlier output


def test_verbose_says_where_the_time_went(call, folder):
    code, _, said = call("run", SET_4A, "-v")
    assert code == 0 and re.search(r"^loop: [\d.e-]+ s$", said, re.MULTILINE)
    assert "start up" not in call("run", SET_4A)[2]


def test_explicit_out_is_not_replaced_without_force(call, folder):
    assert call("run", SET_4A, "--out", "a.h5")[0] == 0
    before = (folder / "a.h5").read_bytes()
    code, out, err = call("run", SET_4A, "--out", "a.h5")
    assert (code, out) == (2, "")
    assert "a.h5" in err and "force" in err
    assert (folder / "a.h5").read_bytes() == before
    assert call("run", SET_4A, "--out", "a.h5", "--force")[0] == 0
    assert not (folder / "results").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", SET_4A, "--out", "missing/too/a.h5"], "missing"),
        (["run", SET_4A, "--out", "file/a.h5"], "file/a.h5"),
        (["run", SET_4A, "--set", "joint.frictoin=0.5"], "did you mean 'friction'"),
        (["run", SET_4A, "--set", "joint.friction=-1"], "friction"),
        (["run", SET_4A, "--tolerance", "0"], "tolerance"),
        (["run", "nowhere.toml"], "nowhere.toml"),
        (["run", "file"], "file"),
        (["run"], "scenario"),
        (["rnu", SET_4A], "rnu"),
        (["run", SET_4A, "--jsn"], "--jsn"),
        (["check", "."], "folder"),
        (["lab", "--sets", "9z", "--no-figures"], "9z"),
        (["lab", "--formulation", "convx", "--no-figures"], "convx"),
        (["lab", "--out", "file", "--no-figures"], "file"),
        (["info", "nowhere.h5"], "nowhere.h5"),
        (["info", "file"], "file"),
        (["yield", "other.h5"], "other.h5"),
        (["export", "other.h5", "--to", "a.csv"], "other.h5"),
    ],
)
def test_mistakes_exit_2(call, folder, arguments, said):
    (folder / "file").write_text("not a history\n[")
    with h5py.File(folder / "other.h5", "w") as file:
        file["numbers"] = [1.0, 2.0]
    code, out, err = call(*arguments)
    assert (code, out) == (2, "")
    assert said in err
    assert not list(folder.rglob("a.*")) and not (folder / "missing").exists()


def test_not_converged_keeps_the_history(call, folder, monkeypatch):
    monkeypatch.setattr("dembrick.simulation.statics.limit_load.is_lone", lambda _: False)
    monkeypatch.setattr("dembrick.simulation.statics.paths.path_following.MOST_EQUILIBRIA", 18)
    fine = ("--tolerance", "1e-8", "--set", 'joint.formulation="concave"')
    code, out, err = call("run", SET_4A, "--json", *fine, "--out", "a.h5")
    data = json.loads(out)
    assert (code, data["status"]) == (1, "failed")
    point = data["yield_point"]
    assert point["V_lower"] <= 254.569823 * (1 + 1e-8) and point["V_upper"] >= 254.569823 * (1 - 1e-8)
    assert "error:" in err and data["error"] in err
    kept = history.read(folder / data["history"])
    assert kept.status == "failed" and len(kept.time) == 19
    assert call("run", SET_4A, *fine)[1] == ""


def test_disagreement_with_theory_exits_3(call, monkeypatch):
    from dembrick.runs import theory_check

    true = theory_check.theory_of
    off = lambda *a, **more: dataclasses.replace(true(*a, **more), V=1.01 * true(*a, **more).V)  # noqa: E731
    monkeypatch.setattr(theory_check, "theory_of", off)
    code, out, err = call("run", SET_4A, "--json")
    assert (code, json.loads(out)["status"]) == (3, "yield")
    assert "disagree" in err
    assert call("lab", "--json", "--no-figures", "--sets", "4a", "--formulation", "convex")[0] == 3


def test_lab_json_twice(call, folder):
    for _ in range(2):
        code, out, _ = call("lab", "--json", "--no-figures", "--sets", "4a", "--formulation", "convex", "concave")
        data = json.loads(out)
        assert code == 0
        assert {"rows", "rows_table_1", "wall"} <= set(data)
        rows = {(row["formulation"], row["load_height"]): row for row in data["rows"]}
        assert set(rows) == {(f, h) for f in ("convex", "concave") for h in (0.0, 0.05)}
        for row in rows.values():
            assert set(ROW_KEYS) <= set(row)
            assert row["difference_vs_experiment_percent"] == pytest.approx(100 * (row["V"] / 216.0 - 1))
            assert history.read(folder / row["history"]).status == "yield"
        assert rows["concave", 0.05]["V"] == pytest.approx(252.0031, rel=1e-3)
        assert len(data["rows_table_1"]) == 10
    assert (folder / "results" / "lab" / "yield_points.csv").exists()


def test_lab_text(call):
    code, out, err = call("lab", "--no-figures", "--sets", "2a", "--formulation", "convex", "--quiet")
    assert (code, err) == (0, "")
    assert "Table 3" in out and "Table 1" in out and "0.64" in out


def test_check_describes_an_assembly(call):
    scenarios = Path(SET_4A).parent
    found = json.loads(call("check", str(scenarios / "wall_tilt.toml"), "--json")[1])
    assert (found["blocks"], len(found["joints"]), found["contact_points"]) == (106, 285, 4 * 285)
    assert 0.0 < found["time_step"] < found["critical_time_step"] and found["expected_memory"] > 1e5
    code, out, _ = call("check", str(scenarios / "arch_tilt.toml"))
    assert code == 0 and "expected      about" in out and "s on one core" in out and "arch.16 - arch.17" in out


@pytest.mark.parametrize(
    "name, told",
    [
        ("arch", "body forces   load on arch.1, load on arch.2, "),
        ("wall_door", "body forces   load on wall.1.1, "),
        ("dam", "pressures     pressure on dam.1, "),
        ("set4a", "actuators     jack\n"),
        ("arch_spread", None),
    ],
)
def test_check_tells_the_kind_of_a_load(call, name, told):
    """Tilts and pushovers have no actuators: their driven loads are listed as body forces on the blocks."""
    _, out, _ = call("check", name)
    lines = [line for line in out.splitlines(True) if line[:14].strip() in ("actuators", "pressures", "body forces")]
    assert lines == [] if told is None else len(lines) == 1 and lines[0].startswith(told)
    found = json.loads(call("check", name, "--json")[1])
    assert sum(bool(found[key]) for key in check.LOADS) == len(lines) and tuple(check.LOADS.values()) == KINDS


def test_check_info_yield_export(call, folder):
    assert json.loads(call("check", SET_4A, "--json")[1])["free_blocks"] == 1
    assert not (folder / "results").exists()
    assert call("run", SET_4A, "--quiet")[0] == 0
    path = "results/set4a.h5"
    assert json.loads(call("info", path, "--json")[1])["status"] == "yield"
    assert "loop" in json.loads(call("info", path, "--profile", "--json")[1])["wall"]
    code, out, _ = call("yield", path, "--json", "--csv", "table.csv")
    assert code == 0 and json.loads(out)["rows"][0]["V"] == pytest.approx(216.054938, rel=1e-3)
    assert len((folder / "table.csv").read_text().splitlines()) == 2
    code, out, _ = call("export", path, "--to", "a.csv", "--json")
    assert code == 0 and all(Path(name).exists() for name in json.loads(out)["files"])


def test_warmup_runs_every_kind_of_loop(call, monkeypatch):
    from dembrick import _kernel_cache
    from dembrick.runs import simulate as simulate_module

    ran = []
    simulate = simulate_module.simulate
    monkeypatch.setattr(simulate_module, "simulate", lambda *given: ran.append(simulate(*given)))
    code, out, _ = call("warmup", "--jobs", "1", "--json")
    assert code == 0 and json.loads(out)["cache"] == str(_kernel_cache.CACHE_FOLDER)
    assert {one.scenario.control.kind for one in ran} == {"yield", "displacement", "pushover", "dynamic"}
    touching = [one.run.motion.contact_detection.touching for one in ran if one.scenario.control.kind == "dynamic"]
    assert [one is None for one in touching] == [True, False, True, False]


def test_warmup_compiles_in_as_many_processes_as_are_asked_for(call, monkeypatch):
    from dembrick.cli import warmup
    from dembrick.runs.study import executors

    ran, asked = [], []
    kinds = {kind: lambda formulation, kind=kind: ran.append((kind, formulation)) for kind in warmup.KINDS}
    monkeypatch.setattr(warmup, "KINDS", kinds)

    def here(function, chunks, jobs):
        asked.append(jobs)
        return executors.run_here(function, chunks)

    monkeypatch.setattr(executors, "run_local", here)
    code, out, _ = call("warmup", "--jobs", "3", "--json")
    assert code == 0 and json.loads(out)["jobs"] == 3 and asked == [3]
    assert len(set(ran)) == len(ran) == 2 * len(kinds)
    code, _, err = call("warmup", "--jobs", "0")
    assert code == 2 and "--jobs = 0 is out of range" in err


def test_module_is_the_command():
    def run(*command: str, **variables: str) -> subprocess.CompletedProcess:
        root = str(Path(dembrick.__file__).parent.parent)
        env = os.environ | {"PYTHONPATH": root} | variables
        return subprocess.run([sys.executable, *command], capture_output=True, text=True, env=env)

    script = "import sys; from dembrick.cli import main; sys.argv[0] = 'dembrick'; sys.exit(main())"
    for arguments in (["--version"], ["schema"], ["run", "nowhere.toml"]):
        module, command = run("-m", "dembrick", *arguments, NO_COLOR="1"), run("-c", script, *arguments)
        assert (module.returncode, module.stdout, module.stderr) == (command.returncode, command.stdout, command.stderr)
        assert "\033" not in module.stderr and "Traceback" not in module.stderr


def test_lab_tells_figures_and_what_is_for_paraview_apart(call, folder):
    code, out, _ = call("lab", "--json", "--quiet", "--sets", "4b", "--formulation", "convex", "--out", "lab")
    told = json.loads(out)
    assert code == 0 and {Path(name).suffix for name in told["figures"]} == {".png", ".pdf"}
    assert Path(told["exports"][0]) == Path("lab") / "turning_block.vtkhdf"
    assert {Path(name).suffix for name in told["exports"]} == {".vtkhdf"}
    assert all((folder / name).exists() for name in told["figures"] + told["exports"])


def test_an_interrupted_lab_prints_the_rows_it_has(capsys, tmp_path, monkeypatch):
    done, original = [], lab.simulate

    def interrupted(*given, **options):
        if len(done) == 3:
            raise Interrupted(signal.SIGINT, "interrupted after step 7")
        done.append(original(*given, **options))
        return done[-1]

    monkeypatch.setattr(lab, "simulate", interrupted)
    options = ["--formulation", "concave", "--no-figures", "--json", "--quiet", "--out", str(tmp_path)]
    assert main(["lab", *options]) == 130
    data = json.loads(capsys.readouterr().out)
    assert data["status"] == "interrupted"
    assert [(row["set"], row["load_height"]) for row in data["rows"]] == [("2a", 0.0), ("2a", 0.05), ("2b", 0.0)]
    assert data["rows_table_1"] == [] and data["wall"]["total"] > 0.0
