"""Blocks guided by a test rig, against closed forms, in every kind of control."""

import math

import numpy as np
import pytest

import dembrick
from dembrick import history
from dembrick.errors import ScenarioError
from dembrick.scenario import toml
from helpers.scenario_text import block as floor
from helpers.scenario_text import header

TURNS = '["y", "rx", "ry", "rz"]'
SLIDES = '["y", "rx", "ry", "rz"]'
b, h, G = 0.2, 0.6, 9.81
W, N = 2000.0 * G * b * b * h, 1000.0 * G * 0.4 * 0.2 * 0.2  # of the stone and of the beam on it
DOUBLE_FIXED = (N * b + 0.5 * W * b) / h


def blocks(control: str, *more: str, formulation="concave", friction=0.9, stiffness=1e11) -> str:
    """The text of a scenario with a floor and the tables ``more``."""
    text = f"control = {{{control}}}" + header(formulation, friction, stiffness)
    text += "[materials.beam]\ndensity = 1000.0" + floor("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true")
    return text + "\n".join(more)


def block(name: str, box: list, z: float, *more: str) -> str:
    material = "beam" if name == "beam" else "stone"
    lines = (f"name = '{name}'", f"material = '{material}'", f"box = {box}", f"position = [0, 0, {z}]", *more)
    return "[[blocks]]\n" + "\n".join(lines)


def jack(on: str, z: float) -> str:
    return f"[[actuators]]\nname = 'jack'\nblock = '{on}'\npoint = [-0.2, 0, {z}]\ndirection = [1, 0, 0]"


def under_beam(control: str, held: str | None = TURNS, **law):
    beam = block("beam", [0.4, 0.2, 0.2], h + 0.1, *([f"held = {held}"] if held else []))
    return toml.loads(blocks(control, block("stone", [b, b, h], h / 2), beam, jack("beam", h + 0.1), **law))


def bracket(result) -> tuple[float, float]:
    point = result.as_dict()["yield_point"]
    return point["V_lower"], point["V_upper"]


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_under_a_beam_that_does_not_turn(formulation):
    """It rocks about two opposite edges: V h = N b + W b / 2."""
    scenario = under_beam("kind = 'yield', tolerance = 1e-4", formulation=formulation)
    lower, upper = bracket(dembrick.simulate(scenario, record=False))
    assert lower <= DOUBLE_FIXED * (1.0 + 1e-9) and upper >= DOUBLE_FIXED * (1.0 - 1e-9)
    assert upper - lower < 1e-3 * DOUBLE_FIXED
    bound = dembrick.limit(scenario)
    assert bound.lower == pytest.approx(DOUBLE_FIXED, rel=1e-6) == bound.upper


@pytest.mark.parametrize("formulation", ["corrected", "distributed"])
def test_other_formulations_agree_with_limit_analysis(formulation):
    scenario = under_beam("kind = 'yield', tolerance = 1e-4", formulation=formulation)
    assert dembrick.simulate(scenario, record=False).yield_point.V == pytest.approx(
        dembrick.limit(scenario).lower, rel=3e-4
    )


def test_the_same_in_the_deformed_geometry_and_at_constant_rate():
    for control in ("kind = 'yield', tolerance = 1e-3, large_displacements = true",
                    "kind = 'displacement', rate = 1e-4, travel = 2e-5"):  # fmt: skip
        found = dembrick.simulate(under_beam(control), record=False)
        assert found.yield_point.V == pytest.approx(DOUBLE_FIXED, rel=1e-3)
        assert found.reactions["beam"][0] == 0.0 and found.reactions["beam"][2] == 0.0


def test_a_cantilever_and_what_its_guide_bears():
    """Free to rotate: (N + W) b / 2 over the height of the jack; the guide out of plane carries no force."""
    found = dembrick.simulate(under_beam("kind = 'yield', tolerance = 1e-4", '["y", "rx", "rz"]'), record=False)
    assert found.yield_point.V == pytest.approx((N + W) * b / 2 / (h + 0.1), rel=1e-6)
    assert np.abs(found.reactions["beam"]).max() < 1e-6 * found.yield_point.V


def test_a_beam_held_in_z_sends_its_load_into_its_guide():
    for control in ("kind = 'statics'", "kind = 'statics', large_displacements = true"):
        text = blocks(
            control, block("stone", [b, b, h], h / 2), block("beam", [0.4, 0.2, 0.2], h + 0.1, "held = ['z']")
        )
        found = dembrick.simulate(toml.loads(text), record=False)
        assert found.statics["stands"]
        assert found.reactions["beam"] == pytest.approx([0, 0, N, 0, 0, 0], abs=1e-9 * N)
        assert found.reactions["floor"][2] == pytest.approx(W, rel=1e-9)


