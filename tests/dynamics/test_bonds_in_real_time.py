"""Bonded joints in real time: a block on a base that moves by a pulse, against closed forms."""

import numpy as np
import pytest

from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from helpers.restart_cases import check_same, stop_at_look
from helpers.scenario_text import block, header

CONTROL = """
[control]
kind = "base-motion"
direction = [1.0, 0.0, 0.0]
{shake}
duration = 0.5
[output]
rows = 200
frames = 20
checkpoint = 0.0
"""
BLOCKS = block("base", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true") + block(
    "block", (0.0, 0.0, 0.02), (0.3, 0.2, 0.04)
)
MASS, AREA, G = 2000.0 * 0.3 * 0.2 * 0.04, 0.06, 9.81
PULSE = "pulse = { amplitude = 4.905, duration = 0.2 }"


def shaken(formulation, keys, shake=PULSE):
    return toml.loads(header(formulation, 0.2, keys=keys) + BLOCKS + CONTROL.format(shake=shake))


def bond(threshold):
    """Keys of a bond that, with friction 0.2, slides at this acceleration of the base (m/s2)."""
    c = (threshold - 0.2 * G) * MASS / AREA
    return f"cohesion = {c!r}\ntensile_strength = {c!r}"


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_broken_bond_slides_as_a_dry_joint(formulation):
    """Newmark's block slides (A - mu g) t^2 / 2 + ((A - mu g) t)^2 / (2 mu g) = 0.147150 m once its bond has broken."""
    result = simulate(shaken(formulation, bond(0.3 * G)))
    assert result.rows["displacement"][-1] == pytest.approx(0.147150, rel=5e-3)
    held = result.frames["bond"][:, 0]
    assert held[0] == 1.0 and held[-1] == 0.0


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_bond_that_holds_lets_nothing_slide(formulation):
    """A sudden pulse makes the springs swing to twice the static force, so a bond for 1.1 g withstands 0.5 g."""
    result = simulate(shaken(formulation, bond(1.1 * G)))
    assert result.rows["displacement"][-1] < 1e-5
    assert np.all(result.frames["bond"] == 1.0)
    assert result.rows["energy"]["fracture"][-1] == 0.0 and result.rows["energy"]["friction"][-1] == 0.0


def test_residual_friction_in_real_time():
    """Friction 0.2, and 0.1 after the first slip: the slip is 0.4 g t^2 / 2 + (0.4 g t)^2 / (0.2 g) = 0.39240 m."""
    scenario = shaken("convex", "residual_friction = 0.1")
    slip = 0.4 * G * 0.04 / 2.0 + (0.4 * G * 0.2) ** 2 / (0.2 * G)
    longer = toml.loads(toml.dumps(scenario), overrides=["control.duration=1.2"])
    assert simulate(longer).rows["displacement"][-1] == pytest.approx(slip, rel=5e-3)


@pytest.mark.parametrize("formulation", ["concave", "convex", "distributed"])
@pytest.mark.parametrize("dilation", [0.05, 0.15])
def test_a_joint_that_dilates_lifts_the_block_as_it_slides(formulation, dilation):
    """Newmark's block on a joint that rises by t of its slip: N = m (g + t a) and m (A - a) = mu N while it speeds up,
    so that a = (A - mu g) / (1 + mu t); then it slows down by mu g / (1 + mu t)."""
    A, T, mu, t = 4.905, 0.2, 0.2, dilation
    scenario = shaken(formulation, f"dilation = {t}")
    result = simulate(toml.loads(toml.dumps(scenario), overrides=["control.duration=0.8"]))
    faster, slower = (A - mu * G) / (1.0 + mu * t), mu * G / (1.0 + mu * t)
    slip = 0.5 * faster * T**2 + (faster * T) ** 2 / (2.0 * slower)
    assert result.rows["displacement"][-1] == pytest.approx(slip * np.hypot(1.0, t), rel=2e-3)
    assert result.frames["displacement"][-1, -1, 2] == pytest.approx(t * slip, rel=2e-3)
    time, normal = result.rows["time"], result.rows["joint"][:, 0, 0]
    sliding = (time > 0.05) & (time < 0.95 * T)
    assert sliding.sum() > 20
    assert normal[sliding] == pytest.approx(MASS * (G + t * faster), rel=1e-3)
    first = 0.5 * faster * T**2
    taken = MASS * (mu - t) * ((G + t * faster) * first + (G - t * slower) * (slip - first))
    assert result.rows["energy"]["friction"][-1] == pytest.approx(taken, rel=5e-3)
    assert abs(result.energy.relative_residual) < 1e-9


