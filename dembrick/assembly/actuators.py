"""Points attached to blocks, and their uses: actuators, and control points whose displacement is recorded."""

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

ON_FACE = 1e-6  # of the block's diameter: a point this little outside is on the face, within the digits of a file


# kinds of actuators
ACTUATOR = "actuator"
PRESSURE = "pressure"  # the resultant of a driven pressure at the start
BODY_FORCE = "body force"  # the load of a block of a structure that is tilted or pushed as a whole
KINDS = (ACTUATOR, PRESSURE, BODY_FORCE)


@dataclass(frozen=True, eq=False)
class Attached:
    """Material points of blocks: ``block`` (k,), index of the block of each; ``arm`` (k, 3) m, from the centroid to the
    point at the start, world axes; ``lever`` (k, 3) m, the same in body axes. For ends of ties, k is (number, 2)."""

    block: np.ndarray
    arm: np.ndarray
    lever: np.ndarray

    @classmethod
    def to(cls, bare: Assembly, block, arm) -> Attached:
        """Points at ``arm`` (k, 3) from the centroids of the blocks with indices ``block`` (k,)."""
        block = np.array(block, np.int64)
        arm = np.array(arm, float).reshape(*block.shape, 3)
        return cls(block, arm, np.einsum("...ji,...j->...i", bare.rotation[block], arm))

    def __len__(self) -> int:
        return len(self.block)

    def __getitem__(self, which) -> Attached:
        return Attached(self.block[which], self.arm[which], self.lever[which])

    def and_then(self, more: Attached) -> Attached:
        """These points followed by ``more``."""
        parts = zip(vars(self).values(), vars(more).values(), strict=True)
        return Attached(*(np.concatenate(part) for part in parts))

    def start(self, position: np.ndarray) -> np.ndarray:
        """The points (k, 3) m at the start, world; ``position`` (n, 3): centroids at the start."""
        return position[self.block] + self.arm

    def arms(self, rotation: np.ndarray) -> np.ndarray:
        """Vectors from the centroids to the points (k, 3) m, world; ``rotation`` (n, 3, 3): rotation of the blocks."""
        return np.einsum("...ij,...j->...i", rotation[self.block], self.lever)

    def wrenches(self, force: np.ndarray) -> np.ndarray:
        """Wrenches (k, 6) of forces (k, 3) at the points at the start: force (N), moment about the centroid (N m)."""
        return np.concatenate([force, np.cross(self.arm, force)], axis=1)

    def on_blocks(self, force: np.ndarray, count: int) -> np.ndarray:
        """Sum of the wrenches on each of ``count`` blocks (n, 6)."""
        found = np.zeros((count, 6))
        np.add.at(found, self.block, self.wrenches(force))
        return found


@dataclass(frozen=True, eq=False)
class ActuatorTable:
    """Actuators: ``names``; ``at``, the points that they push; ``direction`` (k, 3) unit, world; ``weight`` (k,);
    ``kind`` (k,), one of `KINDS`."""

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
    """Material points whose displacement is recorded: ``names``, and the points, ``at``."""

    names: tuple[str, ...]
    at: Attached

    def displacement(self, moved: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Displacement of the points (w, 3) for ``moved`` (n, 3), that of the centroids, and ``rotation`` (n, 3, 3)."""
        return self.displaced(moved[self.at.block], rotation[self.at.block])

    def displaced(self, moved: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """The same from ``moved`` (..., w, 3) and ``rotation`` (..., w, 3, 3) of the block of each point."""
        return moved + np.einsum("...wij,wj->...wi", rotation, self.at.lever) - self.at.arm


NO_VECTORS = np.zeros((0, 3))
NOWHERE = Attached(np.zeros(0, np.int64), NO_VECTORS, NO_VECTORS)
NO_ACTUATORS = ActuatorTable((), NOWHERE, NO_VECTORS, np.zeros(0), ())
NO_CONTROL_POINTS = ControlPoints((), NOWHERE)


def check_inside(what: str, point, bare: Assembly, block: int) -> np.ndarray:
    """The arm (3,) of a point from the centroid of its block; raise a ScenarioError if it lies outside."""
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
    """Distance (m) of a point outside a block; 0 inside and on a face."""
    shape = bare.shapes[block]
    local = bare.rotation[block].T @ (np.array(point, float) - bare.position[block])
    far = min(float((part.face_normals @ (local - place) - part.face_offsets).max()) for place, part in parts_of(shape))
    return far if far > ON_FACE * shape.diameter else 0.0


def given_actuators(scenario: Scenario, number: dict[str, int], bare: Assembly) -> ActuatorTable:
    """The actuators of a scenario and its driven pressures; ``number``: index of every block by name.

    Raises ScenarioError if an actuator cannot push its block, or a pressure acts on no face.
    """
    rows: list[tuple] = []
    for actuator in scenario.actuators:
        what, block = f"actuator {show(actuator.name)}", number[actuator.block]
        if bare.fixed[block]:
            raise ScenarioError(f"{what} pushes block {show(actuator.block)}, which is fixed; push a free block")
        arm = check_inside(what, actuator.point, bare, block)
        rows.append((actuator.name, block, arm, actuator.direction, actuator.weight, ACTUATOR))
    for pressure in scenario.pressures:
        if pressure.actuator:  # it acts at the centre of pressure, with its force for V = 1
            for face in face_forces(pressure, scenario.groups.get(pressure.block) or (number[pressure.block],), bare):
                weight, name = np.sqrt((face.force**2).sum()), f"pressure on {bare.names[face.block]}"
                rows.append((name, face.block, face.arm, face.force / weight, weight, PRESSURE))
    if not rows:
        return NO_ACTUATORS
    names, blocks, arms, direction, weight, kind = zip(*rows, strict=True)
    at = Attached.to(bare, blocks, arms)
    return ActuatorTable(names, at, np.array(direction, float), np.array(weight, float), kind)


def recorded_curve(control: Control, actuators: ActuatorTable) -> Curve:
    """Curve recorded in a run under ``control``; if only pressures are driven, its load is a factor without a unit."""
    return OF_PRESSURES if set(actuators.kind) == {PRESSURE} and control.curve is OF_ACTUATORS else control.curve


def actuators_on_all_blocks(scenario: Scenario, loads, bare: Assembly) -> ActuatorTable:
    """The load system of a quasi-static tilt or pushover, as actuators at centroids and at the points of loads."""
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
    """Effective mass (kg) of the load system: V over the acceleration of the driven displacement if only the inertia of
    the blocks resists."""
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
    """The control points of a scenario; at the centroid if no point is given. ScenarioError if one is outside."""
    given = scenario.control_points
    if not given:
        return NO_CONTROL_POINTS
    block = np.array([number[entry.block] for entry in given], np.int64)
    arm = np.zeros((len(given), 3))
    for k, entry in enumerate(given):
        if entry.point is not None:
            arm[k] = check_inside(f"control point {show(entry.name)}", entry.point, bare, block[k])
    return ControlPoints(tuple(entry.name for entry in given), Attached.to(bare, block, arm))
