"""The shipped verification cases, how their outcomes are judged, and the command that runs them."""

import dataclasses
import json
import math

import pytest

from dembrick import cli
from dembrick.errors import ScenarioError
from dembrick.runs.verification import cases, verify
from dembrick.scenario import shipped, toml

CASE = cases.Case("torsion", "Torsion", "set2a", "V", 100.0, "a book")


def outcome(value=100.02, lower=99.9, upper=100.1, **changes):
    return verify.Outcome(dataclasses.replace(CASE, **changes), value, lower, upper, 0.1)


def test_at_least_forty_cases_ship_and_each_has_a_source():
    found = cases.all_cases()
    assert len(found) >= 40
    assert all(case.source and case.title and math.isfinite(case.reference) for case in found.values())


@pytest.mark.parametrize("case", cases.all_cases().values(), ids=lambda case: case.name)
def test_every_case_has_a_scenario_that_reads(case):
    assert toml.load(case.path, case.set).title


@pytest.mark.parametrize("name", ["lab-2a-convex", "lab-4a-concave", "harmonic-0.8", "wall-tilt-smooth"])
def test_cases_pass_and_fail_if_the_reference_is_off_by_a_hundredth(name):
    (case,) = cases.chosen([name])
    found = verify.outcome_of(case)
    assert found.passed and found.bar_holds
    wrong = dataclasses.replace(found, case=dataclasses.replace(case, reference=1.01 * case.reference))
    assert not wrong.passed


LONG = ("ferris-tinloi-6", "wall-tilt", "drum-column", "arch-s", "beam-on", "hexagonal")  # prefixes of long cases


@pytest.mark.parametrize("case", cases.all_cases().values(), ids=lambda case: case.name)
def test_every_case_that_is_short_passes(case):
    """Cases that take seconds are left to the command; all others are checked here."""
    if not case.name.startswith(LONG):
        found = verify.outcome_of(case)
        assert found.passed, (found.value, found.lower, found.upper, found.failure)


@pytest.mark.slow
def test_the_whole_table_passes(capsys):
    assert cli.main(["verify", "--quiet"]) == 0, capsys.readouterr().err


def test_a_bar_that_leaves_the_reference_out_fails_unless_the_case_says_why():
    assert outcome().passed and outcome().bar_holds
    narrow = outcome(lower=100.01, upper=100.03)
    assert narrow.bar_holds is False and not narrow.passed
    assert dataclasses.replace(narrow, case=dataclasses.replace(CASE, remark="elastic joints")).passed
    known = dataclasses.replace(narrow, case=dataclasses.replace(CASE, reference_error=0.02))
    assert known.bar_holds and known.passed


def test_a_value_beyond_the_tolerance_fails_even_inside_its_bar():
    assert not outcome(value=100.2, lower=99.0, upper=101.0).passed


def test_a_bound_is_met_from_below():
    assert outcome(value=90.0, lower=89.0, upper=91.0, relation="at most").passed
    assert not outcome(value=100.1, lower=99.0, upper=101.0, relation="at most").passed


def test_a_run_without_an_answer_is_an_outcome_that_failed():
    case = dataclasses.replace(CASE, set=("joint.friction=-1",))
    found = verify.outcome_of(case)
    assert found.value is None and not found.passed and "friction" in found.failure


def test_names_choose_cases_and_a_wrong_one_is_told_the_nearest():
    assert [case.name for case in cases.chosen(["askew"])] == ["askew-10", "askew-20", "askew-30"]
    assert all(case.quick for case in cases.chosen([], quick=True))
    with pytest.raises(ScenarioError, match="did you mean 'askew-10'"):
        cases.chosen(["askew-1O"])


def test_the_command_prints_a_row_a_case_and_writes_the_report(tmp_path, capsys):
    page = tmp_path / "report.html"
    assert cli.main(["verify", "lab-2a-convex", "--report", str(page)]) == 0
    printed = capsys.readouterr().out
    assert "107.1658" in printed and "1 of 1 cases pass" in printed
    text = page.read_text()
    assert "Laboratory set 2a, convex joint" in text and "107.1658" in text and "http" not in text


def test_the_command_exits_with_three_if_a_case_fails(monkeypatch, capsys):
    (case,) = cases.chosen(["lab-2a-convex"])
    monkeypatch.setattr(cases, "chosen", lambda *_: [dataclasses.replace(case, reference=110.0)])
    assert cli.main(["verify", "--json"]) == 3
    answer = json.loads(capsys.readouterr().out)
    assert not answer["passed"] and answer["cases"][0]["error"] < -0.02


