"""Stop and restart of path-following searches and of their dead-load equilibrium: bit for bit one run."""

import dataclasses
import os
import random
import signal

import numpy as np
import pytest

from dembrick.errors import HistoryError, OutputError
from dembrick.history import Checkpoint, Checkpoints, read
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import model, shipped, toml
from dembrick.scenario.controls import PushoverControl, StaticsControl, TiltControl, YieldControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Actuator, Block
from dembrick.simulation.interrupts import Interrupted
from dembrick.simulation.statics import limit_load
from dembrick.simulation.statics.paths import path_following, path_state
from dembrick.simulation.statics.rest import relaxation
from helpers.restart_cases import SLOW, check_same, counted_looks, dembrick, rewritten, rows_of, wait_for
from helpers.stone_scenes import law, of_stone


def scene(control, formulation="concave", friction=0.6, pressure="full", **parts):
    """A scene that writes a checkpoint only when it is stopped; the arch writes one at every check for signals."""
    output = model.Output(("joints", "energy", "frames", "velocity"), checkpoint=1e9)
    return of_stone(law(formulation, friction, pressure=pressure), control, output=output, **parts)


def wall(courses=4, block=(0.3, 0.2, 0.1)):
    return {"walls": (Wall("wall", "stone", block, courses=courses, blocks=3, base=0.1),)}


def tower():
    """Two blocks on a fixed one; a jack pushes the upper one eccentrically."""
    boxes = {"base": -0.05, "lower": 0.05, "upper": 0.15}
    blocks = [Block(name, "stone", (0.3, 0.2, 0.1), (0.0, 0.0, z), fixed=name == "base") for name, z in boxes.items()]
    jack = Actuator("jack", "upper", (0.05, -0.1, 0.15), (0.0, 1.0, 0.0))
    return {"blocks": tuple(blocks), "actuators": (jack,)}


def an_example(name, *changes, checkpoint=1e9):
    given = toml.load(shipped.folder() / name, changes)
    return dataclasses.replace(given, output=model.Output(checkpoint=checkpoint))


TILT = TiltControl((1.0, 0.0, 0.0), 1.0, 1e-4, quasi_static=True)
SCENES = {
    "wall pushed over": lambda: scene(PushoverControl((0.3, 1.0, 0.0), 1e-4), **wall()),
    "convex wall tilted": lambda: scene(TILT, "convex", **wall(2)),
    "linear pressure": lambda: scene(TILT, "convex", pressure="linear", **wall(2)),
    "arch": lambda: an_example("arch.toml", checkpoint=0.0),
    "contacts at the brink": lambda: an_example("ferris_tinloi_3.toml", "control.quasi_static=true"),
    "blocks that are let go": lambda: scene(
        PushoverControl((-0.8, 0.6, 0.0), 1e-4), friction=3.0, **wall(2, (0.2, 0.22, 0.12))
    ),
    "blocks that are pushed on": lambda: scene(PushoverControl((0.3, 1.0, 0.0), 1e-4), **wall()),
    "yield of a tower": lambda: scene(YieldControl(1e-3), "corrected-shear", **tower()),
    "constant rate on a tower": lambda: scene(model.DisplacementControl(1e-4, 5e-6), **tower()),
}


@pytest.fixture
def signal_after(stop_after, monkeypatch):
    """``stop_after``, with checks for signals also between the steps of a dead-load equilibrium."""
    monkeypatch.setattr(relaxation, "FEW", 1)
    monkeypatch.setattr(relaxation, "CHUNK_SECONDS", 0.0)
    return stop_after


LONG = "arch", "blocks that are pushed on"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in LONG else []) for name in SCENES]
)
def test_stopped_anywhere_and_restarted_is_one_run(tmp_path, signal_after, monkeypatch, name):
    """At the first check for signals, a random one and the last; the second run is stopped twice."""
    if "pushed on" in name:
        monkeypatch.setattr(path_following, "WASTED", -1e12)
        monkeypatch.setattr(path_following, "LEAST_WASTED", -1)
    given, rng = SCENES[name](), random.Random(name)
    with counted_looks() as looked:
        simulate(given, tmp_path / "whole.h5")
    most = len(looked)
    assert most > 5
    wheres = set()
    for number, looks in enumerate((1, rng.randrange(2, most), most)):
        path = tmp_path / f"{looks}.h5"
        told = f"^interrupted after .*; continue with: dembrick restart {path}"
        with signal_after(looks, signal.SIGTERM, told) as stopped:
            simulate(given, path)
        wheres.add(str(stopped.value).split()[2])
        with read(path) as file:
            assert file.status == "interrupted"
        assert Checkpoints(path).existing()
        if number % 2:
            with signal_after(2) as stopped:
                restart(path)
            assert stopped.value.exit_code == 130
        restart(path)
        check_same(tmp_path / "whole.h5", path)
        path.unlink()
    assert "rate" in name or "equilibrium" in wheres
    assert os.listdir(tmp_path) == ["whole.h5"]


