"""Points attached to blocks: those of the actuators that push them, and the control points that are watched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import load_system
from dembrick.assembly.surface_pressures import face_forces
from dembrick.errors import ScenarioError
from dembrick.geometry.shapes import parts_of
from dembrick.scenario.checks import show
from dembrick.scenario.pressures import PRESSURE
from dembrick.scenario.regimes import OF_ACTUATORS, OF_PRESSURES, Curve

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control
    from dembrick.scenario.model import Scenario

ON_FACE = 1e-9  # of the block's diameter: a point so little outside is on the face


@dataclass(frozen=True, eq=False)
class ActuatorTable:
    """Actuators: ``names``; ``block`` (k,); ``point`` (k, 3) at the start, world; ``arm`` (k, 3) the same from the
    block's centroid; ``direction`` (k, 3) unit, world; ``weight`` (k,); ``pressed`` (k,): the resultant of a driven
    pressure at the start, and no jack."""

    names: tuple[str, ...]
    block: np.ndarray
    point: np.ndarray
    arm: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    pressed: np.ndarray


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Material points whose displacement is recorded: ``names``; ``block`` (w,); ``point`` (w, 3) at the start, world;
    ``arm`` (w, 3) the same from the block's centroid; ``lever`` (w, 3) that in the block's axes."""

    names: tuple[str, ...]
    block: np.ndarray
    point: np.ndarray
    arm: np.ndarray
    lever: np.ndarray

    def displacement(self, moved: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Of the points (w, 3) where the centroids have ``moved`` (n, 3) and blocks stand as ``rotation`` (n, 3, 3)."""
        return self.displaced(moved[self.block], rotation[self.block])

    def displaced(self, moved: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """The same, ``moved`` (..., w, 3) and ``rotation`` (..., w, 3, 3) being those of the block of each point."""
        return moved + np.einsum("...wij,wj->...wi", rotation, self.lever) - self.arm


NO_VECTORS = np.zeros((0, 3))
NO_ACTUATORS = ActuatorTable(
    (), np.zeros(0, np.int64), NO_VECTORS, NO_VECTORS, NO_VECTORS, np.zeros(0), np.zeros(0, bool)
)
NO_CONTROL_POINTS = ControlPoints((), np.zeros(0, np.int64), NO_VECTORS, NO_VECTORS, NO_VECTORS)


def check_inside(what: str, point, bare: Assembly, block: int) -> np.ndarray:
    """The arm (3,) of a point from the centroid of its block; ScenarioError if it lies outside."""
    outside = _outside(point, bare, block)
    if outside > 0.0:
        name = show(bare.names[block])
        where = f"its point {show(tuple(point))} lies {outside:.6g} m outside block {name}"
        others = [other for i, other in enumerate(bare.names) if i != block and _outside(point, bare, i) <= 0.0]
        where += f", in {show(others[0])}" if others else ""
        centre = ", ".join(f"{part:.4g}" for part in (bare.position[block] + 0.0).round(9).tolist())
        raise ScenarioError(
            f"{what}: {where}; put it in the block, whose centroid is at ({centre}), or on one of its faces (world "
            "position at the start)"
        )
    return np.array(point, float) - bare.position[block]


def _outside(point, bare: Assembly, block: int) -> float:
    """How far (m) a point lies outside a block, 0 if it is in it or on a face."""
    shape = bare.shapes[block]
    local = bare.rotation[block].T @ (np.array(point, float) - bare.position[block])
    far = min(float((part.face_normals @ (local - place) - part.face_offsets).max()) for place, part in parts_of(shape))
    return far if far > ON_FACE * shape.diameter else 0.0


def given_actuators(scenario: Scenario, number: dict[str, int], bare: Assembly) -> ActuatorTable:
    """The actuators of a scenario and its driven pressures; ``number`` of every block by name.

    ScenarioError if an actuator cannot push its block, or no face feels a pressure.
    """
    rows: list[tuple] = []
    for actuator in scenario.actuators:
        what, block = f"actuator {show(actuator.name)}", number[actuator.block]
        if bare.fixed[block]:
            raise ScenarioError(f"{what} pushes block {show(actuator.block)}, which is fixed; push a free block")
        arm = check_inside(what, actuator.point, bare, block)
        rows.append((actuator.name, block, actuator.point, arm, actuator.direction, actuator.weight, False))
    for pressure in scenario.pressures:
        if pressure.actuator:  # it pushes at its centre, by its force for V = 1
            for face in face_forces(pressure, scenario.groups.get(pressure.block) or (number[pressure.block],), bare):
                weight, point = np.sqrt((face.force**2).sum()), bare.position[face.block] + face.arm
                name = f"{PRESSURE}{bare.names[face.block]}"
                rows.append((name, face.block, point, face.arm, face.force / weight, weight, True))
    if not rows:
        return NO_ACTUATORS
    names, blocks, *columns, pressed = zip(*rows, strict=True)
    point, arm, direction, weight = (np.array(column, float) for column in columns)
    return ActuatorTable(names, np.array(blocks, np.int64), point, arm, direction, weight, np.array(pressed, bool))


def recorded_curve(control: Control, actuators: ActuatorTable) -> Curve:
    """Curve that a run under ``control`` records; its load is a factor without a unit if nothing but pressures is
    driven."""
    pressed = bool(actuators.names) and bool(actuators.pressed.all())
    return OF_PRESSURES if pressed and control.curve is OF_ACTUATORS else control.curve


def actuators_on_all_blocks(scenario: Scenario, loads, bare: Assembly) -> ActuatorTable:
    """The load system of a quasi-static tilt or pushover, as actuators at centroids and at the points of the loads."""
    block, point, force = load_system.load_system(scenario, loads, bare.position, bare.mass, bare.fixed)
    weight = np.sqrt((force**2).sum(axis=1))
    return ActuatorTable(
        names=tuple(f"load on {bare.names[i]}" for i in block),
        block=block,
        point=point,
        arm=point - bare.position[block],
        direction=force / weight[:, None],
        weight=weight,
        pressed=np.zeros(len(block), bool),
    )


def effective_mass(assembly: Assembly) -> float:
    """The mass (kg) that actuators of one multiplier V have to speed up: V over the acceleration of the driven
    displacement, if nothing but the inertia of the blocks resists."""
    actuators = assembly.actuators
    force = actuators.direction * actuators.weight[:, None]
    push, turn = np.zeros((len(assembly.names), 3)), np.zeros((len(assembly.names), 3))
    np.add.at(push, actuators.block, force)
    np.add.at(turn, actuators.block, np.cross(actuators.arm, force))
    free = ~assembly.fixed
    mass, inertia = np.asarray(assembly.mass)[free], np.asarray(assembly.inertia)[free]
    rotation = np.asarray(assembly.rotation)[free]
    local = np.einsum("nij,ni->nj", rotation, turn[free])
    speed_up = (push[free] ** 2).sum(axis=1) / mass
    spin_up = (local * np.linalg.solve(inertia, local[..., None])[..., 0]).sum(axis=1)
    return float(np.abs(actuators.weight).sum() / (speed_up + spin_up).sum())


def control_points(scenario: Scenario, number: dict[str, int], bare: Assembly) -> ControlPoints:
    """The control points of a scenario, centroids where it gives no point; ScenarioError if one is outside."""
    given = scenario.control_points
    if not given:
        return NO_CONTROL_POINTS
    block = np.array([number[entry.block] for entry in given], np.int64)
    arm = np.zeros((len(given), 3))
    for k, entry in enumerate(given):
        if entry.point is not None:
            arm[k] = check_inside(f"control point {show(entry.name)}", entry.point, bare, block[k])
    return ControlPoints(
        names=tuple(entry.name for entry in given),
        block=block,
        point=bare.position[block] + arm,
        arm=arm,
        lever=np.einsum("wji,wj->wi", bare.rotation[block], arm),
    )
