"""Key numbers as text: error bars with two digits, and results that lack some quantities."""

import math

import numpy as np
import pytest

from dembrick.views import summary
from dembrick.views.key_numbers import key_numbers
from dembrick.views.number_lines import KeyNumber
from dembrick.views.summary import rounded_up, with_error


@pytest.mark.parametrize(
    "value, half, text",
    [
        (215.9883, 0.0668, "215.988 ± 0.068 N"),
        (239.5202373, 2.6e-5, "239.520237 ± 2.7e-05 N"),
        (107.16583, 2e-14, "107.1658 N"),
        (216.0, 1.0, "216.0 ± 1.0 N"),
        (12345.0, 340.0, "12345 ± 340 N"),
        (3e-7, 2.5e-9, "3.000e-07 ± 2.5e-09 N"),
    ],
)
def test_an_error_bar_has_two_digits(value, half, text):
    found = with_error(value, half, "N")
    assert found == text or (value < 1e-6 and "±" in found)
    shown = float(found.split()[0])
    assert shown == pytest.approx(value, abs=0.51 * max(half, 1e-6 * value))


def test_what_is_printed_holds_all_that_is_meant():
    """For random values and errors the printed error bar contains the true one and is hardly wider."""
    rng = np.random.default_rng(7)
    for value, error in zip(rng.normal(0.0, 1e3, 2000), 10.0 ** rng.uniform(-5.0, 3.0, 2000), strict=True):
        shown, bar = map(float, summary.barred(value, error))
        assert shown - bar <= value - error and value + error <= shown + bar
        assert bar <= 1.16 * error
        decimals = int(rng.integers(0, 5))
        bar = float(summary.bar_to(decimals, value, error)) + 1e-9 * abs(value)
        assert abs(value - round(value, decimals)) + error <= bar <= error + 1.5 * 10.0**-decimals + 1e-8 * abs(value)
        low, high = map(float, summary.outward(value - error, value + error))
        assert value - 1.02 * error <= low <= value - error and value + error <= high <= value + 1.02 * error


def names(results):
    return {line.name: line for line in key_numbers(results)}


POINT = {"V": 216.0, "V_lower": 215.0, "V_upper": 217.0, "bracket": "certified", "N": 467.0, "M_T": 16.2}


def test_the_peaks_of_a_cycle_have_no_more_digits_than_a_limit():
    """Bounds that differ only by rounding do not print with fifteen digits."""
    cycle = {"peak": [-5652.28124814606, 6124.7], "V_lower": [-5652.28124814644, 6123.7], "dissipated": 1.9}
    cycle["V_upper"] = [-5652.28124814606, 6125.7]
    assert names({"yield_point": POINT, "cycles": [cycle]})["cycle 1"].value == "peaks -5652.281 and 6124.7 ± 1.0 N"


def test_brackets_are_named_for_what_they_are():
    assert names({"yield_point": POINT})["limit load V"].remark == "certified: bounds 215 and 217 N"
    indicator = names({"yield_point": POINT | {"bracket": "indicator"}})["limit load V"]
    assert indicator.value == "216.0 ± 1.0 N" and indicator.remark.startswith("indicator, not certified")
    for openly in ({"bracket": "open"}, {"V_upper": None}):
        line = names({"yield_point": POINT | openly})["V"]
        assert "±" not in line.value and "no upper bound" in line.remark and "at least 215 N" in line.remark
    meeting = names({"yield_point": POINT | {"V_lower": 216.0, "V_upper": 216.0}})["limit load V"]
    assert meeting == KeyNumber("limit load V", "216 N", "certified: the two bounds meet")


def test_theory_and_collapse():
    theory = names({"theory": {"V": 216.05, "error": -3.1e-4, "discretisation_error": 4e-4}})["theory"]
    assert theory[:3] == ("theory", "216.05 N", "simulation -0.031 %; the points deviate from the continuum by 0.04 %")
    collapse = {"angle": 12.01, "load_factor": 0.2127, "mechanism": "rocking", "error_estimate": None}
    lines = names({"collapse": collapse})
    assert lines["collapse angle"][:3] == ("collapse angle", "12.01 deg", "no error bar: --refine gives one")
    assert lines["load factor"].value == "0.2127" and lines["mechanism"].value == "rocking"
    lines = names({"collapse": collapse | {"error_estimate": 5e-4}})
    assert lines["load factor"].value == "0.21270 ± 0.00050"
    # 5e-4 cos(12.01 deg)^2 in degrees
    assert lines["collapse angle"][:3] == ("collapse angle", "12.010 ± 0.028 deg", "")


