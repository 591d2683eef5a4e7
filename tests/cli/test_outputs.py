"""Files that runs and exports write, in the format of their ending; what `info` reports about a history."""

import json
import shlex
from pathlib import Path

import pytest

from dembrick import history
from dembrick.cli import export, main
from helpers.scenario_text import block, header, jack

BEGINS = {  # first bytes of files, by ending
    "png": b"\x89PNG", "gif": b"GIF8", "html": b"<!doctype html", "pdf": b"%PDF", "svg": b"<?xml", "vtkhdf": b"\x89HDF",
    "csv": b"equilibrium",
}  # fmt: skip


pytestmark = pytest.mark.usefixtures("folder")  # every test runs in an empty folder


@pytest.fixture
def told(capsys):
    """Run a command line; return exit code, standard output and standard error."""

    def call(*words):
        code = main(list(words))
        return code, *capsys.readouterr()

    return call


def test_a_run_writes_each_file_by_its_ending(told):
    names = [f"out.{ending}" for ending in BEGINS]
    code, out, _ = told("run", "set4a", "--json", "--quiet", "--to", *names)
    answer = json.loads(out)
    assert code == 0 and answer["status"] == "yield" and set(names) <= set(answer["files"])
    for ending, begin in BEGINS.items():
        assert Path(f"out.{ending}").read_bytes().lower().lstrip(b"# ").startswith(begin.lower()), ending


def test_a_history_is_exported_to_several_files(told):
    assert told("run", "set4a", "--quiet")[0] == 0
    code, out, _ = told("export", "results/set4a.h5", "--to", "a.png", "--to", "b.pdf", "c.csv")
    assert code == 0 and [line.split()[-1] for line in out.splitlines()] == ["a.png", "b.pdf", "c.csv"]
    assert told("render", "results/set4a.h5", "--to", "same.png", "--quiet")[0] == 0
    assert Path("a.png").read_bytes() == Path("same.png").read_bytes()


def test_an_arch_is_drawn_from_the_front_with_its_line_of_thrust(told):
    assert told("run", "arch", "--quiet", "--to", "arch.png")[0] == 0
    look = ("--camera", "front", "--thrust")
    assert told("render", "results/arch.h5", "--to", "thrust.png", *look, "--quiet")[0] == 0
    assert told("render", "results/arch.h5", "--to", "plain.png", "--quiet")[0] == 0
    assert Path("arch.png").read_bytes() == Path("thrust.png").read_bytes() != Path("plain.png").read_bytes()


@pytest.mark.parametrize(
    "names, message",
    [
        (["curve.txt"], "curve.txt: no file can be written with the ending '.txt'; use one of .png, .gif"),
        (["a.png", "./a.png"], "./a.png: --to names this file twice"),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_runs(names, message, told, folder):
    code, _, err = told("run", "set4a", "--to", *names)
    assert code == 2 and message in err and not list(folder.iterdir())


def test_a_file_that_cannot_be_written_leaves_the_answer(told, folder):
    code, out, err = told("run", "set4a", "--json", "--quiet", "--to", "curve.pdf", "nowhere/at/all.png")
    answer = json.loads(out)
    assert code != 0 and "nowhere" in err
    assert answer["yield_point"]["V"] == pytest.approx(216.055, rel=1e-3) and answer["files"] == ["curve.pdf"]
    with history.read("results/set4a.h5") as found:
        assert found.status == "yield"


def test_render_writes_what_it_is_asked_for(told):
    assert told("run", "set4a", "--quiet", "--out", "run.h5")[0] == 0
    code, out, _ = told("render", "run.h5", "--to", "a.png", "--to", "a.html", "--quiet")
    assert code == 0 and out.splitlines() == ["picture: a.png", "page: a.html"]
    code, out, _ = told("render", "run.h5", "--to", "b.png", "--json")
    assert json.loads(out) == {"picture": "b.png", "files": ["b.png"]}
    code, _, err = told("render", "run.h5", "--to", "z.xyz")
    endings = ".png or .gif or .mp4 or .html or .htm"
    assert code == 2 and f"z.xyz: a picture, movie or page must have the ending {endings}" in err


@pytest.mark.parametrize(
    ("direction", "look"), [("[1, 0, 0]", {"view": "front", "thrust": True}), ("[0, 1, 0]", {}), ("[0, -1, 0]", {})]
)
def test_an_arch_is_drawn_from_the_front_unless_it_falls_that_way(direction, look, told, monkeypatch):
    drawn = []
    monkeypatch.setattr("dembrick.views.render.picture", lambda file, path, **look: drawn.append(look) or path)
    assert told("run", "arch", "--set", f"control.direction={direction}", "--to", "a.png", "--quiet")[0] == 0
    assert drawn == [look]


def test_render_says_how_several_files_are_named(capsys):
    with pytest.raises(SystemExit):
        main(["render", "run.h5", "--to", "c.png", "c.html"])
    assert "unrecognized arguments: c.html; to name several files, repeat --to before each" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ("check", "arch"),
        ("limit", "arch"),
        ("domain", "--a", "0.3", "--b", "0.2", "--mu", "0.64", "--N", "467"),
    ],
    ids=lambda words: words[0],
)
def test_to_is_another_name_of_picture_and_plot(words, told, folder):
    assert told(*words, "--to", "there.png", "--quiet")[0] == 0
    assert (folder / "there.png").stat().st_size > 3000


