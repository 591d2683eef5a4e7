"""A scenario drawn before anything runs: the blocks as they are described, by `render` and by `check --picture`."""

from __future__ import annotations

import numpy as np
import pytest

import dembrick
from dembrick import cli
from dembrick.assembly.build import assemble
from dembrick.runs import mechanism_history


@pytest.mark.parametrize("name", ["set4a", "wall_corner", "rocking_block", "arch_shaken"])
def test_the_history_before_a_run_has_the_blocks_at_rest(name):
    scenario = dembrick.load(name)
    assembly = assemble(scenario)
    with mechanism_history.before_a_run(scenario, assembly) as found:
        assert found.n_frames == 1 and found.block_names == assembly.names
        np.testing.assert_allclose(found.frame("position", 0), assembly.position, atol=1e-15)
        np.testing.assert_array_equal(found.frame("orientation", 0), assembly.orientation)


@pytest.mark.parametrize("command", ["render set4a --to start.png", "check set4a --picture start.png"])
def test_a_shipped_scenario_is_drawn_and_no_picture_of_another_is_lost(tmp_path, monkeypatch, capsys, drawing, command):
    monkeypatch.chdir(tmp_path)
    assert cli.main(command.split()) == 0
    first = (tmp_path / "start.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    other = command.replace("set4a", "set2a")
    assert cli.main(other.split()) == 2
    assert "--force" in capsys.readouterr().err and (tmp_path / "start.png").read_bytes() == first
    assert cli.main([*other.split(), "--force"]) == 0


def test_a_scenario_that_is_wrong_is_not_drawn(tmp_path, capsys):
    file = tmp_path / "wrong.toml"
    file.write_text(dembrick.dumps(dembrick.load("set4a")).replace("friction", "frictoin"))
    assert cli.main(["render", str(file), "--to", str(tmp_path / "a.png")]) == 2
    assert "friction" in capsys.readouterr().err and not (tmp_path / "a.png").exists()


def test_blocks_that_overlap_are_drawn_in_red(tmp_path, monkeypatch, capsys, drawing):
    """Nothing else is: the picture of the same blocks without an overlap has no red in it."""
    from PIL import Image

    monkeypatch.chdir(tmp_path)
    stray = '{name="stray", material="stone", box=[0.4, 0.4, 0.4], position=[0.1, 0.1, %s]}'
    red = {}
    for name, height, code in (("clear", "1.2", 0), ("in", "1.05", 2)):
        words = ["check", "wall_corner", "--set", f"blocks=[{stray % height}]", "--picture", f"{name}.png"]
        assert cli.main(words) == code
        colours = np.asarray(Image.open(f"{name}.png").convert("RGB"), int)
        red[name] = int((colours[..., 0] > 1.5 * colours[..., 1:].max(axis=2)).sum())
    assert red["in"] > 5000 > 500 > red["clear"], red
    told = capsys.readouterr().err
    assert "in.png: the blocks that overlap are red" in told and "or 'stray' as far the other way" in told
