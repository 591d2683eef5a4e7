"""Streams that are full, closed or silent, and letters unknown to a locale: one sentence, never a traceback."""

import json
import os
import subprocess
import sys
import threading
import warnings

import pytest
from matplotlib.figure import Figure

from dembrick.cli import main
from dembrick.scenario import text_files
from dembrick.views.plot import style
from helpers.places import TESTS
from helpers.scenario_text import block, header

FULL = "/dev/full"  # refuses every byte
RUN = [sys.executable, "-m", "dembrick"]


def shell(command, folder, **environment):
    """Run a shell command line in which $DEMBRICK is the program."""
    given = os.environ | {"DEMBRICK": " ".join(RUN), "PYTHONPATH": str(TESTS.parent)} | environment
    return subprocess.run(["bash", "-c", command], cwd=folder, env=given, capture_output=True, timeout=200, check=False)


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    path = tmp_path_factory.mktemp("full") / "set4a.h5"
    assert main(["run", "set4a", "--out", str(path), "--quiet"]) == 0
    return path


@pytest.mark.parametrize("command", ["schema", "joints {}", "info {} --json", "--help", "--version"])
def test_a_full_device_is_said_in_a_sentence(history, command):
    done = shell(f"$DEMBRICK {command.format(history.name)} > {FULL}", history.parent)
    assert done.returncode == 1
    assert done.stderr == b"error: standard output could not be written (No space left on device)\n"


def test_remarks_that_cannot_be_written_cost_no_answer(history):
    done = shell(f"$DEMBRICK joints {history.name} --json 2> {FULL}", history.parent)
    assert done.returncode == 0 and json.loads(done.stdout)["joints"]
    done = shell(f"$DEMBRICK info none.h5 2> {FULL}", history.parent)
    assert done.returncode == 2


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&-"])
def test_closed_streams(history, closed, tmp_path):
    """The answer goes to the streams that are open; no file reuses a closed stream's number and receives its output."""
    done = shell(f"$DEMBRICK run set4a --out {tmp_path / 'a.h5'} --json {closed}", history.parent)
    assert done.returncode == 0 and b"Traceback" not in done.stderr
    if ">&- " not in f"{closed} " or closed == "2>&-":
        assert json.loads(done.stdout)["status"] == "yield"
    assert main(["info", str(tmp_path / "a.h5"), "--json"]) == 0


def test_a_locale_without_letters(history, tmp_path):
    (tmp_path / "Bögen.h5").write_bytes(history.read_bytes())
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = shell("$DEMBRICK render B*.h5 --to page.html", tmp_path, **plain)
    assert done.returncode == 0, done.stderr[-500:]
    assert "<title>" in (tmp_path / "page.html").read_text(encoding="utf-8")
    done = shell("$DEMBRICK info B*.h5", tmp_path, **plain)
    assert done.returncode == 0 and b"Traceback" not in done.stderr


@pytest.mark.parametrize("ending", [".png", ".svg", ".pdf"])
def test_an_escape_sequence_in_a_figure_does_not_reach_the_terminal(tmp_path, ending):
    """In a name or title of an untrusted history; matplotlib would print it in a warning about a missing glyph."""
    figure = Figure()
    figure.add_subplot(title="red \x1b[31m alert\x07", xlabel="fine\nlines").plot([0, 1], label="\x1b]0;a\x07")
    figure.axes[0].legend()
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        style.save(figure, tmp_path / f"a{ending}")
    told = [str(one.message) for one in found if issubclass(one.category, UserWarning)]  # not of unclosed files
    assert not told
    assert figure.axes[0].get_title() == r"red \x1b[31m alert\x07" and figure.axes[0].get_xlabel() == "fine\nlines"


@pytest.mark.parametrize("command", ["check", "run", "limit", "render --to a.png"])
def test_a_pipe_that_nobody_writes_to_is_not_waited_for(command, folder, monkeypatch, capsys):
    monkeypatch.setattr(text_files, "PATIENCE", 0.1)
    pipe = folder / "pipe.toml"
    os.mkfifo(pipe)
    verb, *more = command.split()
    assert main([verb, str(pipe), *more]) == 2
    assert "nothing came through this pipe within 0.1 s" in capsys.readouterr().err
    assert sorted(os.listdir(folder)) == ["pipe.toml"]


