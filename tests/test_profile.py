"""Where the time of a run went: the split of the loop against a loop whose costs are known."""

import dataclasses
import json

import pytest

from dembrick import profile
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.lab import lab_scenario
from dembrick.model import DisplacementControl
from dembrick.profile import NEVER, PHASES, loop_shares
from dembrick.result import simulate

COSTS = {"joint_forces": 50e-6, "block_motion": 20e-6, "bracket": 5e-6, "record": 25e-6}  # s a step


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

    monkeypatch.setattr("dembrick.result._replayed", stop)
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
