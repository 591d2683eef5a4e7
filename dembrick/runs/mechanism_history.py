"""The structure before a run, and the mechanism of limit analysis, as histories, so that the same code draws them.

A mechanism has two frames: the structure at rest, and moved by its velocities for a time in which the farthest corner
moves a little. Rows and joint forces of both are those of the limit state; for a tilting table, at its angle. A
structure before a run has one frame and no force.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

import numpy as np

from dembrick import history
from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by
from dembrick.runs.in_memory import temporary
from dembrick.scenario import toml as scenarios
from dembrick.simulation.channels import FRAMES, JOINT_CHANNELS, ROWS, recorded
from dembrick.simulation.joint_laws import bonded_at_start
from dembrick.simulation.statics import ties
from dembrick.simulation.statics.recorder import reactions
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.tilting_table import forces_on_table

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control
    from dembrick.scenario.model import Scenario

SEEN = 0.12  # of the size of the largest moving block: how far the farthest corner moves


def write(result, path: str | os.PathLike, force: bool = False) -> str:
    """Write a history of the mechanism of a `LimitResult`; return its path."""
    from dembrick.simulation.limit_analysis.analysis import dead_wrench, live_wrench

    if result.limit.mechanism is None:
        raise ScenarioError("nothing moves, so there is no mechanism to draw")
    assembly, channels = result.assembly, ("joints", "frames")
    displacement, orientation = _moved(assembly, result.limit.mechanism.velocity)
    joint = np.zeros((2, len(assembly.joints), len(JOINT_CHANNELS)))
    joint[:, :, :6] = result.limit.resultants
    rows = _rows(assembly, result.scenario.control, 2)
    rows |= {"load": np.full(2, result.load_factor), "lower": np.full(2, result.lower), "joint": joint}
    rows |= {"upper": np.full(2, result.upper)}
    rows["actuator_force"] = np.full((2, 1), result.load_factor) * assembly.actuators.weight
    if assembly.fixed.any() or assembly.held.any():
        state = initial_state(assembly)
        state.joints.resultant[:] = joint[0]
        if state.ties is not None:
            state.ties.tension[:] = result.limit.forces.tension
            ties.act(state)
        _guide(state, dead_wrench(assembly) + result.load_factor * live_wrench(assembly))
        rows["reaction"] = np.tile(reactions(state), (2, 1, 1))
    if len(assembly.ties):
        rows["tension"] = np.tile(result.limit.forces.tension, (2, 1))
    if assembly.control_points.names:
        rows["control_point"][1] = assembly.control_points.displacement(displacement, rotation_matrix(orientation))
    if result.scenario.control.tilt_axis is not None:
        rows = forces_on_table(rows)
    with history.HistoryWriter(
        path, scenarios.text_of(result.scenario), assembly, {}, force, channels=channels,
        control=result.scenario.control, inputs=history.inputs_of(result.scenario),
    ) as writer:  # fmt: skip
        writer.append(rows)
        moved = np.stack([np.zeros_like(displacement), displacement])
        turned = np.stack([assembly.orientation, orientation])
        writer.append_frames(**_frames(assembly, result.scenario.control, moved, turned))
        writer.finish(result.status, result.as_dict())
    return os.fspath(path)


def _guide(state: State, loads: np.ndarray) -> None:
    """Set the guide forces of a ``state`` to what balances ``loads`` (n, 6), joints and ties in held directions."""
    from dembrick.kernels.statics.record import write_reactions

    blocks, borne = state.blocks, np.zeros_like(loads)
    write_reactions(state.joints, np.arange(len(loads)), borne)  # of every block on the others
    if state.ties is not None:
        borne -= ties.on_blocks(state)
    blocks.guide[:] = np.where(blocks.held, (borne - loads)[blocks.guided], 0.0)


def before_a_run(scenario: Scenario, assembly: Assembly) -> AbstractContextManager[history.History]:
    """Context with a temporary history of one frame: the structure as the scenario describes it, at rest."""

    def start(path: str) -> None:
        text = scenarios.text_of(scenario)
        with history.HistoryWriter(path, text, assembly, {}, channels=("frames",), control=scenario.control) as writer:
            rows = _rows(assembly, scenario.control, 1)
            if len(assembly.ties):
                rows["tension"] = assembly.ties.prestress[None]
            writer.append(rows)
            still = np.zeros((1, len(assembly.names), 3))
            writer.append_frames(**_frames(assembly, scenario.control, still, assembly.orientation[None]))
            writer.finish("start", {"title": scenario.title, "moving_supports": _moving_supports(scenario, assembly)})

    return temporary(start, "start.h5")


def _rows(assembly: Assembly, control: Control, count: int) -> dict[str, np.ndarray]:
    """``count`` rows in which nothing has happened yet, without joint forces and energies."""
    fields = [field for field in recorded(assembly, ("frames",), control) if field.grows_by == ROWS]
    rows = {field.name: np.zeros((count, *field.shape)) for field in fields}
    return rows | {"time": np.arange(float(count))}


def _moving_supports(scenario: Scenario, assembly: Assembly) -> dict[str, list[float]]:
    """How far (m) each support that settles will be moved, by its name; zeros if it only turns."""
    return {
        assembly.names[i]: list(path.displacement or (0.0, 0.0, 0.0))
        for path in scenario.control.support_paths
        for name in path.supports
        for i in scenario.members(name)
    }


def _frames(assembly: Assembly, control: Control, displacement: np.ndarray, orientation: np.ndarray) -> dict:
    """Frames (f, ...) of these motions: all bonds are intact, as in limit analysis, and other channels are zero."""
    count = len(displacement)
    fields = [field for field in recorded(assembly, ("frames",), control) if field.grows_by == FRAMES]
    frames = {field.name: np.zeros((count, *field.shape)) for field in fields if field.fill is None}
    if "bond" in frames:
        frames["bond"][:] = bonded_at_start(assembly.joints.law)
    return frames | {"time": np.arange(float(count)), "displacement": displacement, "orientation": orientation}


def picture(result, path: str | os.PathLike, **look) -> str:
    """Write a PNG of the mechanism; ``look`` as for `render.picture`; return its path."""
    from dembrick.views import render

    with temporary(lambda file: write(result, file)) as found:
        return render.picture(found, path, **({"magnification": 1.0} | look))


def _moved(assembly: Assembly, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (n, 3) and orientation (n, 4) of every block, scaled so that the motion is visible."""
    size, fastest = 0.0, 0.0
    for shape, rotation, own in zip(assembly.shapes, assembly.rotation, velocity, strict=True):
        if own.any():
            arm = (shape.vertices - shape.centroid) @ rotation.T
            size = max(size, float(np.ptp(arm, axis=0).max()))
            fastest = max(fastest, float(np.linalg.norm(own[:3] + np.cross(own[3:], arm), axis=1).max()))
    moved = velocity * (SEEN * size / fastest)
    return moved[:, :3], turned_by(moved[:, 3:], assembly.orientation)
