"""Blocks from mesh files: all formats, and for every invalid mesh a message that names the faulty face."""

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.geometry.mesh_file import checked, convex_solids
from dembrick.geometry.shapes import box
from dembrick.scenario import toml
from helpers.cad_files import QUADS, TRIANGLES
from helpers.scenario_text import block, header, jack

meshio = pytest.importorskip("meshio")

CORNERS = np.array([[x, y, z] for z in (0.0, 0.1) for y in (0.0, 0.2) for x in (0.0, 0.3)])
TETRAHEDRA = [(0, 1, 2, 4), (1, 3, 2, 7), (1, 7, 4, 5), (2, 4, 7, 6), (1, 2, 4, 7)]

SCENE = header(title="mesh", normal_stiffness=1e10)
SCENE += block("floor", (0.0, 0.0, -0.05), (1.0, 1.0, 0.1), "fixed = true")
SCENE += jack("stone", (0.2, 0.1, 0.05))
SCENE += """
[[blocks]]
name = "stone"
material = "stone"
mesh = { file = "stone.stl", scale = 0.001 }
position = [0.1, 0.0, 0.0]
[control]
kind = "yield"
"""


def write(path, points=CORNERS, cells=(("triangle", TRIANGLES),), **options):
    meshio.Mesh(points, [(kind, np.array(data)) for kind, data in cells]).write(path, **options)
    return str(path)


def is_the_box(solids):
    (found,) = solids
    exact = box((0.3, 0.2, 0.1))
    assert found.volume == pytest.approx(exact.volume, rel=1e-6)
    assert found.centroid == pytest.approx([0.15, 0.1, 0.05], rel=1e-6)
    assert found.inertia == pytest.approx(exact.inertia, abs=1e-6 * exact.inertia.max())
    assert sorted(map(len, found.faces)) == [4] * 6


@pytest.mark.parametrize(
    ("name", "options"),
    [("b.stl", {}), ("b.stl", {"binary": True}), ("b.obj", {}), ("b.ply", {}), ("b.ply", {"binary": False}),
     ("b.msh", {"file_format": "gmsh"}), ("b.msh", {"file_format": "gmsh22"}), ("b.vtu", {})],
)  # fmt: skip
def test_every_format_gives_the_box(tmp_path, name, options):
    is_the_box(convex_solids(write(tmp_path / name, **options)))


@pytest.mark.parametrize("name", ["b.msh", "b.vtu"])
def test_solid_meshes_give_their_skin(tmp_path, name):
    options = {"file_format": "gmsh"} if name == "b.msh" else {}
    is_the_box(convex_solids(write(tmp_path / name, cells=[("tetra", TETRAHEDRA)], **options)))
    is_the_box(convex_solids(write(tmp_path / name, cells=[("hexahedron", [(0, 1, 3, 2, 4, 5, 7, 6)])], **options)))


def test_a_scale_and_a_scene(tmp_path):
    write(tmp_path / "stone.stl", 1000.0 * CORNERS)
    (tmp_path / "scene.toml").write_text(SCENE)
    found = assemble(toml.load(tmp_path / "scene.toml"))
    assert found.mass[1] == pytest.approx(12.0, rel=1e-6)
    assert found.position[1] == pytest.approx([0.25, 0.1, 0.05], rel=1e-6)
    assert len(found.joints) == 1 and found.joints[0].area == pytest.approx(0.06, rel=1e-6)
    short = toml.loads(SCENE.replace('{ file = "stone.stl", scale = 0.001 }', '"stone.stl"'))
    assert short.blocks[1].mesh.scale == 1.0 and toml.loads(toml.dumps(short)) == short


def refused(points, faces, *fragments):
    with pytest.raises(ScenarioError) as caught:
        checked(np.asarray(points, float), list(faces))
    message = str(caught.value)
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message, message


def test_a_hole():
    refused(CORNERS, TRIANGLES[:5] + TRIANGLES[6:], "not closed", "3 edges", "fill the holes")
    refused(CORNERS, QUADS[:3], "not closed")


def test_faces_that_look_inward_are_turned():
    """One inverted face, all of them, the first one, or several: the volume is that of the box."""
    for turned in ({4}, set(range(6)), {0}, {0, 1, 3}):
        (solid,) = checked(CORNERS, [q[::-1] if i in turned else q for i, q in enumerate(QUADS)])
        assert solid.volume == pytest.approx(0.3 * 0.2 * 0.1, rel=1e-12)


def test_two_surfaces_are_left_as_they_are():
    """Two closed surfaces are not turned but refused: an inner one would be a cavity, so outward is ambiguous."""
    both = np.concatenate([CORNERS, CORNERS + (1.0, 0.0, 0.0)])
    second = [tuple(i + 8 for i in q) for q in QUADS]
    refused(both, [q[::-1] for q in QUADS + second], "inside out", "face 0 (about 0.15, 0.1, 0)", "volume -0.012 m3")
    faces = [*QUADS[:4], QUADS[4][::-1], QUADS[5], *second]
    refused(both, faces, "face 4 (about 0, 0.1, 0.05)", "the same way", "looks inward")


