"""The elastic 6 x 6 stiffness of a closed joint, for both engines and all families."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def elastic_stiffness(shear: Sequence, normal: Sequence) -> np.ndarray:
    """Stiffness (..., 6, 6) against (d1, d2, dn, r1, r2, rn) of b at O in the axes of the joint.

    ``shear`` and ``normal``: sums, or integrals, of the spring stiffness times 1, x, y, x^2, y^2 and x y about O, each
    an array of the shape (...) or a number. A point at (x, y) moves by d1 - rn y and d2 + rn x along the joint, and by
    dn + r1 y - r2 x across it.
    """
    s, s_x, s_y, s_xx, s_yy, _ = shear
    n, n_x, n_y, n_xx, n_yy, n_xy = normal
    k = np.zeros((*np.shape(s), 6, 6))
    entries = (
        (0, 0, s), (1, 1, s), (0, 5, -s_y), (1, 5, s_x), (5, 5, s_xx + s_yy),
        (2, 2, n), (2, 3, n_y), (2, 4, -n_x), (3, 3, n_yy), (4, 4, n_xx), (3, 4, -n_xy),
    )  # fmt: skip
    for row, column, value in entries:
        k[..., row, column] = k[..., column, row] = value
    return k
