"""What a type checker and an editor know of a user's script; mypy reads this file, nobody runs it."""

from typing import assert_type

import dembrick
from dembrick.history.reader import History
from dembrick.runs.motion_result import MotionResult
from dembrick.runs.result import Result
from dembrick.runs.statics_result import StaticsResult
from dembrick.scenario.controls import Control
from dembrick.scenario.model import Scenario

scenario = dembrick.load("wall.toml")
assert_type(scenario, Scenario)
assert_type(scenario.control, Control)

result = dembrick.simulate(scenario, refine=True)
assert_type(result, Result | MotionResult | StaticsResult)
if isinstance(result, Result):
    assert_type(result.yield_point.V_lower, float)

with dembrick.read_history("wall.h5") as run:
    assert_type(run, History)
