"""The largest load of a run, of either sign, and its numbers in tables, however small or large."""

import numpy as np
import pytest

from dembrick.cli import yield_
from dembrick.views.motion.frames import peak_time
from dembrick.views.page import diagrams
from helpers import history_cases as cases


def test_the_frame_at_the_peak_is_that_of_the_largest_load_of_either_sign(tmp_path):
    rows = cases.record(0, 5) | {"load": np.array([0.0, 50.0, 0.0, -236.0, -100.0])}
    with cases.written(tmp_path / "run.h5", rows, cases.frames(0, 4)) as run:
        assert peak_time(run) == run.time[3]
        assert diagrams.thinned(run, 2).tolist() == [0, 3, 4]


def row(**numbers):
    point = {"V": 216.0, "V_lower": 216.0, "V_upper": 216.0, "V_peak": 216.0, "M_T": 16.2, "N": 467.0}
    told = {"history": "a.h5", "formulation": "convex", "digits_open": False}
    return told | point | numbers


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_the_table_of_yield_points_has_its_digits_and_columns(size):
    large = row(history="longer.h5", M_T=-39.397062823 * size, N=517.0 * size, V_peak=81.6 * size)
    head, first, second = yield_._text([row(), large], [("216 N", "sliding"), ("81.6 N", "torsion-shear")]).splitlines()
    numbers = second.split()
    assert float(numbers[-2]) == pytest.approx(large["M_T"], rel=1e-5)
    assert float(numbers[-3]) == pytest.approx(large["V_peak"], rel=1e-5)
    assert first.index("sliding") == second.index("torsion-shear") == head.index("mechanism")


def test_a_torsion_that_is_rounding_is_none():
    (_, line) = yield_._text([row(M_T=1e-14)], [("216 N", "sliding")]).splitlines()
    assert line.split()[-2:] == ["0", "sliding"]