def test_flat():
    for faces in (QUADS, TRIANGLES):
        refused(CORNERS * (1, 1, 0), faces, "the surface is flat", "lie in a plane")
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    refused(square, [(0, 1, 2, 3), (3, 2, 1, 0)], "flat", "lie in a plane")


def test_not_convex():
    """A box with a pyramid cut into its top is split into convex parts, whose volume is that of the dented box."""
    dent = np.concatenate([CORNERS, [[0.15, 0.1, 0.07]]])
    top = next(q for q in QUADS if all(CORNERS[i][2] > 0.0 for i in q))
    rim = zip(top, top[1:] + top[:1], strict=True)
    parts = checked(dent, [q for q in QUADS if q != top] + [(a, b, 8) for a, b in rim])
    assert len(parts) > 1
    assert sum(part.volume for part in parts) == pytest.approx(0.3 * 0.2 * (0.1 - 0.03 / 3.0), rel=1e-12)


def test_a_face_that_is_not_plane():
    bent = CORNERS.copy()
    bent[7, 2] += 0.01
    refused(bent, QUADS, "face 1 (about 0.15, 0.1, 0.1025) is not plane", "0.0025 m off")


def test_an_edge_of_three_faces():
    refused(CORNERS, [*TRIANGLES, (0, 2, 4)], "the same way", "three faces")


def test_files_that_cannot_be_read(tmp_path):
    for name, content, fragment in (
        ("a.stl", b"solid nonsense", "a.stl"),
        ("a.obj", b"v 0 0\nf 1 2 3", "a.obj"),
        ("a.step", b"", "use one of .stl, .obj, .ply, .msh, .vtu"),
        ("a.vtu", b"<VTKFile", "cannot be read as vtu"),
        ("a.ply", b"\x00\x01", "cannot be read as ply"),
        ("a.msh", b"(0 x)\n(10 (0 1 4 0 3)\n((((", "cannot be read as msh: its contents do not match its ending"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ScenarioError, match=r"a\.(stl|obj|step|vtu|ply|msh)") as caught:
            convex_solids(str(tmp_path / name))
        assert fragment in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(ScenarioError, match="there is no such file"):
        convex_solids(str(tmp_path / "none.stl"))
    with pytest.raises(ScenarioError, match="mesh of block 'stone': stone.stl: there is no such file"):
        assemble(toml.loads(SCENE))


def test_a_cell_that_is_cut_short(tmp_path):
    """The file ends in the middle of its last cell, a tetrahedron."""
    text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 .1 0 0\n3 0 .1 0\n4 0 0 .1\n$EndNodes\n"
    (tmp_path / "a.msh").write_text(text + "$Elements\n1\n1 4 2 ")
    with pytest.raises(ScenarioError, match="a cell of kind tetra has fewer corners than such a cell needs"):
        convex_solids(str(tmp_path / "a.msh"))


@pytest.mark.parametrize("name", ["b.msh", "b.vtu"])
def test_cells_with_points_on_their_edges_are_refused_and_not_left_out(tmp_path, name):
    """A ten-node tetrahedron is refused even beside a four-node one that can be read."""
    four = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    middles = [(four[a] + four[b]) / 2.0 for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
    points = np.concatenate([four + (5.0, 0.0, 0.0), four, middles])
    cells = [("tetra", [[0, 1, 2, 3]]), ("tetra10", [list(range(4, 14))])]
    options = {"file_format": "gmsh22"} if name == "b.msh" else {}
    with pytest.raises(ScenarioError, match="it has cells of kind tetra10; export a mesh of the first order"):
        convex_solids(write(tmp_path / name, points, cells, **options))
    loose = [("vertex", [[0]]), ("line3", [[4, 5, 8]]), cells[0]]
    assert convex_solids(write(tmp_path / name, points, loose, **options))[0].volume == pytest.approx(1.0 / 6.0)


def test_corners_that_coincide_and_faces_without_an_area_are_taken_out():
    soup = np.concatenate([CORNERS[list(face)] for face in TRIANGLES])
    faces = [(3 * k, 3 * k + 1, 3 * k + 2) for k in range(len(TRIANGLES))]
    is_the_box(checked(soup, [*faces, (0, 0, 1)]))
    rng = np.random.default_rng(0)
    is_the_box(checked(soup + rng.uniform(-1e-11, 1e-11, soup.shape), faces))


def test_a_sphere_of_triangles():
    """The hull of 60 random points on a sphere has the volume that scipy computes, and all of its triangles."""
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(1)
    points = rng.normal(size=(60, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = ConvexHull(points)
    faces = []
    for simplex, equation in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = points[simplex]
        faces.append(tuple(simplex if np.cross(b - a, c - a) @ equation[:3] > 0 else simplex[::-1]))
    (found,) = checked(points, faces)
    assert found.volume == pytest.approx(hull.volume, rel=1e-9)
    assert len(found.faces) == len(faces)
