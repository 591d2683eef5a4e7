"""Blocks that part and meet again, in complete runs: landing, rolling over, colliding, coming to rest."""

import dataclasses
import math

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.assembly.broad_phase import bodies_of, overlap_depths
from dembrick.errors import NotConvergedError
from dembrick.geometry.polygons import mean_distance
from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Sine
from dembrick.scenario.model import Block, JointLaw, Output, Solver
from dembrick.simulation.dynamics import chunks
from dembrick.simulation.dynamics.contact_detection import ContactDetection
from helpers.impact_scenes import AWAY, FLOOR, G, collapse, falling_arch, scene
from helpers.places import SCENARIOS, tool_module
from helpers.restart_cases import stop_at_look

EVERY = Output(rows=1000, frames=1000)
OBLIQUE = tuple(np.array([0.92, 0.1, 0.2, 0.31]) / np.linalg.norm([0.92, 0.1, 0.2, 0.31]))


def block(height, **more):
    return Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05 + height), **more)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.9])
def test_a_dropped_block_bounces(restitution):
    """From 20 mm the block lands after sqrt(2 h/g), at sqrt(2 g h), and rebounds at the given restitution."""
    output = Output(("frames", "velocity", "energy"), rows=1050, frames=1050)
    result = simulate(scene(DynamicControl(0.07, restitution), FLOOR, block(0.02), output=output))
    time, speed = result.frames["time"], result.frames["velocity"][:, 1, 2]
    landing = int(np.argmin(speed))
    assert time[landing] == pytest.approx(math.sqrt(0.04 / G), abs=2e-4)
    assert speed[landing] == pytest.approx(-math.sqrt(0.04 * G), rel=2e-3)
    assert speed[landing : landing + 75].max() == pytest.approx(
        -restitution * speed[landing], rel=0.025 if restitution == 0.2 else 0.008
    )


