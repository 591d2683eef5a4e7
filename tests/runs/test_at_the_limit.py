"""Results at the limit describe the limit itself: mechanism, blocks, pictures and joints, whatever the path does later.
Compared with limit analysis and with the equilibrium of one block."""

import numpy as np
import pytest

import dembrick
from dembrick import history
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs import limit
from dembrick.views.motion.frames import ejected, frame_number, peak_time
from dembrick.views.motion.table import joint_table
from dembrick.views.page import content
from helpers.key_lines import key_lines
from helpers.scenario_text import header
from helpers.two_blocks import BLOCKS, RATE

CORNER = (
    header(friction=0.67, normal_stiffness=1e10, density=2300.0)
    + """
[[walls]]
name     = "south"
material = "stone"
block    = [0.6, 0.3, 0.25]
courses  = 10
blocks   = 8
openings = [
  { span = [0.9, 1.8], courses = [1, 8], lintel = 0.3 },
  { span = [2.7, 3.6], courses = [4, 8], lintel = 0.3 },
]
returns  = [{ end = "left", side = "back", blocks = 3 }, { end = "right", side = "back", blocks = 5 }]
base     = 0.2
[control]
kind = "tilt"
axis = [1.0, 0.0, 0.0]
"""
)


@pytest.fixture(scope="module")
def corner(tmp_path_factory):
    """The facade leans out; long after that, a single stone of the jamb flies off."""
    path = tmp_path_factory.mktemp("corner") / "corner.h5"
    return dembrick.simulate(dembrick.loads(CORNER), path), path


def test_blocks_are_those_that_move_at_the_limit(corner):
    result, _ = corner
    of_theory = limit.limit(result.scenario).as_dict()["blocks"]
    fallen, after = result.collapse, result.after
    assert len(set(of_theory) & set(fallen["blocks"])) > 0.9 * len(of_theory)
    assert fallen["mechanism"] == "sliding" and fallen["displacement"] < 0.1
    assert (
        after["blocks"] == ["south.3.2"] and after["displacement"] > 1.0 and after["load"] < result.yield_point.V_lower
    )
    assert "south.3.2" in key_lines(result)["beyond the limit"]


def test_the_record_has_a_frame_of_the_limit(corner):
    result, path = corner
    with history.read(path) as found:
        number = frame_number(found)
        assert found.n_frames < found.n_row / 4 and number < found.n_frames - 1
        assert found.frame_time[number] == peak_time(found) == result.yield_point.limit_at
        assert found.load[int(peak_time(found))] == found.load.max()
        assert (np.diff(found.frame_time) > 0).all() and found.frame_time[-1] == found.time[-1]
        moved = np.linalg.norm(found.frame("displacement", number) - found.frame("displacement", 0), axis=1)
        assert moved.max() == pytest.approx(result.collapse["displacement"], rel=1e-12)
        assert frame_number(found, "last") == found.n_frames - 1
        with pytest.raises(ScenarioError, match="give peak, last or the number"):
            frame_number(found, "best")


def test_joints_and_page_show_the_limit_and_leave_out_what_comes_off_later(corner, tmp_path, capsys):
    result, path = corner
    with history.read(path) as found:
        assert max(row["utilisation"] or 0.0 for row in joint_table(found)) < 1.01
        slips = [max(row["slip"] for row in joint_table(found, frame)) for frame in (None, "last")]
        assert slips[0] < 0.1 and slips[1] > 0.3  # a stone that has flown off, and slid while it touched
        own = {row["joint"]: row for row in joint_table(found)}["/".join(result.yield_point.joint)]
        assert own["N"] == pytest.approx(result.yield_point.N) and own["V_2"] == pytest.approx(result.yield_point.V_2)
        data = content.collect(found)
        assert data["time"][data["shown"]] == result.yield_point.limit_at
        assert data["most"] < 0.1 and np.array(found.block_names)[ejected(found)].tolist() == ["south.3.2"]
    assert main(["joints", str(path)]) == 0
    at, angle = int(result.yield_point.limit_at), result.collapse["angle"]
    load = f"load factor {result.yield_point.V:.4g}"
    head, at_limit = capsys.readouterr().out.splitlines()[0].split(", table at ")
    assert head == f"equilibrium {at} (the limit)" and at_limit.endswith(f" deg, {load}")
    assert float(at_limit.split()[0]) == pytest.approx(angle, abs=0.01)
    assert main(["joints", str(path), "--frame", "last"]) == 0
    assert f"past the limit, which is at {at}" in capsys.readouterr().out
    with history.read(path) as found:
        between = max(set(range(at)) - {int(time) for time in found.frame_time})  # an equilibrium without a frame
        row = joint_table(found, time=float(between))
        assert row[0]["N"] == found.joint("N")[between, 0]
    assert main(["joints", str(path), "--time", str(between)]) == 0
    assert capsys.readouterr().out.startswith(f"equilibrium {between}, ")


@pytest.mark.parametrize("formulation", ["convex", "concave", "corrected"])
@pytest.mark.parametrize("swapped", [False, True])
def test_a_lone_joint_carries_what_balances_the_limit(formulation, swapped):
    text = BLOCKS.replace("convex", formulation)
    if swapped:  # the first block of the joint moves, pressed upwards against the second
        text = text.replace("fixed = true\n", "")
        text = text.replace("position = [0.0, 0.0, 0.075]\n", "position = [0.0, 0.0, 0.075]\nfixed = true\n")
        text = text.replace('"upper"\nforce = [0.0, 0.0, -1500.0]', '"lower"\nforce = [0.0, 0.0, 2112.144]')
        text = text.replace('"upper"\npoint = [0.12, 0.0, 0.075]', '"lower"\npoint = [0.12, 0.0, -0.075]')
    result = dembrick.simulate(dembrick.loads(text))
    point, side = result.yield_point, -1.0 if swapped else 1.0
    weight = 0.4 * 0.2 * 0.15 * 2600.0 * 9.81
    N = 2112.144 - weight if swapped else 1500.0 + weight
    expected = N, 0.0, side * point.V, side * 0.12 * point.V
    assert (point.N, point.V_1, point.V_2, point.M_T) == pytest.approx(expected, rel=1e-12, abs=1e-9)
    assert point.V_lower <= abs(point.V_2) <= point.V_upper
    (reaction,) = result.reactions.values()
    assert reaction[1] == pytest.approx(-point.V, rel=1e-12)


def test_no_force_of_a_certified_test_lies_above_its_bound():
    point = dembrick.simulate(dembrick.loads(RATE)).yield_point
    assert point.bracket == "certified"
    assert point.V_lower <= point.V_2 <= point.V_upper < point.V_peak  # V_peak of the record has a rate effect
