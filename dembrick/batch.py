"""Limit loads of many two-block scenes at once: one compiled call instead of an assembly, a state and a file for each.

A case is a joint between a fixed and a free block with its dead load and its jacks, all in the joint's own axes about
its centroid O. Every case is stepped through time by the kernels of a scene of its own (``replay.find_limit_load``)
and ends with the same bracket; a test holds the two against each other. Cases run in blocks of `BLOCK`, so memory does
not grow with their number, and the compiled call lets go of Python's lock, so that threads share them. Whatever the
number of threads, the answers are the same to the last bit.

    >>> cases = Cases.rectangle(0.3, 0.2, "convex", friction=0.64, normal_force=467.0,
    ...                         jack_point=[[0.075, 0.0, 0.05]], jack_direction=[[0.0, 1.0, 0.0]])
    >>> find_limit_loads(cases).V
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from dembrick import certificate, equilibrium, guards, polygons, replay, simulation
from dembrick.errors import ScenarioError
from dembrick.joints import Joint
from dembrick.kernels.advance import CONVERGED
from dembrick.kernels.batch import UNSEATED, Answer, Loading, Lone, Room, Settings, replay_batch
from dembrick.kernels.bracket import NEVER
from dembrick.kernels.certify import Basis
from dembrick.model import JointLaw
from dembrick.point_rules import ContactPoints, contact_points
from dembrick.stability import critical_time_step
from dembrick.state import Areas, Blocks, Jacks, Joints, Points, Pressed, ScaledInertia
from dembrick.yield_point import OPEN

BLOCK = 128  # cases prepared and run at a time
STIFF = 1e-6  # elastic closing and slip over the short side, where no stiffness is given: a numerical choice
STEP_FACTOR = 0.9  # of the time step that is stable


@dataclass(frozen=True)
class Cases:
    """k two-block scenes of one formulation. SI units, joint axes (t1, t2, n) about O; forces act on the free block b.

    ``polygons``: the different joint polygons, each (m, 2) about its centroid, counter-clockwise, convex; ``shape``
    (k,) says which of them a case has. ``friction``, ``normal_stiffness``, ``shear_stiffness`` (k,). ``dead`` (k, 6):
    force and moment of the dead load (a pressing force has dead[:, 2] < 0). ``jack_point``, ``jack_direction``
    (k, j, 3) and ``jack_weight`` (k, j): the j jacks of each case; a height above the joint is jack_point[..., 2].
    ``tolerance``: relative half-width of the brackets. ``points``: (n, m) of ``distributed``, None for as many as the
    tolerance needs.
    """

    formulation: str
    polygons: Sequence[np.ndarray]
    shape: np.ndarray
    friction: np.ndarray
    normal_stiffness: np.ndarray
    shear_stiffness: np.ndarray
    dead: np.ndarray
    jack_point: np.ndarray
    jack_direction: np.ndarray
    jack_weight: np.ndarray
    pressure: str = "full"
    points: tuple[int, int] | None = None
    tolerance: float = 1e-3

    @property
    def count(self) -> int:
        """k."""
        return len(self.shape)

    @classmethod
    def on(
        cls,
        polygons_,
        formulation: str,
        *,
        friction,
        normal_force,
        jack_point,
        jack_direction,
        jack_weight=1.0,
        shape=0,
        eccentricity=(0.0, 0.0),
        dead_shear=(0.0, 0.0),
        normal_stiffness=None,
        shear_stiffness=None,
        **options,
    ) -> Cases:
        """Cases from whatever broadcasts to k: numbers, or arrays with k rows.

        ``polygons_`` is one polygon (m, 2) or a list of them. N acts at ``eccentricity`` (..., 2), ``dead_shear``
        (..., 2) is a tangential dead force at O. ``jack_point`` and ``jack_direction`` (j, 3) or (k, j, 3). Without
        stiffnesses the joint is so stiff that it closes and shears by a millionth of its short side.
        """
        single = np.ndim(polygons_[0]) == 2
        shapes = [np.ascontiguousarray(p, float) for p in (polygons_ if single else [polygons_])]
        point, direction = (np.asarray(v, float) for v in (jack_point, jack_direction))
        weight = np.asarray(jack_weight, float)
        k = np.broadcast_shapes(
            *(np.shape(v) for v in (shape, friction, normal_force)),
            *(np.shape(v)[:-1] for v in (eccentricity, dead_shear)),
            *(v.shape[:-2] for v in (point, direction)),
            weight.shape[:-1],
        )
        k = k if k else (1,)
        each = np.broadcast_shapes(point.shape[-2:-1], direction.shape[-2:-1], weight.shape[-1:])
        shape = np.broadcast_to(np.asarray(shape, np.int64), k)
        N, mu = (np.broadcast_to(np.asarray(v, float), k) for v in (normal_force, friction))
        e, shear = (np.broadcast_to(np.asarray(v, float), (*k, 2)) for v in (eccentricity, dead_shear))
        dead = np.zeros((*k, 6))
        dead[:, :2], dead[:, 2] = shear, -N
        dead[:, 3], dead[:, 4] = -N * e[:, 1], N * e[:, 0]
        stiff = np.array([1.0 / (polygons.area(p) * STIFF * polygons.width(p)) for p in shapes])[shape]
        kn = N * stiff if normal_stiffness is None else np.broadcast_to(np.asarray(normal_stiffness, float), k)
        ks = np.maximum(mu, 1.0) * N * stiff if shear_stiffness is None else np.broadcast_to(shear_stiffness, k)
        length = np.sqrt((direction**2).sum(axis=-1, keepdims=True))
        return cls(
            formulation, shapes, shape, mu, kn, np.asarray(ks, float), dead,
            np.broadcast_to(point, (*k, *each, 3)), np.broadcast_to(direction / length, (*k, *each, 3)),
            np.broadcast_to(weight, (*k, *each)), **options,
        )  # fmt: skip

    @classmethod
    def rectangle(cls, a: float, b: float, formulation: str, **options) -> Cases:
        """Cases of one rectangle a (along t1) x b (along t2); options as of `on`."""
        corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]]) / 2.0
        return cls.on(corners, formulation, **options)

    def part(self, first: int, last: int) -> Cases:
        """Cases ``first`` to ``last`` - 1."""
        s = slice(first, last)
        rows = ("shape", "friction", "normal_stiffness", "shear_stiffness", "dead")
        rows += ("jack_point", "jack_direction", "jack_weight")
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Cases(**(fields | {name: fields[name][s] for name in rows}))


@dataclass(frozen=True)
class LimitLoads:
    """What became of k cases, row by row. SI units, joint axes; N, V_1, V_2, M_T act on b about O.

    ``status``: "yield", or what went wrong: "not converged", "diverged", "not seated" (the dead load alone brings the
    block down); V and its bounds are those reached. ``V`` is the middle of the bracket, NaN without an upper bound
    (``V_upper`` infinite). ``certified`` tells a strict bracket from an indicator. ``twist`` (k, 3) is the slip twist
    that gave the upper bound, where certified, else that at the end; ``tilt`` (k, 2) how the block rocked in the last
    step (rad).
    """

    V: np.ndarray
    V_lower: np.ndarray
    V_upper: np.ndarray
    certified: np.ndarray
    status: np.ndarray
    jack_load: np.ndarray
    N: np.ndarray
    V_1: np.ndarray
    V_2: np.ndarray
    M_T: np.ndarray
    twist: np.ndarray
    tilt: np.ndarray
    steps: np.ndarray

    @property
    def half_width(self) -> np.ndarray:
        """Half the width of each bracket (N)."""
        return 0.5 * (self.V_upper - self.V_lower)


_STATUS = np.array(["not converged", "yield", "diverged", "not converged", "diverged", "not seated"])
assert _STATUS[CONVERGED] == "yield" and _STATUS[UNSEATED] == "not seated"


def find_limit_loads(
    cases: Cases, threads: int | None = None, progress: Callable[[int, int], None] | None = None
) -> LimitLoads:
    """The limit load of every case; ``threads`` defaults to the cores of the machine.

    Cases that have no answer say so in ``status``, and the others go on. ``progress`` gets the number of cases done
    and of all. ScenarioError where the cases are no tests: shapes, signs, a load that does not push along the joint.
    """
    _check(cases)
    starts = range(0, cases.count, BLOCK)
    parts = [cases.part(first, min(first + BLOCK, cases.count)) for first in starts]
    faces = _Faces(cases)
    threads = min(threads or os.cpu_count() or 1, len(parts))
    found, done = [], 0

    def run(part: Cases) -> LimitLoads:
        return _run(part, faces)

    if threads > 1:
        _run(cases.part(0, 1), faces)  # loads or fills the cache of compiled code before the threads meet at it
    with ThreadPoolExecutor(threads) as pool:
        for result in pool.map(run, parts) if threads > 1 else map(run, parts):
            found.append(result)
            done += len(result.V)
            if progress:
                progress(done, cases.count)
    names = LimitLoads.__dataclass_fields__
    return LimitLoads(**{name: np.concatenate([getattr(result, name) for result in found]) for name in names})


def _check(cases: Cases) -> None:
    def require(condition, what: str, bound: str) -> None:
        bad = np.flatnonzero(~np.asarray(condition))
        if len(bad):
            raise ScenarioError(f"case {int(bad[0])}: {what} is out of range: {bound}")

    if not cases.count:
        raise ScenarioError("there are no cases: give at least one")
    if not 1e-8 <= cases.tolerance <= 0.1:
        raise ScenarioError(f"tolerance = {cases.tolerance!r} is out of range: it is a relative error from 1e-8 to 0.1")
    JointLaw(cases.formulation, 0.0, 1.0, 1.0, points=cases.points, pressure=cases.pressure)  # checks the names
    rows = np.isfinite(cases.dead).all(1) & np.isfinite(cases.jack_point).all((1, 2))
    rows &= np.isfinite(cases.jack_direction).all((1, 2)) & np.isfinite(cases.jack_weight).all(1)
    require(rows, "a load or a jack", "it must be made of finite numbers, and no direction may be 0")
    require(np.isfinite(cases.friction) & (cases.friction >= 0.0), "friction", "it must be at least 0")
    for name in ("normal_stiffness", "shear_stiffness"):
        value = getattr(cases, name)
        require(np.isfinite(value) & (value > 0.0), name, "it must be greater than 0 Pa/m")
    require(cases.dead[:, 2] < 0.0, "the dead load", "it must press the joint (N greater than 0)")
    for i, polygon in enumerate(cases.polygons):
        _check_polygon(i, polygon)
    unit = _wrench(cases)
    reach = np.array([np.hypot(*p.T).max() for p in cases.polygons])[cases.shape]
    pushing = np.hypot(unit[:, 0], unit[:, 1]) * reach + np.abs(unit[:, 5])
    most = np.abs(cases.jack_weight).sum(1) * reach
    require(pushing > 1e-12 * most, "the load of the jacks", "it must have a part along the joint or turn it")


def _check_polygon(i: int, polygon: np.ndarray) -> None:
    where = f"polygon {i}"
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
        raise ScenarioError(f"{where} needs at least three corners (x, y) of finite numbers")
    edges = np.roll(polygon, -1, axis=0) - polygon
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    size = float(np.ptp(polygon, axis=0).max())
    if not (turns > 1e-12 * size * size).all():
        raise ScenarioError(
            f"{where} is not convex, runs clockwise, or has a corner on the line of its neighbours: list the corners "
            "of a convex polygon counter-clockwise, each once"
        )
    _, x, y = polygons.area_and_centroid([tuple(corner) for corner in polygon.tolist()])
    if np.hypot(x, y) > 1e-9 * size:
        raise ScenarioError(f"{where} is not about its centroid, which lies at ({x:.6g}, {y:.6g}) m: shift it there")


def _wrench(cases: Cases) -> np.ndarray:
    """Force and moment (k, 6) of the jacks for V = 1 about O."""
    force = cases.jack_direction * cases.jack_weight[:, :, None]
    return np.concatenate([force.sum(1), np.cross(cases.jack_point, force).sum(1)], axis=1)


def face(polygon: np.ndarray, law: JointLaw) -> Joint:
    """A joint by itself, in its own axes about its centroid, where the points of its law can be placed."""
    zero, polygon = np.zeros(3), np.asarray(polygon, float)
    return Joint(0, 1, 1, zero, np.eye(3), polygon, polygons.area(polygon), law, 0.0, zero, zero)


class _Faces:
    """The different joints of a batch with friction and stiffnesses of 1, as the engine sees them."""

    def __init__(self, cases: Cases):
        law = JointLaw(cases.formulation, 1.0, 1.0, 1.0, points=cases.points, pressure=cases.pressure)
        self.joints = [face(polygon, law) for polygon in cases.polygons]
        self.contact_points: list[ContactPoints | None] = [contact_points(f, cases.tolerance) for f in self.joints]
        self.width = np.array([polygons.width(p) for p in cases.polygons])
        self.points, self.areas = simulation.point_joints(self), simulation.area_joints(self)


def _gathered(start: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows ``chosen`` of a ragged table: their new starts, and which of its entries they are made of."""
    counts = np.diff(start)[chosen]
    new = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return new, np.repeat(start[:-1][chosen] - new[:-1], counts) + np.arange(new[-1])


