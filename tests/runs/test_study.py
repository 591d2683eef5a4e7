"""Studies: their cases, and how these are drawn, run, stored and continued."""

import json
import math
import os
import signal
import statistics

import h5py
import numpy as np
import pytest

from dembrick import cli
from dembrick.cli import sweep
from dembrick.errors import OutputError, ScenarioError
from dembrick.runs import study as studies
from dembrick.runs.study.draws import Draws, distribution
from dembrick.runs.study.executors import ClusterError, run_here, run_local
from dembrick.scenario import shipped
from dembrick.views import plot
from helpers.scenario_text import block, header
from helpers.studies import read_csv, write_study

BASE = (shipped.folder() / "set4a.toml").read_text(encoding="utf-8")
THREE = '[grid]\n"joint.friction" = [0.5, 0.6, 0.7]\n'
PRESSED = header("convex") + block("floor", (0.0, 0.0, -0.05), (0.6, 0.6, 0.1), "fixed = true")
PRESSED += (
    block("stone", (0.0, 0.0, 0.05))
    + """
[[pressures]]
block = "stone"
direction = [-1, 0, 0]
value = 1000.0
actuator = true
[control]
kind = "yield"
"""
)
DRAWS = """
[grid]
joint.formulation = ["concave", "corrected"]
[draws]
count = 8
seed = 3
method = "latin-hypercube"
[draws.of]
joint.friction = { distribution = "normal", mean = 0.64, deviation = 0.03, lower = 0.0 }
"""


@pytest.fixture
def write(tmp_path):
    return lambda body, base=BASE: write_study(tmp_path, body, base)


def test_parts_of_a_study_are_combined_and_the_last_runs_fastest(write):
    study = studies.load(
        write(
            '[grid]\n"joint.formulation" = ["concave", "convex"]\n"control.tolerance" = { from = 1e-4, to = 1e-2, '
            'count = 3, spacing = "log" }\n[list]\n"joint.friction" = [0.5, 0.7]\n'
        )
    )
    assert len(study) == 12
    cases = [study.changes(i) for i in range(12)]
    assert [case["joint.friction"] for case in cases] == [0.5, 0.7] * 6
    assert [case["joint.formulation"] for case in cases] == ["concave"] * 6 + ["convex"] * 6
    assert [case["control.tolerance"] for case in cases[::2]] == pytest.approx([1e-4, 1e-3, 1e-2] * 2)
    assert studies.scenario_of(study, 7).joint.friction == 0.7
    assert len({tuple(case.values()) for case in cases}) == 12


def test_cases_out_of_a_csv_file(write, tmp_path):
    (tmp_path / "cases.csv").write_text('joint.friction,joint.formulation\n0.5,concave\n0.6,"""convex"""\n')
    study = studies.load(write('[table]\nfile = "cases.csv"\n'))
    assert [studies.scenario_of(study, i).joint.formulation for i in (0, 1)] == ["concave", "convex"]
    assert [studies.scenario_of(study, i).joint.friction for i in (0, 1)] == [0.5, 0.6]


def test_the_digest_knows_one_study_from_another(write):
    first = studies.load(write(THREE)).digest
    assert studies.load(write("histories = true\n" + THREE)).digest == first  # the cases are the same
    assert studies.load(write(THREE.replace("0.7", "0.71"))).digest != first
    assert studies.load(write(THREE, BASE.replace("467", "466").replace("378.71", "378"))).digest != first


@pytest.mark.parametrize(
    ("table", "mean", "deviation"),
    [
        ({"distribution": "normal", "mean": 0.64, "deviation": 0.03}, 0.64, 0.03),
        ({"distribution": "lognormal", "mean": 0.64, "deviation": 0.2}, 0.64, 0.2),
        ({"distribution": "uniform", "lower": 1.0, "upper": 4.0}, 2.5, 3.0 / math.sqrt(12.0)),
        ({"distribution": "triangular", "lower": 0.0, "mode": 1.0, "upper": 3.0}, 4 / 3, math.sqrt(7 / 18)),
        ({"distribution": "normal", "mean": 0.0, "deviation": 1.0, "lower": 0.0}, math.sqrt(2 / math.pi), 0.60281),
    ],
)
def test_distributions_have_the_mean_and_deviation_of_their_closed_forms(table, mean, deviation):
    one = distribution("key", table)
    values = [one.at((i + 0.5) / 200_000) for i in range(200_000)]
    assert statistics.fmean(values) == pytest.approx(mean, rel=1e-3)
    assert statistics.pstdev(values) == pytest.approx(deviation, rel=2e-3)
    assert all(one.lower <= value <= one.upper for value in (one.at(0.0), one.at(1.0 - 1e-16)))


