"""Arrays as text that a page can carry."""

from __future__ import annotations

import base64

import numpy as np


def packed(values: np.ndarray, kind: str) -> str:
    """The bytes of an array of the type ``kind``, little-endian, in base64."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()
