"""Script of a user who asks whether blocks stand; mypy reads this file, nobody runs it."""

from typing import Any, assert_type

import dembrick

scenario = dembrick.Scenario(
    title="A column",
    gravity=(0.0, 0.0, -9.81),
    joint=dembrick.JointLaw("concave", 0.5, 1.0e10, 4.0e9),
    materials={"stone": dembrick.Material(2000.0)},
    stacks=(dembrick.Stack("column", "stone", blocks=4, box=(0.3, 0.3, 0.2), base=0.2),),
    control=dembrick.StaticsControl(),
)

result = dembrick.simulate(scenario)
assert_type(result, dembrick.StaticsResult | dembrick.DeformedRestResult)
assert_type(result.statics, dict[str, Any])
print(result.status, result.plain_answer)
