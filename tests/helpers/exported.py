"""Finished histories for tests of the export, and VTK's own reader to read the exported files."""

import os

import numpy as np
import pytest

from helpers import history_cases as cases

N_FRAME = 7
EVERYTHING = ("joints", "energy", "frames", "velocity", "contacts")
THREE = ["out.vtkhdf", "out_joints.vtkhdf", "out_contacts.vtkhdf"]


def make(folder, assembly=None, n_frame=N_FRAME, n_row=61, channels=EVERYTHING):
    """A finished history with a frame at every tenth row."""
    assembly = assembly or cases.mixed_assembly()
    n_block, n_joint, n_jack = len(assembly.names), len(assembly.joints), len(assembly.actuators.names)
    n_point = sum(len(p.area) for p in assembly.contact_points if p is not None)
    needs = {"velocity": "velocity", "spin": "velocity", "contact_force": "contacts"}
    moving = cases.motion(0, n_frame, n_block, n_point).items()
    moving = {name: values for name, values in moving if needs[name] in channels}
    rows, poses = cases.record(0, n_row, n_joint, n_jack), cases.frames(0, n_frame, n_block) if n_frame else None
    asked = {"channels": channels, "control": cases.CONSTANT_RATE}
    return cases.written(folder / "run.h5", rows, poses, assembly, moving=moving, **asked)


def vtk_steps(path):
    """(times, PolyData of every step) as vtkHDFReader reads them; arrays of VTK as numpy arrays."""
    reader_module = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = reader_module.vtkHDFReader()
    assert reader.CanReadFile(os.fspath(path))
    reader.SetFileName(os.fspath(path))
    reader.UpdateInformation()
    axis, information = reader.GetExecutive().TIME_STEPS(), reader.GetOutputInformation(0)
    times = [information.Get(axis, i) for i in range(information.Length(axis))]
    n_step = reader.GetNumberOfSteps()
    assert len(times) == n_step or n_step == 1  # VTK gives a single step no time
    steps = []
    for k in range(n_step):
        reader.SetStep(k)
        reader.Update()
        output = reader.GetOutputDataObject(0)
        polygons = output.GetPolys()
        corners = vtk_to_numpy(polygons.GetConnectivityArray()).tolist()
        offsets = vtk_to_numpy(polygons.GetOffsetsArray()).tolist()
        step = {
            "points": vtk_to_numpy(output.GetPoints().GetData()).copy(),
            "faces": [tuple(corners[a:b]) for a, b in zip(offsets, offsets[1:], strict=False)],
            "vertices": [(i,) for i in vtk_to_numpy(output.GetVerts().GetConnectivityArray()).tolist()],
        }
        for key, data in (("cells", output.GetCellData()), ("at_points", output.GetPointData())):
            arrays = [data.GetArray(i) for i in range(data.GetNumberOfArrays())]
            step[key] = {array.GetName(): vtk_to_numpy(array).copy() for array in arrays}
        steps.append(step)
    return times, steps


def real_time(folder):
    """A finished history of a run in real time whose frames have none, one, two or three new contacts."""
    assembly = cases.assembly()
    arms = np.tile(assembly.joints[0].polygon, (N_FRAME, 1, 1))
    arms[2:, 1] += [-0.02, 0.03]
    moving = cases.motion(0, N_FRAME) | {"joint_shift": np.zeros((N_FRAME, 1, 2)), "contact_arm": arms}
    moving |= {"contact_area": np.tile(assembly.contact_points.area[:4], (N_FRAME, 1))}
    moving |= {"new_contacts": cases.new_contacts(0, N_FRAME)}
    rows, poses, asked = cases.moving_record(0, N_FRAME), cases.frames(0, N_FRAME), {"channels": EVERYTHING}
    return cases.written(folder / "run.h5", rows, poses, assembly, moving=moving, control=cases.MOTION, **asked)
