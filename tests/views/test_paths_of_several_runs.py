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


def test_what_differs_between_runs_is_told_of_each(loaded):
    grown = np.linspace(0.0, 1.0, 9)
    light = loaded(N=500.0, V_2=100.0 * grown, M_T=7.0 * grown)
    heavy = loaded(N=1000.0, V_1=-90.0 * grown, M_T=-6.0 * grown)
    figure = plot.load_path([light, heavy], ["light", "heavy"])
    (axes,) = figure.axes
    assert axes.get_title() == "joint lower/upper"
    assert axes.get_xlabel() == "shear force V [N]" and axes.get_ylabel() == "torsion [N m]"
    apart = [r"N = 500 N, V along $t_2$, torsion $M_T$", r"N = 1000 N, V along $-t_1$, torsion $-M_T$"]
    lines = {line.get_label(): line for line in axes.lines}
    assert {f"light, {apart[0]}", f"heavy, {apart[1]}"} <= set(lines)
    for name in ("concave", "convex, exact"):
        surfaces = [lines[f"limit surface, {name}: {own}"] for own in apart]
        for surface, N, look in zip(surfaces, (500.0, 1000.0), ("light", "heavy"), strict=True):
            assert surface.get_xdata()[0] == pytest.approx(0.64 * N, rel=1e-6)
            (of_run,) = (line for label, line in lines.items() if label.startswith(look))
            assert surface.get_color() == of_run.get_color()


def test_what_runs_share_is_told_once(loaded):
    grown = np.linspace(0.0, 1.0, 9)
    runs = [loaded(V_2=size * grown, M_T=-7.0 * grown) for size in (100.0, 50.0)]
    (axes,) = plot.load_path(runs, ["one", "other"]).axes
    assert axes.get_title() == "joint lower/upper, N = 500 N"
    assert axes.get_xlabel() == "shear force V along $t_2$ [N]" and axes.get_ylabel() == "torsion $-M_T$ [N m]"
    labels = [line.get_label() for line in axes.lines]
    assert sorted(labels) == ["limit surface, concave", "limit surface, convex, exact", "one", "other"]


def test_a_yield_point_is_where_its_joint_was(loaded):
    """At the end of a path to and fro, on the side of its last half; of another joint there is none."""
    to_and_fro = np.array([0.0, 0.5, 1.0, 0.5, 0.0, -0.4, -0.8, -0.9, -0.9])
    point = {"V": -90.0, "V_1": 0.0, "V_2": -90.0, "M_T": 6.3, "N": 500.0}
    run = loaded(V_2=100.0 * to_and_fro, M_T=-7.0 * to_and_fro, results={"yield_point": point})
    (star,) = (line for line in plot.load_path(run).axes[0].lines if line.get_label() == "yield point")
    assert star.get_xydata()[0] == pytest.approx([-90.0, -6.3])
    rows = cases.record(0, 5, 2, 0)
    told = {"blocks": cases.mixed_assembly(), "channels": CHANNELS}
    told |= {"results": {"yield_point": point | {"joint": ["lower", "upper"]}}}
    with cases.written(run.path.replace("run0", "two"), rows, **told) as two:
        drawn = [[line.get_label() for line in plot.load_path(two, joint=j).axes[0].lines] for j in (0, 1)]
    assert ["yield point" in own for own in drawn] == [True, False]


def test_a_yield_point_of_any_run_is_in_the_legend(loaded):
    grown = np.linspace(0.0, 1.0, 9)
    point = {"yield_point": {"V": 100.0, "V_1": 0.0, "V_2": 100.0, "M_T": 7.0, "N": 500.0}}
    runs = [loaded(V_2=50.0 * grown), loaded(V_2=100.0 * grown, M_T=7.0 * grown, results=point)]
    assert "yield point" in plot.load_path(runs).axes[0].get_legend_handles_labels()[1]
