"""Studies with a search: bisection for the value of a key at which a run falls."""

import math

import pytest

from dembrick import cli
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs import study as studies
from dembrick.runs.study import search
from dembrick.views import plot
from helpers.scenario_text import block, header
from helpers.studies import read_csv, write_study

SLOPE = math.tan(math.radians(20.0))
FLOOR = block("floor", [0.0, 0.0, -0.05], [1.0, 1.0, 0.1], "fixed = true")
LEVEL = "gravity = [0.0, 0.0, -9.81]"
BASE = (
    header().replace(LEVEL, f"gravity = [{9.81 * SLOPE}, 0.0, -9.81]")
    + FLOOR
    + block("stone", [0.0, 0.0, 0.05], [0.2, 0.2, 0.1])
    + '[control]\nkind = "statics"\n'
)
SEARCH = '[search]\nkey = "joint.friction"\nlow = 0.1\nhigh = 1.0\ntolerance = 1e-3\n'


@pytest.fixture
def write(tmp_path):
    return lambda body, base=BASE: write_study(tmp_path, body, base)


def test_the_friction_that_holds_a_block_on_a_slope(write, tmp_path):
    """tan 20 deg, for any formulation; the block falls below it, so the bracket is reversed."""
    path = write('[grid]\n"joint.formulation" = ["concave", "convex", "distributed"]\n' + SEARCH)
    outcome = studies.sweep(path, tmp_path / "out")
    rows = read_csv(outcome.csv)
    for row in rows:
        value, bar = float(row["value"]), float(row["half_width"])
        assert row["status"] == "found" and row["searched"] == "joint.friction"
        assert float(row["falls"]) <= SLOPE <= float(row["stands"])
        assert abs(value - SLOPE) <= bar <= 1e-3 * value
        assert 2.0 * bar == pytest.approx(float(row["stands"]) - float(row["falls"]), rel=1e-9)
        assert int(row["runs"]) == 2 + math.ceil(math.log2(0.45 / (1e-3 * SLOPE)))
    assert [cell["half_width"] for cell in outcome.statistics] == [float(row["half_width"]) for row in rows]
    assert {cell["falls"] for cell in outcome.statistics} == {"below"}
    assert studies.sweep(path, tmp_path / "out").ran == 0


def test_a_fall_in_an_earlier_stage_is_a_fall(write, tmp_path):
    outcome = studies.sweep(write(SEARCH, BASE + '[[stages]]\nkind = "statics"\n'), tmp_path / "out")
    (row,) = read_csv(outcome.csv)
    assert row["status"] == "found" and float(row["falls"]) <= SLOPE <= float(row["stands"])


def test_no_bar_leaves_out_what_points_inside_the_edge_do(write, tmp_path, capsys):
    """The least thickness of an arch against that of rigid stones, which rotate about their edges."""
    arch = '[[arches]]\nname = "arch"\nmaterial = "stone"\nradius = 5.0\nthickness = 0.6\ndepth = 0.5\nvoussoirs = 7\n'
    base = header(friction=0.9) + arch + '[control]\nkind = "statics"\n'
    body = '[grid]\n"joint.formulation" = ["concave", "convex", "distributed"]\n'
    body += '[search]\nkey = "arches.arch.thickness"\nlow = 0.45\nhigh = 0.65\ntolerance = 4e-3\n'
    cli.main(["sweep", str(write(body, base)), "--out", str(tmp_path / "out")])
    concave, convex, distributed = read_csv(tmp_path / "out" / "table.csv")
    assert abs(float(convex["value"]) - float(concave["value"])) <= 2.0 * float(concave["half_width"])
    assert float(distributed["value"]) > 1.03 * float(concave["value"]) and distributed["half_width"] == ""
    assert "topple 5.6 % early" in distributed["remark"] and "topple 5.6 % early" in capsys.readouterr().out


