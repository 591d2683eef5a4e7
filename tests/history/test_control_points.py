"""Control points: displacements of material points in every kind of run and in the history; and kinds of actuators."""

import csv
import json
import math

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.assembly.build import assemble
from dembrick.cli import main
from dembrick.errors import HistoryError, ScenarioError
from dembrick.history.tables import columns_of
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from dembrick.views import plot
from helpers import history_cases as cases
from helpers.places import SCENARIOS

TOP = 0.1  # m, of the upper block of set4a


def with_points(stem, *points):
    text = (SCENARIOS / f"{stem}.toml").read_text()
    for name, block, point in points:
        text += f'\n[[control_points]]\nname = "{name}"\nblock = "{block}"\n'
        text += "" if point is None else f"point = {list(point)}\n"
    return scenarios.loads(text)


@pytest.mark.parametrize("stem", ["set4a", "set4a_mid_curve"])
def test_a_point_at_the_jack_moves_as_the_jack_says(stem):
    given = with_points(stem)
    jack = given.actuators[0]
    result = simulate(with_points(stem, ("rod", "upper", jack.point)))
    way = result.rows["control_point"][:, 0]
    driven = result.rows["actuator_displacement"][:, 0]
    assert driven[-1] > 1e-6
    # the kernel of a search assumes small rotations: the rotation term of the point is of second order
    np.testing.assert_allclose(way @ jack.direction, driven, rtol=1e-4, atol=1e-14)
    assert result.control_points["rod"] == pytest.approx(way[-1].tolist(), rel=0.01, abs=1e-15)  # perhaps an older row
    assert result.as_dict()["control_points"]["rod"] == result.control_points["rod"]


def test_a_corner_of_a_block_that_turns_on_its_toe():
    result = simulate(with_points("rocking_push", ("corner", "block", (-0.1, 0.25, 1.0)), ("middle", "block", None)))
    q = result.frames["orientation"][:, 1]
    theta = 2.0 * np.arctan2(q[:, 2], q[:, 0])
    rows = np.searchsorted(result.rows["time"], result.frames["time"])
    way = result.rows["control_point"][rows]
    np.testing.assert_allclose(way[:, 1], result.frames["displacement"][:, 1], atol=1e-15)
    assert theta[-1] > 0.1
    # rotated by theta about the toe, from its place 0.2 m in front of the toe and 1 m above it
    expected = [
        -0.2 * (np.cos(theta) - 1.0) + 1.0 * np.sin(theta),
        0.0 * theta,
        0.2 * np.sin(theta) + 1.0 * (np.cos(theta) - 1.0),
    ]
    np.testing.assert_allclose(way[:, 0], np.transpose(expected), atol=5e-6)  # the joint is elastic


def test_a_centroid_of_an_arch_that_is_pushed(tmp_path):
    given = with_points("arch", ("crown", "arch.9", None))
    result = simulate(given, tmp_path / "arch.h5")
    crown = result.assembly.names.index("arch.9")
    np.testing.assert_allclose(
        result.rows["control_point"][-1, 0], result.frames["displacement"][-1, crown], rtol=1e-9, atol=1e-15
    )
    with history.read(tmp_path / "arch.h5") as file:
        assert file.control_point.shape == (file.n_row, 1, 3)
        (point,) = file.control_points
        assert (point["name"], point["block"]) == ("crown", crown)
        np.testing.assert_allclose(point["point"], result.assembly.position[crown])


