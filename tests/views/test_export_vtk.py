"""Exports for VTK, read back by VTK and by meshio, against points computed by Rodrigues' formula."""

import os
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.views import export
from dembrick.views.export import vtkhdf
from dembrick.views.motion.blocks import mean_velocities
from dembrick.views.motion.joints import JointMotion
from helpers import history_cases as cases
from helpers.exported import N_FRAME, THREE, make, real_time, vtk_steps


def rotated(quaternion, vector):
    """v + 2 w (u x v) + 2 u x (u x v)"""
    w, u = quaternion[0], np.asarray(quaternion[1:])
    turn = np.cross(u, vector)
    return vector + 2.0 * w * turn + 2.0 * np.cross(u, turn)


def expected_points(assembly, k):
    _, displacement, orientation = cases.frames(k, k + 1, len(assembly.names))
    return np.concatenate(
        [
            assembly.position[i] + displacement[0, i] + np.array([rotated(orientation[0, i], v) for v in s.vertices])
            for i, s in enumerate(assembly.shapes)
        ]
    )


def start_points(assembly):
    return np.concatenate(
        [
            assembly.position[i] + np.array([rotated(assembly.orientation[i], v) for v in s.vertices])
            for i, s in enumerate(assembly.shapes)
        ]
    )


def test_vtk_reads_the_blocks_at_every_step(tmp_path):
    assembly = cases.mixed_assembly()
    written = export.export(make(tmp_path, assembly), tmp_path / "out.vtkhdf")
    assert [os.path.basename(name) for name in written] == THREE
    times, steps = vtk_steps(written[0])
    np.testing.assert_array_equal(times, cases.frames(0, N_FRAME)[0])
    owner = np.repeat([0, 1, 2], [6, 6, 5])
    faces = [tuple(8 * i + v for v in face) for i, s in enumerate(assembly.shapes) for face in s.faces]
    for k, step in enumerate(steps):
        _, displacement, orientation = cases.frames(k, k + 1, 3)
        displacement = displacement[0]
        points = expected_points(assembly, k)
        assert step["points"].dtype == np.float64
        # one block stands at y = 1000 m, which leaves rounding of a few units in its last place
        np.testing.assert_allclose(step["points"], points, rtol=0, atol=5e-13)
        np.testing.assert_allclose(step["points"][:16], points[:16], rtol=0, atol=1e-15)
        assert step["faces"] == faces
        np.testing.assert_array_equal(step["cells"]["block"], owner)
        np.testing.assert_allclose(step["cells"]["displacement"], displacement[owner], rtol=1e-7)
        moved = points - start_points(assembly)
        np.testing.assert_allclose(step["at_points"]["displacement"], moved, rtol=1e-6, atol=1e-12)
        moving = cases.motion(k, k + 1, 3)
        velocity, spin = moving["velocity"][0], moving["spin"][0]
        np.testing.assert_allclose(step["cells"]["velocity"], velocity[owner], rtol=1e-7)
        np.testing.assert_allclose(step["cells"]["spin"], spin[owner], rtol=1e-7)
        kinetic = []
        for i in range(3):
            body = rotated(orientation[0, i] * [1, -1, -1, -1], spin[i])
            kinetic.append(0.5 * assembly.mass[i] * velocity[i] @ velocity[i] + 0.5 * body @ assembly.inertia[i] @ body)
        np.testing.assert_allclose(step["cells"]["kinetic_energy"], np.array(kinetic)[owner], rtol=1e-6)
    assert abs(steps[-1]["points"] - steps[0]["points"]).max() > 1e-2


def test_velocities_from_frames_where_they_were_not_recorded(tmp_path):
    remarks = []
    found = make(tmp_path, channels=("frames",))
    written = export.export(found, tmp_path / "out.vtkhdf", remarks.append)
    assert len(remarks) == 2 and all("output.channels" in remark for remark in remarks)
    _, steps = vtk_steps(written[0])
    # steady translation and spin, 1e-4 s between frames
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    for step in steps:
        velocity, spin = step["cells"]["velocity"], step["cells"]["spin"]
        np.testing.assert_allclose(velocity[6], [1e-5, -20.0, 3e-2], rtol=1e-6)
        np.testing.assert_allclose(spin[6], 100.0 * axis, rtol=1e-6)
        assert not velocity[0].any() and not spin[0].any()
        np.testing.assert_allclose(
            step["cells"]["kinetic_energy"][6],
            0.5 * 9.0 * (1e-10 + 400 + 9e-4) + 0.5 * 1e4 * (0.0375 + 4 * 0.075 + 4 * 0.0975) / 9,
            rtol=1e-6,
        )


