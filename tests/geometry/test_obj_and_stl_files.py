"""OBJ and STL as programs write them: read alike as a block and as a structure, with refusals that name the line."""

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.geometry import cad_file
from dembrick.geometry.mesh_file import convex_solids
from helpers.cad_files import QUADS, binary_stl, corners, obj, text_stl

LOW, HIGH = (1.0, 2.0, 3.0), (1.5, 2.25, 3.125)
BOX = {"stone": (LOW, HIGH)}


def corner_lines(after=""):
    return ["v {} {} {}".format(*point) + after for point in corners(LOW, HIGH).tolist()]


def face_lines(corner="{}", first=1):
    return ["f " + " ".join(corner.format(i + first) for i in face) for face in QUADS]


PLAIN = "\n".join(["o stone", *corner_lines(), *face_lines()]) + "\n"
OBJ = {
    "plain": PLAIN,
    "textures and normals": "\n".join([*corner_lines(), "vt 0 0", "vn 0 0 1", *face_lines("{}/1/1")]),
    "textures": "\n".join([*corner_lines(), "vt 0 0", *face_lines("{}/1")]),
    "normals": "\n".join([*corner_lines(), "vn 0 0 1", *face_lines("{}//1")]),
    "counted from the end": "\n".join([*corner_lines(), *face_lines(first=-8)]),
    "colours": "\n".join([*corner_lines(" 0.5 0.25 1.0"), *face_lines()]),
    "weights": "\n".join([*corner_lines(" 1.0"), *face_lines()]),
    "joined lines": PLAIN.replace("f 1 3", "f 1 \\\n3").replace("f 5", "f 5 \\\n"),
    "tabs": PLAIN.replace(" ", "\t"),
    "many blanks": PLAIN.replace(" ", " \t "),
    "ends of Windows": PLAIN.replace("f 1 3", "f 1 3 \\\n").replace("\n", "\r\n"),
    "old ends": PLAIN.replace("\n", "\r"),
    "remarks": PLAIN.replace("\nf", " # a remark\nf"),
    "byte order mark": "\ufeff" + PLAIN,
    "faces of old": PLAIN.replace("\nf", "\nfo"),
    "materials": "mtllib stone.mtl\n" + PLAIN.replace("\nf", "\nusemtl grey\ns off\nf", 1),
}


def is_the_box(path):
    """Assert that the reader of blocks and the reader of structures both find the box; return its name."""
    (block,) = convex_solids(str(path))
    (solid,) = cad_file.read(str(path), 1.0)
    for points in (block.vertices + block.centroid, solid.corners):
        assert len(points) == 8
        np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [LOW, HIGH], rtol=1e-12)
    assert block.volume == pytest.approx(0.5 * 0.25 * 0.125, rel=1e-12)
    assert len(block.faces) == len(solid.shape.faces) == 6
    return solid.name


@pytest.mark.parametrize("name", OBJ)
def test_an_obj_file_is_read_alike_as_a_block_and_as_a_structure(tmp_path, name):
    (tmp_path / "stone.obj").write_bytes(OBJ[name].encode())
    assert is_the_box(tmp_path / "stone.obj") == ("stone" if "stone" in OBJ[name] else "solid")


STL = {
    "plain": (lambda s: s, "stone"),
    "ends of Windows": (lambda s: s.replace("\n", "\r\n"), "stone"),
    "old ends": (lambda s: s.replace("\n", "\r"), "stone"),
    "capitals": (lambda s: s.upper(), "STONE"),
    "no name, and blanks": (lambda s: s.replace("solid stone", "solid  "), "solid"),
    "a word of the format as name": (lambda s: s.replace("solid stone", "solid vertex facet 1"), "vertex facet 1"),
    "tabs": (lambda s: s.replace("vertex ", "\t\tvertex\t"), "stone"),
    "byte order mark": (lambda s: "\ufeff" + s, "stone"),
}


