"""Many solids from one CAD file: every format, names, units, closing of gaps, refusals in one sentence."""

import numpy as np
import pytest

from dembrick import cli
from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.geometry import cad_file, closed_gaps
from dembrick.geometry.convex_hull import from_faces
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.files import inputs_of
from helpers.cad_files import GATE, TRIANGLES, binary_stl, compas, gltf, obj, text_stl
from helpers.scenario_text import header

WRITERS = {
    "objects.obj": (obj, {}),
    "groups.obj": (obj, {"word": "g"}),
    "triangles.obj": (obj, {"faces": TRIANGLES}),
    "text.stl": (text_stl, {}),
    "scene.gltf": (gltf, {}),
    "scene.glb": (gltf, {"binary": True}),
    "assembly.json": (compas, {}),
    "older.json": (compas, {"old": True}),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_solids_with_their_names(tmp_path, name):
    write, options = WRITERS[name]
    write(tmp_path / name, **options)
    in_metres = name.startswith("scene")
    solids = cad_file.read(str(tmp_path / name), 1.0 if in_metres else 1e-3)
    assert [solid.name for solid in solids] == list(GATE)
    for solid, (low, high) in zip(solids, GATE.values(), strict=True):
        np.testing.assert_allclose(solid.corners.min(axis=0), 1e-3 * np.array(low), atol=1e-7)
        np.testing.assert_allclose(solid.corners.max(axis=0), 1e-3 * np.array(high), atol=1e-7)
        assert len(solid.corners) == 8 and len(solid.shape.faces) == 6
    assert [solid.fixed for solid in solids] == [name == "assembly.json", False, False, False]


def test_bodies_without_names_end_where_their_surface_closes(tmp_path):
    """Touching bodies share corners; in a binary STL file only the closing of the surface shows where a body ends."""
    cubes = {str(i): ((i, 0.0, 0.0), (i + 1.0, 1.0, 1.0)) for i in range(3)}
    for write, options in ((binary_stl, {}), (text_stl, {"names": False})):
        write(tmp_path / "cubes.stl", cubes, **options)
        solids = cad_file.read(str(tmp_path / "cubes.stl"), 1.0)
        assert [solid.name for solid in solids] == ["solid.1", "solid.2", "solid.3"]
        assert [solid.corners[:, 0].min() for solid in solids] == [0.0, 1.0, 2.0]


def test_gaps_are_closed_within_the_tolerance_and_not_beyond(tmp_path):
    obj(tmp_path / "gate.obj")
    solids = cad_file.read(str(tmp_path / "gate.obj"), 1e-3)
    closed, found = closed_gaps.close(solids, 1e-3)
    assert sorted(round(1e3 * gap.distance, 6) for gap in found) == [0.1, 0.1, 0.2, 0.3]
    top = [solid.corners[:, 2].max() for solid in closed]
    assert top[1] == pytest.approx(top[2], abs=1e-12) and closed[3].corners[:, 2].min() == pytest.approx(
        top[1], abs=1e-12
    )
    for before, after in zip(solids, closed, strict=True):
        assert len(after.corners) == 8 and len(after.shape.faces) == 6
        assert np.abs(np.sort(before.corners, axis=0) - np.sort(after.corners, axis=0)).max() < 3e-4
    some, fewer = closed_gaps.close(solids, 1.5e-4)
    assert len(fewer) == 2 and some[3].corners[:, 2].min() != pytest.approx(some[2].corners[:, 2].max(), abs=1e-5)
    assert closed_gaps.close(solids, 5e-5) == (solids, [])


def test_faces_askew_come_onto_one_plane(tmp_path):
    """Two faces that differ by a slope of 1e-4 move onto their mean plane, whose slope is half of that."""
    boxes = {"low": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), "high": ((0.0, 0.0, 1.0), (1.0, 1.0, 2.0))}
    obj(tmp_path / "two.obj", boxes)
    low, high = cad_file.read(str(tmp_path / "two.obj"), 1.0)
    lifted = high.corners.copy()
    lifted[(lifted[:, 0] == 1.0) & (lifted[:, 2] == 1.0), 2] += 1e-4
    closed, found = closed_gaps.close([low, high._replace(shape=from_faces(lifted, high.shape.faces))], 2e-4)
    assert [gap.distance for gap in found] == pytest.approx([1e-4], rel=1e-3)
    for solid, z in zip(closed, (1.0, 1.0), strict=True):
        shared = solid.corners[np.abs(solid.corners[:, 2] - z) < 1e-3]
        np.testing.assert_allclose(shared[:, 2], 1.0 + 0.5e-4 * shared[:, 0], atol=1e-9)


