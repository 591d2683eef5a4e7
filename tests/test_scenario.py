"""Scenario files: what they say, what is refused and in which words, ``--set``, and text written back."""

import math
import random
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick import model, scenario
from dembrick.errors import ScenarioError

FOLDER = Path(__file__).parents[1] / "scenarios"
FILES = sorted(FOLDER.glob("*.toml"))

BASE = """\
title   = "One force at 0.25 a"
gravity = [0.0, 0.0, -9.81]

[joint]
formulation      = "convex"
friction         = 0.64
normal_stiffness = 1.0e10
shear_stiffness  = 4.0e9

[materials.tuff]
density = 1500.0

[[blocks]]
name     = "lower"
material = "tuff"
box      = [0.3, 0.2, 0.1]
position = [0.0, 0.0, -0.05]
fixed    = true

[[blocks]]
name     = "upper"
material = "tuff"
box      = [0.3, 0.2, 0.1]
position = [0.0, 0.0, 0.05]

[[loads]]
block = "upper"
force = [0.0, 0.0, -378.71]

[[actuators]]
name      = "jack"
block     = "upper"
point     = [0.075, 0.0, 0.0]
direction = [0.0, 1.0, 0.0]

[control]
kind      = "yield"
tolerance = 1.0e-3
"""


def refused(text, *fragments, **options):
    with pytest.raises(ScenarioError) as caught:
        scenario.loads(text, "test.toml", **options)
    message = str(caught.value)
    assert message.startswith("test.toml") or "of test.toml" in message or "in test.toml" in message
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message
    return message


# --- the files of the project ----------------------------------------------------------------------------------------


def situation(s):
    """Normal force, torsion and shear per unit V, slenderness of the joint and height of the jacks, by statics."""
    lower, upper = s.blocks
    assert lower.fixed and not upper.fixed
    assert lower.box == upper.box
    top, bottom = lower.position[2] + lower.box[2] / 2, upper.position[2] - upper.box[2] / 2
    assert top == bottom == 0.0
    (load,) = s.loads
    assert load.block == "upper" and load.point is None and load.force[:2] == (0.0, 0.0)
    mass = s.materials[upper.material].density * math.prod(upper.box)
    normal = -mass * s.gravity[2] - load.force[2]
    torsion = sum(j.weight * (j.point[0] * j.direction[1] - j.point[1] * j.direction[0]) for j in s.actuators)
    shear = [sum(j.weight * j.direction[i] for j in s.actuators) for i in range(3)]
    (height,) = {j.point[2] for j in s.actuators}
    assert all(j.block == "upper" and abs(j.point[0]) <= upper.box[0] / 2 for j in s.actuators)
    return normal, torsion, shear, upper.box[:2], height


def test_all_files_are_there_and_load():
    sets = [
        f"set{name}{mid}{curve}"
        for name in ("2a", "2b", "4a", "4b")
        for mid in ("", "_mid")
        for curve in ("", "_curve")
    ]
    tables = [f"table1_{name}" for name in ("025", "05", "1", "15", "2")]
    assert {*sets, *tables, "shear"} <= {file.stem for file in FILES}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_file_says_the_same_after_a_round_trip(file):
    s = scenario.load(file)
    assert s.path == str(file)
    assert s.text == file.read_text(encoding="utf-8")
    assert s.text.startswith("# ")
    assert scenario.loads(scenario.dumps(s)) == s
    assert scenario.text_of(s) is s.text


@pytest.mark.parametrize("curve", ["", "_curve"])
@pytest.mark.parametrize(("mid", "z"), [("", 0.0), ("_mid", 0.05)])
@pytest.mark.parametrize(
    ("name", "arm", "net"), [("2a", 0.27, 0.0), ("2b", 0.15, 0.0), ("4a", 0.075, 1.0), ("4b", 0.135, 1.0)]
)
def test_lab_sets_are_the_tests_of_the_paper(name, arm, net, mid, z, curve):
    s = scenario.load(FOLDER / f"set{name}{mid}{curve}.toml")
    normal, torsion, shear, joint, height = situation(s)
    assert normal == pytest.approx(467.0, rel=1e-14)
    assert torsion == pytest.approx(arm, rel=1e-14)
    assert shear == [0.0, net, 0.0]
    assert joint == (0.3, 0.2)
    assert height == z
    assert s.joint == model.JointLaw("convex", 0.64, 1.0e10, 4.0e9)
    if curve:
        elastic_slip = 0.64 * 467.0 / (4.0e9 * 0.06)
        assert s.control.travel == pytest.approx(20 * elastic_slip, rel=0.01)
        assert s.control.rate * math.sqrt(4.0e9 * 0.06 * 9.0) < 0.002 * 298.88
    else:
        assert s.control == model.YieldControl(1.0e-3)


