"""Outcome of a run in real time: greatest displacements, fallen blocks, and the record of a collapse."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.dynamics.record import Extremes as Noted
from dembrick.simulation.dynamics.dead_load import unsupported
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.pushover import PushController
from dembrick.simulation.dynamics.state import seen

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.scenario.controls import Control
    from dembrick.scenario.stages import TiesBefore

MOVED = 0.1  # of the longest displacement: blocks that have moved further belong to the mechanism
DROPPED = 0.5  # of a block's least dimension: a block that has dropped by more has fallen
TURNED_OVER = math.cos(math.radians(45.0))  # cosine of the angle between a block's initial vertical and its present one
STILL = 1e-12  # of a rotation: rounding
PEAK_TENSIONS = "extremes.tension"  # name in checkpoints of the greatest tensions of ties, whose number may change
CARRIED = 20.0  # factor on `OFF_BALANCE` if supports move, as they accelerate standing blocks
MOVES = 0.01  # of sqrt(g d), d a block's least dimension: a lower speed, which lifts it by d / 20000, counts as rest
OFF_BALANCE = 1e-3  # of gravity: blocks whose mean acceleration stays above it have begun to fall


@dataclass
class Extremes:
    """The greatest values of a run so far, which every row updates in the arrays of ``noted`` (`write_row`).

    ``calm`` (n,): last time (s) at which the mean acceleration of each block was below half of the threshold, if
    supports move (`look`); ``apart`` (1,): the time between rows (s).
    """

    noted: Noted
    calm: np.ndarray
    apart: np.ndarray

    @classmethod
    def of(cls, moving: Motion) -> Extremes:
        n, tie = len(moving.assembly.names), len(moving.state.ties.stiffness)
        return cls(Noted(
            furthest=np.zeros(n),
            quiet=np.zeros(n),
            last=np.zeros((n + 1, 3)),
            tension=np.full(tie, -math.inf),
            turned=np.ones(n),
            threshold=np.array([OFF_BALANCE * float(np.linalg.norm(moving.assembly.gravity))]),
            upright=moving.upright,
        ), np.zeros(n), np.zeros(1))  # fmt: skip

    def look(self, moving: Motion, take: Callable[[], None]) -> None:
        """Record a row by ``take``, and update ``calm``; blocks that have fallen do not count as calm any more."""
        bodies, last, time = moving.state.bodies, self.noted.last, moving.time
        passed = time - float(last[-1, 0])
        if passed > 0.0:
            self.apart[0] = passed
            speeds_up = np.linalg.norm(bodies.velocity - last[:-1], axis=1) / passed
            self.calm[speeds_up <= 0.5 * self.noted.threshold[0]] = time
        take()
        last[:-1][fallen(moving)] = math.nan

    @property
    def turn(self) -> np.ndarray:
        """The greatest rotation of each block so far (n,), rad."""
        return 2.0 * np.arccos(np.minimum(self.noted.turned, 1.0))

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays for a restart."""
        kept = {name: getattr(self.noted, name) for name in ("furthest", "quiet", "last", "turned", "upright")}
        kept |= {"calm": self.calm, "apart": self.apart}
        return {PEAK_TENSIONS: self.noted.tension} | {f"extremes.{name}": array for name, array in kept.items()}

    def go_on_with(self, peaks: np.ndarray, before: TiesBefore) -> None:
        """Copy the greatest tensions (N) of ties that are kept from the ``peaks`` of the run before."""
        old = np.array(before.of, np.int64)
        self.noted.tension[old >= 0] = peaks[old[old >= 0]]


def fallen(moving: Motion) -> np.ndarray:
    """Which blocks (n,) have fallen: their centroid has dropped along gravity by more than half of the least
    dimension of the block, or their initial vertical has tilted by more than 45 deg.

    If supports have moved, motion is measured relative to each of them, as if it had carried all blocks along: a block
    that has dropped or turned with any support has not fallen.
    """
    assembly, bodies = moving.assembly, moving.state.bodies
    weight, free = float(np.linalg.norm(assembly.gravity)), ~np.asarray(assembly.fixed)
    if not weight > 0.0:
        return np.zeros(len(assembly.names), bool)
    down = np.asarray(assembly.gravity, float) / weight
    upright, away, found = rotation_matrix(moving.upright), moving.displacement, free.copy()
    line = np.einsum("nij,i->nj", upright, down)  # of the start, in body axes
    for carried, turn in _carried(moving, upright):
        dropped = (away - carried) @ down > DROPPED * assembly.least_size
        turned = np.einsum("nij,nj,i->n", bodies.rotation, line, turn @ down) < TURNED_OVER
        found &= dropped | turned
    return found


def speed_at_the_end(moving: Motion) -> float:
    """The greatest speed (m/s) of any point of a free block, relative to the supports; zero if all are at rest."""
    assembly, bodies = moving.assembly, moving.state.bodies
    speed = np.linalg.norm(bodies.velocity, axis=1) + np.linalg.norm(bodies.spin, axis=1) * bodies.reach
    moves = speed > MOVES * np.sqrt(float(np.linalg.norm(assembly.gravity)) * assembly.least_size)
    return float(speed[moves & ~np.asarray(assembly.fixed)].max(initial=0.0))