def _point_joints(faces: _Faces, cases: Cases) -> Points | None:
    if faces.points is None:
        return None
    start, entry = _gathered(faces.points.start, cases.shape)
    counts = np.diff(start)
    values = {name: getattr(faces.points, name)[entry] for name in faces.points._fields[3:]}
    values["k_n"] *= np.repeat(cases.normal_stiffness, counts)
    values["k_s"] *= np.repeat(cases.shear_stiffness, counts)
    return Points(np.arange(cases.count), start, np.array(cases.friction), **values)


def _area_joints(faces: _Faces, cases: Cases) -> Areas | None:
    if faces.areas is None:
        return None
    start, entry = _gathered(faces.areas.start, cases.shape)
    values = {name: getattr(faces.areas, name)[cases.shape] for name in faces.areas._fields if name != "pressed"}
    values |= {"joint": np.arange(cases.count), "start": start, "friction": np.array(cases.friction)}
    values |= {"x": faces.areas.x[entry], "y": faces.areas.y[entry]} if len(entry) else {}
    values |= {"k_n": np.array(cases.normal_stiffness), "k_s": np.array(cases.shear_stiffness)}
    pressed: Pressed | None = simulation.pressed_room([cases.pressure] * cases.count, np.diff(start).tolist())
    return Areas(**values, pressed=pressed)