@pytest.mark.parametrize("psi", [30.0, 40.0])
def test_landing_on_a_slope(psi):
    """The block sticks if tan psi < mu and does not creep; otherwise it slides by g (sin psi - mu cos psi)."""
    angle = math.radians(psi)
    gravity = (G * math.sin(angle), 0.0, -G * math.cos(angle))
    result = simulate(scene(DynamicControl(1.0), FLOOR, block(1e-4), gravity=gravity))
    time, speed = result.frames["time"], result.frames["velocity"][:, 1, 0]
    late = time > 0.4
    if psi < 32.6:
        place = result.frames["displacement"][late, 1]
        assert np.abs(place - place[0]).max() < 1e-9
    else:
        expected = G * (math.sin(angle) - 0.64 * math.cos(angle))
        assert np.polyfit(time[late], speed[late], 1)[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_free_blocks_collide(restitution):
    """Momentum and angular momentum are conserved to rounding; with restitution 1 and no friction so is the energy."""
    other = Block(
        "other", "stone", (0.2, 0.2, 0.2), (0.05, 0.02, 0.75), OBLIQUE, velocity=(0.0, 0.0, -0.5),
        angular_velocity=(0.0, 3.0, 1.0),
    )  # fmt: skip
    one = block(0.45, velocity=(0.0, 0.0, 1.0), angular_velocity=(1.0, 0.5, 2.0))
    given = scene(DynamicControl(0.3, restitution), AWAY, one, other, gravity=(0.0, 0.0, 0.0),
                  friction=0.0 if restitution == 1.0 else 0.64)  # fmt: skip
    short = simulate(dataclasses.replace(given, control=DynamicControl(1e-3, restitution)))
    before, after = momenta(short), momenta(simulate(given))
    np.testing.assert_allclose(after[0], before[0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(after[1], before[1], rtol=0.0, atol=1e-11)
    if restitution == 1.0:
        assert after[2] == pytest.approx(before[2], rel=1e-4)
    else:
        assert after[2] < 0.8 * before[2]


@pytest.mark.parametrize(
    "slenderness, part, e, friction",
    [
        (3.0, 0.6, 0.3, 0.8),
        pytest.param(3.0, 0.9, 0.14, 0.3, marks=pytest.mark.slow),
        pytest.param(4.0, 0.5, 0.5, 0.8, marks=pytest.mark.slow),
        (8.0, 0.9, 0.3, 0.3),
    ],
)
def test_every_impact_of_a_rocking_block_loses_as_housner_says(slenderness, part, e, friction):
    """The angular velocity falls to 1 - 1.5 sin^2 alpha of itself, also after the block was tossed clear of the floor
    or rotated too far for its joint."""
    found = tool_module("drawn_impacts").rock(
        0.3, slenderness, 0.5, part, e, JointLaw("concave", friction, 1e10, 4e9), impacts=2
    )
    assert len(found) == 2 and found == pytest.approx([1.0] * 2, abs=0.01)


@pytest.mark.parametrize("formulation, softer", [("convex", True), ("distributed", True), ("corrected-shear", False)])
def test_a_result_says_if_blocks_rocked_over_a_bed_of_springs(formulation, softer):
    rocks = Block(
        "block", "stone", (0.3, 0.2, 1.2), (0.0, 0.0, 0.6), velocity=(0.3, 0.0, 0.0), angular_velocity=(0.0, 0.5, 0.0)
    )
    slides = Block("slider", "stone", (0.5, 0.5, 0.1), (0.6, 0.0, 0.05), velocity=(0.3, 0.0, 0.0))
    result = simulate(scene(DynamicControl(0.3), FLOOR, rocks, slides, formulation=formulation))
    said = [(one["law"], one["joints"]) for one in result.as_dict().get("left_out", [])]
    assert said == ([(formulation, 1)] if softer else [])
    assert ("bed of springs" in result.text()) == softer


def momenta(result):
    """Momentum, angular momentum about the origin and kinetic energy of the free blocks, with the velocities of half a
    step ago and the positions at that time."""
    motion = result.run.motion
    bodies, inertia = motion.state.bodies, result.assembly.inertia
    v, place = bodies.velocity, bodies.position - 0.5 * motion.time_step * bodies.velocity + motion.state.middle
    linear = bodies.mass[:, None] * v
    angular = bodies.momentum + np.cross(place, linear)
    own = np.einsum("nji,nj->ni", bodies.rotation, bodies.momentum)
    spinning = (own * np.einsum("nij,nj->ni", np.linalg.inv(inertia), own)).sum()
    return linear[1:].sum(axis=0), angular[1:].sum(axis=0), 0.5 * ((linear * v).sum() + spinning)


@pytest.mark.parametrize("friction, sideways", [(0.0, 0.0), (0.3, 2.0), (0.3, -2.0)])
@pytest.mark.parametrize("free", [False, True])
def test_an_edge_strikes_as_routh_says(free, friction, sideways):
    """Without loss in the normal direction the closing speed of the edge is reversed by the impulse

        J = 2 v / (1/m + (x^2 - mu s x z)/I + the same term of the other block),

    with (x, z) the edge from the centroid and mu J the friction of an edge that slides throughout, in the sense s
    (Routh, Dynamics of a System of Rigid Bodies I, 1905). The block struck is fixed, or free and struck off its centre.
    """
    turn, speed, gap = 0.5, 1.0, 1e-4
    rotation = rotation_matrix(np.array([math.cos(turn / 2), 0.0, math.sin(turn / 2), 0.0]))
    edge = rotation @ np.array([0.15, 0.0, -0.05])
    x, z = edge[0], edge[2]
    at = 0.25 if free else 0.0  # position of the edge from the middle of the struck block
    striker = Block(
        "striker", "stone", (0.3, 0.2, 0.1), (at - x, 0.0, gap - z), (math.cos(turn / 2), 0.0, math.sin(turn / 2), 0.0),
        velocity=(sideways, 0.0, -speed),
    )  # fmt: skip
    struck = Block("struck", "stone", (0.8, 0.4, 0.2), (0.0, 0.0, -0.1), fixed=not free)
    given = scene(
        DynamicControl(2e-3, 1.0), AWAY, struck, striker, friction=friction, gravity=(0.0, 0.0, 0.0), stiffness=1e13
    )
    result = simulate(given)
    m, M = result.assembly.mass[[2, 1]]
    at += sideways * gap / speed
    sense = -np.sign(sideways)  # of the friction on the striker
    felt = 1.0 / m + x * (x - friction * sense * z) / result.assembly.inertia[2][1, 1]
    if free:
        felt += 1.0 / M + at * (at - friction * sense * 0.1) / result.assembly.inertia[1][1, 1]
    impulse = 2.0 * speed / felt
    push = friction * sense * impulse
    after = result.frames["velocity"][-1], result.frames["spin"][-1]
    assert after[0][2, 2] == pytest.approx(-speed + impulse / m, abs=2e-3 * impulse / m)
    assert after[0][2, 0] == pytest.approx(sideways + push / m, abs=2e-3 * impulse / m)
    spin = (z * push - x * impulse) / result.assembly.inertia[2][1, 1]
    assert after[1][2, 1] == pytest.approx(spin, rel=2e-3)
    if free:
        assert after[0][1, 2] == pytest.approx(-impulse / M, rel=2e-3)
        spin = (at * impulse - 0.1 * push) / result.assembly.inertia[1][1, 1]
        assert after[1][1, 1] == pytest.approx(spin, abs=2e-3 * impulse * at / result.assembly.inertia[1][1, 1])


def test_spin_down_after_landing():
    """Flat on the floor the block is slowed by 12 mu g c_T/(a^2 + b^2), as a joint would slow it."""
    spin = 10.0
    result = simulate(scene(DynamicControl(0.15, 0.2), FLOOR, block(1e-5, angular_velocity=(0.0, 0.0, spin))))
    time, found = result.frames["time"], result.frames["spin"][:, 1, 2]
    arm = mean_distance(np.array([(-0.15, -0.1), (0.15, -0.1), (0.15, 0.1), (-0.15, 0.1)]))[0]
    sliding = (time > 0.03) & (found > 1.0)
    slowing = -np.polyfit(time[sliding], found[sliding], 1)[0]
    assert slowing == pytest.approx(12.0 * 0.64 * G * arm / (0.3**2 + 0.2**2), rel=2e-3)


@pytest.mark.parametrize(
    "spin, x, y, angle", [(5.0, -0.00126, 0.09238, 0.58576), (10.0, -0.00500, 0.12630, 1.28769)]
)  # fmt: skip
def test_a_plate_lands_sliding_and_spinning(spin, x, y, angle):
    """A plate of 1 mm dropped from a micrometre at 1 m/s slides as far as by the exact limit surface, with bounces."""
    plate = Block(
        "plate", "stone", (0.3, 0.2, 0.001), (0.0, 0.0, 0.0005 + 1e-6), velocity=(0.0, 1.0, 0.0),
        angular_velocity=(0.0, 0.0, spin),
    )  # fmt: skip
    result = simulate(scene(DynamicControl(0.35), FLOOR, plate, formulation="convex", stiffness=1e9))
    assert not len(result.assembly.joints)
    q = result.frames["orientation"][-1, 1]
    assert 2.0 * math.atan2(q[3], q[0]) == pytest.approx(angle, rel=1e-3)
    assert result.displacement[1, 1] == pytest.approx(y, rel=1e-3)
    assert result.displacement[1, 0] == pytest.approx(x, abs=2e-3 * y)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_that_rocks_over_comes_to_rest_on_its_side(formulation):
    """Its joint is handed over to an edge contact, then to a face; at rest its centroid is half its thickness up."""
    b, h = 0.2, 1.0
    spin = 1.6 * math.sqrt(1.5 * G / math.hypot(b, h) * (1.0 - math.cos(math.atan2(b, h))))
    velocity = tuple(np.cross([0.0, spin, 0.0], [-b / 2, 0.0, h / 2]))
    tall = Block("block", "stone", (b, 0.5, h), (0.0, 0.0, h / 2), velocity=velocity, angular_velocity=(0.0, spin, 0.0))
    given = scene(DynamicControl(2.5), FLOOR, tall, friction=0.8, formulation=formulation, output=EVERY)
    result = simulate(given)
    q = result.frames["orientation"][:, 1]
    angle = 2.0 * np.arctan2(q[:, 2], q[:, 0])
    assert angle[-1] == pytest.approx(math.pi / 2, abs=1e-6)
    assert result.run.motion.state.bodies.position[1, 2] + result.run.motion.state.middle[2] == pytest.approx(
        b / 2, abs=1e-6
    )
    assert np.abs(result.frames["velocity"][-1]).max() < 1e-6
    assert np.abs(np.diff(angle)).max() < 0.05


def test_a_block_slides_off_a_table():
    """The block tips over the edge, falls and comes to rest on the floor with all its energy dissipated."""
    table = Block("table", "stone", (1.0, 1.0, 0.5), (0.0, 0.0, 0.25), fixed=True)
    slider = Block("block", "stone", (0.3, 0.2, 0.1), (0.3, 0.0, 0.55), velocity=(2.0, 0.0, 0.0))
    result = simulate(scene(DynamicControl(1.2), FLOOR, table, slider, friction=0.4, stiffness=1e9))
    assert np.abs(result.frames["velocity"][-1]).max() < 1e-5
    pressed = result.run.motion.contact_detection.pressed(result.run.motion.state.middle)
    assert pressed["blocks"].tolist() == [[0, 2]]
    np.testing.assert_allclose(pressed["force"], [[0.0, 0.0, 12.0 * G]], atol=1e-3)
    np.testing.assert_allclose(pressed["point"][0, 2], 0.0, atol=1e-6)
    np.testing.assert_allclose(pressed["point"][0, 0], 0.3 + result.displacement[2, 0], atol=1e-4)
    assert result.displacement[2, 2] == pytest.approx(-0.5, abs=1e-5)
    assert 0.4 < result.displacement[2, 0] < 1.0


def test_too_hard_a_throw_is_said():
    fast = block(0.01, velocity=(0.0, 0.0, -12.0))
    with pytest.raises(NotConvergedError, match="blocks 'floor' and 'block' overlap by.*stiffness"):
        simulate(scene(DynamicControl(0.1), FLOOR, fast, stiffness=2e7, solver=Solver(0.4)))


@pytest.fixture(scope="module")
def collapsed(tmp_path_factory):
    """Result of the collapse and the path of its history."""
    path = tmp_path_factory.mktemp("collapse") / "whole.h5"
    return simulate(collapse(checkpoint=1e9), path), path


def test_a_collapse_loses_energy_and_no_blocks(collapsed):
    result, _ = collapsed
    bodies, motion = result.run.motion.state.bodies, result.run.motion
    assert motion.contact_detection.retired.any() and motion.contact_detection.touching is not None
    # all lie on the floor, or on a block that does; none has passed through it
    height = bodies.position[:, 2] + motion.state.middle[2]
    assert height[1:].min() > 0.049 and height.max() < 0.35
    thrown = result.frames["time"] > 0.35
    bodies_mass = result.assembly.mass
    energy = 0.5 * (bodies_mass[:, None] * result.frames["velocity"] ** 2).sum(axis=(1, 2))
    energy += G * (bodies_mass * result.frames["displacement"][:, :, 2]).sum(axis=1)
    assert energy[-1] < energy[thrown][0] - 50.0


@pytest.mark.parametrize("formulation", ["concave", pytest.param("convex", marks=pytest.mark.slow)])
def test_an_arch_too_thin_falls_and_lies_still(formulation):
    """Hinges open, stones part and meet the floor and each other; the energy that they lose is not regained."""
    result = simulate(falling_arch(formulation))
    motion, mass, free = result.run.motion, result.assembly.mass, ~result.assembly.fixed
    frames = result.frames
    rotation = np.array([[rotation_matrix(q) for q in frame] for frame in frames["orientation"]])
    spin = np.einsum("fnji,fnj->fni", rotation, frames["spin"])
    energy = 0.5 * (mass[:, None] * frames["velocity"] ** 2)[:, free].sum(axis=(1, 2))
    energy += 0.5 * np.einsum("fni,nij,fnj->fn", spin, np.array(result.assembly.inertia), spin)[:, free].sum(axis=1)
    energy += G * (mass * frames["displacement"][:, :, 2])[:, free].sum(axis=1)
    lost = energy[0] - energy[-1]
    assert lost > 0.7 * G * 0.6 * mass[free].sum()
    assert energy.max() < energy[0] + 1e-6 * lost
    # between impacts no more may be regained than was stored in contacts
    assert (energy - np.minimum.accumulate(energy)).max() < 0.03 * lost
    # at rest on the floor, and penetration no deeper than the weight causes
    assert np.abs(frames["velocity"][-50:]).max() < 1e-9
    place = motion.state.bodies.position + motion.state.middle
    assert place[free, 2].max() < -0.3
    parts = bodies_of(result.assembly.shapes, place, motion.state.bodies.rotation)
    pairs = np.array([(i, j) for j in range(len(mass)) for i in range(j) if free[i] or free[j]])
    depth = overlap_depths(parts, pairs)
    weight = G * mass[free].sum()
    # a stone on a corner penetrates by d with kn d^3 its weight, one on a face by a thousandth of that
    assert 0.0 < depth.max() < (mass[free].max() * G / 1e9) ** (1.0 / 3.0)
    held = motion.contact_detection.pressed(motion.state.middle)
    below = held["blocks"][:, 0] == 0
    assert held["force"][below, 2].sum() == pytest.approx(weight, rel=1e-3)


@pytest.mark.parametrize("step", [12, 150])
def test_a_collapse_goes_on_from_a_checkpoint(tmp_path, collapsed, step):
    """Stopped before and during the fall and restarted, the run equals the uninterrupted one bit for bit."""
    whole, path = collapsed
    stop_at_look(collapse(checkpoint=1e9), tmp_path / "parts.h5", step)
    result = restart(tmp_path / "parts.h5")
    assert result.displacement.tobytes() == whole.displacement.tobytes()
    with h5py.File(path) as one, h5py.File(tmp_path / "parts.h5") as other:
        for name in ("history/displacement", "frames/position", "frames/orientation"):
            assert one[name][()].tobytes() == other[name][()].tobytes()


@pytest.mark.slow
def test_a_wall_of_ten_by_ten_comes_to_rest_where_it_falls():
    """All blocks lie on the ground or on blocks that do, nothing moves any more, and the energy is that of lying
    blocks.

    The first and the last block of a course stand on their sides and rock for 3.9 s; the ground is so wide that none
    rolls off it.
    """
    given = toml.load(SCENARIOS / "wall_collapse.toml", ["control.duration=4.5"])
    ground, *others = given.blocks
    result = simulate(dataclasses.replace(given, blocks=(dataclasses.replace(ground, box=(9.0, 9.0, 0.2)), *others)))
    motion = result.run.motion
    height = motion.state.bodies.position[1:, 2] + motion.state.middle[2]
    assert 0.049 < height.min() and height.max() < 0.2
    assert np.abs(result.frames["velocity"][-1]).max() < 0.01
    weight = G * result.assembly.mass[1:].sum()
    held = motion.contact_detection.pressed(motion.state.middle)
    on_ground = held["blocks"][:, 0] == 0
    joints = motion.state.links.wrench[motion.state.links.other == 0, 2].sum()
    assert held["force"][on_ground, 2].sum() + joints == pytest.approx(weight, rel=0.02)


@pytest.mark.slow
def test_threads_change_no_bit(monkeypatch):
    """New contacts are computed by one thread, in the order of the pairs."""
    alone = simulate(collapse())
    monkeypatch.setattr(chunks, "MANY", 1)
    together = simulate(collapse())
    assert together.displacement.tobytes() == alone.displacement.tobytes()


def test_a_history_counts_new_contacts(tmp_path):
    """A block falls 5 mm onto the floor and stays there: no new contact on the way down, one after it has landed."""
    made = scene(
        DynamicControl(0.15, 0.2), FLOOR, block(0.005), stiffness=1e8, output=Output(("energy", "frames"), 50, 10)
    )
    result = simulate(made, history=tmp_path / "run.h5")
    with history.read(result.history) as file:
        time, count = file.time, file.new_contacts
        assert file.series("new_contacts").shape == file.time.shape
    landing = math.sqrt(2.0 * 0.005 / G)
    assert (count[time < 0.95 * landing] == 0.0).all()
    assert count[-1] == 1.0


@pytest.mark.parametrize("made", [collapse(), toml.load(SCENARIOS / "rocking_block.toml")], ids=["collapse", "rocking"])
def test_pairs_are_looked_for_no_later_for_looking_seldom(monkeypatch, made):
    """Contact detection runs at the same moments whether motion is checked seldom or after every chunk of steps."""
    made = dataclasses.replace(made, output=Output((), rows=220, frames=110))
    asked, looked = [], []
    stirred, look = ContactDetection._stirred, ContactDetection._look
    monkeypatch.setattr(ContactDetection, "_stirred", lambda *given: asked.append(0) or stirred(*given))
    monkeypatch.setattr(
        ContactDetection, "_look", lambda *given: looked.append(given[0].looked.tobytes()) or look(*given)
    )
    simulate(made)
    few, moments = len(asked), looked.copy()
    asked.clear(), looked.clear()
    monkeypatch.setattr(ContactDetection, "_patient", lambda *given: 0.0)
    simulate(made)
    assert few < len(asked) and len(moments) > 20
    assert looked == moments


@pytest.mark.parametrize(
    "formulation, friction, told", [("convex", 2.0, True), ("convex", 0.1, False), ("concave", 2.0, False)]
)
def test_small_rocking_over_stiff_springs_is_remarked_on(formulation, friction, told):
    """Shaken a little above g b / h the block rocks by 0.008 rad, or by 1e-5 rad if it slides before it lifts."""
    tall = Block("tall", "stone", (0.25, 0.3, 1.0), (0.0, 0.0, 0.5))
    control = BaseMotionControl(0.7, (1.0, 0.0, 0.0), restitution=0.5, sine=Sine(2.6, 1.0))
    result = simulate(scene(control, FLOOR, tall, formulation=formulation, friction=friction, stiffness=1e11))
    assert bool(result.left_out) == told
