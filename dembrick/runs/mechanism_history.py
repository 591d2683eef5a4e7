"""The mechanism of limit analysis as a history of two frames, so that everything that draws a history draws it.

The first frame is the structure at rest, the second the mechanism, its velocities times a time in which the farthest
corner moves a little. Rows and joint forces are those of the limit state in both.
"""

from __future__ import annotations

import os
import tempfile
from typing import TYPE_CHECKING

import numpy as np

from dembrick import history
from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import quaternion_product, rotation_matrix
from dembrick.scenario import toml as scenarios
from dembrick.simulation.channels import JOINT_CHANNELS

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

SEEN = 0.12  # of the largest block: how far the farthest corner moves


def write(result, mechanism, resultants: np.ndarray, path: str | os.PathLike, force: bool = False) -> str:
    """Write a history of the mechanism of a `LimitResult`; its path."""
    if mechanism is None:
        raise ScenarioError("nothing moves, so there is no mechanism to draw")
    assembly, channels = result.assembly, ("joints", "frames")
    displacement, turn = _moved(assembly, mechanism.velocity)
    text = scenarios.text_of(result.scenario)
    actuators = len(assembly.actuators.names)
    joint = np.zeros((2, len(assembly.joints), len(JOINT_CHANNELS)))
    joint[:, :, :6] = resultants
    rows = {
        "time": np.array([0.0, 1.0]),
        "load": np.full(2, result.load_factor),
        "displacement": np.zeros(2),
        "unbalanced": np.zeros(2),
        "lower": np.full(2, result.lower),
        "upper": np.full(2, result.upper),
        "actuator_displacement": np.zeros((2, actuators)),
        "actuator_force": np.full((2, actuators), result.load_factor) * assembly.actuators.weight,
        "joint": joint,
        "control_point": np.zeros((2, len(assembly.control_points.names), 3)),
    }
    if assembly.control_points.names:
        rows["control_point"][1] = assembly.control_points.displacement(
            displacement, rotation_matrix(quaternion_product(turn, assembly.orientation))
        )
    with history.HistoryWriter(
        path, text, assembly, {}, force, channels=channels, control=result.scenario.control
    ) as writer:
        writer.append(rows)
        writer.append_frames(
            np.array([0.0, 1.0]),
            np.stack([np.zeros_like(displacement), displacement]),
            np.stack([assembly.orientation, quaternion_product(turn, assembly.orientation)]),
        )
        writer.finish(result.status, result.as_dict())
    return os.fspath(path)


def picture(result, mechanism, resultants: np.ndarray, path: str | os.PathLike, **look) -> str:
    """Write a PNG of the mechanism; ``look`` as for `render.picture`; its path."""
    from dembrick.views import render

    with tempfile.TemporaryDirectory(prefix="dembrick-") as folder:
        file = write(result, mechanism, resultants, os.path.join(folder, "mechanism.h5"))
        with history.read(file) as found:
            return render.picture(found, path, **({"magnification": 1.0} | look))


def _moved(assembly: Assembly, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (n, 3) and quaternion of the turn (n, 4) of every block, to the scale that is seen."""
    size, fastest = 0.0, 0.0
    for shape, rotation, own in zip(assembly.shapes, assembly.rotation, velocity, strict=True):
        if own.any():
            arm = (shape.vertices - shape.centroid) @ rotation.T
            size = max(size, float(np.ptp(arm, axis=0).max()))
            fastest = max(fastest, float(np.linalg.norm(own[:3] + np.cross(own[3:], arm), axis=1).max()))
    moved = velocity * (SEEN * size / fastest)
    angle = np.linalg.norm(moved[:, 3:], axis=1)[:, None]
    return moved[:, :3], np.concatenate(
        [np.cos(0.5 * angle), 0.5 * np.sinc(0.5 * angle / np.pi) * moved[:, 3:]], axis=1
    )
