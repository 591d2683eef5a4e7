"""Script of a user who tilts a table; mypy reads this file, nobody runs it."""

from typing import assert_type

import dembrick

scenario = dembrick.Scenario(
    title="A column",
    gravity=(0.0, 0.0, -9.81),
    joint=dembrick.JointLaw("concave", 0.5, 1.0e10, 4.0e9),
    materials={"stone": dembrick.Material(2000.0)},
    stacks=(dembrick.Stack("column", "stone", blocks=4, box=(0.3, 0.3, 0.2), base=0.2),),
    control=dembrick.TiltControl(axis=(0.0, 1.0, 0.0)),
)

result = dembrick.simulate(scenario)
assert_type(result, dembrick.Result | dembrick.MotionResult)
if result.yield_point is not None:  # found by a search, not in real time
    print(result.yield_point.V_lower)
if isinstance(result, dembrick.Result):
    assert_type(result.yield_point, dembrick.YieldPoint)
    print(result.load.max())
if result.collapse is not None:
    print(result.collapse["angle"])
