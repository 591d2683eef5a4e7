"""Views of a joint of several polygons in one plane, as between blocks of several parts.

A history stores the pieces of a joint as one closed chain of corners; views show each piece as a separate polygon.
"""

from types import SimpleNamespace

import numpy as np
import pytest

import dembrick
from dembrick import theory
from dembrick.geometry import polygons
from dembrick.history import read
from dembrick.views import export, plot
from dembrick.views.motion.hinges import closed_edges
from dembrick.views.motion.joints import JointMotion
from dembrick.views.plot import subject
from dembrick.views.plot.joint_plane import joint_plane
from helpers.exported import EVERYTHING, vtk_steps
from helpers.scenario_text import block, header, jack

# pieces (x0, y0, x1, y1) in m, which touch along an edge or are separate
FEET = {
    "L": [(-0.3, -0.2, 0.3, 0.2), (0.3, 0.0, 0.7, 0.2)],
    "apart": [(-0.3, -0.2, 0.0, 0.2), (0.4, -0.1, 0.7, 0.2)],
    "U": [(-0.3, -0.2, 0.4, 0.0), (-0.3, 0.0, -0.1, 0.3), (0.2, 0.0, 0.4, 0.5)],
}


def shared(pieces):
    return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in pieces)


@pytest.fixture(params=list(FEET))
def foot(request):
    return FEET[request.param]


@pytest.fixture
def pushed(tmp_path, foot):
    """A function that pushes a block with such a foot, beside a plain block on a floor, until it slides."""

    def run(formulation="convex"):
        parts = ", ".join(
            f"{{box = [{x1 - x0}, {y1 - y0}, 0.5], position = [{(x0 + x1) / 2}, {(y0 + y1) / 2}, 0.25]}}"
            for x0, y0, x1, y1 in foot
        )
        foot_block = f'[[blocks]]\nname = "foot"\nmaterial = "stone"\nparts = [{parts}]\n'
        text = header(formulation) + block("floor", (0.0, 0.0, -0.5), (10.0, 10.0, 1.0), "fixed = true")
        text += block("plain", (3.0, 0.0, 0.25), (0.5, 0.4, 0.5)) + foot_block
        text += jack("foot", (-0.2, -0.15, 0.02), (0.6, 0.8, 0.0)) + '[control]\nkind = "yield"\n'
        text += f"[output]\nchannels = {list(EVERYTHING)}\n".replace("'", '"')
        dembrick.simulate(dembrick.loads(text), tmp_path / "run.h5")
        return read(tmp_path / "run.h5")

    return run


def number_of(found):
    """Number of the joint under the foot."""
    (number,) = (j for j, joint in enumerate(found.joints) if "foot" in found.block_names[joint["block_b"]])
    return number


def area_of(points, faces):
    """Sum of the areas of faces, from their vector areas (m2)."""
    total = 0.0
    for face in faces:
        own = points[list(face)] - points[face[0]]
        total += 0.5 * np.linalg.norm(np.cross(own, np.roll(own, -1, axis=0)).sum(axis=0))
    return total


def test_every_piece_is_a_cell_with_what_its_joint_carries(tmp_path, pushed, foot):
    with pushed() as found:
        number = number_of(found)
        _, steps = vtk_steps(export.to_vtkhdf(found, tmp_path / "out.vtkhdf", only=["joints"])[0])
        for step in steps:
            own = np.flatnonzero(step["cells"]["joint"] == number)
            assert len(own) == len(foot) and len(step["faces"]) == len(foot) + 1
            faces = [step["faces"][i] for i in own]
            assert area_of(step["points"], faces) == pytest.approx(shared(foot), rel=1e-9)
            assert all(len(set(face)) == 4 for face in faces)
            for name in ("N", "V", "M_T", "utilisation", "state", "block_a", "block_b", "open_share"):
                assert len(set(step["cells"][name][own].tolist())) == 1
            assert step["at_points"]["opening"].shape == (4 * (len(foot) + 1),)
        motion = JointMotion(found).at([found.n_frames - 1])
        np.testing.assert_allclose(step["cells"]["N"][own], motion.resultants[0, number, 0], rtol=1e-6)


def test_programs_find_the_area_of_a_joint_in_its_cells(tmp_path, pushed, foot, drawing):
    """The cells have the area of the joint in pyvista, from both formats, and in a picture seen from above."""
    pyvista = pytest.importorskip("pyvista")
    with pushed() as found:
        number = number_of(found)
        reader = pyvista.get_reader(export.to_vtkhdf(found, tmp_path / "out.vtkhdf", only=["joints"])[0])
        meshes = [reader.read()]
        if pytest.importorskip("meshio"):
            meshes.append(pyvista.read(export.to_pvd(found, tmp_path / "out.pvd", only=["joints"])[1]))
    for mesh in meshes:
        own = mesh.extract_cells(np.flatnonzero(mesh.cell_data["joint"] == number))
        assert own.compute_cell_sizes()["Area"].sum() == pytest.approx(shared(foot), rel=1e-6)
        plotter = pyvista.Plotter(off_screen=True, window_size=(400, 400))
        plotter.add_mesh(own, color="black", lighting=False)
        plotter.view_xy()
        plotter.enable_parallel_projection()
        picture = np.asarray(plotter.screenshot(return_img=True))[..., 0]
        plotter.close()
        low, high = (np.array([getattr(np, f"{end}imum").reduce([one[k : k + 2] for one in foot]) for k in (0, 2)])
                     for end in ("min", "max"))  # fmt: skip
        rows, columns = np.nonzero(picture < 128)
        box = (np.ptp(rows) + 1) * (np.ptp(columns) + 1)
        assert len(rows) / box == pytest.approx(shared(foot) / np.prod(high[1] - low[0]), rel=0.02)


