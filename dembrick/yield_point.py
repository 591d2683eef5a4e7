"""The limit load of a scenario, found by a replay that ends when its own bracket is narrow enough.

Nobody waits for physical inertia. Every block gets an artificial one proportional to its contact stiffness, so that
all its modes swing together and the out-of-balance force of a joint never stirs another of its components. The jacks
push at about one elastic slip a step. Damping sits in the contacts, behind the slider, and in the jack, on the
difference between head and block: both vanish when the block slides steadily, so that V is then what the joints carry,
however fast the blocks move. What is left to wait for is the memory of the elastic forces, which slip wipes out.

The bracket (limit analysis, at fixed normal forces): any slip twist gives an upper bound, any force within the joint's
limit set a lower one. See ``kernels.advance``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dembrick import limit_set
from dembrick.equilibrium import scaled_inverse, seat
from dembrick.errors import DivergedError, NotConvergedError
from dembrick.kernels.advance import CONVERGED, DIVERGED, FULL, RUNNING, Drive, advance
from dembrick.kernels.bracket import NEVER, Certificate
from dembrick.kernels.record import Record
from dembrick.kernels.limit_surface import gauge
from dembrick.simulation import State, block_stiffness, initial_state, load_vectors
from dembrick.state import ScaledInertia

# Numerical choices of the replay; answers do not depend on them beyond the tolerance (a test says so).
VISCOUS = 0.5  # dashpot force over spring force for the same increment, in contacts and jack
JACK = 1.0  # stiffness of the jack over that of the joint along the load
SLIP_PER_STEP = 1.0  # elastic slips that the head moves in a step
RAMP = 8  # steps over which the head speeds up
MOST_STEPS = 20_000
CHUNK = 256  # steps after which a replay that has not converged goes on at half the rate
WINDOW = 16  # steps over which an indicator must hold still


@dataclass(frozen=True)
class YieldPoint:
    """Limit load of the load system, with its bracket and the state of the judged joint (SI units, joint axes).

    ``V`` is the middle of the bracket. ``bracket`` is "certified" where the normal forces do not depend on the load,
    else "indicator". ``jack_load`` is what the jacks carried when the bracket closed.
    """

    V: float
    V_lower: float
    V_upper: float
    bracket: str
    V_peak: float
    displacement_at_peak: float
    jack_load: float
    V_1: float
    V_2: float
    M_T: float
    N: float
    displacement: float
    torsion_centre: tuple[float, float] | None
    mechanism: str
    joint: tuple[str, str]

    @property
    def half_width(self) -> float:
        """Half the width of the bracket (N)."""
        return 0.5 * (self.V_upper - self.V_lower)


@dataclass
class YieldRun:
    """A finished search: the yield point, the record of the replay and what the program chose."""

    yield_point: YieldPoint
    state: State
    record: Record | None
    steps: int
    time_step: float
    critical_time_step: float
    unbalanced: float
    settings: dict = field(default_factory=dict)


def new_record(rows: int, frames: int, n_block: int, n_joint: int, n_jack: int, every: int = 1) -> Record:
    """Room for ``rows`` rows of history and ``frames`` frames, one frame every ``every`` rows."""
    return Record(
        every=np.array([1, every], np.int64),
        count=np.zeros(2, np.int64),
        row=np.empty((rows, 6)),
        actuator=np.empty((rows, n_jack)),
        joint=np.empty((rows, n_joint, 7)),
        frame_time=np.empty(frames),
        frame_displacement=np.empty((frames, n_block, 3)),
        frame_orientation=np.empty((frames, n_block, 4)),
    )


def _single_joint(state: State):
    """(family, index, friction) of the one joint of a scene, or None."""
    if len(state.joints.block_a) != 1:
        return None
    if state.points is not None:
        return 0, 0, float(state.points.friction[0])
    return 1, 0, float(state.areas.friction[0])


def _at_joint(state: State, wrench: np.ndarray) -> np.ndarray:
    """Force and moment (6,) at the centroid of b, as V_1, V_2, V_n, M_1, M_2, M_T about O in the joint's axes."""
    axes, arm = state.joints.axes[0], state.joints.arm_b[0]
    return np.concatenate([axes @ wrench[:3], axes @ (wrench[3:] - np.cross(arm, wrench[:3]))])


