"""Invalid scenario files are refused in one sentence that names the place, and never raise another error."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.errors import ScenarioError
from dembrick.scenario import model, text_files, toml
from helpers.scenario_text import BASE, refused

BAD = {
    "unknown key": (
        "friction  ",
        "fricton   ",
        "unknown key 'fricton' in [joint] of test.toml:6; did you mean 'friction'?",
    ),
    "unknown key, nothing like it": ("friction  ", "zzz=1\nfriction", "unknown key 'zzz' in [joint]", "'formulation'"),
    "unknown table": ("[control]", "[solvr]\nstep_factor=0.5\n[control]", "'solvr' in test.toml", "'solver'"),
    "unknown key of a block": ("fixed ", "fixd ", "'fixd' in [[blocks]] number 1 of test.toml", "'fixed'"),
    "unknown key of a material": ("density = 1500.0", "density = 1\nwieght = 1", "[materials.tuff]", "'wieght'"),
    "unknown key of a load": ("force =", "forces =", "[[loads]] number 1", "did you mean 'force'?"),
    "unknown key of an actuator": ("direction =", "directon =", "[[actuators]] number 1", "did you mean 'direction'?"),
    "unknown key of the control": ("tolerance =", "tolerence =", "in [control]", "did you mean 'tolerance'?"),
    "key of another table": (
        "tolerance =",
        "friction = 0.5\ntolerance =",
        "[control] of test.toml",
        "is a key of [joint]",
    ),
    "among is no key": ("title ", "among = 3\ntitle ", "unknown key 'among'", "known: 'actuators', 'arches'"),
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
    "friction below 0": ("0.64", "-0.1", "test.toml:6: [joint]: friction = -0.1 is out of range", "at least 0"),
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
    "kind is a number": ('"yield"', "1", "kind = 1 is not a kind of control"),
    "pushover in real time without a rate": (
        '"yield"',
        '"pushover"\ndirection = [1, 0, 0]\nquasi_static = false',
        "rate is missing",
        "a push in real time needs it, in m/s",
    ),
    "rate missing": (
        '"yield"\ntolerance = 1.0e-3',
        '"displacement"\ntravel=1e-5',
        "missing key 'rate': a test at a constant rate",
    ),
    "rate 0": ('"yield"\ntolerance = 1.0e-3', '"displacement"\nrate=0\ntravel=1', "rate = 0.0", "greater than 0 m/s"),
    "travel below 0": (
        '"yield"\ntolerance = 1.0e-3',
        '"displacement"\nrate=1\ntravel=-1',
        "travel = -1.0",
        "greater than 0 m",
    ),
    "tolerance of a displacement": (
        '"yield"',
        '"displacement"\nrate = 1e-5\ntravel = 1e-4',
        "[control]: kind 'displacement' has no 'tolerance', which is a key of 'yield'",
    ),
    "gravity is a number": ("[0.0, 0.0, -9.81]", "-9.81", "test.toml:2: gravity = -9.81", "list of 3 numbers"),
    "gravity NaN": ("[0.0, 0.0, -9.81]", "[0.0, 0.0, nan]", "gravity[2] = nan", "finite"),
    "title is a number": ('"One force at 0.25 a"', "1", "title = 1", "must be a text"),
    "list in place of a table": (
        "[joint]",
        "[[joint]]",
        "[joint]: this must be a table",
        "write it with one pair of brackets",
    ),
    "table in place of a list": ("[[loads]]", "[loads]", "loads must be a list of tables", "[[loads]]"),
    "control is text": (
        BASE,
        "control = 'yield'\n" + BASE[: BASE.index("[control]")],
        "[control]: this must be a table, not 'yield'",
    ),
    "not TOML": ("0.64", "0.64 0.65", "test.toml: not valid TOML", "line 6, column 25"),
    "key twice": ("0.64", "0.64\nfriction = 0.7", "not valid TOML", "line 7"),
    "endless nesting": ("0.64", "[" * 100_000, "nested too deeply"),
    "dotted without end": ("title ", ".".join("a" * 1500) + " = 1\ntitle ", "unknown key 'a'"),
}


@pytest.mark.parametrize("case", BAD.values(), ids=BAD)
def test_bad_input_is_refused_in_clear_words(case):
    old, new, *fragments = case
    assert old in BASE
    text = BASE.replace(old, new, 1)
    refused(text, *fragments)


def test_the_base_of_all_these_is_right():
    s = toml.loads(BASE)
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
    toml.loads(BASE.replace(old, within, 1))
    refused(BASE.replace(old, beyond, 1), "is out of range")


def test_an_integer_serves_as_a_float():
    s = toml.loads(BASE.replace("0.64", "1").replace("[0.0, 1.0, 0.0]", "[0, 2, 0]"))
    assert s.joint.friction == 1.0 and type(s.joint.friction) is float
    assert s.actuators[0].direction == (0.0, 1.0, 0.0)


def test_files_that_cannot_be_read(tmp_path):
    def message(path):
        with pytest.raises(ScenarioError) as caught:
            toml.load(path)
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
    assert "this file is empty" in message(file)
    file.write_bytes(b"\x89HDF\r\n\x1a\n\0\0\0\0")
    assert "UTF-8" in message(file)
    with open(file, "wb") as stream:
        stream.truncate(text_files.LARGEST_FILE + 1)
    assert "16 MiB" in message(file)
    file.write_bytes(b"#" * (text_files.LARGEST_FILE - len(BASE) - 1) + b"\n" + BASE.encode())
    assert toml.load(file).title == "One force at 0.25 a"


def test_windows_text_is_read(tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_bytes(b"\xef\xbb\xbf" + BASE.replace("\n", "\r\n").encode())
    assert toml.load(file) == toml.loads(BASE)


# --- only ScenarioError ----------------------------------------------------------------------------------------------

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
        s = toml.loads(BASE[:start] + piece + BASE[start + length :])
    except ScenarioError as error:
        for line in str(error).split("\n"):
            assert re.match("the scenario(, line [0-9]+)?: |unknown key |missing key |and [0-9]+ more$", line), line
    else:
        assert toml.loads(toml.dumps(s)) == s


@settings(max_examples=400, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from(PATHS), st.sampled_from(TOKENS) | st.text(max_size=5)), min_size=1, max_size=3)
)
def test_any_set_loads_or_is_refused(changes):
    try:
        s = toml.loads(BASE, overrides=[f"{path}={value}" for path, value in changes])
    except ScenarioError:
        return
    assert toml.loads(s.text) == s


@settings(max_examples=100, deadline=None)
@given(data=st.binary(max_size=200), keep=st.integers(0, len(BASE)))
def test_any_bytes_load_or_are_refused(tmp_path_factory, data, keep):
    file = tmp_path_factory.getbasetemp() / "bytes.toml"
    file.write_bytes(BASE.encode()[:keep] + data)
    try:
        toml.load(file)
    except ScenarioError as error:
        assert "bytes.toml" in str(error)
