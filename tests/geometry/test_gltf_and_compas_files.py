"""glTF and COMPAS files in all variants: mirrored, nested, damaged. Positions by hand, refusals in one sentence."""

import base64
import json
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest

from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.geometry import cad_file
from helpers.cad_files import GATE, compas, gltf
from helpers.places import TESTS
from helpers.scenario_text import header

MUTATE = """
import json, random, sys
from pathlib import Path
from dembrick.errors import ScenarioError
from dembrick.geometry import cad_file

JUNK = [-1, 0, 1, 2, 7, 1e9, 10**30, 1.5, float("nan"), True, None, "", "x", "../a.bin", "data:,", [], [0], [[]], {}]
source, folder, first, last = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])

def spots(part):
    for key, value in list(part.items() if isinstance(part, dict) else enumerate(part)):
        yield part, key
        if isinstance(value, (dict, list)):
            yield from spots(value)

for seed in range(first, last):
    rng = random.Random(seed)
    if source.endswith(".glb"):
        data = bytearray(Path(source).read_bytes())
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        data = data[: rng.choice([len(data), rng.randrange(len(data))])]
        path = folder + "/fuzzed.glb"
    else:
        document = json.loads(Path(source).read_text())
        for _ in range(rng.randint(1, 3)):
            part, key = rng.choice(list(spots(document)))
            if rng.random() < 0.2:
                del part[key]
            else:
                part[key] = rng.choice(JUNK)
        data = json.dumps(document).encode()
        path = folder + "/fuzzed.gltf"
    Path(path).write_bytes(data)
    try:
        print("read", len(cad_file.read(path, 1.0)))
    except ScenarioError as error:
        assert "\\n" not in str(error) and len(str(error)) < 500, str(error)
        print("refused")
"""


@pytest.mark.parametrize("name", ["scene.gltf", "scene.glb"])
def test_damaged_scenes_are_refused_in_a_sentence_and_crash_nothing(tmp_path, name):
    """200 random changes, omissions and cuts of the bytes of a GLB file, and as many of the entries of a document."""
    gltf(tmp_path / name, binary=name.endswith("glb"))
    command = [sys.executable, "-W", "error", "-c", MUTATE, str(tmp_path / name), str(tmp_path), "0", "200"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=TESTS.parent, timeout=120, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr[-2000:]
    said = Counter(line.split()[0] for line in done.stdout.splitlines())
    assert said.total() == 200 and said["refused"] > 50 and (name == "scene.glb" or said["read"] > 10)


def edited(path, edit):
    gltf(path)
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))
    return str(path)


def test_a_mirrored_node_turns_the_winding(tmp_path):
    """A negative determinant reverses the winding of the triangles (glTF 2.0, 3.7.4)."""

    def mirror(document):
        document["nodes"].append({"children": [0, 1, 2, 3], "scale": [-1, 1, 1]})
        document["scenes"] = [{"nodes": [4]}]

    solids = cad_file.read(edited(tmp_path / "mirrored.gltf", mirror), 1.0)
    assert [solid.name for solid in solids] == list(GATE)
    for solid, (low, high) in zip(solids, GATE.values(), strict=True):
        ends = 1e-3 * np.array([[-high[0], *low[1:]], [-low[0], *high[1:]]])
        np.testing.assert_allclose([solid.corners.min(axis=0), solid.corners.max(axis=0)], ends, atol=1e-6)


