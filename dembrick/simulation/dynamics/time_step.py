"""The critical time step of an assembly in free motion, from its greatest natural frequencies.

With velocities half a step behind, a dashpot acts on the increment of the last step, and a linear system
M u'' + C u' + K u = 0 is stable while the greatest eigenvalue of M^-1 (dt^2 K + 2 dt C) stays below 4. K is greatest
with all joints closed and none slipping. Each eigenvalue comes from a Lanczos iteration on the matrices of the joints,
plus its residual; no dense matrix is formed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry import polygons
from dembrick.geometry.shapes import Polyhedron, parts_of
from dembrick.kernels.dynamics.contact_forces import Touching
from dembrick.kernels.joint.ties import SHORTEST
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.state import MovingState, arms
from dembrick.simulation.joint_laws import elastic_stiffness

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

LANCZOS = 60  # iterations at most
CLOSE = 2e-3  # relative residual that ends them
NEWTON = 8  # steps, for an equation that is nearly linear
COARSE = 1.2  # rad per step: contacts that oscillate faster are damped as if at this phase


class JointOperator:
    """x -> M^-1/2 (sum over joints, new contacts and ties of stiffness, each part times its weight) M^-1/2 x for the
    free blocks."""

    def __init__(self, state: MovingState):
        bodies, links = state.bodies, state.links
        u = np.einsum("jik,jlk->jli", bodies.rotation[links.other], links.axes[links.plane])
        axes = np.concatenate([u, np.cross(u[:, 0], u[:, 1])[:, None]], axis=1)
        arm_host, _ = arms(bodies, links)
        arm_other = arm_host + bodies.position[links.host] - bodies.position[links.other]
        self._mass, self._free = bodies.mass, np.zeros(len(bodies.mass))
        self._free[bodies.free] = 1.0
        # columns of the square root of the inverse inertia, world axes: J^-1 = (R W)(R W)^T
        self._root = bodies.rotation @ np.linalg.cholesky(bodies.inverse)
        blocks = np.stack([links.other, links.host], axis=1)
        self._elements = [self._element(axes, blocks, (arm_other, arm_host), joint_families.stiffness(state))]
        self._ties = self._of_ties(state)

    def _element(self, axes: np.ndarray, blocks: np.ndarray, arm, k: np.ndarray) -> tuple[np.ndarray, ...]:
        """Elements between ``blocks`` (e, 2), at an arm (e, 3) from either, with the stiffness ``k`` (e, 6, 6) in
        ``axes`` (e, 3, 3): blocks, matrices from their mass-scaled motions to those of their ends, and ``k``."""
        ends = (self._to_joint(axes, arm[side], blocks[:, side]) for side in (0, 1))
        return blocks, *ends, k

    def _to_joint(self, axes: np.ndarray, arm: np.ndarray, block: np.ndarray) -> np.ndarray:
        """(e, 6, 6) from the mass-scaled motion of a block to that of O in the joint's axes."""
        matrix = np.zeros((len(block), 6, 6))
        scale = self._free[block] / np.sqrt(self._mass[block])
        matrix[:, :3, :3] = axes * scale[:, None, None]
        turn = self._root[block] * self._free[block][:, None, None]
        matrix[:, 3:, 3:] = axes @ turn
        matrix[:, :3, 3:] = axes @ np.cross(turn, arm[:, :, None], axis=1)
        return matrix

    def _of_ties(self, state: MovingState) -> tuple[np.ndarray, ...]:
        """The ties as elastic bars, all taut: k along the line, and the geometric stiffness of their prestress across
        it."""
        ties, bodies = state.ties, state.bodies
        block, arm = ties.block, ties.arm
        line = bodies.position[block[:, 1]] + arm[:, 1] - bodies.position[block[:, 0]] - arm[:, 0]
        length = np.maximum(np.sqrt((line * line).sum(axis=1)), SHORTEST)
        line /= length[:, None]
        across = np.cross(line, np.eye(3)[np.argmin(np.abs(line), axis=1)])
        across /= np.sqrt((across * across).sum(axis=1))[:, None]
        axes = np.stack([across, np.cross(line, across), line], axis=1)
        k = np.zeros((len(line), 6, 6))
        k[:, [0, 1], [0, 1]], k[:, 2, 2] = (ties.prestress / length)[:, None], ties.stiffness
        return self._element(axes, block, (arm[:, 0], arm[:, 1]), k)

    def add(self, bodies, contacts: Touching) -> np.ndarray:
        """Add the new contacts that touch now; returns their numbers (c,)."""
        on = np.flatnonzero(contacts.area > 0.0)
        springs = contacts.springs[on]
        blocks = contacts.parts.owner[np.stack([contacts.second[on], contacts.first[on]], axis=1)]
        normal, tangent = springs[:, 0:3], springs[:, 3:6]
        axes = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
        arm = [contacts.point[on] - bodies.position[block] for block in blocks.T]
        along, x, y, xx, xy, yy, _, across, shear, torsion = springs[:, 6:].T
        # x^2 + y^2 of the torsion in one number; the couplings of shear and torsion about that centre are zero
        k = elastic_stiffness((shear + across, 0.0, 0.0, torsion, 0.0, 0.0), (along, x, y, xx, yy, xy))
        self._elements.append(self._element(axes, blocks, arm, k))
        return on

    def greatest(self, normal: np.ndarray, shear: np.ndarray, ties: bool = True) -> float:
        """Greatest eigenvalue with the normal and the shear part of every joint weighted by (j,) each; with ``ties``,
        or without."""
        weight = np.stack([shear, shear, normal, normal, normal, shear], axis=1)
        blocks, to_a, to_b, k = (np.concatenate(part) for part in zip(*self._elements, strict=True))
        k *= weight[:, :, None]
        if ties:
            own = (blocks, to_a, to_b, k), self._ties
            blocks, to_a, to_b, k = (np.concatenate(part) for part in zip(*own, strict=True))
        a, b = blocks.T

        def apply(x: np.ndarray) -> np.ndarray:
            x = x.reshape(len(self._mass), 6, 1)
            force = k @ (to_b @ x[b] - to_a @ x[a])
            y = np.zeros((len(self._mass), 6))
            np.add.at(y, b, (np.swapaxes(to_b, 1, 2) @ force)[:, :, 0])
            np.add.at(y, a, -(np.swapaxes(to_a, 1, 2) @ force)[:, :, 0])
            return y.ravel()

        return _lanczos(apply, 6 * len(self._mass))