def places(bodies: Bodies) -> np.ndarray:
    """Centroid of every block and its axes scaled by its reach (n, 4, 3), m, so that rotations count as displacements
    too."""
    axes = bodies.reach[:, None, None] * np.swapaxes(bodies.rotation, 1, 2)
    return np.concatenate([bodies.position[:, None], axes], axis=1)


def moved(now: np.ndarray, before: np.ndarray) -> np.ndarray:
    """How far every block (n,) has moved or turned between two `places`, m."""
    return np.linalg.norm(now - before, axis=2).max(axis=1)


def standing(bodies: Bodies, kept: Mapping[str, np.ndarray] | None = None) -> Bodies:
    """The blocks at their present positions, or at those ``kept`` earlier."""
    kept = kept or {"bodies.position": bodies.position.copy(), "bodies.rotation": bodies.rotation.copy()}
    return bodies._replace(position=kept["bodies.position"], rotation=kept["bodies.rotation"])


def _carried(moving: Motion, upright: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Displacements (n, 3) and rotation (3, 3) of all blocks if they had moved with each support as a rigid body; one
    entry for all supports that have not moved. ``upright`` (n, 3, 3): rotations of the start."""
    fixed, bodies, away = np.flatnonzero(moving.assembly.fixed), moving.state.bodies, moving.displacement
    turn = bodies.rotation[fixed] @ np.swapaxes(upright[fixed], 1, 2)
    still = (away[fixed] == 0.0).all(axis=1) & (np.abs(turn - np.eye(3)).max(axis=(1, 2)) < STILL)
    rides = [(np.zeros(3), np.eye(3))] if still.any() or not len(fixed) else []
    for i, rotation in zip(fixed[~still], turn[~still], strict=True):
        arm = bodies.start - bodies.start[i]
        rides.append((away[i] + arm @ (rotation - np.eye(3)).T, rotation))
    return rides


def collapse_of(
    moving: Motion, control: Control, controller: PushController | None, at_rest: np.ndarray, extremes: Extremes
) -> dict:
    """Record of a collapse, the object ``collapse`` of the JSON output.

    ``angle`` (deg): that at which a block has moved by ``displacement`` (m); ``onset``: that at which the first of
    the ``blocks`` that fell lost its balance for good; both None for a push, whose load factor is its peak.
    """
    away = np.linalg.norm(moving.displacement, axis=1)
    time, worst = float(moving.time), float(away.max())
    blocks = np.flatnonzero(away > MOVED * worst)
    angle = control.rate * time if controller is None else None
    return {
        "angle": angle,
        "onset": control.rate * float(extremes.noted.quiet[blocks].min()) if controller is None else None,
        "load_factor": math.tan(math.radians(angle)) if controller is None else float(controller.peak[0]),
        "time": time,
        "displacement": worst,
        "mechanism": mechanism(moving, at_rest),
        "blocks": [moving.assembly.names[i] for i in blocks],
        "error_estimate": None,
    }


def collapse_of_settlement(moving: Motion, driving: Driving, at_rest: np.ndarray, extremes: Extremes) -> dict:
    """Record of a collapse while supports moved in real time, with the ``settlement`` (m) of the supports at the time
    ``onset`` (s), when the first of the blocks that fell lost its balance for good.

    The block accelerates gradually. The settlement is extrapolated linearly from those at half of the threshold and at
    the whole; its error (``settlement_range``) is the extrapolation plus the motion of the supports between rows. For
    blocks that never were calm only the fall itself is known.
    """
    away = np.linalg.norm(moving.displacement, axis=1)
    blocks = np.flatnonzero(fallen(moving))
    first = blocks[np.argmin(extremes.noted.quiet[blocks])]
    onset = float(extremes.noted.quiet[first])
    times = np.array([onset, min(onset, extremes.calm[first])]) if onset > 0.0 else np.array([moving.time, 0.0])
    whole, half, later = driving.share(np.append(times, times[0] + extremes.apart[0])) * driving.supports.length
    back = min(float(whole - half), 0.5 * float(whole))
    settlement = max(float(whole) - 2.0 * back, back)  # half of the whole, +- as much, if blocks never were calm
    off = back + float(later - whole)
    return settlement_collapse(moving, at_rest, blocks) | {
        "onset": onset,
        "settlement": settlement,
        "settlement_range": [max(settlement - off, 0.0), settlement + off],
        "time": float(moving.time),
        "displacement": float(away[blocks].max()),
    }


def settlement_collapse(moving: Motion, before: np.ndarray, blocks: np.ndarray) -> dict:
    """Record of the collapse of ``blocks`` (k,) from the joint positions ``before`` (j, 9, of `seen`).

    ``hinges``: the joints that turn by more than a tenth of the greatest rotation; none if joints slide
    and their rims move less than a tenth of that by turning.
    """
    links, names = moving.state.links, moving.assembly.names
    moves = _moves(moving, before)
    turn = moves[:, 1] / links.reach
    opens = moves[:, 1] > MOVED * moves.max(initial=0.0)
    hinges = np.flatnonzero((turn > MOVED * turn.max(initial=0.0)) & opens.any())
    return {
        "angle": None,
        "load_factor": None,
        "time": None,
        "mechanism": mechanism(moving, before),
        "blocks": [names[i] for i in blocks],
        "hinges": [f"{names[links.host[j]]} / {names[links.other[j]]}" for j in hinges],
        "error_estimate": None,
    }


def mechanism(moving: Motion, at_rest: np.ndarray) -> str:
    """Mechanism of the joint that moved most since ``at_rest`` (j, 9, of `seen`): sliding, rocking, torsion, uplift;
    crushing if the rim of a joint that crushes has sunk further than it has tilted.

    Uplift of a pair of blocks is the least opening of their joints: a block made of parts has several, and opens all
    but one when it rocks. A joint that opens because its blocks slide apart on others is no uplift: one of the two
    must hang on no joint that carries a force.
    """
    moves, laws, links = _moves(moving, at_rest), moving.assembly.joints.law, moving.state.links
    if not len(moves):
        return "uplift"  # there are no joints
    sunk = moves[:, 1] - moves[:, 3]  # a joint that rocks on its rim sinks nowhere
    crushed = max((sunk[j] for j, law in enumerate(laws) if law.compressive_strength is not None), default=0.0)
    pairs = np.sort(np.column_stack([links.host, links.other]), axis=1)
    _, pair = np.unique(pairs, axis=0, return_inverse=True)
    lifted = np.full(len(pairs), np.inf)
    np.minimum.at(lifted, pair.ravel(), moves[:, 3])
    floats = unsupported(moving.state, links.wrench[:, :3].any(axis=1))
    moves[:, 3] = np.where(floats[links.host] | floats[links.other], lifted[pair.ravel()], 0.0)
    names = "sliding", "rocking", "torsion", "uplift", "crushing"
    return max(zip([*moves.max(axis=0), crushed], names, strict=True))[1]


def moved_most(moving: Motion, at_rest: np.ndarray) -> int:
    """The number of the joint that moved most since ``at_rest``, zero if there are none."""
    moves = np.abs(_moves(moving, at_rest)).max(axis=1)
    return int(np.argmax(moves)) if len(moves) else 0


def _moves(moving: Motion, at_rest: np.ndarray) -> np.ndarray:
    """How far every joint has slid since ``at_rest``, its rim has tilted and turned about its normal, and it has opened
    at O (j, 4) m.

    Slip is measured at the last corner in contact: if a block overturns about an edge, O moves and the edge stays.
    """
    links = moving.state.links
    now = seen(moving.state.bodies, links)
    turn = _axes(now) @ np.swapaxes(_axes(at_rest), 1, 2)
    twist = np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])
    rocked = links.reach * np.sqrt(2.0 * np.maximum(1.0 - turn[:, 2, 2], 0.0))
    twisted = links.reach * 2.0 * np.abs(np.sin(0.5 * twist))
    slid = np.zeros(len(now))
    for joints, outlines in moving.polygons.outlines():
        drawn = outlines - moving.polygons.shift[joints, None]  # from O of now
        corners = np.concatenate([drawn, np.zeros((*drawn.shape[:2], 1))], axis=2)
        arm, before = (np.einsum("jik,jmk->jmi", _axes(found[joints]), corners) for found in (now, at_rest))
        height = now[joints, None, 2] + arm[..., 2] - links.offset[joints, None]
        pressed = np.arange(len(joints)), np.argmin(links.sense[joints, None] * height, axis=1)
        way = (now - at_rest)[joints, :2] + (arm - before)[pressed][:, :2]
        x, y = before[pressed][:, :2].T
        c, s = np.cos(twist[joints]) - 1.0, np.sin(twist[joints])
        slid[joints] = np.hypot(way[:, 0] - (c * x - s * y), way[:, 1] - (s * x + c * y))
    return np.column_stack([slid, rocked, twisted, links.sense * (now - at_rest)[:, 2]])


def opened(moving: Motion) -> bool:
    """Whether any corner of a joint without tensile strength is open."""
    links, laws = moving.state.links, moving.assembly.joints.law
    now, holds = seen(moving.state.bodies, links), np.array([law.tensile_strength > 0.0 for law in laws], bool)
    for joints, outlines in moving.polygons.outlines():
        drawn = outlines - moving.polygons.shift[joints, None]  # from O of now
        rise = np.einsum("jk,jmk->jm", _axes(now[joints])[:, 2, :2], drawn)
        gap = links.sense[joints, None] * (now[joints, None, 2] + rise - links.offset[joints, None])
        if (gap[~holds[joints]] > 0.0).any():
            return True
    return False


def _axes(found: np.ndarray) -> np.ndarray:
    """Axes of the host's face in those of the plane (j, 3, 3), columns, of `seen` (j, 9)."""
    first, second = found[:, 3:6], found[:, 6:9]
    return np.stack([first, second, np.cross(first, second)], axis=2)
