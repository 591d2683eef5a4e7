"""Warnings about keys that have no effect in a run, each with its reason, and none about keys that have one."""

import pytest

import dembrick
from dembrick.assembly.build import assemble
from dembrick.scenario import toml
from helpers.scenario_text import block, header, jack

FLOOR = block("floor", (0.0, 0.0, -0.05), more="fixed = true")
TILT, PUSH = 'kind = "tilt"\naxis = [0.0, 1.0, 0.0]\n', 'kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n'
IN_TIME = "rate = 1.0\ndisplacement = 0.01\n"
SHAKEN = 'kind = "base-motion"\nduration = 1.0\ndirection = [1.0, 0.0, 0.0]\n'
THROWN = "velocity = [1.0, 0.0, 0.0]"


@pytest.mark.parametrize(
    "control, stone, solver, said",
    [
        (f"{TILT}rate = 1.0\nquasi_static = true\ndamping = 0.2", "", "",
         ["control.rate = 1 ", "control.damping = 0.2 "]),
        (f"{PUSH}damping = 0.1", "", "step_factor = 0.5", ["control.damping = 0.1 ", "solver.step_factor = 0.5 "]),
        (f"{TILT}{IN_TIME}tolerance = 0.01", "", "step_factor = 0.5", ["control.tolerance = 0.01 "]),
        (f"{TILT}{IN_TIME}large_displacements = true", "", "", ["control.large_displacements = true "]),
        (f"{TILT}{IN_TIME}damping = 0.2", "", "", []),
        ('kind = "statics"', THROWN, "step_factor = 0.5", ["solver.step_factor = 0.5 ", "the velocity of 'stone' "]),
        (f"{SHAKEN}scale = 0.0\nsine = {{ amplitude = 1.0, frequency = 2.0 }}", THROWN, "",
         ["the velocity of 'stone' ", "nothing shakes"]),
        ('kind = "dynamic"\nduration = 1.0', THROWN, "step_factor = 0.5", []),
        ('kind = "yield"', THROWN, "", ["the velocity of 'stone' has no effect under control.kind = 'yield'"]),
        ('kind = "displacement"\nrate = 1e-4\ntravel = 1e-5\nlarge_displacements = true', "", "step_factor = 0.5",
         ["control.rate = 0.0001 has no effect"]),
        ('kind = "displacement"\nrate = 1e-4\ntravel = 1e-5', "", "step_factor = 0.5", []),
    ],
)  # fmt: skip
def test_what_does_nothing_is_said(control, stone, solver, said):
    pushed = jack("stone", (0.0, 0.0, 0.05)) if "yield" in control or "travel" in control else ""
    text = header() + f"[solver]\n{solver}\n" + FLOOR + block("stone", (0.0, 0.0, 0.05), more=stone) + pushed
    warnings = assemble(toml.loads(f"{text}[control]\n{control}\n")).warnings
    assert len(warnings) == len(said)
    assert all(one in warning for one, warning in zip(said, warnings, strict=True))
    assert all("has no effect" in warning or "nothing shakes" in warning for warning in warnings)


def test_what_does_nothing_in_a_stage_is_said():
    """Every stage is checked, not only the last; a step factor that an earlier stage uses is not reported."""
    idle = f"{TILT}rate = 1.0\nquasi_static = true\ndamping = 0.2\n"
    moves = 'kind = "displacement"\nrate = 1e-4\ntravel = 1e-5\n'
    text = header() + "[solver]\nstep_factor = 0.5\n" + FLOOR + block("stone", (0.0, 0.0, 0.05))
    text += jack("stone", (0.0, 0.0, 0.05))
    stages = f"[[stages]]\n{moves}[[stages]]\n{idle}[control]\n{PUSH}damping = 0.1\n"
    said = assemble(toml.loads(text + stages)).warnings
    wanted = ["control.damping = 0.1 has no effect", "rate = 1 of stage 2 has", "damping = 0.2 of stage 2 has"]
    assert [one.startswith(begins) for one, begins in zip(said, wanted, strict=True)] == [True] * 3


def test_velocities_do_not_count_where_blocks_begin_at_rest():
    """On a shaken base initial velocities are ignored, for a block on the floor and for one in the air beside it."""
    text = (
        header() + FLOOR + block("stone", (0.0, 0.0, 0.05), more=THROWN) + block("away", (2.0, 0.0, 3.0), more=THROWN)
    )
    sine = "sine = { amplitude = 1e-3, frequency = 2.0 }"
    found = dembrick.simulate(toml.loads(f"{text}[control]\n{SHAKEN.replace('1.0', '0.1', 1)}{sine}\n"), record=False)
    assert abs(found.displacement[:, 0]).max() < 1e-4
