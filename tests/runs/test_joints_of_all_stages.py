"""All stages have the same joints and contact points, whether blocks move in a stage or not."""

import os

import pytest

from dembrick.assembly.build import assemble
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from dembrick.scenario.stages import at_stage
from helpers.restart_cases import stop_in_stages
from helpers.scenario_text import block, header

MU = 0.5
W = 2000.0 * 9.81 * 0.06 * 0.1  # N, of two parts that rest on 0.06 m2
REST = 'kind = "statics"\n'
DEFORMED = REST + "large_displacements = true\n"
SEARCH = 'kind = "yield"\ntolerance = 4e-3\n'
SINKS = 'kind = "settlement"\nsupports = ["floor"]\ndisplacement = [0.0, 0.0, -1e-4]\n'
TIME = 'kind = "dynamic"\nduration = 0.002\n'


def scenario(formulation, *stages):
    """A stone of two parts, 0.2 m and 0.1 m wide, on a floor, pushed at its foot in line with its weight."""
    parts = ", ".join(f"{{ box = [{w}, 0.2, 0.1], position = [{x}, 0.0, 0.05] }}" for w, x in ((0.2, 0.0), (0.1, 0.15)))
    return toml.loads(
        header(formulation, MU)
        + block("floor", (0.0, 0.0, -0.1), (2.0, 2.0, 0.2), "fixed = true")
        + f'[[blocks]]\nname = "stone"\nmaterial = "stone"\nparts = [{parts}]\n'
        + '[[actuators]]\nname = "jack"\nblock = "stone"\npoint = [0.05, 0.0, 1e-3]\ndirection = [0.0, 1.0, 0.0]\n'
        + "".join(f"[[stages]]\n{stage}" for stage in stages[:-1])
        + f"[control]\n{stages[-1]}",
        "staged.toml",
    )


@pytest.mark.parametrize(
    ("formulation", "stages"),
    [
        *[(formulation, stages) for formulation in ("concave", "convex") for stages in (
            (REST, DEFORMED, SEARCH), (SEARCH, DEFORMED), (SINKS, SEARCH), (SEARCH, REST, TIME)
        )],
        ("distributed", (REST, DEFORMED, SEARCH)),
        ("distributed", (SEARCH, DEFORMED)),
    ],
)  # fmt: skip
def test_a_stone_of_two_parts_slides_by_its_weight_in_every_stage(formulation, stages):
    """V = mu W. The parts form one joint if no stage moves, else two; distributed points follow a stage's tolerance."""
    found = simulate(scenario(formulation, *stages), record=False)
    answers = [stage["yield_point"] for stage in found.stages if stage["kind"] == "yield"]
    answers += [found.as_dict()["yield_point"]] if stages[-1] == SEARCH else []
    assert len(answers) == 1 and answers[0]["V"] == pytest.approx(MU * W, rel=2e-3)
    assert answers[0]["V_lower"] <= MU * W * (1 + 1e-5) and answers[0]["V_upper"] >= MU * W * (1 - 1e-5)


def test_they_are_those_of_the_stages_that_move_and_of_the_finest_tolerance():
    given = scenario("distributed", 'kind = "yield"\ntolerance = 1e-4\n', SEARCH, SINKS)
    tables = [assemble(at_stage(given, number)) for number in (1, 2, 3)] + [assemble(given)]
    alone = assemble(scenario("distributed", SINKS))
    assert {len(table.joints) for table in tables} == {len(alone.joints)} == {2}
    counts = {len(table.contact_points.area) for table in tables}
    assert len(counts) == 1 and counts.pop() > 4 * len(alone.contact_points.area)


def test_a_run_that_stops_between_them_goes_on_to_the_same(tmp_path):
    given, path = scenario("convex", REST, SINKS, SEARCH), os.fspath(tmp_path / "stopped.h5")
    whole = simulate(given, record=False)
    stop_in_stages(given, path, lambda where, _: where.startswith("stage 2"), often=False)
    assert restart(path).yield_point.V == whole.yield_point.V
