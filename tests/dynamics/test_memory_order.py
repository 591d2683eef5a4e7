"""Blocks in random order: the compiled loop stores them in an order of its own, which no result shows."""

import dataclasses

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import shipped, toml
from dembrick.scenario.model import Output
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.simulation.dynamics import memory_order
from dembrick.simulation.dynamics.memory_order import ALIKE, neighbours_together
from dembrick.simulation.dynamics.state import moving_state
from helpers.restart_cases import check_same, stop_at_look


def thrown_over(courses, blocks, k_n=1e10, **more):
    """A dry wall on a ground that jerks under it: as drawn, and with its blocks in random order."""
    stiff = [f"joint.normal_stiffness={k_n}", f"joint.shear_stiffness={0.4 * k_n}"]
    changes = [f"walls.0.courses={courses}", f"walls.0.blocks={blocks}", *stiff]
    scenario = toml.load(shipped.folder() / "wall_collapse.toml", changes)
    drawn = dataclasses.replace(scenario, **more)
    given = drawn.all_blocks
    turn = np.random.default_rng(5).permutation(len(given))
    return drawn, dataclasses.replace(drawn, walls=(), blocks=tuple(given[i] for i in turn))


@pytest.fixture
def own_order(monkeypatch):
    """Make scenes of any size run in an order of their own, or none."""

    def choose(wanted):
        monkeypatch.setattr(memory_order, "NEAR", -1.0 if wanted else np.inf)
        monkeypatch.setattr(memory_order, "NEARER", np.inf)

    return choose


def test_large_scenes_in_random_order_run_in_one_where_neighbours_are_near():
    drawn, random = thrown_over(40, 50)
    near, far = (moving_state(build.assemble(one)) for one in (drawn, random))
    assert near.order is None and far.order is not None
    assert sorted(far.order.order) == list(range(len(far.bodies.mass)))
    np.testing.assert_array_equal(far.order.row[far.order.order], np.arange(len(far.order.order)))
    apart = np.abs(far.links.host.astype(int) - far.links.other).mean()
    rows = far.links.ends.astype(int)
    free = far.order.bodies.mass[rows].max(axis=1) < 100.0  # all except the joints on the ground
    near.links.share(), far.links.share()
    assert apart > 600.0 and np.abs(rows[:, 0] - rows[:, 1])[free].mean() < 60.0
    # joints are ordered as their blocks are, and equal ones share tiles
    assert np.abs(np.diff(rows.min(axis=1).ravel())).mean() < 10.0
    assert len(np.unique(far.links.like)) < 0.3 * len(far.links.like) and len(far.links.host) > 8 * ALIKE


def test_neighbours_stand_together_beside_a_floor_under_all():
    """Forty towers of five blocks on one floor and a block that touches nothing: every tower stays contiguous."""
    n, rng = 202, np.random.default_rng(3)
    number = rng.permutation(n)  # 0 is the floor, 201 the lone block
    towers = number[1:201].reshape(40, 5)
    a = np.concatenate([np.full(40, number[0]), towers[:, :-1].ravel()])
    b = np.concatenate([towers[:, 0], towers[:, 1:].ravel()])
    order = neighbours_together(a, b, np.arange(n) == number[0])
    assert sorted(order) == list(range(n))
    row = np.argsort(order)
    assert (np.abs(np.diff(row[towers], axis=1)) <= 2).all()  # the floor may stand in between


def short(formulation, **output):
    """A small wall with a tie that is thrown over, until the first blocks have come apart; everything is recorded."""
    control = dataclasses.replace(thrown_over(3, 3)[0].control, duration=0.25 if formulation == "convex" else 0.6)
    ends = TieEnd("ground", (0.15, 0.6, 0.0)), TieEnd("wall.4.1", (0.15, 0.1, 0.35))
    output = Output(("joints", "energy", "frames", "velocity", "contacts"), rows=40, frames=20, **output)
    _, random = thrown_over(5, 2, 1e8, control=control, output=output, ties=(Tie(ends, 1e3),))
    return dataclasses.replace(random, joint=dataclasses.replace(random.joint, formulation=formulation))


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_every_number_of_a_run_is_that_without_it(own_order, formulation):
    """With and without an own order all numbers agree bit for bit, new contacts included, except energies, which are
    sums over blocks and tiles."""
    runs = []
    for own in (False, True):
        own_order(own)
        runs.append(simulate(short(formulation)))
        assert (runs[-1].run.motion.state.order is not None) == own
    plain, ordered = runs
    for one, other in ((plain.rows, ordered.rows), (plain.frames, ordered.frames)):
        assert set(one) == set(other)
        for name, values in one.items():
            if name == "energy":
                size = max(np.abs(energy).max() for energy in values.values())
                for term, energy in values.items():
                    np.testing.assert_allclose(other[name][term], energy, rtol=0.0, atol=1e-10 * size, err_msg=term)
            else:
                np.testing.assert_equal(other[name], values, err_msg=name)
    assert formulation == "convex" or plain.frames["new_contacts"]["count"].max() > 1
    assert ordered.as_dict()["collapse"] == plain.as_dict()["collapse"]


def test_a_run_in_its_own_order_is_stopped_and_restarted(own_order, tmp_path):
    own_order(True)
    given = short("concave", checkpoint=1e9)
    simulate(given, tmp_path / "whole.h5")
    stop_at_look(given, tmp_path / "parts.h5", 25)
    restart(tmp_path / "parts.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "parts.h5")


def test_random_order_gives_the_answers_of_the_drawn_one(own_order):
    """Displacements agree up to the time step, whose bound depends on the order by some parts in a thousand."""
    control = dataclasses.replace(thrown_over(3, 3)[0].control, duration=0.1)
    drawn, random = thrown_over(6, 5, control=control)
    own_order(True)
    found = [simulate(one) for one in (drawn, random)]
    names = [list(one.assembly.names) for one in found]
    turn = [names[1].index(name) for name in names[0]]
    first, second = (one.frames["displacement"][-1] for one in found)
    size = np.abs(first).max()
    assert size > 0.01
    np.testing.assert_allclose(second[turn], first, rtol=0.0, atol=2e-3 * size)
    assert np.abs(second - first).max() > 0.1 * size  # without the permutation they differ


def test_a_head_drives_blocks_that_the_loop_has_in_another_order(own_order, few):
    changes = ["control.large_displacements=true", "control.travel=2e-5", "joint.formulation=concave"]
    given = toml.load(shipped.folder() / "set4a_curve.toml", changes)
    orders = []
    for blocks in (given.blocks, given.blocks[::-1]):
        own_order(False)
        plain = simulate(dataclasses.replace(given, blocks=blocks, text=None))
        own_order(True)
        ordered = simulate(dataclasses.replace(given, blocks=blocks, text=None))
        np.testing.assert_array_equal(ordered.rows["load"], plain.rows["load"])
        assert plain.rows["load"].max() > 100.0
        orders.append(ordered.run.motion.state.order.order.tolist())
    assert [1, 0] in orders
