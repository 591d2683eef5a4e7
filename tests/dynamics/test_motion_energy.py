"""The energy balance of runs in real time: it closes, terms agree with closed forms, and wrong ones are detected."""

import dataclasses
import json
import math

import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.errors import EnergyAuditError
from dembrick.runs.simulate import simulate
from dembrick.scenario import model
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Pulse, PushoverControl, Sine
from dembrick.scenario.model import Block, Load, Output, Solver
from dembrick.simulation import energy_audit
from dembrick.simulation.channels import energies as energies_of
from helpers.custom_laws import COHESIVE
from helpers.key_lines import words
from helpers.stone_scenes import law, of_stone

FORMULATIONS = ("concave", "corrected-shear", "distributed", "convex")
G = 9.81


def scene(formulation, control, *blocks, friction=0.64, gravity=(0.0, 0.0, -G), stiffness=1e9, factor=0.9, loads=()):
    """Blocks on a large floor."""
    return of_stone(
        law(formulation, friction, stiffness),
        control,
        (Block("floor", "stone", (4.0, 4.0, 0.1), (0.0, 0.0, -0.05), fixed=True), *blocks),
        gravity=gravity,
        solver=Solver(step_factor=factor),
        output=Output(("joints", "energy", "frames", "velocity"), rows=400, frames=40),
        loads=loads,
    )


def block(edges=(0.3, 0.2, 0.1), place=(0.0, 0.0), lift=0.0, name="block", **more):
    return Block(name, "stone", edges, (*place, 0.5 * edges[2] + lift), **more)


def mass(edges=(0.3, 0.2, 0.1)):
    return 2000.0 * math.prod(edges)


def off(energies):
    """The residual of every row (J)."""
    gone = sum(values for name, values in energies.items() if name != "external")
    return gone - energies["external"] - energies["kinetic"][0]


def slope(formulation):
    psi = math.radians(40.0)
    gravity = (10.0 * math.sin(psi), 0.0, -10.0 * math.cos(psi))
    return scene(formulation, DynamicControl(0.1), block(), friction=math.tan(math.radians(20.0)), gravity=gravity)


def spinning(formulation):
    return scene(formulation, DynamicControl(0.3), block((0.3, 0.2, 0.01), angular_velocity=(0.0, 0.0, 10.0)))


def rocking(formulation, factor=0.9, stiffness=1e9):
    """Set rotating about one edge, the block lands on the other, twice over."""
    free = block((0.2, 0.6, 1.0), angular_velocity=(0.0, 0.8, 0.0))
    return scene(formulation, DynamicControl(1.2), free, factor=factor, stiffness=stiffness)


def swinging(formulation):
    """Oscillates vertically on soft springs that never open, undamped."""
    control = DynamicControl(0.1, restitution=1.0)
    return scene(formulation, control, block(velocity=(0.0, 0.0, -1e-3)), stiffness=1e7, factor=0.2)


def landing(formulation):
    """One block falls 1 mm onto another at rest."""
    return scene(formulation, DynamicControl(0.2), block(), block(place=(0.05, 0.0), lift=0.101, name="upper"))