def _certificate(state: State, load: np.ndarray, tolerance: float) -> Certificate:
    """What the bracket needs, read off the seated state: strict where one joint carries a load without a normal part."""
    unit, dead, centre, radius, dead_gauge, strict = np.zeros(3), np.zeros(3), np.zeros(2), 1.0, 0.0, False
    normal, rest = 0.0, np.zeros(1)
    family = index = 0
    single = _single_joint(state)
    if single is not None:
        family, index, friction = single
        b = state.joints.block_b[0]
        at_joint = _at_joint(state, load[b])
        size = float(np.abs(at_joint[:2]).max())
        unit = at_joint[[0, 1, 5]]
        dead = _at_joint(state, np.concatenate([state.blocks.dead_force[b], state.blocks.dead_torque[b]]))[[0, 1, 5]]
        normal = float(state.joints.resultant[0, 0])
        if family == 0:
            p = state.points
            rest = p.normal.copy()
            weights = p.normal / p.normal.sum()
            centre = np.array([weights @ p.x_s, weights @ p.y_s])
            radius = limit_set.torsion_radius(p.x_s, p.y_s, weights)
            reach = float(np.hypot(p.x_s, p.y_s).max())
        else:
            radius, reach = float(state.areas.radius[0]), float(state.areas.reach[0])
        scale = max(size, abs(at_joint[5]) / reach)
        strict = abs(at_joint[2]) <= 1e-12 * scale
        if family == 0:
            strict = strict and float(np.abs(at_joint[3:5]).max()) <= 1e-12 * scale * reach
        if strict and friction > 0.0 and np.any(dead):
            dead_gauge = _dead_gauge(state, family, friction * normal, dead)
    return Certificate(
        strict=bool(strict),
        joint=0,
        family=family,
        index=index,
        unit=unit,
        dead=dead,
        dead_gauge=dead_gauge,
        centre=centre,
        radius=radius,
        normal=normal,
        rest=rest,
        tolerance=tolerance,
        bracket=np.array([0.0, NEVER]),
        window=np.tile([0.0, NEVER], (WINDOW, 1)),
    )


def _dead_gauge(state: State, family: int, strength: float, dead: np.ndarray) -> float:
    """Upper bound of the gauge of the tangential dead load in the limit set, at the seated state.

    Points: the largest utilisation of a point, because the seated forces are one way to carry the load. Convex: exact.
    """
    if family == 1:
        a = state.areas
        f = dead / strength
        return gauge(
            a.x, a.y, 0, a.x.size, a.area[0], a.reach[0], a.far[0], f[0], f[1], f[2], 0.0, 0.0, 0.0, False
        )[0]  # fmt: skip
    p = state.points
    closed = p.normal > 0.0
    return float((np.hypot(p.elastic_1, p.elastic_2)[closed] / (p.friction[0] * p.normal[closed])).max())


def _drive(state: State, certificate: Certificate, load, stiffness, dt: float) -> Drive:
    """Jack stiffness and rate from the joint's elastic compliance along the load and a rough strength."""
    free = state.blocks.free
    compliance = sum(float(load[b] @ np.linalg.solve(stiffness[b], load[b])) for b in free)
    total = float(np.abs(state.jacks.weight).sum())
    rough = _rough_strength(state, certificate, load)
    k = JACK * total / compliance
    return Drive(
        rate=SLIP_PER_STEP * rough * compliance / total / dt,
        ramp=RAMP * dt,
        stiffness=k,
        dashpot=VISCOUS * k * dt,
        viscous_n=VISCOUS,
        viscous_s=VISCOUS,
        longest=1e9,
    )


def _rough_strength(state: State, certificate: Certificate, load: np.ndarray) -> float:
    """A scale for V, right to a factor of a few: what it takes to slide and twist the joints of the loaded blocks."""
    capacity, lever = 0.0, 0.0
    loaded = set(state.jacks.block.tolist())
    for family in (state.points, state.areas):
        if family is None:
            continue
        for i, j in enumerate(family.joint):
            if loaded & {int(state.joints.block_a[j]), int(state.joints.block_b[j])}:
                capacity += max(family.friction[i], 1e-3) * state.joints.resultant[j, 0]
    if certificate.strict:
        unit = certificate.unit
        return capacity / (float(np.hypot(unit[0], unit[1])) + abs(float(unit[2])) / certificate.radius)
    sizes = [np.linalg.norm(state.joints.arm_a, axis=1).max(), np.linalg.norm(state.joints.arm_b, axis=1).max()]
    lever = max(max(sizes), 1e-300)
    moments = load[:, 3:] / lever
    return capacity / max(float(np.linalg.norm(load[:, :3], axis=1).max()), float(np.linalg.norm(moments, axis=1).max()))