def test_pure_shear_passes_through_the_centroid():
    normal, torsion, shear, _, height = situation(scenario.load(FOLDER / "shear.toml"))
    assert (torsion, shear, height) == (0.0, [0.0, 1.0, 0.0], 0.0)
    assert 0.64 * normal == pytest.approx(298.88, rel=1e-14)


@pytest.mark.parametrize(("name", "ratio"), [("025", 0.25), ("05", 0.5), ("1", 1.0), ("15", 1.5), ("2", 2.0)])
def test_table_1_joints(name, ratio):
    s = scenario.load(FOLDER / f"table1_{name}.toml")
    normal, torsion, shear, (a, b), height = situation(s)
    assert normal == pytest.approx(1000.0, rel=1e-14)
    assert s.joint.friction == 0.7
    assert (b, a) == (0.3, pytest.approx(ratio * 0.3, rel=1e-14))
    assert torsion == pytest.approx(0.9 * a, rel=1e-14)
    assert shear == [0.0, 0.0, 0.0] and height == 0.0
    assert normal / (s.joint.normal_stiffness * a * b) < 1e-5 * min(a, b)
    assert 0.7 * normal / (s.joint.shear_stiffness * a * b) < 1e-5 * min(a, b)


# --- what is refused -------------------------------------------------------------------------------------------------

