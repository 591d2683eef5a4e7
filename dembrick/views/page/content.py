"""Data of a history for the scripts of a page: geometry and frames packed as float32, actuators, torsion centres."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import HistoryError
from dembrick.geometry.rotations import quaternion_product, rotation_matrix, rotation_vector
from dembrick.views import summary
from dembrick.views.motion import loads
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices
from dembrick.views.motion.frames import LAST, MECHANISM, START, ejected, frame_number
from dembrick.views.motion.joint_frames import CHANNELS
from dembrick.views.motion.joints import JointMotion
from dembrick.views.motion.magnification import automatic_magnification
from dembrick.views.page import choices, diagrams
from dembrick.views.page.choices import packed as _packed
from dembrick.views.plot.paths import JointPath, joint_path

if TYPE_CHECKING:
    from dembrick.history.reader import History

MOST_FRAMES = 240
MOST_BYTES = 8 << 20  # of packed frames
_MOST_USED = 200_000  # joints times frames up to which utilisation and slip are included
_LOOKS = 12  # number of frames, roughly, from which the upper end of the magnification slider is found
_BEYOND, _EARLIER = 5.0, 1e3  # end of the slider over its first value: at least, and at most for earlier frames
_FAR = 2.0  # times the size of the scene: a torsion centre further away means pure shear


class Frames(NamedTuple):
    """The frames of a page: their numbers (f,), time (f,) s, displacement (f, n, 3) m and rotation vectors (f, n, 3)
    since the start, world axes."""

    number: np.ndarray
    time: np.ndarray
    displacement: np.ndarray
    rotation: np.ndarray


def collect(history: History) -> dict:
    """All data that the scripts of a page need, as plain lists, numbers and base64."""
    frames = chosen_frames(history)
    body, blocks, starts = all_vertices(history)
    carried = CarriedPoints(history, body, blocks)
    vertices = np.einsum("nij,nj->ni", rotation_matrix(history.orientation0)[blocks], body)
    world = vertices + history.position0[blocks]
    if not len(world):
        raise HistoryError(f"{history.path}: nothing to draw, because its blocks have no corners")
    middle = 0.5 * (world.min(axis=0) + world.max(axis=0))
    shown = frame_number(history)
    moved = _moved(history, carried, blocks, frames.number.tolist(), shown)
    at = int(np.abs(frames.number - shown).argmin())
    colours = _colours(history, frames, moved, at)
    start = automatic_magnification(history, frames.number[: at + 1].tolist())  # without the fall after a limit
    path = recorded_path(history)
    record = diagrams.record_at(history, frames.time, moved)
    # driven by actuators, not by the weight of a tilted structure
    pushed = record.load is not None and record.diagram.unit == "N"
    before = history.status == START  # nothing has been computed yet
    return {
        "blocks": {
            "count": history.n_block,
            "fixed": [bool(fixed) for fixed in history.block_fixed],
            "vertexStart": _packed(starts, "<u4"),
            "vertices": _packed(vertices, "<f4"),
            "places": _packed(history.position0 - middle, "<f4"),
            "faces": _packed(_faces(history, starts), "<u4"),
            "displacement": _packed(frames.displacement, "<f4"),
            "rotation": _packed(frames.rotation, "<f4"),
        },
        "time": diagrams.listed(frames.time),
        "shown": at,
        "load": None if not pushed else [1.0] if before else diagrams.listed(record.load),
        "reach": 0.5 * float(np.linalg.norm(np.ptp(world, axis=0))),
        "most": max(_up_to(moved, at), 1e-30),
        "mostText": colours[0]["text"],
        "magnification": {"start": math.log10(start), "most": _most_magnified(history, frames.number[: at + 1], start)},
        "actuators": _arrows(history, loads.driven_loads(history) if pushed else [], middle),
        "loads": _arrows(history, loads.dead_loads(history), middle),
        "ties": [
            {"blocks": tie["blocks"].tolist(), "points": (tie["points"] - middle).tolist()} for tie in history.ties
        ],
        "centre": _centres(history, path, frames, middle, world, blocks),
        "curve": None if before else diagrams.curve(history, record),
        "path": None if path is None else diagrams.yield_domain(history, record, path),
        "colours": colours,
        "joints": choices.joints(history, record, path),
        "record": None if before else choices.record(history),
        "readout": [] if before else diagrams.readout(history, record, path),
    }


def _most_magnified(history: History, numbers: np.ndarray, start: float) -> float:
    """Upper end of the magnification slider, as a power of ten: above its first value ``start``, which suits the last
    frame. For equilibria it also makes earlier frames visible, in which the blocks have hardly moved."""
    early = numbers[1 :: max(1, len(numbers) // _LOOKS)].tolist() if history.counts_equilibria else []
    wanted = max((automatic_magnification(history, k) for k in early), default=1.0)
    return max(1.0, math.ceil(math.log10(max(_BEYOND * start, min(wanted, _EARLIER * start)))))


def chosen_frames(history: History) -> Frames:
    """Frames spread evenly over the run, including the first and the last, at most as many as a page should hold.

    Frames from the first one that is not finite on (a run that diverged) are left out.
    """
    frame_number(history, LAST)  # raises if there is nothing to draw
    most = int(np.clip(MOST_BYTES // (24 * max(1, history.n_block)), 2, MOST_FRAMES))
    even = np.linspace(0, history.n_frames - 1, min(most, history.n_frames)).round().astype(int)
    numbers = np.unique(np.append(even, frame_number(history)))
    back = history.orientation0 * np.array([1.0, -1.0, -1.0, -1.0])
    displacement, rotation = [], []
    for k in numbers.tolist():
        shift = history.frame("displacement", k)
        turned = rotation_vector(quaternion_product(history.frame("orientation", k), back))
        if not (np.isfinite(shift).all() and np.isfinite(turned).all()):
            break
        displacement.append(shift)
        rotation.append(turned)
    if not displacement:
        raise HistoryError(f"{history.path}: nothing to draw, because its frames hold no finite numbers")
    numbers = numbers[: len(displacement)]
    return Frames(numbers, history.frame_time[numbers], np.array(displacement), np.array(rotation))


def _moved(history: History, carried: CarriedPoints, blocks: np.ndarray, frames: list[int], limit: int) -> np.ndarray:
    """Greatest displacement (f,) m of a corner in each frame; after the limit, of the blocks that are not ejected."""
    gone, found = ejected(history)[blocks], []
    for k in frames:
        way = np.linalg.norm(carried.moved(Poses.read(history, k, k + 1))[0], axis=1)
        found.append(float(way.max(initial=0.0, where=~gone if k > limit else True)))
    return np.array(found)


def _faces(history: History, starts: list[int]) -> np.ndarray:
    """All faces in sequence: the number of corners, then the corners, numbered through all blocks."""
    found: list[int] = []
    for i, first in enumerate(starts[:-1]):
        for face in history.block_faces(i):
            if len(face) > 2:
                found += [len(face), *(first + corner for corner in face)]
    return np.array(found, np.int64)


def _arrow(history: History, load: loads.Load, middle: np.ndarray, most: float) -> dict:
    """Point and direction of a load. ``size``: relative to the largest of its kind. ``ends``: for the arrow of the load
    and for that of the opposite force, the shift along it from the point (m), and whether it begins there."""
    back = loads.arrow_place(history, load.block, load.arm, -load.way)
    return {
        "block": load.block,
        "point": (history.position0[load.block] + load.arm - middle).tolist(),
        "direction": load.way.tolist(),
        "size": load.size / most,
        "ends": [[place.shift, place.pulls] for place in (load.place, back)],
    }


def _arrows(history: History, given: list[loads.Load], middle: np.ndarray) -> list[dict]:
    most = max((load.size for load in given), default=0.0)
    return [_arrow(history, load, middle, most or 1.0) for load in given]


def _up_to(values: np.ndarray, at: int) -> float:
    """Upper end of a colour scale: the greatest of ``values`` (f, ...) up to frame ``at``, which is shown first. Later
    values, when blocks fall, would make all others look alike; they count only if all values up to then are zero."""
    return float(values[: at + 1].max(initial=0.0)) or float(values.max(initial=0.0))


def _end_of_scale(values: np.ndarray, at: int) -> str:
    """The length at the upper end of a colour scale; greater values have the last colour."""
    end = _up_to(values, at)
    return summary.length(end) + (" and more" if values.max(initial=0.0) > end else "")


def _colours(history: History, frames: Frames, moved: np.ndarray, at: int) -> list[dict]:
    """Quantities by which blocks can be coloured: name, label at the end of the scale, values (f, n) of the blocks.
    ``moved`` (f,) m: greatest displacement of a corner; ``at``: index of the frame that is shown first."""
    text = "the greatest velocity" if history.status == MECHANISM else f"{_end_of_scale(moved, at)} (a corner)"
    none = {"name": "none", "text": "", "values": None, "most": 1.0}
    if history.status == START:
        return [none]
    found = [{"name": "displacement", "text": text, "values": None, "most": 1.0}]
    if history.n_joint and history.has_joints and history.n_row and len(frames.number) * history.n_joint <= _MOST_USED:
        joints = JointMotion(history)
        now = joints.at(frames.number.tolist())
        slip = now.resultants[..., CHANNELS.index("slip")]
        for name, of_joint, most in (
            ("utilisation", now.utilisation, 1.0),
            ("slip", slip, _up_to(slip, at)),
        ):
            values = joints.greatest_of_blocks(of_joint)
            text = "1: slides or is a hinge" if name == "utilisation" else _end_of_scale(slip, at)
            values = _packed(np.minimum(values, 1e30), "<f4")
            found.append({"name": name, "text": text, "values": values, "most": most or 1.0})
    return [*found, none]


def recorded_path(history: History) -> JointPath | None:
    """The path of the joint that failed, None if no joint was recorded."""
    if not (history.n_joint and history.n_row and history.has_joints):
        return None
    return joint_path(history)


def _centres(
    history: History, path: JointPath | None, frames: Frames, middle: np.ndarray, world: np.ndarray, blocks: np.ndarray
) -> dict | None:
    """Torsion centres of the joint of ``path`` from frame to frame, in the scene at the start; they move with block a.

    None for frames between which nothing turned, or turned about a point far away.
    """
    if path is None or len(frames.number) < 2:
        return None
    size = float(np.ptp(world, axis=0).max())
    joint = history.joints[path.number]
    motion = JointMotion(history, path.number)
    places: list = [None]
    for k, since in zip(frames.number[1:], frames.number[:-1], strict=True):
        found = motion.torsion_centre(int(k), int(since))[0]
        near = np.isfinite(found).all() and np.hypot(*found) <= _FAR * size
        places.append((joint["origin"] + found @ joint["axes"][:2] - middle).tolist() if near else None)
    if not any(places):
        return None
    axis = joint["axes"][2]
    depth = float(np.ptp(world[(blocks == joint["block_a"]) | (blocks == joint["block_b"])] @ axis))
    return {"block": joint["block_a"], "axis": axis.tolist(), "length": 1.5 * depth, "places": places}