def test_vtk_reads_the_joints_at_every_step(tmp_path, monkeypatch):
    monkeypatch.setattr(vtkhdf, "_HELD", 3000)  # three frames at a time
    assembly = cases.mixed_assembly()
    found = make(tmp_path, assembly)
    written = export.to_vtkhdf(found, tmp_path / "out.vtkhdf")
    _, steps = vtk_steps(written[1])
    motion = JointMotion(found)
    for k, step in enumerate(steps):
        row = 10 * k
        assert step["faces"] == [(0, 1, 2, 3), (4, 5, 6, 7)]
        np.testing.assert_array_equal(step["cells"]["joint"], [0, 1])
        np.testing.assert_array_equal(step["cells"]["block_a"], [0, 1])
        np.testing.assert_array_equal(step["cells"]["block_b"], [1, 2])
        np.testing.assert_allclose(step["cells"]["N"], [row, row + 10.0], rtol=1e-7)
        np.testing.assert_allclose(step["cells"]["M_T"], [row + 0.3, row + 10.3], rtol=1e-7)
        np.testing.assert_allclose(
            step["cells"]["V"], np.hypot([row + 0.1, row + 10.1], [row + 0.2, row + 10.2]), rtol=1e-7
        )
        _, displacement, orientation = cases.frames(k, k + 1, 3)
        for own, joint in zip((slice(0, 4), slice(4, 8)), assembly.joints, strict=True):
            host = joint.host
            conjugate = assembly.orientation[host] * [1, -1, -1, -1]
            start = joint.origin + np.column_stack([joint.polygon, np.zeros(4)])
            body = [rotated(conjugate, p - assembly.position[host]) for p in start]
            world = assembly.position[host] + displacement[0, host] + [rotated(orientation[0, host], p) for p in body]
            np.testing.assert_allclose(step["points"][own], world, rtol=0, atol=5e-13)
        relative = motion.at([k]).relative[0]
        np.testing.assert_allclose(step["at_points"]["opening"], relative.opening.ravel(), rtol=1e-6, atol=1e-12)
        np.testing.assert_array_equal(step["cells"]["state"], relative.state)
        np.testing.assert_allclose(step["cells"]["open_share"], relative.open_share, rtol=1e-6)
        np.testing.assert_allclose(step["cells"]["utilisation"], motion.at([k]).utilisation[0], rtol=1e-6)
        centre = motion.torsion_centre(k)
        np.testing.assert_allclose(step["cells"]["torsion_centre_joint"], centre, rtol=1e-6)
        # block a of the first joint does not move, and its axes are the world axes
        np.testing.assert_allclose(step["cells"]["torsion_centre"][0, :2], centre[0], rtol=1e-6)
    assert len({state for step in steps for state in step["cells"]["state"].tolist()}) > 1
    assert np.isfinite(steps[3]["cells"]["torsion_centre"]).any()


def test_a_joint_that_is_open_has_no_torsion_centre(tmp_path):
    """A block turning about the vertical through O has its torsion centre there in contact, and none 1 mm above."""
    half = 0.01 * np.arange(6)
    shift, turn = np.zeros((6, 2, 3)), np.zeros((6, 2, 4))
    shift[3:, 1, 2] = 1e-3
    turn[:, 0, 0], turn[:, 1, 0], turn[:, 1, 3] = 1.0, np.cos(half), np.sin(half)
    found = cases.written(tmp_path / "run.h5", cases.record(0, 6), (1e-4 * np.arange(6), shift, turn))
    written = export.to_vtkhdf(found, tmp_path / "out.vtkhdf", only=["joints"])
    _, steps = vtk_steps(written[0])
    centres = [step["cells"]["torsion_centre_joint"][0] for step in steps]
    assert [int(step["cells"]["state"][0]) for step in steps] == [0, 0, 0, 2, 2, 2]
    assert np.isnan([centres[0], *centres[3:]]).all()
    np.testing.assert_allclose(centres[1:3], 0.0, atol=1e-9)