BAD = {
    "unknown key": (
        "friction  ",
        "fricton   ",
        "unknown key 'fricton' in [joint] of test.toml; did you mean 'friction'?",
    ),
    "unknown key, nothing like it": ("friction  ", "zzz=1\nfriction", "unknown key 'zzz' in [joint]", "'formulation'"),
    "unknown table": ("[control]", "[solvr]\nstep_factor=0.5\n[control]", "'solvr' in test.toml", "'solver'"),
    "unknown key of a block": ("fixed ", "fixd ", "'fixd' in [[blocks]] number 1 of test.toml", "'fixed'"),
    "unknown key of a material": ("density = 1500.0", "density = 1\nwieght = 1", "[materials.tuff]", "'wieght'"),
    "unknown key of a load": ("force =", "forces =", "[[loads]] number 1", "did you mean 'force'?"),
    "unknown key of an actuator": ("direction =", "directon =", "[[actuators]] number 1", "did you mean 'direction'?"),
    "unknown key of the control": ("tolerance =", "tolerence =", "in [control]", "did you mean 'tolerance'?"),
    "path is no key": ("title ", "path = 'x'\ntitle ", "unknown key 'path'"),
    "no title": ('title   = "One force at 0.25 a"', "", "missing key 'title' in test.toml"),
    "no gravity": ("gravity = [0.0, 0.0, -9.81]", "", "missing key 'gravity'"),
    "no joint": (BASE[BASE.index("[joint]") : BASE.index("[materials")], "", "missing key 'joint'"),
    "no control": (BASE[BASE.index("[control]") :], "", "missing key 'control'"),
    "no materials": ("[materials.tuff]\ndensity = 1500.0", "", "missing key 'materials'"),
    "no blocks": (BASE[BASE.index("[[blocks]]") : BASE.index("[[loads]]")], "", "missing key 'blocks'"),
    "empty blocks": (
        BASE,
        "blocks = []\n" + BASE[: BASE.index("[[blocks]]")] + BASE[BASE.index("[[loads]]") :],
        "at least one block",
    ),
    "no friction": ("friction         = 0.64", "", "missing key 'friction' in [joint] of test.toml", "no default"),
    "no normal stiffness": ("normal_stiffness = 1.0e10", "", "missing key 'normal_stiffness'"),
    "no shear stiffness": ("shear_stiffness  = 4.0e9", "", "missing key 'shear_stiffness'"),
    "no formulation": ('formulation      = "convex"', "", "missing key 'formulation'"),
    "no density": ("density = 1500.0", "", "missing key 'density' in [materials.tuff]"),
    "no material in block": ('material = "tuff"\nbox', "box", "missing key 'material' in [[blocks]] number 1"),
    "no kind": ('kind      = "yield"', "", "missing key 'kind' in [control]", "yield, displacement"),
    "no actuators": (BASE[BASE.index("[[actuators]]") : BASE.index("[control]")], "", "'yield'", "[[actuators]]"),
    "unknown formulation": (
        '"convex"',
        '"convx"',
        "formulation = 'convx'",
        "did you mean 'convex'?",
        "corrected-shear",
    ),
    "formulation is a number": ('"convex"', "3", "[joint]: formulation = 3 is of the wrong type"),
    "friction below 0": ("0.64", "-0.1", "test.toml: [joint]: friction = -0.1 is out of range", "at least 0"),
    "friction is text": ("0.64", '"0.64"', "friction = '0.64'", "must be a number"),
    "friction is a truth value": ("0.64", "true", "friction = true", "must be a number"),
    "friction is a date": ("0.64", "2020-01-01", "friction = ", "must be a number"),
    "friction is a list": ("0.64", "[0.64]", "friction = [0.64]", "must be a number"),
    "friction NaN": ("0.64", "nan", "friction = nan", "finite"),
    "friction infinite": ("0.64", "inf", "friction = inf", "finite"),
    "friction too large for a float": ("0.64", "1" + "0" * 400, "friction = 1", "finite"),
    "friction of 5000 hexadecimal digits": ("0.64", "0x" + "f" * 5000, "friction = <int>", "finite"),
    "friction of 5000 digits": ("0.64", "1" * 5000, "not valid TOML"),
    "stiffness 0": ("1.0e10", "0", "normal_stiffness = 0.0", "greater than 0 Pa/m"),
    "shear stiffness below 0": ("4.0e9", "-4e9", "shear_stiffness = -4000000000.0", "greater than 0 Pa/m"),
    "pressure of a concave joint": ('"convex"', '"concave"\npressure="linear"', "pressure = 'linear'", "'convex'"),
    "unknown pressure": ('"convex"', '"convex"\npressure="ful"', "pressure = 'ful'", "did you mean 'full'?"),
    "points of a convex joint": ('"convex"', '"convex"\npoints=[2,2]', "points = [2, 2]", "'distributed'"),
    "points 0": ('"convex"', '"distributed"\npoints=[0,2]', "points = [0, 2]", "at least 1"),
    "points in halves": ('"convex"', '"distributed"\npoints=[2.5,2]', "points = [2.5, 2]", "whole numbers"),
    "points as truth values": ('"convex"', '"distributed"\npoints=[true,true]', "points", "whole numbers"),
    "three points": ('"convex"', '"distributed"\npoints=[2,2,2]', "points = [2, 2, 2]", "not 3"),
    "too many points": ('"convex"', '"distributed"\npoints=[10000,10000]', "points", "million"),
    "points as a word": ('"convex"', '"distributed"\npoints="many"', "points = 'many'", "whole numbers"),
    "density 0": ("1500.0", "0.0", "[materials.tuff]: density = 0.0", "greater than 0 kg/m3"),
    "density is text": ("1500.0", '"heavy"', "density = 'heavy'", "must be a number"),
    "unknown material": (
        'material = "tuff"\nbox',
        'material = "tuf"\nbox',
        "'tuf' is not the name of a material",
        "'tuff'?",
    ),
    "material is no table": ("[materials.tuff]\ndensity = 1500.0", "[materials]\ntuff = 1500.0", "must be a table"),
    "edge 0": ("box      = [0.3, 0.2, 0.1]", "box = [0.3, 0.0, 0.1]", "box of block 'lower'", "longer than 0 m"),
    "edge below 0": ("box      = [0.3, 0.2, 0.1]", "box = [0.3, -0.2, 0.1]", "[0.3, -0.2, 0.1]", "longer than 0 m"),
    "edge NaN": ("box      = [0.3, 0.2, 0.1]", "box = [0.3, nan, 0.1]", "box[1] of block 'lower' = nan", "finite"),
    "two edges": (
        "box      = [0.3, 0.2, 0.1]",
        "box = [0.3, 0.2]",
        "box of block 'lower' = [0.3, 0.2]",
        "3 numbers, not 2",
    ),
    "edge is text": ("box      = [0.3, 0.2, 0.1]", 'box = [0.3, "0.2", 0.1]', "box[1] of block 'lower' = '0.2'"),
    "box is a number": ("box      = [0.3, 0.2, 0.1]", "box = 0.3", "box of block 'lower' = 0.3", "list of 3 numbers"),
    "position infinite": ("[0.0, 0.0, 0.05]", "[0.0, -inf, 0.05]", "position[1] of block 'upper' = -inf", "finite"),
    "no unit quaternion": ("fixed ", "orientation=[1.0,1.0,0.0,0.0]\nfixed ", "orientation", "unit quaternion"),
    "quaternion of three": ("fixed ", "orientation=[1.0,0.0,0.0]\nfixed ", "orientation", "4 numbers, not 3"),
    "fixed is a number": ("= true", "= 1", "fixed of block 'lower' = 1", "true or false"),
    "velocity of two": ("fixed ", "velocity=[1.0,0.0]\nfixed ", "velocity of block 'lower'", "3 numbers, not 2"),
    "name is a number": ('"lower"', "7", "[[blocks]] number 1: name = 7", "must be a text"),
    "name is empty": ('"lower"', '""', "name = ''", "must not be empty"),
    "name with a line break": ('"lower"', '"lo\\nwer"', "name = 'lo\\nwer'", "one line"),
    "blocks of one name": ('"lower"', '"upper"', "two blocks are named 'upper'"),
    "load on an unknown block": ('block = "upper"', 'block = "uper"', "block of load number 1 = 'uper'", "'upper'?"),
    "actuator on an unknown block": ('block     = "upper"', 'block = "Upper"', "actuator 'jack' = 'Upper'", "'upper'?"),
    "force NaN": ("-378.71", "nan", "force[2] of the load on block 'upper' = nan", "finite"),
    "force is a number": ("force = [0.0, 0.0, -378.71]", "force = -378.71", "force", "list of 3 numbers"),
    "load point of two": ("force =", "point = [0, 0]\nforce =", "point of the load on block 'upper'", "not 2"),
    "direction without length": (
        "[0.0, 1.0, 0.0]",
        "[0.0, 0.0, 0.0]",
        "direction of actuator 'jack'",
        "greater than 0",
    ),
    "direction infinite": ("[0.0, 1.0, 0.0]", "[0.0, inf, 0.0]", "direction[1] of actuator 'jack' = inf", "finite"),
    "weight 0": ("direction =", "weight = 0\ndirection =", "weight of actuator 'jack' = 0.0", "must not be 0"),
    "tolerance 0": ("1.0e-3", "0", "[control]: tolerance = 0.0", "between 1e-8 and 0.1"),
    "tolerance 1": ("1.0e-3", "1", "[control]: tolerance = 1.0", "between 1e-8 and 0.1"),
    "tolerance NaN": ("1.0e-3", "nan", "tolerance = nan", "finite"),
    "step factor 1": (
        "[control]",
        "[solver]\nstep_factor=1.0\n[control]",
        "[solver]: step_factor = 1.0",
        "between 0 and 1",
    ),
    "mistyped kind": (
        '"yield"',
        '"yeild"',
        "kind = 'yeild'",
        "'yield' and 'displacement' and",
        "did you mean 'yield'?",
    ),
    "kind is a number": ('"yield"', "1", "kind = 1 is not a kind of control"),
    "pushover in real time without a rate": (
        '"yield"',
        '"pushover"\ndirection = [1, 0, 0]\nquasi_static = false',
        "rate = None is out of range",
        "a push in real time needs it, in m/s",
    ),
    "rate missing": ('"yield"\ntolerance = 1.0e-3', '"displacement"\ntravel=1e-5', "missing key 'rate' in [control]"),
    "rate 0": ('"yield"\ntolerance = 1.0e-3', '"displacement"\nrate=0\ntravel=1', "rate = 0.0", "greater than 0 m/s"),
    "travel below 0": (
        '"yield"\ntolerance = 1.0e-3',
        '"displacement"\nrate=1\ntravel=-1',
        "travel = -1.0",
        "greater than 0 m",
    ),
    "tolerance of a displacement": ('"yield"', '"displacement"', "unknown key 'tolerance' in [control]"),
    "gravity is a number": ("[0.0, 0.0, -9.81]", "-9.81", "test.toml: gravity = -9.81", "list of 3 numbers"),
    "gravity NaN": ("[0.0, 0.0, -9.81]", "[0.0, 0.0, nan]", "gravity[2] = nan", "finite"),
    "title is a number": ('"One force at 0.25 a"', "1", "title = 1", "must be a text"),
    "list in place of a table": ("[joint]", "[[joint]]", "[joint]: this must be a table", "one pair of brackets"),
    "table in place of a list": ("[[loads]]", "[loads]", "loads must be a list of tables", "[[loads]]"),
    "control is text": (
        BASE,
        "control = 'yield'\n" + BASE[: BASE.index("[control]")],
        "[control]: this must be a table, not 'yield'",
    ),
    "not TOML": ("0.64", "0.64 0.65", "test.toml: not valid TOML", "line 6, column 25"),
    "key twice": ("0.64", "0.64\nfriction = 0.7", "not valid TOML", "line 7"),
    "endless nesting": ("0.64", "[" * 100_000, "nested without end"),
    "dotted without end": ("title ", ".".join("a" * 1500) + " = 1\ntitle ", "unknown key 'a'"),
}


