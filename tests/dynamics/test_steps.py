"""A run in real time as a Python loop: against closed forms, against the same run in one piece, and ended early."""

from __future__ import annotations

import numpy as np
import pytest

import dembrick
from dembrick.errors import ScenarioError

MU, G, MASS = 0.3, 9.81, 2000.0 * 0.3 * 0.2 * 0.1


def scene(control, **more) -> dembrick.Scenario:
    floor = dembrick.Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = dembrick.Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05))
    law = dembrick.JointLaw("concave", MU, 1e11, 4e10)  # stiff, so that the block slides almost at once
    return dembrick.Scenario(
        "steps", (0.0, 0.0, -G), law, {"stone": dembrick.Material(2000.0)}, (floor, block), control, **more
    )


def test_a_block_slides_under_the_load_of_a_callback():
    """From 0.05 s on the push is twice the friction: the block gains mu g, and slows down by it after 0.1 s."""

    def loads(step):
        return {"block": (2.0 * MU * MASS * G, 0.0, 0.0)} if 0.05 <= step.time < 0.1 else None

    states = list(dembrick.steps(scene(dembrick.DynamicControl(0.2)), 1e-3, loads))
    at = {name: next(s for s in states if s.time >= t) for name, t in (("begin", 0.05), ("end", 0.1))}
    pushed = at["end"].time - at["begin"].time
    block = states[0].of("block")
    assert at["end"].velocity[block, 0] == pytest.approx(MU * G * pushed, rel=2e-3)
    # sliding on takes as long and as far as being pushed
    assert states[-1].displacement[block, 0] == pytest.approx(MU * G * pushed**2, rel=5e-3)
    assert abs(states[-1].velocity[block, 0]) < 1e-4
    assert states[-1].joint_forces[0, 0] == pytest.approx(MASS * G, rel=1e-3)


def test_the_states_are_those_of_the_run():
    output = dembrick.Output(("frames",))
    scenario = scene(dembrick.DynamicControl(0.05), output=output, loads=(dembrick.Load("block", (80.0, 0.0, 0.0)),))
    whole = dembrick.simulate(scenario)
    *_, last = dembrick.steps(scenario, 0.0123)
    assert last.time == pytest.approx(0.05, rel=1e-3)
    np.testing.assert_array_equal(last.displacement, whole.frames["displacement"][-1])
    assert last.position[1] == pytest.approx(whole.assembly.position[1] + last.displacement[1])
    assert last.position[1, 2] == pytest.approx(0.05, abs=1e-6)


def test_leaving_the_loop_ends_the_run():
    for step in dembrick.steps(scene(dembrick.DynamicControl(1e3)), 1e-3):
        if step.time > 0.005:
            break
    assert step.time < 0.01


def test_what_has_no_time_is_refused():
    with pytest.raises(ScenarioError, match="search for equilibria"):
        dembrick.steps("set4a", 0.01)
    with pytest.raises(ScenarioError, match="longer than 0 s"):
        dembrick.steps(scene(dembrick.DynamicControl(0.1)), 0.0)
    with pytest.raises(ScenarioError, match="'floor', which is not a free block"):
        list(dembrick.steps(scene(dembrick.DynamicControl(0.1)), 0.01, lambda step: {"floor": (1.0, 0.0, 0.0)}))


@pytest.mark.parametrize(
    "force", [5.0, [5.0], "abc", [1.0, 2.0, 3.0, 4.0], [1.0, 2.0], [[1.0, 2.0, 3.0]], [1.0, 2.0, float("nan")],
              ["a", "b", "c"], None, [True, False, True], [1.0, [2.0], 3.0], {"x": 1.0}],
)  # fmt: skip
def test_a_force_that_is_no_three_numbers_is_refused(force):
    """A single number would act along all three axes."""
    with pytest.raises(ScenarioError, match=r"loads gives block 'block' the force .*; it must be three numbers"):
        for _ in dembrick.steps(scene(dembrick.DynamicControl(0.02)), 0.01, loads=lambda _: {"block": force}):
            pass


@pytest.mark.parametrize("given", [[1.0, 2.0, 3.0], 5.0, "block", [("block", (1.0, 0.0, 0.0))]])
def test_loads_that_are_no_table_are_refused(given):
    with pytest.raises(ScenarioError, match="it must return a table of forces by block name, or None"):
        for _ in dembrick.steps(scene(dembrick.DynamicControl(0.02)), 0.01, loads=lambda _: given):
            pass


@pytest.mark.parametrize("every", [float("inf"), float("nan"), 0.0, -1.0, "a", None, True, 10**400])
def test_an_interval_that_is_no_time_is_refused(every):
    with pytest.raises(ScenarioError, match="every = "):
        dembrick.steps(scene(dembrick.DynamicControl(0.02)), every)


def test_forces_as_arrays_lists_and_tuples_are_the_same():
    ends = []
    for force in ([5, 0, 0], (5.0, 0.0, 0.0), np.array([5.0, 0.0, 0.0], "f4")):
        *_, last = dembrick.steps(
            scene(dembrick.DynamicControl(0.02)), 0.01, loads=lambda _, force=force: {"block": force}
        )
        ends.append(last.position)
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_array_equal(ends[0], ends[2])
