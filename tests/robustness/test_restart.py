"""Stop and restart: bit for bit the same result as an uninterrupted run."""

import dataclasses
import json
import os
import signal

import numpy as np
import pytest

from dembrick.cli import main
from dembrick.errors import HistoryError
from dembrick.history import Checkpoints, read
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import model, toml
from dembrick.simulation.dynamics import run
from helpers.places import SCENARIOS
from helpers.restart_cases import case, check_same, content, rewritten
from helpers.scenario_text import block, header


@pytest.mark.parametrize("formulation", model.FORMULATIONS)
@pytest.mark.parametrize("name", ["set4a", "set4b_mid", "set4a_curve"])
def test_stop_and_restart_is_one_run(tmp_path, stop_after, name, formulation):
    """Stopped twice, once by each signal: rows, frames, results and settings equal those of one run bit for bit."""
    given = case(name, formulation, checkpoint=1e9, rows=60, frames=30)
    whole = simulate(given, tmp_path / "whole.h5")
    path = tmp_path / "parts.h5"
    words, first = ("step 5", "step 9"), 5
    if whole.counts_equilibria:
        words, first = ("equilibrium 1", "equilibrium [34]"), 2
    with stop_after(first, match=rf"after {words[0]}\b.*dembrick restart {path}") as stopped:
        simulate(given, path)
    assert stopped.value.exit_code == 130
    with read(path) as file:
        assert file.status == "interrupted" and file.n_row >= 1
    with stop_after(4, signal.SIGTERM, rf"after {words[1]}\b") as stopped:
        restart(path)
    assert stopped.value.exit_code == 143
    assert len(Checkpoints(path).existing()) == 2
    result = restart(path)
    assert result.yield_point == whole.yield_point and result.energy == whole.energy
    check_same(tmp_path / "whole.h5", path)
    assert sorted(os.listdir(tmp_path)) == ["parts.h5", "whole.h5"]  # no checkpoint is left behind


TILT = """
kind = "tilt"
axis = [1.0, 0.0, 0.0]
rate = 10.0
displacement = 0.002
"""


@pytest.mark.parametrize("pressure", ["effective", "linear"])
def test_pressures_that_follow_the_bending_go_on_too(tmp_path, stop_after, pressure):
    """Their state contains a nested part: the compressed polygons of the convex joints."""
    given = case("set4a_mid", "convex", checkpoint=1e9, rows=60, frames=30)
    given = dataclasses.replace(given, joint=dataclasses.replace(given.joint, pressure=pressure))
    whole = simulate(given, tmp_path / "whole.h5")
    with stop_after(5):
        simulate(given, tmp_path / "parts.h5")
    assert restart(tmp_path / "parts.h5").yield_point == whole.yield_point
    check_same(tmp_path / "parts.h5", tmp_path / "whole.h5")


PUSH = """
kind = "pushover"
direction = [1.0, 0.0, 0.0]
quasi_static = false
rate = 1.0e-2
displacement = 0.002
"""


