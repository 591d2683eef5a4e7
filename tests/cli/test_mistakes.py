"""Mistakes of users: the message says what to write; wrong units cause warnings, not refusals."""

import json
import re

import pytest

from dembrick import history
from dembrick.assembly.block_shapes import shapes_of
from dembrick.assembly.build import assemble
from dembrick.cli import joints, main
from dembrick.errors import HistoryError, ScenarioError
from dembrick.runs import lab
from dembrick.runs.study import plan
from dembrick.scenario import toml
from dembrick.scenario.units import unit_slips
from dembrick.views.structure_numbers import of_reactions
from helpers.places import SCENARIOS

SET4A = (SCENARIOS / "set4a.toml").read_text()


def refused(text, **more):
    with pytest.raises(ScenarioError) as caught:
        toml.loads(text, "mine.toml", **more)
    return str(caught.value)


def test_a_text_without_quotes():
    said = refused(SET4A.replace('"convex"', "convex"))
    assert 'texts need quotes: "convex"' in said and "formulation      = convex" in said


def test_a_decimal_comma():
    assert "with a decimal point: 0.64" in refused(re.sub(r"= 0\.64.*", "= 0,64", SET4A, count=1))


def test_a_material_of_a_generated_block_is_named_by_the_line_of_its_generator():
    wall = (SCENARIOS / "templates" / "wall.toml").read_text()
    said = refused(re.sub(r'material( *)= "\w+"', r'material\1= "tuf"', wall))
    lines = wall.splitlines()
    line = 1 + lines.index("[[walls]]")
    key = 1 + next(i for i in range(line, len(lines)) if lines[i].startswith("material"))
    assert re.search(rf":{key}: material of block .* = 'tuf'", said)
    single = refused(wall.replace("[[walls]]", "[walls]"))
    assert f":{line}: " in single and "write [[walls]] before each" in single


@pytest.mark.parametrize(
    "words, told",
    [
        (["run", "a.toml", "--bounds"], "--bounds; did you mean --bound?"),
        (["run", "a.toml", "--refned", "--tolerence=1e-3"], "did you mean --refine and --tolerance?"),
        (["plot", "a.h5", "--labs", "b.csv"], "--labs b.csv; did you mean --lab?"),
        (["view", "a.h5", "--bounds"], "unrecognized arguments: --bounds"),  # no option of this command is similar
        (["run", "a.toml", "b.toml"], "unrecognized arguments: b.toml"),
    ],
)
def test_a_mistyped_option_is_told_the_nearest_of_its_command(words, told, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*words, "--json"])
    said = capsys.readouterr()
    assert stop.value.code == 2 and said.err.rstrip().endswith(told)
    assert json.loads(said.out)["error"].endswith(told)


def test_joints_for_joint():
    assert "you wrote [joints], but the default law is [joint]" in refused(SET4A.replace("[joint]", "[joints]"))


def test_a_heading_that_is_left_out_is_told_with_its_keys():
    said = refused(SET4A.replace("[joint]\n", ""))
    assert re.search(r"unknown key 'friction' in mine.toml:\d+; it is a key of \[joint\]\n", said)


def test_a_kind_of_control_that_is_none_gets_the_list_of_them():
    said = refused(SET4A.replace('"yield"', '"support-displacement"'))
    assert "the kinds are 'yield', 'displacement', " in said and "did you mean" not in said
    assert "did you mean 'tilt'?" in refused(SET4A.replace('"yield"', '"tild"'))
    assert "did you mean 'pushover'?" in refused(SET4A.replace('"yield"', '"push-over"'))


def test_known_keys_are_sorted():
    said = refused(SET4A.replace("[joint]", "[joint]\nzzz = 1.0"))
    known = re.findall("'([a-z_]+)'", said.partition("known:")[2])
    assert len(known) > 4 and known == sorted(known)


@pytest.mark.parametrize("path", ["/data/x.csv", "./x.csv", "../x.csv", "~/x.csv", "data/x.csv"])
def test_set_takes_a_path(path):
    text = SET4A.partition("[[actuators]]")[0]
    text += '[control]\nkind = "base-motion"\nduration = 1.0\ndirection = [1, 0, 0]\nfile = "a.csv"\n'
    assert toml.loads(text, overrides=[f"control.file={path}"]).control.file == path


