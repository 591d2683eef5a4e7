"""Figures of paths of joints: all of each path is in the picture, and what differs between runs is told of each."""

import numpy as np
import pytest

from dembrick.views import plot
from helpers import history_cases as cases

CHANNELS = ("joints", "energy")


@pytest.fixture
def loaded(tmp_path):
    """A history of two blocks whose joint carried N, V_1, V_2 and M_T, numbers or series of nine rows."""
    made = []

    def load(N=500.0, V_1=0.0, V_2=0.0, M_T=0.0, **options):
        rows = cases.record(0, 9)
        rows["joint"] = np.zeros((9, 1, 7))
        for i, own in enumerate((N, V_1, V_2, M_T)):
            rows["joint"][:, 0, i] = own
        made.append(cases.written(tmp_path / f"run{len(made)}.h5", rows, channels=CHANNELS, **options))
        return made[-1]

    yield load
    for one in made:
        one.close()


def test_what_is_pushed_to_and_fro_is_whole(loaded):
    to_and_fro = np.sin(np.linspace(0.0, 2.0 * np.pi, 9))
    run = loaded(V_2=100.0 * to_and_fro, M_T=7.0 * to_and_fro)
    axes = plot.load_path(run).axes[0]
    assert axes.get_xlim()[0] <= -100.0 and axes.get_ylim()[0] <= -7.0
    with_one_way = plot.load_path([loaded(V_2=np.arange(9.0)), run]).axes[0]
    assert with_one_way.get_xlim()[0] <= -100.0 and with_one_way.get_ylim()[0] <= -7.0
