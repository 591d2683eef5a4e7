"""Solids cut into convex parts: nothing is lost or counted twice, and the number of parts is the least possible."""

import math

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.geometry import convex_parts as cutting
from dembrick.geometry.convex_parts import convex_parts
from dembrick.scenario import toml
from helpers.scenario_text import block, header

SHAPES = {  # outline, number of parts
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 3), (0, 3)], 2),
    "T": ([(0, 0), (1, 0), (1, 2), (2, 2), (2, 3), (-1, 3), (-1, 2), (0, 2)], 3),
    "cross": ([(1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2), (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)], 3),
    "comb": ([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)], 4),
    "star": ([((1 + 0.5 * (k % 2)) * math.cos(k * math.pi / 5), (1 + 0.5 * (k % 2)) * math.sin(k * math.pi / 5))
              for k in range(10)], 6),
}  # fmt: skip
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
TURN *= np.linalg.det(TURN)


def extruded(outline, height):
    n = len(outline)
    points = np.array([(x, y, z) for z in (0.0, height) for x, y in outline], float)
    faces = [tuple(range(n))[::-1], tuple(range(n, 2 * n))]
    return points, faces + [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)]


def moments(outline):
    """Area, first moments and polar moment about the origin, by Green's theorem."""
    p = np.array(outline, float)
    q = np.roll(p, -1, axis=0)
    twice = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    polar = (p**2 + p * q + q**2).sum(axis=1)
    return twice.sum() / 2.0, (twice[:, None] * (p + q)).sum(axis=0) / 6.0, (twice * polar).sum() / 12.0


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_parts_make_up_the_solid(name, turned):
    """Volume, centroid and axial moment of inertia, which overlapping or misplaced parts would change."""
    outline, count = SHAPES[name]
    points, faces = extruded(outline, 1.3)
    turn = TURN if turned else np.eye(3)
    parts = convex_parts(points @ turn.T + 0.37, faces)
    area, first, polar = moments(outline)
    volumes = np.array([part.volume for part in parts])
    places = (np.array([part.centroid for part in parts]) - 0.37) @ turn
    assert len(parts) == count
    assert volumes.sum() == pytest.approx(1.3 * area, rel=1e-12)
    assert volumes @ places / volumes.sum() == pytest.approx([*(first / area), 0.65], abs=1e-12)
    own = sum((turn.T @ part.inertia @ turn)[2, 2] for part in parts)
    assert own + volumes @ (places[:, :2] ** 2).sum(axis=1) == pytest.approx(1.3 * polar, rel=1e-12)


def test_triangles_are_cut_as_the_faces_that_they_make_up():
    points, faces = extruded(SHAPES["cross"][0], 1.0)
    fans = [(face[0], face[i], face[i + 1]) for face in faces for i in range(1, len(face) - 1) if len(face) == 4]
    caps = [
        (0, 1, 11),
        (1, 2, 11),
        (2, 10, 11),
        (2, 8, 10),
        (2, 5, 8),
        (2, 3, 5),
        (3, 4, 5),
        (5, 6, 8),
        (6, 7, 8),
        (8, 9, 10),
    ]
    caps = caps + [tuple(i + 12 for i in face) for face in caps]
    turned = [face[::-1] for face in caps[:10]] + caps[10:]
    parts = convex_parts(points, fans + turned)
    assert len(parts) == 3 and sum(part.volume for part in parts) == pytest.approx(5.0, rel=1e-12)


def test_a_hole_goes_through():
    """A square ring with quadrilateral faces is cut into four parts."""
    points, faces = [], []
    for z in (0.0, 1.0):
        for half in (3.0, 1.0):
            points += [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, 8 + j, 8 + i), (4 + j, 4 + i, 12 + i, 12 + j)]
        faces += [(j, i, 4 + i, 4 + j), (8 + i, 8 + j, 12 + j, 12 + i)]
    parts = convex_parts(np.array(points), faces)
    assert len(parts) == 4 and sum(part.volume for part in parts) == pytest.approx(32.0, rel=1e-12)


def test_a_solid_of_very_many_parts_is_refused(monkeypatch):
    monkeypatch.setattr(cutting, "MOST_PARTS", 3)
    with pytest.raises(ScenarioError, match="convex parts: it has curved or very many faces"):
        convex_parts(*extruded(SHAPES["comb"][0], 1.0))


def test_a_block_out_of_a_mesh_is_that_of_its_parts(tmp_path):
    """An L as a mesh has the load factor, mass and inertia of the same L as two boxes."""
    import dembrick

    points, faces = extruded([(0, 0), (0.3, 0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.2), (0, 0.2)], 0.1)
    lines = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {' '.join(str(i + 1) for i in face)}" for face in faces]
    (tmp_path / "l.obj").write_text("\n".join(lines))
    floor = header(friction=0.5, normal_stiffness=1e10) + '[control]\nkind = "pushover"\ndirection = [0, 1, 0]\n'
    floor += block("floor", (0, 0, -0.1), (2, 2, 0.2), "fixed = true")
    floor += '[[blocks]]\nname = "foot"\nmaterial = "stone"\n'
    mesh = floor + f'mesh = {{file = "{tmp_path / "l.obj"}", unit = "m"}}\n'
    boxes = (
        floor
        + """
[[blocks.parts]]
box = [0.3, 0.1, 0.1]
position = [0.15, 0.05, 0.05]
[[blocks.parts]]
box = [0.1, 0.1, 0.1]
position = [0.05, 0.15, 0.05]
"""
    )
    found = [dembrick.simulate(toml.loads(text), record=False) for text in (mesh, boxes)]
    assert found[0].collapse["load_factor"] == pytest.approx(found[1].collapse["load_factor"], rel=1e-6)
    assert found[0].assembly.mass[1] == pytest.approx(8.0, rel=1e-12)
    assert found[0].assembly.inertia[1] == pytest.approx(found[1].assembly.inertia[1], abs=1e-12)
