"""Points attached to blocks, and what is there: actuators that push them, control points that are watched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import load_system
from dembrick.assembly.surface_pressures import face_forces
from dembrick.errors import ScenarioError
from dembrick.geometry.shapes import parts_of
from dembrick.scenario.checks import show
from dembrick.scenario.regimes import OF_ACTUATORS, OF_PRESSURES, Curve

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control
    from dembrick.scenario.model import Scenario

ON_FACE = 1e-6  # of the block's diameter: a point so little outside is on the face, as files give coordinates


# kinds of actuators
ACTUATOR = "actuator"
PRESSURE = "pressure"  # the resultant of a driven pressure at the start
BODY_FORCE = "body force"  # the load of a block of a structure that is tilted or pushed as a whole
KINDS = (ACTUATOR, PRESSURE, BODY_FORCE)


@dataclass(frozen=True, eq=False)
class Attached:
    """Material points of blocks: ``block`` (k,) which each belongs to; ``arm`` (k, 3) m from the centroid to the point
    at the start, world axes; ``lever`` (k, 3) m the same in the block's axes. Ends of ties are k by 2 points."""

    block: np.ndarray
    arm: np.ndarray
    lever: np.ndarray

    @classmethod
    def to(cls, bare: Assembly, block, arm) -> Attached:
        """Points of the blocks numbered ``block`` (k,) at ``arm`` (k, 3) of an assembly."""
        block = np.array(block, np.int64)
        arm = np.array(arm, float).reshape(*block.shape, 3)
        return cls(block, arm, np.einsum("...ji,...j->...i", bare.rotation[block], arm))

    def __len__(self) -> int:
        return len(self.block)

    def __getitem__(self, which) -> Attached:
        return Attached(self.block[which], self.arm[which], self.lever[which])

    def and_then(self, more: Attached) -> Attached:
        """These points and ``more``."""
        parts = zip(vars(self).values(), vars(more).values(), strict=True)
        return Attached(*(np.concatenate(part) for part in parts))

    def start(self, position: np.ndarray) -> np.ndarray:
        """The points (k, 3) m at the start, world; ``position`` (n, 3) of the centroids then."""
        return position[self.block] + self.arm

    def arms(self, rotation: np.ndarray) -> np.ndarray:
        """From the centroids to the points (k, 3) m, world, where blocks stand as ``rotation`` (n, 3, 3)."""
        return np.einsum("...ij,...j->...i", rotation[self.block], self.lever)

    def wrenches(self, force: np.ndarray) -> np.ndarray:
        """Forces (k, 3) N at the points at the start and their moments about the centroids (k, 6): N and N m."""
        return np.concatenate([force, np.cross(self.arm, force)], axis=1)

    def on_blocks(self, force: np.ndarray, count: int) -> np.ndarray:
        """Sums of the wrenches (n, 6) on each of so many blocks."""
        found = np.zeros((count, 6))
        np.add.at(found, self.block, self.wrenches(force))
        return found


@dataclass(frozen=True, eq=False)
class ActuatorTable:
    """Actuators: ``names``; points of blocks, ``at``, that they push; ``direction`` (k, 3) unit, world; ``weight``
    (k,); ``kind`` (k,), of `KINDS`."""

    names: tuple[str, ...]
    at: Attached
    direction: np.ndarray
    weight: np.ndarray
    kind: tuple[str, ...]

    @property
    def force(self) -> np.ndarray:
        """Forces (k, 3) for V = 1, world."""
        return self.direction * self.weight[:, None]


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Material points whose displacement is recorded: ``names``, and where they are, ``at``."""

    names: tuple[str, ...]
    at: Attached

    def displacement(self, moved: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Of the points (w, 3) where the centroids have ``moved`` (n, 3) and blocks stand as ``rotation`` (n, 3, 3)."""
        return self.displaced(moved[self.at.block], rotation[self.at.block])

    def displaced(self, moved: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """The same, ``moved`` (..., w, 3) and ``rotation`` (..., w, 3, 3) being those of the block of each point."""
        return moved + np.einsum("...wij,wj->...wi", rotation, self.at.lever) - self.at.arm


NO_VECTORS = np.zeros((0, 3))
NOWHERE = Attached(np.zeros(0, np.int64), NO_VECTORS, NO_VECTORS)
NO_ACTUATORS = ActuatorTable((), NOWHERE, NO_VECTORS, np.zeros(0), ())
NO_CONTROL_POINTS = ControlPoints((), NOWHERE)


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
        rows.append((actuator.name, block, arm, actuator.direction, actuator.weight, ACTUATOR))
    for pressure in scenario.pressures:
        if pressure.actuator:  # it pushes at its centre, by its force for V = 1
            for face in face_forces(pressure, scenario.groups.get(pressure.block) or (number[pressure.block],), bare):
                weight, name = np.sqrt((face.force**2).sum()), f"pressure on {bare.names[face.block]}"
                rows.append((name, face.block, face.arm, face.force / weight, weight, PRESSURE))
    if not rows:
        return NO_ACTUATORS
    names, blocks, arms, direction, weight, kind = zip(*rows, strict=True)
    at = Attached.to(bare, blocks, arms)
    return ActuatorTable(names, at, np.array(direction, float), np.array(weight, float), kind)


def recorded_curve(control: Control, actuators: ActuatorTable) -> Curve:
    """Curve that a run under ``control`` records; its load is a factor without a unit if nothing but pressures is
    driven."""
    return OF_PRESSURES if set(actuators.kind) == {PRESSURE} and control.curve is OF_ACTUATORS else control.curve


def actuators_on_all_blocks(scenario: Scenario, loads, bare: Assembly) -> ActuatorTable:
    """The load system of a quasi-static tilt or pushover, as actuators at centroids and at the points of the loads."""
    block, point, force = load_system.load_system(scenario, loads, bare.position, bare.mass, bare.fixed)
    weight = np.sqrt((force**2).sum(axis=1))
    return ActuatorTable(
        names=tuple(f"load on {bare.names[i]}" for i in block),
        at=Attached.to(bare, block, point - bare.position[block]),
        direction=force / weight[:, None],
        weight=weight,
        kind=(BODY_FORCE,) * len(block),
    )


def effective_mass(assembly: Assembly) -> float:
    """The mass (kg) that actuators of one multiplier V have to speed up: V over the acceleration of the driven
    displacement, if nothing but the inertia of the blocks resists."""
    actuators = assembly.actuators
    wrench = actuators.at.on_blocks(actuators.force, len(assembly.names))
    push, turn = wrench[:, :3], wrench[:, 3:]
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
    return ControlPoints(tuple(entry.name for entry in given), Attached.to(bare, block, arm))