def test_latin_hypercube_takes_one_number_from_every_slice_and_pairs_them_at_random():
    of = {key: distribution(key, {"distribution": "uniform", "lower": 0.0, "upper": 1.0}) for key in "ab"}
    draws = Draws(of, 50, 1, "latin-hypercube")
    found = np.array([list(draws[i].values()) for i in range(50)])
    for column in found.T:
        assert sorted((column * 50).astype(int)) == list(range(50))
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.4
    assert np.abs(found.mean(axis=0) - 0.5).max() < 0.005  # plain Monte Carlo scatters by 0.04


def test_a_case_draws_the_same_whatever_was_drawn_before():
    of = {"a": distribution("a", {"distribution": "normal", "mean": 0.0, "deviation": 1.0})}
    for method in ("monte-carlo", "latin-hypercube"):
        alone = Draws(of, 10, 7, method)[6]
        after = Draws(of, 10, 7, method)
        assert [after[i] for i in range(10)][6] == alone
        assert Draws(of, 10, 8, method)[6] != alone


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('[grid]\n"joint.frction" = [0.5]\n', ["frction", "friction"]),
        ('[grid]\n"actuators.jock.weight" = [0.5]\n', ["jock", "jack"]),
        ('[grid]\n"joint.friction" = []\n', ["joint.friction", "empty"]),
        (THREE + '[list]\n"joint.friction" = [0.5]\n', ["two columns", "joint.friction"]),
        (THREE + "[list]\njoint = [{ friction = 0.5 }]\n", ["'joint.friction' and 'joint' set the same"]),
        ('[list]\n"actuators.0.weight" = [1.0]\n"actuators.jack.weight" = [2.0]\n', ["set the same"]),
        ('[list]\n"joint.friction" = [0.5]\n"control.tolerance" = [1e-3, 1e-4]\n', ["one length"]),
        ("", ["nothing changes"]),
        ('[grdi]\n"joint.friction" = [0.5]\n', ["grdi", "grid"]),
        ("[draws]\ncount = 0\nseed = 1\n", ["draws.count", "at least 1"]),
        ('[draws]\ncount = 2\n[draws.of]\n"joint.friction" = { distribution = "normal" }\n', ["draws.seed"]),
        (
            '[draws]\ncount = 2\nseed = 1\n[draws.of]\n"joint.friction" = { distribution = "norml", mean = 1 }\n',
            ["norml", "normal"],
        ),
        (
            '[draws]\ncount = 2\nseed = 1\n[draws.of]\n"joint.friction" = { distribution = "normal", mean = 1.0 }\n',
            ["deviation", "no default"],
        ),
        ('[table]\nfile = "none.csv"\n', ["none.csv", "there is no such file"]),
    ],
)
def test_what_is_no_study_is_refused_in_one_sentence(write, body, words):
    with pytest.raises(ScenarioError) as caught:
        studies.load(write(body))
    assert "study.toml" in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_two_columns_of_a_table_for_one_key(write, tmp_path):
    (tmp_path / "cases.csv").write_text("joint.friction,joint.friction\n0.5,0.6\n")
    with pytest.raises(ScenarioError, match="two columns"):
        studies.load(write('[table]\nfile = "cases.csv"\n'))


