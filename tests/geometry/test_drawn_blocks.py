"""Blocks as masonry programs write them in COMPAS files: prisms that are not convex, faces with the wrong winding,
repeated corners, and several solids that form one block."""

import json

import numpy as np
import pytest

import dembrick
from dembrick.assembly.build import assemble
from dembrick.geometry import cad_file
from dembrick.scenario import toml
from helpers import cad_files
from helpers.scenario_text import header

RING = [(0.0, 0.0), (1.2, 0.0), (1.2, 0.6), (0.9, 0.6), (0.9, 0.3), (0.3, 0.3), (0.3, 0.6), (0.0, 0.6)]  # a U, m
AREA = 1.2 * 0.6 - 0.6 * 0.3
DEPTH = 0.4
BOX = ((-0.5, -0.2, -0.2), (1.7, 0.6, 0.0))  # the floor


def prism(ring=RING):
    """Corners (2 n, 3) and outward faces of a prism along y over a ``ring`` in x and z."""
    n = len(ring)
    points = np.array([(x, y, z) for y in (0.0, DEPTH) for x, z in ring])
    sides = [(i, i + n, (i + 1) % n + n, (i + 1) % n) for i in range(n)]
    return points, [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *sides]


def apart(points, faces):
    """The same surface with separate corners for every face, as triangle exports have them."""
    corners = np.concatenate([points[list(face)] for face in faces])
    ends = np.cumsum([0, *map(len, faces)])
    return corners, [tuple(range(a, b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]


def wound(points, faces, turned):
    """The same surface with the winding of the faces numbered in ``turned`` reversed."""
    return points, [face[::-1] if i in turned else face for i, face in enumerate(faces)]


KINDS = {
    "not convex": prism(),
    "one face the wrong way": wound(*prism(), {4}),
    "every other face the wrong way": wound(*prism(), set(range(0, 10, 2))),
    "inside out": wound(*prism(), set(range(10))),
    "repeated corners": apart(*prism()),
    "repeated corners, wound the wrong way": apart(*wound(*prism(), {0, 3, 7})),
}


def written(path, *blocks):
    """Write a COMPAS assembly of ``blocks``: name, corners, faces, and whether it is a support."""
    nodes = {}
    for i, (name, points, faces, support) in enumerate(blocks):
        vertex = {str(k): dict(zip("xyz", point.tolist(), strict=True)) for k, point in enumerate(points)}
        data = {"attributes": {"name": name}, "vertex": vertex, "face": {str(k): f for k, f in enumerate(faces)}}
        block = {"dtype": "compas_assembly.datastructures/Block", "data": data}
        nodes[str(i)] = {"block": block, "is_support": support}
    graph = {"dtype": "compas.datastructures/Graph", "data": {"node": nodes, "edge": {}}}
    path.write_text(json.dumps({"dtype": "compas_assembly.datastructures/Assembly", "data": {"graph": graph}}))
    return path


FLOOR = ("floor", cad_files.corners(*BOX), cad_files.QUADS, True)
SCENE = (
    header(friction=0.9, normal_stiffness=1e10)
    + """
[[models]]
name = "m"
file = "a.json"
unit = "m"
material = "stone"
{more}
[control]
kind = "pushover"
direction = [-1.0, 0.0, 0.0]
"""
)


def test_the_prism_looks_outward():
    points, faces = prism()
    rims = [points[list(face)] for face in faces]
    volume = sum(np.cross(p[i], p[i + 1]) @ p[0] / 6.0 for p in rims for i in range(1, len(p) - 1))
    assert volume == pytest.approx(AREA * DEPTH)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_the_same_block(tmp_path, kind):
    """Volume and centroid are those of the polygon; pushed sideways, the block slides at the friction coefficient."""
    written(tmp_path / "a.json", FLOOR, ("u", *KINDS[kind], False))
    solids = [solid for solid in cad_file.read(str(tmp_path / "a.json"), 1.0) if solid.name == "u"]
    assert sum(solid.shape.volume for solid in solids) == pytest.approx(AREA * DEPTH, rel=1e-9)
    scenario = toml.loads(SCENE.format(more=""), tmp_path / "a.toml")
    found = assemble(scenario)
    assert found.names == ("m.floor", "m.u") and found.fixed.tolist() == [True, False]
    height = (1.2 * 0.3 * 0.15 + 2 * 0.3 * 0.3 * 0.45) / AREA
    assert found.position[1] == pytest.approx((0.6, 0.5 * DEPTH, height), abs=1e-9)
    assert found.mass[1] == pytest.approx(2000.0 * AREA * DEPTH, rel=1e-9)
    assert dembrick.limit(scenario).load_factor == pytest.approx(0.9, rel=1e-6)  # sliding; rocking takes more


def test_solids_that_are_one_block_may_be_wound_as_they_like(tmp_path):
    """The U drawn as a foot and two arms, two of the three inside out, has one joint and the mass of the U."""
    boxes = {
        "foot": ((0.0, 0.0, 0.0), (1.2, DEPTH, 0.3)),
        "left": ((0.0, 0.0, 0.3), (0.3, DEPTH, 0.6)),
        "right": ((0.9, 0.0, 0.3), (1.2, DEPTH, 0.6)),
    }
    turned = {"foot": cad_files.QUADS}
    drawn = [
        (name, cad_files.corners(*ends), turned.get(name, [q[::-1] for q in cad_files.QUADS]), False)
        for name, ends in boxes.items()
    ]
    written(tmp_path / "a.json", FLOOR, *drawn)
    one = toml.loads(SCENE.format(more='united = [["foot", "left", "right"]]'), tmp_path / "a.toml")
    found = assemble(one)
    assert found.names == ("m.floor", "m.foot") and len(found.joints) == 1
    assert found.mass[1] == pytest.approx(2000.0 * AREA * DEPTH, rel=1e-9)


def test_a_surface_with_one_side_only_is_still_refused(tmp_path):
    """A hole, and an edge of three faces: no change of winding repairs these."""
    points, faces = prism()
    for more in (faces[1:], [*faces, (0, 1, 9)]):
        written(tmp_path / "a.json", FLOOR, ("u", points, more, False))
        with pytest.raises(dembrick.ScenarioError, match="not closed|the same way"):
            cad_file.read(str(tmp_path / "a.json"), 1.0)
