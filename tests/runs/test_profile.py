"""Where the time of a run went: the split of the loop against a loop whose costs are known."""

import dataclasses
import importlib
import json
import math
import time

import pytest

from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs import profile
from dembrick.runs.lab import lab_scenario
from dembrick.runs.profile import NEVER, PHASES, STEPS, loop_shares, step_shares
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl, PushoverControl
from dembrick.scenario.model import Block, DisplacementControl, JointLaw, Material, Scenario
from dembrick.simulation.statics.newton import Equilibria

COSTS = {"joint_forces": 50e-6, "block_motion": 20e-6, "bracket": 5e-6, "record": 25e-6}  # s a step


@pytest.fixture(autouse=True)
def run_up_to_the_middle(monkeypatch):
    """However slow the machine is: the state whose steps are timed is that of half the steps."""
    monkeypatch.setattr(profile, "RUN_UP", math.inf)


def known(loop, record, steps):
    """What a loop would take in which every phase costs its share of ``COSTS``, and a call 3 ms."""
    joints = any(family is not None and family.joint.size for family in (loop.state.points, loop.state.areas))
    cost = COSTS["block_motion"] + joints * COSTS["joint_forces"]
    cost += (loop.certificate.every < NEVER) * COSTS["bracket"] + (record.every[0] < NEVER) * COSTS["record"]
    return 3e-3 + steps * cost


@pytest.mark.parametrize("name, formulation", [("set4a", "convex"), ("set4a_curve", "concave")])
def test_the_loop_is_split_as_its_costs_are(monkeypatch, name, formulation):
    given = lab_scenario(name, formulation)
    monkeypatch.setattr(profile, "LEAST", 0.0)
    whole = loop_shares(given, 1000)
    assert set(whole) == set(PHASES) and sum(whole.values()) == pytest.approx(1.0) and min(whole.values()) >= 0.0
    monkeypatch.setattr(profile, "_timed", known)
    shares = loop_shares(given, 1000)
    for phase, cost in COSTS.items():
        assert shares[phase] == pytest.approx(cost / sum(COSTS.values()), rel=1e-9), phase


def test_leaving_joints_out_leaves_the_motion(monkeypatch):
    """The timed loops are what they say: without joints no force reaches the block, without record no row comes."""
    seen = []

    def spy(loop, record, steps):
        own = known(loop, record, steps)
        if steps:
            timed(loop, record, steps)
            seen.append((loop.state.points.joint.size, loop.certificate.every, record.every[0], int(record.count[0])))
        return own

    timed = profile._timed
    monkeypatch.setattr(profile, "_timed", spy)
    monkeypatch.setattr(profile, "LEAST", 0.0)
    loop_shares(lab_scenario("set4a", "concave"), 30)
    assert {(joints, every == NEVER, rows == NEVER, count > 0) for joints, every, rows, count in seen} == {
        (1, False, False, True),
        (1, True, False, True),
        (1, False, True, False),
        (0, True, True, False),
    }


def test_what_cannot_be_split_is_said():
    given = lab_scenario("set4a_curve", "concave")
    short = dataclasses.replace(given, control=DisplacementControl(1e-3, 1e-8))
    with pytest.raises(ScenarioError, match="too short"):
        loop_shares(short, 1)