def handed_over(formulation):
    """A block that overturns about an edge: its joint is handed over to a new contact."""
    return scene(formulation, DynamicControl(0.7), block((0.2, 0.3, 0.5)), friction=2.0, gravity=(5.0, 0.0, -G))


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_gravity_drives_and_friction_brakes_on_a_slope(formulation):
    """Work of gravity m g s sin(psi), of friction mu m g s cos(psi), along the displacement up to the last forces."""
    result = simulate(slope(formulation))
    energies, dt = result.rows["energy"], result.run.motion.time_step
    psi = math.radians(40.0)
    way = result.frames["displacement"][:, 1, 0] - dt * result.frames["velocity"][:, 1, 0] + 0.5 * 3.63970 * dt**2
    way -= way[0]  # the dead-load equilibrium comes first
    assert way[-1] == pytest.approx(0.5 * 3.63970 * (0.1 - dt) ** 2, rel=2e-3)
    assert energies["external"][-1] == pytest.approx(mass() * 10.0 * math.sin(psi) * way[-1], rel=1e-5)
    pressed = mass() * 10.0 * math.cos(psi) * math.tan(math.radians(20.0)) * way[-1]
    assert energies["friction"][-1] == pytest.approx(pressed, rel=2e-3)  # except for the elastic slip before it slides
    speed = result.frames["velocity"][-1, 1, 0] - 3.63970 * dt
    assert energies["kinetic"][-1] == pytest.approx(0.5 * mass() * speed**2, rel=2e-3)
    assert np.abs(off(energies)).max() < 1e-10 * energies["external"].max()
    assert result.energy.relative_residual < 1e-10
    assert abs(result.energy.friction_law_error) < 1e-3


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_shaken_supports_put_in_what_friction_takes(formulation):
    """Newmark's pulse: once the block has stopped, both energies are mu m g times its slip of 0.14715 m."""
    control = BaseMotionControl(1.0, (1.0, 0.0, 0.0), pulse=Pulse(0.5 * G, 0.2))
    edges = (0.3, 0.2, 0.01)
    result = simulate(scene(formulation, control, block(edges), friction=0.2))
    energies, expected = result.rows["energy"], 0.2 * mass(edges) * G * 0.14715
    assert energies["external"][-1] == pytest.approx(expected, rel=1e-3)
    assert energies["friction"][-1] == pytest.approx(expected, rel=1e-3)
    assert result.energy.relative_residual < 1e-10


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_friction_takes_all_of_a_spin(formulation):
    edges = (0.3, 0.2, 0.01)
    result = simulate(spinning(formulation))
    energies = result.rows["energy"]
    spun = 0.5 * mass(edges) * (edges[0] ** 2 + edges[1] ** 2) / 12.0 * 10.0**2
    assert energies["kinetic"][0] == pytest.approx(spun, rel=1e-6)
    assert energies["friction"][-1] == pytest.approx(spun, rel=3e-3)
    assert np.abs(energies["external"]).max() < 1e-6 * spun
    assert result.energy.relative_residual < 1e-5


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_springs_that_stay_closed_keep_all_energy(formulation):
    """An oscillation of speed v = a sin(w dt) / dt on the stiffness k A, with sin(w dt / 2) = (dt / 2) sqrt(k A / m):
    the springs store N^2 / (2 k A), between its values at the amplitude a above and a below."""
    result = simulate(swinging(formulation))
    energies = result.rows["energy"]
    put_in = 0.5 * mass() * 1e-3**2
    assert energies["kinetic"][0] == pytest.approx(put_in, rel=1e-6)
    for name in ("friction", "dashpots", "released", "stepping", "new_contacts"):
        assert np.abs(energies[name]).max() < 1e-9 * put_in, name
    k, dt = 1e7 * 0.3 * 0.2, result.run.motion.time_step
    depth, swing = mass() * G / k, 1e-3 * dt / math.sin(2.0 * math.asin(0.5 * dt * math.sqrt(k / mass())))
    for extreme, height in ((energies["elastic"].min(), swing), (energies["elastic"].max(), -swing)):
        assert extreme == pytest.approx(0.5 * k * ((depth - height) ** 2 - depth**2), rel=2e-3)
    assert np.abs(off(energies)).max() < 1e-8 * put_in