@pytest.mark.parametrize("name", STL)
def test_an_stl_file_of_text_is_read_alike_as_a_block_and_as_a_structure(tmp_path, name):
    text_stl(tmp_path / "stone.stl", BOX)
    edit, called = STL[name]
    (tmp_path / "stone.stl").write_bytes(edit((tmp_path / "stone.stl").read_text()).encode())
    assert is_the_box(tmp_path / "stone.stl") == called


@pytest.mark.parametrize("after", [b"", b"\0\0\0", b"\r\n"])
def test_a_binary_stl_file_may_begin_with_the_word_of_text(tmp_path, after):
    binary_stl(tmp_path / "stone.stl", BOX)
    data = (tmp_path / "stone.stl").read_bytes()
    (tmp_path / "stone.stl").write_bytes(b"solid stone".ljust(80) + data[80:] + after)
    assert is_the_box(tmp_path / "stone.stl") == "solid"


def lines_of_stl():
    facet = "facet normal 0 0 0\nouter loop\n" + "vertex 0 0 0\n" * 3 + "endloop\nendfacet\n"
    return "solid a\n" + facet


BAD = {
    "zero.obj": (PLAIN.replace("f 1", "f 0"), "line 10 cannot be read as OBJ: a face has fewer than three corners, or"),
    "joined.obj": ("v 0 0 0\nf 1 \\\n 2 \\\n 3\n", "line 2 cannot be read as OBJ"),
    "short.obj": ("v 0 0\n", "line 1 cannot be read as OBJ: a corner has fewer than three coordinates"),
    "curved.obj": (
        PLAIN + "cstype bspline\ndeg 3 3\nsurf 0 1 0 1 1 2 3 4\n",
        "line 18 cannot be read as OBJ: it holds",
    ),
    "cut.stl": (lines_of_stl() + "endsolid a\n" + lines_of_stl(), "it ends within solid 'a', so it is incomplete"),
    "square.stl": (lines_of_stl().replace("endloop", "vertex 0 0 0\nendloop") + "endsolid", "above line 9"),
    "two.stl": (
        lines_of_stl().replace("vertex 0 0 0", "vertex 0 0"),
        "the vertex in line 4 does not have three numbers",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_refused_by_both_readers(tmp_path, name):
    content, said = BAD[name]
    (tmp_path / name).write_text(content)
    for read in (convex_solids, lambda path: cad_file.read(path, 1.0)):
        with pytest.raises(ScenarioError) as refusal:
            read(str(tmp_path / name))
        assert said in str(refusal.value) and str(tmp_path / name) in str(refusal.value)
        assert "\n" not in str(refusal.value)


def test_a_binary_file_with_more_than_it_says_is_refused(tmp_path):
    """Two files joined end to end are refused rather than read without the second body."""
    binary_stl(tmp_path / "stone.stl", BOX)
    (tmp_path / "stone.stl").write_bytes(2 * (tmp_path / "stone.stl").read_bytes())
    with pytest.raises(ScenarioError, match=r"neither a binary STL file \(its length does not fit\) nor a text one"):
        convex_solids(str(tmp_path / "stone.stl"))


def test_solids_of_one_name_stay_apart_in_stl_and_objects_go_before_groups_in_obj(tmp_path):
    text_stl(tmp_path / "one.stl", BOX)
    once = (tmp_path / "one.stl").read_text()
    (tmp_path / "two.stl").write_text(once + once.replace("vertex 1", "vertex 7"))
    assert [solid.name for solid in cad_file.read(str(tmp_path / "two.stl"), 0.1)] == ["stone.1", "stone.2"]
    two = {"a": (LOW, HIGH), "b": ((5.0, 2.0, 3.0), (6.0, 3.0, 4.0))}
    obj(tmp_path / "two.obj", two)
    grouped = (tmp_path / "two.obj").read_text().replace("o b", "g layer\no b")
    (tmp_path / "two.obj").write_text(grouped)
    assert [solid.name for solid in cad_file.read(str(tmp_path / "two.obj"), 0.1)] == ["a", "b"]
