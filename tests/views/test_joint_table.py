"""The table of joint forces at one time, compared with statics."""

import csv
import json

import pytest

from dembrick import history
from dembrick.cli import joints as joints_command
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, Output
from dembrick.views.motion.table import CONTACT, UNITS, joint_table, new_contact_table, reaction_table
from helpers.impact_scenes import scene
from helpers.places import SCENARIOS


@pytest.fixture(scope="module")
def arch(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("arch") / "arch.h5")
    simulate(SCENARIOS / "arch.toml", path)
    return path


def test_eccentricity_of_a_weight_beside_the_middle(tmp_path):
    """378.71 N at x = 0.02, y = -0.01 m and the block's 88.29 N in the middle give e = 0.811 times that position."""
    text = (SCENARIOS / "set4a.toml").read_text()
    text = text.replace("force = [0.0, 0.0, -378.71]", "force = [0.0, 0.0, -378.71]\npoint = [0.02, -0.01, 0.1]")
    assert "point = [0.02, -0.01, 0.1]" in text
    simulate(scenarios.loads(text), tmp_path / "set.h5")
    with history.read(tmp_path / "set.h5") as found:
        (row,) = joint_table(found, 0)
        assert (row["joint"], row["state"]) == ("lower/upper", "closed")
        assert row["N"] == pytest.approx(467.0, rel=1e-6)
        share = 378.71 / 467.0
        assert (row["e_1"], row["e_2"]) == (
            pytest.approx(0.02 * share, rel=1e-3),
            pytest.approx(-0.01 * share, rel=1e-3),
        )
        (last,) = joint_table(found)
        assert last["utilisation"] == pytest.approx(1.0, abs=2e-3)
        assert last["V_2"] == pytest.approx(found.load[-1], rel=1e-3)
        assert joint_table(found, time=found.frame_time[0]) == joint_table(found, 0)
        with pytest.raises(ScenarioError, match="frame 100000 is out of range"):
            joint_table(found, 100000)


def test_the_hinges_of_an_arch(arch):
    """The mechanism of a pushed arch has four hinges, with the thrust at an edge, half of 0.15 m from O."""
    with history.read(arch) as found:
        rows = joint_table(found)
    edge = [row for row in rows if max(abs(row["e_1"]), abs(row["e_2"])) > 0.0749]
    assert len(edge) == 4
    assert all(row["state"] == "partly open" and row["open_share"] > 0.75 for row in edge)
    assert [row for row in rows if row["utilisation"] > 0.9985] == edge  # a hinge is at 1