def test_a_load_factor_has_no_newtons():
    """The V of a quasi-static tilt is a load factor, printed with its bracket and without a unit."""
    point = {"V": 0.37001, "V_lower": 0.37, "V_upper": 0.37002, "bracket": "indicator", "V_peak": 0.38, "N": 900.0}
    results = {"yield_point": point, "collapse": {"angle": 20.305, "load_factor": 0.37001, "mechanism": "rocking"}}
    lines = key_numbers(results)
    assert [line.name for line in lines] == [
        "collapse angle", "load factor", "largest load factor", "joint forces", "mechanism"
    ]  # fmt: skip
    assert lines[1].value == "0.370010 ± 0.000010" and lines[1].remark.endswith("0.37000 and 0.37002")
    # 1e-5 cos(20.305 deg)^2 in degrees
    assert "N" not in lines[2].value and lines[0][1:3] == ("20.30498 ± 0.00051 deg", "indicator")
    assert lines[4].value == "rocking"


def test_a_structure_tells_what_else_its_run_printed():
    """Key numbers include stages, ties, reactions, blocks, hinges, and the loads of other paths."""
    stage = {"stage": 1, "kind": "displacement", "status": "completed", "yield_point": POINT, "path": None}
    ties = [
        {"between": ["a", "b"], "tension": 200.0, "yielded": 1.8e-3},
        {"between": ["a", "c"], "tension": 5.0, "peak": 7.0},
    ]
    beside = {
        "path_range": [0.19, 0.21],
        "paths": [9, 10],
        "associative": {"upper": 0.22},
        "mechanism_load_factor": 0.18,
    }
    collapse = {"load_factor": 0.2, "mechanism": "rocking", "blocks": ["a", "b"], "hinges": ["b / a"]} | beside
    lines = names(
        {
            "yield_point": POINT | {"V": 0.2, "V_lower": 0.2, "V_upper": 0.2}, "collapse": collapse, "stages": [stage],
            "ties": ties, "reactions": {"base": [1.0, 0.0, 20.0, 0.0, -1e-9, 3.0]},
        }
    )  # fmt: skip
    told = {name: line[1:3] for name, line in lines.items()}
    assert told["stage 1"] == ("displacement: completed", "V = 216.0 ± 1.0 N, certified")
    assert told["tie a - b"] == ("200 N", "yielded by 1.8 mm") and told["tie a - c"] == ("5 N", "7 N at most")
    assert told["reaction of base"] == ("1, 0, 20 N", "0, 0, 3 N m about its centroid")
    assert told["blocks that move"][0] == "a, b" and told["hinges"][0] == "b / a"
    assert told["after a peak"] == ("load factor 0.18", "the height of the peak depends on the load path")
    assert told["path range"] == ("0.19 to 0.21", "by 9 of 10 paths of the same structure, without their bars")
    assert told["bound"] == ("0.22", "associative: no path exceeds it")
    settled = names({"collapse": {"settlement": 0.2, "settlement_range": [0.19, 0.21], "mechanism": "rocking"}})
    assert settled["settlement at collapse"].remark.startswith("between 190 and 210 mm; ")


def test_stages_without_a_limit_tell_what_their_supports_bear():
    settlement = {"reaction": 2156.09, "displacement": 0.01, "least": {"reaction": 2130.71, "displacement": 1.25e-4}}
    settlement["greatest"] = {"reaction": 2499.85, "displacement": 0.0}
    wrenches = {name: [sign * 2499.79, -3e-14, 6905.8, 0.0, 744.0, 0.0] for name, sign in (("a", 1), ("b", -1))}
    stages = [
        {"kind": "statics", "status": "stands", "reactions": wrenches},
        {"kind": "settlement", "status": "completed", "reactions": wrenches, "settlement": settlement},
        {"kind": "statics", "status": "stands", "reactions": {"base": [0.0, 0.0, 20.0, 0.0, 0.0, 0.0]}},
        {"kind": "statics", "status": "stands", "reactions": wrenches | {"c": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]}},
        {"kind": "statics", "status": "stands", "reactions": {"a": [1.0], "b": None}, "settlement": {"reaction": 1.0}},
    ]
    lines = names({"stages": [{"stage": i, **stage} for i, stage in enumerate(stages, 1)]})
    of_both = "reactions: a 2499.79, 0, 6905.8 N; b -2499.79, 0, 6905.8 N"
    assert [lines[f"stage {i}"].remark for i in range(1, 6)] == [
        of_both,
        "reaction along the motion 2156.09 N at 10 mm, least 2130.71 N at 0.125 mm, "
        "greatest 2499.85 N before the supports moved",
        "",
        f"{of_both} and 1 more",
        "",
    ]


