"""Causes of cracks: known support motions are recovered from the joints that they open, and motions that the cracks
cannot distinguish are reported as ambiguous."""

import json

import numpy as np
import pytest

import dembrick
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs import causes
from dembrick.runs.simulate import simulate
from dembrick.runs.study.target import Target, asks_for_causes, read
from dembrick.scenario import toml
from helpers.places import SCENARIOS, tool_module
from helpers.scenario_text import block, header

pytestmark = pytest.mark.usefixtures("few")

ARCH = SCENARIOS / "arch_spread.toml"
SPREAD = '[["arch.3", "arch.4"], ["arch.10", "arch.11"], ["arch.17", "arch.18"]]'
STUDY = 'title = "Which springing has moved?"\nbase = "{base}"\n[target]\n'


def asked(tmp_path, text):
    path = tmp_path / "cracks.toml"
    path.write_text(STUDY.format(base=ARCH) + text, encoding="utf-8")
    return path


def test_the_hinges_of_an_arch_that_spreads_lead_back_to_a_spread(tmp_path):
    """Three hinges, at the crown and in the haunches (Heyman): either springing may have moved outwards."""
    found = dembrick.find_causes(asked(tmp_path, f"open = {SPREAD}"))
    best = found.causes[0]
    assert best.hits == 3 and not best.misses and not best.false_alarms and best.share > 0.99
    ways = {(motion.support, *motion.velocity.round(9).tolist()) for motion in best.motions}
    assert ("arch.right", 1.0, 0.0, 0.0, 0.0, 0.0, 0.0) in ways and ("arch.left", -1.0, 0.0, 0.0, 0.0, 0.0, 0.0) in ways
    assert not any(way[:4] == ("arch.right", -1.0, 0.0, 0.0) for way in ways)
    assert found.ambiguous and "does not distinguish arch.left from arch.right" in found.text()


def test_a_springing_that_sinks_is_told_from_one_that_spreads(tmp_path):
    spread = causes.find(asked(tmp_path, f"open = {SPREAD}")).causes[0]
    sunk = 'open = [["arch.4", "arch.5"], ["arch.11", "arch.12"], ["arch.right", "arch.20"]]'
    found = causes.find(asked(tmp_path, f'{sunk}\nsupports = ["arch.right"]'))
    assert {motion.support for cause in found.causes for motion in cause.motions} == {"arch.right"}
    np.testing.assert_allclose(found.causes[0].motions[0].velocity, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0], atol=1e-12)
    assert not found.ambiguous and found.causes[0].opening.argmax() != spread.opening.argmax()


def test_the_plainest_of_motions_that_open_the_same_joints_comes_first(tmp_path):
    """The cracks of a left springing that goes outwards. A shift and a turn of the right one open the same joints, and
    tell twice as well of one that hardly opens: it made the headline."""
    base = tmp_path / "arch.toml"
    arch = '[[arches]]\nname = "arch"\nmaterial = "stone"\nradius = 1.0\nthickness = 0.2\ndepth = 0.3\nvoussoirs = 7\n'
    base.write_text(header(friction=0.7, normal_stiffness=1e10) + arch + '[control]\nkind = "statics"\n')
    study = tmp_path / "cracks.toml"
    joints = '[["arch.1", "arch.2"], ["arch.3", "arch.4"], ["arch.6", "arch.7"]]'
    study.write_text(STUDY.format(base=base) + f"open = {joints}", encoding="utf-8")
    best = causes.find(study).causes[0]
    assert best.motions[0].said() == "arch.left moves along -x" and best.weight == 1.0
    together = [motion for motion in best.motions if motion.said() == "arch.right moves along -x and turns about +y"]
    assert len(together) == 1 and "96.9 %: arch.left moves along -x (or" in best.title


def test_a_lintel_that_slides_is_said_to(tmp_path, monkeypatch):
    """A lintel drawn off one support slides; limit analysis lifts it there and opens the joint at the other support."""
    blocks = block("left", [-0.5, 0.0, 0.5], [0.3, 0.3, 1.0], "fixed = true")
    blocks += block("right", [0.5, 0.0, 0.5], [0.3, 0.3, 1.0], "fixed = true")
    blocks += block("lintel", [0.0, 0.0, 1.1], [1.3, 0.3, 0.2])
    (tmp_path / "lintel.toml").write_text(header(friction=0.6) + blocks + '[control]\nkind = "statics"\n')
    text = 'title = "?"\nbase = "lintel.toml"\n[target]\nopen = [["left", "lintel"]]\n'
    (tmp_path / "cracks.toml").write_text(text)
    found = causes.find(tmp_path / "cracks.toml")
    assert found.causes[0].slides and "target.paths = true" in found.text()
    (tmp_path / "cracks.toml").write_text(text + 'paths = true\nsupports = ["left"]\n')
    every = causes._motions
    monkeypatch.setattr(causes, "_motions", lambda *known: every(*known)[:2])  # paths are slow
    assert not any(cause.slides for cause in causes.find(tmp_path / "cracks.toml").causes)
    monkeypatch.undo()
    arch = causes.find(asked(tmp_path, f"open = {SPREAD}"))
    assert not arch.causes[0].slides and "slides " not in arch.text()