def find_yield_point(assembly, tolerance: float, step_factor: float, record_rows: int = 0) -> YieldRun:
    """Replay the scenario of ``assembly`` until the bracket of V is within ``tolerance`` of it.

    ``step_factor`` is the time step over the critical one. ``record_rows`` > 0 asks for a record. Raises
    NotConvergedError, with the best bracket, where the tolerance is not reached, and DivergedError.
    """
    state = initial_state(assembly)
    stiffness, factor = block_stiffness(state)
    unbalanced = seat(state, stiffness, factor)
    load = load_vectors(state)
    certificate = _certificate(state, load, tolerance)
    names = tuple(assembly.names)

    # The undamped frequencies of the scaled blocks all are eta / dt; dashpots and jack count in the critical step:
    # eta_cr = 2 / sqrt((1 + 2 viscous) (1 + jack)).
    dt = assembly.reference_time_step * step_factor
    critical = dt / step_factor
    eta_critical = 2.0 / np.sqrt((1.0 + 2.0 * VISCOUS) * (1.0 + JACK))
    eta = step_factor * eta_critical
    inertia = ScaledInertia(scaled_inverse(state, stiffness * factor[:, None, None]) * (eta / dt) ** 2)
    drive = _drive(state, certificate, load, stiffness, dt)

    record = None
    if record_rows:
        record = new_record(record_rows, record_rows, len(names), len(state.joints.block_a), len(state.jacks.block))
    single = _single_joint(state)
    if single is not None and single[2] == 0.0 and np.any(certificate.unit):
        certificate.bracket[:] = 0.0
        status, steps = CONVERGED, 0
    else:
        status, steps = RUNNING, 0
        while status == RUNNING and steps < MOST_STEPS:
            status, steps = advance(
                steps, CHUNK, dt, *state, inertia, None, drive, certificate, record
            )  # fmt: skip
            drive = drive._replace(rate=0.5 * drive.rate)
    run = YieldRun(
        yield_point=_yield_point(state, certificate, names),
        state=state,
        record=record,
        steps=steps,
        time_step=dt,
        critical_time_step=critical,
        unbalanced=unbalanced,
        settings={
            "rate": drive.rate,
            "jack_stiffness": drive.stiffness,
            "jack_dashpot": drive.dashpot,
            "viscous": VISCOUS,
            "eta": float(eta),
        },
    )
    return run


def _yield_point(state: State, certificate: Certificate, names) -> YieldPoint:
    lower, upper = (float(v) for v in certificate.bracket)
    j = int(np.argmax(state.joints.resultant[:, 6]))
    resultant = state.joints.resultant[j]
    twist = state.joints.step[j]
    if state.areas is not None and j in state.areas.joint:
        twist = state.areas.twist[int(np.flatnonzero(state.areas.joint == j)[0])]
    v, w = float(np.hypot(twist[0], twist[1])), abs(float(twist[2]))
    reach = 0.1
    mechanism = "torsion-shear"
    centre = None
    if w * reach <= 1e-9 * v:
        mechanism = "sliding"
    else:
        centre = (float(-twist[1] / twist[2]), float(twist[0] / twist[2]))
        if v <= 1e-9 * w * reach:
            mechanism = "torsion"
    return YieldPoint(
        V=0.5 * (lower + upper),
        V_lower=lower,
        V_upper=upper,
        bracket="certified" if certificate.strict else "indicator",
        V_peak=float(state.jacks.drive[3]),
        displacement_at_peak=float(state.jacks.drive[4]),
        jack_load=float(state.jacks.drive[2]),
        V_1=float(resultant[1]),
        V_2=float(resultant[2]),
        M_T=float(resultant[3]),
        N=float(resultant[0]),
        displacement=float(state.jacks.drive[1]),
        torsion_centre=centre,
        mechanism=mechanism,
        joint=(names[state.joints.block_a[j]], names[state.joints.block_b[j]]),
    )
