"""A user's script with the types that checkers and editors see; mypy reads this file, nothing runs it."""

from typing import Any, assert_type

import dembrick

scenario = dembrick.load("wall.toml")
assert_type(scenario, dembrick.Scenario)
assert_type(scenario.control, dembrick.Control)
assert_type(dembrick.load("wall.toml", {"joint.friction": 0.5}), dembrick.Scenario)

try:
    result = dembrick.simulate(scenario, refine=True)  # from a file: the type of its control is not known statically
    assert_type(result, dembrick.Result | dembrick.MotionResult | dembrick.StaticsResult)
    if isinstance(result, dembrick.Result):
        assert_type(result.yield_point.V_lower, float)
    result.to_xarray(), result.to_pandas(), result.meshes()
except dembrick.ScenarioError as error:
    print(error)
except dembrick.NotConvergedError as error:
    print(error.yield_point, error.answer)

with dembrick.read_history("wall.h5") as run:
    assert_type(run, dembrick.History)
    dataset, table = run.to_xarray(), run.to_pandas()

found = dembrick.limit("wall.toml")
if isinstance(found, dembrick.LimitResult):
    print(found.load_factor)


@dembrick.joint_law(memory="slipped", slip_distance=1e-3)
def own_law(move: Any, law: Any, memory: Any) -> tuple[float, float, float, float]:
    return law.normal_stiffness * max(move.penetration, 0.0), 0.0, 0.0, 0.0


assert_type(own_law, dembrick.CustomLaw)
assert_type(own_law.with_parameters(slip_distance=2e-3), dembrick.CustomLaw)
dembrick.simulate(scenario, law=own_law)
