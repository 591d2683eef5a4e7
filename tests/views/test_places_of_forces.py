"""Places of drawn and exported forces after large rotations: at the toe of a rocking block, in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick import history
from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.views import export
from dembrick.views.motion.blocks import Poses
from dembrick.views.motion.hinges import hinges
from dembrick.views.motion.joints import JointMotion
from dembrick.views.motion.table import joint_table
from dembrick.views.render.force_arrows import DrawnForces
from helpers import history_cases as cases
from helpers.exported import vtk_steps
from helpers.scenario_text import block, header, jack

TOE = 0.15  # m: half the width of the joint
N = 400.0


def rocked(path, angle, across, host):
    """A history of two blocks, the upper one turned by ``angle`` about its toe, where N and ``across`` times N act on
    it; the joint has no contact points, and its polygon is fixed to the block ``host``."""
    blocks, side = cases.assembly(), math.copysign(TOE, angle)
    blocks.joints = JointTable.of((replace(cases.joint(0, 1, "convex"), host=host),))
    blocks.contact_points = PointTable.of((None,))
    s, c = math.sin(angle), math.cos(angle)
    centroid = np.array([side - side * c + 0.05 * s, 0.0, side * s + 0.05 * c])
    displacement = np.zeros((2, 2, 3))
    displacement[1, 1] = centroid - [0.0, 0.0, 0.05]
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (2, 2, 1))
    orientation[1, 1] = [math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]
    rows = cases.moving_record(0, 2)
    # t1 of the host block, projected on the face of the other block, which gives the normal
    t1, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    force, origin = np.array([across * N, 0.0, N]), np.array([side * (1.0 - c), 0.0, side * s])
    if host == 0:
        t1, normal, origin = np.array([c, 0.0, -s]), np.array([s, 0.0, c]), np.zeros(3)
    toe = np.array([side, 0.0, 0.0])
    moment = np.cross(toe - origin, force) @ np.cross(normal, t1)  # on b; the record has the moments of b on a
    rows["joint"][1] = [[force @ normal, -force @ t1, 0.0, 0.0, 0.0, -moment, 0.0]]
    poses = rows["time"], displacement, orientation
    moving = {"joint_shift": np.zeros((2, 1, 2)), "contact_arm": np.zeros((2, 0, 2)), "contact_area": np.zeros((2, 0))}
    return cases.written(path, rows, poses, blocks, control=cases.MOTION, moving=moving), toe


@pytest.mark.parametrize("host", [1, 0])
@pytest.mark.parametrize("angle, across", [(0.05, 0.0), (0.4, 0.0), (0.4, 0.3), (-0.4, 0.3)])
def test_the_force_of_a_block_that_rocks_is_at_its_toe(tmp_path, angle, across, host):
    found, toe = rocked(tmp_path / "run.h5", angle, across, host)
    with found as run:
        motion = JointMotion(run)
        _, steps = vtk_steps(export.to_vtkhdf(run, tmp_path / "out.vtkhdf", only=["contacts"])[0])
        np.testing.assert_allclose(steps[1]["points"], [toe], atol=1e-12)
        np.testing.assert_allclose(steps[1]["at_points"]["force"], [[across * N, 0.0, N]], rtol=1e-6, atol=1e-4)
        place, force = DrawnForces(run, motion, 1.0, False).of_joints(1, Poses.read(run, 1, 2))
        np.testing.assert_allclose(place, [toe], atol=1e-12)
        np.testing.assert_allclose(force, [[across * N, 0.0, N]], atol=1e-9)
        assert motion.at([1]).bending_utilisation[0, 0] == pytest.approx(1.0, rel=1e-12)
        assert hinges(run, motion, 1) == [0]
        (row,) = joint_table(run, 1)
        assert (row["e_1"], row["e_2"]) == (pytest.approx(math.copysign(TOE, angle), rel=1e-12), pytest.approx(0.0))


def test_the_toe_of_a_test_at_a_constant_rate(tmp_path):
    """A block that rocks by 0.02 rad on contact points has its pressure at b / 2 from O."""
    text = header("concave", 0.6, 1e8) + block("base", (0.0, 0.0, -0.1), (4.0, 4.0, 0.2), "fixed = true")
    text += block("b", (0.0, 0.0, 0.25), (2.0 * TOE, 0.2, 0.5)) + jack("b", (-TOE, 0.0, 0.45))
    text += '[control]\nkind = "displacement"\nrate = 1e-2\ntravel = 1e-2\n'
    simulate(toml.loads(text), tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as run:
        (row,) = joint_table(run)
        assert JointMotion(run).at([-1]).bending_utilisation[0, 0] == pytest.approx(1.0, rel=1e-9)
    assert row["e_1"] == pytest.approx(TOE, rel=1e-9) and row["V_1"] > 0.3 * row["N"]