def test_a_direction_may_begin_with_a_minus_sign(told):
    spelled = [told("limit", "arch", "--reaction", "arch.right", *way) for way in (
        ("--direction", "-1,0,0"), ("--direction=-1,0,0",), ("--direction", "-1.0,.0,0")
    )]  # fmt: skip
    assert spelled[0][0] == 0 and spelled[0] == spelled[1] == spelled[2]


def test_a_history_that_was_not_written_is_not_named(told):
    """A history in a folder where not even root may create a file is not reported as written."""
    code, out, err = told("run", "set4a", "--out", "/proc/x.h5")
    assert code == 1 and "cannot be written" in err and "history:" not in err
    code, out, err = told("run", "set4a", "--out", "/proc/x.h5", "--json")
    assert set(json.loads(out)) == {"status", "error"}


def test_help_names_every_ending():
    assert set(export.BY_ENDING) == {
        ".png",
        ".gif",
        ".mp4",
        ".html",
        ".htm",
        ".pdf",
        ".svg",
        ".vtkhdf",
        ".pvd",
        ".csv",
    }


def test_info_tells_what_a_stranger_asks(told):
    """The joint forces at a time, as `joints` prints them, and a command that runs it again with a change."""
    assert told("run", "rocking_push", "--quiet", "--out", "given.h5")[0] == 0
    _, joints, _ = told("joints", "given.h5", "--time", "0.1", "--all")
    code, info, _ = told("info", "given.h5", "--time", "0.1")
    assert code == 0 and info.endswith(joints) and joints.startswith("time 0.09")
    assert json.loads(told("info", "given.h5", "--time", "0.1", "--json")[1])["at"]["joints"]
    assert "at" not in json.loads(told("info", "given.h5", "--json")[1])
    (again,) = [line.split(None, 3)[3] for line in info.splitlines() if line.startswith("run again")]
    words = shlex.split(again.replace("KEY.PATH=VALUE", "joint.friction=0.5"))
    assert told(*words, "--quiet")[0] == 0
    assert "friction = 0.5" in told("info", "NEW.h5", "--scenario")[1]


RIG = (
    header(friction=0.5, title="rig")
    + block("floor", (0.0, 0.0, -0.05), more="fixed = true")
    + block("stone", (0.0, 0.0, 0.05))
    + jack("stone", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    + "[control]\n"
)


def test_what_a_command_reads_is_not_written_over(told):
    """Scenario, protocol and history that a command reads are not overwritten, not even with --force."""
    Path("rig.toml").write_text(RIG + 'kind = "displacement"\nprotocol = "way.csv"\nlarge_displacements = true\n')
    Path("way.csv").write_text("displacement [m]\n0\n1e-5\n-1e-5\n0\n")
    Path("push.toml").write_text(RIG + 'kind = "yield"\n')
    kept = {name: Path(name).read_text() for name in ("rig.toml", "way.csv", "push.toml")}
    assert told("run", "rig.toml", "--out", "rig.h5")[0] == 0
    for words in (
        ("limit", "push.toml", "--out", "push.toml"),
        ("run", "rig.toml", "--to", "way.csv"),
        ("export", "rig.h5", "--to", "way.csv"),
        ("export", "rig.h5", "--to", "rig.toml"),
        ("joints", "rig.h5", "--csv", "way.csv"),
        ("domain", "--scenario", "rig.toml", "--csv", "way.csv"),
    ):
        code, _, said = told(*words, "--force")
        assert code == 2 and any(why in said for why in ("is an input of the command", "ending", ".h5")), words
    assert {name: Path(name).read_text() for name in kept} == kept
    assert told("limit", "push.toml", "--out", "push.h5")[0] == 0
    code, _, said = told("limit", "push.h5", "--out", "push.h5", "--force")
    assert code == 2 and "is an input of the command" in said
    assert "the ending" in told("limit", "push.toml", "--out", "push.txt")[2]


def test_an_export_of_layers_that_there_are_not_is_refused(told):
    Path("push.toml").write_text(RIG + 'kind = "yield"\n')
    assert told("run", "push.toml", "--out", "push.h5")[0] == 0
    code, _, said = told("export", "push.h5", "--to", "push.vtkhdf", "--layers", "ties")
    assert code == 2 and "no ties" in said


def test_tables_of_causes_take_no_place_of_others(told):
    Path("cracks.toml").write_text('title = "?"\nbase = "arch_spread.toml"\n[target]\nopen = [["arch.4", "arch.5"]]\n')
    Path("out").mkdir()
    Path("out/causes.csv").write_text("notes\n")
    code, out, said = told("sweep", "cracks.toml", "--out", "out")
    assert code == 2 and "cause 1" in out and "causes.csv: this file exists" in said
    assert Path("out/causes.csv").read_text() == "notes\n"
    assert told("sweep", "cracks.toml", "--out", "out", "--force")[0] == 0
    assert Path("out/causes.csv").read_text().startswith("cause")
