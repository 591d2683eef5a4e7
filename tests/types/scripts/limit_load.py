"""Script of a user who asks for a limit load; mypy reads this file, nobody runs it."""

from typing import assert_type

import dembrick

scenario = dembrick.Scenario(
    title="A column",
    gravity=(0.0, 0.0, -9.81),
    joint=dembrick.JointLaw("concave", 0.5, 1.0e10, 4.0e9),
    materials={"stone": dembrick.Material(2000.0)},
    stacks=(dembrick.Stack("column", "stone", blocks=4, box=(0.3, 0.3, 0.2), base=0.2),),
    actuators=(dembrick.Actuator("jack", "column.4", point=(0.0, 0.0, 0.7), direction=(1.0, 0.0, 0.0)),),
    control=dembrick.YieldControl(tolerance=1.0e-4),
)
assert_type(scenario, dembrick.Scenario[dembrick.YieldControl])

result = dembrick.simulate(scenario, bound=True)
assert_type(result.yield_point, dembrick.YieldPoint)
assert_type(result.yield_point.V_lower, float)
print(result.yield_point.mechanism, result.load.max(), result.theory)
if isinstance(result, dembrick.Result):
    print(result.blocks, result.displacement[-1])
