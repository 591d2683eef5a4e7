"""Stages: controls in sequence, each starting from the state that the one before left."""

import itertools
import math
import os

import numpy as np
import pytest

from dembrick import cli
from dembrick.assembly import build
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.history import read
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from dembrick.simulation.statics import stepper
from helpers.key_lines import key_lines
from helpers.restart_cases import stop_in_stages, told_of_checkpoints
from helpers.scenario_text import BASE, header, refused
from helpers.scenario_text import block as block_text

MU, N, A, B = 0.64, 467.0, 0.3, 0.2
HALF = 0.5 * MU * N  # N, half of the strength in shear
JOINT = BASE[: BASE.index("[[actuators]]")]
JACK = BASE[BASE.index("[[actuators]]") : BASE.index("[control]")]
COUPLE = "".join(  # V is its moment
    f'[[actuators]]\nname = "{name}"\nblock = "upper"\npoint = [{x}, 0.0, 0.0]\ndirection = [0.0, {x}, 0.0]\n'
    "weight = 5.0\n"
    for name, x in (("one", 0.1), ("two", -0.1))
)
pytestmark = pytest.mark.usefixtures("few")
STATICS = 'kind = "statics"\n'
YIELD = 'kind = "yield"\ntolerance = 1e-5\n'


def scenario(*stages, formulation="concave", loads="", actuators=JACK, changes=(), more=""):
    """The lab joint under stages; the last one is its control."""
    text = JOINT.replace('"convex"', f'"{formulation}"') + loads + actuators
    text += "".join(f"[[stages]]\n{stage}" for stage in stages[:-1]) + f"[control]\n{stages[-1]}{more}"
    return toml.loads(text, "staged.toml", changes)


def push(force, stages=None):
    text = f'[[loads]]\nblock = "upper"\npoint = [0.0, 0.0, 0.0]\nforce = {list(force)}\n'
    return text + ("" if stages is None else f"stages = {stages}\n")


def residual(jack):
    """Self-equilibrated forces (4, 2) of the points of a concave joint after a jack at x = ``jack`` has reached its
    limit and is removed: those at the limit, less the elastic response of the points to that load."""
    x, y = 0.5 * A * np.array([-1, -1, 1, 1]), 0.5 * B * np.array([-1, 1, -1, 1])

    def limit(centre):
        r = np.hypot(x - centre, y)
        f = 0.25 * MU * N * np.column_stack([-y, x - centre]) / r[:, None]
        return f, (x * f[:, 1] - y * f[:, 0]).sum() - jack * f[:, 1].sum()

    low, high = -10.0, 0.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if limit(middle)[1] > 0.0 else (middle, high)
    f = limit(low)[0]
    V, polar = f[:, 1].sum(), (x * x + y * y).sum()
    return f - np.column_stack([-jack * V / polar * y, 0.25 * V + jack * V / polar * x])


def test_the_residual_forces_have_the_numbers_of_another_source():
    one, other = np.abs(residual(0.075)), np.abs(residual(0.135))
    np.testing.assert_allclose(one, [[36.19610, 13.10524]] * 2 + [[3.11961, 13.10524]] * 2, atol=2e-5)
    np.testing.assert_allclose(other, [[44.36401, 14.25476]] * 2 + [[1.59971, 14.25476]] * 2, atol=2e-5)


CONTACTS = '[output]\nchannels = ["joints", "energy", "frames", "contacts"]\n'


