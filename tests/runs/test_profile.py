"""Where a run spent its time, by its own measurement."""

import dataclasses
import importlib
import json
import time

import pytest

from dembrick.cli import main
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl, PushoverControl
from dembrick.scenario.model import Block
from dembrick.simulation.statics.newton import Equilibria
from helpers.stone_scenes import law, of_stone


def test_info_tells_where_the_time_went(tmp_path, capsys):
    result = simulate(lab_scenario("set4a", "concave"), tmp_path / "run.h5")
    assert main(["info", str(tmp_path / "run.h5"), "--profile", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["wall"]) == {"start_up", "build", "compile", "loop", "write", "total"}
    assert found["wall"]["loop"] == result.wall["loop"] and found["loop"] is None  # too short to be timed by phase
    assert main(["info", str(tmp_path / "run.h5"), "--profile"]) == 0
    assert "start-up" in capsys.readouterr().out


def test_only_a_finished_run_has_a_profile(tmp_path, monkeypatch, capsys):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("dembrick.runs.drivers.limit_load.find_limit_load", stop)
    with pytest.raises(KeyboardInterrupt):
        simulate(lab_scenario("set4a", "concave"), tmp_path / "run.h5")
    assert main(["info", str(tmp_path / "run.h5"), "--profile"]) == 2
    assert "status interrupted" in capsys.readouterr().err


def test_info_reads_no_data(tmp_path, monkeypatch, capsys):
    """A summary of a history reads neither a series nor a frame."""
    from dembrick.history import guard

    simulate(lab_scenario("set4a", "concave"), tmp_path / "run.h5")
    read, seen = guard.values, []
    monkeypatch.setattr(guard, "values", lambda data, *where: (seen.append(data.name), read(data, *where))[1])
    assert main(["info", str(tmp_path / "run.h5")]) == 0
    assert "254.5" in capsys.readouterr().out
    assert not [name for name in seen if name.startswith(("/history", "/frames"))]


# --- runs in real time, and path-following searches


def stack(control, gap=0.0):
    """A block on a floor, and one above it."""
    size = (0.3, 0.2, 0.1)
    return of_stone(
        law("concave", 0.64, 1e9),
        control,
        (
            Block("floor", "stone", size, (0.0, 0.0, -0.05), fixed=True),
            Block("lower", "stone", size, (0.0, 0.0, 0.05)),
            Block("upper", "stone", size, (0.0, 0.0, 0.15 + gap)),
        ),
    )


def dropped():
    """The upper block lands on the lower one after 0.014 of 0.04 s: a joint and a new contact."""
    return stack(DynamicControl(0.04), gap=1e-3)


@pytest.mark.parametrize(
    "phase, owner, name",
    [
        ("contact_search", "dembrick.simulation.dynamics.contact_detection.ContactDetection", "follow"),
        ("geometry", "dembrick.simulation.dynamics.joint_polygons.Polygons", "cut"),
        ("record", "dembrick.simulation.dynamics.recorder.Recorder", "curve"),
        ("driving", "dembrick.simulation.dynamics.contact_detection.ContactDetection", "steps_to_go"),
    ],
)
def test_what_takes_long_is_booked_where_it_happens(monkeypatch, phase, owner, name):
    module, _, kind = owner.rpartition(".")
    slow, own = [], getattr(importlib.import_module(module), kind)
    plain = getattr(own, name)

    def slowly(*given, **named):
        began = time.perf_counter()
        time.sleep(2e-3)
        slow.append(time.perf_counter() - began)
        return plain(*given, **named)

    monkeypatch.setattr(own, name, slowly)
    slide = dataclasses.replace(dropped().blocks[2], velocity=(0.5, 0.0, 0.0), position=(0.0, 0.0, 0.15))
    blocks = (*dropped().blocks[:2], slide)
    result = simulate(dataclasses.replace(dropped(), blocks=blocks))
    phases, wall = result.run.phases, result.wall
    assert slow and phases[phase] >= sum(slow)
    assert sum(phases.values()) == pytest.approx(wall["loop"])
    assert wall["build"] + wall["compile"] + wall["loop"] + wall["write"] <= wall["total"] * (1.0 + 1e-9)


def test_equilibria_are_timed_by_phase(monkeypatch):
    solve, slow = Equilibria._solve, []

    def slowly(search):
        began = time.perf_counter()
        time.sleep(2e-3)
        slow.append(time.perf_counter() - began)
        return solve(search)

    monkeypatch.setattr(Equilibria, "_solve", slowly)
    result = simulate(stack(PushoverControl((1.0, 0.0, 0.0), 1e-3)))
    phases, wall = result.run.phases, result.wall
    assert set(phases) == {"dead_load", "joint_forces", "equations", "bracket", "record", "path"}
    # one call is counted as compiling
    assert len(slow) > 1 and phases["equations"] >= sum(slow[1:]) and min(phases.values()) > 0.0
    assert sum(phases.values()) == pytest.approx(wall["loop"])
    assert wall["build"] + wall["compile"] + wall["loop"] + wall["write"] <= wall["total"] * (1.0 + 1e-9)


@pytest.mark.parametrize("control", [DynamicControl(0.04), PushoverControl((1.0, 0.0, 0.0), 1e-3)])
def test_info_tells_where_the_time_of_assemblies_went(tmp_path, capsys, control):
    path = str(tmp_path / "run.h5")
    simulate(stack(control, 1e-3 if control.kind == "dynamic" else 0.0), path)
    assert main(["info", path, "--profile", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert sum(found["loop"].values()) == pytest.approx(found["wall"]["loop"])
    phases = {"dead_load", "contact_search", "geometry", "record", "driving", "steps"}
    if control.kind == "pushover":
        phases = {"dead_load", "joint_forces", "equations", "bracket", "record", "path"}
    assert set(found["loop"]) == phases
    assert main(["info", path, "--profile"]) == 0
    out = capsys.readouterr().out
    assert all(phase.replace("_", " ") in out for phase in phases)
