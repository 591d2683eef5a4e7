"""Run the scenario, the Python block and the commands of the README; and the README stays short."""

from __future__ import annotations

import re
import tomllib

import pytest

import dembrick
from dembrick import cli
from helpers.places import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_block_runs_and_says_what_it_should(folder, capsys):
    (block,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names: dict = {}
    exec(block, names)
    printed = capsys.readouterr().out
    V, half, theory = (float(x) for x in re.findall(r"[\d.]+\d", printed))
    assert theory == pytest.approx(216.055, abs=1e-3)
    assert abs(V - 216.054938) <= max(half, 1e-3)
    (line, *_) = names["figure"].axes[0].lines
    history = dembrick.read_history("set4a.h5")
    assert line.get_ydata() == pytest.approx(history.load)


def test_the_light_install_asks_for_what_the_full_one_does():
    """The dependency group that README names with --no-deps has three of the dependencies, with the same bounds."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    group = project["dependency-groups"]["solver"]
    assert set(group) < set(project["project"]["dependencies"])
    assert [re.match(r"\w+", entry).group() for entry in group] == ["numpy", "numba", "h5py"]
    assert "--group solver" in TEXT


def test_its_pictures_exist():
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", TEXT):
        assert (ROOT / picture).stat().st_size > 10_000, picture


def test_it_is_a_door_and_no_report():
    assert len(TEXT.encode()) <= 10_000


def test_its_scenario_is_complete_and_its_commands_run(folder, capsys):
    """Run the scenario unchanged, and all commands in their order."""
    (scenario,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    (folder / "wall.toml").write_text(scenario)
    commands = re.findall(r"^    dembrick (.*?)(?: {2,}#.*)?$", TEXT, re.MULTILINE)
    assert len(commands) == 7
    for command in commands:
        assert cli.main(command.split()) == 0, command
    printed = capsys.readouterr().out
    assert "collapse" in printed and "certified" in printed
    assert {path.suffix for path in (folder / "results").iterdir()} >= {".h5"}
    assert (folder / "curve.pdf").stat().st_size > 5000 and (folder / "wall.png").stat().st_size > 5000


def test_every_command_it_names_exists():
    named = {*re.findall(r"`dembrick ([a-z]+)\b", TEXT), *re.findall(r"^    dembrick ([a-z]+)", TEXT, re.MULTILINE)}
    assert len(named) > 6 and named <= set(cli.VERBS)


def test_the_folders_and_files_it_names_exist():
    for name in re.findall(r"`((?:docs|tools)/[a-z_/.]+|[A-Z]+\.(?:md|cff))`", TEXT):
        assert name.startswith("docs/_build") or (ROOT / name).exists(), name