def test_every_case_is_a_row_of_one_table(write, tmp_path):
    outcome = studies.sweep(write(THREE), tmp_path / "out")
    rows = read_csv(outcome.csv)
    assert [row["case"] for row in rows] == ["0", "1", "2"]
    V = [float(row["V"]) for row in rows]
    assert V == pytest.approx([216.054938 * mu / 0.64 for mu in (0.5, 0.6, 0.7)], rel=1e-3)
    with h5py.File(outcome.h5) as file:
        np.testing.assert_array_equal(file["V"][:], V)
        assert file["bracket"].asstr()[0] == "certified"
        assert file["joint.friction"][:].tolist() == [0.5, 0.6, 0.7]
    assert (outcome.cases, outcome.ran, outcome.failed) == (3, 3, 0)
    assert not (tmp_path / "out" / "histories").exists()


def test_cases_run_together_come_to_what_each_comes_to_alone(write, tmp_path):
    """Frictions, loads, jacks, blocks and formulations vary; every case is also run alone, with a history."""
    body = """
[list]
joint.formulation = ["concave", "corrected-shear", "convex", "convex", "distributed", "concave"]
joint.friction = [0.5, 0.6, 0.7, 0.3, 0.64, 9.0]
actuators.jack.point = [[0.1, 0, 0], [0.1, 0.02, 0.05], [0, 0.05, 0], [-0.05, 0, 0.02], [0.075, 0, 0], [0, 0, 0.09]]
loads.upper.force = [[0, 0, -300], [10, 0, -378], [0, 5, -500], [0, 0, -378], [0, 0, -400], [0, 0, -400]]
"""
    together = read_csv(studies.sweep(write(body), tmp_path / "together").csv)
    alone = read_csv(studies.sweep(write("histories = true\n" + body), tmp_path / "alone").csv)
    # `distributed` always runs alone, and so does path following, whose bracket is no proof
    assert [row["theory"] == "" for row in together] == [True, False, True, True, False, False]
    for one, other in zip(together, alone, strict=True):
        assert one["status"] == other["status"]
        assert (one["mechanism"], one["bracket"]) == (other["mechanism"], other["bracket"])
        for name, most in (("V", 1e-4), ("V_lower", 1e-3), ("V_upper", 1e-3), ("N", 1e-9), ("M_T", 2e-3)):
            if other[name]:
                assert float(one[name]) == pytest.approx(float(other[name]), rel=most, abs=1e-9)
        assert one["load_unit"] == other["load_unit"] == "N"
        if one["mechanism"] == "torsion-shear":
            centre, expected = ([float(r[f"torsion_centre_{i}"]) for i in (1, 2)] for r in (one, other))
            assert centre == pytest.approx(expected, abs=2e-3)


def test_a_driven_pressure_is_a_factor_in_the_table_and_in_its_figure(write, tmp_path):
    """In cases that run together, and by themselves."""
    body = '[grid]\n"joint.friction" = [0.3, 0.6]\n'
    for name, more in (("together", ""), ("alone", "histories = true\n")):
        rows = read_csv(studies.sweep(write(more + body, PRESSED), tmp_path / name).csv)
        assert [(row["load_unit"], row["theory"] == "") for row in rows] == [("1", name == "together")] * 2
        assert plot.study(plot.read_study(tmp_path / name)).axes[0].get_ylabel() == "load factor V [-]"


def test_finished_cases_are_not_run_again_and_a_torn_line_is(write, tmp_path):
    path, folder = write(THREE), tmp_path / "out"
    studies.sweep(path, folder)
    before = read_csv(folder / "table.csv")
    assert studies.sweep(path, folder).ran == 0
    rows = folder / "rows_1_of_1.jsonl"
    text = rows.read_text()
    rows.write_text(text[: text.rindex('"V"') + 8])  # as if killed while writing the last line
    again = studies.sweep(path, folder)
    assert (again.ran, again.finished) == (1, 3)
    assert [row["V"] for row in read_csv(folder / "table.csv")] == [row["V"] for row in before]