def test_matrix_and_turns_place_what_hangs_on_a_node(tmp_path):
    """A quarter turn about the file's y (our z), then a matrix, by columns, that scales by 2 and lifts by 1."""

    def hang(document):
        half = 0.5**0.5
        document["nodes"].append({"children": [0], "rotation": [0, half, 0, half]})
        document["nodes"].append({"children": [4], "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 1, 0, 1]})
        document["scenes"] = [{"nodes": [5]}]

    (solid,) = cad_file.read(edited(tmp_path / "turned.gltf", hang), 1.0)
    # ground: x -.5 to 1.5, y -.5 to .8, z -.1 to 0; turned (x, y) -> (-y, x)
    ends = [[-1.6, -1.0, 0.8], [1.0, 3.0, 1.0]]
    np.testing.assert_allclose([solid.corners.min(axis=0), solid.corners.max(axis=0)], ends, atol=1e-6)


def test_strips_and_fans_and_triangles_without_indices(tmp_path):
    """A box with four faces as a list of triangles, one as a fan and one as a strip is still the same box."""

    def modes(document):
        blob = document["buffers"][0]["uri"]
        extra = np.array([0, 2, 3, 1, 4, 5, 6, 7], "<u2")
        data = base64.b64decode(blob.split(",")[1])
        start = len(data)
        document["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": 16})
        for offset in (0, 8):
            view = {"bufferView": len(document["bufferViews"]) - 1, "byteOffset": offset, "componentType": 5123}
            document["accessors"].append(view | {"count": 4, "type": "SCALAR"})
        index = document["meshes"][0]["primitives"][0]["indices"]
        document["accessors"][index] |= {"count": 24}
        document["accessors"][index]["byteOffset"] = 24  # skip the first two faces, of two triangles each
        n, position = len(document["accessors"]), document["meshes"][0]["primitives"][0]["attributes"]
        document["meshes"][0]["primitives"] += [
            {"attributes": position, "indices": n - 2, "mode": 6},
            {"attributes": position, "indices": n - 1, "mode": 5},
        ]
        data += extra.tobytes()
        document["buffers"][0] = {
            "byteLength": len(data),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
        }

    solids = cad_file.read(edited(tmp_path / "modes.gltf", modes), 1.0)
    assert [solid.name for solid in solids] == list(GATE)
    assert solids[0].shape.volume == pytest.approx(2.0 * 1.3 * 0.1, rel=1e-5)


def deep(document, levels=5000):
    nodes = document["nodes"]
    for _ in range(levels):
        nodes.append({"children": [len(nodes) - 1], "translation": [0.0, 0.001, 0.0]})
    document["scenes"] = [{"nodes": [len(nodes) - 1]}]


def test_five_thousand_nodes_below_one_another(tmp_path):
    (solid,) = cad_file.read(edited(tmp_path / "deep.gltf", deep), 1.0)
    assert solid.name == "lintel" and solid.corners[:, 2].max() == pytest.approx(1.2 + 5.0, abs=1e-5)


def put(*keys_and_value):
    *keys, last, value = keys_and_value

    def edit(document):
        for key in keys:
            document = document[key]
        document[last] = value

    return edit


DAMAGED = {
    "its own child": (put("nodes", 0, "children", [0]), "must be a tree"),
    "a cycle": (lambda d: (put("nodes", 0, "children", [1])(d), put("nodes", 1, "children", [0])(d)), "must be a tree"),
    "a short matrix": (put("nodes", 1, "matrix", [1] * 15), "not a list of 16 numbers"),
    "no buffer": (put("buffers", []), "number 0 of buffers, but there are 0"),
    "no data": (put("buffers", 0, {"byteLength": 999}), "its data are not in the file"),
    "short data": (put("buffers", 0, "byteLength", 10**6), "of its 1000000 bytes"),
    "a long view": (put("bufferViews", 0, "byteLength", 10**6), "reaches beyond its buffer"),
    "a long accessor": (put("accessors", 0, "count", 10**12), "reaches beyond its bufferView"),
    "a corner too far": (put("accessors", 0, "count", 7), "has a triangle at corner 7"),
    "outside": (put("buffers", 0, "uri", "../../../../etc/hostname"), "leads out of the folder"),
    "outside, hidden": (put("buffers", 0, "uri", "%2e%2e/other.bin"), "leads out of the folder"),
    "absolute": (put("buffers", 0, "uri", "/etc/hostname"), "leads out of the folder"),
    "on the net": (put("buffers", 0, "uri", "https://localhost/a.bin"), "leads out of the folder"),
    "absent": (put("buffers", 0, "uri", "none.bin"), "there is no ordinary file 'none.bin'"),
    "instances": (put("nodes", 0, "extensions", {"EXT_mesh_gpu_instancing": {}}), "export without them"),
    "compressed": (put("extensionsRequired", ["KHR_draco_mesh_compression"]), "export without it"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_what_is_damaged_is_said(tmp_path, name):
    edit, said = DAMAGED[name]
    with pytest.raises(ScenarioError) as refusal:
        cad_file.read(edited(tmp_path / "scene.gltf", edit), 1.0)
    assert said in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_buffer_beside_the_file_is_read(tmp_path):
    def outside(document):
        uri = document["buffers"][0]["uri"]
        (tmp_path / "the data.bin").write_bytes(base64.b64decode(uri.split(",")[1]))
        document["buffers"][0]["uri"] = "the%20data.bin"

    assert len(cad_file.read(edited(tmp_path / "scene.gltf", outside), 1.0)) == len(GATE)


SCENE = (
    'supports = ["m.{support}"]'
    + header(friction=0.5, normal_stiffness=1e10)
    + """
[[models]]
name = "m"
file = "{file}"
unit = "{unit}"
material = "stone"
gap_tolerance = 0.001
[control]
kind = "statics"
"""
)


def test_the_command_line_refuses_with_exit_2_and_one_line(tmp_path, capfd):
    edited(tmp_path / "scene.gltf", DAMAGED["a cycle"][0])
    (tmp_path / "scene.toml").write_text(SCENE.format(support="ground", file="scene.gltf", unit="m"))
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    out, err = capfd.readouterr()
    assert not out and err.count("\n") == 1 and "must be a tree" in err


def moved(path, matrix, **more):
    """The gate with a transformation stored beside the geometry of every block, as elements of models have it."""
    compas(path)
    document = json.loads(path.read_text())
    nodes = document["data"]["graph"]["data"]["node"]
    for node in nodes.values():
        given = {"dtype": "compas.geometry/Transformation", "data": {"matrix": matrix}}
        node["transformation"] = given if matrix else None
        node |= more
    path.write_text(json.dumps(document))
    return str(path)


STRETCH = [[2, 0, 0, 100], [0, 2, 0, 0], [0, 0, 4, -50], [0, 0, 0, 1]]
MIRROR = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize("matrix", [None, STRETCH, MIRROR])
def test_a_transformation_moves_the_block(tmp_path, matrix):
    applied = np.array(matrix or np.eye(4), float)
    for solid, ends in zip(cad_file.read(moved(tmp_path / "a.json", matrix), 1.0), GATE.values(), strict=True):
        expected = np.array(ends) @ applied[:3, :3].T + applied[:3, 3]
        np.testing.assert_allclose(solid.corners.min(axis=0), expected.min(axis=0), atol=1e-9)
        np.testing.assert_allclose(solid.corners.max(axis=0), expected.max(axis=0), atol=1e-9)


@pytest.mark.parametrize(
    "matrix, more, said",
    [
        ([[1, 0], [0, 1]], {}, "not a matrix of 4 x 4 numbers"),
        ([*STRETCH[:3], [0, 0, 0, 2]], {}, "not a matrix of 4 x 4 numbers"),
        (None, {"is_support": "false"}, "is_support of block '0' is 'false'; it must be true or false"),
        (None, {"is_support": 1}, "it must be true or false"),
    ],
)
def test_what_a_block_says_wrongly_is_refused(tmp_path, matrix, more, said):
    with pytest.raises(ScenarioError, match=said):
        cad_file.read(moved(tmp_path / "a.json", matrix, **more), 1.0)


def test_parts_have_the_keys_of_their_nodes(tmp_path):
    compas(tmp_path / "a.json")
    document = json.loads((tmp_path / "a.json").read_text())
    nodes = document["data"]["graph"]["data"]["node"]
    for node in nodes.values():
        node["part"] = node.pop("block")
        del node["part"]["data"]["attributes"]
    (tmp_path / "a.json").write_text(json.dumps(document))
    assert [solid.name for solid in cad_file.read(str(tmp_path / "a.json"), 1.0)] == ["0", "1", "2", "3"]


def with_a_block(path, block, **more):
    """The gate with one more block, in a node of its own."""
    compas(path)
    document = json.loads(path.read_text())
    document["data"]["graph"]["data"]["node"]["cap"] = {"block": block, **more}
    path.write_text(json.dumps(document))
    return str(path)


def in_type(kind, data):
    return {"dtype": f"compas.geometry/{kind}", "data": data}


FRAME = {"point": [10.0, 20.0, 30.0], "xaxis": [0.0, 2.0, 0.0], "yaxis": [-1.0, 3.0, 0.0]}  # a quarter turn about z
SIZES = {"xsize": 4.0, "ysize": 2.0, "zsize": 6.0}
PRISM = {
    "vertices": [[0, 0, 0], [4, 0, 0], [0, 2, 0], [0, 0, 6], [4, 0, 6], [0, 2, 6]],
    "faces": [[0, 2, 1], [3, 4, 5], [0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]],
}


@pytest.mark.parametrize(
    "block, low, high, volume",
    [
        (in_type("Box", SIZES | {"frame": FRAME}), (9, 18, 27), (11, 22, 33), 48.0),
        (in_type("Box", SIZES | {"frame": in_type("Frame", FRAME)}), (9, 18, 27), (11, 22, 33), 48.0),
        ({"dtype": "compas.geometry/Box", "value": SIZES | {"frame": None}}, (-2, -1, -3), (2, 1, 3), 48.0),
        (in_type("Polyhedron", PRISM), (0, 0, 0), (4, 2, 6), 24.0),
    ],
)
def test_boxes_and_polyhedra_are_blocks(tmp_path, block, low, high, volume):
    solids = cad_file.read(with_a_block(tmp_path / "a.json", block, is_support=True), 1.0)
    assert [solid.name for solid in solids] == [*GATE, "cap"] and solids[-1].fixed
    assert solids[-1].shape.volume == pytest.approx(volume, rel=1e-12)
    np.testing.assert_allclose(solids[-1].corners.min(axis=0), low, atol=1e-12)
    np.testing.assert_allclose(solids[-1].corners.max(axis=0), high, atol=1e-12)


def test_a_transformation_moves_a_box(tmp_path):
    lifted = {"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]}
    file = with_a_block(tmp_path / "a.json", in_type("Box", SIZES), transformation=in_type("Translation", lifted))
    assert cad_file.read(file, 1.0)[-1].corners[:, 2].max() == pytest.approx(8.0, rel=1e-12)


NO_BLOCKS = {
    "sphere": (in_type("Sphere", {"radius": 1.0}), "block 'cap' is of type 'Sphere' and has no corners and faces"),
    "brep": ({"dtype": "compas_occ.brep/OCCBrep", "data": {"faces": [{}]}}, "block 'cap' is of type 'OCCBrep' and has"),
    "unknown": ({"dtype": "mine/Stone", "data": {"radius": 1.0}}, "block 'cap' is of type 'Stone' and has no corners"),
    "empty": ({"vertex": {}, "face": {}}, "block 'cap' is empty: it has no corners and faces; put its mesh into"),
    "features": (in_type("Box", SIZES) | {"features": [{"a": 1}]}, "block 'cap' has features that change its shape"),
    "frame": (in_type("Box", SIZES | {"frame": {"point": [0, 0, 0]}}), "block 'cap' is damaged: KeyError('xaxis')"),
    "no plane": (in_type("Box", SIZES | {"frame": FRAME | {"yaxis": [0, 1, 0]}}), "its frame span no plane"),
    "corner": (in_type("Polyhedron", PRISM | {"faces": [[0, 1, 6]]}), "block 'cap' is damaged: KeyError(6)"),
}


@pytest.mark.parametrize("name", NO_BLOCKS)
def test_a_block_that_cannot_be_read_is_refused_and_not_left_out(tmp_path, name):
    block, said = NO_BLOCKS[name]
    with pytest.raises(ScenarioError) as refusal:
        cad_file.read(with_a_block(tmp_path / "a.json", block), 1.0)
    assert said in str(refusal.value) and "\n" not in str(refusal.value)
    assert str(tmp_path / "a.json") in str(refusal.value)


def test_the_box_around_a_block_is_none(tmp_path):
    file = with_a_block(tmp_path / "a.json", in_type("Polyhedron", PRISM), aabb=in_type("Box", SIZES))
    assert len(cad_file.read(file, 1.0)) == len(GATE) + 1