@pytest.mark.parametrize("last", [STATICS, 'kind = "dynamic"\nduration = 0.01\n'], ids=["statics", "real time"])
@pytest.mark.parametrize("jack", [0.075, 0.135])
def test_points_keep_forces_in_balance_when_the_jack_is_off(jack, last):
    """Sets 4a and 4b to the limit, then unloaded, and so in real time after it: the memory of points is handed on."""
    given = scenario(
        YIELD, *dict.fromkeys((STATICS, last)), changes=[f"actuators.jack.point=[{jack}, 0.0, 0.0]"], more=CONTACTS
    )
    result = simulate(given)
    stage, *_ = result.stages
    assert (stage["stage"], stage["kind"], stage["status"]) == (1, "yield", "yield")
    assert stage["yield_point"]["V"] == pytest.approx({0.075: 254.5698, 0.135: 212.2493}[jack], rel=2e-5)
    found = result.frames["contact_force"][-1]
    own = residual(jack)
    order = [2 * (round(a / A + 0.5)) + round(b / B + 0.5) for a, b in result.assembly.contact_points.normal_arm]
    np.testing.assert_allclose(found[:, :2], -own[order], atol=1.1e-4 * HALF)  # on the upper block
    np.testing.assert_allclose(found[:, 2], 0.25 * N, rtol=1e-6)


TORSION = [  # formulation; M_T with half of the strength in shear held along y and along x, and M_T0 (N m)
    ("concave", 39.765984, 44.456094, 53.881380),
    ("corrected-shear", 21.354677, 23.873307, 28.934692),
    ("convex", 22.913836, 24.159095, 28.934692),
]


@pytest.mark.parametrize(("formulation", "along_y", "along_x", "alone"), TORSION)
def test_torsion_with_half_of_the_shear_held_and_after_shear_and_back(formulation, along_y, along_x, alone):
    """M_T beside a lasting shear is the reduced strength; a shear that was removed leaves M_T0 unchanged."""
    held = push((0.0, HALF, 0.0)), push((HALF, 0.0, 0.0))
    for load, expected in zip(held, (along_y, along_x), strict=True):
        given = scenario(STATICS, YIELD, formulation=formulation, loads=load, actuators=COUPLE)
        result = simulate(given, record=False)
        assert result.yield_point.V == pytest.approx(expected, rel=2e-5)
        assert [stage["status"] for stage in result.stages] == ["stands"]
    gone = push((0.0, HALF, 0.0), [1])
    result = simulate(scenario(STATICS, STATICS, YIELD, formulation=formulation, loads=gone, actuators=COUPLE))
    assert result.yield_point.V == pytest.approx(alone, rel=2e-5)
    assert result.as_dict()["stages"] == result.stages and len(result.stages) == 2
    base = [stage["reactions"]["lower"] for stage in result.stages]
    assert base[0][1] == pytest.approx(-HALF, rel=1e-9) and abs(base[1][1]) < 1e-9


@pytest.mark.parametrize("last", [STATICS, 'kind = "dynamic"\nduration = 0.01\n'], ids=["statics", "real time"])
@pytest.mark.parametrize("act", [JACK.replace("0.075", "0.0"), COUPLE], ids=["slid", "turned"])
def test_blocks_stay_where_a_test_has_left_them(last, act):
    """Driven by 2 mm, then released: only the elastic part returns, V / (ks A) or M_T / (ks J); N keeps it sunk."""
    far = 'kind = "displacement"\nrate = 1e-2\ntravel = 2e-3\n'
    left = simulate(scenario(far, formulation="convex", actuators=act)).run.state.blocks
    result = simulate(scenario(far, last, formulation="convex", actuators=act))
    slid, sunk = result.frames["displacement"][-1, 1, 1:]
    turned = 2.0 * math.asin(result.frames["orientation"][-1, 1, 3])
    area, polar = A * B, A * B * (A * A + B * B) / 12.0
    if act is COUPLE:
        given_back = 28.934692 / (4e9 * polar)
        assert (
            turned == pytest.approx(2.0 * math.asin(left.orientation[1, 3]) - given_back, rel=1e-6)
            and abs(slid) < 1e-12
        )
    else:
        given_back = MU * N / (4e9 * area)
        assert slid == pytest.approx(left.displacement[1, 1] - given_back, rel=1e-6) and abs(turned) < 1e-9
    assert sunk == pytest.approx(-N / (1e10 * area), rel=1e-6)


