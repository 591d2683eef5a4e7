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
