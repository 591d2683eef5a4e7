"""Only files that this program wrote, as the same kind and from the same scenario, are overwritten."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import h5py
import pytest

from dembrick import _file_locks, history
from dembrick.cli import main
from dembrick.errors import OutputError
from dembrick.history.claims import claimed
from dembrick.runs.simulate import simulate
from helpers import windows_locks
from helpers.places import ROOT

SET4A = (ROOT / "scenarios" / "set4a.toml").read_text()


@pytest.fixture
def folder(folder):
    (folder / "mine.toml").write_text(SET4A)
    return folder


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """Folder in which ``mine.toml`` was run once, and once more with another friction."""
    folder = tmp_path_factory.mktemp("once")
    (folder / "mine.toml").write_text(SET4A)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["run", "mine.toml", "--out", "run.h5", "--quiet"]) == 0
        assert main(["run", "mine.toml", "--out", "other.h5", "--set", "joint.friction=0.5"]) == 0
    return folder


@pytest.fixture
def run(once, folder):
    shutil.copy(once / "run.h5", folder)
    return "run.h5"


def refused(capsys, *words):
    capsys.readouterr()
    assert main(list(words)) == 2
    return capsys.readouterr().err


# --- histories --------------------------------------------------------------------------------------------------------


def test_default_names_of_different_runs_do_not_meet(folder, capsys):
    """Another --set, another scenario with the same file name, and an edit: none overwrites an existing history."""
    run = ["run", "mine.toml", "--json"]
    assert main(run) == 0
    first = (folder / "results" / "mine.h5").read_bytes()
    assert main([*run, "--set", "joint.friction=0.5"]) == 0
    assert "results/mine.h5 holds another scenario or other --set values; this run is written to results/mine_2.h5" in (
        capsys.readouterr().err
    )
    (folder / "B").mkdir()
    (folder / "B" / "mine.toml").write_text(SET4A)
    assert main(["run", "B/mine.toml"]) == 0
    assert (folder / "results" / "mine.h5").read_bytes() == first
    (folder / "mine.toml").write_text(SET4A.replace("0.64 ", "0.63 "))
    assert main(run) == 0
    assert (folder / "results" / "mine.h5").read_bytes() == first
    names = {f"mine{end}.h5" for end in ("", "_2", "_3", "_4")}
    assert names == set(os.listdir(folder / "results"))
    loads = [history.read(folder / "results" / name).results["yield_point"]["V"] for name in sorted(names)]
    assert len({round(V, 6) for V in loads}) == 3  # B's is that of the first
    (folder / "mine.toml").write_text(SET4A + "\n# a remark changes nothing\n")
    assert main(run) == 0  # it replaces its own earlier output
    assert names == set(os.listdir(folder / "results"))


def test_what_is_no_history_is_left_alone(folder, capsys):
    (folder / "results").mkdir()
    (folder / "results" / "mine.h5").write_text("notes")
    assert main(["run", "mine.toml"]) == 0
    assert (folder / "results" / "mine.h5").read_text() == "notes" and (folder / "results" / "mine_2.h5").exists()


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_a_run_never_writes_over_its_scenario_or_an_input(folder, force, capsys):
    assert "ending .h5 or .hdf5" in refused(capsys, "run", "mine.toml", "--out", "mine.toml", *force)
    assert "ending .h5 or .hdf5" in refused(capsys, "run", "mine.toml", "--out", "out.txt", *force)
    os.link(folder / "mine.toml", folder / "mine.h5")
    assert "is an input of the command" in refused(capsys, "run", "mine.toml", "--out", "mine.h5", *force)
    shaken = SET4A.partition("[[actuators]]")[0]
    shaken += '[control]\nkind = "base-motion"\nduration = 0.01\ndirection = [1.0, 0.0, 0.0]\nfile = "record.h5"\n'
    (folder / "shaken.toml").write_text(shaken)
    (folder / "record.h5").write_text("time [s],acceleration [g]\n0,0\n1,0\n")
    assert "is an input of the command" in refused(capsys, "run", "shaken.toml", "--out", "record.h5", *force)
    assert (folder / "mine.toml").read_text() == SET4A


def test_an_unfinished_run_of_another_scenario_is_kept(run, folder, capsys):
    with h5py.File(run, "r+") as file:
        file.attrs["status"] = "running"
    other = ["run", "mine.toml", "--out", run, "--set", "joint.friction=0.5"]
    assert "an unfinished run (dembrick restart) of another scenario is there" in refused(capsys, *other)
    assert main(["run", "mine.toml", "--out", run]) == 0  # of the same scenario: started afresh


@pytest.fixture(params=["posix", "windows"])
def system(request, monkeypatch):
    """Start of a script that locks files as an operating system does; this process does so too."""
    if request.param == "posix":
        return ""
    if sys.platform != "linux":
        pytest.skip("locks of Windows are played by those of Linux")
    monkeypatch.setattr(_file_locks, "fcntl", None)
    monkeypatch.setattr(_file_locks, "msvcrt", windows_locks)
    return (
        f"import sys; sys.path.insert(0, {str(ROOT / 'tests')!r})\nfrom helpers import windows_locks\n"
        "from dembrick import _file_locks\n_file_locks.fcntl, _file_locks.msvcrt = None, windows_locks\n"
    )


def test_the_second_of_two_writers_is_refused(folder, capsys, system):
    code = "from dembrick.history import claimed\nimport time\nwith claimed('run.h5'):\n print('in', flush=True)\n"
    code = system + code
    first = subprocess.Popen([sys.executable, "-c", code + " time.sleep(60)"], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout.readline() == "in\n"
        assert "another run is writing this file" in refused(capsys, "run", "mine.toml", "--out", "run.h5")
        with pytest.raises(OutputError, match="another run is writing"), claimed("run.h5"):
            pass
    finally:
        first.kill()  # its lock ends with the process
        first.wait()
    simulate("mine.toml", "run.h5")
    assert sorted(os.listdir(folder)) == ["mine.toml", "run.h5"]


def test_claims_of_many_processes_never_meet(folder, system):
    """A process with the lock is alone, also while the locked file is created and removed by others."""
    code = """
