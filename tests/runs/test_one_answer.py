"""One run has one answer: all commands, figures and pages give the same limit with the same bracket, V inside it."""

import json
import re
from dataclasses import replace

import pytest

import dembrick
from dembrick import history
from dembrick.cli import main
from dembrick.cli.sweep import _answer
from dembrick.errors import BracketError
from dembrick.runs import path_dependence
from dembrick.runs.path_dependence import cut_at_bound
from dembrick.scenario import toml
from dembrick.views import page, plot, summary
from helpers.scenario_text import block, header, jack
from helpers.two_blocks import BLOCKS, RATE

SLOPE = BLOCKS.partition("[[actuators]]")[0] + '[control]\nkind = "tilt"\naxis = [1.0, 0.0, 0.0]\n'
RUNS = {
    "yield": BLOCKS,
    "above the joint": BLOCKS.replace("convex", "concave"),
    "constant rate": RATE,
    "V at the lower bound": RATE.replace("convex", "concave"),
    "tilt": SLOPE,
}


@pytest.mark.parametrize("name", RUNS)
def test_every_command_says_the_same(name, tmp_path, capsys):
    path, csv = tmp_path / "run.h5", tmp_path / "points.csv"
    (tmp_path / "run.toml").write_text(RUNS[name], encoding="utf-8")
    told = []
    for command in (["run", str(tmp_path / "run.toml"), "--out", str(path)], ["info", str(path)],
                    ["yield", str(path), "--csv", str(csv)]):  # fmt: skip
        assert main(command) == 0
        told.append(capsys.readouterr().out)
    with history.read(path) as found:
        point, unit = found.results["yield_point"], "N" if found.curve.unit == "N" else ""
        said = summary.limit_text(point, found.results.get("path"), unit)
        drawn = summary.angle_text(point, found.results.get("path")) if name == "tilt" else said
        legend = [text.get_text() for text in plot.force_displacement([found]).legends[0].get_texts()]
        document = page.document(found)
    assert point["V_lower"] <= point["V"] <= point["V_upper"]
    for text in told:
        assert summary.plain(said.value) in text and said.remark.split(":")[0] in text
        assert len(set(re.findall(r"\+- ([\d.e-]+)", text.partition("\nV_peak")[0]))) <= 2  # of load and tilt angle
        assert "no error bar" not in text
    assert str(drawn) in legend and said.value in document and json.dumps(str(drawn))[1:-1] in document
    row = dict(zip(*(line.split(",") for line in csv.read_text().splitlines()[:2]), strict=False))
    assert [float(row[key]) for key in ("V", "V_lower", "V_upper")] == [point[k] for k in ("V", "V_lower", "V_upper")]


def test_a_bracket_whose_middle_is_not_V_is_said_by_its_ends():
    result = dembrick.simulate(toml.loads(RUNS["V at the lower bound"]))
    point = result.yield_point
    assert point.V_lower <= result.theory.V <= point.V_upper and point.V_upper > 1.01 * point.V
    low, high = map(
        float, re.fullmatch(r"([\d.]+) to ([\d.]+) N", summary.limit_text(point.as_dict(), None, "N").value).groups()
    )
    assert point.V_lower - 0.1 <= low <= point.V_lower and point.V_upper <= high <= point.V_upper + 0.1


@pytest.mark.parametrize(
    "V, bounds, text",
    [
        (840.09, (840.09, 873.8), "840.0 to 873.8 N (indicator)"),
        (216.0, (215.0, 217.0), "216.0 ± 1.0 N (indicator)"),
        (0.64, (0.64 - 7e-12, 0.64 + 7e-12), "0.64 N (indicator: the two bounds meet)"),
        (1.28, (1.28 - 1.1e-7, 1.28 + 1.1e-7), "1.28000000 ± 1.1e-07 N (indicator)"),
        (84.0, (83.0, None), "84 N (at the end, no upper bound; the limit is at least 83 N)"),
    ],
)
def test_words(V, bounds, text):
    point = {"V": V, "V_lower": bounds[0], "V_upper": bounds[1], "bracket": "indicator"}
    assert str(summary.limit_text(point, None, "N")) == text


def test_a_load_that_depends_on_the_path_has_two_digits():
    point = {"V": 0.2946, "V_lower": 0.2937, "V_upper": 0.2955, "bracket": "indicator"}
    path = {"path_dependent": True, "digits_open": True}
    assert str(summary.limit_text(point, path, "")) == "about 0.29 (of this path)"
    assert str(summary.angle_text(point, path)) == "about 16 deg (of this path)"
    ranged = path | {"path_range": [0.2937, 0.2955]}
    assert str(summary.limit_text(point, ranged, "")) == "0.29460 ± 0.00090 (indicator)"


STUDY = """
title = "two blocks over friction"
base = "run.toml"
[grid]
"joint.friction" = { from = 0.4, to = 0.7, count = 4 }
"""


