"""Scenario files: their contents, ``--set``, and text written back."""

import math
import random
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.assembly.laws import Laws
from dembrick.errors import ScenarioError
from dembrick.scenario import model, toml
from helpers.places import SCENARIOS as FOLDER
from helpers.scenario_text import BASE, refused

FILES = sorted(FOLDER.glob("*.toml"))


# --- the files of the project ----------------------------------------------------------------------------------------


def situation(s):
    """Normal force, torsion and shear per unit V, sides of the joint and height of the jacks, by statics."""
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


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_file_says_the_same_after_a_round_trip(file):
    s = toml.load(file)
    assert s.path == str(file)
    assert s.text == file.read_text(encoding="utf-8")
    schema, about, *_ = s.text.splitlines()
    assert schema.startswith("#:schema ") and about.startswith("# ")
    assert toml.loads(toml.dumps(s)) == s
    assert toml.text_of(s) is s.text


def test_a_scenario_that_was_read_is_not_read_again_for_its_text(monkeypatch):
    whole, changed = (toml.load(FILES[0], given) for given in ((), ["gravity=[0.0, 0.0, -5.0]"]))
    assert toml.loads(changed.text) == changed
    moved = replace(whole, gravity=(0.0, 0.0, -1.0))
    assert toml.loads(toml.text_of(moved)) == moved != whole
    denser = toml.load(FILES[0])
    name = next(iter(denser.materials))
    denser.materials[name] = model.Material(1.01 * denser.materials[name].density)
    assert toml.loads(toml.text_of(denser)) == denser != whole
    monkeypatch.setattr(toml, "_parsed", None)
    assert toml.text_of(whole) is whole.text and toml.text_of(changed) is changed.text


@pytest.mark.parametrize("curve", ["", "_curve"])
@pytest.mark.parametrize(("mid", "z"), [("", 0.0), ("_mid", 0.05)])
@pytest.mark.parametrize(
    ("name", "arm", "net"), [("2a", 0.27, 0.0), ("2b", 0.15, 0.0), ("4a", 0.075, 1.0), ("4b", 0.135, 1.0)]
)
def test_lab_sets_are_the_tests_of_the_paper(name, arm, net, mid, z, curve):
    s = toml.load(FOLDER / f"set{name}{mid}{curve}.toml")
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
    normal, torsion, shear, _, height = situation(toml.load(FOLDER / "shear.toml"))
    assert (torsion, shear, height) == (0.0, [0.0, 1.0, 0.0], 0.0)
    assert 0.64 * normal == pytest.approx(298.88, rel=1e-14)


@pytest.mark.parametrize(("name", "ratio"), [("025", 0.25), ("05", 0.5), ("1", 1.0), ("15", 1.5), ("2", 2.0)])
def test_table_1_joints(name, ratio):
    s = toml.load(FOLDER / f"table1_{name}.toml")
    normal, torsion, shear, (a, b), height = situation(s)
    assert normal == pytest.approx(1000.0, rel=1e-14)
    assert s.joint.friction == 0.7
    assert (b, a) == (0.3, pytest.approx(ratio * 0.3, rel=1e-14))
    assert torsion == pytest.approx(0.9 * a, rel=1e-14)
    assert shear == [0.0, 0.0, 0.0] and height == 0.0
    assert normal / (s.joint.normal_stiffness * a * b) < 1e-5 * min(a, b)
    assert 0.7 * normal / (s.joint.shear_stiffness * a * b) < 1e-5 * min(a, b)


# --- [[joints]] ------------------------------------------------------------------------------------------------------


def with_joint(entry, joint=BASE):
    return toml.loads(f"{joint}\n[[joints]]\nbetween = ['lower', 'upper']\n{entry}").joints[0].law


def test_a_joint_overrides_only_what_it_names():
    default = toml.loads(BASE).joint
    assert with_joint("friction = 0.3") == replace(default, friction=0.3)
    assert with_joint("shear_stiffness = 1e9") == replace(default, shear_stiffness=1e9)
    assert with_joint("") == default
    s = toml.loads(BASE + "\n[[joints]]\nbetween = ['upper', 'lower']\nfriction = 0.3")
    assert Laws(s).between(0, 1).friction == Laws(s).between(1, 0).friction == 0.3 and s.joint.friction == 0.64


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
        ("between = ['lower', 'upper']\n[[joints]]\nbetween = ['upper', 'lower']", ["a later entry names the same"]),
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
    s = toml.loads(BASE, overrides=assignments)
    assert toml.loads(s.text) == s  # the history stores the scenario that ran
    return s


def test_set_reaches_every_kind_of_place():
    base = toml.loads(BASE)
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
    assert base == toml.loads(BASE)