@pytest.mark.parametrize("formulation", ["concave", "distributed", "convex"])
def test_free_rocking_loses_energy_in_impacts_only(formulation):
    """Between impacts the sum of kinetic, elastic and potential energy is constant, except for residual vibrations."""
    result = simulate(rocking(formulation))
    energies, time = result.rows["energy"], result.rows["time"]
    assert result.energy.relative_residual < 1e-5
    lost = sum(energies[name] for name in ("friction", "dashpots", "released", "stepping"))
    assert lost[-1] > 0.5 * energies["kinetic"][0]
    rate = np.diff(lost) / np.diff(time)
    free = np.sort(np.abs(rate))[: len(rate) // 2]  # most of the time the block rotates about an edge without impact
    assert free.max() * time[-1] < 0.02 * energies["kinetic"][0]
    assert abs(result.energy.step_error) < 5e-3


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_residual_falls_with_the_square_of_the_step(formulation):
    """The residual stems from the rotation of the joint within a step, so it falls with the square of the step."""
    coarse, fine = (simulate(rocking(formulation, factor)).energy.relative_residual for factor in (0.9, 0.225))
    assert fine < coarse / 8.0


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_that_lands_on_another_leaves_its_fall_with_new_contacts_and_joints(formulation):
    result = simulate(landing(formulation))
    energies = result.rows["energy"]
    fallen = mass() * G * (1e-3 + 2e-6)
    assert energies["external"][-1] == pytest.approx(fallen, rel=0.01)
    assert energies["new_contacts"][-1] > 0.1 * fallen
    assert energies["new_contacts"][0] == 0.0 and energies["kinetic"][-1] < 1e-6 * fallen
    assert result.energy.relative_residual < 1e-5


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_the_energy_balance_goes_on_where_joints_are_handed_over(formulation):
    result = simulate(handed_over(formulation))
    assert result.run.motion.energy.table.share[0] == 0.0
    assert result.rows["new_contacts"].max() > 0
    assert np.abs(result.rows["energy"]["new_contacts"]).max() > 0.01 * result.rows["energy"]["kinetic"][0]
    assert result.energy.relative_residual < 1e-4


def test_work_of_a_load_that_varies_beside_the_centroid():
    """A block is pushed back and forth and twisted; without the work of the couple the energy would not balance."""
    control = DynamicControl(0.2)
    load = Load("block", (40.0, 10.0, 0.0), point=(0.1, 0.05, 0.06), sine=model.Sine(1.0, 8.0, 0.3))
    result = simulate(scene("concave", control, block(), friction=0.1, loads=(load,)))
    energies = result.rows["energy"]
    assert energies["external"].max() > 0.05
    assert result.energy.relative_residual < 1e-8


def test_a_push_in_real_time_balances():
    control = PushoverControl((1.0, 0.0, 0.0), quasi_static=False, displacement=0.004, rate=0.02)
    walls = (model.Wall("wall", "stone", (0.3, 0.2, 0.1), 2, 2, base=0.1),)
    pushed = dataclasses.replace(scene("concave", control), blocks=(), walls=walls)
    result = simulate(pushed)
    assert result.rows["energy"]["friction"][-1] > 0.5 * result.rows["energy"]["external"][-1]
    assert result.energy.relative_residual < 1e-5


BALANCED = {  # scene, greatest residual relative to the energy input, terms that the balance then checks to a per cent
    "slope": (slope, 1e-10, ("kinetic", "external", "friction")),
    "spinning": (spinning, 1e-5, ("kinetic", "friction")),
    "swinging": (swinging, 1e-8, ("kinetic", "elastic", "external")),
    "rocking": (rocking, 5e-6, ("kinetic", "elastic", "external", "friction", "dashpots")),
    "landing": (landing, 1e-5, ("kinetic", "external", "dashpots", "new_contacts")),
}


@pytest.mark.parametrize("name", BALANCED)
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_term_that_is_one_per_cent_off_is_seen(formulation, name):
    make, bound, terms = BALANCED[name]
    energies = simulate(make(formulation)).rows["energy"]
    scale = (np.abs(energies["external"]) + energies["kinetic"][0]).max()
    assert set(energies) == set(energies_of(real_time=True))
    assert np.abs(off(energies)).max() < bound * scale
    for term in terms:
        wrong = energies | {term: 1.01 * energies[term]}
        if term == "kinetic":  # the first row is the initial kinetic energy
            wrong["kinetic"] = np.append(energies["kinetic"][:1], wrong["kinetic"][1:])
        assert np.abs(off(wrong)).max() > bound * scale, term


@pytest.mark.parametrize("formulation, terms", [("concave", ("released", "stepping")), ("convex", ("stepping",))])
def test_what_joints_let_go_and_steps_take_is_seen_as_well(formulation, terms):
    """Both terms are small: an error of a tenth is detected."""
    energies = simulate(rocking(formulation)).rows["energy"]
    scale = (np.abs(energies["external"]) + energies["kinetic"][0]).max()
    for term in terms:
        assert np.abs(off(energies | {term: 1.1 * energies[term]})).max() > 5e-6 * scale, term


def test_an_energy_that_does_not_balance_fails_the_run(monkeypatch):
    monkeypatch.setattr(energy_audit, "MOTION", 1e-20)
    monkeypatch.setattr("dembrick.simulation.dynamics.run.rounding", lambda moving: 0.0)
    with pytest.raises(EnergyAuditError, match="off by"):
        simulate(rocking("concave"))
    monkeypatch.undo()
    monkeypatch.setattr(energy_audit, "STEPPING", 1e-9)
    with pytest.raises(EnergyAuditError, match="open and close within a time step"):
        simulate(rocking("concave"))


def test_nothing_is_balanced_where_nobody_asks_and_the_motion_is_the_same():
    asked = rocking("concave")
    silent = simulate(dataclasses.replace(asked, output=Output(("frames",), rows=400, frames=40)))
    assert silent.rows["energy"] == {} and silent.energy is None and silent.as_dict()["energy"] is None
    balanced = simulate(asked)
    np.testing.assert_array_equal(silent.frames["displacement"], balanced.frames["displacement"])
    shown = balanced.as_dict()["energy"]
    assert shown == dataclasses.asdict(balanced.energy)
    assert set(shown) == {
        "relative_residual", "friction_law_error", "least_friction_increment", "step_error"
    }  # fmt: skip
    json.dumps(shown)


def test_a_history_has_every_energy(tmp_path, capsys):
    path = tmp_path / "run.h5"
    result = simulate(landing("concave"), path)
    with history.read(path) as found:
        assert set(found.energy_names) == set(energies_of(real_time=True))
        np.testing.assert_array_equal(found.energy["friction"], result.rows["energy"]["friction"])
        assert found.results["energy"]["relative_residual"] == result.energy.relative_residual
    assert main(["info", str(path)]) == 0
    shown = capsys.readouterr().out
    (line,) = (line for line in shown.splitlines() if line.startswith("energy balance"))
    assert f"{result.energy.relative_residual:.1e}" in line
    assert f"energy balance {result.energy.relative_residual:.1e} (residual" in words(result.text())


def test_polygons_that_are_cut_keep_the_energy_balance():
    """A block slides over the edge of another: the elastic energy of the area it loses is counted as released."""
    below = Block("below", "stone", (0.3, 0.3, 0.1), (0.0, 0.0, 0.05), fixed=True)
    over = Block("over", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.15), velocity=(0.9, 0.0, 0.0))
    for formulation, rounding in (("concave", 5e-11), ("distributed", 5e-11), ("convex", 2e-10)):
        result = simulate(scene(formulation, DynamicControl(0.15), below, over))
        assert result.displacement[-1, 0] > 0.05
        assert result.energy.relative_residual < rounding, formulation


