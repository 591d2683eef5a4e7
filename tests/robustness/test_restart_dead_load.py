"""Runs in real time stopped or killed in their dead-load equilibrium: after a restart, bit for bit the whole run."""

import dataclasses
import json
import signal

import numpy as np
import pytest

from dembrick.cli import main
from dembrick.errors import HistoryError
from dembrick.history import Checkpoint, Checkpoints, read
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import model, toml
from dembrick.simulation.dynamics import dead_load
from helpers.restart_cases import SLOW, check_same, dembrick, rewritten, wait_for
from helpers.scenario_text import header

PILE = """
[[stacks]]
name = "pile"
material = "stone"
box = [0.3, 0.2, 0.1]
blocks = 3
base = 0.1

[output]
channels = ["joints", "energy", "frames", "velocity", "contacts"]
rows = 20
frames = 10
"""
CONTROL = {
    "shaken": '[control]\nkind = "base-motion"\nduration = 0.02\ndirection = [1.0, 0.0, 0.0]\n'
    "sine = { amplitude = 2.0, frequency = 5.0 }\n",
    # overloaded sideways: a block that overturns without slip is fixed until time starts, and then falls
    "overturned": '[control]\nkind = "dynamic"\nduration = 0.02\n'
    '[[loads]]\nblock = "pile.3"\nforce = [600.0, 0.0, 0.0]\n',
    # displaced a little, and then at rest
    "settled": '[control]\nkind = "settlement"\nquasi_static = false\nrate = 0.05\nsupports = ["pile.base"]\n'
    "displacement = [0.001, 0.0, 0.0]\n",
    "pushed": '[control]\nkind = "pushover"\nquasi_static = false\nrate = 0.02\ndirection = [1.0, 0.0, 0.0]\n'
    "displacement = 2.0e-4\n",
}


def scene_text(formulation, control, checkpoint):
    return header(formulation) + PILE + f"checkpoint = {checkpoint}\n" + CONTROL[control]


def given(formulation, control, checkpoint=1e9):
    return toml.loads(scene_text(formulation, control, checkpoint))


@pytest.mark.parametrize(
    "formulation, control",
    [("concave", "shaken"), ("convex", "overturned"), ("convex", "pushed"), ("concave", "settled")],
)
def test_a_dead_load_equilibrium_goes_on_where_it_was_stopped(tmp_path, stop_after, monkeypatch, formulation, control):
    """Stopped after the first chunk and before the last."""
    monkeypatch.setattr(dead_load, "CHUNK", 16)
    scene = given(formulation, control)
    whole = simulate(scene, tmp_path / "whole.h5")
    steps = whole.run.motion.dead_load_steps
    if control == "overturned":
        assert whole.run.motion.falling.any()
    chunks = -(-steps // 16)
    assert chunks > 6
    for chunk in (1, chunks - 1):
        path = tmp_path / f"{chunk}.h5"
        place = f"step {16 * chunk} of the dead-load equilibrium"
        with stop_after(chunk, match=f"after {place}; continue with: dembrick restart"):
            simulate(scene, path)
        with read(path) as found:
            assert found.n_row == 0 and found.status == "interrupted"
        said = []
        result = restart(path, report=said.append)
        assert said[0] == f"continuing from {place}"  # the remark about a fast rate comes after this
        assert result.run.motion.dead_load_steps == steps
        check_same(tmp_path / "whole.h5", path)


def test_a_run_that_is_killed_in_its_dead_load_equilibrium(tmp_path, monkeypatch, capsys):
    """Killed by SIGKILL, which no process can catch, after it had written checkpoints."""
    scene, path = given("concave", "shaken", 0.0), tmp_path / "run.h5"
    (tmp_path / "scene.toml").write_text(toml.dumps(scene))
    seen = "import dembrick.simulation.dynamics.dead_load as d\nd.CHUNK = 16\n"
    slow = SLOW.replace("looked =", seen + "looked =", 1)
    child = dembrick("run", str(tmp_path / "scene.toml"), "--out", str(path), code=slow)

    def two_are_there():
        kept = Checkpoints(path).existing()
        return len(kept) == 2

    wait_for(two_are_there, child, "two checkpoints")
    child.send_signal(signal.SIGKILL)
    child.communicate(timeout=60)
    places = [Checkpoint(one).about["where"] for one in Checkpoints(path).existing()]
    assert all(place.endswith("of the dead-load equilibrium") for place in places)
    with read(path) as found:
        assert found.status == "running" and found.n_row == 0
    monkeypatch.setattr(dead_load, "CHUNK", 16)
    assert main(["restart", str(path), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["status"] == "completed" and "of the dead-load equilibrium" in err
    simulate(tmp_path / "scene.toml", tmp_path / "whole.h5")
    check_same(tmp_path / "whole.h5", path)


@pytest.mark.parametrize("loop", [(0.0, 1e-4, 0.0), (0.0, 1e-4, 16.5), (-1.0, 1e-4, 16.0), (0.0, np.inf, 16.0)])
def test_a_checkpoint_of_no_step_is_refused(tmp_path, stop_after, monkeypatch, loop):
    monkeypatch.setattr(dead_load, "CHUNK", 16)
    path = tmp_path / "run.h5"
    with stop_after(2):
        simulate(dataclasses.replace(given("concave", "shaken"), output=model.Output(checkpoint=1e9)), path)
    for one in Checkpoints(path).existing():
        rewritten(one, loop=np.array(loop))
    with pytest.raises(HistoryError, match="this checkpoint holds no step of this run"):
        restart(path)
