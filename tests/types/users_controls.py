"""User scripts for every kind of control, which determines the type of the result; mypy reads this file, nothing runs
it."""

from typing import Any, assert_type

import dembrick

DOWN, X = (0.0, 0.0, -9.81), (1.0, 0.0, 0.0)
LAW = dembrick.JointLaw("concave", 0.5, 1.0e10, 4.0e9)
STONE = {"stone": dembrick.Material(2000.0)}
COLUMN = (dembrick.Stack("column", "stone", blocks=4, box=(0.3, 0.3, 0.2), base=0.2),)
JACK = (dembrick.Actuator("jack", "column.4", point=(0.0, 0.0, 0.7), direction=X),)


def limit_load() -> None:
    control = dembrick.YieldControl(tolerance=1.0e-4)
    scenario = dembrick.Scenario("limit", DOWN, LAW, STONE, stacks=COLUMN, actuators=JACK, control=control)
    assert_type(scenario, dembrick.Scenario[dembrick.YieldControl])
    result = dembrick.simulate(scenario, bound=True)
    assert_type(result.yield_point, dembrick.YieldPoint)
    assert_type(result.yield_point.V_lower, float)
    print(result.yield_point.mechanism, result.load.max(), result.theory)
    if isinstance(result, dembrick.Result):
        print(result.blocks, result.displacement[-1])


def constant_rate() -> None:
    control = dembrick.DisplacementControl(rate=1.0e-4, travel=1.0e-3)
    scenario = dembrick.Scenario("rate", DOWN, LAW, STONE, stacks=COLUMN, actuators=JACK, control=control)
    result = dembrick.simulate(scenario, "test.h5", force="own")
    assert_type(result.yield_point, dembrick.YieldPoint)
    print(result.yield_point.V_peak, result.load.max())


def statics() -> None:
    scenario = dembrick.Scenario("stands", DOWN, LAW, STONE, stacks=COLUMN, control=dembrick.StaticsControl())
    result = dembrick.simulate(scenario)
    assert_type(result, dembrick.StaticsResult)
    assert_type(result.statics, dict[str, Any])
    print(result.status, result.plain_answer)


def tilting_table() -> None:
    control = dembrick.TiltControl(axis=(0.0, 1.0, 0.0))
    result = dembrick.simulate(dembrick.Scenario("table", DOWN, LAW, STONE, stacks=COLUMN, control=control))
    assert_type(result, dembrick.Result | dembrick.MotionResult)
    if result.yield_point is not None:  # found by a search, not in real time
        print(result.yield_point.V_lower)
    if isinstance(result, dembrick.Result):
        assert_type(result.yield_point, dembrick.YieldPoint)
        print(result.load.max())
    if result.collapse is not None:
        print(result.collapse["angle"])


def pushover() -> None:
    control = dembrick.PushoverControl(direction=X)
    scenario = dembrick.Scenario("push", DOWN, LAW, STONE, stacks=COLUMN, control=control)
    result = dembrick.simulate(scenario, refine=True)
    if isinstance(result, dembrick.Result):
        assert_type(result.yield_point, dembrick.YieldPoint)
        print(result.yield_point.V_lower, result.blocks)
    print(result.to_pandas(), result.reactions)


def base_motion() -> None:
    control = dembrick.BaseMotionControl(duration=1.0, direction=X, sine=dembrick.Sine(1.0, 2.0))
    scenario = dembrick.Scenario("shaken", DOWN, LAW, STONE, stacks=COLUMN, control=control)
    result = dembrick.simulate(scenario, "shaken.h5")
    assert_type(result, dembrick.MotionResult)
    print(result.status, result.greatest_displacement)


def settlement() -> None:
    control = dembrick.SettlementControl(supports=("column.base",), displacement=(0.0, 0.0, -0.01))
    result = dembrick.simulate(dembrick.Scenario("settled", DOWN, LAW, STONE, stacks=COLUMN, control=control))
    assert_type(result, dembrick.MotionResult)
    if result.settlement is not None:  # a path of equilibria, not in real time
        print(result.settlement["reaction"], result.reaction_error)


def free_motion() -> None:
    control = dembrick.DynamicControl(duration=1.0)
    result = dembrick.simulate(dembrick.Scenario("free", DOWN, LAW, STONE, stacks=COLUMN, control=control))
    assert_type(result, dembrick.MotionResult)
    print(result.displacement[:, 0].max(), result.fallen)