@pytest.mark.parametrize("last", [STATICS, 'kind = "dynamic"\nduration = 0.01\n'], ids=["statics", "real time"])
def test_a_tie_stays_as_long_as_a_test_has_made_it(last):
    """It yields at 200 N over nearly 2 mm; then friction holds the block, and the tie loses k times the return."""
    far = 'kind = "displacement"\nrate = 1e-3\ntravel = 2e-3\n'
    tie = (
        '[[ties]]\nbetween = [{ block = "lower", point = [0.0, -0.1, 0.0] }, { block = "upper", point = [0.0, 0.1, 0.0]'
        " }]\nstiffness = 1e6\nstrength = 200.0\n"
    )
    shear = JACK.replace("0.075", "0.0")
    alone = simulate(scenario(far, formulation="convex", actuators=shear, loads=tie)).run.state
    assert alone.blocks.displacement[1, 1] > 1.9e-3
    result = simulate(scenario(far, last, formulation="convex", actuators=shear, loads=tie))
    shorter = alone.blocks.displacement[1, 1] - result.frames["displacement"][-1, 1, 1]
    assert 0.0 < shorter < 1e-5
    assert float(result.rows["tension"][-1, 0]) == pytest.approx(200.0 - 1e6 * shorter, rel=1e-3)  # at its centroid


def test_actuators_of_one_stage_are_not_those_of_another():
    """Shear to its limit by a jack, then torsion to its limit by a couple, selected by `stages` of the actuators."""
    actuators = JACK.replace("0.075", "0.0") + "stages = [1]\n" + COUPLE.replace("weight", "stages = [2]\nweight")
    result = simulate(scenario(YIELD, YIELD, formulation="convex", actuators=actuators), record=False)
    assert result.stages[0]["yield_point"]["V"] == pytest.approx(MU * N, rel=2e-5)
    assert result.yield_point.V == pytest.approx(28.934692, rel=2e-5)


@pytest.mark.parametrize("kind", ["rate", "path", "search"])
def test_the_driven_displacement_counts_from_where_the_actuators_begin(kind):
    """Despite a lasting shear load and a slip of 0.1 mm in the stage before, V = k_s A u from zero."""
    held, k = 0.25 * MU * N, 4e9 * A * B
    slide = 'kind = "displacement"\nrate = 1e-4\ntravel = 1e-4\n'
    last = {"rate": slide, "path": slide + "large_displacements = true\n", "search": YIELD}[kind]
    actuators = JACK.replace("0.075", "0.0")
    result = simulate(scenario(slide, last, formulation="convex", loads=push((0.0, held, 0.0)), actuators=actuators))
    V, u, own = result.rows["load"], result.rows["displacement"], result.rows["actuator_displacement"][:, 0]
    np.testing.assert_allclose(u, own, rtol=1e-9, atol=1e-18)
    assert u[0] == 0.0
    assert np.interp(0.5 * (MU * N - held), V, u) == pytest.approx(0.5 * (MU * N - held) / k, rel=1e-2)
    assert result.frames["displacement"][0, 1, 1] > 7e-5


def test_a_search_that_follows_equilibria_and_a_test_at_a_rate_are_stages_too():
    """A tower: its second limit equals the first, and a constant-rate test before them changes nothing."""
    tower = '[[blocks]]\nname = "top"\nmaterial = "tuff"\nbox = [0.3, 0.2, 0.1]\nposition = [0.0, 0.0, 0.15]\n'
    jack = JACK.replace('"upper"', '"top"').replace("0.075, 0.0, 0.0", "0.05, 0.0, 0.12")
    rate = 'kind = "displacement"\nrate = 1e-3\ntravel = 2e-5\n'
    result = simulate(scenario(rate, YIELD, YIELD, loads=tower, actuators=jack), record=False)
    alone = simulate(scenario(YIELD, loads=tower, actuators=jack), record=False)
    first = result.stages[1]["yield_point"]["V"]
    assert first == pytest.approx(alone.yield_point.V, rel=1e-4)
    told = key_lines(result)["stage 2"]
    assert told.startswith(f"stage 2 yield: yield (V = {first:.2f}") and told.endswith(" N, indicator)")
    assert result.yield_point.V == pytest.approx(alone.yield_point.V, rel=1e-4)


