"""Arrays for new contacts: convex parts of all blocks, scratch space for a contact surface, pairs."""

from __future__ import annotations

import functools

import numpy as np

from dembrick.geometry.shapes import parts_of
from dembrick.kernels.dynamics.contact_forces import Touching
from dembrick.kernels.dynamics.contact_surface import Parts, Scratch
from dembrick.kernels.joint.pressure import PATCHES, Pressed
from dembrick.simulation.dynamics.time_step import COARSE


def parts_table(shapes) -> Parts:
    """The convex parts of all blocks in the form that kernels need; equal shapes are stored once."""
    known: dict[tuple[int, int], tuple[int, int]] = {}
    vertices, normals, offsets = [], [], []
    vertex_start, face_start, vertex_count, face_count = [], [], [], []
    owner, centre, radius, inner = [], [], [], []
    rows = faces = 0
    for block, shape in enumerate(shapes):
        for number, (place, part) in enumerate(parts_of(shape)):
            key = (id(shape), number)
            if key not in known:
                known[key] = (rows, faces)
                vertices.append(part.vertices + place)
                normals.append(part.face_normals)
                offsets.append(part.face_offsets + part.face_normals @ place)
                rows, faces = rows + len(part.vertices), faces + len(part.faces)
            own = known[key]
            owner.append(block)
            vertex_start.append(own[0])
            face_start.append(own[1])
            vertex_count.append(len(part.vertices))
            face_count.append(len(part.faces))
            centre.append(place)
            radius.append(0.5 * part.diameter)
            inner.append(part.face_offsets.min())
    integers = (np.array(values, np.int64) for values in (owner, vertex_start, vertex_count, face_start, face_count))
    return Parts(
        *integers,
        vertex=np.concatenate(vertices),
        normal=np.concatenate(normals),
        offset=np.concatenate(offsets),
        centre=np.array(centre, float).reshape(-1, 3),
        radius=np.array(radius),
        inner=np.array(inner),
    )


def scratch_for(parts: Parts) -> Scratch:
    """Scratch space for the contact surface of any two of the parts."""
    faces, vertices = int(parts.face_count.max()), int(parts.vertex_count.max())
    patches = faces * faces
    corners = (
        6 * patches + 16 * faces + 64
    )  # a plane map of so many cells has at most six corners each, apart from its rim
    return Scratch(
        normal=np.zeros((2 * faces, 3)),
        offset=np.zeros(2 * faces),
        face=np.zeros(2 * faces, np.int64),
        flush=np.zeros(2 * faces),
        vertex=np.zeros((2 * vertices, 3)),
        turn=np.zeros((3, 3)),
        x=np.zeros(corners),
        y=np.zeros(corners),
        spare_x=np.zeros(corners),
        spare_y=np.zeros(corners),
        start=np.zeros(patches + 1, np.int64),
        frame=np.zeros((patches, 3, 4)),
        depth=np.zeros((patches, 4)),
        side=np.zeros((patches, 2), np.int64),
        sums=np.zeros((patches, 10)),
    )


def pressed_room(scratch: Scratch) -> Pressed:
    """Arrays for the pressure of one contact, with as many linear pieces as ``scratch`` has patches."""
    patches = len(scratch.depth)
    integers = (np.zeros(patches, np.int64) for _ in range(3))
    return Pressed(
        np.full(patches, PATCHES),
        *integers,
        x=np.zeros_like(scratch.x),
        y=np.zeros_like(scratch.y),
        spare_x=np.zeros(0),
        spare_y=np.zeros(0),
        centre=np.zeros((1, 2)),
        density=np.zeros((patches, 3)),
        reach=np.zeros(1),
        radius=np.zeros(1),
    )


def touching_pairs(parts: Parts, scratch: Scratch, free, pairs, joints, laws, ratio: float, hand_over=None) -> Touching:
    """Pairs (t, 2) of parts with their ``joints`` (t,; -1 for none) and ``laws``, without history.

    ``hand_over``: data of all joints for the handover: size and whether it is smaller than its face (j,), `seen` at
    the start (j, 9) and shift (j, 2).
    """
    pairs = np.asarray(pairs, np.int64).reshape(-1, 2)
    n = len(pairs)
    joints = np.asarray(joints, np.int64)
    size, partial, start, shift = hand_over or (np.ones(1), np.zeros(1, bool), np.zeros((1, 9)), np.zeros((1, 2)))
    return Touching(
        parts=parts,
        scratch=scratch,
        pressed=pressed_room(scratch),
        free=np.asarray(free, float),
        first=pairs[:, 0].copy(),
        second=pairs[:, 1].copy(),
        joint=joints,
        k_n=np.array([law.normal_stiffness for law in laws], float),
        k_s=np.array([law.shear_stiffness for law in laws], float),
        friction=np.array([law.friction_after for law in laws], float),
        cohesion=np.array([law.cohesion_after for law in laws], float),
        weight=(joints < 0).astype(float),
        size=size[joints],
        partial=partial[joints],
        crushes=np.array([(law.compressive_strength or np.inf) / law.normal_stiffness for law in laws], float),
        start=start,
        shift=shift,
        plane=np.full(n, -1, np.int64),
        elastic=np.zeros((n, 4)),
        stiffness=np.zeros((n, 2)),
        springs=np.zeros((n, 16)),
        **{name: np.zeros(n) for name in ("slack", "least", "deepest", "slip", "normal", "area")},
        **{name: np.zeros((n, 3)) for name in ("twist", "point", "axis", "force", "torque")},
        load=np.zeros(len(free)),
        bearable=np.full(len(free), 4.0),
        overloaded=np.zeros(1, np.int64),
        laws=np.zeros(1, np.int64),
        dashpot=dashpot_polynomial(ratio),
        room=np.zeros(1),
        trouble=np.zeros(1, np.int64),
    )


@functools.cache
def dashpot_polynomial(ratio: float) -> np.ndarray:
    """Dashpot over spring of a contact times its phase per step w dt (rad), as a polynomial (8,) in that phase; the
    last of the nine numbers is the greatest phase for which it holds, well within the stable range.

    The equation of `time_step.stepped_dashpots`, by its parameter s.
    """
    s = np.linspace(1e-3, 2.0, 2000)
    decay, damped = np.exp(-ratio * s), np.sqrt(1.0 - ratio * ratio)
    swing = np.sqrt(1.0 + decay**2 - 2.0 * decay * np.cos(damped * s))
    peak = int(np.argmax(swing))
    greatest = min(COARSE, 0.8 * swing[peak])
    held = slice(0, np.searchsorted(swing[: peak + 1], greatest))
    fit = np.polynomial.polynomial.polyfit(swing[held], (1.0 - decay[held] ** 2) / swing[held], 7)
    return np.append(fit, greatest)