@pytest.mark.parametrize("case", BAD.values(), ids=BAD)
def test_bad_input_is_refused_in_clear_words(case):
    old, new, *fragments = case
    assert old in BASE
    text = BASE.replace(old, new, 1)
    refused(text, *fragments)


def test_the_base_of_all_these_is_right():
    s = scenario.loads(BASE)
    assert s.joint == model.JointLaw("convex", 0.64, 1.0e10, 4.0e9)
    assert s.blocks[0].fixed and not s.blocks[1].fixed
    assert s.solver == model.Solver()
    assert s.path is None


@pytest.mark.parametrize(
    ("old", "within", "beyond"),
    [
        ("tolerance = 1.0e-3", "tolerance = 0.1", "tolerance = 0.1001"),
        ("tolerance = 1.0e-3", "tolerance = 1e-8", "tolerance = 0.99e-8"),
        ("friction         = 0.64", "friction = 0", "friction = -1e-300"),
        ("density = 1500.0", "density = 1e-300", "density = -1e-300"),
        ("[control]", "[solver]\nstep_factor = 0.9999\n[control]", "[solver]\nstep_factor = 1.0001\n[control]"),
        ("[control]", "[solver]\nstep_factor = 1e-9\n[control]", "[solver]\nstep_factor = 0\n[control]"),
        ("fixed ", "orientation = [1.0000009, 0, 0, 0]\nfixed ", "orientation = [1.0000011, 0, 0, 0]\nfixed "),
        ('"convex"', '"distributed"\npoints = [1000, 1000]', '"distributed"\npoints = [1001, 1000]'),
        ('"convex"', '"distributed"\npoints = [1, 1]', '"distributed"\npoints = [1, 0]'),
    ],
)
def test_bounds_are_where_they_are_said_to_be(old, within, beyond):
    scenario.loads(BASE.replace(old, within, 1))
    refused(BASE.replace(old, beyond, 1), "is out of range")