def test_info_tells_where_the_time_went(tmp_path, capsys):
    result = simulate(lab_scenario("set4a", "concave"), tmp_path / "run.h5")
    assert main(["info", str(tmp_path / "run.h5"), "--profile", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["wall"]) == {"start_up", "build", "compile", "loop", "write", "total"}
    assert sum(found["loop"].values()) == pytest.approx(found["wall"]["loop"]) == result.wall["loop"]
    assert main(["info", str(tmp_path / "run.h5"), "--profile"]) == 0
    out = capsys.readouterr().out
    assert all(phase.replace("_", " ") in out for phase in PHASES) and "start-up" in out


def test_only_a_finished_run_has_a_profile(tmp_path, monkeypatch, capsys):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("dembrick.runs.simulate._replayed", stop)
    with pytest.raises(KeyboardInterrupt):
        simulate(lab_scenario("set4a", "concave"), tmp_path / "run.h5")
    assert main(["info", str(tmp_path / "run.h5"), "--profile"]) == 2
    assert "status interrupted" in capsys.readouterr().err


def test_info_reads_no_data(tmp_path, monkeypatch, capsys):
    """To summarise a history neither a series nor a frame is read."""
    from dembrick.history import guard

    simulate(lab_scenario("set4a", "concave"), tmp_path / "run.h5")
    read, seen = guard.values, []
    monkeypatch.setattr(guard, "values", lambda data, *where: (seen.append(data.name), read(data, *where))[1])
    assert main(["info", str(tmp_path / "run.h5")]) == 0
    assert "254.5" in capsys.readouterr().out and seen == ["/written"]


# --- runs in real time, and searches through equilibria


def stack(control, gap=0.0):
    """A block that stands on a floor, and one above it."""
    size = (0.3, 0.2, 0.1)
    return Scenario(
        title="stack",
        gravity=(0.0, 0.0, -9.81),
        joint=JointLaw("concave", 0.64, 1e9, 4e8),
        materials={"stone": Material(2000.0)},
        blocks=(
            Block("floor", "stone", size, (0.0, 0.0, -0.05), fixed=True),
            Block("lower", "stone", size, (0.0, 0.0, 0.05)),
            Block("upper", "stone", size, (0.0, 0.0, 0.15 + gap)),
        ),
        control=control,
    )


def dropped():
    """The upper block lands on the lower one after 0.014 of 0.04 s: a joint, and a new contact."""
    return stack(DynamicControl(0.04), gap=1e-3)


@pytest.mark.parametrize("gap, contacts", [(1e-3, 30e-6), (0.0, 0.0)])
def test_compiled_steps_are_split_as_their_costs_are(monkeypatch, gap, contacts):
    costs = {"joint_forces": 50e-6, "new_contacts": contacts, "block_motion": 20e-6}
    monkeypatch.setattr(profile, "LEAST", 0.0)
    monkeypatch.setattr(profile, "_stepped", lambda _, __, ___, without=None: 100e-6 - costs.get(without, 0.0))
    given = stack(DynamicControl(0.04), gap)
    shares = step_shares(given, simulate(given, record=False).run.motion.steps)
    costs["block_motion"] = 50e-6 - contacts
    assert set(shares) == set(STEPS)
    assert all(shares[phase] == pytest.approx(cost / 100e-6, rel=1e-9) for phase, cost in costs.items())


def test_what_is_left_out_of_a_step_is_what_it_says(monkeypatch):
    """Nothing of the motion that is copied moves; without joints, or contacts, there are none in the loop."""
    seen, runs = [], []

    def spy(own, driving, steps, limits):
        before = own.loop_seconds
        status = advance(own, driving, steps, limits)
        seen.append(
            (len(own.state.corners.joint), len(own.contact_detection.touching.first), own.loop_seconds > before)
        )
        return status

    def kept(moving, driving):
        runs.append((moving, moving.steps, moving.displacement.copy()))
        return {without: split(moving, driving, 8, without) for without in (None, *STEPS[:2])}

    advance, split = profile.advance, profile._stepped
    monkeypatch.setattr(profile, "advance", spy)
    monkeypatch.setattr(profile, "_step_shares", kept)
    found = step_shares(dropped(), simulate(dropped(), record=False).run.motion.steps)
    ((moving, steps, displacement),) = runs
    assert seen == [(1, 1, True), (0, 1, True), (1, 0, True)] and min(found.values()) > 0.0
    assert moving.steps == steps and (moving.displacement == displacement).all()


@pytest.mark.parametrize(
    "phase, owner, name",
    [
        ("contact_search", "dembrick.simulation.dynamics.contact_detection.ContactDetection", "follow"),
        ("geometry", "dembrick.simulation.dynamics.joint_polygons.Polygons", "cut_stale"),
        ("record", "dembrick.simulation.dynamics.recorder.Recorder", "_load"),
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
    phases, wall = result.replay.phases, result.wall
    assert set(phases) == {"seating", "joint_forces", "equations", "bracket", "record", "path"}
    # one call is for compiling
    assert len(slow) > 1 and phases["equations"] >= sum(slow[1:]) and min(phases.values()) > 0.0
    assert sum(phases.values()) == pytest.approx(wall["loop"])
    assert wall["build"] + wall["compile"] + wall["loop"] + wall["write"] <= wall["total"] * (1.0 + 1e-9)


@pytest.mark.parametrize("control", [DynamicControl(0.04), PushoverControl((1.0, 0.0, 0.0), 1e-3)])
def test_info_tells_where_the_time_of_assemblies_went(tmp_path, monkeypatch, capsys, control):
    monkeypatch.setattr(profile, "LEAST", 0.0)
    path = str(tmp_path / "run.h5")
    simulate(stack(control, 1e-3 if control.kind == "dynamic" else 0.0), path)
    assert main(["info", path, "--profile", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert sum(found["loop"].values()) == pytest.approx(found["wall"]["loop"])
    phases = {"seating", "contact_search", "geometry", "record", *STEPS}
    if control.kind == "pushover":
        phases = {"seating", "joint_forces", "equations", "bracket", "record", "path"}
    assert set(found["loop"]) == phases
    assert main(["info", path, "--profile"]) == 0
    out = capsys.readouterr().out
    assert all(phase.replace("_", " ") in out for phase in phases) and "measured in the run" in out