@pytest.mark.parametrize(
    "formulation, law",
    [*((name, None) for name in (*FORMULATIONS, "corrected")), *((name, COHESIVE) for name in FORMULATIONS[:3])],
)
def test_cohesion_brakes_by_the_area_that_is_left_on_a_floor_of_the_same_size(formulation, law):
    """m x'' = -mu m g - c b (L - x), with a constant cohesion c and the overlap b (L - x), from v to rest; also by a
    law of the user's own."""
    cohesion, friction, length, width, speed = 500.0, 0.3, 0.3, 0.2, 0.9
    below = Block("below", "stone", (length, width, 0.1), (0.0, 0.0, 0.05), fixed=True)
    over = Block("over", "stone", (length, width, 0.04), (0.0, 0.0, 0.12), velocity=(speed, 0.0, 0.0))
    # the usual dashpots take up to 0.1 % of the speed as the springs of a user's own law are loaded
    dry = scene(formulation, DynamicControl(0.3, restitution=0.95 if law else 0.5), below, over, friction=friction)
    bonded = dataclasses.replace(dry.joint, cohesion=cohesion, residual_cohesion=cohesion)
    result = simulate(dry if law else dataclasses.replace(dry, joint=bonded), law=law)
    # speed^2 / 2 = mu g x + b c (L x - x^2 / 2) / m
    c, b = friction * G, cohesion * width / mass((length, width, 0.04))
    half = c / b + length
    x = half - math.sqrt(half**2 - speed**2 / b)
    assert result.displacement[-1, 0] == pytest.approx(x, rel=8e-4 if law else 3e-4)
    assert result.energy.relative_residual < 5e-10


def test_a_wall_at_rest_is_held_against_what_its_springs_hold():
    """Almost no energy is put in: the residual is rounding, is compared with the elastic energy and is no failure."""
    walls = (model.Wall("wall", "stone", (0.3, 0.2, 0.1), 3, 3, base=0.1),)
    still = dataclasses.replace(scene("concave", DynamicControl(0.2)), blocks=(), walls=walls)
    result = simulate(still)
    assert result.energy.relative_residual < 1e-4
    shaken = dataclasses.replace(still, control=BaseMotionControl(0.5, (0.0, 1.0, 0.0), sine=Sine(4.0, 2.0)))
    assert simulate(shaken).energy.relative_residual < 1e-6
