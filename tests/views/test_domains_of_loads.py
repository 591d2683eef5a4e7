"""Domains in figures follow the load of their points: its direction in the joint, and the point where N acts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dembrick import cli, history
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.model import Load
from dembrick.views import plot
from helpers.one_joint import MU, A, B, N, scene, single
from helpers.scenario_text import block, header, jack

BESIDE = (0.0487, 0.0325)  # m: within the core, also that of the corners, so that nothing opens


def pushed(path, formulation="concave", jack=(0.075, 0.0), direction=(0.0, 1.0, 0.0), centre=(0.0, 0.0), z=0.0, **law):
    """Run a search with a jack at a point of the joint, under N at ``centre``."""
    given = scene(formulation, jacks=single(jack, direction, z))
    given = dataclasses.replace(
        given, loads=(Load("upper", (0.0, 0.0, -N), (*centre, 0.05)),), joint=dataclasses.replace(given.joint, **law)
    )
    simulate(given, path)
    return path


def shown(path):
    """Axes of the figure, row of its point (V, M_T), and the relative distance of the point outside the curve of its
    formulation."""
    with history.read(path) as found:
        (row,) = plot.domain_points([found])
        axes = plot.domains([found]).axes[0]
    (curve,) = (line.get_xydata() for line in axes.lines if row["formulation"] == line.get_label().split(",")[0])
    (mark,) = (own for own in axes.containers if own.get_label().startswith("DEM"))
    scale = np.abs(curve).max(axis=0)
    (x, y), own = mark[0].get_xydata()[0] / scale, curve / scale
    reach = np.interp(np.arctan2(y, x), np.arctan2(own[:, 1], own[:, 0]), np.hypot(*own.T))
    return axes, row, np.hypot(x, y) / reach - 1.0


@pytest.mark.parametrize(
    "load",
    [
        {"jack": (0.0, 0.075), "direction": (1.0, 0.0, 0.0)},
        {"jack": (0.05, 0.04), "direction": (0.8, 0.6, 0.0)},
        {"centre": BESIDE},
        {"centre": BESIDE, "jack": (-0.075, 0.02), "direction": (-0.6, 0.8, 0.0)},
        {"centre": BESIDE, "formulation": "corrected-shear"},
        {"centre": BESIDE, "formulation": "distributed"},
        {"centre": (0.08, 0.03), "formulation": "convex", "pressure": "linear"},
    ],
)
def test_a_certified_point_lies_on_the_curve_of_its_formulation(tmp_path, load):
    axes, row, off = shown(pushed(tmp_path / "run.h5", **load))
    assert abs(off) < 2e-3
    assert row["eccentricity"] == pytest.approx(load.get("centre", (0.0, 0.0)), abs=1e-6)
    x, y, _ = load.get("direction", (0.0, 1.0, 0.0))
    angle = np.degrees(np.arctan(y / x)) if x else 90.0
    named = {0.0: "along $t_1$", 90.0: "along $t_2$"}.get(angle, f"at {angle:.3g}° from $t_1$")
    assert axes.get_xlabel() == f"V {named} [N]"
    assert ("mm, friction" in axes.get_title()) == ("centre" in load)


def test_corners_under_n_beside_the_middle_turn_as_they_are_pressed(tmp_path):
    """The torsion strength of four corners pressed by N / 4 (1 + 4 e_1 x / a^2 + 4 e_2 y / b^2) is the minimum over
    all centres of rotation."""
    axes, _, _ = shown(pushed(tmp_path / "run.h5", centre=BESIDE))
    (curve,) = (line.get_xydata() for line in axes.lines if line.get_label() == "concave")
    corners = 0.5 * np.array([[-A, -B], [A, -B], [A, B], [-A, B]])
    bearing = MU * N / 4.0 * (1.0 + 4.0 * corners @ (np.array(BESIDE) / [A * A, B * B]))
    x, y = np.meshgrid(np.linspace(-A / 2, A / 2, 601), np.linspace(-B / 2, B / 2, 401))
    couple = sum(own * np.hypot(x - r[0], y - r[1]) for own, r in zip(bearing, corners, strict=True)).min()
    assert bearing.min() > 0.0 and curve[-1] == pytest.approx([0.0, couple], rel=1e-4, abs=1e-9)


def test_n_is_where_it_was_before_a_load_above_the_joint(tmp_path):
    """The eccentricity of N excludes the shift V z / N from a jack at height z, which is reported separately."""
    _, row, _ = shown(pushed(tmp_path / "run.h5", "convex", centre=(0.02, 0.01), z=0.05))
    assert row["eccentricity"] == pytest.approx((0.02, 0.01), abs=1e-6) and row["load_height"] == pytest.approx(0.05)


def test_loads_with_one_curve_share_a_figure_and_others_are_refused(tmp_path, capsys):
    ways = {"along": (0.0, 1.0, 0.0), "back": (0.0, -1.0, 0.0), "across": (1.0, 0.0, 0.0)}
    runs = {name: str(pushed(tmp_path / f"{name}.h5", direction=way)) for name, way in ways.items() if name != "across"}
    runs["across"] = str(pushed(tmp_path / "across.h5", jack=(0.0, 0.075), direction=ways["across"]))
    runs["beside"] = str(pushed(tmp_path / "beside.h5", centre=BESIDE))
    runs["mirror"] = str(pushed(tmp_path / "mirror.h5", centre=(BESIDE[0], -BESIDE[1])))
    to = ["--to", str(tmp_path / "f.png"), "--force"]
    for one, other in (("along", "back"), ("beside", "mirror")):
        assert cli.main(["plot", runs[one], runs[other], "--kind", "domain", *to]) == 0
    for other, said in (("across", "its V acts along $t_1$ and its N in the middle"), ("beside", "at (48.7, 32.5) mm")):
        capsys.readouterr()
        assert cli.main(["plot", runs["along"], runs[other], "--kind", "domain", *to]) == 2
        told = capsys.readouterr().err
        assert said in told and "--kind path" in told
    with history.read(runs["along"]) as one, history.read(runs["across"]) as two, pytest.raises(ScenarioError):
        plot.interaction([one, two])
    assert cli.main(["yield", runs["across"], "--plot", str(tmp_path / "g.png"), "--force"]) == 0


def test_a_bond_that_may_break_under_n_beside_the_middle_is_left_to_paths(tmp_path):
    """While it is bonded, corners may be in tension, which the curve does not assume: the domain is refused."""
    path = pushed(tmp_path / "run.h5", centre=BESIDE, cohesion=1e4)
    with history.read(path) as found, pytest.raises(ScenarioError, match="use --kind path"):
        plot.domains([found])


def test_the_scaled_figure_has_the_direction_and_the_place_of_n_too(tmp_path):
    path = pushed(tmp_path / "run.h5", jack=(0.05, 0.04), direction=(0.8, 0.6, 0.0), centre=BESIDE)
    with history.read(path) as found:
        axes = plot.interaction([found]).axes[0]
    (curve,) = (line.get_xydata() for line in axes.lines if line.get_label() == "concave")
    (mark,) = (own[0].get_xydata()[0] for own in axes.containers if own.get_label().startswith("DEM"))
    reach = np.interp(np.arctan2(*mark[::-1]), np.arctan2(curve[:, 1], curve[:, 0]), np.hypot(*curve.T))
    assert np.hypot(*mark) == pytest.approx(reach, rel=2e-3)
    assert "shear at 36.9° from $t_1$, N at (48.7, 32.5) mm" in axes.get_title()


def test_n_is_where_it_is_in_the_row_of_the_yield_point(tmp_path):
    """A jack that presses as it pushes, beside the middle, and more at the greatest V than at the end of its way back:
    N = W + c V acts at y c V / N."""
    y, c, W = 0.05, 0.5, 0.4 * 0.4 * 0.1 * 2000.0 * 9.81
    text = header("concave", 0.3, 1e10) + block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true")
    text += block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1)) + jack("stone", (0.0, y, 0.0), (1.0, 0.0, -c))
    control = "large_displacements = true\nprotocol = [2e-5, -1e-5]\n"
    simulate(toml.loads(text + f'[control]\nkind = "displacement"\n{control}'), tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as run:
        (row,) = plot.domain_points([run])
    pressed = c / np.hypot(1.0, c) * row["V"]
    assert row["V"] < 0.0 and row["N"] == pytest.approx(W + pressed, rel=1e-6)
    assert row["eccentricity"] == pytest.approx((0.0, y * pressed / row["N"]), abs=1e-6)