def test_lasting_cohesion_under_a_guide_is_in_the_bracket():
    """A convex joint with ductile cohesion turns and slides about a guide; the least mechanism needs 519.7326 N. With
    cohesion, areas stick that friction alone would let slide, and the block does not rock on."""
    law = {"cohesion": 10773.752015142261, "residual_cohesion": 10773.752015142261}
    keys = "\n".join(f"{key} = {value}" for key, value in law.items())
    text = header("convex", 0.2574315042109354, 1e10, keys=keys)
    text += floor("lo", (0.0, 0.0, -0.05), (0.2017584678340521, 0.362332360432742, 0.1), "fixed = true")
    size, place = (0.2017584678340521, 0.362332360432742, 0.22562590519421202), (0.08611156, 0.04431809, 0.1128129526)
    text += floor("up", place, size, 'held = ["rx", "ry", "x"]')
    text += '[[loads]]\nblock = "up"\nforce = [0.0, 0.0, -526.7875989868062]\n[[actuators]]\nname = "j"\nblock = "up"\n'
    text += "point = [0.12047237, 0.11419832, 0.03694436]\ndirection = [0.88502591, -0.46554177, 0.0]\n"
    found = dembrick.simulate(toml.loads(text + '[control]\nkind = "yield"\n'), record=False)
    lower, upper = bracket(found)
    assert lower - 0.001 < 519.733 < upper + 0.001 and upper - lower < 1.0


def test_a_triplet():
    """EN 1052-3: V + W = 2 (c A + mu N), the outer units fixed against all rotations and along V."""
    sides = [
        "[[blocks]]\nname = '{}'\nmaterial = 'stone'\nbox = [0.06, 0.12, 0.25]\nposition = [{}, 0, 1]\n{}".format(*one)
        for one in (("left", -0.06, "fixed = true"), ("middle", 0.0, ""),
                    ("right", 0.06, "held = ['y', 'z', 'rx', 'ry', 'rz']"))
    ]  # fmt: skip
    press = "[[loads]]\nblock = 'right'\nforce = [-6000, 0, 0]"
    push = "[[actuators]]\nname = 'jack'\nblock = 'middle'\npoint = [0, 0, 1.125]\ndirection = [0, 0, -1]"
    law = "[[joints]]\nbetween = ['left', 'middle']\ncohesion = 2e5\nresidual_cohesion = 2e5"
    text = blocks("kind = 'yield', tolerance = 1e-4", *sides, press, push, law, law.replace("left", "right"))
    scenario, weight = toml.loads(text), 2000.0 * G * 0.06 * 0.12 * 0.25
    expected = 2.0 * (2e5 * 0.03 + 0.9 * 6000.0) - weight
    assert dembrick.simulate(scenario, record=False).yield_point.V == pytest.approx(expected, rel=1e-5)
    bound = dembrick.limit(scenario)
    assert bound.lower == pytest.approx(expected, rel=1e-6) == bound.upper


@pytest.mark.parametrize("control", [
    "kind = 'tilt', axis = [0, 1, 0]",
    "kind = 'tilt', axis = [0, 1, 0], large_displacements = true",
    "kind = 'tilt', axis = [0, 1, 0], rate = 5.0, displacement = 0.002",
    "kind = 'pushover', direction = [1, 0, 0]",
    "kind = 'pushover', direction = [1, 0, 0], large_displacements = true",
])  # fmt: skip
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_slender_block_that_may_not_turn_slides(control, formulation):
    """At the friction coefficient, below the b/h at which it would overturn: the table carries the guides with it."""
    text = blocks(control, block("stone", [0.2, 0.2, 0.8], 0.4, f"held = {SLIDES}"), formulation=formulation,
                  friction=0.5, stiffness=1e9)  # fmt: skip
    found = dembrick.simulate(toml.loads(text), record=False).as_dict()
    at = found["collapse"].get("onset")
    factor = found["collapse"]["load_factor"] if at is None else math.tan(math.radians(at))
    assert factor == pytest.approx(0.5, rel=1e-4 if at is None else 5e-3)
    assert found["collapse"]["mechanism"] == "sliding"


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_guided_block_slows_down_by_friction(formulation):
    """Thrown along its guide, it stops upright after v^2 / (2 mu g); its energy balances."""
    text = blocks("kind = 'dynamic', duration = 0.3", block("stone", [0.2, 0.2, 0.8], 0.4, f"held = {SLIDES}",
                  "velocity = [1, 0, 0]"), formulation=formulation, friction=0.5, stiffness=1e9)  # fmt: skip
    found = dembrick.simulate(toml.loads(text))
    assert np.abs(found.displacement).max() == pytest.approx(1.0 / (2.0 * 0.5 * G), rel=1e-3)
    assert np.abs(found.frames["spin"]).max() == 0.0
    assert abs(found.as_dict()["energy"]["relative_residual"]) < 1e-9
    assert found.rows["reaction"][0, 1, 4] == pytest.approx(-0.5 * W / h * 0.8 * 0.4, rel=0.05)  # mu W at half height