def test_faces_in_a_row_that_would_move_too_far_are_refused(tmp_path):
    """Steps of 0.9 mm, each within the tolerance, add up to 3.6 mm on one slab: no plane is near all of the faces."""
    boxes = {f"{i}": ((i, 0.0, 0.9e-3 * i), (i + 1.5, 1.0, 1.0)) for i in range(5)}
    boxes |= {f"under {i}": ((i, 0.0, -1.0), (i + 1.5, 1.0, 0.9e-3 * i - 4e-4)) for i in range(5)}
    obj(tmp_path / "steps.obj", boxes)
    solids = cad_file.read(str(tmp_path / "steps.obj"), 1.0)
    with pytest.raises(ScenarioError, match="more than gap_tolerance = 0.001 m: the faces that touch there do not lie"):
        closed_gaps.close(solids, 1e-3)


SCENE = (
    header(title="gate", friction=0.7, normal_stiffness=1e11)
    + """
[[models]]
name = "gate"
file = "gate.obj"
unit = "mm"
material = "stone"
gap_tolerance = 0.0005
[control]
kind = "tilt"
axis = [0.0, 1.0, 0.0]
"""
)
SCENE = 'supports = ["gate.ground"]\n' + SCENE


@pytest.fixture
def scene(tmp_path):
    obj(tmp_path / "gate.obj")
    path = tmp_path / "gate.toml"
    path.write_text(SCENE)
    return str(path)


def test_a_gate_from_cad_falls_when_its_posts_do(scene):
    """Posts of width b and height h under a lintel rock about their toes at tan(angle) = b / h, for any weight."""
    found = simulate(scene, record=False)
    assert found.collapse["load_factor"] == pytest.approx(0.2, rel=1e-3)
    assert [name.partition(".")[2] for name in found.collapse["blocks"]] == ["left", "right", "lintel"]
    scenario = toml.load(scene)
    assert inputs_of(scenario) == [scene, scene.replace("toml", "obj")]
    assert toml.loads(toml.dumps(scenario), scene) == scenario
    turned = toml.load(scene, ["models.gate.heading=90", "models.gate.position=[1,2,3]", "control.axis=[1,0,0]"])
    assert simulate(turned, record=False).collapse["load_factor"] == pytest.approx(0.2, rel=1e-3)


def test_gaps_are_told(scene, capsys):
    assert assemble(toml.load(scene)).warnings[0] == (
        "model 'gate': 4 pairs of faces up to 0.3 mm apart or overlapping were moved onto one plane "
        "(gap_tolerance = 0.0005 m)"
    )
    remarks = toml.load(scene, ["models.gate.gap_tolerance=0"]).remarks
    assert len(remarks) == 1 and "share no joint" in remarks[0] and "gap_tolerance = 0.0004 closes them" in remarks[0]
    assert cli.main(["check", scene, "--set", "models.gate.gap_tolerance=0"]) == 2
    assert "gap_tolerance = 0.0004 closes them" in capsys.readouterr().err


def test_an_edited_file_is_read_again(scene, tmp_path):
    assert len(toml.load(scene).all_blocks) == 4
    obj(tmp_path / "gate.obj", dict(list(GATE.items())[:3]))
    assert len(toml.load(scene).all_blocks) == 3


@pytest.mark.parametrize(
    "changes, said",
    [
        (["models.gate.unit=yard"], "unit of model 'gate' = 'yard' is not one of m, cm, mm, in, ft"),
        (["models.gate.gap_tolerance=-1"], "gap_tolerance of model 'gate' = -1.0 is out of range: it must be at least"),
        (["models.gate.file=none.obj"], "there is no such file"),
        (["models.gate.file=gate.toml"], "its ending is .toml; use one of .obj, .stl, .gltf"),
        (["models.gate.unit=m"], "blocks 'gate.ground' and 'gate.right' overlap by 0.1 m"),
    ],
)  # fmt: skip
def test_keys_that_are_wrong(scene, changes, said):
    with pytest.raises(ScenarioError) as refusal:
        assemble(toml.load(scene, changes))
    assert said in str(refusal.value)