def test_a_stopped_run_goes_on_in_its_stage(tmp_path, monkeypatch):
    """Stopped in the first stage, between the first and the second, and in the last: the result is one run's."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    monkeypatch.setattr(stepper, "FIRST_WORK", 1)
    monkeypatch.setattr(stepper, "CHUNK_SECONDS", 0.0)
    path = tmp_path / "run.h5"
    given = scenario(YIELD, STATICS, YIELD)
    places = []
    with told_of_checkpoints(lambda where, _: places.append(where)):
        whole = simulate(given, tmp_path / "whole.h5")
    assert "stage 1 of 3" in places and "stage 2 of 3" in places and places[-1].startswith("equilibrium")
    for place in (0, places.index("stage 1 of 3"), len(places) - 1):
        looks = itertools.count()
        stop_in_stages(given, path, lambda *_, looks=looks, place=place: next(looks) == place)
        result = restart(path)
        assert result.yield_point == whole.yield_point
        assert [s["yield_point"] for s in result.stages] == [s["yield_point"] for s in whole.stages]
        with read(path) as one, read(tmp_path / "whole.h5") as other:
            np.testing.assert_array_equal(one.load, other.load)
            np.testing.assert_array_equal(one.frame_values("displacement", 0, one.n_frames),
                                          other.frame_values("displacement", 0, other.n_frames))  # fmt: skip
            assert len(one.results["stages"]) == 2


def test_a_stage_after_one_that_fell_and_one_that_fails_are_one_sentence(tmp_path, capsys):
    over = push((0.0, 2.1 * HALF, 0.0), [1])
    with pytest.raises(
        ScenarioError, match=r"stage 1 of kind 'statics' fell, and no stage can start on blocks that fall"
    ):
        simulate(scenario(STATICS, YIELD, loads=over))
    slow = 'kind = "displacement"\nrate = 1e-3\ntravel = 1e-9\n'
    with pytest.raises(NotConvergedError, match=r"^stage 1 \(displacement\): no limit load"):
        simulate(scenario(slow, STATICS))
    path = tmp_path / "fallen.toml"
    path.write_text(toml.dumps(scenario(STATICS, YIELD, loads=over)))
    assert toml.load(path).stages == scenario(STATICS, YIELD, loads=over).stages
    assert cli.main(["run", str(path), "--out", str(tmp_path / "x.h5"), "--json"]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"error: {path}: stage 1 of kind 'statics' fell, and no stage can start")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[[stages]]\nkind = "dynamic"\nduration = 1.0\n', ["stage 1 of kind 'dynamic' runs in real time"]),
        ('[[stages]]\nkind = "static"\n', ["[[stages]] number 1", "did you mean 'statics'"]),
        ('[[stages]]\nkind = "statics"\nrate = 1.0\n', ["kind 'statics' has no 'rate'"]),
        (push((0.0, 1.0, 0.0), [2]), ["there is no stage 2", "add [[stages]]"]),
        (push((0.0, 1.0, 0.0), [0]), ["stages are counted from 1"]),
        (push((0.0, 1.0, 0.0), []), ["at least one stage"]),
        (push((0.0, 1.0, 0.0), ["last"]), ["a list of numbers of stages"]),
        ('[[stages]]\nkind = "yield"\n', ["stage 1 of kind 'yield' drives actuators, but none acts in it"]),
    ],
)
def test_stages_that_cannot_be_are_refused(text, words):
    jack = JACK + "stages = [2]\n" if '"yield"' in text else JACK
    refused(JOINT + jack + text + "[control]\n" + YIELD, *words)


PRESSURE = '[[pressures]]\nblock = "upper"\ndirection = [0.0, -1.0, 0.0]\nvalue = 500.0\nactuator = true\n'


@pytest.mark.parametrize("stages", ["", "stages = [1, 2]\n", "stages = [2]\n"])
@pytest.mark.parametrize(
    "last", ['kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n', 'kind = "dynamic"\nduration = 1.0\n']
)
def test_actuators_and_pressures_that_no_stage_drives_are_refused(last, stages):
    """They were once dropped silently; without stages they are refused too."""
    control = f"[[stages]]\n{STATICS}[control]\n{last}"
    where = "stage 2 of kind" if stages == "stages = [2]\n" else "stages 1 and 2 of kind 'statics' and"
    refused(JOINT + JACK + stages + control, where, "no use for [[actuators]]; remove the one on 'upper'")
    refused(JOINT + PRESSURE + stages + control, where, "no pressure: remove actuator = true of the one on 'upper'")
    toml.loads(JOINT + JACK + stages.replace("[2]", "[1]") + control.replace(STATICS, YIELD))


def test_actuators_that_act_only_where_blocks_are_to_rest_are_said_to_carry_nothing():
    """As without stages; if another of their stages drives them, there is no warning."""
    (said,) = build.assemble(scenario(STATICS, STATICS)).warnings
    assert said.startswith("[[actuators]] have no effect in a run of kind 'statics'")
    (said,) = build.assemble(scenario(STATICS, YIELD, loads=PRESSURE + "stages = [1]\n")).warnings
    assert said.startswith("[[pressures]] with actuator = true have no effect in a run of kind 'statics'")
    assert not build.assemble(scenario(YIELD, STATICS)).warnings


@pytest.mark.parametrize("key", ["cohesion = 2000.0", "residual_friction = 0.32"])
def test_theory_knows_no_bond_that_an_earlier_stage_may_have_broken(key):
    """Theory uses the initial strength, which the second search cannot reach once the first has broken the bond."""
    whole = simulate(scenario(YIELD, formulation="convex", changes=[f"joint.{key}"]), record=False)
    again = simulate(scenario(YIELD, STATICS, YIELD, formulation="convex", changes=[f"joint.{key}"]), record=False)
    assert whole.theory is not None and whole.agrees() and whole.yield_point.V > 1.2 * again.yield_point.V
    assert again.theory is None and again.agrees()
    kept = simulate(scenario(YIELD, STATICS, YIELD, formulation="convex"), record=False)
    assert kept.theory is not None and kept.agrees()


@pytest.mark.parametrize("deformed", [False, True])
def test_what_is_handed_on_of_bonds_that_break_at_a_limit_is_said(deformed):
    """A search in the original geometry hands them on broken, one in the deformed geometry intact."""
    large = "large_displacements = true\n" if deformed else ""
    text = header("concave", 0.5, 1e10, keys="cohesion = 1e4\n") + block_text(
        "floor", (0, 0, -0.05), more="fixed = true"
    )
    text += block_text("upper", (0, 0, 0.05)) + '[[actuators]]\nname = "jack"\nblock = "upper"\npoint = [0, 0, 0]\n'
    text += f'direction = [1, 0, 0]\n[[stages]]\nkind = "yield"\n{large}[control]\nkind = "yield"\n'
    said = []
    found = simulate(toml.loads(text), report=said.append)
    words = "bonds that broke in the collapse are intact" if deformed else "bonds that break at the limit stay broken"
    assert (
        sum(f"stage 1 (yield): {'the next stage starts' if deformed else 'bonds that'}" in line for line in said) == 1
    )
    assert any(words in line for line in said)
    mu_N, bond = 0.5 * 0.3 * 0.2 * 0.1 * 2000.0 * 9.81, 1e4 * 0.06
    assert found.stages[0]["yield_point"]["V"] == pytest.approx(mu_N + bond, rel=2e-3)
    assert found.yield_point.V == pytest.approx(mu_N + bond * deformed, rel=2e-3)


def test_blocks_of_several_parts_move_in_one_stage_and_not_in_another():
    """An L on a floor by two parts has one joint in the original geometry, and two if a stage moves it."""
    parts = "".join(
        f"[[blocks.parts]]\nbox = {box}\nposition = {place}\n"
        for box, place in (([0.2, 0.1, 0.1], [0.0, 0.0, 0.0]), ([0.1, 0.1, 0.1], [-0.05, 0.1, 0.0]))
    )
    ell = f'[[blocks]]\nname = "ell"\nmaterial = "tuff"\nposition = [-0.03, 0.0, 0.05]\n{parts}'
    jack = '[[actuators]]\nname = "jack"\nblock = "ell"\npoint = [-0.04, 0.03, 0.01]\ndirection = [0.0, 1.0, 0.0]\n'
    floor = JOINT[: JOINT.index('[[blocks]]\nname     = "upper"')].replace('"convex"', '"concave"')
    first, last = 'kind = "displacement"\nrate = 1e-3\ntravel = 1e-5\n', 'kind = "dynamic"\nduration = 1e-3\n'

    def staged(more):
        return toml.loads(f"{floor}{ell}{jack}[[stages]]\n{first}{more}[control]\n{last}", "staged.toml")

    for more in ("", "large_displacements = true\n"):
        assert simulate(staged(more), record=False).status == "completed"


def test_refinement_and_real_time_in_stages():
    with pytest.raises(ScenarioError, match=r"has \[\[stages\]\]"):
        simulate(scenario(STATICS, 'kind = "dynamic"\nduration = 0.01\n', actuators=""), refine=True)


# --- after a settlement

G = 9.81


def turned(formulation, *stages, degrees=10.0, more="[output]\nrows = 400\nframes = 20\n"):
    """A flat block on a floor that rotates about its middle by ``degrees``, followed by stages."""
    text = header(formulation, 0.5, 1e10) + block_text("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    text += block_text("block", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1))
    floor = 'kind = "settlement"\nsupports = ["floor"]\n'
    floor += f"rotation = {{ axis = [0.0, 1.0, 0.0], angle = {degrees}, point = [0.0, 0.0, 0.0] }}\n"
    every = [floor, *stages]
    text += "".join(f"[[stages]]\n{stage}" for stage in every[:-1]) + f"[control]\n{every[-1]}{more}"
    return toml.loads(text, "turned.toml")


def pulse(degrees, amplitude=6.0, duration=0.8):
    """A pulse of the base up the inclined floor."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return f'kind = "base-motion"\ndirection = [{-c!r}, 0.0, {s!r}]\nduration = {duration}\n' + (
        f"pulse = {{ amplitude = {amplitude}, duration = 0.2 }}\n"
    )


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_on_a_floor_that_has_turned_takes_a_pulse(formulation):
    """It stands, slides with a = A + g sin th - mu g cos th in the pulse, and slows by mu g cos th - g sin th."""
    result = simulate(turned(formulation, pulse(10.0)))
    th, A, T = math.radians(10.0), 6.0, 0.2
    faster = A + G * math.sin(th) - 0.5 * G * math.cos(th)
    slower = 0.5 * G * math.cos(th) - G * math.sin(th)
    slip = 0.5 * faster * T**2 + (faster * T) ** 2 / (2.0 * slower)
    assert result.rows["displacement"][-1] == pytest.approx(slip, rel=5e-3)
    assert result.rows["joint"][0, 0, 0] == pytest.approx(16.0 * G * math.cos(th), rel=1e-5)
    first, last = result.frames["displacement"][[0, -1], 1]
    assert first[0] == pytest.approx(0.05 * math.sin(th), abs=1e-6)  # on the rotated floor
    assert last - first == pytest.approx(slip * np.array([math.cos(th), 0.0, -math.sin(th)]), rel=5e-3, abs=1e-6)
    assert result.stages[0]["kind"] == "settlement" and result.stages[0]["status"] == "completed"
    assert abs(result.energy.relative_residual) < 1e-9


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_one_settlement_after_another(formulation):
    """A beam on three equal springs: the middle support sinks by s and rises by s / 2; then the left one sinks."""
    weight, k, s = 3000.0, 1e8, 1e-5
    text = header(formulation, 0.5, k / 0.1)
    text += block_text("beam", (0.0, 0.0, 0.1), (2.4, 0.5, weight / (2000.0 * G * 1.2) / 1.0))
    text = text.replace("position = [0.0, 0.0, 0.1]", f"position = [0.0, 0.0, {0.5 * weight / (2000.0 * G * 1.2)!r}]")
    for name, x in (("left", -1.0), ("middle", 0.0), ("right", 1.0)):
        text += block_text(name, (x, 0.0, -0.1), (0.2, 0.5, 0.2), "fixed = true")

    def sinks(name, by):
        return f'kind = "settlement"\nsupports = ["{name}"]\ndisplacement = [0.0, 0.0, {-by!r}]\n'

    text += f"[[stages]]\n{sinks('middle', s)}[[stages]]\n{sinks('middle', -0.5 * s)}[control]\n{sinks('left', s)}"
    result = simulate(toml.loads(text, "beam.toml"))
    one, two = (stage["reactions"]["middle"][2] for stage in result.stages)
    assert one == pytest.approx(weight / 3.0 - 2.0 * k * s / 3.0, rel=1e-5)
    assert two == pytest.approx(weight / 3.0 - k * s / 3.0, rel=1e-5)
    third = weight / 3.0 - k * s / 3.0 + k * s / 3.0  # a settling end spring loads all three as (-1, 2, -1) / 6
    assert result.reactions["middle"][2] == pytest.approx(third, rel=1e-4)