def test_of_many_supports_and_ties_some_have_a_line():
    wrench, tie = [1.0] * 6, {"between": ["a", "b"], "tension": 1.0}
    lines = names({"ties": [tie] * 9, "reactions": {f"s{i}": wrench for i in range(11)}})
    assert lines["more ties"].value == "1" and lines["more supports"].value == "3" and "reaction of s8" not in lines


@pytest.mark.parametrize("junk", [None, True, "x", [], [1], [{}], {"a": [1]}, {"a": "x"}, {"a": [math.nan] * 6}])
def test_junk_beside_the_limit_is_left_out(junk):
    ends = {"least": {"reaction": 2130.0, "displacement": 2e-3}, "greatest": {"reaction": 2500.0, "displacement": 0.0}}
    settled = names({"settlement": ends})
    assert settled["least reaction"].remark == "at 2 mm"
    assert settled["greatest reaction"].remark == "before the supports moved", "at 0 µm is no place on the way"
    keys = ("path_range", "paths", "wanders", "blocks", "hinges", "settlement_range", "left_out", "associative")
    beside = dict.fromkeys(keys, junk)
    results = {"stages": junk, "ties": junk, "reactions": junk, "collapse": beside, "path": beside}
    assert {line.name for line in key_numbers(results)} <= {"blocks that move", "hinges"}


@pytest.mark.parametrize("junk", [None, True, "x", [], {"V": "x"}, {"V": [1]}, {"V": math.nan}, {"V": 10**400}])
def test_junk_is_left_out(junk):
    assert key_numbers({"yield_point": junk, "theory": junk, "collapse": junk, "wall": junk, "steps": junk}) == []
    assert summary.number(10**400) is None and summary.number(True) is None and summary.number(2) == 2.0


@pytest.mark.parametrize(
    "error, text", [(0.00145, "0.0015"), (0.067, "0.067"), (0.0671, "0.068"), (99.2, "1e+02"), (0.0, "0")]
)
def test_an_error_is_never_rounded_down(error, text):
    assert rounded_up(error) == text and float(text) >= error
    assert rounded_up(1.31e-3, 1) == "0.002"
    assert with_error(12345.0, 340.2, "N") == "12345 ± 341 N" and with_error(216.0, 1.01, "N") == "216.0 ± 1.1 N"


def test_bars_of_refined_runs_are_those_of_the_limit():
    """The bracket is that of the refined runs if it is wider than that of the path."""
    refined = {"yield_point": POINT | {"bracket": "indicator"}, "error_estimate": 5.0}
    point = summary.yield_point(refined)
    assert (point["V_lower"], point["V_upper"], point["bracket"]) == (point["V"] - 5.0, point["V"] + 5.0, "refined")
    assert summary.yield_point(refined | {"yield_point": POINT})["bracket"] == POINT["bracket"]  # stays certified


def test_a_value_is_cut_at_the_second_digit_of_a_great_bar():
    assert summary.barred(545073.597, 2.8e6) == ("5e+05", "2.9e+06")
    assert summary.barred(1.2345678e9, 3.2e6) == ("1.2346e+09", "3.3e+06")


def test_what_a_collapse_leaves_out_is_told_once():
    beside = {"left_out": [{"text": "4 joints rock about points"}]}
    assert names({"path": beside, "collapse": beside})["left out"].value == "4 joints rock about points"


def test_a_path_that_ends_in_a_collapse_says_so():
    point = POINT | {"V": 198.9, "V_lower": 198.9, "V_upper": None, "bracket": "open", "displacement": 0.1576}
    told = names({"yield_point": point, "status": "collapse"})["V"]
    assert told.remark == "at the end, 157.6 mm, where blocks fall, no upper bound"


def test_a_record_that_comes_near_its_limit_says_how_near():
    point = POINT | {"V": 216.0, "V_lower": 215.0, "V_upper": 217.0, "V_peak": 210.7, "displacement_at_peak": 0.04}
    told = names({"yield_point": point | {"bracket": "indicator"}})
    assert "98 % of the limit" in told["largest V"].remark and "at the largest load" in told["joint forces"].remark


def test_loads_of_pressures_have_no_unit():
    results = {"theory": {"V": 3.5316}, "after": {"displacement": 1.0, "load": 0.2, "blocks": ["a"], "mechanism": "x"}}
    told = {line.name: line for line in key_numbers(results, "1")}
    assert told["theory"].value == "3.5316" and "at a load factor of 0.2;" in told["beyond the limit"].remark
    assert "at V = 0.2 N;" in names(results)["beyond the limit"].remark