BAD = {
    "empty.obj": (b"", "there is no surface"),
    "words.obj": (b"v 1 2 three\n", "line 1 cannot be read as OBJ"),
    "short.obj": (
        b"o a\nv 0 0 0\nf 1 2 3\n",
        "line 3 cannot be read as OBJ: a face has fewer than three corners, or names",
    ),
    "flat.obj": (b"o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n", "solid 'a': the surface is flat"),
    "noise.stl": (b"solid x\nfacet\n", "neither a binary STL file"),
    "cut.stl": (b"x" * 80 + (5).to_bytes(4, "little") + b"short", "neither a binary STL file"),
    "bad.stl": (b"solid a\nvertex 1 2 three\nendsolid a\n", "does not have three numbers"),
    "list.json": (b"[1, 2]", "it is not a table of keys"),
    "cut.json": (b'{"a": ', "cannot be read as COMPAS JSON"),
    "other.json": (b'{"a": 1}', "it contains no block"),
    "hole.json": (b'{"a": {"vertex": {"0": {"x": 1}}, "face": {"0": [0, 1, 2]}}}', "is damaged: KeyError('1')"),
    "cut.glb": (b"glTF" + bytes(20), "cannot be read as glTF"),
    "nodes.gltf": (b'{"nodes": [{"mesh": 7}]}', "names number 7 of meshes, but there are 0"),
    "scene.gltf": (b'{"asset": {"version": "2.0"}, "nodes": []}', "there is no surface"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_a_sentence(tmp_path, name, capfd):
    content, said = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ScenarioError) as refusal:
        cad_file.read(str(tmp_path / name), 1.0)
    assert said in str(refusal.value) and str(tmp_path / name) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_solid_whose_faces_are_bent_is_named(tmp_path):
    boxes = {"good": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))}
    obj(tmp_path / "bad.obj", boxes)
    text = (tmp_path / "bad.obj").read_text().replace("v 1 1 1", "v 0.4 0.4 0.4")
    (tmp_path / "bad.obj").write_text(text.replace("o good", "o dented"))
    with pytest.raises(ScenarioError, match="solid 'dented': .*not plane"):
        cad_file.read(str(tmp_path / "bad.obj"), 1.0)


def test_the_parts_of_a_solid_bear_its_name(tmp_path):
    """An L is split into two convex parts, and both are named after it."""
    foot = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
    lines = ["o foot"] + [f"v {x} {y} {z}" for z in (0, 1) for x, y in foot]
    lines += ["f 6 5 4 3 2 1", "f 7 8 9 10 11 12"]
    lines += [f"f {i + 1} {(i + 1) % 6 + 1} {(i + 1) % 6 + 7} {i + 7}" for i in range(6)]
    (tmp_path / "l.obj").write_text("\n".join(lines))
    found = cad_file.read(str(tmp_path / "l.obj"), 0.1)
    assert [solid.name for solid in found] == ["foot", "foot"]
    assert sum(solid.shape.volume for solid in found) == pytest.approx(4e-3, rel=1e-12)


def test_a_hollow_solid_is_refused(tmp_path):
    """Its inner surface would be read as a second, solid block inside the first; a table on four legs is not hollow."""
    shell = {"outer": ((0.0, 0.0, 0.0), (3.0, 3.0, 3.0)), "inner": ((1.0, 1.0, 1.0), (2.0, 2.0, 2.0))}
    binary_stl(tmp_path / "shell.stl", shell)
    with pytest.raises(ScenarioError, match=r"solid 'solid' is hollow: .* cut it into pieces"):
        cad_file.read(str(tmp_path / "shell.stl"), 1.0)
    legs = [((x, y, 0.0), (x + 1.0, y + 1.0, 3.0)) for x in (0.0, 3.0) for y in (0.0, 3.0)]
    table = {str(i): leg for i, leg in enumerate([*legs, ((-1.0, -1.0, 3.0), (5.0, 5.0, 4.0))])}
    binary_stl(tmp_path / "table.stl", table)
    assert len(cad_file.read(str(tmp_path / "table.stl"), 1.0)) == 5


def test_a_solid_in_the_opening_of_another_is_no_hollow(tmp_path):
    """A stone between the arms of a U lies inside the bounding box of the U but outside its surface."""
    corners = [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (1, 1), (1, 3), (0, 3)]
    count = len(corners)
    lines = ["o both"] + [f"v {x} {y} {z}" for z in (0, 3) for x, y in corners]
    lines += [
        f"f {' '.join(str(i) for i in range(count, 0, -1))}",
        f"f {' '.join(str(count + i + 1) for i in range(count))}",
    ]
    lines += [f"f {i + 1} {(i + 1) % count + 1} {(i + 1) % count + count + 1} {i + count + 1}" for i in range(count)]
    first = 2 * count
    box = [(x, y, z) for z in (1, 2) for y in (1.5, 2.5) for x in (2, 3)]
    lines += [f"v {x} {y} {z}" for x, y, z in box]
    faces = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    lines += ["f " + " ".join(str(first + 1 + i) for i in face) for face in faces]
    (tmp_path / "u.obj").write_text("\n".join(lines))
    found = cad_file.read(str(tmp_path / "u.obj"), 0.1)
    assert sum(solid.shape.volume for solid in found) == pytest.approx((15.0 - 6.0) * 3e-3 + 1e-3, rel=1e-9)
