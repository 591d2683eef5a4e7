"""The reader of CSV files: units, separators, records of the PEER database, and refusals."""

import os

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.runs import fit
from dembrick.runs.study import plan
from dembrick.scenario import csv_tables, text_files, units
from dembrick.simulation.dynamics.time_histories import read_samples
from dembrick.views import plot

RECORD = """PEER NGA STRONG MOTION DATABASE RECORD
Somewhere, 10/15/1979, Station 5, 140
ACCELERATION TIME SERIES IN UNITS OF G
NPTS=      7, DT=   .0050 SEC
   .1000000E+00  -.2000000E+00   .3000000E-01-.4000000E-01   .0000000E+00
   .5000000E+00   .1000000E+01
"""


def file(tmp_path, text, name="data.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def acceleration(path):
    return csv_tables.read_columns(path, "a history", ("time", "acceleration"))[0]["acceleration"]


@pytest.mark.parametrize(
    ("title", "size"),
    [
        ("acceleration [g]", 9.80665),
        ("acceleration (g)", 9.80665),
        ("acc (m/s2)", 1.0),
        ("a [m/s^2]", 1.0),
        ("a [m/s²]", 1.0),
        ("a [cm/s2]", 0.01),
        ("a [Gal]", 0.01),
        ("a (north) [mm/s2]", 0.001),
    ],
)
def test_an_acceleration_comes_in_the_unit_of_its_title(tmp_path, title, size):
    """Accelerations are converted from the unit in the column title to m/s2: 0.35 g are 3.43 m/s2."""
    found = acceleration(file(tmp_path, f"time [s], {title}\n0, 0.35\n1, -2\n"))
    np.testing.assert_allclose(found, [0.35 * size, -2.0 * size], rtol=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "time [s],a [g]\n0,0.5\n0.5,1.25e-1\n",
        "\ufefftime [s],a [g]\r\n0,0.5\r\n0.5,0.125\r\n",
        "time [s];a [g]\n0;0,5\n0,5;0,125\n",
        "time [s]\ta [g]\n0\t0,5\n0.5\t0.125\n",
        "time [s]\ta [g]\n0\t0.5\n0.5\t0.125\n",
        "# station 5\n\n  # filtered\ntime [ms], a [g]\n0, 0.5\n\n# a gap\n500, 0.125\n",
        '"time [s]", "a [g]"\n"0", "0.5"\n0.5, 0.125\n',
        "a [g], note, time [s]\n0.5, x, 0\n0.125, y, 0.5\n",
        "time [s],a [g]\r0,0.5\r0.5,0.125\r",
    ],
)
def test_one_table_in_many_spellings(tmp_path, text):
    path = file(tmp_path, text)
    found, _ = csv_tables.read_columns(path, "a history", ("time", "acceleration"))
    np.testing.assert_allclose(found["time"], [0.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(found["acceleration"] / units.STANDARD_GRAVITY, [0.5, 0.125], rtol=1e-15)


@pytest.mark.parametrize("numbers, said", [
    (("950.0", "1,150"), "line 3: 1,150 may mean 1150 or 1.150"),
    (("950,0", "1.150"), "line 3: 1.150 may mean 1150 or 1.150"),
    (("950", "1,150"), "line 3: 1,150 may mean 1150 or 1.150"),
])  # fmt: skip
@pytest.mark.parametrize("divider", [";", "\t"])
def test_marks_of_thousands_are_no_decimals(tmp_path, numbers, said, divider):
    lines = [f"{i}{divider}{number}" for i, number in enumerate(numbers)]
    path = file(tmp_path, "\n".join([f"time [s]{divider}force [N]", *lines]) + "\n")
    with pytest.raises(ScenarioError, match=said):
        csv_tables.read_columns(path, "a history", ("time", "force"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "0,0\n1,1\n",
            'the first line must name the columns and their units; write a first line such as "time .s., acc',
        ),
        ("time,acceleration\n0,0\n1,1\n", "the column 'time' has no unit; write it in brackets, as in 'time .s.'"),
        ("time [s],acceleration\n0,0\n1,1\n", "the column 'acceleration' has no unit; .* 'acceleration .m/s2.'"),
        ("time [s],acceleration [G's]\n0,0\n1,1\n", "the unit \"G's\" of the column 'acceleration' is unknown; write "),
        ("time [s],velocity [m/s]\n0,0\n1,1\n", "no column has a unit of acceleration"),
        (
            "time [s],x [g],y [g]\n0,0,0\n1,1,1\n",
            "the columns 'x', 'y' all have a unit of acceleration; call one 'acceleration', or pick it by col",
        ),
        ("time [s],a [g]\n0,0\n1\n", "line 3: 1 values for 2 columns$"),
        ("time [s],a [g]\n0,00,0,01\n", "line 2: 4 values for 2 columns; with decimal commas, separate .* semicolons"),
        ("time [s],a [g]\n0.0,0.1,0.2\n", "line 2: 3 values for 2 columns$"),
        ("time [s],a [g]\n0,0\n# note\n1,1_0\n", "line 4: '1_0' in column 'a' is not a finite number"),
        ("time [s],a [g]\n0,inf\n1,1\n", "line 2: 'inf' in column 'a' is not a finite number"),
        ('time [s],a [g]\n0,"1\n1,1\n', "line 2: unexpected end of data"),
        ("", "the file is empty"),
        ("time [s],a [g]\n0,0\n", "at least 2 lines"),
    ],
)
def test_what_is_no_table_of_numbers(tmp_path, text, said):
    with pytest.raises(ScenarioError, match=said):
        acceleration(file(tmp_path, text))


def test_columns_are_picked_by_name(tmp_path):
    path = file(tmp_path, "t [s],north [g],east [g],up [m/s]\n0,1,2,3\n1,4,5,6\n")

    def east(*columns):
        return csv_tables.read_columns(path, "a history", ("time", "acceleration"), columns)[0]["acceleration"]

    np.testing.assert_allclose(east("t", "east"), np.array([2.0, 5.0]) * 9.80665)
    np.testing.assert_allclose(east("t", "east [g]"), np.array([2.0, 5.0]) * 9.80665)
    with pytest.raises(ScenarioError, match="there is no column 'eest'; did you mean 'east'"):
        east("t", "eest")
    with pytest.raises(ScenarioError, match="column 'up' has the unit 'm/s', which is not one of acceleration"):
        east("t", "up")


def test_a_record_of_the_peer_data_base(tmp_path):
    samples = read_samples(file(tmp_path, RECORD, "rsn.AT2"), 0.03, "acceleration")
    np.testing.assert_allclose(samples.time, 0.005 * np.arange(7), rtol=1e-15)
    np.testing.assert_allclose(samples.value / 9.80665, [0.1, -0.2, 0.03, -0.04, 0.0, 0.5, 1.0], rtol=1e-15)
    old = RECORD.replace("NPTS=      7, DT=   .0050 SEC", "   7    0.0050    NPTS, DT")
    np.testing.assert_array_equal(read_samples(file(tmp_path, old, "o.at2"), 0.03, "acceleration").value, samples.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            RECORD.replace("UNITS OF G", "UNITS OF FT"),
            "line 3: the record is in the unit 'FT', but acceleration is needed",
        ),
        (RECORD.replace("UNITS OF G", "UNITS OF CM/SEC"), r"line 3: the record is of velocity \(CM/SEC\)"),
        (RECORD.replace("IN UNITS OF G", ""), "line 3: a PEER record states its unit"),
        (RECORD.replace("NPTS=      7", "NPTS=      8"), "7 values where line 4 says NPTS= 8"),
        (RECORD.replace("NPTS=", "N="), "line 4: a PEER record states NPTS="),
        (RECORD.replace(".5000000E+00", "much"), "line 6: .* is not a line of numbers"),
        ("short\n", "four lines of header"),
    ],
)
def test_records_that_are_damaged(tmp_path, text, said):
    with pytest.raises(ScenarioError, match=said):
        read_samples(file(tmp_path, text, "rsn.AT2"), 0.03, "acceleration")


