"""Script of a user who shakes the supports; mypy reads this file, nobody runs it."""

from typing import assert_type

import dembrick

scenario = dembrick.Scenario(
    title="A column",
    gravity=(0.0, 0.0, -9.81),
    joint=dembrick.JointLaw("concave", 0.5, 1.0e10, 4.0e9),
    materials={"stone": dembrick.Material(2000.0)},
    stacks=(dembrick.Stack("column", "stone", blocks=4, box=(0.3, 0.3, 0.2), base=0.2),),
    control=dembrick.BaseMotionControl(duration=1.0, direction=(1.0, 0.0, 0.0), sine=dembrick.Sine(1.0, 2.0)),
)

result = dembrick.simulate(scenario, "shaken.h5")
assert_type(result, dembrick.MotionResult)
print(result.status, result.greatest_displacement)