def _joints(k: int) -> Joints:
    """k joints in their own axes, both blocks seen from O."""
    axes = np.tile(np.eye(3), (k, 1, 1))
    zero = {name: np.zeros((k, 3)) for name in ("arm_a", "arm_b", "lever_a", "lever_b", "offset", "opening", "step")}
    return Joints(
        block_a=2 * np.arange(k),
        block_b=2 * np.arange(k) + 1,
        host=np.ones(k),
        axes=axes,
        axes_a=axes.copy(),
        axes_b=axes.copy(),
        gap=np.zeros(k),
        relative=np.zeros((k, 6)),
        damping=np.ones(k),
        tilt=np.zeros((k, 2)),
        resultant=np.zeros((k, 7)),
        **zero,
    )


def _blocks(k: int, dead: np.ndarray) -> Blocks:
    n = 2 * k
    vectors = ("displacement", "rotation", "velocity", "spin", "momentum", "force", "torque")
    dead_force, dead_torque = np.zeros((n, 3)), np.zeros((n, 3))
    dead_force[1::2], dead_torque[1::2] = dead[:, :3], dead[:, 3:]
    return Blocks(
        free=2 * np.arange(k) + 1,
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        mean_velocity=np.zeros((n, 6)),
        dead_force=dead_force,
        dead_torque=dead_torque,
        **{name: np.zeros((n, 3)) for name in vectors},
    )