def test_an_integer_serves_as_a_float():
    s = scenario.loads(BASE.replace("0.64", "1").replace("[0.0, 1.0, 0.0]", "[0, 2, 0]"))
    assert s.joint.friction == 1.0 and type(s.joint.friction) is float
    assert s.actuators[0].direction == (0.0, 1.0, 0.0)


def test_files_that_cannot_be_read(tmp_path):
    def message(path):
        with pytest.raises(ScenarioError) as caught:
            scenario.load(path)
        assert str(path) in str(caught.value) and caught.value.exit_code == 2
        return str(caught.value)

    assert "no such file" in message(tmp_path / "nothing.toml")
    assert "folder" in message(tmp_path)
    assert "cannot be read" in message("null\0character.toml")
    assert "cannot be read" in message(tmp_path / ("x" * 5000))
    file = tmp_path / "scenario.toml"
    file.write_bytes(b"title = 'a'\n# caf\xe9")
    assert "UTF-8" in message(file) and "line 2" in message(file)
    file.write_bytes(b"")
    assert "missing key 'title'" in message(file)
    file.write_bytes(b"\x89HDF\r\n\x1a\n\0\0\0\0")
    assert "UTF-8" in message(file)
    with open(file, "wb") as stream:
        stream.truncate(scenario.LARGEST_FILE + 1)
    assert "16 MiB" in message(file)
    file.write_bytes(b"#" * (scenario.LARGEST_FILE - len(BASE) - 1) + b"\n" + BASE.encode())
    assert scenario.load(file).title == "One force at 0.25 a"