@pytest.mark.parametrize(
    "words",
    [["check"], ["run"], ["limit"], ["sweep"], ["plot"], ["render", "--to", "a.png"], ["info"], ["schema", "--out"]],
    ids=lambda words: words[0],
)
def test_a_name_too_long_for_any_file(words, folder, capsys):
    assert main([*words, "9" * 400]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: 999")


def test_a_scenario_for_a_study():
    with pytest.raises(ScenarioError, match='this is a scenario .*; a study has base = "SCENARIO.toml"'):
        plan.load(SCENARIOS / "set4a.toml")


@pytest.mark.parametrize(
    "words", [["run"], ["check"], ["limit"], ["render", "--to", "a.png"]], ids=lambda words: words[0]
)
def test_a_study_for_a_scenario(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "study"]) == 0
    capsys.readouterr()
    assert main([*words, "study.toml"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(
        "this is a study of many runs; run it with dembrick sweep study.toml; its scenario is base = 'set4a'"
    )
    if words == ["run"]:
        assert main(["run", "study.toml", "--set", "joint.friction=0.5"]) == 2
        assert "dembrick sweep study.toml" in capsys.readouterr().err


def test_an_empty_file_and_one_without_blocks():
    with pytest.raises(ScenarioError, match="mine.toml: this file is empty; 'dembrick new'"):
        toml.loads("# to do\n", "mine.toml")
    text = re.sub(r"\[\[blocks\]\].*?(?=\[\[(?!blocks))", "", SET4A, flags=re.DOTALL)
    assert "missing key 'blocks' in mine.toml; give blocks, walls, stacks, arches, domes or models" in refused(text)


def test_a_scenario_for_a_history():
    with pytest.raises(HistoryError, match="this is a scenario, not a history; run it first: dembrick run"):
        history.read(SCENARIOS / "set4a.toml")


SHAKEN = '[control]\nkind = "base-motion"\nduration = 1.0\ndirection = [1.0, 0.0, 0.0]\n'
PUSHED = '[[loads]]\nblock = "upper"\nforce = [1.0, 0.0, 0.0]\n'
DRIVEN = '[[actuators]]\nname = "jack"\nblock = "upper"\ndirection = [1.0, 0.0, 0.0]\npoint = [-0.15, 0.0, 0.05]\n'
DRIVEN += '[control]\nkind = "displacement"\nrate = 1e-3\n'


@pytest.mark.parametrize(
    "before, line, after, key",
    [
        (SHAKEN, "file = 'none.csv'  # (m/s2)", "", "control.file"),
        (PUSHED, 'history = "none.csv"', '[control]\nkind = "dynamic"\nduration = 1.0\n', "history of load number 2"),
        (DRIVEN, 'protocol = "none.csv"', "", "protocol"),
    ],
)
def test_a_file_that_is_not_there_is_told_with_the_key_and_line_that_name_it(
    before, line, after, key, tmp_path, capsys
):
    text = '# reads "none.csv"\n' + SET4A.partition("[[actuators]]")[0] + before
    path = tmp_path / "one.toml"
    path.write_text(f"{text}{line}\n{after}")
    assert main(["check", str(path)]) == 2
    wanted = f"{path}:{text.count(chr(10)) + 1}: {key}: {tmp_path / 'none.csv'}: there is no such file"
    assert wanted in capsys.readouterr().err
    name = line.split()[0]
    table = "loads.1" if after else "control"
    assert main(["check", str(path), "--set", f"{table}.{name}=other.csv"]) == 2
    assert f"{path}: {key}: {tmp_path / 'other.csv'}: there is no such file" in capsys.readouterr().err


def test_check_looks_at_every_stage(tmp_path, capsys):
    """A jack outside its block is reported although only an earlier stage than the last, a tilt, uses it."""
    text = SET4A.replace("point     = [0.0", "point     = [9.0").partition("[control]")[0]
    text += '[[stages]]\nkind = "displacement"\nrate = 1e-2\ntravel = 1e-4\n'
    text += '[control]\nkind = "tilt"\naxis = [0.0, 1.0, 0.0]\n'
    (tmp_path / "staged.toml").write_text(text)
    assert main(["check", str(tmp_path / "staged.toml")]) == 2
    said = capsys.readouterr().err
    assert "stage 1 (displacement)" in said and "outside block" in said


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n300 0 0\n0 100 0\n0 0 100\n3 0 2 1\n3 0 1 3\n3 1 2 3\n"
    "3 0 3 2\n"
)
SLIPS = {
    "degrees": ("friction         = 0.64", "friction         = 32", "friction of joint = 32 is a coefficient"),
    "g/cm3": ("density = 1500.0", "density = 1.5", "density of material 'tuff' = 1.5 kg/m3 fits no stone"),
    "mm/s2": ("-9.81]", "-9810.0]", "is 9810 m/s2, but on earth it is 9.81"),
    "upwards": ("[0.0, 0.0, -9.81]", "[0.0, 0.0, 9.81]", "does not point down"),
    "mm": (
        "[0.3, 0.2, 0.1]\nposition = [0.0, 0.0, 0.05]",
        "[300.0, 200.0, 100.0]\nposition = [0.0, 0.0, 50.0]",
        "'upper'",
    ),
}


def slips(scenario):
    return unit_slips(scenario, shapes_of(scenario.all_blocks, scenario.path_of))


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_of_units_is_warned_of(name):
    before, after, said = SLIPS[name]
    assert before in SET4A
    (found,) = slips(toml.loads(SET4A.replace(before, after)))
    assert said in found
    assert slips(toml.loads(SET4A)) == []


ARCH = (SCENARIOS / "arch_filled.toml").read_text()


@pytest.mark.parametrize(
    "key, value, told",
    [
        ("angle", 3.14, "angle of arch 'arch' = 3.14 is in degrees, 0.0548 rad; for 3.14 rad write 179.9"),
        ("angle", 1.571, "for 1.571 rad write 90.01"),
        ("angle", 2.09, "for 2.09 rad write 119.7"),
        ("heading", -1.5708, "heading of arch 'arch' = -1.5708 is in degrees, -0.0274 rad"),
        ("angle", 180.0, None),
        ("angle", 6.0, None),  # nearly flat, and no simple fraction of a turn
        ("angle", 31.4, None),
        ("heading", 1.5, None),
        ("heading", 0.0, None),
        ("heading", 90.0, None),
    ],
)
def test_an_angle_in_radians_is_warned_of(key, value, told):
    """Angles are in degrees: values that look like radians cause a warning, plausible small angles do not."""
    scenario = toml.loads(ARCH.replace("\nangle     = 110.0", f"\n{key} = {value}"))
    said = slips(scenario)
    assert said == [] if told is None else told in said[0] and len(said) == 1


@pytest.mark.parametrize(("weight", "told"), [(18.0, True), (1800.0, True), (18000.0, False)])
def test_the_weight_of_a_fill_or_a_fluid_in_another_unit_is_warned_of(weight, told):
    assert "= 18000.0" in ARCH
    said = slips(toml.loads(ARCH.replace("= 18000.0", f"= {weight}")))
    assert [f"weight of the fill on 'arch' = {weight:g} N/m3 fits no earth" in one for one in said] == [True] * told
    water = '[[pressures]]\nblock = "upper"\ndirection = [0.0, -1.0, 0.0]\nsurface = 1.0\nweight = '
    said = slips(toml.loads(f"{SET4A}\n{water}{weight}\n"))
    assert ["weight of the pressure on 'upper'" in one for one in said] == [True] * told


def test_a_dome_in_radians_is_told_what_to_write():
    """Its eye is in degrees and so beyond its springing: the refusal says why."""
    text = (SCENARIOS / "dome.toml").read_text()
    said = r"oculus of dome 'dome' = 10.0 is out of range: .* for 1.5708 rad write 90"
    changed = re.sub(r"\n(angle|key|oculus) *=.*", "", text).replace(
        "[[domes]]", "[[domes]]\nangle = 1.5708\noculus = 10.0"
    )
    with pytest.raises(ScenarioError, match=said):
        toml.loads(changed)
    with pytest.raises(ScenarioError) as refusal:
        toml.loads(changed.replace("1.5708", "8.0"))
    assert "rad" not in str(refusal.value)


@pytest.mark.parametrize(
    "table, line, key",
    [
        ('[[blocks]]\nname = "stone"', 'mesh = { file = "none.stl" }', "mesh of block 'stone'"),
        ('[[blocks]]\nname = "stone"', 'parts = [{ mesh = { file = "none.stl" } }]', "mesh of block 'stone'"),
        ('[[models]]\nname = "more"\nunit = "m"', 'file = "none.stl"', "file of model 'more'"),
    ],
)
def test_a_file_of_blocks_that_is_not_there_is_told_with_its_line(table, line, key, tmp_path, capsys):
    text = f'{SET4A.partition("[[actuators]]")[0]}{table}\nmaterial = "tuff"\n'
    path = tmp_path / "one.toml"
    path.write_text(f'{text}{line}\n[control]\nkind = "statics"\n')
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert f"{path}:{text.count(chr(10)) + 1}: {key}: " in said and "none.stl: there is no such file" in said


@pytest.mark.parametrize("angle, told", [(0.5236, True), (0.0, False), (2.0, False), (30.0, False)])
def test_a_friction_angle_of_a_fill_in_radians_is_warned_of(angle, told):
    scenario = toml.loads(re.sub(r"friction_angle( *)= [\d.]+", rf"friction_angle\1= {angle}", ARCH))
    assert scenario.fills[0].friction_angle == angle
    assert [line.startswith("friction_angle of the fill on ") for line in slips(scenario)] == [True] * told


@pytest.mark.parametrize(
    "shape",
    [
        "prism = { polygon = [[-150.0, -100.0], [150.0, -100.0], [150.0, 100.0], [-150.0, 100.0]], height = 100.0 }",
        "vertices = [[-150, -100, 0], [150, -100, 0], [150, 100, 0], [-150, 100, 0], [0, 0, 100]]",
        'mesh = { file = "block.ply" }',
    ],
    ids=["prism", "vertices", "mesh"],
)
def test_blocks_of_any_shape_may_be_in_mm(shape, tmp_path):
    (tmp_path / "block.ply").write_text(PLY)
    at = SET4A.rindex("box      =") if "box      =" in SET4A else SET4A.rindex("box =")
    text = SET4A[:at] + shape + SET4A[SET4A.index("\n", at) :]
    scenario = toml.loads(text, tmp_path / "one.toml")
    (found,) = unit_slips(scenario, shapes_of(scenario.all_blocks, scenario.path_of))
    assert "'upper' is 300 m long: lengths are in metres" in found


def test_a_scenario_in_mm_is_told_so_before_it_is_called_soft():
    """Blocks of 300 m overload the joint stiffness; the message blames the unit and does not advise a stiffer joint."""
    before, after, said = SLIPS["mm"]
    with pytest.raises(
        ScenarioError, match="is soft for its load.*'upper' is 300 m long: lengths are in metres"
    ) as found:
        assemble(toml.loads(SET4A.replace(before, after)))
    assert "raise" not in str(found.value)


def test_a_key_that_is_needed_and_missing():
    text = SET4A.partition("[[actuators]]")[0] + '[control]\nkind = "tilt"\naxis = [1.0, 0.0, 0.0]\nrate = 1.0\n'
    assert "[control]: displacement is missing: a tilt in real time needs it, in m" in refused(text)


def test_rounding_prints_as_none_in_tables():
    row = {
        "a_over_b": 1.0,
        "formulation": "convex",
        "printed": 1.0,
        "theory": 1.0,
        "M_T0": 1.0,
        "error_vs_theory": -1e-9,
    }
    assert lab.table_1([row | {"M_T0_upper": 1.0, "M_T0_lower": 1.0}]).endswith(" +0.0000 %")
    carried = dict.fromkeys(joints.COLUMNS, 0.0) | {"N": 467.0, "V_1": 2e-7, "M_T": -1.1369e-13, "e_1": 3e-14}
    line = joints._text([carried | {"joint": "a / b", "state": "closed"}], 1).splitlines()[1]
    assert line.split() == ["a", "/", "b", "467", *"00000000", "closed"]


def test_rounding_beside_a_force_prints_as_none():
    found = {"reactions": {"base": [4e-11, -7063.2, 105948.0, 11301.1, 7.8e-10, 0.0]}}
    assert list(of_reactions(found)) == [
        ("reaction of base", "0, -7063.2, 105948 N", "11301.1, 0, 0 N m about its centroid")
    ]


def test_warnings_stand_on_standard_error_and_quiet_hides_them(capsys):
    check = ["check", str(SCENARIOS / "set4a.toml"), "--set", "joint.friction=32", "--json"]
    assert main(check) == 0
    out, err = capsys.readouterr()
    assert "warning: friction of joint = 32" in err and out.startswith("{")
    assert main([*check, "--quiet"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_no_shipped_scenario_looks_like_a_slip(path):
    assert slips(toml.load(path)) == []


def test_a_run_without_a_limit_has_no_yield_point(tmp_path, capsys):
    """A run whose travel is too short to reach a limit is reported as such, not as having an unlimited load."""
    path = str(tmp_path / "short.h5")
    assert main(["run", str(SCENARIOS / "set4a_curve.toml"), "--set", "control.travel=1e-6", "--out", path]) == 1
    capsys.readouterr()
    assert main(["yield", path]) == 2
    assert "found no yield point: no limit load: the joint has not begun to slip" in capsys.readouterr().err


def test_histories_that_ask_for_no_limit_load_are_left_out_of_the_table(tmp_path, capsys):
    """One such history among results/*.h5 is named and skipped; the table shows the others."""
    limit, rest = (str(tmp_path / name) for name in ("limit.h5", "rest.h5"))
    assert main(["run", "set4a", "--out", limit]) == 0
    assert main(["run", "set4a", "--set", 'control={kind="statics"}', "--out", rest]) == 0
    capsys.readouterr()
    assert main(["yield", limit, rest]) == 0
    out, err = capsys.readouterr()
    assert "216.0549" in out and rest not in out and err == f"left out because no limit load was searched: {rest}\n"
    short = str(tmp_path / "short.h5")
    assert main(["run", "set4a_curve", "--set", "control.travel=1e-6", "--out", short]) == 1
    capsys.readouterr()
    assert main(["yield", limit, short]) == 0
    out, err = capsys.readouterr()
    assert "216.0549" in out and short not in out and f"{short} is left out: this run found no yield point" in err
    assert main(["yield", rest]) == 2
    assert f"{rest}: this run searched no limit load" in capsys.readouterr().err