def _jacks(cases: Cases) -> Jacks:
    k, each = cases.jack_weight.shape
    arm = np.array(cases.jack_point, float).reshape(-1, 3)
    return Jacks(
        block=np.ones(k * each, np.int64),
        arm=arm.copy(),
        lever=arm.copy(),
        start=arm.copy(),
        direction=np.array(cases.jack_direction, float).reshape(-1, 3),
        weight=np.array(cases.jack_weight, float).reshape(-1),
        displacement=np.zeros(k * each),
        drive=np.zeros((k, 5)),
    )


def _inertia(stiffness: np.ndarray) -> ScaledInertia:
    """Scaled inertia (2 k, 6, 6) of the free blocks from their stiffness (k, 6, 6)."""
    inverse, matrix = np.zeros((2, 2 * len(stiffness), 6, 6))
    inverse[1::2], matrix[1::2] = np.linalg.inv(stiffness), stiffness
    return ScaledInertia(inverse, matrix, None)


def _settings(tolerance: float, eta: float) -> Settings:
    """The choices of ``replay`` and ``equilibrium``."""
    return Settings(
        tolerance=tolerance,
        caution=certificate.CAUTION,
        unbalanced=equilibrium.UNBALANCED,
        first_steps=equilibrium.FIRST_STEPS,
        seating_steps=equilibrium.MOST_STEPS,
        momentum=equilibrium.MOMENTUM,
        eta=eta,
        slip_per_step=replay.SLIP_PER_STEP,
        gently=replay.GENTLY,
        ramp=float(replay.RAMP),
        steady=16 * replay.HALVING,
        slowing=0.5 ** (1.0 / replay.HALVING),
        jack=replay.JACK,
        viscous=replay.VISCOUS,
        calming=replay.CALMING,
        memory=replay.MEMORY,
        chunk=replay.CHUNK_OF_SEARCH,
        most_steps=replay.MOST_STEPS,
        window=certificate.WINDOW,
        mask=guards.LOOK - 1,
        stretch=1 << 62,
    )