def test_windows_text_is_read(tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_bytes(b"\xef\xbb\xbf" + BASE.replace("\n", "\r\n").encode())
    assert scenario.load(file) == scenario.loads(BASE)


# --- [[joints]] ------------------------------------------------------------------------------------------------------


def with_joint(entry, joint=BASE):
    return scenario.loads(f"{joint}\n[[joints]]\nbetween = ['lower', 'upper']\n{entry}").joints[0].law


def test_a_joint_overrides_only_what_it_names():
    default = scenario.loads(BASE).joint
    assert with_joint("friction = 0.3") == replace(default, friction=0.3)
    assert with_joint("shear_stiffness = 1e9") == replace(default, shear_stiffness=1e9)
    assert with_joint("") == default
    s = scenario.loads(BASE + "\n[[joints]]\nbetween = ['upper', 'lower']\nfriction = 0.3")
    assert s.law_between("lower", "upper").friction == 0.3 and s.joint.friction == 0.64


def test_keys_of_a_formulation_go_with_it():
    effective = BASE.replace('"convex"', '"convex"\npressure = "effective"')
    points = BASE.replace('"convex"', '"distributed"\npoints = [8, 6]')
    assert with_joint("friction = 0.3", effective).pressure == "effective"
    assert with_joint("formulation = 'concave'", effective).pressure == "full"
    assert with_joint("friction = 0.3", points).points == (8, 6)
    assert with_joint("points = 'auto'", points).points is None
    assert with_joint("formulation = 'concave'", points).points is None


@pytest.mark.parametrize(
    ("entry", "fragments"),
    [
        ("between = ['lower', 'uper']", ["between = 'uper'", "did you mean 'upper'?"]),
        ("between = ['lower']", ["[[joints]] number 1", "two blocks, not 1"]),
        ("between = ['lower', 'lower']", ["no joint with itself"]),
        ("between = 'lower'", ["two block names"]),
        ("between = ['lower', 3]", ["between[1] = 3", "must be a text"]),
        ("friction = 0.3", ["missing key 'between' in [[joints]] number 1"]),
        ("between = ['lower', 'upper']\nfricton = 0.3", ["'fricton' in [[joints]] number 1", "'friction'?"]),
        ("between = ['lower', 'upper']\nfriction = -1", ["[[joints]] number 1", "friction = -1.0"]),
        ("between = ['lower', 'upper']\npoints = [2, 2]", ["points = [2, 2]", "'distributed'"]),
    ],
)
def test_bad_joints(entry, fragments):
    refused(f"{BASE}\n[[joints]]\n{entry}\n", *fragments)


# --- --set -----------------------------------------------------------------------------------------------------------


def changed(*assignments):
    s = scenario.loads(BASE, overrides=assignments)
    assert scenario.loads(s.text) == s  # what the history stores is what ran
    return s


def test_set_reaches_every_kind_of_place():
    base = scenario.loads(BASE)
    assert changed("control.tolerance=1e-4") == replace(base, control=model.YieldControl(1e-4))
    assert changed("joint.friction = 0.5").joint.friction == 0.5
    assert changed("title=Set 4a, e = 0.25 a").title == "Set 4a, e = 0.25 a"
    assert changed("joint.formulation=corrected-shear").joint.formulation == "corrected-shear"
    assert changed('joint.formulation="concave"').joint.formulation == "concave"
    assert changed("blocks.upper.position=[0.01, 0, 0.05]").blocks[1].position == (0.01, 0.0, 0.05)
    assert changed("blocks.1.position=[0.01, 0, 0.05]").blocks[1].position == (0.01, 0.0, 0.05)
    assert changed("blocks.upper.box.0=0.4").blocks[1].box == (0.4, 0.2, 0.1)
    assert changed("blocks.lower.fixed=false").blocks[0].fixed is False
    assert changed("loads.upper.force=[0, 0, -1]").loads[0].force == (0.0, 0.0, -1.0)
    assert changed("loads.0.force=[0, 0, -1]").loads[0].force == (0.0, 0.0, -1.0)
    assert changed("actuators.jack.weight=2").actuators[0].weight == 2.0
    assert changed("materials.tuff.density=2000").materials["tuff"].density == 2000.0
    assert changed("solver.step_factor=0.5").solver.step_factor == 0.5
    assert changed("gravity=[0, 0, -1.62]").gravity == (0.0, 0.0, -1.62)
    assert changed("control={kind = 'displacement', rate = 1e-5, travel = 2e-5}").control.travel == 2e-5
    both = changed("joint.friction=0.1", "joint.friction=0.2", "control.tolerance=0.01")
    assert (both.joint.friction, both.control.tolerance) == (0.2, 0.01)
    assert base == scenario.loads(BASE)


def test_set_leaves_a_note_in_the_text():
    text = scenario.loads(BASE, overrides=["joint.friction=0.5", 'title="it\'s"']).text
    assert text.startswith("# --set 'joint.friction=0.5'\n# --set 'title=\"it\\'s\"'\ntitle = \"it's\"\n")
    assert scenario.loads(BASE, overrides=[]).text == BASE


def test_set_finds_names_with_dots_and_blanks():
    text = BASE.replace('"lower"', '"row 1.left"').replace('"upper"', '"row 2"')
    assert scenario.loads(text, overrides=['blocks."row 1.left".fixed=false']).blocks[0].fixed is False
    assert scenario.loads(text, overrides=["blocks.row 2.position=[0, 0, 1]"]).blocks[1].position[2] == 1.0


@pytest.mark.parametrize(
    ("assignment", "fragments"),
    [
        ("joint.fricton=0.5", ["unknown key 'fricton' in [joint] of test.toml (with --set)", "'friction'?"]),
        ("jiont.friction=0.5", ["unknown key 'jiont'", "'joint'?"]),
        ("joint.friction=-1", ["test.toml (with --set): [joint]: friction = -1.0", "at least 0"]),
        ("joint.friction=high", ["friction = 'high'", "must be a number"]),
        ("joint.friction=True", ["friction = 'True'", "must be a number"]),
        ("joint=3", ["must be a table"]),
        ("blocks.uper.fixed=true", ["--set 'blocks.uper.fixed=true'", "did you mean 'upper'?"]),
        ("blocks.2.fixed=true", ["blocks has no entry 2", "counted from 0"]),
        ("blocks.upper.position.3=1", ["blocks.upper.position has no entry 3"]),
        ("control.tolerance.x=1", ["control.tolerance = 0.001 has no parts"]),
        ("control.tolerance", ["write key.path=value"]),
        ("=3", ["write key.path=value"]),
        ("joint.friction=", ["'' is not a value"]),
        ("joint.friction=.5", ["'.5' is not a value", "0.5"]),
        ("gravity=[0, 0, -9.81", ["is not a value"]),
        ("joint.friction=0.5\n[solver]", ["is not a value"]),
        ("joint.friction=" + "[" * 5000, ["is not a value"]),
        ("path=elsewhere", ["unknown key 'path'"]),
    ],
)
def test_bad_set(assignment, fragments):
    with pytest.raises(ScenarioError) as caught:
        scenario.loads(BASE, "test.toml", [assignment])
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_set_wants_an_index_where_a_name_is_not_enough():
    two = BASE + '\n[[loads]]\nblock = "upper"\nforce = [1.0, 0.0, 0.0]\n'
    with pytest.raises(ScenarioError, match="2 entries of loads have block = 'upper'; use an index"):
        scenario.loads(two, overrides=["loads.upper.force=[0, 0, 0]"])
    assert scenario.loads(two, overrides=["loads.1.force=[2, 0, 0]"]).loads[1].force[0] == 2.0


# --- scenarios written in Python -------------------------------------------------------------------------------------


def test_a_changed_scenario_is_not_stored_as_the_file_it_came_from():
    s = scenario.loads(BASE)
    concave = replace(s, joint=replace(s.joint, formulation="concave"))
    assert concave.text == BASE
    assert scenario.loads(scenario.text_of(concave)) == concave
    assert scenario.text_of(s) == BASE


def test_python_values_are_checked_like_those_of_a_file():
    numpy = pytest.importorskip("numpy")
    block = model.Block("a", "tuff", numpy.array([0.3, 0.2, 0.1]), [0, 0, numpy.float64(1.5)])
    assert block == model.Block("a", "tuff", (0.3, 0.2, 0.1), (0.0, 0.0, 1.5))
    assert type(block.box[0]) is float
    with pytest.raises(ScenarioError, match=r"box of block 'a' = \[0.3, 0.2\]"):
        model.Block("a", "tuff", numpy.array([0.3, 0.2]), (0.0, 0.0, 0.0))
    with pytest.raises(ScenarioError, match="friction"):
        model.JointLaw("convex", "0.64", 1e10, 4e9)
    s = scenario.loads(BASE)
    with pytest.raises(ScenarioError, match="is not the name of a block; did you mean 'upper'"):
        replace(s, loads=(model.Load("uppr", (0.0, 0.0, -1.0)),))
    with pytest.raises(ScenarioError, match="two actuators are named 'jack'"):
        replace(s, actuators=s.actuators * 2)


@pytest.mark.parametrize(
    "direction", [(1e-200, 0.0, 0.0), (5e-324, 5e-324, 0.0), (1e308, 1e308, 1e308), (3.0, -4.0, 0.0)]
)
def test_a_direction_of_any_length_is_made_1(direction):
    jack = model.Actuator("jack", "upper", (0.0, 0.0, 0.0), direction)
    assert math.hypot(*jack.direction) == pytest.approx(1.0, rel=1e-15)
    assert jack.direction[0] > 0.0
    assert replace(jack).direction == jack.direction


def test_a_direction_at_length_1_is_kept_to_the_last_bit():
    draw = random.Random(1)
    for _ in range(1000):
        direction = tuple(draw.gauss(0.0, 1.0) for _ in range(3))
        jack = model.Actuator("jack", "upper", (0.0, 0.0, 0.0), direction)
        assert replace(jack).direction == jack.direction


def test_a_joint_without_a_count_of_points_keeps_none_under_a_default_with_one():
    counted = model.JointLaw("distributed", 0.64, 1e10, 4e9, points=(8, 6))
    free = model.JointOverride(("lower", "upper"), replace(counted, points=None))
    s = replace(scenario.loads(BASE), joint=counted, joints=(free,))
    assert scenario.loads(scenario.dumps(s)) == s
    assert scenario.loads(scenario.dumps(s)).joints[0].law.points is None


def test_a_rounded_quaternion_is_made_1():
    block = model.Block("a", "tuff", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.7071068, 0.0, 0.0, 0.7071068))
    assert math.hypot(*block.orientation) == pytest.approx(1.0, rel=1e-15)


finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0.0, exclude_min=True, allow_infinity=False)
vectors = st.tuples(finite, finite, finite)
printable = st.text(st.characters(blacklist_categories=("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp", "Zs")))
names = printable.filter(bool)


@st.composite
def laws(draw):
    formulation = draw(st.sampled_from(model.FORMULATIONS))
    counts = st.none() | st.tuples(st.integers(1, 1000), st.integers(1, 1000))
    return model.JointLaw(
        formulation,
        draw(st.floats(min_value=0.0, allow_infinity=False)),
        draw(positive),
        draw(positive),
        points=draw(counts) if formulation == "distributed" else None,
        pressure=draw(st.sampled_from(model.PRESSURES)) if formulation == "convex" else "full",
    )


@st.composite
def scenarios(draw):
    materials = draw(st.dictionaries(names, st.builds(model.Material, positive), min_size=1, max_size=3))
    block_names = draw(st.lists(names, min_size=2, max_size=4, unique=True))
    some_block = st.sampled_from(block_names)
    edges = st.tuples(positive, positive, positive)
    quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1)
    units = quaternions.map(lambda q: tuple(c / math.hypot(*q) for c in q))
    some_material = st.sampled_from(sorted(materials))
    directions = vectors.filter(any)
    actuator_names = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    tolerances = st.builds(model.YieldControl, st.floats(1e-8, 0.1))
    pairs = st.lists(some_block, min_size=2, max_size=2, unique=True)
    return model.Scenario(
        title=draw(printable),
        gravity=draw(vectors),
        joint=draw(laws()),
        materials=materials,
        blocks=[
            model.Block(
                name,
                draw(some_material),
                draw(edges),
                draw(vectors),
                draw(units),
                draw(st.booleans()),
                draw(vectors),
                draw(vectors),
            )
            for name in block_names
        ],
        control=draw(tolerances | st.builds(model.DisplacementControl, positive, positive)),
        joints=draw(st.lists(st.builds(model.JointOverride, pairs, laws()), max_size=3)),
        loads=draw(st.lists(st.builds(model.Load, some_block, vectors, st.none() | vectors), max_size=3)),
        actuators=[
            model.Actuator(name, draw(some_block), draw(vectors), draw(directions), draw(finite.filter(bool)))
            for name in actuator_names
        ],
        solver=draw(st.builds(model.Solver, st.floats(0.0, 1.0, exclude_min=True, exclude_max=True))),
    )