import os, random, time
from dembrick.errors import OutputError
from dembrick.history.claims import claimed
end, got = time.monotonic() + 0.15, 0
while time.monotonic() < end:
    try:
        with claimed("run.h5"):
            os.close(os.open("inside", os.O_CREAT | os.O_EXCL))
            os.unlink("inside")
            got += 1
    except OutputError:
        pass
print(got)
"""
    started = [
        subprocess.Popen([sys.executable, "-c", system + code], stdout=subprocess.PIPE, text=True) for _ in range(3)
    ]
    assert [one.wait() for one in started] == [0, 0, 0]
    assert sum(int(one.stdout.read()) for one in started) > 40
    assert time.monotonic()


# --- pictures of check ------------------------------------------------------------------------------------------------


def test_check_draws_a_file_again_after_an_edit_and_no_other_file(folder, capsys):
    check = ["check", "mine.toml", "--picture", "p.png"]
    assert main(check) == 0
    first = (folder / "p.png").read_bytes()
    (folder / "mine.toml").write_text(SET4A.replace("0.64 ", "0.62 "))
    assert main([*check, "--set", "joint.friction=0.5"]) == 0
    again = (folder / "p.png").read_bytes()
    assert again != first
    (folder / "other.toml").write_text(SET4A.replace("0.64 ", "0.63 "))
    capsys.readouterr()
    assert main(["check", "other.toml", "--picture", "p.png"]) == 2
    out, err = capsys.readouterr()
    assert "was not written by this command from the same scenario" in err
    assert "blocks        2 (1 free)" in out  # the check itself
    assert (folder / "p.png").read_bytes() == again


def test_a_result_is_not_replaced_by_the_picture_of_an_edited_scenario(run, folder):
    assert main(["render", run, "--to", "r.png", "--quiet"]) == 0
    (folder / "mine.toml").write_text(SET4A.replace("0.64 ", "0.63 "))
    assert main(["check", "mine.toml", "--picture", "r.png"]) == 2


def test_overlapping_blocks_are_told_where_their_picture_is_refused(folder, capsys):
    (folder / "p.png").write_bytes(b"mine")
    text = (
        SET4A + '\n[[blocks]]\nname = "extra"\nmaterial = "tuff"\nbox = [0.3, 0.2, 0.1]\nposition = [0.0, 0.0, 0.05]\n'
    )
    (folder / "mine.toml").write_text(text)
    assert main(["check", "mine.toml", "--picture", "p.png"]) == 2
    err = capsys.readouterr().err
    assert "overlap" in err and "p.png: this file exists" in err
    assert (folder / "p.png").read_bytes() == b"mine"


# --- tables, figures, exports -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["yield", "joints"])
def test_a_table_replaces_nothing_but_itself(verb, run, folder, capsys):
    for target in (run, "mine.toml"):
        before = Path(target).read_bytes()
        refused(capsys, verb, run, "--csv", target)
        assert Path(target).read_bytes() == before
    (folder / "data.csv").write_text("my own,data\n1,2\n")
    assert "--force replaces it" in refused(capsys, verb, run, "--csv", "data.csv")
    assert (folder / "data.csv").read_text() == "my own,data\n1,2\n"
    assert main([verb, run, "--csv", "data.csv", "--force"]) == 0
    assert main([verb, run, "--csv", "data.csv"]) == 0  # the same again
    assert (folder / "data.csv").read_text().count("\n") == 2


def test_a_table_of_a_domain_replaces_nothing(folder, capsys):
    domain = ["domain", "--a", "0.3", "--b", "0.2", "--mu", "0.64", "--N", "467", "--formulation", "convex"]
    assert "ending .csv" in refused(capsys, *domain, "--csv", "mine.toml")
    (folder / "data.csv").write_text("my own\n")
    assert "--force replaces it" in refused(capsys, *domain, "--csv", "data.csv")
    assert (folder / "data.csv").read_text() == "my own\n"
    assert main([*domain, "--csv", "table.csv"]) == main([*domain, "--csv", "table.csv"]) == 0


def test_a_run_looks_at_the_files_in_its_way_before_it_runs(folder, capsys):
    (folder / "wall.png").write_text("mine\n")
    said = refused(capsys, "run", "mine.toml", "--to", "page.html", "wall.png")
    assert "wall.png" in said and "was not written by this command" in said
    assert not (folder / "results" / "mine.h5").exists() and not (folder / "page.html").exists()
    assert main(["run", "mine.toml", "--to", "page.html", "wall.png", "--force"]) == 0
    assert main(["run", "mine.toml", "--to", "page.html", "wall.png"]) == 0


MAKERS = {
    "figure.png": ["plot"],
    "figure.svg": ["plot"],
    "figure.pdf": ["plot"],
    "page.html": ["render"],
    "frames.vtkhdf": ["export"],
    "frames.pvd": ["export"],
    "series.csv": ["export"],
}


def read_vtkhdf(name):
    with h5py.File(name) as file:
        assert file["VTKHDF/Steps"].attrs["NSteps"] > 1


def read_png(name):
    from matplotlib import image

    assert image.imread(name).shape[2] == 4


READS = {  # the mark that the program appends harms no format
    "figure.png": read_png,
    "figure.svg": ElementTree.parse,
    "figure.pdf": lambda name: Path(name).read_bytes()[-200:].index(b"%%EOF"),
    "page.html": lambda name: Path(name).read_text(encoding="utf-8"),
    "frames.vtkhdf": read_vtkhdf,
    "frames.pvd": ElementTree.parse,
    "series.csv": lambda name: Path(name).read_text(encoding="utf-8"),
}


@pytest.mark.parametrize("name", MAKERS)
def test_what_was_made_of_a_run_gives_way_to_the_same_of_it_alone(name, run, once, folder, capsys):
    make = [*MAKERS[name], run, "--to", name]
    (folder / name).write_text("mine\n")
    assert "was not written by this command from the same scenario" in refused(capsys, *make)
    assert (folder / name).read_text() == "mine\n"
    assert main([*make, "--force"]) == 0
    assert main(make) == 0
    READS[name](name)
    before = (folder / name).read_bytes()
    assert "--force replaces it" in refused(capsys, MAKERS[name][0], str(once / "other.h5"), "--to", name)
    assert (folder / name).read_bytes() == before


def test_a_figure_of_another_kind_is_another_file(run, folder, capsys):
    assert main(["plot", run]) == main(["plot", run, "--kind", "energies"]) == 0
    assert sorted(os.listdir(folder / "results")) == ["run.png", "run_energies.png"]
    refused(capsys, "plot", run, "--kind", "energies", "--to", "results/run.png")


def test_default_figures_of_runs_of_one_name_do_not_meet(run, once, folder):
    assert main(["plot", run]) == 0
    (folder / "B").mkdir()
    shutil.copy(once / "other.h5", folder / "B" / "run.h5")
    assert main(["plot", "B/run.h5"]) == 0
    assert sorted(os.listdir(folder / "results")) == ["run.png", "run_2.png"]


def test_a_list_of_frames_has_a_folder_of_its_own(run, folder):
    assert main(["export", run, "--to", "q.pvd"]) == 0
    made = sorted(name for name in os.listdir(folder) if name.startswith("q"))
    assert made == ["q.pvd", "q_contacts.pvd", "q_frames", "q_joints.pvd"]
    frames = os.listdir(folder / "q_frames")
    assert all(name.endswith(".vtu") for name in frames) and len(frames) > 2
    assert 'file="q_frames/q_00000.vtu"' in (folder / "q.pvd").read_text()
    assert not [name for name in os.listdir(folder) if name.startswith(".")]


def test_a_folder_of_other_things_is_not_taken_for_frames(run, folder, capsys):
    (folder / "q_frames").mkdir()
    (folder / "q_frames" / "thesis.tex").write_text("mine")
    assert "holds files other than frames" in refused(capsys, "export", run, "--to", "q.pvd", "--force")
    assert (folder / "q_frames" / "thesis.tex").read_text() == "mine"


# --- templates and reports --------------------------------------------------------------------------------------------


def test_a_template_replaces_only_itself(folder, capsys):
    assert main(["new", "wall", "w.toml"]) == 0
    assert main(["new", "wall", "w.toml"]) == 0  # the same text
    whole = (folder / "w.toml").read_text()
    (folder / "w.toml").write_text(whole + "# mine")
    assert "was not written by this command" in refused(capsys, "new", "wall", "w.toml")
    assert "ending .toml" in refused(capsys, "new", "wall", "w.h5")
    assert (folder / "w.toml").read_text().endswith("# mine")
    assert main(["new", "wall", "w.toml", "--force"]) == 0 and (folder / "w.toml").read_text() == whole


def test_a_report_replaces_only_a_report_of_the_same_cases(folder, capsys):
    from dembrick.runs.verification.cases import chosen

    one, other = (case.name for case in chosen([], True)[:2])
    (folder / "r.html").write_text("<p>mine</p>")
    assert "was not written by this command" in refused(capsys, "verify", one, "--report", "r.html")
    assert (folder / "r.html").read_text() == "<p>mine</p>"
    assert main(["verify", one, "--report", "r.html", "--force"]) == 0
    assert main(["verify", one, "--report", "r.html"]) == 0
    assert "was not written by this command" in refused(capsys, "verify", other, "--report", "r.html")
    assert (folder / "r.html").read_text().startswith("<!doctype html>")