def test_on_the_command_line(arch, tmp_path, capsys):
    """The text starts with the most utilised joint; CSV and JSON have all joints in the order of the assembly."""
    assert main(["joints", arch, "--csv", str(tmp_path / "joints.csv"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    rows, reactions = told["joints"], told["reactions"]
    assert len(rows) == 18 and set(rows[0]) == {"joint", "state", *UNITS}
    with open(tmp_path / "joints.csv", newline="") as lines:
        table = list(csv.DictReader(lines))
    assert [row["joint"] for row in table] == [row["joint"] for row in rows]
    assert float(table[3]["N"]) == rows[3]["N"]
    assert main(["joints", arch]) == 0
    when, _, *lines = capsys.readouterr().out.splitlines()
    assert when.startswith("equilibrium ") and "(the limit), load factor" in when
    most = max(rows, key=lambda row: row["utilisation"])
    assert lines[1].split()[0] == most["joint"] and len(lines) == 19 + 4 and not lines[19]
    assert float(lines[1].split()[1]) == pytest.approx(most["N"], rel=1e-4)
    told = {line.split()[0]: [float(number) for number in line.split()[1:]] for line in lines[21:]}
    assert told == {name: pytest.approx(wrench, rel=1e-4, abs=1e-3) for name, wrench in reactions.items()}
    with pytest.raises(SystemExit):
        main(["joints", arch, "--frame", "0", "--time", "1"])


def test_a_history_without_joint_forces(tmp_path, capsys):
    text = (SCENARIOS / "set4a.toml").read_text() + '\n[output]\nchannels = ["frames"]\n'
    simulate(scenarios.loads(text), tmp_path / "run.h5")
    assert main(["joints", str(tmp_path / "run.h5")]) == 2
    assert '"joints" in output.channels' in capsys.readouterr().err


def test_signs_are_those_that_docs_symbols_draws(tmp_path):
    """Signs of the forces on the lower block from V along +y on the upper one, at x = 0.075 m and 0.05 m above."""
    for control in ({}, {"control": '{kind="displacement", rate=1e-5, travel=3e-5}'}):
        changes = ["actuators.0.point=[0.075, 0.0, 0.05]", *(f"{key}={value}" for key, value in control.items())]
        scenario = scenarios.load(SCENARIOS / "set4a.toml", changes)
        simulate(scenario, tmp_path / "signs.h5", force=True)
        with history.read(tmp_path / "signs.h5") as found:
            (row,) = joint_table(found)
        V = row["V_2"]
        assert V > 100.0 and row["N"] == pytest.approx(467.0, rel=1e-6)
        assert (row["M_T"], row["M_1"]) == (pytest.approx(0.075 * V, rel=1e-3), pytest.approx(-0.05 * V, rel=1e-3))
        assert (row["e_1"], row["e_2"]) == (
            pytest.approx(row["M_2"] / row["N"], abs=1e-10),  # the face is tilted by 1e-7
            pytest.approx(-row["M_1"] / row["N"], rel=1e-5),
        )


PUSHED_OFF = """title = "slides"
gravity = [0.0, 0.0, -9.81]
[joint]
formulation = "concave"
friction = 0.5
normal_stiffness = 1e8
shear_stiffness = 4e7
[materials.stone]
density = 2000.0
[[blocks]]
name = "floor"
material = "stone"
box = [2.0, 2.0, 0.2]
position = [0.0, 0.0, -0.1]
fixed = true
[[blocks]]
name = "block"
material = "stone"
box = [0.3, 0.2, 0.1]
position = [0.0, 0.0, 0.05]
[control]
kind = "pushover"
direction = [1.0, 0.0, 0.0]
large_displacements = true
"""


def test_the_last_equilibrium_at_a_time_of_the_collapse(tmp_path, capsys):
    """12 kg slide at a load factor of 0.5, with 117.72 N and 58.86 N. A time in the collapse gives the last
    equilibrium, a frame of the collapse gives zeros."""
    path = str(tmp_path / "slides.h5")
    simulate(scenarios.loads(PUSHED_OFF), path)
    with history.read(path) as found:
        last = float(found.time[-1])
        falling = [float(time) for time in found.frame_time if last < time < last + 0.5]
        (row,) = joint_table(found, time=falling[0])
        (floor,) = reaction_table(found, time=falling[0])
        assert (row["N"], row["V_1"]) == (pytest.approx(117.72, rel=1e-6), pytest.approx(58.86, rel=1e-3))
        assert row["utilisation"] == pytest.approx(1.0, abs=2e-3)
        assert (floor["F_z"], floor["F_x"]) == (pytest.approx(117.72, rel=1e-6), pytest.approx(-58.86, rel=1e-3))
        (row,), (floor,) = joint_table(found, -1), reaction_table(found, -1)
        assert row["N"] == row["V_1"] == floor["F_z"] == floor["F_x"] == 0.0
    assert main(["joints", path, "--time", str(falling[0])]) == 0
    when = capsys.readouterr().out.splitlines()[0]
    assert when.startswith(f"equilibrium {last:g}") and when.endswith(f"openings of the frame at {falling[0]:.4g}")


@pytest.mark.parametrize("recorded", [True, False])
def test_a_joint_that_was_handed_over_and_the_contact_in_its_place(tmp_path, capsys, recorded):
    """12 kg slide by v^2 / (2 mu g) = 65 mm; then the new contact carries their 117.72 N and the joint nothing."""
    blocks = (
        Block("lower", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
        Block("upper", "stone", (0.3, 0.2, 0.1), (0.08, 0.05, 0.05), velocity=(-0.8, 0.0, 0.0)),
    )
    output = Output(("joints", "frames", *(("contacts", "energy") if recorded else ())), rows=100, frames=50)
    path = str(tmp_path / "slid.h5")
    simulate(scene(DynamicControl(0.4, 0.5), *blocks, friction=0.5, stiffness=1e8, output=output), path)
    assert main(["joints", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (row,), met = told["joints"], told["new_contacts"]
    assert row["N"] == 0.0
    assert main(["joints", path]) == 0
    text = capsys.readouterr().out
    if not recorded:
        assert met is None and "forces of new contacts were not recorded" in text
        return
    assert (row["state"], row["utilisation"]) == ("handed over", None)
    (contact,) = met
    assert (contact["contact"], contact["N"]) == ("lower/upper", pytest.approx(117.72, rel=1e-3))
    assert (contact["x"], contact["y"]) == (pytest.approx(0.08 - 0.64 / 9.81, abs=2e-3), pytest.approx(0.05, abs=1e-3))
    assert contact["V"] < 1.0
    assert [line.split()[:2] for line in text.splitlines() if line.startswith("lower/upper")] == [
        ["lower/upper", "0"],
        ["lower/upper", "117.72"],
    ]
    with history.read(path) as found:
        (first,) = joint_table(found, 0)
        assert first["state"] == "closed" and new_contact_table(found, 0) == []


@pytest.mark.parametrize("formulation", ["convex", "concave", "corrected", "distributed"])
def test_a_block_that_has_slid_over_an_edge_still_presses_below_its_middle(tmp_path, formulation):
    """A block that overhangs by 25 mm has e = 0 and M = 0, as the initial O stays fixed to its face."""
    blocks = (
        Block("lower", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
        Block("upper", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05), velocity=(0.5, 0.0, 0.0)),
    )
    output = Output(("joints", "frames"), rows=100, frames=50)
    given = scene(
        DynamicControl(0.4, 0.5), *blocks, friction=0.5, stiffness=1e8, output=output, formulation=formulation
    )
    simulate(given, tmp_path / "slid.h5")
    with history.read(tmp_path / "slid.h5") as found:
        (row,) = joint_table(found)
        assert found.frame("displacement", -1)[1, 0] == pytest.approx(0.25 / 9.81, rel=0.02)
    assert row["N"] == pytest.approx(117.72, rel=1e-3)
    assert (row["e_1"], row["e_2"]) == (pytest.approx(0.0, abs=1e-4), pytest.approx(0.0, abs=1e-4))
    assert (row["M_1"], row["M_2"]) == (pytest.approx(0.0, abs=0.01), pytest.approx(0.0, abs=0.01))


def test_places_of_new_contacts_hold_no_rounding():
    """A coordinate y of 1e-16 m prints as 0, while z = -0.14 mm is kept."""
    row = dict.fromkeys(CONTACT, 1.0) | {"contact": "a/b", "x": 0.1, "y": 4.3e-16, "z": -1.4e-4}
    assert joints_command._text_of_contacts([row], 5).split()[-3:] == ["0.1", "0", "-0.00014"]