def test_a_case_that_fails_is_a_row_with_its_error_and_the_rest_goes_on(write, tmp_path):
    path, folder = write('[grid]\n"joint.friction" = [0.5, -1.0, 0.7]\n'), tmp_path / "out"
    outcome = studies.sweep(path, folder)
    rows = read_csv(outcome.csv)
    assert [row["status"] for row in rows] == ["yield", "failed", "yield"]
    assert "friction" in rows[1]["error"] and rows[1]["V"] == ""
    assert outcome.failed == 1
    assert studies.sweep(path, folder).ran == 0
    assert studies.sweep(path, folder, retry=True).ran == 1


def test_rows_of_another_study_are_refused_and_left_alone(write, tmp_path):
    folder = tmp_path / "out"
    studies.sweep(write(THREE), folder)
    before = (folder / "rows_1_of_1.jsonl").read_bytes()
    with pytest.raises(OutputError, match="another study"):
        studies.sweep(write(THREE.replace("0.5", "0.4")), folder)
    assert (folder / "rows_1_of_1.jsonl").read_bytes() == before


def test_force_replaces_the_rows_of_all_shards_of_another_study_and_keeps_its_own(write, tmp_path):
    folder = tmp_path / "out"
    studies.sweep(write(THREE), folder, part="1/2")
    studies.sweep(write(THREE), folder, part="2/2")
    other = write(THREE.replace("0.5", "0.4"))
    outcome = studies.sweep(other, folder, force=True)
    assert (outcome.ran, outcome.finished) == (3, 3)
    alone = studies.sweep(other, tmp_path / "alone")
    assert [row["V"] for row in read_csv(outcome.csv)] == [row["V"] for row in read_csv(alone.csv)]
    assert studies.sweep(other, folder, force=True).ran == 0


def test_shards_make_up_the_whole(write, tmp_path):
    path = write(DRAWS)
    whole = studies.sweep(path, tmp_path / "whole")
    for part in ("1/3", "2/3", "3/3"):
        last = studies.sweep(path, tmp_path / "parts", part=part)
    assert (last.cases, last.finished) == (16, 16)
    one, other = (read_csv(outcome.csv) for outcome in (whole, last))
    assert [row["V"] for row in one] == [row["V"] for row in other]
    for bad in ("0/3", "4/3", "x", "3"):
        with pytest.raises(ScenarioError, match="--shard"):
            studies.sweep(path, tmp_path / "bad", part=bad)


def test_workers_take_one_thread_and_leave_this_process_its_own(monkeypatch):
    """numba cannot change its number of threads once they run, so a worker must not see another number first."""
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    seen = []
    for threads in run_local(os.getenv, ["unset"] * 3, 2, "NUMBA_NUM_THREADS"):
        assert "NUMBA_NUM_THREADS" not in os.environ
        seen.append(threads)
    assert seen == ["1"] * 3
    assert list(run_here(os.getenv, ["unset"], "NUMBA_NUM_THREADS")) == ["unset"]


def test_local_processes_give_the_same_table_and_the_scatter_of_V(write, tmp_path):
    path = write(DRAWS)
    one = studies.sweep(path, tmp_path / "one")
    two = studies.sweep(path, tmp_path / "two", jobs=2)
    assert [row["V"] for row in read_csv(one.csv)] == [row["V"] for row in read_csv(two.csv)]
    # V is proportional to the friction, and so is its scatter
    assert len(two.statistics) == 2
    for cell in two.statistics:
        assert cell["count"] == 8
        drawn = [
            float(r["joint.friction"]) for r in read_csv(two.csv) if r["joint.formulation"] == cell["joint.formulation"]
        ]
        share = statistics.stdev(drawn) / statistics.fmean(drawn)
        assert cell["deviation"] / cell["mean"] == pytest.approx(share, rel=1e-2)
        assert cell["standard_error"] == pytest.approx(cell["deviation"] / math.sqrt(8.0))