def test_a_sweep_says_what_the_run_of_a_case_says(tmp_path, capsys):
    (tmp_path / "run.toml").write_text(BLOCKS, encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    assert main(["sweep", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    said = capsys.readouterr().out
    table = plot.read_study(tmp_path / "out")
    assert [row["joint.friction"] for row in table.rows] == ["0.4", "0.5", "0.6", "0.7"]  # not rounded
    for row in table.rows:
        friction = row["joint.friction"]
        point = dembrick.simulate(toml.loads(BLOCKS.replace("0.62", friction)), record=False).yield_point
        text = summary.plain(str(summary.limit_text(point.as_dict(), None, "N")))
        assert f"V             {text}  joint.friction = {friction}\n" in said + "\n"
        for name in ("V", "V_lower", "V_upper", "V_2", "M_T", "N"):
            assert float(row[name]) == pytest.approx(getattr(point, name), rel=1e-9), name
        assert float(row["V_lower"]) <= float(row["V_2"]) <= float(row["V_upper"])


FEET = BLOCKS.replace("convex", "concave").replace("[0.12, 0.0, 0.075]", "[0.12, 0.0, 0.0]")
FEET = FEET.replace(
    "box = [0.4, 0.2, 0.15]\nposition = [0.0, 0.0, 0.075]\n",
    "".join(
        f"[[blocks.parts]]\nbox = {list(box)}\nposition = {list(position)}\n"
        for box, position in (
            ((0.1, 0.2, 0.1), (-0.15, 0.0, 0.05)), ((0.2, 0.2, 0.1), (0.1, 0.0, 0.05)),
            ((0.4, 0.2, 0.05), (0.0, 0.0, 0.125)),
        )
    ),
)  # fmt: skip


@pytest.mark.parametrize("more", ["tie", "large", "feet"])
def test_cases_of_a_sweep_keep_ties_the_deformed_geometry_and_feet(more, tmp_path):
    """Batched cases support none of them: a block with a tie once got the limit without it, called "certified", and one
    on two feet that of a single outline around both."""
    ends = '{ block = "lower", point = [0.0, -0.1, -0.01] }, { block = "upper", point = [0.0, 0.1, 0.05] }'
    tie = f"[[ties]]\nbetween = [{ends}]\nstiffness = 1e6\nstrength = 50.0\n"
    large = BLOCKS.replace('kind = "yield"', 'kind = "yield"\nlarge_displacements = true')
    text = {"tie": BLOCKS + tie, "large": large, "feet": FEET}[more]
    (tmp_path / "base.toml").write_text(text, encoding="utf-8")
    (tmp_path / "study.toml").write_text('base = "base.toml"\n[list]\n"joint.friction" = [0.5]\n', encoding="utf-8")
    assert main(["sweep", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    (row,) = plot.read_study(tmp_path / "out").rows
    point = dembrick.simulate(toml.loads(text.replace("0.62", "0.5")), record=False).yield_point
    assert row["bracket"] == point.bracket
    assert float(row["V"]) == pytest.approx(point.V, rel=1e-9)


def test_a_run_is_that_of_the_law_of_its_joints(tmp_path, capsys):
    """The law of [joint] is that of no joint here: the formulation is another, and its few points are asked for."""
    law = '[[joints]]\nbetween = ["lower", "upper"]\nformulation = "distributed"\npoints = [2, 2]\n'
    (tmp_path / "run.toml").write_text(BLOCKS.replace("0.0, 0.075]\ndirection", "0.0, 0.0]\ndirection") + law)
    for command in (["run", "--out", str(tmp_path / "run.h5")], ["limit"]):
        assert main([*command, str(tmp_path / "run.toml"), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["formulation"] == "distributed"


def test_a_sweep_says_of_one_path_what_a_run_says(tmp_path):
    cell = {"count": 1, "mean": 0.2946, "V_lower": 0.2937, "V_upper": 0.2955, "bracket": "indicator"}
    assert _answer(cell | {"digits_open": "true"}, "") == "about 0.29 (of this path)"
    assert _answer(cell | {"digits_open": "false"}, "") == "0.29460 +- 0.00090 (indicator)"
    rows = ["case,joint.friction,status,V,V_lower,V_upper,bracket,associative,digits_open,path_dependent",
            "0,0.6,collapse,0.2946,0.2937,0.2955,indicator,0.35,true,true",
            "1,0.8,collapse,0.3000,0.2990,0.3010,indicator,,false,true"]  # fmt: skip
    (tmp_path / "table.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    table = plot.read_study(tmp_path / "table.csv")
    (axes,) = plot.study(table).axes
    bars = [segment[:, 1].tolist() for segment in axes.containers[0].lines[2][0].get_segments()]
    assert bars == [pytest.approx([0.2946, 0.35]), pytest.approx([0.299, 0.301])]
    marked = {text.get_text(): text for text in axes.get_legend().get_texts()}
    assert list(marked)[-2:] == [
        f"depends on the load path; bar: {bar}" for bar in ("to the bound of all paths", "what was found")
    ]
    one, several = axes.lines[-2:]
    assert (list(one.get_xdata()), list(several.get_xdata())) == ([0.6], [0.8])


BOUND = {"load_factor": 0.35, "lower": 0.34999, "upper": 0.35}


def test_no_limit_above_a_proven_bound_is_told(tmp_path, monkeypatch):
    """A limit above the bound within the tolerance of the search is cut; one that contradicts it is an error."""
    point = dembrick.simulate(toml.loads(SLOPE), record=False).yield_point  # friction 0.62
    for low, high in ((0.3499, 0.3503), (0.3501, 0.3506)):
        found = cut_at_bound(replace(point, V=0.5 * (low + high), V_lower=low, V_upper=high, V_peak=high), BOUND)
        assert low >= found.V_lower and found.V_lower <= found.V <= found.V_upper == found.V_peak == 0.35
    assert cut_at_bound(point, None) == point == cut_at_bound(point, BOUND | {"upper": 0.63})
    with pytest.raises(BracketError, match="proves that none lies above 0.35, so one of them is wrong"):
        cut_at_bound(point, BOUND)
    monkeypatch.setattr(path_dependence, "statically_determinate", lambda _: False)
    monkeypatch.setattr("dembrick.runs.limit.associative_bound", lambda *_: BOUND)
    with pytest.raises(BracketError) as failed:
        dembrick.simulate(toml.loads(SLOPE), tmp_path / "run.h5", bound=True)
    assert failed.value.answer["status"] == "failed" and failed.value.answer["yield_point"] is None
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "failed" and "one of them is wrong" in found.results["error"]


def test_a_search_without_an_upper_end_takes_that_of_limit_analysis():
    """Nothing below is proven, so V is the bound itself if the search went above it."""
    open_ended = replace(
        dembrick.simulate(toml.loads(SLOPE), record=False).yield_point,
        V=0.4, V_lower=0.0, V_upper=0.5, V_peak=0.5, bracket="open",
    )  # fmt: skip
    found = cut_at_bound(open_ended, BOUND)
    assert (found.V, found.V_lower, found.V_upper, found.V_peak) == (0.35, 0.0, 0.35, 0.35)
    said = summary.limit_text(found.as_dict(), {"associative": BOUND}, "")
    assert said.remark == "at the end, at most 0.35 by limit analysis; the limit is at least 0"


L = (
    header("convex", 0.7, 1e10, title="pushed high up, where it slides", density=2500.0)
    + block("floor", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    + """
[[blocks]]
name = "L"
material = "stone"
[[blocks.parts]]
box = [0.6, 0.3, 0.2]
position = [0.3, 0.15, 0.1]
[[blocks.parts]]
box = [0.2, 0.3, 0.4]
position = [0.1, 0.15, 0.4]
[control]
kind = "yield"
"""
    + jack("L", (0.0, 0.15, 0.5))
)


def test_joints_at_the_limit_are_those_of_the_limit(tmp_path, capsys):
    """The last row is an equilibrium below the limit; joints are reported at the limit."""
    (tmp_path / "l.toml").write_text(L, encoding="utf-8")
    assert main(["run", str(tmp_path / "l.toml"), "--out", str(tmp_path / "l.h5")]) == 0
    with history.read(tmp_path / "l.h5") as found:
        V, N, loads = found.results["yield_point"]["V"], found.results["yield_point"]["N"], found.load[:]
    assert loads[-1] == pytest.approx(V, rel=1e-3)
    capsys.readouterr()
    assert main(["joints", str(tmp_path / "l.h5"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["joints"][0]["N"] == pytest.approx(N, rel=0.02) and loads[told["frame"]] == pytest.approx(V, rel=5e-3)


def test_a_run_that_failed_says_no_limit(tmp_path, capsys):
    text = RATE.replace("travel = 6e-5", "travel = 4e-7")
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(tmp_path / "run.toml"), "--out", str(tmp_path / "run.h5")]) == 1
    capsys.readouterr()
    assert main(["info", str(tmp_path / "run.h5")]) == 0
    said = capsys.readouterr().out
    assert "no limit load" in said and "limit load V" not in said
    with history.read(tmp_path / "run.h5") as found:
        assert plot.subject.diagram_of(found).limit(found.results) is None


def test_a_sweep_prints_tables_as_a_study_has_them(tmp_path, capsys):
    (tmp_path / "run.toml").write_text(BLOCKS, encoding="utf-8")
    study = 'title = "tolerances"\nbase = "run.toml"\n[grid]\ncontrol = [{ kind = "yield", tolerance = 1e-3 }]\n'
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    assert main(["sweep", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    assert "  control = { kind = 'yield', tolerance = 0.001 }\n" in capsys.readouterr().out