@pytest.mark.parametrize(
    "formulation, pressure",
    [
        ("concave", "full"),
        ("convex", "full"),
        pytest.param("distributed", "full", marks=pytest.mark.slow),
        pytest.param("convex", "effective", marks=pytest.mark.slow),
        ("convex", "linear"),
    ],
)
@pytest.mark.parametrize("control", [TILT, PUSH], ids=["tilt", "push"])
def test_a_run_to_collapse_in_real_time_goes_on_too(tmp_path, stop_after, formulation, pressure, control):
    """A block overhangs the other, so polygons are clipped; stopped in the dead-load equilibrium and in motion."""
    law = f'"{formulation}"' + (f'\npressure = "{pressure}"' if pressure != "full" else "")
    text = (SCENARIOS / "set4a.toml").read_text().replace('"convex"', law)
    text = text[: text.index("[[loads]]")] + "[control]" + control
    text = text.replace("position = [0.0, 0.0, 0.05]", "position = [0.01, 0.02, 0.05]")
    given = toml.loads(text + "[output]\nrows = 100\nframes = 25\ncheckpoint = 1e9\n")
    whole = simulate(given, tmp_path / "whole.h5")
    assert whole.status == "collapse" and whole.run.motion.steps > 1000
    n_row = len(whole.rows["time"])
    for row in (1, n_row // 2):
        path = tmp_path / f"{row}.h5"
        with stop_after(row, match="dembrick restart"):
            simulate(given, path)
        assert restart(path).collapse == whole.collapse
        check_same(tmp_path / "whole.h5", path)


def test_a_settlement_that_waits_for_a_fall_goes_on_too(tmp_path, stop_after):
    """It ends as the whole run does, wherever the blocks were at the stop, bit for bit."""
    shelf = block("shelf", (0.0, 0.0, -0.1), (0.2, 1.0, 0.2), "fixed = true")
    floor, stone = block("floor", (0.0, 0.0, -3.1), (1.0, 1.0, 0.2), "fixed = true"), (0.15, 0.2, 0.2)
    turn = "rotation = { axis = [0.0, 1.0, 0.0], angle = 40.0 }\nquasi_static = false\nrate = 0.5"
    text = header("concave", 0.5, 2e8) + floor + shelf + block("b", (0.02, 0.0, 0.1), stone)
    text += f'[control]\nkind = "settlement"\nsupports = ["shelf"]\n{turn}\n'
    given = toml.loads(text + "[output]\nrows = 50\nframes = 50\ncheckpoint = 1e9\n")
    whole = simulate(given, tmp_path / "whole.h5")
    assert whole.fallen == ["b"]
    for row in (2, len(whole.rows["time"]) // 3):
        path = tmp_path / f"{row}.h5"
        with stop_after(row):
            simulate(given, path)
        assert restart(path).collapse == whole.collapse
        check_same(tmp_path / "whole.h5", path)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_run_in_real_time_stops_between_two_rows(tmp_path, stop_after, monkeypatch, formulation):
    """If a row takes many steps of a large scene, an interrupt does not wait for the end of the row."""
    monkeypatch.setattr(run, "AT_ONCE", 60)  # 20 steps of two blocks and a joint
    given = toml.load(SCENARIOS / "rocking_block.toml", ["control.duration=0.4", f"joint.formulation={formulation}"])
    given = dataclasses.replace(given, output=model.Output(model.CHANNELS, rows=20, frames=10, checkpoint=1e9))
    whole = simulate(given, tmp_path / "whole.h5")
    every = whole.run.motion.steps // 20
    assert every > 60 and len(whole.rows["time"]) in (21, 22)
    for looks in (1, 17):
        path = tmp_path / f"{looks}.h5"
        with stop_after(looks) as stopped:
            simulate(given, path)
        assert int(str(stopped.value).split()[3]) % every  # between two rows
        restart(path)
        check_same(tmp_path / "whole.h5", path)


SLIDING = header("convex", 0.2, title="Plates that slide over the edges of their floors")
SLIDING += '[control]\nkind = "dynamic"\nduration = 0.004\n'


def plate(i, speed):
    """A plate on its own floor, ``i`` m along x, that slides off it obliquely."""
    floor = block(f"floor {i}", (i, 0.0, -0.05), more="fixed = true")
    return floor + block(f"plate {i}", (i, 0.0, 0.05), more=f"velocity = [{speed}, 0.2, 0.0]")


def test_polygons_that_were_cut_go_on(tmp_path, stop_after):
    """Ten plates share a polygon until each has its own; stopped before and after that."""
    given = toml.loads(SLIDING + "".join(plate(i, 0.1 * i + 0.01) for i in range(10)))
    given = dataclasses.replace(given, output=model.Output(model.CHANNELS, rows=20, frames=10, checkpoint=1e9))
    whole = simulate(given, tmp_path / "whole.h5")
    faces = whole.run.motion.state.faces
    assert sorted(faces.outline) == list(range(1, 11)) and len(faces.count) == 17
    for row, some_share in ((2, True), (12, False)):
        path = tmp_path / f"{row}.h5"
        with stop_after(row):
            simulate(given, path)
        for one in Checkpoints(path).existing():
            with np.load(one) as kept:
                assert (kept["faces.outline"] == 0).any() == some_share
        restart(path)
        check_same(tmp_path / "whole.h5", path)


@pytest.mark.parametrize("array", ["faces.outline", "faces.count"])
def test_a_polygon_that_is_not_there_is_refused(tmp_path, stop_after, array):
    given = toml.loads(SLIDING + plate(0, 0.5))
    given = dataclasses.replace(given, output=model.Output(rows=20, frames=10, checkpoint=1e9))
    path = tmp_path / "run.h5"
    with stop_after(5):
        simulate(given, path)
    for one in Checkpoints(path).existing():
        rewritten(one, **{array: lambda numbers: numbers + np.array(1000, numbers.dtype)})
    with pytest.raises(HistoryError, match=f"{array} is outside the range of its polygons"):
        restart(path)


def test_a_history_is_enough_to_run_again(folder, capsys):
    given = case("set4a", "concave")
    simulate(given, folder / "first.h5")
    assert main(["run", "first.h5", "--quiet"]) == 0
    assert os.listdir(folder / "results") == ["first.h5"]
    first, again = content("first.h5"), content("results/first.h5")
    assert again["results"].pop("scenario") == "first.h5" and first["results"].pop("scenario") == given.path
    assert first["results"] == again["results"]
    assert first["history/load"].tobytes() == again["history/load"].tobytes()
    assert main(["run", "first.h5", "--set", "joint.friction=0.32", "--json", "--out", "half.h5"]) == 0
    out = capsys.readouterr().out
    half = json.loads(out[out.index("\n{") if not out.startswith("{") else 0 :])
    assert half["yield_point"]["V"] == pytest.approx(0.5 * first["results"]["yield_point"]["V"], rel=1e-2)
