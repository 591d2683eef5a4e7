"""What the README shows is run: its Python block, its commands' options, its pictures."""

from __future__ import annotations

import re

import pytest

import dembrick
from dembrick import cli
from dembrick.assembly.build import assemble
from helpers.places import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_block_runs_and_says_what_it_should(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
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


def test_its_pictures_exist():
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", TEXT):
        assert (ROOT / picture).stat().st_size > 10_000, picture


def test_its_own_scenario_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (line,) = re.findall(r"dembrick (run scenarios/set4a.toml --set .*)", TEXT)
    words = line.split()
    words[1] = str(ROOT / words[1])
    assert cli.main(words) == 0
    assert "certified" in capsys.readouterr().out


def test_every_command_it_names_exists():
    named = set(re.findall(r"\bdembrick ([a-z]+)\b", TEXT)) - {"is", "replays", "keeps", "says", "draws"}
    assert named <= set(cli.VERBS)


def test_its_wall_is_a_scenario():
    section = TEXT[TEXT.index("## Walls, arches") : TEXT.index("| table | what it lays")]
    wall = "\n".join(line[4:] for line in section.splitlines() if line.startswith("    "))
    head = (ROOT / "scenarios" / "set4a.toml").read_text(encoding="utf-8")
    head = head[: head.index("[[blocks]]")].replace('"convex"', '"concave"')
    found = dembrick.loads(head + wall)
    assert {"wall", "wall.3", "wall.right", "wall.right.3"} <= set(found.groups)
    assert found.all_blocks[-1].name == "wall.base" and found.control.kind == "pushover"
    assert len(assemble(found).joints) > 150