READERS = {
    "history": lambda path: read_samples(path, 1.0, "acceleration"),
    "measured curve": plot.read_measured,
    "yield points": fit.read,
    "study": plan.load,
    "table of a study": plan._read_csv,
}


@pytest.mark.parametrize("name", READERS)
def test_no_reader_waits_or_reads_for_ever(tmp_path, name, monkeypatch):
    """Endless devices, pipes without a writer, folders, oversized files and text that is not UTF-8 are refused."""
    read = READERS[name]
    os.mkfifo(tmp_path / "pipe.csv")
    for path in ("/dev/zero", tmp_path / "pipe.csv"):
        with pytest.raises(ScenarioError, match="not an ordinary file"):
            read(path)
    with pytest.raises(ScenarioError, match="this is a folder"):
        read(tmp_path)
    with pytest.raises(ScenarioError, match="there is no such file"):
        read(tmp_path / "none.csv")
    with pytest.raises(ScenarioError, match="not UTF-8 text .line 2."):
        read(file(tmp_path, "time [s]\nµ\n", encoding="latin-1"))
    monkeypatch.setattr(text_files, "LARGEST_FILE", 1 << 20)
    with pytest.raises(ScenarioError, match="longer than 1 MiB"):
        read(file(tmp_path, "#" * ((1 << 20) + 1)))


def test_a_load_history_is_a_factor(tmp_path):
    samples = read_samples(file(tmp_path, "time [s];factor [%]\n0;0\n1;150\n"), 1.0, "factor")
    np.testing.assert_allclose(samples.value, [0.0, 1.5])