def _lanczos(apply, size: int) -> float:
    """Greatest eigenvalue of a positive semidefinite operator, plus the residual of its vector."""
    vector = np.random.default_rng(0).standard_normal(size)
    basis = [vector / np.linalg.norm(vector)]
    diagonal: list[float] = []
    beside: list[float] = []
    value = 0.0
    for _ in range(min(LANCZOS, size)):
        y = apply(basis[-1])
        diagonal.append(float(basis[-1] @ y))
        for q in basis:  # twice is enough to keep them orthogonal to each other
            y -= (q @ y) * q
        for q in basis:
            y -= (q @ y) * q
        size_left = float(np.linalg.norm(y))
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
        residual = size_left * abs(vectors[-1, -1])
        value = float(values[-1]) + residual
        if residual <= CLOSE * value:
            break
        beside.append(size_left)
        basis.append(y / size_left)
    return value


def pair_frequencies(state: MovingState) -> np.ndarray:
    """Frequencies (rad/s) of every joint (j, 2), normal and shear: those of the relative translation of its two blocks
    alone."""
    links, bodies = state.links, state.bodies
    inverse = np.zeros(len(bodies.mass))
    inverse[bodies.free] = 1.0 / bodies.mass[bodies.free]
    mass = 1.0 / (inverse[links.host] + inverse[links.other])
    stiffness = joint_families.stiffness(state)[:, [2, 0], [2, 0]]
    return np.sqrt(stiffness / mass[:, None])


def time_constants(frequency: np.ndarray, ratio: float) -> np.ndarray:
    """Dashpot over spring (s): ``ratio`` of critical damping at those frequencies (rad/s)."""
    return 2.0 * ratio / frequency


def stepped_dashpots(swing: np.ndarray, ratio: float) -> np.ndarray:
    """Dashpot over spring force for the same increment, for a pair with the phase per step ``swing`` = w dt (rad).

    As its velocity is half a step late, a dashpot c damps more than in continuous time. Steps of an oscillator with
    k dt^2/m = K and c dt/m = C have the eigenvalues exp(-ratio s +- i sqrt(1 - ratio^2) s) for

        C = 1 - E^2,  K = 1 + E^2 - 2 E cos(sqrt(1 - ratio^2) s),  E = exp(-ratio s);

    K = swing^2 gives s, by Newton's method, and so C / K: less than the 2 ratio / swing of continuous time. Phases
    beyond ``COARSE``, close to the critical step, are damped as if at it.
    """
    swing = np.minimum(swing, COARSE)
    damped, s = math.sqrt(1.0 - ratio * ratio), swing.copy()
    for _ in range(NEWTON):
        E, cosine, sine = np.exp(-ratio * s), np.cos(damped * s), np.sin(damped * s)
        slope = 2.0 * E * (ratio * cosine - ratio * E + damped * sine)
        s -= (1.0 + E * E - 2.0 * E * cosine - swing * swing) / slope
    return -np.expm1(-2.0 * ratio * s) / swing**2