def test_the_pulse_that_overturns_a_block(write, tmp_path):
    """On a base under an endless pulse a block rocks, and so falls, if a > g b/h."""
    control = 'kind = "base-motion"\nduration = 1.5\ndirection = [1.0, 0.0, 0.0]\n'
    control += "pulse = { amplitude = 9.81, duration = 5.0 }\n"
    base = (
        header(normal_stiffness=1e9)
        + FLOOR
        + block("stone", [0.0, 0.0, 0.1], [0.1, 0.2, 0.2])
        + f"[control]\n{control}"
    )
    body = '[search]\nkey = "control.scale"\nlow = 0.4\nhigh = 0.59\ntolerance = 0.02\n'
    outcome = studies.sweep(write(body, base), tmp_path / "out")
    (row,) = read_csv(outcome.csv)
    assert float(row["value"]) == pytest.approx(0.5, abs=float(row["half_width"]) + 0.01)  # elastic joints
    assert row["runs"] == "6"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("joint.friction", "joint.frction", ["frction", "friction"]),
        ("high = 1.0", "high = 0.1", ["search.low = 0.1 must be below search.high = 0.1"]),
        ("tolerance = 1e-3\n", "", ["missing key 'tolerance'"]),
        ("tolerance = 1e-3", "tolerance = 2.0", ["search.tolerance = 2", "between 1e-6 and 0.5"]),
        ("low = 0.1", "lower = 0.1", ["search: unknown key 'lower'", "low"]),
        ("low = 0.1", "low = -0.1", ["friction", "at least 0"]),
        ("low = 0.1", 'low = "small"', ["search.low"]),
        ("low = 0.1", "low = 0.1\nscan = 0", ["search.scan = 0", "from 1 to 1000"]),
        ("[search]", "histories = true\n[search]", ["keep no history"]),
        ("[search]", '[grid]\n"joint.friction" = [0.5, 0.6]\n[search]', ["already varies from case to case"]),
        ("[search]", '[grid]\n"control.kind" = ["yield"]\n[search]', ["neither stands nor falls"]),
    ],
)
def test_what_is_no_search_is_refused_in_one_sentence(write, old, new, words):
    base = BASE
    if "yield" in new:
        base += '[[actuators]]\nname = "jack"\nblock = "stone"\npoint = [0.1, 0.0, 0.05]\ndirection = [1.0, 0.0, 0.0]\n'
    with pytest.raises(ScenarioError) as caught:
        studies.load(write(SEARCH.replace(old, new), base))
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(("low", "high", "word"), [(0.5, 1.0, "stands at both ends"), (0.1, 0.2, "falls at both ends")])
def test_ends_that_do_not_bracket_are_a_failed_case(write, tmp_path, low, high, word, capsys):
    body = SEARCH.replace("low = 0.1", f"low = {low}").replace("high = 1.0", f"high = {high}")
    code = cli.main(["sweep", str(write(body)), "--out", str(tmp_path / "out"), "--jobs", "1"])
    assert code == 1
    (row,) = read_csv(tmp_path / "out" / "table.csv")
    assert row["status"] == "failed" and word in row["error"] and row["value"] == ""
    with pytest.raises(ScenarioError, match="no case of this study has an answer"):
        plot.read_study(tmp_path / "out")


def test_bisection_ends_at_its_tolerance_also_at_zero():
    wide = search.Search("key", -1.0, 3.0, 0.01)
    for edge in (0.7, -0.2, 0.0, 2.9):
        found = wide.bisect(lambda value, edge=edge: value > edge)
        assert found.stands <= edge <= found.falls
        assert found.half_width <= max(0.01 * abs(found.value), 4e-9)
    assert found.runs == 2 + math.ceil(math.log2(2.0 / 0.029))
    island = search.Search("key", 0.1, 1.6, 1e-3, scan=8)  # also falls between 0.3 and 0.5: the first change counts
    found = island.bisect(lambda value: 0.3 < value < 0.5 or value > 0.9)
    assert found.stands <= 0.3 <= found.falls
    back = island.bisect(lambda value: value < 0.2 or 0.3 < value < 0.5)
    assert back.falls <= 0.5 <= back.stands
    with pytest.raises(NotConvergedError, match="key = -1 and 3"):
        wide.bisect(lambda value: False)


def test_a_study_is_drawn_over_every_key_that_changes(tmp_path, capsys):
    """One panel per key, one line per combination of the others, with the bars of the search."""
    lines = [
        "case,joint.formulation,control.pulse.duration,status,searched,value,half_width,stands,falls,runs,loop,error"
    ]
    numbers = {("concave", 0.2): 1.4, ("concave", 0.5): 0.25, ("convex", 0.2): 1.5, ("convex", 0.5): 0.26}
    for i, ((law, time), value) in enumerate(numbers.items()):
        lines.append(f"{i},{law},{time},found,control.scale,{value},0.01,{value - 0.01},{value + 0.01},9,1.0,")
    lines.append("4,convex,1.0,failed,control.scale,,,,,,,it stands at both ends")
    folder = tmp_path / "domain"
    folder.mkdir()
    (folder / "table.csv").write_text("\n".join(lines) + "\n")
    figure = plot.study(plot.read_study(folder))
    laws, times = figure.axes
    assert times.get_ylabel() == "control.scale at collapse [-]"
    assert laws.get_xlabel() == "joint.formulation" and times.get_xlabel() == "control.pulse.duration [s]"
    concave, convex = times.containers
    assert concave[0].get_xydata().tolist() == [[0.2, 1.4], [0.5, 0.25]]
    assert convex[0].get_ydata().tolist() == [1.5, 0.26]
    ends = concave[2][0].get_segments()[1]
    assert ends[:, 1].tolist() == pytest.approx([0.24, 0.26])
    assert [text.get_text() for text in laws.get_xticklabels()] == ["concave", "convex"]
    target = tmp_path / "domain.svg"
    command = ["plot", str(folder / "table.csv"), "--to", str(target)]
    assert cli.main([*command, "--over", "control.pulse.duration"]) == 0 and target.exists()
    assert cli.main([*command, "--over", "control.pulse.length"]) == 2
    assert cli.main([*command, "--answer", "valu"]) == 2
    assert "did you mean 'value'" in capsys.readouterr().err