def test_the_way_of_blocks_that_are_let_go_is_in_the_checkpoint(tmp_path, signal_after, monkeypatch):
    """Stopped during their drift: no step of the drift is repeated."""
    given, drifted, drifting = SCENES["blocks that are let go"](), path_following.PathFollower._drifted, []

    def spied(follower):
        if follower.way.drift.steps == 3:
            drifting.append(len(looked))
        return drifted(follower)

    monkeypatch.setattr(path_following.PathFollower, "_drifted", spied)
    with counted_looks() as looked:
        simulate(given, tmp_path / "whole.h5")
    path, messages = tmp_path / "run.h5", []
    with signal_after(drifting[0] + 1, match="after equilibrium"):
        simulate(given, path)
    newest, _ = Checkpoints(path).newest(read(path).run)
    assert newest.array("way.drift", np.zeros(3))[2] == 3.0
    restart(path, report=messages.append)
    assert any(line.startswith("continuing from equilibrium ") for line in messages)
    check_same(tmp_path / "whole.h5", path)


def test_a_way_comes_back_whole():
    """A path state survives its snapshot: every number, vector and list of it."""

    class Kept(dict):
        path = "kept"

        def array(self, name, like):
            assert self[name].shape == like.shape and self[name].dtype == like.dtype
            return self[name]

    rng = np.random.default_rng(2)
    numbers = {name: kind(rng.integers(1, 9)) for name, kind in path_state.NUMBERS.items()}
    given = path_state.PathState(
        *rng.normal(size=(3, 12)), **{**numbers, "gain": 0.3, "V": -0.7, "since_failure": -2, "equilibria": 3}
    )
    given.seen = [(*rng.normal(size=4).tolist(), bool(i % 2)) for i in range(4)]
    for given.drift in (None, path_state.Drift(rng.normal(size=12), 0.2, 4.0, 7)):
        found = path_state.PathState(*np.zeros((3, 12)))
        found.restore(Kept(given.snapshot()))
        for part in dataclasses.fields(path_state.PathState):
            one, other = getattr(found, part.name), getattr(given, part.name)
            if part.name == "drift" and one is not None:
                one, other = (np.append(d.motion, [d.V, d.drag, d.steps]) for d in (one, other))
            assert np.array_equal(one, other) and type(one) is type(other), part.name


def test_a_dead_load_equilibrium_goes_on_in_the_middle(tmp_path, signal_after):
    """Stopped in the many steps that a joint opening under its dead load takes."""
    load = model.Load("upper", (0.0, 0.0, -200.0), (0.0, 0.09, 0.2))
    given = scene(TILT, "convex", loads=(load,), **{**tower(), "actuators": ()})
    with counted_looks() as looked:
        simulate(given, tmp_path / "whole.h5")
    for looks in (2, 6):
        path = tmp_path / f"{looks}.h5"
        with signal_after(looks, match=f"after step {looks} of the dead-load equilibrium"):
            simulate(given, path)
        newest, _ = Checkpoints(path).newest(read(path).run)
        assert newest.array("dead_load", np.zeros(2)).tolist() == [0.0, looks]
        messages = []
        with counted_looks() as again:
            restart(path, report=messages.append)
        assert f"continuing from step {looks} of the dead-load equilibrium" in messages
        assert len(again) == len(looked) - looks
        check_same(tmp_path / "whole.h5", path)


def test_a_signal_while_it_comes_to_rest_again_leaves_the_later_checkpoint(tmp_path, signal_after):
    given = SCENES["wall pushed over"]()
    simulate(given, tmp_path / "whole.h5")
    path = tmp_path / "run.h5"
    with signal_after(12, match="after equilibrium"):
        simulate(given, path)
    kept = [Checkpoint(one).about["where"] for one in Checkpoints(path).existing()]
    with signal_after(1, match="of the dead-load equilibrium"):
        restart(path)
    assert [Checkpoint(one).about["where"] for one in Checkpoints(path).existing()] == kept
    restart(path)
    check_same(tmp_path / "whole.h5", path)