@pytest.mark.parametrize("formulation", ["convex", "concave", "distributed"])
def test_pieces_of_a_joint_are_taken_apart_again(pushed, foot, formulation):
    with pushed(formulation) as found:
        joint = found.joints[number_of(found)]
        own = [
            joint["polygon"][corners] @ joint["axes"][:2] + joint["origin"]
            for corners in polygons.pieces(joint["polygon"])
        ]
        boxes = sorted(tuple(np.round([*one.min(axis=0)[:2], *one.max(axis=0)[:2]], 9) + 0.0) for one in own)
        np.testing.assert_allclose(boxes, sorted(foot), atol=1e-12)
        assert sum(map(polygons.area, subject.outlines(joint))) == pytest.approx(joint["area"], rel=1e-12)


def test_the_plane_of_a_joint_shows_its_pieces(pushed, foot):
    """Every piece contains points of the grid, none lie elsewhere, and friction is at its limit at all of them."""
    with pushed() as found:
        number = number_of(found)
        joint = found.joints[number]
        places = JointMotion(found).grid(number) @ joint["axes"][:2] + joint["origin"]
        inside = np.array(
            [
                (places[:, :2] >= [x0 - 1e-9, y0 - 1e-9]).all(axis=1)
                & (places[:, :2] <= [x1 + 1e-9, y1 + 1e-9]).all(axis=1)
                for x0, y0, x1, y1 in foot
            ]
        )
        assert inside.any(axis=0).all() and inside.any(axis=1).all()
        stage = joint_plane(found, number)[-1]
        assert len(stage.points) and stage.friction is not None
        assert (np.linalg.norm(stage.friction, axis=1) > 0.99 * stage.limit).all()
        (axes, *_) = plot.joint_stages([found], joint=number).axes
        areas = [polygons.area(patch.get_path().vertices[:-1]) for patch in axes.patches]
        assert len(areas) == len(foot) and sum(areas) == pytest.approx(joint["area"], rel=1e-9)


def test_utilisation_and_open_share_are_those_of_all_pieces(pushed, foot):
    with pushed() as found:
        number, motion = number_of(found), JointMotion(found)
        joint, now = found.joints[number], motion.at([found.n_frames - 1])
        N, V_1, V_2, M_T = now.resultants[0, number, :4]
        parts = [joint["polygon"][corners] for corners in polygons.pieces(joint["polygon"])]
        law = theory.convex(parts, joint["friction"], N)
        used = 1.0 / theory.limit_load(law, (V_1, V_2, M_T)).V
        assert now.friction_utilisation[0, number] == pytest.approx(used, rel=1e-3)
        # a plane that opens beyond a line, against a count of cells in a fine grid
        relative = now.relative[0]
        for slope in ((1.0, 0.3), (-0.4, 1.0), (0.0, -1.0)):
            plane = relative.plane.copy()
            plane[number] = [0.02, *slope]
            tilted = type(relative)(relative.joints, relative.shift, relative.turn, plane, relative.small)
            places = motion.grid(number, along=600)
            share = (0.02 + places @ slope > 0.0).mean()
            assert tilted.open_share[number] == pytest.approx(share, abs=4e-3)


def test_a_hinge_is_half_way_along_the_edge_about_which_the_pieces_turn(pushed, foot, monkeypatch):
    """Rotations about the edges of least y and about those of greatest y give the middle of these edges."""
    with pushed() as found:
        number, joints = number_of(found), JointMotion(found)
        joint = found.joints[number]
        corners = np.array([corner for x0, y0, x1, y1 in foot for corner in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))])
        for sense in (1.0, -1.0):
            height = sense * corners[:, 1]
            own = corners[height < height.min() + 1e-9]
            middle = 0.5 * (own.min(axis=0) + own.max(axis=0))
            plane = np.tile([0.0, 0.0, 0.0], (1, joints.n_joint, 1))
            plane[0, number, 1:] = 0.01 * sense * joint["axes"][:2, 1]
            relative = joints.at([0]).relative
            turned = type(relative)(joints, relative.shift, relative.turn, plane, relative.small)
            monkeypatch.setattr(joints, "at", lambda frames, turned=turned: SimpleNamespace(relative=turned))
            place = closed_edges(joints, 0)[number] @ joint["axes"][:2] + joint["origin"]
            monkeypatch.undo()
            np.testing.assert_allclose(place[:2], middle, atol=1e-9)