@pytest.mark.parametrize("held, omega", [
    ('["rx"]', [0.0, 2.0, 1.0]), ('["rx", "ry"]', [0.0, 0.0, 3.0]), ('["x", "rz"]', [1.0, -2.0, 0.0]),
])  # fmt: skip
def test_held_turns_of_a_block_whose_inertia_is_not_diagonal(held, omega):
    """Fixed components of the spin stay below 1e-12 of the others, and the guides do no work."""
    text = blocks("kind = 'dynamic', duration = 0.4", block("stone", [0.2, 0.5, 0.3], 2.0, f"held = {held}",
                  "orientation = [0.8, 0.36, 0.48, 0.0]", f"angular_velocity = {omega}"))  # fmt: skip
    found = dembrick.simulate(toml.loads(text.replace(f"-{G}]", "0]")))
    spin = found.frames["spin"][:, 1]
    still = np.array([name in held for name in ("rx", "ry", "rz")])
    assert np.abs(spin[:, still]).max() <= 1e-12 * np.abs(spin).max()
    guide = found.rows["reaction"][:, 1]
    assert np.abs(guide[:, 3:][:, still]).max() > 1e-2  # the inertia couples the axes
    assert (guide[:, 3:][:, ~still] == 0.0).all()
    kinetic = found.rows["energy"]["kinetic"]
    assert np.ptp(kinetic) < 2e-5 * kinetic[0]


def test_a_shaken_base_carries_the_guides():
    """In the frame of the base the block is at rest, and its guide provides its acceleration: m a."""
    text = blocks("kind = 'base-motion', duration = 0.5, direction = [1, 0, 0], sine = {amplitude = 2, frequency = 4}",
                  block("stone", [0.2, 0.2, 0.8], 0.4, "held = ['x', 'y', 'rx', 'ry', 'rz']"),
                  friction=0.5, stiffness=1e9)  # fmt: skip
    found = dembrick.simulate(toml.loads(text))
    assert np.abs(found.displacement).max() < 1e-12
    mass = 2000.0 * 0.2 * 0.2 * 0.8
    assert np.abs(found.rows["reaction"][:, 1, 0]).max() == pytest.approx(2.0 * mass, rel=1e-2)


def test_a_history_says_what_is_held(tmp_path):
    path = tmp_path / "run.h5"
    dembrick.simulate(under_beam("kind = 'yield', tolerance = 1e-3"), path)
    with dembrick.read_history(path) as history:
        assert history.support_names == ["floor", "beam"]
        assert history.block_held.tolist() == [[True] * 6, [False] * 6, [False, True, False, True, True, True]]
        again = toml.loads(history.scenario_text)
    assert again.blocks[2].held == ("y", "rx", "ry", "rz")


@pytest.mark.parametrize("line, said", [
    ("held = []", "name a direction"),
    ("held = ['w']", "'w'"),
    ("held = ['x', 'x']", "x is listed twice"),
    ("held = 'x'", "a list of x, y, z, rx, ry, rz"),
    ("held = ['x']\nfixed = true", "fixed already"),
    ("held = ['x']\nvelocity = [1, 0, 0]", "velocity in a direction in which it is held"),
])  # fmt: skip
def test_bad_guides_are_refused(line, said):
    with pytest.raises(ScenarioError, match=said):
        toml.loads(blocks("kind = 'statics'", block("stone", [b, b, h], h / 2, line)))


def test_all_six_are_fixed():
    scenario = toml.loads(
        blocks("kind = 'statics'", block("stone", [b, b, h], h / 2, "held = ['x', 'y', 'z', 'rx', 'ry', 'rz']"))
    )
    assert scenario.blocks[1].fixed and scenario.blocks[1].held is None


def test_a_jack_that_pushes_against_a_guide_is_refused():
    scenario = under_beam("kind = 'yield'", '["x", "rx", "ry", "rz"]')
    with pytest.raises(ScenarioError, match="push block 'beam' only against its guide"):
        dembrick.simulate(scenario, record=False)
    with pytest.raises(ScenarioError, match="against its guide"):
        dembrick.limit(scenario)


@pytest.mark.parametrize("held", ['["y", "rx", "ry", "rz"]', '["y", "rx", "rz"]'])
def test_guides_bear_the_same_in_limit_analysis(held, tmp_path):
    """A jack across the guide and above the joint: the guide carries the same as in a run, by statics of the block."""
    stone = block("stone", [0.3, 0.2, 0.2], 0.1, f"held = {held}")
    text = blocks("kind = 'yield', tolerance = 1e-6", stone, friction=0.5)
    push = "\n[[actuators]]\nname = 'j'\nblock = 'stone'\npoint = [0.0, 0.05, 0.2]\ndirection = [1.0, 0.5, 0.0]\n"
    scenario = toml.loads(text + push)
    run = dembrick.simulate(scenario, record=False)
    dembrick.limit(scenario).write(tmp_path / "limit.h5")
    with history.read(tmp_path / "limit.h5") as found:
        guide = found.reaction[-1, list(found.support_names).index("stone")]
    assert guide == pytest.approx(run.reactions["stone"], abs=2e-3 * run.yield_point.V)
    assert guide[1] == pytest.approx(-0.5 / math.sqrt(1.25) * run.yield_point.V, rel=2e-3)
