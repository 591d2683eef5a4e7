"""A tilting table in the geometry of the start: the search divides loads by cos(psi), the results do not."""

import math

import numpy as np
import pytest

from dembrick import history
from dembrick.runs import mechanism_history
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import TiltControl
from dembrick.scenario.model import Output
from dembrick.scenario.ties import Tie, TieEnd
from helpers.quasi_static import scene
from helpers.scenario_text import block, header, jack

MU, WEIGHT, SIDES = 0.5, 2000.0 * 9.81 * 0.3 * 0.2 * 0.2, (0.3, 0.2, 0.2)
STIFFNESS, AREA = 1e9, 0.3 * 0.2
EVERYTHING = Output(frames=500, channels=("joints", "energy", "frames", "contacts"))


def block_on_table(formulation="concave", large=False, **parts):
    floor = Block("floor", "stone", (2.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", SIDES, (0.0, 0.0, 0.1))
    return scene(
        TiltControl((0.0, 1.0, 0.0), large_displacements=large),
        formulation,
        MU,
        STIFFNESS,
        blocks=(floor, block),
        output=EVERYTHING,
        **parts,
    )


@pytest.fixture(params=["concave", "convex"])
def ended(request):
    return simulate(block_on_table(request.param))


def angle_of(rows):
    return np.arctan(rows["load"])


def test_a_block_on_a_table_carries_its_weight_at_every_angle(ended):
    psi, rows = angle_of(ended.rows), ended.rows
    N, V = WEIGHT * np.cos(psi), WEIGHT * np.sin(psi)
    np.testing.assert_allclose(rows["joint"][:, 0, 0], N, rtol=2e-6)
    np.testing.assert_allclose(np.abs(rows["joint"][:, 0, 1]), V, rtol=2e-6, atol=1e-9 * WEIGHT)
    np.testing.assert_allclose(np.abs(rows["actuator_force"][:, 0]), V, rtol=1e-9, atol=1e-12)
    reaction = np.linalg.norm(rows["reaction"][:, 0, :3], axis=1)
    np.testing.assert_allclose(reaction, WEIGHT, rtol=1e-6)
    assert not rows["energy"]


def test_what_is_told_of_the_limit_is_of_the_table(ended):
    psi, point = math.atan(MU), ended.yield_point
    assert ended.collapse["angle"] == pytest.approx(math.degrees(psi), rel=1e-6)
    assert point.N == pytest.approx(WEIGHT * math.cos(psi), rel=1e-6)
    assert math.hypot(point.V_1, point.V_2) == pytest.approx(WEIGHT * math.sin(psi), rel=1e-6)
    assert np.linalg.norm(ended.reactions["floor"][:3]) == pytest.approx(WEIGHT, rel=1e-6)


def test_frames_of_a_table_are_of_its_angle(ended):
    """The springs shorten by W cos(psi) / K, and the forces at points sum up to the joint's; the rotation of the block
    is due to the moment W sin(psi) h / 2 at the bed."""
    frames, rows = ended.frames, ended.rows
    psi = angle_of(rows)[np.searchsorted(rows["time"], frames["time"])]
    assert len(psi) > 5
    shortened = WEIGHT * np.cos(psi) / (STIFFNESS * AREA)
    np.testing.assert_allclose(-frames["displacement"][:, 1, 2], shortened, rtol=1e-6)
    stiffness = STIFFNESS * AREA * SIDES[0] ** 2 / 4.0  # of four points, or less of a polygon
    turned = WEIGHT * np.sin(psi) * SIDES[2] / 2.0 / stiffness
    about = 2.0 * np.abs(frames["orientation"][:, 1, 2])
    few = psi < 0.2  # no point has opened or slid yet
    times = 1.0 if frames["contact_force"].shape[1] else 3.0
    np.testing.assert_allclose(about[few], times * turned[few], rtol=1e-6, atol=1e-15)
    if frames["contact_force"].shape[1]:
        carried = np.linalg.norm(frames["contact_force"].sum(axis=1), axis=1)
        np.testing.assert_allclose(carried, WEIGHT, rtol=1e-6)


def test_an_elastic_tie_and_friction_hold_a_block_on_a_table():
    tie = Tie((TieEnd("floor", (-0.9, 0.0, 0.0)), TieEnd("block", (0.0, 0.0, 0.0))), 1e6)
    ended = simulate(block_on_table(ties=(tie,)))
    psi = angle_of(ended.rows)
    together = np.abs(ended.rows["joint"][:, 0, 1]) + ended.rows["tension"][:, 0]
    np.testing.assert_allclose(together, WEIGHT * np.sin(psi), rtol=1e-6, atol=1e-9 * WEIGHT)
    assert ended.run.ties["tension"][0] == pytest.approx(ended.rows["tension"].max(), rel=1e-2)


def test_in_the_deformed_geometry_the_load_is_that_of_the_table_too():
    rows = simulate(block_on_table(large=True)).rows
    down_the_slope = WEIGHT * np.sin(angle_of(rows))
    np.testing.assert_allclose(np.abs(rows["actuator_force"][:, 0]), down_the_slope, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.abs(rows["joint"][:, 0, 1]), down_the_slope, rtol=1e-4, atol=1e-4 * WEIGHT)


def test_what_a_stage_before_has_moved_stays_as_the_table_tilts():
    """A jack slides the block sideways by 5 mm; the table that tilts afterwards does not undo it."""
    text = header("concave", MU, STIFFNESS) + block("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    text += block("stone", (0.0, 0.0, 0.1), SIDES) + jack("stone", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    text += '[[control_points]]\nname = "c"\nblock = "stone"\npoint = [0.0, 0.0, 0.1]\n'
    text += '[[stages]]\nkind = "displacement"\nrate = 1e-2\ntravel = 5e-3\n[[stages]]\nkind = "statics"\n'
    ended = simulate(toml.loads(text + '[control]\nkind = "tilt"\naxis = [0.0, 1.0, 0.0]\n'))
    rows, slid = ended.rows, 5e-3 - MU * WEIGHT / (0.4 * STIFFNESS * AREA)
    assert (np.diff(rows["joint"][:, 0, 6]) >= 0.0).all()
    np.testing.assert_allclose(rows["joint"][0, 0, 6], slid, rtol=1e-2)
    np.testing.assert_allclose(rows["control_point"][:, 0, 1], slid, rtol=1e-2)
    np.testing.assert_allclose(ended.frames["displacement"][:, 1, 1], slid, rtol=1e-2)
    assert ended.control_points["c"][1] == pytest.approx(slid, rel=1e-2)
    assert ended.collapse["displacement"] < 1e-4
    np.testing.assert_allclose(rows["joint"][:, 0, 0], WEIGHT * np.cos(angle_of(rows)), rtol=2e-6)


def test_the_mechanism_of_limit_analysis_carries_what_the_table_does(tmp_path):
    path = mechanism_history.write(limit(block_on_table()), tmp_path / "mechanism.h5")
    psi = math.atan(MU)
    with history.History(path) as found:
        joint = found.joint("N")[:, 0]
    np.testing.assert_allclose(joint, WEIGHT * math.cos(psi), rtol=1e-6)
