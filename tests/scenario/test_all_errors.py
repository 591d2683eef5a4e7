"""All errors of a scenario are reported at once, each with its line."""

from __future__ import annotations

import pytest

from dembrick.errors import ScenarioError
from dembrick.scenario import toml
from dembrick.scenario.text_files import line_of

TEXT = """title = "bad"
gravity = [0.0, 0.0, -9.81]

[joint]
formulation = "convex"
frictoin = 0.64
normal_stiffness = -1.0
shear_stiffness = 4.0e9
cohesion = -3.0

[materials.tuff]
density = 1500.0

[[blocks]]  # the floor
name = "lower"
material = "tuff"
box = [0.3, 0.2, 0.1]
position = [
    [0.0],
]
fixed = true

[[blocks]]
name = "upper"
material = "tufff"
box = [0.3, 0.2, -0.1]
position = [0.0, 0.0, 0.05]

[[loads]]
block = "uper"
force = [0.0, 0.0, -1.0]

[control]
kind = "displacement"
tolerance = 1e-3
rate = -1.0
travel = 1e-4
"""


def messages(text: str) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        toml.loads(text, "wall.toml")
    return str(caught.value).split("\n")


def test_errors_of_all_tables_come_together_with_their_lines():
    told = messages(TEXT)
    starts = [
        "unknown key 'frictoin' in [joint] of wall.toml:6; did you mean 'friction'?",
        "wall.toml:18: [[blocks]] number 1: position",
        "wall.toml:26: [[blocks]] number 2: box",
        "wall.toml:35: [control]: kind 'displacement' has no 'tolerance', which is a key of 'yield'",
        "wall.toml:36: [control]: rate",
    ]
    assert len(told) == len(starts)
    for line, start in zip(told, starts, strict=True):
        assert line.startswith(start)


def test_an_optional_value_that_is_wrong_does_not_hide_the_next():
    text = TEXT.replace("frictoin", "friction").replace("-1.0\nshear", "1e10\nshear")
    text = text.replace("cohesion = -3.0", "cohesion = -3.0\ndilation = -1.0")
    told = [line for line in messages(text) if "[joint]" in line]
    assert [line.split(" = ")[0] for line in told] == [
        "wall.toml:9: [joint]: cohesion",
        "wall.toml:10: [joint]: dilation",
    ]


def test_references_are_told_together_after_the_tables_are_right():
    text = TEXT.replace("frictoin", "friction").replace("= -1.0\n", "= 1.0e9\n").replace("cohesion = -3.0\n", "")
    text = text.replace("    [0.0],\n]", "0.0, 0.0, -0.05]").replace("-0.1]", "0.1]")
    text = text.replace("tolerance = 1e-3\n", "").replace("rate = 1.0e9", "rate = 1e-5")
    told = messages(text)
    assert [line.split(" = ")[0] for line in told] == [
        "wall.toml:23: material of block 'upper'",
        "wall.toml:28: block of load number 1",
    ]


def test_a_text_of_many_errors_is_cut_short():
    text = TEXT + "".join(f'\n[[loads]]\nblock = "upper"\nforce = {i}\n' for i in range(40))
    told = messages(text)
    assert len(told) == 21 and told[-1].startswith("and ") and told[-1].endswith(" more")


@pytest.mark.parametrize(
    ("table", "number", "key", "line"),
    [("", 1, "gravity", 2), ("", 1, "nothing", None), ("blocks", 2, "box", 26), ("blocks", 2, "fixed", 23),
     ("blocks", 1, "", 14), ("blocks", 3, "name", None), ("materials.tuff", 1, "density", 12),
     ("control", 1, "kind", 34)],
)  # fmt: skip
def test_lines_of_keys_and_tables(table, number, key, line):
    assert line_of(TEXT, table, number, key) == line


def test_a_key_of_the_scenario_in_a_table_is_told_where_it_belongs():
    text = TEXT.replace("[materials.tuff]\n", '[materials.tuff]\nsupports = ["lower"]\n')
    with pytest.raises(
        ScenarioError, match="unknown key 'supports' .*supports must stand above the first table of the file"
    ):
        toml.loads(text)