def test_vtk_reads_the_contact_forces_at_every_step(tmp_path):
    assembly = cases.mixed_assembly()
    found = make(tmp_path, assembly)
    written = export.to_vtkhdf(found, tmp_path / "out.vtkhdf")
    _, steps = vtk_steps(written[2])
    for k, step in enumerate(steps):
        force = cases.motion(k, k + 1)["contact_force"][0]
        np.testing.assert_allclose(step["at_points"]["force"][:4], force, rtol=1e-6)
        np.testing.assert_allclose(step["at_points"]["normal_force"], [*force[:, 2], 10.0 * k + 10.0], rtol=1e-6)
        np.testing.assert_array_equal(step["cells"]["joint"], [0, 0, 0, 0, 1])
        _, displacement, orientation = cases.frames(k, k + 1, 3)
        arms = np.column_stack([assembly.joints[0].polygon, np.full(4, -0.05)])
        world = [0.0, 0.0, 0.05] + displacement[0, 1] + [rotated(orientation[0, 1], p) for p in arms]
        np.testing.assert_allclose(step["points"][:4], world, rtol=0, atol=1e-15)
        # resultant of the convex joint along the normal of block 1 and the first tangent of block 2 projected on it;
        # M_1 = -y N, M_2 = x N about O on the face of block 2, to which the polygon is fixed at a constant rate
        N, V_1, V_2, _, M_1, M_2, _ = 10.0 * k + 10.0 + 0.1 * np.arange(7)

        def turned(i, vector, now=orientation[0]):
            return rotated(now[i], rotated(assembly.orientation[i] * [1, -1, -1, -1], np.array(vector)))

        normal, t1 = turned(1, [0.0, 0.0, 1.0]), turned(2, [1.0, 0.0, 0.0])
        t1 = (t1 - (t1 @ normal) * normal) / np.linalg.norm(t1 - (t1 @ normal) * normal)
        t2, host = np.cross(normal, t1), assembly.position[2]
        force, arm = -V_1 * t1 - V_2 * t2 + N * normal, turned(2, [M_2 / N, -M_1 / N, 0.0])
        at = host + displacement[0, 2] + turned(2, [0.0, 0.0, 0.1] - host) + arm
        np.testing.assert_allclose(step["points"][4], at, rtol=0, atol=1e-12)  # 1 km away
        np.testing.assert_allclose(step["at_points"]["force"][4], force, rtol=1e-5)
    assert steps[0]["vertices"] == [(0,), (1,), (2,), (3,), (4,)]


@pytest.mark.parametrize("together", [1 << 22, 20_000])
def test_vtk_reads_the_new_contacts_of_every_step(tmp_path, monkeypatch, together):
    """Every step has its number of vertices, possibly none, also when two steps are written at a time."""
    monkeypatch.setattr(vtkhdf, "_HELD", together)
    written = export.to_vtkhdf(real_time(tmp_path), tmp_path / "out.vtkhdf", only=["contacts"])
    assert [os.path.basename(name) for name in written] == ["out_contacts.vtkhdf", "out_new_contacts.vtkhdf"]
    times, steps = vtk_steps(written[1])
    assert times == cases.frames(0, N_FRAME)[0].tolist()
    for k, step in enumerate(steps):
        met = cases.new_contacts(k, k + 1)
        np.testing.assert_array_equal(step["points"], met["point"])
        assert step["vertices"] == [(i,) for i in range(k % 4)] and step["faces"] == []
        if k % 4:
            for name in ("force", "torque", "normal", "area", "slip"):
                np.testing.assert_allclose(step["at_points"][name], met[name], rtol=1e-6, err_msg=name)
            normal = (met["force"] * met["normal"]).sum(axis=1)
            np.testing.assert_allclose(step["at_points"]["normal_force"], normal, rtol=1e-6)
            assert step["at_points"]["block_b"].tolist() == [1] * (k % 4)


def test_contact_points_that_were_cut_are_shown_where_they_are(tmp_path):
    """One of the four points has moved on its block from the third frame on."""
    written = export.to_vtkhdf(real_time(tmp_path), tmp_path / "out.vtkhdf", only=["contacts"])
    for k, step in enumerate(vtk_steps(written[0])[1]):
        arms = np.column_stack([cases.assembly().joints[0].polygon, np.full(4, -0.05)])
        arms[1, :2] += np.array([-0.02, 0.03]) * (k >= 2)
        _, displacement, orientation = cases.frames(k, k + 1)
        world = [0.0, 0.0, 0.05] + displacement[0, 1] + [rotated(orientation[0, 1], arm) for arm in arms]
        np.testing.assert_allclose(step["points"], world, rtol=0, atol=1e-15)