def test_blocks_that_fall_fall_after_a_restart_too(tmp_path, signal_after):
    """Stopped in viscous motion, which restarts from the positions as drawn. Since nothing had moved yet, the blocks
    were once reported to stand without any force."""
    blocks = (
        Block("floor", "stone", (2.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
        Block("below", "stone", (0.4, 0.4, 0.4), (0.0, 0.0, 0.2)),
        Block("above", "stone", (0.4, 0.4, 0.4), (0.25, 0.0, 0.6)),
    )
    given = of_stone(law(), StaticsControl(), blocks, output=model.Output(checkpoint=1e9))
    with counted_looks() as looked:
        whole = simulate(given, tmp_path / "whole.h5")
    assert whole.status == "falls"
    for looks in (1, len(looked) // 2, len(looked)):
        path = tmp_path / f"{looks}.h5"
        with signal_after(looks):
            simulate(given, path)
        assert restart(path).statics == whole.statics
        check_same(tmp_path / "whole.h5", path)  # its step count once omitted the steps before viscous motion


def test_loads_that_change_in_increments_go_on_from_their_start(tmp_path, signal_after):
    """A block pressed against a curb slides on the floor; the restart applies that load again in ten increments."""
    size, curb = (0.4, 0.4, 1.0), Block("curb", "stone", (0.2, 0.4, 0.1), (-0.3, 0.0, 0.05), fixed=True)
    floor = Block("floor", "stone", (2.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    press = model.Load("block", (-6000.0, 0.0, 0.0), (0.2, 0.0, 0.05), stages=(2,))
    given = of_stone(
        law(), StaticsControl(), (floor, curb, Block("block", "stone", size, (0.0, 0.0, 0.5))), loads=(press,),
        stages=(StaticsControl(),), output=model.Output(("joints", "frames"), checkpoint=1e9),
    )  # fmt: skip
    with counted_looks() as looked:
        simulate(given, tmp_path / "whole.h5")
    assert len(looked) > 40
    for looks in (len(looked) - 20, len(looked) - 1):
        path = tmp_path / f"{looks}.h5"
        with signal_after(looks, match="after step 0 of the dead-load equilibrium"):
            simulate(given, path)
        with counted_looks() as again:
            restart(path)
        assert len(again) > 40
        check_same(tmp_path / "whole.h5", path)


STRANGE = {
    "of no equilibrium": ("way.numbers", lambda a: np.where(a == a.max(), 0.5, a) * np.nan),
    "of too many": ("way.numbers", lambda a: a + 1e3),
    "of another scene": ("way.motion", lambda a: a[:-6]),
    "of other blocks": ("state.joints.block_a", lambda a: a[::-1].copy()),
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_checkpoint_that_does_not_fit_is_refused(tmp_path, signal_after, name):
    given, path = SCENES["wall pushed over"](), tmp_path / "run.h5"
    with signal_after(12):
        simulate(given, path)
    field, change = STRANGE[name]
    for one in Checkpoints(path).existing():
        rewritten(one, **{field: change})
    with pytest.raises(HistoryError, match="run|scenario"):
        restart(path)


# --- signals and kills of a process


@pytest.fixture(scope="module")
def long_search(tmp_path_factory):
    """A wall pushed over in many steps, and its history."""
    folder = tmp_path_factory.mktemp("search")
    given = scene(PushoverControl((0.0, 1.0, 0.0), 1e-5), "convex", **wall(9))
    given = dataclasses.replace(given, output=model.Output(checkpoint=0.05))
    (folder / "wall.toml").write_text(toml.dumps(given))
    simulate(toml.load(folder / "wall.toml"), folder / "whole.h5")
    return folder


def test_a_search_that_is_stopped_and_then_killed_goes_on(tmp_path, long_search):
    path, rng = tmp_path / "run.h5", random.Random(15)
    for stop, signum in enumerate((signal.SIGTERM, signal.SIGKILL)):
        command = ["restart", str(path)] if stop else ["run", str(long_search / "wall.toml"), "--out", str(path)]
        child = dembrick(*command, code=SLOW)
        before = rows_of(path)
        wait_for(lambda before=before: Checkpoints(path).existing() and rows_of(path) > before, child, "more rows")
        for _ in range(rng.randrange(1 << 18)):
            pass
        child.send_signal(signum)
        child.communicate(timeout=60)
        assert child.returncode in (-9, 128 + signum)
        with read(path) as file:
            assert file.status == ("running" if signum == signal.SIGKILL else "interrupted") and file.n_row > 0
    restart(path)
    check_same(long_search / "whole.h5", path)
    assert os.listdir(tmp_path) == ["run.h5"]


# --- points of a distributed joint, placed before the search of its limit load


def test_stopped_while_points_are_placed_leaves_a_history_to_restart(tmp_path, monkeypatch, capsys):
    given = lab_scenario("set4a", "distributed")
    given = dataclasses.replace(given, output=model.Output(model.CHANNELS))
    simulate(given, tmp_path / "whole.h5")
    place, path = limit_load.place_points, tmp_path / "run.h5"

    def interrupted(*_):
        raise Interrupted(signal.SIGINT)

    monkeypatch.setattr(limit_load, "place_points", interrupted)
    with pytest.raises(Interrupted, match=f"while the contact points were placed.*dembrick restart {path}") as stopped:
        simulate(given, path)
    assert stopped.value.exit_code == 130
    with read(path) as file:
        assert (file.status, file.n_row, file.title) == ("interrupted", 0, given.title)
    with pytest.raises(OutputError, match="a finished history"):  # before any points are placed
        simulate(given, path)
    monkeypatch.setattr(limit_load, "place_points", place)
    restart(path, report=print)
    assert "from the beginning" in capsys.readouterr().out
    check_same(tmp_path / "whole.h5", path)
