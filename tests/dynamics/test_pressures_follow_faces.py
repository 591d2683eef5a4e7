"""Pressures on moving blocks follow the faces, a fluid's with the present depth; against hydrostatics."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import UndecidedError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario.blocks import Part
from dembrick.scenario.controls import DisplacementControl, DynamicControl, PushoverControl, TiltControl
from dembrick.scenario.model import Block, JointLaw, Material, Output, Scenario
from dembrick.scenario.pressures import Pressure
from dembrick.simulation.dynamics import memory_order
from dembrick.simulation.dynamics.paths import equilibria
from helpers.restart_cases import check_same, stop_at_look
from helpers.stone_scenes import law, of_stone

G = 9.81
WATER = 1000.0 * G  # N/m3
STRAIGHT = np.eye(3)


def all_round(axes=STRAIGHT, block="block", **fluid):
    """The same pressure on all six faces of a box whose axes are the columns of ``axes``."""
    normals = [sign * axis for axis in np.asarray(axes).T for sign in (1.0, -1.0)]
    return tuple(Pressure(block, tuple(normal), **fluid) for normal in normals)


def scene(edges, density, pressures, duration=0.2, place=(0.0, 0.0, 0.0), bed=-20.0, **more):
    """A box, and a bed far below it."""
    keys = {name: more.pop(name) for name in ("orientation", "angular_velocity", "velocity") if name in more}
    return Scenario(
        title="a block in a fluid",
        gravity=more.pop("gravity", (0.0, 0.0, -G)),
        joint=JointLaw("concave", 0.5, 1e7, 4e6),
        materials={"stone": Material(density), "bed": Material(2000.0)},
        blocks=(
            Block("bed", "bed", (1.0, 1.0, 0.1), (0.0, 0.0, bed), fixed=True),
            Block("block", "stone", edges, place, **keys),
        ),
        pressures=pressures,
        control=DynamicControl(duration),
        output=Output(("energy", "frames", "velocity"), rows=40, frames=40),
        **more,
    )


def turned(rng):
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    return q, rotation_matrix(q[None])[0]


@pytest.mark.parametrize("number", range(5))
def test_a_block_under_water_rises_without_turning(number):
    """Archimedes: a = (rho_w / rho - 1) g upwards without moment, for five sizes and attitudes each."""
    rng = np.random.default_rng(100 + number)
    for _ in range(5):
        edges, density = tuple(rng.uniform(0.1, 0.5, 3)), rng.uniform(200.0, 3000.0)
        q, axes = turned(rng)
        water = all_round(axes, surface=9.0, weight=WATER)
        frames = simulate(scene(edges, density, water, place=(0.0, 0.0, 2.0), orientation=tuple(q))).frames
        rise = 0.5 * (1000.0 / density - 1.0) * G * 0.2**2
        np.testing.assert_allclose(frames["displacement"][-1, 1], [0.0, 0.0, rise], rtol=1e-6, atol=1e-11)
        np.testing.assert_allclose(frames["spin"][:, 1], 0.0, atol=1e-11)


def test_a_uniform_pressure_all_round_has_no_resultant():
    """A block that spins about a principal axis and flies without gravity keeps its motion."""
    q, axes = turned(np.random.default_rng(5))
    spin = axes @ [0.0, 0.0, 20.0]
    squeezed = scene(
        (0.3, 0.2, 0.1), 1000.0, all_round(axes, value=1e7), orientation=tuple(q), angular_velocity=tuple(spin),
        velocity=(1.0, 2.0, 3.0), gravity=(0.0, 0.0, 0.0),
    )  # fmt: skip
    frames = simulate(squeezed).frames
    np.testing.assert_allclose(frames["velocity"][:, 1], [[1.0, 2.0, 3.0]] * len(frames["time"]), atol=1e-9)
    np.testing.assert_allclose(frames["spin"][:, 1], [spin] * len(frames["time"]), atol=1e-7)


def metacentre(edges, density):
    """GM (m) of a box with these edges (beam along y) that floats upright: KB + BM - KG."""
    _, beam, height = edges
    draught = density / 1000.0 * height
    return 0.5 * draught + beam**2 / (12.0 * draught) - 0.5 * height


def floating(edges, density, angle, duration, **more):
    draught = density / 1000.0 * edges[2]
    q = (math.cos(0.5 * angle), math.sin(0.5 * angle), 0.0, 0.0)
    axes = rotation_matrix(np.array([q]))[0]
    water = all_round(axes, surface=draught - 0.5 * edges[2], weight=WATER)
    return scene(edges, density, water, duration, orientation=q, **more)


@pytest.mark.parametrize("number", range(10))
def test_a_floating_block_rolls_about_its_metacentre(number):
    """phi'' = -m g GM / I phi for small angles: the block rolls if GM > 0 and capsizes if GM < 0; heave is second
    order."""
    rng = np.random.default_rng(200 + number)
    density, ratio = rng.uniform(200.0, 800.0), rng.uniform(0.5, 2.0)
    height = rng.uniform(0.2, 0.4)
    edges = (0.5, ratio * height, height)
    rate = metacentre(edges, density) * G * 12.0 / (edges[1] ** 2 + edges[2] ** 2)  # 1/s2
    duration = 3.0 / math.sqrt(abs(rate))
    frames = simulate(floating(edges, density, 1e-4, duration)).frames
    angle = 2.0 * frames["orientation"][:, 1, 1]
    grow = np.cos if rate > 0.0 else np.cosh
    expected = 1e-4 * grow(math.sqrt(abs(rate)) * frames["time"])
    np.testing.assert_allclose(angle, expected, atol=2e-3 * np.abs(expected).max())


def test_a_fluid_at_rest_keeps_the_energy():
    """A light block, released rotated, rises, leaves the water and flies: its kinetic energy is its buoyancy times its
    depth less its weight times its rise; the recorded energies agree within the bound of the audit."""
    edges, density, depth = (0.3, 0.25, 0.2), 300.0, 1.5
    q, axes = turned(np.random.default_rng(11))
    water = all_round(axes, surface=depth, weight=WATER)
    result = simulate(scene(edges, density, water, 1.05, orientation=tuple(q), angular_velocity=(1.0, 2.0, 0.5)))
    volume, frames, energy = math.prod(edges), result.frames, result.rows["energy"]
    rise = frames["displacement"][-1, 1, 2]
    assert rise > depth + 0.3  # out of the water
    lifted = energy["external"][-1] + volume * density * G * rise
    np.testing.assert_allclose(lifted, volume * WATER * depth, rtol=1e-3)  # energies lag positions by a step
    gained = energy["kinetic"][-1] - energy["kinetic"][0]
    np.testing.assert_allclose(gained, energy["external"][-1], rtol=1e-7)


def test_a_block_that_falls_into_water_is_stopped_by_it():
    """Dry at the start, the block meets the water only later. Energy: a box of density rho that falls by h sinks to the
    depth at which the work of gravity equals the integral of buoyancy."""
    edge, density, height = 0.2, 500.0, 0.3
    water = all_round(surface=-height - 0.5 * edge, weight=WATER)
    frames = simulate(scene((edge,) * 3, density, water, 0.8)).frames
    deepest = -frames["displacement"][:, 1, 2].min()
    # rho b (h + d) = rho_w (d - b / 2) b with the foot d under the surface, once it is covered, d > b
    d = (density * height + 500.0 * edge) / (1000.0 - density)
    assert d > edge
    assert deepest == pytest.approx(height + d, rel=2e-3)


B, H, DENSITY = 0.6, 1.2, 2000.0


def wall(pressures, control, **more):
    return of_stone(
        law("concave", 5.0),
        control,
        (
            Block("base", "stone", (4.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
            Block("wall", "stone", (B, 1.0, H), (0.0, 0.0, 0.5 * H)),
        ),
        materials={"stone": Material(DENSITY)},
        pressures=pressures,
        **more,
    )


def test_a_driven_pressure_turns_with_the_wall_that_it_pushes_over():
    """V p H^2 / 2 = W (B cos t - H sin t) / 2 about the toe: the arm of the pressure is constant; that of a force of
    fixed direction would grow by B sin t."""
    back = Pressure("wall", (-1.0, 0.0, 0.0), value=5000.0, actuator=True)
    control = DisplacementControl(rate=1e-3, travel=0.06, large_displacements=True)
    rows = simulate(wall((back,), control)).rows
    u, V = rows["displacement"], rows["load"]
    far = u > 0.01
    assert far.sum() > 10
    angles = np.linspace(0.0, 0.3, 3001)
    angle = np.interp(u[far], 0.5 * H * np.sin(angles) + B * (1.0 - np.cos(angles)), angles)
    weight = B * H * DENSITY * G
    expected = weight * (B * np.cos(angle) - H * np.sin(angle)) / (5000.0 * H**2)
    np.testing.assert_allclose(V[far], expected, rtol=2e-3)
    dead = expected / (1.0 * np.cos(angle) + 2.0 * B / H * np.sin(angle))
    assert (np.abs(dead / V[far] - 1.0) > 0.01).any()


def test_a_pressure_tilts_with_the_table_and_a_fluid_does_not():
    """Overturning about the toe, in the frame of the table: gravity rotates; a uniform pressure stays normal to the
    wall, and the depth of water is measured from a surface that stays level in the world."""
    weight = B * H * DENSITY * G
    control = TiltControl(axis=(0.0, 1.0, 0.0), large_displacements=True)
    even = simulate(wall((Pressure("wall", (-1.0, 0.0, 0.0), value=3000.0),), control)).collapse["angle"]
    # W (B cos - H sin) / 2 = p H^2 / 2
    reach, lean = math.hypot(B, H), math.atan2(H, B)
    expected = math.degrees(math.acos(3000.0 * H**2 / (weight * reach)) - lean)
    assert even == pytest.approx(expected, rel=3e-3)
    water = Pressure("wall", (-1.0, 0.0, 0.0), surface=1.1, weight=WATER)
    found = simulate(wall((water,), control)).collapse["angle"]

    def moment(angle):
        z = (np.arange(4000) + 0.5) / 4000 * H
        depth = 1.1 - (math.cos(angle) * z + math.sin(angle) * 0.5 * B)  # of the back, x = -B / 2
        pushed = (WATER * np.maximum(depth, 0.0) * z).sum() * H / 4000
        return 0.5 * weight * (B * math.cos(angle) - H * math.sin(angle)) - pushed

    low, high = 0.0, 0.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if moment(middle) > 0.0 else (low, middle)
    assert found == pytest.approx(math.degrees(low), rel=3e-3)


def test_parts_of_one_block_cover_each_other():
    """An L pressed on its side faces carries p times the exposed area, and nothing where its pieces meet."""
    parts = (Part(box=(0.2, 1.0, 0.6), position=(0.1, 0.0, 0.3)), Part(box=(0.4, 1.0, 0.2), position=(0.4, 0.0, 0.1)))
    piece = Block("block", "stone", position=(0.0, 0.0, 0.0), parts=parts)
    given = scene((1.0, 1.0, 1.0), 1000.0, (Pressure("block", (1.0, 0.0, 0.0), value=1000.0),))
    built = assemble(replace(given, blocks=(given.blocks[0], piece)))
    np.testing.assert_allclose(built.point_loads.force.sum(axis=0), [-600.0, 0.0, 0.0], rtol=1e-9, atol=1e-9)


def test_a_floating_block_goes_on_where_it_was_stopped(tmp_path):
    given = floating((0.5, 0.3, 0.2), 500.0, 0.4, 0.5)
    given = replace(given, output=Output(("energy", "frames"), rows=40, frames=40, checkpoint=0.0))
    simulate(given, tmp_path / "whole.h5")
    stop_at_look(given, tmp_path / "stopped.h5", 12)
    restart(tmp_path / "stopped.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "stopped.h5")


def test_pressures_find_their_blocks_in_any_order_of_memory(monkeypatch):
    """Five blocks that bob and a raft of two have the same bits whatever the memory order of the loop."""
    places = ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 2.0))
    blocks = tuple(
        Block(f"b.{i}", "stone", (0.3 + 0.1 * (i % 2), 0.3, 0.2), (*place, 0.02 * i)) for i, place in enumerate(places)
    )
    given = scene((0.1, 0.1, 0.1), 500.0, (), 0.1)
    stack = (
        Block("low", "stone", (0.5, 0.5, 0.2), (-2.0, 0.0, -0.1)),
        Block("high", "stone", (0.4, 0.4, 0.1), (-2.0, 0.0, 0.05)),
    )
    water = [all_round(block=name, surface=0.02, weight=WATER) for name in ("low", *(block.name for block in blocks))]
    given = replace(given, blocks=(given.blocks[0], *blocks, *stack), pressures=sum(water, ()))
    found = []
    for near in (np.inf, -1.0):
        monkeypatch.setattr(memory_order, "NEAR", near)
        monkeypatch.setattr(memory_order, "NEARER", np.inf)
        result = simulate(given)
        found.append((result.frames["displacement"], result.rows["energy"]["external"]))
    assert np.abs(found[0][0][-1, 1:6]).max() > 1e-3
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("control, remedy", [(TiltControl, "quasi_static = false"), (PushoverControl, "large_disp")])
def test_a_load_that_blocks_follow_as_it_changes_with_their_place_is_named(control, remedy, monkeypatch):
    """A block that slides down into water finds rest again, deeper and deeper: no stiffer joint would change that."""
    monkeypatch.setattr(equilibria, "SPARE", 33)  # gives up after five equilibria
    water = Pressure("block", (-1.0, 0.0, 0.0), surface=0.3, weight=WATER)
    way = {"axis": (0.0, -1.0, 0.0)} if control is TiltControl else {"direction": (-1.0, 0.0, 0.0)}
    blocks = (
        Block("floor", "stone", box=(3.0, 3.0, 0.1), position=(0.0, 0.0, -0.05), fixed=True),
        Block("block", "stone", box=(0.4, 0.4, 0.3), position=(0.5, 0.0, 0.15)),
    )
    given = of_stone(law("convex", 0.33), control(**way, large_displacements=True), blocks, pressures=(water,))
    with pytest.raises(UndecidedError, match=f"the pressure on 'block' depends on the height.*{remedy}") as told:
        simulate(given, record=False)
    assert "stiffen" not in str(told.value)