def test_pvd_lists_the_new_contacts(tmp_path):
    pytest.importorskip("meshio")
    reader = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridReader()
    from vtkmodules.util.numpy_support import vtk_to_numpy

    written = [os.path.basename(name) for name in export.to_pvd(real_time(tmp_path), tmp_path / "out.pvd")]
    assert written[:4] == ["out.pvd", "out_joints.pvd", "out_contacts.pvd", "out_new_contacts.pvd"]
    for k in range(4):
        reader.SetFileName(str(tmp_path / "out_frames" / f"out_new_contacts_{k:05d}.vtu"))
        reader.Update()
        grid, met = reader.GetOutput(), cases.new_contacts(k, k + 1)
        assert grid.GetNumberOfCells() == grid.GetNumberOfPoints() == k
        if k:
            np.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), met["point"])
            force = vtk_to_numpy(grid.GetPointData().GetArray("force"))
            np.testing.assert_allclose(force, met["force"], rtol=1e-6)


def test_contacts_without_recorded_forces_show_the_normal_forces(tmp_path):
    remarks = []
    found = make(tmp_path, cases.assembly(), channels=("joints", "frames", "velocity"))
    written = export.to_vtkhdf(found, tmp_path / "out.vtkhdf", remarks.append)
    assert len(remarks) == 1 and "contact forces" in remarks[0]
    _, steps = vtk_steps(written[2])
    for k, step in enumerate(steps):
        assert list(step["at_points"]) == ["normal_force"]
        np.testing.assert_allclose(step["at_points"]["normal_force"].sum(), 10.0 * k, rtol=1e-6)


def test_a_history_without_joints_or_with_one_frame(tmp_path):
    assembly = cases.many_blocks(3)
    assembly.joints, assembly.contact_points = JointTable.of(()), PointTable.of(())
    written = export.to_vtkhdf(make(tmp_path, assembly, n_frame=1), tmp_path / "out.vtkhdf")
    assert len(written) == 1
    _, steps = vtk_steps(written[0])
    assert len(steps) == 1
    np.testing.assert_allclose(steps[0]["points"], expected_points(assembly, 0), rtol=0, atol=1e-15)


def test_pvd_read_back_by_meshio(tmp_path):
    meshio = pytest.importorskip("meshio")
    assembly = cases.mixed_assembly()
    (tmp_path / "out.pvd").write_text("old")
    written = export.export(make(tmp_path, assembly), tmp_path / "out.pvd")
    entries = ElementTree.parse(written[0]).getroot().findall("Collection/DataSet")
    assert [float(e.get("timestep")) for e in entries] == cases.frames(0, N_FRAME)[0].tolist()
    for k, entry in enumerate(entries):
        mesh = meshio.read(tmp_path / entry.get("file"))
        np.testing.assert_allclose(mesh.points, expected_points(assembly, k), rtol=0, atol=5e-13)
        displacement = cases.frames(k, k + 1, 3)[1][0]
        total = 0
        for cells, block, moved in zip(
            mesh.cells, mesh.cell_data["block"], mesh.cell_data["displacement"], strict=True
        ):
            total += len(cells.data)
            np.testing.assert_array_equal(np.minimum(cells.data[:, 0] // 8, 2), block)
            np.testing.assert_allclose(moved, displacement[block], rtol=1e-7)
        assert total == 17
    # lists first, then the frames of all layers
    assert [os.path.basename(name) for name in written[:3]] == ["out.pvd", "out_joints.pvd", "out_contacts.pvd"]
    assert len(written) == 3 * (1 + N_FRAME)
    contacts = meshio.read(tmp_path / "out_frames" / f"out_contacts_{N_FRAME - 1:05d}.vtu")
    assert [(cells.type, len(cells.data)) for cells in contacts.cells] == [("vertex", 5)]
    np.testing.assert_allclose(
        contacts.point_data["force"][:4], cases.motion(N_FRAME - 1, N_FRAME)["contact_force"][0], rtol=1e-6
    )


@pytest.mark.parametrize("step", [0.5, 2.0, 3.0])
def test_a_block_that_spins_fast_has_its_spin(tmp_path, step):
    """The mean spin is right even if the block turns more than half a turn between the two frames it is taken from."""
    axis, angle = np.array([1.0, 2.0, -2.0]) / 3.0, 0.5 * step * np.arange(5.0)
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (5, 2, 1))
    orientation[:, 1] = np.column_stack([np.cos(angle), np.sin(angle)[:, None] * axis])
    poses = 0.1 * np.arange(5.0), np.zeros((5, 2, 3)), orientation
    with cases.written(tmp_path / "run.h5", cases.moving_record(0, 5), poses, control=cases.MOTION,
                       moving={"joint_shift": np.zeros((5, 1, 2))}) as run:  # fmt: skip
        _, spin = mean_velocities(run, 0, 5)
        np.testing.assert_allclose(spin[:, 1], np.tile(step / 0.1 * axis, (5, 1)), rtol=1e-12)
        assert not spin[:, 0].any()
