"""Dead loads besides gravity as forces at points of blocks: [[loads]], [[fills]] and undriven [[pressures]].

The one list is used for the dead force and torque of blocks, the load system of a tilting table, and the loads of a run
in real time.

Fills act on each upward bare face of a block, by the column above it and by horizontal pressure.

With sigma(z) = gamma (z_s - z) on a face of outward normal n, the traction is -sigma (K n_x, K n_y, n_z) per area:
sigma times the area in plan, and K sigma times the area in elevation. The traction has one direction all over a face,
so that its resultant acts at the centre of sigma, like that of a pressure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import NO_VECTORS, NOWHERE, Attached, check_inside
from dembrick.assembly.surface_pressures import FACING, FaceForce, bare_faces, face_forces, resultant
from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show
from dembrick.scenario.controls import BaseMotionControl, PushoverControl

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.model import Scenario
    from dembrick.scenario.pressures import Fill


@dataclass(frozen=True, eq=False)
class PointLoads:
    """Forces at points of blocks. Those of ``scenario.loads`` and of fills move with the blocks and keep their
    direction in the world.

    ``at``: the k points; ``force`` (k, 3): N, world; ``given`` (k,): index of the source in
    ``scenario.loads + scenario.fills``, -1 for a pressure; ``what`` (k,): its name in messages.
    """

    at: Attached
    force: np.ndarray
    given: np.ndarray
    what: tuple[str, ...]


NO_LOADS = PointLoads(NOWHERE, NO_VECTORS, np.zeros(0, np.int64), ())


def point_loads(scenario: Scenario, number: dict[str, int], bare: Assembly, moving: bool = False) -> PointLoads:
    """The dead loads of a scenario on the blocks of ``bare``, with pressures as they act at the start; ``number``:
    index of every block by name.

    Raises ScenarioError for a point outside its block, for a pressure or fill that acts on no face (with ``moving``
    blocks: a pressure that never could), and for fills on a tilting table.
    """
    rows: list[tuple[int, np.ndarray, np.ndarray, int, str]] = []
    for index, load in enumerate(scenario.loads):
        what = f"load number {index + 1}"
        for block in scenario.groups.get(load.block) or (number[load.block],):
            arm = np.zeros(3) if load.point is None else check_inside(what, load.point, bare, block)
            rows.append((block, arm, np.array(load.force, float), index, what))
    if scenario.fills and scenario.control.tilt_axis is not None:
        raise ScenarioError(
            "a tilt turns loads like gravity, but the sideways pressure of [[fills]] would not turn: use kind "
            "'pushover', or leave the fills out"
        )
    for index, fill in enumerate(scenario.fills):
        members = scenario.groups.get(fill.block) or (number[fill.block],)
        given, what = len(scenario.loads) + index, f"fill number {index + 1}"
        rows += [(force.block, force.arm, force.force, given, what) for force in fill_forces(fill, members, bare)]
    for index, pressure in enumerate(scenario.pressures, 1):
        if not pressure.actuator:
            members = scenario.groups.get(pressure.block) or (number[pressure.block],)
            rows += [
                (face.block, face.arm, face.force, -1, f"pressure number {index}")
                for face in face_forces(pressure, members, bare, moving)
            ]
    return PointLoads(
        at=Attached.to(bare, [row[0] for row in rows], [row[1] for row in rows]),
        force=np.array([row[2] for row in rows]).reshape(-1, 3),
        given=np.array([row[3] for row in rows], np.int64),
        what=tuple(row[4] for row in rows),
    )


def fill_forces(fill: Fill, members, bare: Assembly) -> list[FaceForce]:
    """The forces of a fill on the blocks ``members`` of an assembly, one for each loaded face.

    Raises ScenarioError if none of them is free and has an upward bare face below the surface.
    """
    share, found = np.array([fill.ratio, fill.ratio, 1.0]), []
    for face in bare_faces(lambda normal: bool(normal[2] > FACING), members, bare):
        force, arm = resultant(face, fill.at_height, bare)
        if force > 0.0:
            found.append(FaceForce(face.block, arm, -share * face.normal * force))
    if not found:
        raise ScenarioError(
            f"the fill on {show(fill.block)}: no free block of it has a bare upward face below surface = "
            f"{fill.surface:g} m; check block and surface"
        )
    return found


def weight_without_mass(scenario: Scenario, loads: PointLoads, bare: Assembly) -> tuple[str, ...]:
    """Remarks on fills and loads whose weight a pushover does not push, or a moving support does not shake, as they
    have no mass; empty if there are none. (A tilt refuses fills, and turns loads as it turns gravity.)"""
    control = scenario.control
    doing = {PushoverControl: "pushed", BaseMotionControl: "shaken"}.get(type(control))
    gravity = np.array(scenario.gravity, float)
    size = float(np.linalg.norm(gravity))
    if doing is None or size == 0.0:
        return ()
    down = (loads.force @ gravity) / size
    of_fills = loads.given >= len(scenario.loads)
    free = ~np.asarray(bare.fixed)[loads.at.block]
    found = []
    for table, meant in (("fills", of_fills), ("loads", ~of_fills & (loads.given >= 0))):
        weight = float(down[meant & free].sum())
        if weight > 0.0:
            share = weight / (weight + size * float(bare.mass[~np.asarray(bare.fixed)].sum()))
            found.append(
                f"the weight of [[{table}]], {weight:.6g} N or {100.0 * share:.2g} % of theirs and that of the blocks, "
                f"is not {doing}, as they have no mass: for earthquakes this is on the unsafe side; to include it, "
                "give it as blocks, or as density of the blocks that bear it"
            )
    return tuple(found)