def test_overrides_in_python_may_be_a_mapping_and_not_one_text():
    changes = {"joint.friction": np.float64(0.5), "title": "A b", "blocks.1.position": np.array([0.01, 0.0, 0.05])}
    texts = ["joint.friction=0.5", "title=A b", "blocks.1.position=[0.01, 0.0, 0.05]"]
    by_mapping, by_texts = (toml.loads(BASE, overrides=given) for given in (changes, texts))
    assert by_mapping == by_texts and by_mapping.joint.friction == 0.5
    assert toml.loads(by_mapping.text) == by_mapping
    with pytest.raises(ScenarioError, match=r"give a list, \['joint.friction=0.5'\], or a mapping"):
        toml.loads(BASE, overrides="joint.friction=0.5")
    with pytest.raises(ScenarioError, match="'friction'"):
        toml.loads(BASE, overrides={"joint.fricton": 0.5})


def test_set_leaves_a_note_in_the_text():
    text = toml.loads(BASE, overrides=["joint.friction=0.5", 'title="it\'s"']).text
    assert text.startswith("# --set 'joint.friction=0.5'\n# --set 'title=\"it\\'s\"'\ntitle = \"it's\"\n")
    assert toml.loads(BASE, overrides=[]).text == BASE


def test_set_finds_names_with_dots_and_blanks():
    text = BASE.replace('"lower"', '"row 1.left"').replace('"upper"', '"row 2"')
    assert toml.loads(text, overrides=['blocks."row 1.left".fixed=false']).blocks[0].fixed is False
    assert toml.loads(text, overrides=["blocks.row 2.position=[0, 0, 1]"]).blocks[1].position[2] == 1.0


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
        ("control.tolerance.x=1", ["control.tolerance = 0.001 has no keys"]),
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
        toml.loads(BASE, "test.toml", [assignment])
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_set_wants_an_index_where_a_name_is_not_enough():
    two = BASE + '\n[[loads]]\nblock = "upper"\nforce = [1.0, 0.0, 0.0]\n'
    with pytest.raises(ScenarioError, match="2 entries of loads have block = 'upper'; use an index"):
        toml.loads(two, overrides=["loads.upper.force=[0, 0, 0]"])
    assert toml.loads(two, overrides=["loads.1.force=[2, 0, 0]"]).loads[1].force[0] == 2.0


# --- scenarios written in Python -------------------------------------------------------------------------------------


def test_a_changed_scenario_is_not_stored_as_the_file_it_came_from():
    s = toml.loads(BASE)
    concave = replace(s, joint=replace(s.joint, formulation="concave"))
    assert concave.text == BASE
    assert toml.loads(toml.text_of(concave)) == concave
    assert toml.text_of(s) == BASE


def test_python_values_are_checked_like_those_of_a_file():
    numpy = pytest.importorskip("numpy")
    block = model.Block("a", "tuff", numpy.array([0.3, 0.2, 0.1]), [0, 0, numpy.float64(1.5)])
    assert block == model.Block("a", "tuff", (0.3, 0.2, 0.1), (0.0, 0.0, 1.5))
    assert type(block.box[0]) is float
    with pytest.raises(ScenarioError, match=r"box of block 'a' = \[0.3, 0.2\]"):
        model.Block("a", "tuff", numpy.array([0.3, 0.2]), (0.0, 0.0, 0.0))
    with pytest.raises(ScenarioError, match="friction"):
        model.JointLaw("convex", "0.64", 1e10, 4e9)
    s = toml.loads(BASE)
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
    s = replace(toml.loads(BASE), joint=counted, joints=(free,))
    assert toml.loads(toml.dumps(s)) == s
    assert toml.loads(toml.dumps(s)).joints[0].law.points is None


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


def same_joints(override):
    return tuple(sorted(override.between))


@st.composite
def scenarios(draw):
    materials = draw(st.dictionaries(names, st.builds(model.Material, positive), min_size=1, max_size=3))
    block_names = draw(st.lists(names, min_size=2, max_size=4, unique=True))
    some_block = st.sampled_from(block_names)
    fixed = {name: draw(st.booleans()) for name in block_names}
    free, still = [name for name in block_names if not fixed[name]], st.just((0.0, 0.0, 0.0))
    load = st.builds(model.Load, st.sampled_from(free), vectors, st.none() | vectors) if free else None
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
                fixed[name],
                draw(still if fixed[name] else vectors),
                draw(still if fixed[name] else vectors),
            )
            for name in block_names
        ],
        control=draw(tolerances | st.builds(model.DisplacementControl, positive, positive)),
        joints=draw(st.lists(st.builds(model.JointOverride, pairs, laws()), max_size=3, unique_by=same_joints)),
        loads=draw(st.lists(load, max_size=3)) if free else [],
        actuators=[
            model.Actuator(name, draw(some_block), draw(vectors), draw(directions), draw(finite.filter(bool)))
            for name in actuator_names
        ],
        solver=draw(st.builds(model.Solver, st.floats(0.0, 1.0, exclude_min=True, exclude_max=True))),
    )


@settings(max_examples=150, deadline=None)
@given(scenarios())
def test_text_and_scenario_round_trip(s):
    text = toml.dumps(s)
    assert toml.loads(text) == s
    assert toml.dumps(toml.loads(text)) == text
    assert toml.text_of(s) == text


def test_reading_needs_no_heavy_module():
    code = "import sys, dembrick.scenario.toml; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "dembrick.scenario.toml" in loaded
    assert not {"numpy", "numba", "h5py", "scipy", "difflib"} & set(loaded)
