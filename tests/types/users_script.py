"""What a type checker and an editor know of a user's script; mypy reads this file, nobody runs it."""

from typing import assert_type

import dembrick

scenario = dembrick.load("wall.toml")
assert_type(scenario, dembrick.Scenario)
assert_type(scenario.control, dembrick.Control)

try:
    result = dembrick.simulate(scenario, refine=True)  # of a file: its control is not known before it is read
    assert_type(result, dembrick.Result | dembrick.MotionResult | dembrick.StaticsResult)
    if isinstance(result, dembrick.Result):
        assert_type(result.yield_point.V_lower, float)
except dembrick.ScenarioError as error:
    print(error)
except dembrick.NotConvergedError as error:
    print(error.yield_point, error.answer)

with dembrick.read_history("wall.h5") as run:
    assert_type(run, dembrick.History)
    run.to_xarray()
    run.to_pandas()

found = dembrick.limit("wall.toml")
if isinstance(found, dembrick.LimitResult):
    print(found.load_factor)