def test_a_scenario_may_come_through_a_pipe(tmp_path, capsys):
    from dembrick.scenario import shipped

    text = (shipped.folder() / "set4a.toml").read_text()
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    writer = threading.Thread(target=lambda: pipe.write_text(text))
    writer.start()
    assert main(["check", str(pipe), "--json"]) == 0
    writer.join()
    assert json.loads(capsys.readouterr().out)["blocks"] == 2
    done = shell(f"$DEMBRICK check <(cat {shipped.folder() / 'set4a.toml'}) --json", tmp_path)
    assert done.returncode == 0 and json.loads(done.stdout)["blocks"] == 2


@pytest.mark.parametrize(
    "arguments, code",
    [
        (["run", "none.toml"], 2),
        (["check", "bad.toml"], 2),
        (["limit", "bad.toml"], 2),
        (["joints", "none.h5"], 2),
        (["plot", "none.h5"], 2),
        (["sweep", "none.toml"], 2),
        (["restart", "none.h5"], 2),
        (["lab", "--wrong"], 2),
        (["rum"], 2),
        (["run"], 2),
        (["run", "set4a", "--out", "absent/folder/a.h5"], 2),
    ],
)
def test_every_error_is_one_json_object(arguments, code, folder, capsys):
    (folder / "bad.toml").write_text("title = 1\n")
    try:
        found = main([*arguments, "--json"])
    except SystemExit as leaving:
        found = leaving.code
    out, err = capsys.readouterr()
    assert found == code and "error: " in err
    said = json.loads(out)
    assert said["status"] == "failed" and said["error"] in err


SHAKEN = (
    header(friction=0.5, normal_stiffness=1e8, title="shaken")
    + block("base", (0.0, 0.0, -0.05), (1.0, 1.0, 0.1), "fixed = true")
    + block("block", (0.0, 0.0, 0.15), (0.3, 0.3, 0.3))
    + """
[control]
kind = "base-motion"
direction = [1.0, 0.0, 0.0]
file = "quake.csv"
duration = 0.2
"""
)


def test_an_input_error_leaves_no_history_in_the_way(tmp_path, capsys):
    """A record that begins too late, then corrected: the failed run left no file that only --force would replace."""
    scene, record, out = tmp_path / "quake.toml", tmp_path / "quake.csv", tmp_path / "quake.h5"
    scene.write_text(SHAKEN)
    record.write_text("time [s], acceleration [m/s2]\n" + "".join(f"{0.01 * i + 0.1}, 0.1\n" for i in range(31)))
    assert main(["run", str(scene), "--out", str(out)]) == 2
    assert "covers 0.1 to 0.4 s" in capsys.readouterr().err and not out.exists()
    record.write_text("time [s], acceleration [m/s2]\n" + "".join(f"{0.01 * i}, 0.1\n" for i in range(31)))
    scene.write_text(SHAKEN.replace("shaken", "shaken, mended"))
    assert main(["run", str(scene), "--out", str(out)]) == 0


def test_a_failed_run_is_replaced_without_force(tmp_path):
    """A block that falls before a settlement begins; then another scenario under the same name."""
    tall = SHAKEN.replace("position = [0.0, 0.0, 0.15]", "position = [0.6, 0.0, 0.15]")
    falls = tall[: tall.index("[control]")].replace("[1.0, 1.0, 0.1]", "[1.0, 1.0, 0.1]")
    settle = '[control]\nkind = "settlement"\nsupports = ["base"]\ndisplacement = [0.0, 0.0, -0.001]\n'
    scene, out = tmp_path / "a.toml", tmp_path / "a.h5"
    scene.write_text(falls + settle)
    assert main(["run", str(scene), "--out", str(out)]) == 1 and out.exists()
    scene.write_text(SHAKEN[: SHAKEN.index("[control]")] + '[control]\nkind = "statics"\n')
    assert main(["run", str(scene), "--out", str(out)]) == 0
    scene.write_text(falls.replace('"shaken"', '"another"') + '[control]\nkind = "statics"\n')
    assert main(["run", str(scene), "--out", str(out)]) == 2  # a finished history stays
