"""Settlement controls: reading, writing, and refusals in one clear sentence."""

import re

import pytest

from dembrick.assembly import build
from dembrick.errors import ScenarioError
from dembrick.runs.drivers import driver_of
from dembrick.scenario import toml
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.time_functions import SupportPath, Turn
from helpers.scenario_text import header

ARCH = (
    header(friction=0.7, normal_stiffness=1e10)
    + """
[[arches]]
name = "arch"
material = "stone"
radius = 1.5
thickness = 0.3
depth = 0.5
voussoirs = 4
[control]
kind = "settlement"
"""
)
SPREAD = 'supports = ["arch.right"]\ndisplacement = [0.1, 0.0, 0.0]\n'


def planned(keys: str) -> None:
    scenario = toml.loads(ARCH + keys)
    driver_of(scenario.control).plan(scenario, build.assemble(scenario))


def test_what_a_settlement_says_of_itself():
    turn = "rotation = { axis = [0, 2, 0], angle = -3, point = [1, 0, 0] }"
    control = toml.loads(ARCH + SPREAD + f'motions = [{{ supports = ["arch.left"], {turn} }}]').control
    assert control == SettlementControl(
        ("arch.right",), (0.1, 0.0, 0.0),
        motions=(SupportPath(("arch.left",), rotation=Turn((0.0, 1.0, 0.0), -3.0, (1.0, 0.0, 0.0))),),
    )  # fmt: skip
    assert [path.supports for path in control.support_paths] == [("arch.right",), ("arch.left",)]
    assert control.quasi_static and control.curve.unit == "N"
    scenario = toml.loads(ARCH + SPREAD + f'motions = [{{ supports = ["arch.left"], {turn} }}]')
    assert toml.loads(toml.dumps(scenario)) == scenario


REFUSED = {
    "nothing moves": ("", "name the supports that move, or give motions"),
    "supports without a motion": (
        'supports = ["arch.right"]', "they need a displacement or a rotation that is not zero",
    ),
    "a displacement of nothing": (
        'supports = ["arch.right"]\ndisplacement = [0, 0, 0]', "need a displacement or a rotation"
    ),
    "a displacement of nobody": ("displacement = [0.1, 0, 0]", "supports must name the blocks or groups that move"),
    "unknown name": (SPREAD.replace("arch.right", "arch.rihgt"), "'arch.rihgt' is not the name", "'arch.right'?"),
    "no support": (SPREAD.replace("arch.right", "arch.2"), "moves 'arch.2', which is not a support", "fixed = true"),
    "a group that is not fixed": (SPREAD.replace("arch.right", "arch"), "which is not a support"),
    "two ways at once": (
        SPREAD + 'motions = [{ supports = ["arch.right"], displacement = [-0.1, 0, 0] }]',
        "support 'arch.right' has two motions at once", "name it in only one of the motions",
    ),
    "a rate without time": (SPREAD + "rate = 0.1", "rate = 0.1 is out of range", "quasi_static = false"),
    "time without a rate": (SPREAD + "quasi_static = false", "missing key 'rate'", "needs it, in m/s"),
    "a rate of nothing": (SPREAD + "quasi_static = false\nrate = 0", "greater than 0 m/s"),
    "a turn about nothing": (
        'supports = ["arch.right"]\nrotation = { axis = [0, 0, 0], angle = 3 }', "rotation in [control]: axis",
    ),
    "a turn by too much": (
        'supports = ["arch.right"]\nrotation = { axis = [0, 1, 0], angle = 300 }', "between -90 and 90 deg",
    ),
    "a turn that is a number": ('supports = ["arch.right"]\nrotation = 3', "must be a table"),
    "motions that are no list": ('motions = "arch.right"', "motions must be a list of tables"),
    "a motion of nobody": ("motions = [{ supports = [], displacement = [1, 0, 0] }]", "must name a block or a group"),
    "a tolerance of nothing": (SPREAD + "tolerance = 0", "between 1e-5 and 0.1"),
    "duration": (SPREAD + "duration = 1.0", "kind 'settlement' has no 'duration'", "a key of 'dynamic', 'base-motion'"),
    "a load that varies": (
        SPREAD + '[[loads]]\nblock = "arch.2"\nforce = [1, 0, 0]\nsine = { amplitude = 1, frequency = 2 }',
        "varies with time, which a test of kind 'settlement' does not allow",
    ),
    "an actuator": (
        SPREAD + '[[actuators]]\nname = "a"\nblock = "arch.2"\npoint = [-0.574, 0, 1.386]\ndirection = [1, 0, 0]',
        "control kind 'settlement' has no use for [[actuators]]",
    ),
}  # fmt: skip


@pytest.mark.parametrize("keys, parts", [(keys, parts) for keys, *parts in REFUSED.values()], ids=REFUSED)
def test_refused(keys, parts):
    with pytest.raises(ScenarioError) as caught:
        planned(keys)
    message = str(caught.value)
    for part in parts:
        assert part in message
    assert "\n" not in message and not re.search(r"Traceback|None", message)


def test_one_motion_named_twice_is_one():
    planned(SPREAD + 'motions = [{ supports = ["arch.right"], displacement = [0.1, 0, 0] }]')
