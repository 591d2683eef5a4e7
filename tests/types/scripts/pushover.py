"""Script of a user who pushes every block by a share of its weight; mypy reads this file, nobody runs it."""

from typing import assert_type

import dembrick

scenario = dembrick.Scenario(
    title="A column",
    gravity=(0.0, 0.0, -9.81),
    joint=dembrick.JointLaw("concave", 0.5, 1.0e10, 4.0e9),
    materials={"stone": dembrick.Material(2000.0)},
    stacks=(dembrick.Stack("column", "stone", blocks=4, box=(0.3, 0.3, 0.2), base=0.2),),
    control=dembrick.PushoverControl(direction=(1.0, 0.0, 0.0)),
)

result = dembrick.simulate(scenario, refine=True)
if isinstance(result, dembrick.Result):
    assert_type(result.yield_point, dembrick.YieldPoint)
    print(result.yield_point.V_lower, result.blocks)
print(result.to_pandas(), result.reactions)
