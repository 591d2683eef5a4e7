"""Contact forces of frames sum up to the forces of the joints at that time, also if bonds have just broken."""

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.scenario_text import block, header


@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
def test_points_sum_up_to_what_joints_carry(formulation):
    """A stack whose friction falls from 0.6 to 0.3 as it slips; the last point to break drops to its residual."""
    text = header(formulation, 0.6, 1e10, gravity=(-0.4, -1.7, -9.6), keys="residual_friction = 0.3\n")
    text += block("floor", (0.0, 0.0, -0.1), (2.0, 2.0, 0.2), "fixed = true")
    for i in range(3):
        text += block(f"b{i}", (0.01 * i, 0.02 * i, 0.05 + 0.1 * i), (0.3, 0.2, 0.1))
    text += '[control]\nkind = "pushover"\ndirection = [1.0, 0.3, 0.0]\n'
    text += '[output]\nchannels = ["joints", "frames", "contacts", "energy"]\nrows = 200\nframes = 200\n'
    found = simulate(toml.loads(text))
    axes = found.assembly.joints.axes
    joint = np.repeat(range(len(axes)), [len(points.area) for points in found.assembly.contact_points])
    rows = np.searchsorted(found.rows["time"], found.frames["time"])
    worst = 0.0
    for force, row in zip(found.frames["contact_force"], rows, strict=True):
        for j in range(len(axes)):
            own = force[joint == j].sum(axis=0) @ axes[j].T
            carried = found.rows["joint"][row, j, :3]
            worst = max(worst, float(np.abs(np.abs(own[[2, 0, 1]]) - np.abs(carried)).max()))
    assert worst < 1e-12 * 3 * 0.006 * 2000.0 * 9.81