def critical_time_step(state: MovingState, constants: np.ndarray) -> float:
    """Greatest stable time step (s) with dashpots of these time ``constants`` (j, 2)."""
    if not len(constants) and not len(state.ties.stiffness):
        return math.inf
    operator = JointOperator(state)
    one = np.ones(len(constants))
    dt = 2.0 / math.sqrt(operator.greatest(one, one))
    if not constants.any():
        return dt
    # the greatest eigenvalue of a sum is at most the sum of the greatest
    spring, dashpot = 4.0 / dt**2, operator.greatest(constants[:, 0], constants[:, 1], ties=False)
    return (math.sqrt(dashpot**2 + 4.0 * spring) - dashpot) / spring


def load_of_contacts(state: MovingState, contacts: Touching, left_to_joints: np.ndarray, dt: float) -> float:
    """Greatest eigenvalue of M^-1 (dt^2 K + 2 dt C) with the joints that are closed now, each weighted by its share
    (j,) of the force, and the new contacts of the last step: steps are stable up to 4."""
    operator, links = JointOperator(state), state.links
    on = operator.add(state.bodies, contacts)
    closed = np.where(links.wrench[:, :3].any(axis=1), left_to_joints, 0.0)[:, None] * (1.0 + 2.0 * links.viscous)
    damped = 1.0 + 2.0 * contacts.springs[on, 12]
    weights = (np.append(closed[:, i], damped) for i in (0, 1))
    return dt * dt * operator.greatest(*weights)


def contact_time_step(assembly: Assembly, damping: float) -> float:
    """Greatest stable time step (s) for a block that lies on any one of its faces with the stiffest law of the scene.

    For two free blocks of equal size on each other the square of the frequency is twice as large.
    """
    laws = assembly.laws.all
    k_n, k_s = max(law.normal_stiffness for law in laws), max(law.shear_stiffness for law in laws)
    free = np.flatnonzero(~assembly.fixed)
    known: dict[tuple[int, float], float] = {}
    for block in free.tolist():
        key = (id(assembly.shapes[block]), float(assembly.mass[block]))
        if key not in known:
            known[key] = max(
                _fastest(part, number, place, k_n, k_s, assembly.mass[block], assembly.inertia[block])
                for place, part in parts_of(assembly.shapes[block])
                for number in range(len(part.faces))
            )
    spring = max(known.values()) * (2.0 if len(free) > 1 else 1.0)
    dashpot = 2.0 * damping * np.sqrt(spring)
    return float((np.sqrt(dashpot**2 + 4.0 * spring) - dashpot) / spring)


def _fastest(part: Polyhedron, number: int, place, k_n: float, k_s: float, mass: float, inertia) -> float:
    """Square of the greatest frequency (1/s2) of a block that lies with a face of a part on a fixed body."""
    normal = part.face_normals[number]
    first = part.edge_axes[int(np.argmin(np.abs(part.edge_axes @ normal)))]
    axes = np.stack([first, np.cross(normal, first), normal])
    corners = (place + part.vertices[list(part.faces[number])]) @ axes.T
    area, x, y = polygons.area_and_centroid(corners[:, :2])
    yy, xx, xy = polygons.second_moments(corners[:, :2] - (x, y))
    arm = np.array([x, y, corners[0, 2]])
    moments = (area, 0.0, 0.0, xx, yy, xy)
    stiffness = elastic_stiffness([k_s * a for a in moments], [k_n * a for a in moments])
    # the face moves by u + r x arm
    root = np.linalg.cholesky(np.linalg.inv(axes @ inertia @ axes.T))
    to_face = np.zeros((6, 6))
    to_face[:3, :3] = np.eye(3) / np.sqrt(mass)
    to_face[3:, 3:] = root
    to_face[:3, 3:] = np.cross(root, arm[:, None], axis=0)
    return float(np.linalg.eigvalsh(to_face.T @ stiffness @ to_face)[-1])


def damping_of_restitution(restitution: float) -> float:
    """The damping ratio of a spring and dashpot without tension for which a mass rebounds at ``restitution`` times
    its speed (the contact ends when the force vanishes; Schwager and Poeschel, Granular Matter 9 (2007) 465)."""
    low, high = 0.0, 1.0 - 1e-12
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if restitution_of_damping(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


def restitution_of_damping(ratio: float) -> float:
    """Rebound speed over impact speed for a damping ratio below 1."""
    if ratio <= 0.0:
        return 1.0
    root = math.sqrt(1.0 - ratio * ratio)
    # the force vanishes at the phase where spring and dashpot cancel, during the rebound
    phase = math.pi - math.atan2(2.0 * ratio * root, 1.0 - 2.0 * ratio * ratio)
    return math.exp(-ratio / root * phase)
