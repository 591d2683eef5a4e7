"""Cyclic tests: friction work, peaks in both directions, measured protocols, restart within a cycle."""

from dataclasses import replace

import numpy as np
import pytest

import dembrick
from dembrick.errors import ScenarioError
from dembrick.runs.outcomes import cycles
from dembrick.scenario import toml
from dembrick.scenario.controls import DisplacementControl
from dembrick.scenario.protocols import protocol_of, turning_points
from helpers.key_lines import key_lines
from helpers.restart_cases import check_same, stop_at_look
from helpers.scenario_text import block, header, jack

pytestmark = pytest.mark.usefixtures("few")

U = 2e-5


def to_and_fro(points, name="set4a_curve", formulation="convex", **control):
    scenario = toml.load(name)
    law = replace(scenario.joint, formulation=formulation)
    return replace(scenario, joint=law, control=DisplacementControl(rate=1e-5, protocol=points, **control))


def test_a_test_that_is_stopped_in_a_cycle_goes_on_to_the_last_bit(tmp_path):
    scenario = to_and_fro((U, -U, U), formulation="concave")
    dembrick.simulate(scenario, tmp_path / "whole.h5")
    stop_at_look(scenario, tmp_path / "stopped.h5", 3)
    dembrick.restart(tmp_path / "stopped.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "stopped.h5")


@pytest.mark.parametrize("large", ["false", "true"])
def test_damping_counts_what_lifts_a_block_whose_joint_dilates(large):
    """The loop is a rectangle of height mu W, for any dilation as part of mu: damping 2 / pi, less the elastic slip."""
    text = header("convex", 0.5, 1e10, keys="dilation = 0.2\n") + block(
        "floor", (0.0, 0.0, -0.1), (2.0, 2.0, 0.2), "fixed = true"
    )
    text += block("stone", (0.0, 0.0, 0.05), (0.4, 0.4, 0.1)) + jack("stone", (0.0, 0.0, 0.0))
    control = f"rate = 1e-4\nprotocol = [2e-4, -2e-4, 2e-4]\nlarge_displacements = {large}\n"
    (cycle,) = dembrick.simulate(toml.loads(f'{text}[control]\nkind = "displacement"\n{control}')).cycles
    assert cycle["damping"] == pytest.approx(2.0 / np.pi, rel=5e-3)
    if large == "false":
        assert cycle["dissipated"] < 0.65 * cycle["damping"] * 2.0 * np.pi * 2e-4 * 0.5 * 0.016 * 2000.0 * 9.81


def test_friction_work_of_a_slider():
    """4 mu N s per cycle, with s = u - mu N (1 / (k_s A) + 1 / k_jack)."""
    scenario = to_and_fro((0.0, U, -U, U, -U, U), "shear")
    found = dembrick.simulate(scenario)
    law, N = scenario.joint, found.yield_point.N
    settings = found.run.settings
    slip = U - law.friction * N * (1.0 / (law.shear_stiffness * 0.06) + 1.0 / settings["actuator_stiffness"])
    for cycle in found.cycles:
        assert cycle["dissipated"] == pytest.approx(4.0 * law.friction * N * slip, rel=1e-6)
        V, u = law.friction * N, U - law.friction * N / settings["actuator_stiffness"]
        assert cycle["damping"] == pytest.approx(cycle["dissipated"] / (2.0 * np.pi * V * u), rel=1e-3)
        if cycle["residual"] is not None:
            assert cycle["residual"] == pytest.approx(slip, rel=1e-3)
    assert len(found.cycles) == 2 and found.status == "completed"


@pytest.mark.parametrize("large", [False, True])
def test_loops_of_growing_amplitude_are_those_of_constant_amplitude(large):
    """Each amplitude twice, as laboratories do: both loops of an amplitude lose 4 mu N s and damp the same, though the
    second cycle goes on to the next amplitude. In the deformed geometry the head has no spring."""
    protocol = tuple(size * U for size in (0.0, 1.0, -1.0, 1.0, -1.0, 2.0, -2.0, 2.0))
    scenario = to_and_fro(protocol, "shear", large_displacements=large)
    found = dembrick.simulate(scenario)
    law, N = scenario.joint, found.yield_point.N
    spring = 0.0 if large else law.friction * N / found.run.settings["actuator_stiffness"]
    assert len(found.cycles) == 3
    for size, cycle in zip((U, U, 2.0 * U), found.cycles, strict=True):
        lost = 4.0 * law.friction * N * (size - law.friction * N / (law.shear_stiffness * 0.06) - spring)
        assert cycle["dissipated"] == pytest.approx(lost, rel=3e-3)
        assert cycle["damping"] == pytest.approx(lost / (2.0 * np.pi * law.friction * N * (size - spring)), rel=3e-3)


@pytest.mark.parametrize("size, said", [(0.4, True), (1.0, False)])
def test_a_jack_whose_spring_takes_the_displacement_is_reported(size, said):
    """Where the block slides it stays behind the jack by mu N / k_jack, in either direction."""
    scenario, heard = to_and_fro((0.0, size * U, -size * U, size * U), "shear"), []
    found = dembrick.simulate(scenario, report=heard.append)
    reached = size * U - scenario.joint.friction * found.yield_point.N / found.run.settings["actuator_stiffness"]
    assert (reached < 0.9 * size * U) == said
    remarks = [text for text in heard if "the spring of the jack takes the rest" in text]
    assert len(remarks) == said
    if said:
        assert float(remarks[0].split("moved by ")[1].split()[0]) == pytest.approx(1e6 * reached, rel=1e-3)


ONE = jack("stone", (0.0, 0.0, 0.05), (1.0, 0.0, 0.0))
COUPLE = jack("stone", (0.2, 0.0, 0.05), (0.0, 1.0, 0.0))
COUPLE += jack("stone", (-0.2, 0.0, 0.05), (0.0, 1.0, 0.0)).replace("jack", "other") + "weight = -1.0\n"
POST = block("post", (1.0, 0.0, 0.3), (0.2, 0.2, 0.6), "fixed = true")
TIE = """[[ties]]
between = [{ block = "stone", point = [0.2, 0.0, 0.0] }, { block = "post", point = [0.9, 0.0, 0.0] }]
stiffness = 1e7
strength = 60.0
tension_only = false
"""
STONE_N = 0.4 * 0.4 * 0.1 * 2000.0 * 9.81


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize(
    "jacks, lost",
    [
        (ONE, STONE_N),
        pytest.param(ONE + "weight = 2.0\n", STONE_N, marks=pytest.mark.slow),
        (COUPLE, 0.765196 * STONE_N),
        (ONE + POST + TIE, STONE_N + 120.0),
    ],
)
def test_what_a_cycle_loses_is_the_work_of_all_actuators(jacks, lost, large):
    """A slider over 2 (umax - umin), less its elastic part; a couple turns at M_T0 = .3826 mu N a; a tie that yields in
    both directions adds its work. No loop has more damping than a rectangle, 2 / pi."""
    text = header(formulation="convex", friction=0.5, normal_stiffness=1e10)
    text += block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true") + block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1))
    rate = 1e-4 if large else 1e-5
    text += f'{jacks}[control]\nkind = "displacement"\nrate = {rate}\nprotocol = [1e-4, -1e-4, 1e-4]\n'
    (cycle,) = dembrick.simulate(toml.loads(text + f"large_displacements = {str(large).lower()}\n")).cycles
    assert 0.90 < cycle["dissipated"] / (lost * 2e-4) < 1.0
    assert 0.55 < cycle["damping"] < 2.0 / np.pi


def test_a_test_that_turns_ends_with_what_it_carries_then():
    """It ends sliding back at -mu N, whatever its peaks were; the bars of the peaks contain mu N."""
    text = header(formulation="concave", friction=0.5, normal_stiffness=1e10)
    text += block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true") + block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1))
    text += jack("stone", (-0.2, 0.0, 0.1), (1.0, 0.0, 0.0))
    text += '[control]\nkind = "displacement"\nrate = 1e-4\nprotocol = [-2e-5, 2e-5, -2e-5]\n'
    found = dembrick.simulate(toml.loads(text))
    assert found.yield_point.V == pytest.approx(-0.5 * STONE_N, rel=2e-3) and found.yield_point.V_upper is None
    (cycle,) = found.cycles
    for sense, low, high in zip((1.0, -1.0), cycle["V_lower"], cycle["V_upper"], strict=True):
        assert low <= sense * 0.5 * STONE_N <= high


@pytest.mark.parametrize("keys", ["", "rows = 10000\n", 'channels = ["joints"]\n'])
def test_a_peak_between_two_rows_lies_in_its_bar(keys):
    """The block rocks at (N + f_t A) b / 2 h until its two corners in tension break: on its way back after those at the
    other edge, and then at N b / 2 h."""
    text = header("concave", 0.65, 1e10, keys="cohesion = 2000.0\ntensile_strength = 1000.0\n")
    text += block("floor", (0.0, 0.0, -0.1), (0.1, 0.1, 0.2), "fixed = true")
    text += block("stone", (0.0, 0.0, 0.12), (0.1, 0.1, 0.24)) + jack("stone", (0.0, 0.0, 0.24))
    text += '[control]\nkind = "displacement"\nrate = 1e-5\nprotocol = [0.0, 2e-5, -2e-5, 2e-5, -2e-5]\n[output]\n'
    (cycle,) = dembrick.simulate(toml.loads(text + keys)).cycles
    N, bars = 0.0024 * 2000.0 * 9.81, zip(cycle["V_lower"], cycle["V_upper"], strict=True)
    for (low, high), peak in zip(bars, (-(N + 10.0) * 0.05 / 0.24, N * 0.05 / 0.24), strict=True):
        assert low <= peak <= high and high - low < 0.3 * abs(peak)


@pytest.mark.parametrize("formulation", ["convex", "concave", "corrected", "corrected-shear", "distributed"])
def test_peaks_are_the_limit_load_both_ways(formulation):
    scenario = to_and_fro((U, -U, U), formulation=formulation)
    limit = dembrick.simulate(replace(toml.load("set4a"), joint=scenario.joint), record=False).yield_point.V
    (cycle,) = dembrick.simulate(scenario).cycles
    first, second = cycle["peak"]
    assert first == pytest.approx(-limit, rel=1e-3) and second == pytest.approx(limit, rel=1e-3)
    bars = [0.5 * (b - a) for a, b in zip(cycle["V_lower"], cycle["V_upper"], strict=True)]
    assert abs(first + second) <= sum(bars) < 1e-3 * limit


def test_the_same_in_the_deformed_geometry():
    scenario = to_and_fro((U, -U, U), formulation="concave", large_displacements=True)
    limit = dembrick.simulate(replace(toml.load("set4a"), joint=scenario.joint), record=False).yield_point.V
    found = dembrick.simulate(scenario)
    (cycle,) = found.cycles
    assert cycle["peak"] == pytest.approx([-limit, limit], rel=1e-3)
    assert cycle["dissipated"] == pytest.approx(4.0 * limit * U, rel=0.1)
    assert found.rows["displacement"][list(found.run.turns)] == pytest.approx([U, -U, U], rel=1e-4)


@pytest.mark.parametrize("points, count, closed", [
    ((U, -U, 2.0 * U), 1, True),  # passes U again on the way to 2 U
    pytest.param((2.0 * U, -2.0 * U, U), 1, False, marks=pytest.mark.slow),
    ((U, -U, 0.0), 0, True),  # part of a loop
    pytest.param((U, -U, U, -U, 0.0), 1, True, marks=pytest.mark.slow),
])  # fmt: skip
def test_only_loops_that_close_have_an_area(points, count, closed):
    """4 V s each, whatever follows the closed loop."""
    scenario = to_and_fro(points, formulation="concave", large_displacements=True)
    found = dembrick.simulate(scenario)
    assert len(found.cycles) == count
    for cycle in found.cycles:
        if not closed:
            assert cycle["dissipated"] is None and cycle["damping"] is None and cycle["peak"][0] < 0.0
            assert "its loop is not closed" in key_lines(found)["cycle 1"]
            continue
        limit = -cycle["peak"][0]
        slip = U - limit / (1e10 * 0.06)
        assert cycle["dissipated"] == pytest.approx(4.0 * limit * slip, rel=0.1)


@pytest.mark.parametrize(
    "slips", [1.05, pytest.param(1.5, marks=pytest.mark.slow), pytest.param(3.0, marks=pytest.mark.slow)]
)
def test_small_loops_turn_where_they_are_to(slips):
    """A guided block on a spring k_s A that slips at mu N, with amplitudes little above its slip displacement u: 4 mu N
    (amplitude - u) per loop."""
    V = 0.6 * (1000.0 + 2000.0 * 9.81 * 0.3 * 0.2 * 0.1)
    u, text = V / (4e9 * 0.06), header("concave", 0.6, 1e10) + block("lo", (0.0, 0.0, -0.05), more="fixed = true")
    text += block("up", (0.0, 0.0, 0.05), more='held = ["x", "rx", "ry", "rz"]') + jack(
        "up", (0.0, 0.0, 0.05), (0, 1, 0)
    )
    text += '[[loads]]\nblock = "up"\nforce = [0.0, 0.0, -1000.0]\n[control]\nkind = "displacement"\n'
    top = slips * u
    text += f"large_displacements = true\nprotocol = {[top, -top, top, -top]}\n"
    found = dembrick.simulate(toml.loads(text))
    assert found.rows["displacement"][list(found.run.turns)] == pytest.approx([top, -top, top, -top], rel=3e-5)
    assert found.cycles[0]["peak"] == pytest.approx([-V, V], rel=1e-6)
    assert found.cycles[0]["dissipated"] == pytest.approx(4.0 * V * (top - u), rel=0.02)
    out = slice(found.run.turns[0] + 1)  # the yield corner must be sharp
    assert np.interp(0.98 * u, found.rows["displacement"][out], found.rows["load"][out]) == pytest.approx(
        0.98 * V, 5e-3
    )


def test_a_block_that_rocks_dissipates_next_to_nothing():
    """At most 1e-4 N u + 4 V^2 / (2 k_s A): points that open lose the energy of their shear springs."""
    text = header(friction=0.9, normal_stiffness=1e10) + block("floor", (0, 0, -0.1), (1, 1, 0.2), "fixed = true")
    text += block("stone", (0, 0, 0.3), (0.2, 0.2, 0.6)) + jack("stone", (-0.1, 0, 0.6))
    text += '[control]\nkind = "displacement"\nrate = 1e-4\nprotocol = [2e-5, -2e-5, 2e-5]\n'
    found = dembrick.simulate(toml.loads(text))
    (cycle,) = found.cycles
    W = 2000.0 * 9.81 * 0.2 * 0.2 * 0.6
    V = W * 0.2 / 2 / 0.6
    assert cycle["peak"] == pytest.approx([-V, V], rel=0.02)
    assert 0.0 <= cycle["dissipated"] <= 1e-4 * W * 2e-5 + 4.0 * V**2 / (2.0 * 4e9 * 0.04)


def test_a_protocol_of_forces():
    """Below the strength the block returns; the turning points are those of V."""
    limit = 216.05
    scenario = toml.load("set4a_curve")
    force = (0.5 * limit, -0.5 * limit, 0.5 * limit)
    control = DisplacementControl(rate=10.0, force_protocol=force, large_displacements=True)
    found = dembrick.simulate(replace(scenario, control=control))
    assert found.rows["load"][list(found.run.turns)] == pytest.approx(force, rel=1e-9)
    assert found.cycles[0]["peak"] == pytest.approx([-0.5 * limit, 0.5 * limit], rel=1e-9)
    assert found.cycles[0]["dissipated"] == 0.0  # elastic springs, but for rounding
    timeless = dembrick.simulate(replace(scenario, control=replace(control, rate=None)))
    assert timeless.rows["displacement"].tolist() == found.rows["displacement"].tolist()


def test_a_measured_protocol(tmp_path):
    """Turning points are the extremes of the measurement, and times are those of the jack."""
    way = np.concatenate([np.linspace(0, 0.02, 30), np.linspace(0.02, -0.02, 40), np.linspace(-0.02, 0.01, 30)])
    way += 1e-5 * np.sin(7.0 * np.arange(len(way)))
    lines = [f"{0.1 * i},{1.0 * x:.6f}" for i, x in enumerate(way)]
    (tmp_path / "jack.csv").write_text("time [s],displacement [mm]\n" + "\n".join(lines) + "\n")
    scenario = replace(to_and_fro("jack.csv"), path=str(tmp_path / "a.toml"))
    protocol = protocol_of(scenario)
    assert protocol.turns == pytest.approx([0.0, 2e-5, -2e-5, 1e-5], abs=3e-8)
    assert protocol.seconds == pytest.approx([2.9, 4.0, 3.0], abs=0.21)
    assert len(dembrick.simulate(scenario).cycles) == 1
    (tmp_path / "jack.csv").write_text("displacement [mm]\n" + "\n".join(f"{x:.6f}" for x in way[:30]) + "\n")
    with pytest.raises(ScenarioError, match="no turning point"):
        protocol_of(scenario)
    (tmp_path / "jack.csv").write_text("displacement\n" + "\n".join(f"{x:.6f}" for x in way) + "\n")
    with pytest.raises(ScenarioError, match="unit"):
        protocol_of(scenario)


def test_turning_points_of_noise():
    values = np.array([0.0, 0.5, 0.49, 1.0, 1.001, 0.2, -1.0, -0.99, -1.002, 0.3])
    assert turning_points(values).tolist() == [0, 4, 8, 9]


@pytest.mark.parametrize("control, said", [
    ({"protocol": [0.0, 1e-5]}, "it must have a turn"),
    ({"protocol": [1e-5, 2e-5, -1e-5]}, "it must have a turn"),
    ({"protocol": [1e-5, 1e-5]}, "must differ"),
    ({"protocol": []}, "must differ"),
    ({"protocol": [0.0, float("nan")]}, "finite"),
    ({"protocol": 3.0}, "a list of turning points"),
    ({"protocol": [1e-5, -1e-5], "travel": 1e-5}, "one of travel, protocol and force_protocol"),
    ({}, "one of travel, protocol and force_protocol"),
    ({"force_protocol": [1.0, -1.0]}, "large_displacements = true"),
])  # fmt: skip
def test_bad_protocols_are_refused(control, said):
    with pytest.raises(ScenarioError, match=said):
        DisplacementControl(rate=1e-5, **control)


def test_a_protocol_in_a_file_and_back():
    text = toml.text_of(toml.load("set4a_cyclic"))
    assert toml.loads(text).control.protocol == toml.load("set4a_cyclic").control.protocol


@pytest.mark.parametrize("large", [False, True])
def test_damping_is_the_area_of_a_loop_in_which_joints_open(large):
    """A stack that leans: points lose their shear as they lift off, and that is no friction work."""
    text = header("concave", 0.69, 5e9) + block("floor", (0.0, 0.0, -0.1), (5.0, 4.0, 0.2), "fixed = true")
    for k, box in enumerate([(0.37, 0.24, 0.1), (0.23, 0.38, 0.1), (0.23, 0.35, 0.1)]):
        text += block(f"part {k}", (0.0, 0.0, 0.05 + 0.1 * k), box)
    text += '[[loads]]\nblock = "part 2"\nforce = [0.0, 0.0, -820.0]\npoint = [-0.046, -0.047, 0.3]\n'
    text += jack("part 2", (0.039, 0.063, 0.274), (-0.18, -0.98, -0.02))
    points = [1.9e-4, -1.6e-4, 1.9e-4]
    control = f'kind = "displacement"\nrate = 6.5e-6\nprotocol = {points}\nlarge_displacements = {str(large).lower()}\n'
    found = dembrick.simulate(toml.loads(f"{text}[control]\n{control}"))
    (cycle,) = found.cycles
    u, V = (np.asarray(found.rows[name]) for name in ("displacement", "load"))
    turn = int(np.argmax(u[: np.argmin(u)]))
    area = float(np.trapezoid(V[turn:], u[turn:]))
    sizes = 0.25 * float(np.ptp(V[turn:]) * np.ptp(u[turn:]))
    assert cycle["damping"] == pytest.approx(area / (2.0 * np.pi * sizes), rel=2e-3)
    assert large or cycle["dissipated"] < 0.95 * area


def test_a_loop_of_rocking_takes_nothing():
    """There and back on one curve, sampled at different points in each direction."""
    there, back = np.linspace(0.0, 1.0, 40), np.linspace(1.0, 0.0, 57)
    u = np.concatenate([there, back[1:]])
    assert cycles._area(1.0 / (1.0 + 10.0 * u), u, 39) == 0.0
    friction = np.where(np.arange(len(u)) < 40, 1.0, -1.0)
    assert cycles._area(friction, u, 39) == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("formulation", ["convex", "concave", "corrected", "corrected-shear", "distributed"])
def test_the_largest_v_is_that_of_either_direction_with_its_sign(formulation, large):
    """A dead load F to one side leaves a slider mu N - F that way and -(mu N + F) the other, wherever it is pushed
    first; its mirror image has the opposite, and an actuator that points the other way the same."""
    F, most = 40.0, 0.5 * STONE_N + 40.0

    def largest(sense, first, way=1.0):
        text = header(formulation=formulation, friction=0.5, normal_stiffness=1e10)
        text += block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true")
        text += block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1)) + jack("stone", (0.0, 0.0, 0.0), (way, 0.0, 0.0))
        text += f'[[loads]]\nblock = "stone"\nforce = [{sense * F}, 0.0, 0.0]\n'
        text += f'[control]\nkind = "displacement"\nrate = 1e-5\nprotocol = [{first * U}, {-first * U}]\n'
        return dembrick.simulate(toml.loads(text + f"large_displacements = {str(large).lower()}\n")).yield_point.V_peak

    found = [largest(1.0, first) for first in ((1.0, -1.0) if formulation == "convex" else (1.0,))]
    assert all(-1.01 * most < V < -most * (1.0 - 1e-6) for V in found)
    if formulation == "convex":  # signs and their order are those of the path, whatever the joint
        assert largest(-1.0, 1.0) == pytest.approx(-found[1], rel=1e-6)
        assert largest(-1.0, 1.0, way=-1.0) == pytest.approx(found[0], rel=1e-6)