@settings(max_examples=150, deadline=None)
@given(scenarios())
def test_text_and_scenario_round_trip(s):
    text = scenario.dumps(s)
    assert scenario.loads(text) == s
    assert scenario.dumps(scenario.loads(text)) == text
    assert scenario.text_of(s) == text


# --- nothing but ScenarioError ---------------------------------------------------------------------------------------

TOKENS = ["nan", "-inf", "1e999", "0", "-1", "true", "''", "'upper'", "[]", "{}", "[[0]]", "[0, 0, 0]", "1979-05-27"]
TOKENS += ["{kind='yield'}", "[{}]", "0x" + "f" * 400, "[joint]", "[[blocks]]", "=", "\n", '"\\u0000"', "\ud800", "\0"]
PATHS = ["title", "gravity", "gravity.1", "joint", "joints", "joint.points", "joint.friction", "materials", "blocks"]
PATHS += ["materials.tuff", "materials.tuff.density", "blocks.0", "blocks.upper.box", "blocks.upper.box.0", "loads"]
PATHS += ["blocks.upper.orientation", "blocks.lower.name", "loads.0.point", "actuators.jack", "actuators.0.direction"]
PATHS += ["control", "control.kind", "control.tolerance", "solver", "solver.step_factor", "a.b.c", "", ".", "'"]


@settings(max_examples=400, deadline=None)
@given(st.integers(0, len(BASE)), st.integers(0, 30), st.sampled_from(TOKENS) | st.text(max_size=5))
def test_a_text_with_a_piece_replaced_loads_or_is_refused(start, length, piece):
    try:
        s = scenario.loads(BASE[:start] + piece + BASE[start + length :])
    except ScenarioError as error:
        assert str(error).startswith(("the scenario: ", "unknown key ", "missing key "))
    else:
        assert scenario.loads(scenario.dumps(s)) == s


@settings(max_examples=400, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from(PATHS), st.sampled_from(TOKENS) | st.text(max_size=5)), min_size=1, max_size=3)
)
def test_any_set_loads_or_is_refused(changes):
    try:
        s = scenario.loads(BASE, overrides=[f"{path}={value}" for path, value in changes])
    except ScenarioError:
        return
    assert scenario.loads(s.text) == s


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=200), keep=st.integers(0, len(BASE)))
def test_any_bytes_load_or_are_refused(tmp_path_factory, data, keep):
    file = tmp_path_factory.getbasetemp() / "bytes.toml"
    file.write_bytes(BASE.encode()[:keep] + data)
    try:
        scenario.load(file)
    except ScenarioError as error:
        assert "bytes.toml" in str(error)


def test_reading_needs_no_heavy_module():
    code = "import sys, dembrick.scenario; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "dembrick.scenario" in loaded
    assert not {"numpy", "numba", "h5py", "scipy", "difflib"} & set(loaded)