def _run(cases: Cases, faces: _Faces) -> LimitLoads:
    k = cases.count
    points, areas = _point_joints(faces, cases), _area_joints(faces, cases)
    blocks, joints, jacks = _blocks(k, cases.dead), _joints(k), _jacks(cases)
    stiffness = simulation.joint_stiffness(simulation.State(blocks, joints, points, areas, jacks))
    eta = STEP_FACTOR * critical_time_step(float(np.sqrt(1.0 + replay.JACK)), replay.VISCOUS)
    unit = _wrench(cases)
    loading = Loading(
        unit=unit,
        dead=np.array(cases.dead, float),
        compliance=(unit * np.linalg.solve(stiffness, unit[:, :, None])[:, :, 0]).sum(1),
        weight=np.abs(cases.jack_weight).sum(1),
        size=guards.LONGEST_MOVE * faces.width[cases.shape],
    )
    counts = np.zeros((2, k), np.int64)
    answer = Answer(np.zeros((k, 2)), np.zeros((k, 5)), np.zeros((k, 3)), *counts)
    basis = Basis(
        np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(1 if points is None else len(points.k_n)), np.zeros(5)
    )
    room = Room(np.zeros((certificate.WINDOW, 4)), np.zeros(4), np.zeros(2), np.zeros(2), np.zeros(3), np.zeros((1, 3)))
    replay_batch(
        0, k, blocks, joints, points, areas, jacks, cases.jack_weight.shape[1],
        _inertia(stiffness), _inertia(stiffness / eta**2), loading, Lone(np.zeros(1, np.int64), np.ones(1, np.int64)),
        basis, room, _settings(cases.tolerance, eta), answer,
    )  # fmt: skip
    strict = answer.basis[:, 0] == 1.0
    lower, upper = np.minimum(answer.bracket[:, 0], answer.bracket[:, 1]), answer.bracket.max(axis=1)
    unbounded = upper >= NEVER
    open_ = unbounded | (~strict & (upper - lower > OPEN * np.abs(lower)))
    status = np.where(open_ & (answer.status == CONVERGED), "not converged", _STATUS[answer.status])
    resultant = joints.resultant
    return LimitLoads(
        V=np.where(open_, np.nan, 0.5 * (lower + np.where(unbounded, 0.0, upper))),
        V_lower=lower,
        V_upper=np.where(unbounded, np.inf, upper),
        certified=strict,
        status=status,
        jack_load=jacks.drive[:, 2].copy(),
        N=resultant[:, 0].copy(),
        V_1=resultant[:, 1].copy(),
        V_2=resultant[:, 2].copy(),
        M_T=resultant[:, 3].copy(),
        twist=np.where(strict[:, None], answer.twist, joints.step if areas is None else areas.twist),
        tilt=joints.tilt.copy(),
        steps=answer.steps,
    )