def test_a_displacement_that_was_seen_says_how_far(tmp_path):
    """The crown of an arch spread by 10 mm sinks as the mechanism predicts; if the crown rises, it was not spread."""
    every = causes.find(asked(tmp_path, f"open = {SPREAD}"))
    spread, crown = every.causes[0], list(every.assembly.names).index("arch.10")
    down = 0.01 * spread.velocity[crown, :3]
    seen = ", ".join(f"{x:.9g}" for x in down)
    found = causes.find(asked(tmp_path, f'open = {SPREAD}\ndisplacement = {{ block = "arch.10", value = [{seen}] }}'))
    motion = next(m for m in found.causes[0].motions if np.allclose(m.velocity, spread.motions[0].velocity))
    assert motion.amount == pytest.approx(0.01, rel=1e-6)
    up = ", ".join(f"{-x:.9g}" for x in down)
    risen = causes.find(asked(tmp_path, f'open = {SPREAD}\ndisplacement = {{ block = "arch.10", value = [{up}] }}'))
    assert not any(np.allclose(m.velocity, spread.motions[0].velocity) for c in risen.causes for m in c.motions)


def test_first_motions_are_dual_to_the_least_reaction():
    """First velocities for a spreading springing do the work of the least thrust: W . v + R_least = 0."""
    from dembrick.runs.limit import assembled
    from dembrick.simulation.limit_analysis.analysis import prepared, standing
    from dembrick.simulation.limit_analysis.reactions import first_motion

    scenario = toml.load(ARCH)
    _, assembly, _ = assembled(scenario, 0.0, None)
    structure = prepared(assembly)
    support = list(assembly.names).index("arch.right")
    least = dembrick.reaction(scenario, "arch.right", (-1.0, 0.0, 0.0)).least.value
    for motion, work in (([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], least), ([2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2.0 * least)):
        moved = first_motion(structure, standing(structure), support, np.array(motion))
        weight = assembly.dead_force[~assembly.fixed]
        assert (weight * moved.velocity[~assembly.fixed, :3]).sum() == pytest.approx(work, rel=1e-6)


@pytest.mark.parametrize(
    "number, wall",
    [
        (0, False),
        (2, False),
        pytest.param(8, False, marks=pytest.mark.slow),
        pytest.param(1, True, marks=pytest.mark.slow),
    ],
)
def test_drawn_motions_are_found(number, wall):
    """Motions are found from the cracks of a path in the deformed geometry, of which the study knows nothing."""
    drawn = tool_module("drawn_causes")
    scenario, support, way = drawn.drawn(np.random.default_rng([1, number]), wall)
    opened = tuple(drawn.open_joints(simulate(scenario, progress=False)))
    found = causes.find(Target("cracks", scenario, opened))
    assert drawn.found(found, support, way)


def test_paths_of_equilibria_find_it_too(tmp_path, monkeypatch):
    monkeypatch.setattr(causes, "_motions", lambda structure, support: [
        np.array([x, 0.0, z, 0.0, 0.0, 0.0]) for x, z in ((1.0, 0.0), (0.0, -1.0))
    ])  # fmt: skip
    found = causes.find(asked(tmp_path, f'open = {SPREAD}\npaths = true\nsupports = ["arch.right"]'))
    assert found.causes[0].motions[0].velocity.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert found.causes[0].hits == 3 and found.tried == 2


def test_the_command_writes_a_figure_and_a_table(tmp_path, capsys):
    path = asked(tmp_path, f"open = {SPREAD}")
    assert asks_for_causes(path) and not asks_for_causes(ARCH)
    assert main(["sweep", str(path), "--out", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["causes"][0]["hits"] == 3 and told["ambiguous"]
    lines = (tmp_path / "out" / "causes.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + told["tried"] - told["locked"]
    assert (tmp_path / "out" / "causes.png").stat().st_size > 10_000


WRONG = {
    'open = [["arch.3", "arch.5"]]': "no joint lies between 'arch.3' and 'arch.5'",
    'open = [["arch.3", "arch.x"]]': "there is no block 'arch.x'",
    f'open = {SPREAD}\nclosed = [["arch.4", "arch.3"]]': "is both open and closed",
    "open = []": "needs open",
    "open = [['arch.3']]": "must be two blocks",
    f"open = {SPREAD}\nopened = 1": "has no key 'opened'; did you mean 'open'",
    f"open = {SPREAD}\nsupports = ['arch.3']": "is not a support",
    f"open = {SPREAD}\ndoubt = 0.7": "a chance above 0 and below 0.5",
    f"open = {SPREAD}\npaths = 1": "must be true or false",
    f"open = {SPREAD}\ndisplacement = {{ block = 'arch.10', value = [0, 0, 0] }}": "is zero",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_target_that_cannot_be_is_refused(text, tmp_path):
    with pytest.raises(ScenarioError, match=WRONG[text].replace("(", r"\(")):
        causes.find(read(asked(tmp_path, text)))


def test_a_structure_on_one_support_has_no_cause(tmp_path):
    path = tmp_path / "cracks.toml"
    path.write_text(f'base = "{SCENARIOS / "wall_tilt.toml"}"\n[target]\nopen = [["a", "b"]]\n', encoding="utf-8")
    scenario = read(path).scenario
    from dembrick.runs.limit import assembled

    _, assembly, _ = assembled(scenario, 0.0, None)
    joints, names = assembly.joints, assembly.names
    pair = (names[int(joints.block_a[0])], names[int(joints.block_b[0])])
    with pytest.raises(ScenarioError, match="the structure has only one"):
        causes.find(Target("one", scenario, (pair,)))
