"""Loads of a stage on a block that slides and that ties hold: what friction and ties carry depends on their way.

The block moves in its plane, held against turning, on springs of friction beside two ties across each other. Its way is
integrated by itself here, in thousands of increments.
"""

from dataclasses import replace

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import StaticsControl
from dembrick.scenario.model import Load
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.simulation import load_increments
from dembrick.simulation.statics.rest import relaxation
from helpers.key_lines import words
from helpers.stone_scenes import law, of_stone

FRICTION, WEIGHT, SPRING = 0.5, 0.4**3 * 2000.0 * 9.81, 4e8 * 0.16  # -, N, N/m


def scene(formulation, tie, loads, large=False):
    """A cube on a floor, and in each stage a force at its centroid (N); ``large``: in the deformed geometry."""
    control = StaticsControl(large_displacements=large)
    blocks = (
        Block("floor", "stone", box=(4.0, 4.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True),
        Block("cube", "stone", box=(0.4, 0.4, 0.4), position=(0.0, 0.0, 0.2), held=("rx", "ry", "rz")),
    )
    ends = (((1.2, 0.0, 0.0), (0.2, 0.0, 0.0)), ((0.0, 1.2, 0.0), (0.0, 0.2, 0.0)))
    return of_stone(
        law(formulation, FRICTION, stiffness=1e9),
        control,
        blocks,
        stages=(control,) * (len(loads) - 1),
        loads=tuple(Load("cube", force, (0.0, 0.0, 0.2), stages=(i + 1,)) for i, force in enumerate(loads)),
        ties=tuple(Tie((TieEnd("floor", a), TieEnd("cube", b)), tie, tension_only=False) for a, b in ends),
    )


def held_by_ties(tie, loads, increments, bond=0.0, after=0.0, residual=FRICTION):
    """Force (2,) of the ties on the block, and how great any force gets: radial return, step by step, in x + iy.

    ``bond``: strength (N) that friction has besides until it is overborne; ``after`` and ``residual`` friction: from
    then on."""
    friction, moved, elastic, across, up = FRICTION, 0j, 0j, 0j, 0.0
    for x, y, z in np.array(loads).tolist():
        for part in (i / increments for i in range(1, increments + 1)):
            pressed = WEIGHT - up - part * (z - up)
            driving = across + part * (complex(x, y) - across) - tie * moved
            slip = (driving - elastic) / (tie + SPRING)
            trial = elastic + SPRING * slip
            if abs(trial) > friction * pressed + bond:
                bond, friction = after, residual
                strength = friction * pressed + bond
                total = driving + tie / SPRING * elastic  # = trial (tie / spring + strength / |trial|)
                size = (abs(total) - strength) * SPRING / tie
                trial = total / abs(total) * size
                slip, elastic = (trial - elastic) / SPRING, strength / size * trial
            else:
                elastic = trial
            moved += slip
        across, up = complex(x, y), z
    tension = np.array([-tie * moved.real, -tie * moved.imag])
    return tension, max(WEIGHT - up, np.abs(tension).max())


LATE = [(554.3, 27.6, -557.0), (-1302.9, -209.9, -409.8)]  # slides again in the last tenth of the second load
ROUND = [(-812.2, 1198.5, -117.2), (-477.9, -1117.1, 269.0)]


@pytest.mark.parametrize("large", [False, True])
def test_forces_of_a_light_block_are_known_to_what_is_said_beside_a_heavy_one(large):
    """Loads that are little next to the heavy block came in one step, with an error of zero (they were 6 % off)."""
    given = scene("concave", 3e6, ROUND, large)
    heavy = Block("heavy", "stone", box=(9.0, 9.0, 9.0), position=(20.0, 0.0, 4.5))
    ground = Block("ground", "stone", box=(9.0, 9.0, 0.2), position=(20.0, 0.0, -0.1), fixed=True)
    found = simulate(replace(given, blocks=(*given.blocks, ground, heavy)))
    exact, greatest = held_by_ties(3e6, ROUND, 5000)
    error = np.abs(found.rows["tension"][-1] - exact).max() / greatest
    assert error <= found.as_dict()["statics"]["path_error"] < 0.01


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("tie", [1e5, 3e6, 2.6e7])
@pytest.mark.parametrize("loads", [LATE, ROUND])
def test_forces_are_known_to_what_is_said(formulation, tie, loads):
    found = simulate(scene(formulation, tie, loads))
    exact, greatest = held_by_ties(tie, loads, 5000)
    error = np.abs(found.rows["tension"][-1] - exact).max() / greatest
    rest = found.run.rest
    assert rest.increments in load_increments.COUNTS[1:] and 2e-4 < rest.path_error < 0.02
    assert error <= rest.path_error
    assert np.abs(held_by_ties(tie, loads, 1)[0] - exact).max() / greatest > 2.0 * error or error < 1e-4
    assert found.as_dict()["statics"]["increments"] == rest.increments
    assert f"load path {rest.increments} increments (forces are known to" in words(found.text())


EASED = [(-1010.4, 1266.7, -1467.4), (-717.7, -25.3, 234.3)]  # at once, they would swing the joint open


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("loads", [LATE, ROUND, EASED])
def test_forces_are_known_to_what_is_said_in_the_deformed_geometry_too(formulation, loads):
    """Stiff ties: the block moves by hundredths of a millimetre, so that its geometry is that of the start."""
    found = simulate(scene(formulation, 1.5e7, loads, large=True))
    exact, greatest = held_by_ties(1.5e7, loads, 5000)
    run = found.run.rest
    assert run.increments in load_increments.COUNTS[1:] and 2e-4 < run.path_error < 0.02
    assert np.abs(found.rows["tension"][-1] - exact).max() / greatest <= run.path_error + 1e-4
    assert found.as_dict()["statics"]["path_error"] == run.path_error
    assert f"load path {run.increments} increments (forces are known to" in words(found.text())


@pytest.mark.parametrize("tie", [1e5, 3e6])
def test_loads_that_grow_together_from_zero_need_no_increments(tie):
    found = simulate(scene("concave", tie, ROUND[:1]))
    exact, greatest = held_by_ties(tie, ROUND[:1], 1)
    assert found.rows["tension"][-1] == pytest.approx(exact, abs=1e-6 * greatest)
    assert found.run.rest.increments == 1 and found.run.rest.path_error == 0.0
    assert "load path" not in found.text()


def test_soft_ties_are_no_way_of_their_own():
    """Rest that is found by viscous motion answers in one step, as rest by relaxation does: ties of 1e6 and 1e5 N/m."""
    given = scene("concave", 1e6, [(1500.0, 700.0, 0.0)])
    found = simulate(replace(given, ties=(given.ties[0], replace(given.ties[1], stiffness=1e5))))
    # friction is against the whole slip, a point of the shear springs from where it began
    tension = -found.rows["tension"][-1]
    moved = tension / (1e6, 1e5)
    friction = np.array([1500.0, 700.0]) - tension
    assert np.hypot(*friction) == pytest.approx(FRICTION * WEIGHT, rel=1e-9)
    assert friction[0] * moved[1] == pytest.approx(friction[1] * moved[0], rel=1e-6)
    assert found.run.rest.path_error == 0.0


def test_a_wall_that_a_block_closes_on_begins_without_shear():
    """Pulled off a wall by F, then pushed onto it by F with a shear S: the wall closes at half of both, and bears half
    of what comes after; nothing slides."""
    given = scene("concave", 1e6, [(-300.0, 0.0, 0.0), (300.0, 60.0, 0.0)])
    wall = Block("wall", "stone", box=(0.4, 0.4, 0.4), position=(0.4, 0.0, 0.2), fixed=True)
    found = simulate(replace(given, blocks=(*given.blocks, wall), ties=()))
    joints, number = found.assembly.joints, found.assembly.names.index("wall")
    of_wall = (np.array(joints.block_a) == number) | (np.array(joints.block_b) == number)
    sheared = found.run.state.joints.resultant[of_wall, 1:3]
    assert np.abs(sheared).max() == pytest.approx(15.0, abs=found.run.rest.path_error * WEIGHT)
    assert 2e-4 < found.run.rest.path_error < 5e-3


WEAK, BRITTLE, LASTING = (1e-3, 0.0, 0.5), (1e3, 0.0, 0.3), (2e3, 2e3, 0.5)  # Pa, Pa, -: cohesion before and after
HALVED, FALLING = (5e3, 1e3, 0.5), (0.0, 0.0, 0.3)  # and residual friction


def with_bond(given, bond):
    strengths = {"cohesion": bond[0], "residual_cohesion": bond[1], "residual_friction": bond[2]}
    return replace(given, joint=law(given.joint.formulation, FRICTION, stiffness=1e9, **strengths))


@pytest.mark.parametrize(
    "formulation, tie, bond",
    [
        ("concave", 3e6, WEAK),
        ("convex", 3e6, BRITTLE),
        ("concave", 3e6, HALVED),
        ("convex", 3e6, LASTING),
        ("concave", 1e5, FALLING),
        ("convex", 3e6, FALLING),
    ],
)
@pytest.mark.parametrize("loads", [LATE[:1], LATE, ROUND])
def test_bonds_that_break_are_followed(formulation, tie, bond, loads):
    found = simulate(with_bond(scene(formulation, tie, loads), bond))
    exact, greatest = held_by_ties(tie, loads, 5000, *(0.16 * strength for strength in bond[:2]), bond[2])
    rest = found.run.rest
    assert rest.path_error < 0.02
    assert np.abs(found.rows["tension"][-1] - exact).max() / greatest <= rest.path_error + 1e-6


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("bond, loads", [(BRITTLE, LATE), (HALVED, ROUND), (FALLING, ROUND), (BRITTLE, ROUND[:1])])
def test_bonds_that_break_are_followed_in_the_deformed_geometry_too(formulation, bond, loads):
    """In the first stage its bar is that of the rest in the geometry of the start, where it begins."""
    found = simulate(with_bond(scene(formulation, 1.5e7, loads, large=True), bond))
    if len(loads) == 1:
        alone = simulate(with_bond(scene(formulation, 1.5e7, loads), bond)).run.rest
        assert found.run.rest.force_error == pytest.approx(alone.force_error, rel=1e-9) and alone.force_error > 0.0
    exact, greatest = held_by_ties(1.5e7, loads, 5000, *(0.16 * strength for strength in bond[:2]), bond[2])
    assert found.run.rest.path_error < 0.02
    assert np.abs(found.rows["tension"][-1] - exact).max() / greatest <= found.run.rest.path_error + 1e-4


@pytest.mark.parametrize("stages", [1, 10])
def test_bonds_that_bear_too_much_go_one_by_one(stages):
    """Three blocks in a row between walls, each on a bond: what one step throws down stands, as the first bond that
    breaks relieves others; in one stage as in ten."""
    boxes = {"floor": ((5.0, 3.0, 0.2), (0.0, 0.0, -0.1)), "left": ((0.2, 0.6, 0.4), (-0.3, 0.0, 0.2))}
    boxes |= {"right": ((0.2, 0.6, 0.3), (1.1, 0.0, 0.15))} | {
        f"b{i}": ((0.4,) * 3, (0.4 * i, 0.0, 0.2)) for i in range(3)
    }
    blocks = tuple(
        Block(name, "stone", box=box, position=place, fixed=not name.startswith("b"))
        for name, (box, place) in boxes.items()
    )
    forces = (
        ((78.3, 50.3, -1764.8), (-0.075, -0.031, 0.25)),
        ((-108.3, -1069.4, -1255.7), (0.397, 0.062, 0.25)),
        ((289.5, -1600.0, -1884.9), (0.747, 0.032, 0.197)),
    )
    control, bond = StaticsControl(), {"cohesion": 947.156, "tensile_strength": 721.01}
    loads = tuple(
        Load(f"b{i}", tuple((k + 1) / stages * np.array(force)), point, stages=(k + 1,))
        for i, (force, point) in enumerate(forces)
        for k in range(stages)
    )
    joint = law("corrected", 0.6, stiffness=1e9, **bond)
    more = {"gravity": (0.0, 0.0, 0.0), "stages": (control,) * (stages - 1), "loads": loads}
    found = simulate(of_stone(joint, control, blocks, **more), record=False)
    assert found.status == "stands"
    rest = found.run.rest
    np.testing.assert_allclose(found.reactions["floor"][:3], [-41.0, 2130.0, 4590.7], atol=rest.force_error + 0.5)


@pytest.mark.parametrize("large", [False, True])
def test_errors_of_stages_before_are_added(large):
    """Nothing slides under loads that are halved: all that is wrong then was so before."""
    turn = ROUND[-1]
    found = simulate(scene("concave", 1.5e7, [*ROUND, tuple(0.9 * force for force in turn)], large))
    before, now = found.stages[-1]["statics"], found.as_dict()["statics"]
    exact, greatest = held_by_ties(1.5e7, [*ROUND, 0.9 * np.array(turn)], 5000)
    error = np.abs(found.rows["tension"][-1] - exact).max()
    assert 1e-4 * greatest < error < now["force_error"]
    assert now["force_error"] == pytest.approx(before["force_error"], rel=1e-3)
    assert now["path_error"] == pytest.approx(now["force_error"] / greatest, rel=0.2)


def test_a_way_that_is_not_known_well_is_said(monkeypatch):
    monkeypatch.setattr(load_increments, "COUNTS", (8, 19))
    heard = []
    simulate(scene("concave", 1e5, ROUND), report=heard.append)
    assert any("after 19 increments the forces are known to" in sentence for sentence in heard)
    monkeypatch.setattr(relaxation.Relaxation, "_in_increments", lambda *_: (0, False))
    found = simulate(scene("concave", 1e5, ROUND), report=heard.append)
    assert "but the loads were applied in one step" in heard[-1]
    assert found.as_dict()["statics"]["path_error"] is None
    assert "load path 1 increment (same forces as in one step)" in words(found.text())