def test_an_arch_whose_springing_has_spread_stands_in_time():
    """After large hinge rotations new contacts carry part of the load: no motion, and no change of forces or energy."""
    text = header(friction=0.7, normal_stiffness=1e10)
    text += '[[arches]]\nname = "arch"\nmaterial = "stone"\nradius = 1.5\nthickness = 0.5\ndepth = 0.5\nvoussoirs = 6\n'
    text += '[[stages]]\nkind = "settlement"\nsupports = ["arch.right"]\ndisplacement = [0.4, 0.0, 0.0]\n'
    result = simulate(toml.loads(text + '[control]\nkind = "dynamic"\nduration = 0.02\n', "arch.toml"))
    assert result.rows["new_contacts"][0] > 0.0
    assert result.rows["displacement"].max() < 1e-8
    for name in ("arch.left", "arch.right"):  # the moment refers to the support's position at the start of the stage
        assert result.reactions[name][:3] == pytest.approx(result.stages[0]["reactions"][name][:3], rel=1e-6, abs=0.01)
    elastic, external = (result.rows["energy"][name] for name in ("elastic", "external"))
    assert np.abs(elastic).max() < 1e-6 and np.abs(external).max() < 1e-5
    assert abs(result.energy.relative_residual) < 1e-2


def test_a_run_in_real_time_after_a_settlement_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    """Stopped between both stages and in the last: the settled state comes from the checkpoint."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    path = tmp_path / "run.h5"
    given = turned("convex", pulse(10.0, duration=0.02), more="[output]\nrows = 8\nframes = 4\n")
    whole = simulate(given, tmp_path / "whole.h5")
    for stop in ("stage 1 of 2", "(t = "):  # only the last stage has a time
        stop_in_stages(given, path, lambda where, _, stop=stop: stop in where)
        result = restart(path)
        assert result.rows["displacement"][-1] == whole.rows["displacement"][-1]
        with read(path) as one, read(tmp_path / "whole.h5") as other:
            np.testing.assert_array_equal(one.displacement, other.displacement)
