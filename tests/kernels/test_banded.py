"""Gaussian elimination of band matrices against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from dembrick.kernels.math.banded import WIDE, eliminate, substitute


def stored(matrix, half_width):
    """The matrix as the kernels want it, and the h they are told."""
    n, h = len(matrix), half_width + WIDE - 1
    band = np.zeros((n, 3 * h + 1))
    for i in range(n):
        low, high = max(0, i - half_width), min(n, i + half_width + 1)
        band[i, low - i + h : high - i + h] = matrix[i, low:high]
    return band, h


@pytest.mark.parametrize("rows, half_width", [(6, 5), (60, 11), (120, 29)])
@pytest.mark.parametrize("diagonal", [0.0, 1.0, 100.0])  # rows are exchanged always, often, never
@pytest.mark.parametrize("at_once", [6, 18, 600])
def test_both_answers_are_those_of_the_dense_matrix(rows, half_width, diagonal, at_once):
    rng = np.random.default_rng(rows)
    matrix = rng.normal(size=(rows, rows))
    i, k = np.indices(matrix.shape)
    matrix[abs(i - k) > half_width] = 0.0
    matrix[np.diag_indices(rows)] *= diagonal
    given = rng.normal(size=(2, rows))
    band, h = stored(matrix, half_width)
    x, y = given.copy()
    for first in range(0, rows, at_once):
        assert eliminate(band, h, x, y, first, min(first + at_once, rows))
    substitute(band, h, x, y)
    expected = np.linalg.solve(matrix, given.T).T
    assert np.array([x, y]) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_a_singular_matrix_is_told():
    matrix = np.eye(12)
    matrix[7, 7] = 0.0
    band, h = stored(matrix, 5)
    assert not eliminate(band, h, *np.ones((2, 12)), 0, 12)
