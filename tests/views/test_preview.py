"""Pictures of a scenario before its run, from `render` and from `check --picture`."""

from __future__ import annotations

import numpy as np
import pytest

import dembrick
from dembrick import cli, history
from dembrick.assembly.build import assemble
from dembrick.runs import mechanism_history
from dembrick.scenario import shipped
from dembrick.views import page, render
from dembrick.views.motion.joints import JointMotion
from dembrick.views.page import content
from dembrick.views.render.scene import Scene


@pytest.mark.parametrize("name", ["set4a", "wall_corner", "rocking_block", "arch_shaken"])
def test_the_history_before_a_run_has_the_blocks_at_rest(name):
    scenario = dembrick.load(name)
    assembly = assemble(scenario)
    with mechanism_history.before_a_run(scenario, assembly) as found:
        assert found.n_frames == 1 and found.block_names == assembly.names
        np.testing.assert_allclose(found.frame("position", 0), assembly.position, atol=1e-15)
        np.testing.assert_array_equal(found.frame("orientation", 0), assembly.orientation)


@pytest.mark.parametrize("command", ["render set4a --to start.png", "check set4a --picture start.png"])
def test_a_shipped_scenario_is_drawn_and_no_picture_of_another_is_lost(folder, capsys, drawing, command):
    assert cli.main(command.split()) == 0
    first = (folder / "start.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    other = command.replace("set4a", "set2a")
    assert cli.main(other.split()) == 2
    assert "--force" in capsys.readouterr().err and (folder / "start.png").read_bytes() == first
    assert cli.main([*other.split(), "--force"]) == 0


BONDED = ["slope_weak_joints", "wall_mortared", "templates/triplet"]


def test_these_are_all_shipped_scenarios_with_bonds():
    folder, found = shipped.folder(), []
    for path in [*shipped.examples().values(), *shipped.templates().values()]:
        if path.parent.name != shipped.STUDIES and path.stem != "study":
            laws = assemble(dembrick.load(path)).joints.law
            found += [path.relative_to(folder).with_suffix("").as_posix()] * any(law.bonded for law in laws)
    assert sorted(found) == sorted(BONDED)


@pytest.mark.parametrize("name", BONDED)
def test_what_has_bonds_is_drawn_without_a_run_and_its_bonds_hold(tmp_path, capsys, drawing, name):
    """It can be drawn before a run, and as the mechanism of limit analysis, where all bonds are intact."""
    path, png = str(shipped.folder() / f"{name}.toml"), tmp_path / "start.png"
    assert cli.main(["check", path, "--picture", str(png)]) == 0
    assert png.read_bytes().startswith(b"\x89PNG")
    for key, written in (("--picture", tmp_path / "mechanism.png"), ("--out", tmp_path / "mechanism.h5")):
        assert cli.main(["limit", path, key, str(written)]) == 0 and written.exists()
    scenario = dembrick.load(path)
    assembly = assemble(scenario)
    bonded = [float(law.bonded) for law in assembly.joints.law]
    with mechanism_history.before_a_run(scenario, assembly) as found:
        np.testing.assert_array_equal(found.frame("bond", 0), bonded)
    with history.read(tmp_path / "mechanism.h5") as found:
        np.testing.assert_array_equal(found.frame("bond", 1), bonded)
        used = JointMotion(found).at([1]).friction_utilisation[0]
    assert 0.0 < used.max() <= 1.0 + 1e-3  # with cohesion; over friction alone the triplet would have 4.8


@pytest.mark.parametrize("name, support, way", [("arch_spread", "arch.right", 0), ("pier_settles", "right strip", 2)])
def test_a_settlement_before_its_run_shows_what_moves_and_claims_nothing(drawing, name, support, way):
    """An arrow points from the settling support along its motion; no reaction, equilibrium or motion is shown."""
    pyvista = pytest.importorskip("pyvista")
    scenario = dembrick.load(name)
    with mechanism_history.before_a_run(scenario, assemble(scenario)) as found:
        shown = Scene(pyvista.Plotter(off_screen=True), found, render.Look(color="none"), [0])
        said = shown._text.input
        _, (tail,), (tip,) = shown._settlement.arrows.ends(shown._poses(0))
        centre = found.position0[found.block_names.index(support)]
        red, _, blue = np.moveaxis(shown.pixels().astype(int), -1, 0)
    assert "reaction" not in said and "equilibrium" not in said and "start" not in said
    moved = np.array(scenario.control.displacement)
    assert f"{support} is to move by {1e3 * np.abs(moved).max():.4g} mm" in said and "before the run" in said
    arrow = (tip - tail) / np.linalg.norm(tip - tail)
    np.testing.assert_allclose(arrow, moved / np.linalg.norm(moved), atol=1e-12)
    assert (tail - centre) @ arrow > 0.0
    neutral, sandy = (red < 240) & (np.abs(red - blue) < 9), (red > 120) & (red - blue > 20)
    assert "grey: fixed" in said and neutral.sum() > 5000 < sandy.sum()  # pixels of supports and free blocks


@pytest.mark.parametrize("name", ["arch_spread", "set4a"])
def test_a_page_before_the_run_claims_nothing(name):
    """The page has no load, equilibrium or curve, and shows actuators at full length."""
    scenario = dembrick.load(name)
    with mechanism_history.before_a_run(scenario, assemble(scenario)) as found:
        data, text = content.collect(found), page.document(found)
    assert data["curve"] is None is data["record"] and data["readout"] == []
    assert [colour["name"] for colour in data["colours"]] == ["none"] and data["mostText"] == ""
    assert "before the run, " in text and "There are no results yet" in text
    assert (data["load"], len(data["actuators"])) == (([1.0], 1) if name == "set4a" else ([1.0], 0))


def test_a_reaction_is_not_called_the_load_of_actuators(run, monkeypatch):
    monkeypatch.setitem(run.__dict__, "curve", dembrick.load("arch_spread").control.curve)
    assert [item["name"] for item in content.collect(run)["readout"]][1] == "reaction along the motion"


def test_a_scenario_that_is_wrong_is_not_drawn(tmp_path, capsys):
    file = tmp_path / "wrong.toml"
    file.write_text(dembrick.dumps(dembrick.load("set4a")).replace("friction", "frictoin"))
    assert cli.main(["render", str(file), "--to", str(tmp_path / "a.png")]) == 2
    assert "friction" in capsys.readouterr().err and not (tmp_path / "a.png").exists()


def test_blocks_that_overlap_are_drawn_in_red(folder, capsys, drawing):
    """Overlapping blocks are red; the picture of the same blocks without an overlap has no red."""
    from PIL import Image

    stray = '{name="stray", material="stone", box=[0.4, 0.4, 0.4], position=[0.1, 0.1, %s]}'
    red = {}
    for name, height, code in (("clear", "1.2", 0), ("in", "1.05", 2)):
        words = ["check", "wall_corner", "--set", f"blocks=[{stray % height}]", "--picture", f"{name}.png"]
        assert cli.main(words) == code
        colours = np.asarray(Image.open(f"{name}.png").convert("RGB"), int)
        red[name] = int((colours[..., 0] > 1.5 * colours[..., 1:].max(axis=2)).sum())
    assert red["in"] > 5000 > 500 > red["clear"], red
    told = capsys.readouterr().err
    assert "in.png: the blocks that overlap are red" in told and "or 'stray' as far the other way" in told
