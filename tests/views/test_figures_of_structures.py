"""Figures and pages of arches and shaken blocks: quantities that tests of one joint or one actuator do not have."""

import math

import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import BaseMotionControl, DynamicControl
from dembrick.scenario.model import Block, Output, Scenario
from dembrick.scenario.time_functions import Sine
from dembrick.views import page, plot
from dembrick.views.plot.joint_plane import _used, joint_stages
from dembrick.views.plot.paths import joint_path
from helpers.places import SCENARIOS
from helpers.stone_scenes import law, of_stone

G = 9.81


@pytest.fixture(scope="module")
def arch(tmp_path_factory):
    path = tmp_path_factory.mktemp("arch") / "arch.h5"
    simulate(toml.load(SCENARIOS / "templates" / "arch.toml"), path)
    return str(path)


def blocks(*free: Block, control, friction=0.6, output=None) -> Scenario:
    floor = Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    return of_stone(law("concave", friction, 1e9), control, (floor, *free), output=output or Output())


def test_the_page_tells_the_greatest_displacement_of_the_run(tmp_path):
    """A block thrown upwards reaches v^2 / (2 g) and falls back to its place: the page gives both displacements."""
    v = 1.0
    up = Block("up", "stone", (0.2, 0.2, 0.2), (0.0, 0.0, 0.1), velocity=(0.0, 0.0, v))
    simulate(blocks(up, control=DynamicControl(0.6, 0.2)), tmp_path / "thrown.h5")
    with history.read(tmp_path / "thrown.h5") as file:
        shown = page.results_table(file.results)
    assert f"{1e3 * v**2 / (2.0 * G):.4g} mm" in shown and "of up, at any time" in shown
    assert "displacement at the end" in shown


def test_a_path_under_a_changing_normal_force_stays_on_its_domain(tmp_path):
    """A block shaken vertically and sideways, with N varying by half: friction never exceeds mu N of the moment."""
    sine = Sine(0.5 * G, 5.0)
    control = BaseMotionControl(duration=0.4, direction=(1.0, 0.0, 0.5), sine=sine)
    block = Block("block", "stone", (0.4, 0.4, 0.1), (0.0, 0.0, 0.05))
    simulate(blocks(block, control=control, friction=0.3), tmp_path / "shaken.h5")
    with history.read(tmp_path / "shaken.h5") as file:
        path = joint_path(file)
        figure = plot.load_path(file)
    assert path.strength is not None and np.ptp(path.strength) > 0.1 * path.strength.max()
    along, _ = path.drawn
    assert 0.98 < np.nanmax(np.abs(along)) < 1.02
    assert np.abs(path.V).max() > 1.1 * 0.3 * path.normal_force  # beyond a domain for the last N
    assert r"over $\mu N$ [-]" in figure.axes[0].get_xlabel()


def test_a_load_factor_is_printed_without_newtons(arch, capsys):
    assert main(["info", arch]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("load factor"))
    assert " N" not in line and "+-" in line
    assert main(["yield", arch]) == 0
    head, row = capsys.readouterr().out.splitlines()
    assert "limit" in head and " N" not in row and "+-" in row and "rocking" in row


@pytest.mark.parametrize("kind, said", [("layout", "the plan of one"), ("domain", "the domain of one joint")])
def test_figures_of_one_joint_are_refused_for_a_structure(arch, kind, said, tmp_path, capsys):
    assert main(["plot", arch, "--kind", kind, "--to", str(tmp_path / "f.png")]) == 2
    assert said in capsys.readouterr().err


def test_control_points_start_from_rest(arch):
    with history.read(arch) as file:
        line = plot.control_points(file).axes[0].lines[0].get_xydata()
    assert line[0].tolist() == [0.0, 0.0] and line[-1, 0] > 0.0


@pytest.mark.parametrize(
    "used, text",
    [(math.nan, "not known: cut at an edge"), (0.5, "utilisation 0.5"), (math.inf, "without friction strength")],
)
def test_a_utilisation_that_is_no_number_is_said_in_words(used, text):
    assert text in _used(used)


def test_a_joint_that_bends_says_how_far_and_a_hinge_that_it_is_one(arch):
    assert _used(0.1, 0.5).splitlines() == ["friction used 0.1", "bending used 0.5"] and _used(0.5, 0.4)[-3:] == "0.5"
    with history.read(arch) as found:
        (axes, *_) = joint_stages(found, stages=1).axes
    assert axes.get_title().splitlines()[-2] == "a hinge"
