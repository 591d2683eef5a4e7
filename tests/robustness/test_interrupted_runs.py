"""Signals and kills: no result is lost, the exit code names the signal, and restart finishes the run."""

import ctypes
import json
import os
import pkgutil
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from dembrick.cli import main
from dembrick.errors import NotConvergedError
from dembrick.history import Checkpoint, Checkpoints, read
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from dembrick.simulation import interrupts
from dembrick.simulation.interrupts import Interrupted
from helpers.places import SCENARIOS
from helpers.restart_cases import SLOW, case, check_same, dembrick, rows_of, wait_for

LONG = """
[output]
channels = ["joints", "energy", "frames", "velocity", "contacts"]
rows = 2000
frames = 2000
checkpoint = {checkpoint}
"""


@pytest.fixture(scope="module")
def long_run(tmp_path_factory):
    """A scenario that takes some seconds, and the history of its uninterrupted run."""
    folder = tmp_path_factory.mktemp("long")
    text = (SCENARIOS / "set4a_curve.toml").read_text().replace('"convex"', '"concave"')
    text = text.replace("rate   = 1.0e-5", "rate   = 1.0e-6").replace("travel = 2.5e-5", "travel = 2.0e-4")
    (folder / "long.toml").write_text(text + LONG.format(checkpoint=0.02))
    simulate(folder / "long.toml", folder / "whole.h5")
    return folder


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_and_restart_finishes_it(tmp_path, long_run, capsys, signum):
    path = tmp_path / "run.h5"
    child = dembrick("run", str(long_run / "long.toml"), "--out", str(path), "--json", "--quiet", code=SLOW)
    wait_for(lambda: Checkpoints(path).existing(), child, "a checkpoint")
    child.send_signal(signum)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 128 + signum
    assert json.loads(out) == {"status": "interrupted", "history": str(path)}
    (line,) = err.splitlines()
    assert line.startswith("interrupted after step") and line.endswith(f"continue with: dembrick restart {path}")
    with read(path) as file:
        assert file.status == "interrupted" and 0 < file.n_row and file.n_frames == file.n_row
        assert file.settings["scenario"] == str(long_run / "long.toml")
    assert main(["restart", str(path), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == "completed" and "continuing from step" in err
    check_same(long_run / "whole.h5", path)
    assert os.listdir(tmp_path) == ["run.h5"]


def test_a_second_signal_kills_at_once(tmp_path, long_run, monkeypatch):
    """Whatever the run is waiting for after the first one; here a checkpoint that never finishes."""
    code = f"""
import signal, sys, time
from dembrick.runs import record_store
from dembrick.cli import main
record_store.RecordStore.keep = lambda *_: (print("waiting", flush=True), time.sleep(60))
sys.exit(main(["run", {str(long_run / "long.toml")!r}, "--out", {str(tmp_path / "run.h5")!r}]))
"""
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "waiting\n"
    child.send_signal(signal.SIGTERM)
    time.sleep(0.2)
    child.send_signal(signal.SIGTERM)
    child.communicate(timeout=20)
    assert child.returncode == -signal.SIGTERM  # 143 to a shell


@pytest.mark.parametrize("late", ["dembrick.runs.theory_check.theory_of", "dembrick.history.HistoryWriter.finish"])
def test_a_signal_that_finds_the_answer_there_leaves_it_whole(tmp_path, capsys, monkeypatch, late):
    """A signal during the comparison with theory, and one while the result is written."""
    (tmp_path / "set4a.toml").write_text(toml.dumps(case("set4a", "concave")))
    path, original = tmp_path / "run.h5", pkgutil.resolve_name(late)

    def signalled(*arguments):
        signal.raise_signal(signal.SIGTERM)
        return original(*arguments)

    monkeypatch.setattr(late, signalled)
    assert main(["run", str(tmp_path / "set4a.toml"), "--out", str(path), "--json"]) == 143
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == "yield"
    assert err.endswith("interrupted after the work was done; nothing was lost\n")
    with read(path) as file:
        assert file.status == "yield"


def test_a_signal_that_a_callback_swallows_is_not_lost(tmp_path, capsys, monkeypatch):
    """A compiler's callback then raises an error of its own; the user sees only the interrupt."""
    given = case("set4a", "concave")
    (tmp_path / "set4a.toml").write_text(toml.dumps(given))

    def compiling(*_):
        callback = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))
        callback()
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("dembrick.simulation.statics.limit_load.LoneSearch", compiling)
    path = tmp_path / "run.h5"
    assert main(["run", str(tmp_path / "set4a.toml"), "--out", str(path)]) == 143
    assert capsys.readouterr().err == f"interrupted; continue with: dembrick restart {path}\n"
    assert main(["info", str(path)]) == 0
    assert f"go on         dembrick restart {path}\n" in capsys.readouterr().out
    with read(path) as file:
        assert file.status == "interrupted"
    with pytest.raises(RuntimeError, match="a fault"), interrupts.handled():
        raise RuntimeError("a fault")


@pytest.mark.parametrize("error", [Interrupted(signal.SIGINT), NotConvergedError("no equilibrium")])
def test_a_run_is_complete_whatever_becomes_of_its_error_estimate(tmp_path, monkeypatch, error):
    given = toml.load(SCENARIOS / "oppenheim.toml")

    def estimate(*_, **__):
        raise error

    monkeypatch.setattr("dembrick.runs.simulate.histories", estimate)
    path = tmp_path / "run.h5"
    with pytest.raises(type(error), match=f"error.*; the run itself .* is complete in {path}"):
        simulate(given, path, refine=True)
    with read(path) as file:
        assert file.status == "collapse" and file.results["collapse"]["error_estimate"] is None


def test_killed_and_restarted_again_and_again(tmp_path, long_run):
    """Killed before the first row, then at a random moment of the time loop, and finally run to its end."""
    path, rng, numbers = tmp_path / "run.h5", random.Random(4), []
    for kill, rows in enumerate((0, rng.randrange(300, 1800))):
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


def test_a_run_killed_before_its_first_checkpoint_starts_again(tmp_path, capsys):
    given = case("set4a", "concave")
    whole = simulate(given, tmp_path / "whole.h5")
    (tmp_path / "set4a.toml").write_text(toml.dumps(given))
    code = f"""
import os
from dembrick.runs import record_store
from dembrick.cli import main
record_store.RecordStore.session = lambda *_: os.kill(os.getpid(), 9)
main(["run", {str(tmp_path / "set4a.toml")!r}, "--out", {str(tmp_path / "run.h5")!r}])
"""
    done = subprocess.run([sys.executable, "-c", code], timeout=120)
    assert done.returncode == -9
    with read(tmp_path / "run.h5") as file:
        assert (file.status, file.begun, file.n_row, file.title) == ("running", False, 0, given.title)
    assert main(["info", str(tmp_path / "run.h5")]) == 0
    assert "running" in capsys.readouterr().out
    result = restart(tmp_path / "run.h5", report=print)
    assert "from the beginning" in capsys.readouterr().out
    assert result.yield_point == whole.yield_point
    np.testing.assert_array_equal(result.rows["load"], whole.rows["load"])