@pytest.mark.parametrize("deviation", [1e-6, 0.2])
def test_the_mean_of_draws_has_the_bars_of_its_cases_and_of_its_scatter(deviation, write, tmp_path, capsys):
    """A mean of cases each known to a tenth was once said to be known to a millionth, as they hardly scatter."""
    rough = "[grid]\ncontrol.tolerance = [0.1]\n"
    body = DRAWS.replace("deviation = 0.03", f"deviation = {deviation}").replace("[grid]\n", rough)
    outcome = studies.sweep(write(body), tmp_path / "out")
    for cell in outcome.statistics:
        rows = [row for row in read_csv(outcome.csv) if row["joint.formulation"] == cell["joint.formulation"]]
        half = statistics.fmean(0.5 * (float(row["V_upper"]) - float(row["V_lower"])) for row in rows)
        t = 2.364624  # Student's t for eight draws
        assert cell["half_width"] == pytest.approx(half, rel=0.2) and cell["unanswered"] == 0
        assert cell["mean_error"] == pytest.approx(cell["half_width"] + t * cell["standard_error"], rel=1e-6)
    assert cli.main(["sweep", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]) == 0
    assert " on average of 8 cases (95 %), standard deviation " in capsys.readouterr().out


def test_means_of_what_depends_on_the_path_have_two_digits():
    cell = {
        "count": 3,
        "mean": 0.43387,
        "digits_open": True,
        "deviation": 1e-7,
        "mean_error": 1e-7,
        "standard_error": 1e-7,
    }
    assert sweep._answer(cell, "").startswith("about 0.43 (of these paths) on average of 3 cases")
    shut = cell | {"digits_open": False, "mean_error": None}
    assert sweep._answer(shut, "").startswith("0.43387 (no error bar) on average")


@pytest.mark.parametrize("value", ["nan", "inf", "[1.0, -inf]", "1979-05-27"])
def test_values_that_no_table_holds_are_refused(write, value):
    with pytest.raises(ScenarioError, match="values of a case must be finite numbers, texts, or lists of them"):
        studies.load(write(f'[grid]\n"joint.friction" = [0.5, {value}]\n'))


def test_histories_if_asked_for(write, tmp_path):
    folder = tmp_path / "out"
    outcome = studies.sweep(write("histories = true\n" + THREE), folder)
    paths = [row["history"] for row in read_csv(outcome.csv)]
    assert sorted(os.path.basename(path) for path in paths) == [f"case_00000{i}.h5" for i in range(3)]
    with h5py.File(paths[1]) as file:
        assert json.loads(file.attrs["results"])["yield_point"]["V"] == float(read_csv(outcome.csv)[1]["V"])


def test_a_scheduler_that_does_not_answer(write, tmp_path):
    pytest.importorskip("distributed", reason="Dask distributed is not installed (extra 'cluster')")
    with pytest.raises(ClusterError, match="did not answer within 0.5 s"):
        studies.sweep(write(THREE), tmp_path / "out", scheduler="tcp://127.0.0.1:9", timeout=0.5)
    with pytest.raises(ScenarioError, match="neither a scheduler file nor an address"):
        studies.sweep(write(THREE), tmp_path / "out", scheduler="nowhere")


def test_a_worker_killed_half_way_loses_no_case_and_doubles_none(write, tmp_path):
    """A real scheduler with two worker processes; one worker is killed when the first rows arrive."""
    distributed = pytest.importorskip("distributed", reason="Dask distributed is not installed (extra 'cluster')")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    )
    with cluster, distributed.Client(cluster) as client:
        victims = [info["pid"] for info in client.run(lambda: {"pid": os.getpid()}).values()]
        killed = []

        def progress(done, total, _):
            if 8 <= done < total and not killed:
                killed.append(victims[0])
                os.kill(victims[0], signal.SIGKILL)

        path = write(DRAWS.replace("count = 8", "count = 40"))
        outcome = studies.sweep(path, tmp_path / "out", scheduler=cluster.scheduler_address, progress=progress)
    assert killed
    assert (outcome.finished, outcome.failed) == (80, 0)
    with open(tmp_path / "out" / "rows_1_of_1.jsonl", encoding="utf-8") as file:
        numbers = [json.loads(line)["case"] for line in file if '"case"' in line]
    assert sorted(numbers) == list(range(80))