def test_text_from_a_case_is_escaped_on_the_page():
    page = verify.html([outcome(title="<script>alert(1)</script>")], "1.0")
    assert "<script>" not in page and "&lt;script&gt;" in page


def test_shipped_names_stand_for_files(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert toml.load("set4a") == toml.load(shipped.folder() / "set4a.toml")
    (tmp_path / "set4a").write_text("title = 1\n")
    with pytest.raises(ScenarioError):  # a file of that name takes precedence
        toml.load("set4a")
    with pytest.raises(ScenarioError, match="dembrick examples"):
        toml.load("set4q")
    with pytest.raises(ScenarioError, match="did you mean 'arch_tilt'"):
        toml.load("arch-tilt.toml")
    with pytest.raises(ScenarioError, match="there is no such file; 'dembrick examples'"):
        toml.load("zzz")
    assert shipped.find("../set4a") is None and shipped.find("") is None


@pytest.mark.parametrize("name", sorted(shipped.templates()))
def test_a_template_is_a_scenario_to_start_from(name, folder, capsys):
    assert cli.main(["new", name]) == 0
    assert shipped.description(folder / f"{name}.toml")
    first = (folder / f"{name}.toml").read_text().splitlines()[0]
    if name != "study":
        assert (folder / first.removeprefix("#:schema ")).is_file()
        assert cli.main(["check", f"{name}.toml", "--quiet"]) == 0
    capsys.readouterr()
    (folder / f"{name}.toml").write_text("mine")
    assert cli.main(["new", name]) == 2
    assert "exists" in capsys.readouterr().err


def test_a_shipped_scenario_is_one_to_start_from_too(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "house", "mine.toml"]) == 0
    assert (tmp_path / "mine.toml").read_bytes() == (shipped.folder() / "house.toml").read_bytes()
    assert (tmp_path / shipped.SCHEMA).is_file() and cli.main(["check", "mine.toml", "--quiet"]) == 0
    capsys.readouterr()
    assert cli.main(["new", "hous"]) == 2
    assert "did you mean 'house'" in capsys.readouterr().err


def test_a_template_study_runs(folder, capsys):
    assert cli.main(["new", "study", "study.toml"]) == 0
    assert cli.main(["sweep", "study.toml", "--jobs", "1", "--quiet"]) == 0
    assert len((folder / "results" / "study" / "table.csv").read_text().splitlines()) == 21


def test_examples_are_listed_printed_and_copied(folder, capsys):
    assert cli.main(["examples", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["examples"]
    assert "set4a" in told and "studies/friction_scatter" in told
    assert len({one["title"] for one in told.values()}) == len(told)  # no two titles are the same
    kinds = [told[name]["kind"] for name in ("set4a", "oppenheim", "studies/friction_scatter")]
    assert kinds == ["yield", "tilt, search", "study"], "and no blanks that align a text"
    assert cli.main(["examples", "arch"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("# A semicircular arch")
    assert cli.main(["examples", "--copy", "mine"]) == 0
    assert (folder / "mine" / shipped.SCHEMA).exists()
    assert (folder / "mine" / "studies" / "friction_scatter.toml").exists()
    assert cli.main(["examples", "--copy", "mine"]) == 2
    assert cli.main(["examples", "arhc"]) == 2
    assert "did you mean" in capsys.readouterr().err


@pytest.mark.parametrize("shell, word", [("bash", "complete"), ("zsh", "compdef"), ("fish", "complete -c dembrick")])
def test_completion_knows_commands_and_options(shell, word, capsys):
    assert cli.main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert word in script and "warmup" in script and "tolerance" in script


@pytest.mark.parametrize("half, said", [(1e-9, "2 +- 5e-07 N"), (1e-3, "2 N")])
def test_how_far_a_reference_is_known_where_the_bar_is_narrower(half, said):
    case = dataclasses.replace(cases.chosen(["lab-2a-convex"], False)[0], reference=2.0, reference_error=5e-7)
    outcome = verify.Outcome(case, 2.0, 2.0 - half, 2.0 + half, 0.1)
    assert f" {said} " in verify.text_row(outcome) and f">{said}<" in verify.html([outcome], "1")
