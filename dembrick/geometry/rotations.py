"""Quaternions and rotation matrices in numpy: (w, x, y, z), from body axes to world axes."""

from __future__ import annotations

import numpy as np


def unit_quaternion(quaternion) -> np.ndarray:
    """The quaternion(s) (..., 4) scaled to length one."""
    q = np.asarray(quaternion, float)
    return q / np.sqrt((q * q).sum(axis=-1, keepdims=True))


def rotation_matrix(quaternion) -> np.ndarray:
    """Rotation matrix (..., 3, 3) of quaternion(s) (..., 4); its columns are the body axes in the world."""
    q = unit_quaternion(quaternion)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    found = np.empty((*w.shape, 3, 3))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            found[..., i, j] = entry
    return found


def rotation_quaternion(rotation) -> np.ndarray:
    """Quaternion(s) (..., 4) of the rotation vector(s) ``rotation`` (..., 3)."""
    rotation = np.asarray(rotation, float)
    half = 0.5 * np.sqrt((rotation**2).sum(axis=-1, keepdims=True))
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotation], axis=-1)


def turned_by(rotation, quaternion) -> np.ndarray:
    """Quaternion(s) (..., 4) of the rotation ``quaternion`` and then the rotation vector(s) ``rotation`` (..., 3)."""
    return quaternion_product(rotation_quaternion(rotation), quaternion)


def turning(quaternion, vectors) -> np.ndarray:
    """R v - v (..., 3) of unit quaternion(s) (..., 4) and vectors (..., 3), accurate for small rotations:
    2 w (u x v) + 2 u x (u x v)."""
    u, v = np.broadcast_arrays(quaternion[..., 1:], vectors)
    once = np.cross(u, v)
    return 2.0 * (quaternion[..., :1] * once + np.cross(u, once))


def rotation_vector(quaternion) -> np.ndarray:
    """The rotation vector(s) (..., 3) of unit quaternion(s) (..., 4), with an angle of at most pi (rad)."""
    quaternion = np.asarray(quaternion, float)
    w, v = quaternion[..., 0], quaternion[..., 1:]
    sine = np.sqrt((v * v).sum(axis=-1))
    half = np.arctan2(np.where(w < 0.0, -sine, sine), np.abs(w))
    return np.divide(2.0 * half, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)[..., None] * v


def frame_quaternion(axes) -> np.ndarray:
    """The quaternion (4,) of the frame whose first two axes, columns of its rotation matrix, are ``axes`` (2, 3).

    It is computed from its greatest component, to avoid cancellation.
    """
    R = np.column_stack([*axes, np.cross(*axes)])
    trace = np.trace(R)
    twice = np.array([trace, *(2.0 * np.diag(R) - trace)])  # 4 q^2 - 1
    i = int(np.argmax(twice))
    q = np.empty(4)
    if i == 0:
        q[:] = 1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    else:
        a, b, c = i - 1, i % 3, (i + 1) % 3
        q[0] = R[c, b] - R[b, c]
        q[1 + a], q[1 + b], q[1 + c] = 1.0 + twice[i], R[b, a] + R[a, b], R[c, a] + R[a, c]
    return unit_quaternion(q)


def quaternion_product(first, second) -> np.ndarray:
    """Quaternion(s) (..., 4) of the rotation ``second`` followed by the rotation ``first``."""
    a, b, c, d = (np.asarray(first, float)[..., i] for i in range(4))
    w, x, y, z = (np.asarray(second, float)[..., i] for i in range(4))
    found = np.empty((*np.broadcast_shapes(a.shape, w.shape), 4))
    found[..., 0] = a * w - b * x - c * y - d * z
    found[..., 1] = a * x + b * w + c * z - d * y
    found[..., 2] = a * y - b * z + c * w + d * x
    found[..., 3] = a * z + b * y - c * x + d * w
    return found