def test_a_joint_that_dilates_opens_if_its_block_jumps():
    """Thrown up by a downward jerk of the base, the block flies and lands where it left."""
    shake = "sine = { amplitude = 15.0, frequency = 20.0 }"
    text = toml.dumps(shaken("concave", "dilation = 0.1", shake)).replace("[1.0, 0.0, 0.0]", "[0.0, 0.0, 1.0]", 1)
    result = simulate(toml.loads(text.replace('"energy", ', "")))
    flies = result.rows["joint"][:, 0, 0] == 0.0
    assert flies.any() and not flies.all()
    assert abs(result.frames["displacement"][-1, -1, 0]) < 1e-6


WALL = """
[[walls]]
name = "wall"
material = "stone"
block = [0.3, 0.2, 0.1]
courses = 3
blocks = 3
ends = "half"
position = [0.0, 0.0, 0.0]
"""


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_mortar_without_strength_is_the_dry_wall_bit_for_bit(formulation):
    """A joint with f_t = c = 0, shaken until it slides, uses the same law, kernel and memory as a dry joint."""
    mortar = "cohesion = 0.0\ntensile_strength = 0.0\nresidual_cohesion = 0.0\nresidual_friction = 0.2\ndilation = 0.0"
    floor = block("base", (0.5, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    control = CONTROL.format(shake=PULSE).replace("duration = 0.5", "duration = 0.05")
    wet, dry = (
        simulate(toml.loads(header(formulation, 0.2, keys=keys) + floor + WALL + control)) for keys in (mortar, "")
    )
    assert dry.rows["displacement"][-1] > 1e-3
    for name in ("displacement", "load", "joint", "reaction"):
        np.testing.assert_array_equal(wet.rows[name], dry.rows[name])
    np.testing.assert_array_equal(wet.frames["orientation"], dry.frames["orientation"])


def test_what_breaks_and_crushes_is_restarted_to_the_last_bit(tmp_path):
    """A run in which points break and crush, restarted from a checkpoint, equals the uninterrupted one bit for bit."""
    scenario = shaken("concave", bond(0.3 * G) + "\ncompressive_strength = 810.0")
    whole, stopped = tmp_path / "whole.h5", tmp_path / "stopped.h5"
    result = simulate(scenario, whole)
    assert result.rows["energy"]["crushing"][-1] > 0.0 and result.rows["energy"]["fracture"][-1] != 0.0
    stop_at_look(scenario, stopped, 40)
    restart(stopped)
    check_same(whole, stopped)


def thrown(formulation, speed, c, thick):
    """A plate of this thickness on a bond of cohesion c (Pa), thrown along its joint."""
    text = header(formulation, 0.2, 1e8, keys=f"cohesion = {c}\ntensile_strength = {c}")
    text += block("base", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    text += block("block", (0.0, 0.0, 0.5 * thick), (0.3, 0.2, thick), f"velocity = [{float(speed)!r}, 0.0, 0.0]")
    return toml.loads(f'{text}[control]\nkind = "dynamic"\nduration = 2e-3\n[solver]\nstep_factor = 0.02\n')


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_dashpots_break_no_bond(formulation):
    """m x'' + 2 z w m x' + k x = 0 from x' = v: the spring force reaches at most k v / w exp(-z atan(s / z) / s) with s
    = sqrt(1 - z^2). The bond breaks at that force, whatever the dashpot carries beside the spring."""
    c, thick = 3000.0, 0.002
    mass, k = 2000.0 * AREA * thick, 4e7 * AREA
    moving = simulate(thrown(formulation, 1e-3, c, thick)).run.motion
    z = 0.5 * float(moving.state.links.viscous[0, 1]) * moving.time_step * np.sqrt(k / mass)
    s = np.sqrt(1.0 - z * z)
    speed = (c * AREA + 0.2 * mass * G) / np.sqrt(k * mass) * np.exp(z * np.arctan(s / z) / s)
    for share, held in ((0.995, 1.0), (1.005, 0.0)):
        result = simulate(thrown(formulation, share * speed, c, thick))
        assert result.frames["bond"][-1, 0] == held
    assert result.rows["energy"]["fracture"][-1] > 0.3 * 0.5 * mass * speed**2  # the elastic energy of its springs
