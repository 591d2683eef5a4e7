"""Progress of long commands, and their interruption."""

import signal
import subprocess
import sys
import time

import numba
import pytest

from dembrick.cli import main, progress
from dembrick.cli.console import printable
from dembrick.cli.progress import COMPILING, Meter, duration, telling_of_compilation
from dembrick.runs.notebook import as_html, notebook_bar
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.simulation import session
from dembrick.simulation.session import Progress
from helpers.places import SCENARIOS
from helpers.scenario_text import block, header


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr(progress.time, "monotonic", found)
    return found


def test_lines_come_at_growing_intervals_where_there_is_no_terminal(clock, capsys):
    """Intervals of 10, 20, 40 ... up to 600 s; each line has steps, time, pace and time left."""
    meter = Meter(printable, quiet=False)
    came = []
    for second in range(4000):
        clock.now = float(second)
        meter.run(Progress("step", 100 * second, 400_000, 0.01 * second))
        if line := capsys.readouterr().err:
            came.append((second, line))
    assert [second for second, _ in came] == [10, 30, 70, 150, 310, 630, 1230, 1830, 2430, 3030, 3630]
    assert came[0][1] == "step 1000 of 400000, t = 0.1 s, 100 per second, 1.1 h left\n"


def test_quiet_shows_nothing(clock, capsys):
    meter = Meter(printable, quiet=True)
    for second in range(100):
        clock.now = float(second)
        meter.run(Progress("step", second))
        meter.count(second, 100, "frames")
    meter.stage(COMPILING)
    assert capsys.readouterr().err == ""


def test_a_bar_on_a_terminal(clock, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "200")
    meter = Meter(printable, quiet=False)
    for second in range(6):
        clock.now = float(second)
        meter.run(Progress("step", 100 * second, 1000, 0.01 * second, at_most=second == 5))
    shown = capsys.readouterr().err
    assert "[#########...............] step 400 of 1000, t = 0.04 s, 100 per second, 6 s left" in shown
    assert "[############............] step 500 of at most 1000, t = 0.05 s, 100 per second, at most 5 s left" in shown
    meter.run(Progress("equilibrium", 7))
    clock.now = 6.0
    meter.run(Progress("equilibrium", 9))
    assert "\r\033[Kequilibrium 9, 2 per second" in capsys.readouterr().err
    meter.clear()
    assert capsys.readouterr().err == "\r\033[K"


def test_durations():
    assert [duration(s) for s in (3.2, 90.0, 5400.0, 2e5)] == ["3 s", "1.5 min", "1.5 h", "2.3 days"]


@numba.njit
def _twice(x):
    return 2 * x


def test_compiling_is_told_once_and_only_where_it_happens():
    told = []
    with telling_of_compilation(told.append):
        assert _twice(2) == 4 and _twice(2.0) == 4.0
    with telling_of_compilation(told.append):
        assert _twice(3) == 6
    assert told == [COMPILING]


SHAKEN = """
[control]
kind = "dynamic"
duration = 0.05
"""


def dropped():
    text = (SCENARIOS / "set4a.toml").read_text()
    head = text.partition("[[actuators]]")[0].replace("[0.0, 0.0, 0.05]", "[0.0, 0.0, 0.0501]")
    return head.replace('"convex"', '"concave"').replace("1.0e10", "1.0e8").replace("4.0e9", "4.0e7") + SHAKEN


@pytest.mark.parametrize(
    ("make", "stage"),
    [
        (dropped, "step"),
        (lambda: (SCENARIOS / "set4a_curve.toml").read_text(), "step"),
        (lambda: (SCENARIOS / "ferris_tinloi_1.toml").read_text(), "equilibrium"),
    ],
)
def test_a_callback_hears_how_far_a_run_is(make, stage, monkeypatch):
    monkeypatch.setattr(session, "TOLD_EVERY", 0.0)
    heard = []
    simulate(toml.loads(make()), progress=heard.append)
    assert {one.stage for one in heard} <= {stage, session.DEAD_LOADS}
    done = [one.done for one in heard if one.stage == stage]
    assert done == sorted(done) and done[-1] > 0
    if stage == "step":
        assert all(one.done <= one.total and one.time >= 0.0 for one in heard if one.stage == stage)


def test_a_settlement_tells_how_many_equilibria_it_needs(monkeypatch):
    """A block that its support lowers without collapse: all that were announced are needed, and no more."""
    monkeypatch.setattr(session, "TOLD_EVERY", 0.0)
    text = header("convex", 0.5, 1e10) + block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true")
    text += block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1))
    heard = []
    control = '[control]\nkind = "settlement"\nsupports = ["floor"]\ndisplacement = [0.0, 0.0, -1e-3]\n'
    found = simulate(toml.loads(text + control), progress=heard.append)
    path = [one for one in heard if one.stage == "equilibrium"]
    assert {one.total for one in path} == {len(found.run.path)} == {path[-1].done + 1}


def test_a_bar_in_a_notebook():
    assert notebook_bar() is None  # this is no notebook
    html = as_html(Progress("step", 5, 20, 0.25, at_most=True))
    assert html == '<progress value="5" max="20"></progress> step 5 of at most 20, t = 0.25 s'
    assert "<script>" not in as_html(Progress("<script>", 1))


def test_a_study_that_is_stopped_says_how_to_go_on(tmp_path):
    """Its workers stop, finished rows are kept, and the message says how many cases are done."""
    (tmp_path / "base.toml").write_text(dropped())
    study = 'base = "base.toml"\n[grid]\n"control.duration" = [0.01, 1000.0, 1001.0, 1002.0]\n'
    (tmp_path / "study.toml").write_text(study)
    command = [sys.executable, "-m", "dembrick", "sweep", "study.toml", "--jobs", "2", "--out", "out"]
    run = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    rows = tmp_path / "out" / "rows_1_of_1.jsonl"
    while not rows.exists() or rows.read_text().count("\n") < 2:  # until the first case is done
        assert run.poll() is None
        time.sleep(0.05)
    time.sleep(0.3)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=120)
    assert run.returncode == 130
    assert "interrupted: 1 of 4 cases are recorded in out; repeat the command to continue" in said


def test_output_that_nobody_reads_is_no_error(tmp_path):
    for words in (["--help"], ["check", str(SCENARIOS / "set4a.toml")]):
        run = subprocess.Popen(
            [sys.executable, "-m", "dembrick", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        run.stdout.close()
        assert run.stderr.read() == b"" and run.wait() == 0


def test_no_progress_on_standard_output(capsys):
    assert main(["check", str(SCENARIOS / "set4a.toml"), "--json"]) == 0
    assert capsys.readouterr().out.startswith("{")