@pytest.mark.parametrize("path", sorted((shipped.folder() / "studies").glob("*.toml")), ids=lambda path: path.stem)
def test_the_studies_that_come_along_are_sound(path):
    study = studies.load(path)
    assert len(study) > 1
    studies.scenario_of(study, len(study) - 1)


def test_answers_stand_in_the_order_of_the_cases(write, tmp_path):
    """Not in the order in which they were finished."""
    study = studies.load(write(THREE))
    studies.sweep(study, tmp_path / "out", jobs=1)
    (rows,) = (tmp_path / "out").glob("rows_*.jsonl")
    lines = rows.read_text(encoding="utf-8").splitlines(keepends=True)
    own = [i for i, line in enumerate(lines) if '"case"' in line]
    rows.write_text("".join(lines[: own[0]] + [lines[i] for i in reversed(own)]), encoding="utf-8")
    again = studies.sweep(study, tmp_path / "out", jobs=1)
    assert again.ran == 0 and [cell["joint.friction"] for cell in again.statistics] == [0.5, 0.6, 0.7]


OF_MESH = BASE.replace(
    "box      = [0.3, 0.2, 0.1]\nposition = [0.0, 0.0, 0.05]",
    'mesh     = { file = "upper.obj" }\nposition = [0.0, 0.0, 0.05]',
)


def mesh_of(height):
    """A box of 0.3 x 0.2 m as OBJ text."""
    corners = [(x, y, z) for x in (-0.15, 0.15) for y in (-0.1, 0.1) for z in (-height / 2, height / 2)]
    faces = ("1 3 7 5", "2 6 8 4", "1 5 6 2", "3 4 8 7", "1 2 4 3", "5 7 8 6")
    return "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces)


@pytest.mark.parametrize("named", ["base", "grid"])
def test_rows_of_a_file_that_has_changed_are_not_taken_for_those_of_now(named, write, tmp_path):
    (tmp_path / "upper.obj").write_text(mesh_of(0.1))
    (tmp_path / "other.obj").write_text(mesh_of(0.1))
    grid = THREE if named == "base" else '[grid]\n"blocks.upper.mesh.file" = ["upper.obj", "other.obj"]\n'
    path, folder = write(grid, base=OF_MESH), tmp_path / "out"
    studies.sweep(path, folder)
    assert studies.sweep(path, folder).ran == 0
    (tmp_path / ("upper.obj" if named == "base" else "other.obj")).write_text(mesh_of(0.12))
    with pytest.raises(OutputError, match="a file that they read has changed"):
        studies.sweep(path, folder)


def test_an_answer_counts_though_another_shard_failed(write, tmp_path):
    """The file of the shard that failed comes later in alphabetical order."""
    path, folder = write(THREE), tmp_path / "out"
    studies.sweep(path, folder)
    rows = (folder / "rows_1_of_1.jsonl").read_text().splitlines()
    failed = [json.dumps(json.loads(line) | {"status": "failed", "V": None, "error": "no"}) for line in rows[1:]]
    (folder / "rows_2_of_2.jsonl").write_text("\n".join([rows[0], *failed]) + "\n")
    again = studies.sweep(path, folder, retry=True)
    assert (again.ran, again.failed) == (0, 0)
    assert [row["status"] for row in read_csv(again.csv)] == ["yield"] * 3


def test_tables_that_no_study_wrote_are_left_alone(write, tmp_path):
    table, other = tmp_path / "table.csv", tmp_path / "other"
    table.write_text("joint.friction\n0.5\n")
    path = write('[table]\nfile = "table.csv"\n')
    for force in (False, True):
        with pytest.raises(OutputError, match="is an input of the command"):
            studies.sweep(path, tmp_path, force=force)
    assert table.read_text() == "joint.friction\n0.5\n" and not list(tmp_path.glob("*.jsonl"))
    other.mkdir()
    (other / "table.csv").write_text("mine\n")
    with pytest.raises(OutputError, match=r"table.csv: this file exists.*--force"):
        studies.sweep(path, other)
    assert (other / "table.csv").read_text() == "mine\n"
    assert studies.sweep(path, other, force=True).ran == 1
    assert studies.sweep(path, other).ran == 0  # the table is now its own
