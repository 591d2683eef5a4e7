"""Blocks that snap again and again: driven relaxation in place of Newton's method, and its bounds."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.errors import NotConvergedError
from dembrick.history import read
from dembrick.kernels.math.multifrontal import solve_rounded_in_place
from dembrick.kernels.statics.load_bounds import NEVER
from dembrick.runs.limit import limit
from dembrick.runs.path_dependence import ranged
from dembrick.runs.simulate import simulate
from dembrick.scenario import shipped, toml
from dembrick.scenario.controls import PushoverControl, YieldControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Actuator, Block, Load
from dembrick.simulation.session import Session
from dembrick.simulation.statics import limit_load, yield_point
from dembrick.simulation.statics.elastic_factor import elastic_factor, rounded_inertia
from dembrick.simulation.statics.paths import driven_relaxation, path_following
from dembrick.simulation.statics.paths.bounds import bounds_after_jumps, carried, pushed_bounds
from dembrick.simulation.statics.state import initial_state
from dembrick.views.structure_numbers import of_path
from dembrick.views.summary import limit_text
from helpers.key_lines import lines_of
from helpers.pushed_assemblies import stack, wall
from helpers.quasi_static import leaf, scene
from helpers.stone_scenes import law, of_stone

DOME = "control.quasi_static=true", "output.channels=['energy']"


@pytest.fixture
def impatient(monkeypatch):
    """Push the blocks on from the start."""
    monkeypatch.setattr(path_following, "WASTED", -1e12)
    monkeypatch.setattr(path_following, "LEAST_WASTED", -1)


def dome(*changes):
    return toml.load(shipped.folder() / "dome.toml", [*DOME, *changes])


def energies_of(scenario) -> tuple[limit_load.Replay, dict[str, np.ndarray]]:
    """A search, and its energies by name, a row per equilibrium."""
    parts: list[dict] = []
    session = Session.of(lambda rows, _frames: parts.append(rows["energy"]))
    control = scenario.control
    run = limit_load.find_limit_load(build.assemble(scenario), control.tolerance, session)
    return run, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


# --- the inertia


@pytest.mark.parametrize("scenario", [leaf("concave"), dome()], ids=["wall", "dome"])
def test_factors_in_single_precision_are_those_of_the_stiffness(scenario):
    """Rounding loses next to nothing of the energy of a motion, and the matrix stays symmetric."""
    assembly = build.assemble(scenario)
    factors = elastic_factor(initial_state(assembly), assembly.position)
    inertia, rng = rounded_inertia(factors), np.random.default_rng(7)
    x, y = rng.normal(size=(2, factors.pattern.rows))
    answer, other = x.copy(), y.copy()
    solve_rounded_in_place(inertia.rounded, answer)
    solve_rounded_in_place(inertia.rounded, other)
    exact = x[None].copy()
    factors.solve(exact)
    assert answer == pytest.approx(exact[0], rel=1e-5, abs=1e-5 * np.abs(exact).max())
    assert x @ answer == pytest.approx(x @ exact[0], rel=1e-6)
    assert y @ answer == pytest.approx(x @ other, rel=1e-9)


# --- closed forms, by pushes alone


@pytest.mark.parametrize(
    "scenario, limit",
    [
        (wall(law(), 4, 6, (0.0, 1.0, 0.0)), 0.2 / 0.6),
        (stack(law(friction=0.3), (1.0, 0.0, 0.0)), 0.3),
    ],
    ids=["a wall turns about its toe", "a stack slides"],
)
def test_pushes_alone_find_a_limit(impatient, scenario, limit):
    run, _ = energies_of(scenario)
    point = run.yield_point
    assert run.converged and not run.settings["wanders"]
    assert point.V_lower < limit < point.V_upper < 1.001 * limit
    assert point.V == pytest.approx(limit, rel=1e-3)
    assert run.settings["equilibria"] <= 6


def test_what_a_convex_wall_still_lacks_is_in_its_bounds(impatient):
    """The strip at the toe shrinks without end; at V of only 97 % of 1/3 the bounds hold 1/3."""
    run, _ = energies_of(wall(law("convex"), 4, 6, (0.0, 1.0, 0.0)))
    point = run.yield_point
    assert point.V_lower < 0.33 < 1.0 / 3.0 < point.V_upper < 0.37


def test_a_dome_that_snaps_gives_way_at_the_load_of_its_path(impatient):
    """The bounds hold the limit by path following, 0.3732, and the energy balance closes."""
    run, energies = energies_of(dome())
    point = run.yield_point
    assert run.settings["wanders"] and run.converged
    assert 0.35 < point.V_lower < 0.3732 < point.V_upper < 0.41
    spent = sum(energies[name] for name in energies if name != "external")
    assert spent == pytest.approx(energies["external"], abs=0.01 * energies["external"][-1])
    assert energies["friction"][-1] > 0.5 * energies["external"][-1]
    assert "collapse" in simulate(dome(), record=False).as_dict()


def test_what_moves_is_what_moved_last(impatient):
    """The wall rotates as one: every course but the slab, about an edge along x."""
    result = simulate(wall(law(), 4, 6, (0.0, 1.0, 0.0)), record=False)
    assert result.collapse["mechanism"] == "rocking"
    assert len(result.collapse["blocks"]) >= 20


# --- when it begins, and what is reported


def test_a_path_that_wastes_its_steps_is_pushed_on(monkeypatch):
    """Only such a path switches to pushes, and it does not switch back."""
    looked = []
    push = driven_relaxation.DrivenRelaxation.push
    monkeypatch.setattr(driven_relaxation.DrivenRelaxation, "push", lambda *now: looked.append(1) or push(*now))
    patient, _ = energies_of(dome())
    assert not looked and not patient.settings["wanders"]
    monkeypatch.setattr(path_following, "WASTED", 0)
    hasty, _ = energies_of(dome())
    assert len(looked) >= 3
    assert hasty.steps < patient.steps
    assert hasty.yield_point.V_lower <= 1.01 * patient.yield_point.V
    assert hasty.yield_point.V_upper >= 0.99 * patient.yield_point.V


def test_a_path_that_is_given_up_is_pushed_on(monkeypatch):
    """A path on which blocks jump too often. With friction 3 the limit depends strongly on the path; no path ends
    above 1.5278 (linear programming)."""
    walls = (Wall("wall", "stone", (0.2, 0.22, 0.12), courses=2, blocks=3, base=0.1),)
    given = scene(PushoverControl((-0.8, 0.6, 0.0), 1e-4), friction=3.0, walls=walls)
    let_go, _ = energies_of(given)
    monkeypatch.setattr(path_following, "MOST_JUMPS", 0)
    pushed, _ = energies_of(given)
    assert pushed.steps < let_go.steps
    assert pushed.settings["wanders"] and not let_go.settings["wanders"]
    assert let_go.yield_point.V_after < pushed.yield_point.V_lower < 1.5278
    # bounds that are too far apart: the greatest load of an equilibrium is the lower one
    monkeypatch.setattr(yield_point, "OPEN", 0.0)
    run, _ = energies_of(given)
    point = run.yield_point
    assert point.bracket == "open" and pushed.yield_point.V_lower <= point.V_lower == point.V <= point.V_peak
    beside = {"associative": {"upper": 1.5278}, "wanders": [point.V_lower, 1.5278]}
    told = limit_text(point.as_dict(), beside, "")
    assert told == (f"at least {point.V:.6g}", "at most 1.5278 by limit analysis")
    ends = limit_text(point.as_dict(), {}, "")
    assert ends == (f"{point.V:.6g}", "at the end, no upper bound"), "as in a cyclic test"


def test_without_an_end_it_says_so(impatient, monkeypatch):
    monkeypatch.setattr(path_following, "MOST_PUSHES", 2)
    with pytest.raises(NotConvergedError, match="not bracketed"):
        energies_of(dome())


def test_bounds_of_pushes():
    """Of (given, V, lower, upper, closes): the last two or three, widened by half their range and the growth of V."""
    seen = [(1.0, 7.0, 7.0, 7.5, False), (2.0, 8.0, 7.5, 8.25, False), (4.0, 7.75, 7.25, 8.0, False)]
    assert pushed_bounds(seen[:2], False) == (0.0, NEVER, False)
    assert pushed_bounds(seen, False) == (7.25 - 0.5, 8.25 + 0.5, True)
    rising = [*seen, (8.0, 8.0, 7.75, 8.0, False)]
    assert pushed_bounds(rising, False) == (7.25 - 0.5, 8.25 + 0.5, True)
    assert pushed_bounds(rising, True) == (7.25 - 0.5, 8.75, True)
    assert pushed_bounds([*seen, (8.0, 8.125, 7.75, 8.125, False)], True) == (6.75, 8.125 + 3.0 * 0.375, True)
    assert pushed_bounds([*seen, (8.0, 9.0, 8.75, 9.0, False)], False) == (7.25 - 0.875, NEVER, False)


def test_pushes_carry_nothing_for_certain():
    """What an equilibrium carried, less what may be left in its blocks; not what the two pushes after them did."""
    seen = [(0.0, 0.0, 0.0, NEVER, False), (1.0, 7.0, 6.5, 8.0, False), (2.0, 6.75, 6.75, 8.0, True)]
    pushes = [(3.0, 7.5, 7.0, 9.0, False), (4.0, 8.0, 7.5, 9.0, False)]
    assert carried(SimpleNamespace(seen=seen + pushes, pushes=2)) == 6.75
    assert carried(SimpleNamespace(seen=pushes, pushes=2)) == 0.0


def test_bounds_of_blocks_that_were_let_go():
    """Loads fell to 7.25 and rose to 8 in the second half of the path, by .75; a mechanism carries 8.5 at most."""
    before = [(0.0, 0.0, 0.0, NEVER, False), (1.0, 5.0, 5.0, 9.0, False), (2.0, 7.75, 7.75, 9.0, False)]
    recent = [(2.5, 8.0, 7.75, NEVER, True), (3.0, 7.25, 7.25, NEVER, True), (4.0, 7.5, 7.5, 8.5, True)]
    assert bounds_after_jumps([*before, *recent[1:]], False) == (0.0, NEVER, False)
    assert bounds_after_jumps([*before, *recent], False) == (7.25 - 0.375, 8.5 + 0.375, True)
    assert bounds_after_jumps([*before, *recent], True) == (7.25 - 0.375, 8.5 + 3.0 * 0.25, True)
    risen = [*before[:2], (2.0, 7.5, 7.5, 9.0, False), *recent]
    assert bounds_after_jumps(risen, False) == (7.25 - 0.375, NEVER, False)


def crushing_wall():
    """A convex wall crushed by a load and pressed by a jack: its corners stick with a friction of 2, then slip."""
    width, deep, high = 0.342, 0.247, 0.46
    blocks = [Block("floor", "stone", (3.0, deep, 0.2), (0.0, 0.0, -0.1), fixed=True)]
    for course in range(3):
        ends = (-width, -0.5 * width, 0.5 * width, width) if course == 1 else (-width, 0.0, width)
        for i, (left, right) in enumerate(pairwise(ends)):
            place = 0.5 * (left + right), 0.0, (course + 0.5) * high
            blocks.append(Block(f"{course} {i}", "stone", (right - left, deep, high), place))
    jack = Actuator("jack", "2 1", (0.0433856, 0.0, 3.0 * high), (0.1337814, 0.0, -0.9910109))
    joint = law("convex", 2.0, compressive_strength=238242.55)
    load = Load("2 1", (0.0, 0.0, -9591.35), (0.193455, 0.0, 3.0 * high))
    return of_stone(joint, YieldControl(), blocks, loads=(load,), actuators=(jack,))


def test_blocks_that_nothing_pushes_on_are_let_go_again_and_again():
    """Driven relaxation does not cover crushing. V fluctuates by some 1e-4, below the bound of limit analysis."""
    found, most = simulate(crushing_wall(), record=False), limit(crushing_wall()).upper
    point = found.yield_point
    assert found.as_dict()["path"]["wanders"] == [point.V_lower, point.V_upper]
    assert 0.99 * most < point.V_lower <= point.V_peak < point.V_upper <= most * (1.0 + 1e-9)


def test_what_the_command_line_says():
    beside = {"wanders": [0.35, 0.37], "path_dependent": True, "path_range": None, "error_estimate": 0.01}
    assert lines_of(of_path(beside, ""))["wanders"].startswith("wanders 0.35 to 0.37 (")
    for low, error in ((0.355, 0.01), (0.34, 0.02)):
        found, _ = ranged(beside, 0.36, [(low, low, low), (0.362, 0.362, 0.362)], 3)
        assert found["error_estimate"] == pytest.approx(error)


def test_the_json_says_from_where_to_where(impatient):
    result = simulate(dome(), record=False)
    point, collapse = result.yield_point, result.as_dict()["collapse"]
    assert collapse["wanders"] == [point.V_lower, point.V_upper]
    assert collapse["error_estimate"] == point.half_width


def test_every_push_is_worth_a_frame(impatient, tmp_path):
    """With more than a hundred blocks only every eighth equilibrium has a frame otherwise."""
    result = simulate(dome("output.channels=['frames']"), tmp_path / "dome.h5")
    with read(tmp_path / "dome.h5") as file:
        assert file.frame_time[-3:].tolist() == file.time[-3:].tolist()
    assert len(result.rows["time"]) == result.run.settings["equilibria"] + 1