def test_on_the_command_line(tmp_path, capsys):
    """JSON, text and figure of a run with two control points; a run without any says what to add."""
    path = tmp_path / "push.toml"
    path.write_text(scenarios.dumps(with_points("rocking_push", ("a", "block", (0.1, 0.0, 1.0)), ("b", "block", None))))
    file = str(tmp_path / "push.h5")
    assert main(["run", str(path), "--out", file, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)["control_points"]
    assert list(said) == ["a", "b"]
    assert math.hypot(*said["b"]) == pytest.approx(0.06, rel=1e-2)
    assert main(["export", file, "--to", str(tmp_path / "push.csv")]) == 0
    with open(tmp_path / "push.csv", newline="") as lines:
        table = list(csv.DictReader(lines))
    assert [float(table[-1][f"u_{axis} of b [m]"]) for axis in "xyz"] == pytest.approx(said["b"], abs=1e-15)
    assert main(["plot", file, "--kind", "points", "--to", str(tmp_path / "push.png")]) == 0
    with history.read(file) as found:
        (axes,) = plot.control_points([found]).axes
    names = [f"{point}, $u_{axis}$" for point in "ab" for axis in "xz"]  # nothing moves along y
    assert [line.get_label() for line in axes.lines] == names
    for line, axis in zip(axes.lines[2:], "xz", strict=True):  # signed, relative to the dead-load equilibrium
        moved = float(table[-1][f"u_{axis} of b [m]"]) - float(table[0][f"u_{axis} of b [m]"])
        assert line.get_xdata()[-1] == pytest.approx(1e3 * moved)
    assert axes.get_xlabel() == "displacement of control points [mm]"
    simulate(SCENARIOS / "set4a.toml", tmp_path / "none.h5")
    with history.read(tmp_path / "none.h5") as found, pytest.raises(HistoryError, match=r"add \[\[control_points\]\]"):
        plot.control_points([found])


def test_a_point_that_a_file_rounds_to_the_outside_is_on_the_face():
    """Points outside by less than a millionth of the block, as coordinates in files are rounded, are accepted."""
    assemble(with_points("set4a", ("a", "upper", (0.0, 0.0, TOP + 2e-7))))
    with pytest.raises(ScenarioError, match="outside block 'upper'"):
        assemble(with_points("set4a", ("a", "upper", (0.0, 0.0, TOP + 2e-6))))


@pytest.mark.parametrize(
    "point, words",
    [
        (
            ("a", "upper", (0.0, 0.0, 0.2)),
            "control point 'a': its point .* lies 0.1 m outside block 'upper'; put it in the block, whose centroid",
        ),
        (("a", "uper", None), "block of control point 'a' = 'uper' .*did you mean 'upper'"),
        (("", "upper", None), "name = ''"),
    ],
)
def test_points_that_are_refused(point, words):
    with pytest.raises(ScenarioError, match=words):
        simulate(with_points("set4a", point))


def test_two_of_a_name_and_a_group_are_refused():
    with pytest.raises(ScenarioError, match="two control points are named 'a'"):
        with_points("set4a", ("a", "upper", None), ("a", "lower", None))
    with pytest.raises(ScenarioError, match="'arch' is a group; name one block of it"):
        with_points("arch", ("a", "arch", None))


@pytest.mark.parametrize(
    "name, kind", [("jack", "actuator"), ("pressure on upper", "pressure"), ("load on upper", "body force")]
)
def test_files_of_earlier_versions_tell_kinds_of_actuators_by_their_names(tmp_path, name, kind):
    path = cases.finished(tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        del file["geometry/actuators/kind"]
        file["geometry/actuators/name"][0] = name
    with history.read(path) as found:
        assert found.actuators[0]["kind"] == kind


def test_a_kind_of_actuator_that_there_is_not_is_an_error(tmp_path):
    path = cases.finished(tmp_path / "run.h5")
    with h5py.File(path, "r+") as file:
        file["geometry/actuators/kind"][0] = "spring"
    with history.read(path) as found, pytest.raises(HistoryError, match="'spring', which is not one of actuator"):
        _ = found.actuators


def test_a_dataset_has_their_motion_and_their_names(tmp_path):
    """The series and the dimension shared a name, which xarray refuses."""
    pytest.importorskip("xarray")
    result = simulate(
        with_points("set4a", ("rod", "upper", None), ("edge", "upper", (0.1, 0.0, 0.1))), tmp_path / "a.h5"
    )
    with history.read(tmp_path / "a.h5") as found:
        data = found.to_xarray()
    assert data["control_point_displacement"].dims == ("row", "control_point", "axis")
    assert data.control_point.values.tolist() == ["rod", "edge"]
    moved = data["control_point_displacement"].sel(control_point="edge", axis="y")
    np.testing.assert_array_equal(moved, result.rows["control_point"][:, 1, 1])


def test_loads_of_one_block_have_columns_of_their_own(tmp_path):
    """A tilt loads a block by its weight and by its dead load, both at a point of that block."""
    text = (SCENARIOS / "set4a.toml").read_text().partition("[control]")[0].replace("[[actuators]]", "[[none]]")
    text = text.partition("[[none]]")[0] + '[control]\nkind = "tilt"\naxis = [1.0, 0.0, 0.0]\n'
    simulate(scenarios.loads(text), tmp_path / "tilt.h5")
    with history.read(tmp_path / "tilt.h5") as found:
        titles = [title for _, own in columns_of(found) for title in own]
        weights = [actuator["weight"] for actuator in found.actuators]
    assert len(weights) == 2 and len(set(titles)) == len(titles)
    assert titles[-2:] == ["force of load on upper #0 [N]", "force of load on upper #1 [N]"], "after all others"
