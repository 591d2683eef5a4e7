"""Yield domains from the command line and from Python: all kinds of joints, their checks, bad requests."""

import dataclasses
import json

import numpy as np
import pytest

import dembrick
from dembrick.assembly import build
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs import domain
from dembrick.runs.lab import lab_scenario
from dembrick.runs.theory_check import theory_of
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.views import plot
from helpers.scenario_text import block, header, jack
from helpers.stone_scenes import GRAVITY

LAB = ["--a", "0.3", "--b", "0.2", "--mu", "0.64", "--N", "467"]
OBLIQUE = "0,0;0.4,0;0.35,0.2;0.05,0.25"


def answer(capsys, *arguments):
    code = main(["domain", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_the_quarter_of_a_rectangle(capsys, tmp_path):
    """Five formulations: pure shear, pure torsion and between; theory lies in each bracket; a table of all points."""
    table = tmp_path / "points.csv"
    code, found = answer(capsys, *LAB, "--simulate", "5", "--points", "3", "--csv", str(table))
    assert code == 0 and set(found["checks"]) == {"concave", "corrected", "corrected-shear", "convex", "distributed"}
    rows = [row for row in found["rows"] if row["source"] == "DEM" and row["formulation"] == "convex"]
    assert rows[0]["V"] == pytest.approx(298.88, rel=1e-3) and rows[0]["M_T"] == 0.0
    assert rows[-1]["M_T"] == pytest.approx(298.88 * 0.09681061, rel=1e-3) and rows[-1]["V"] == 0.0
    assert all(row["bracket"] == "certified" and abs(row["error_vs_theory"]) < 1e-3 for row in rows)
    for name, check in found["checks"].items():
        assert check["convexity"]["holds"] and check["normality"]["holds"] and check["certified"], name
    assert len(table.read_text().splitlines()) == 1 + 5 * (3 + 5)


def test_a_polygon_all_round_and_a_scenario(capsys):
    joint = ["--polygon", OBLIQUE, "--mu", "0.5", "--N", "1000", "--formulation", "convex", "concave"]
    code, found = answer(capsys, *joint, "--simulate", "40", "--space", "all")
    assert code == 0 and found["joint"]["a"] is None and len(found["joint"]["polygon"]) == 4
    assert all(check["error_vs_theory"] < 1e-3 for check in found["checks"].values())
    scenarios = [str(path) for path in (lab_scenario("set4a", "convex").path,)]
    code, found = answer(capsys, "--scenario", scenarios[0], "--simulate", "4", "--space", "plane", "--height", "0.05")
    assert code == 0 and list(found["checks"]) == [lab_scenario("set4a", "convex").joint.formulation]
    assert found["joint"]["normal_force"] == pytest.approx(467.0, rel=1e-9)
    assert found["joint"]["friction"] == 0.64 and found["joint"]["a"] == pytest.approx(0.3)


def test_the_load_above_a_joint_that_follows_the_bending(capsys):
    """Load at mid-height and pressure "effective": an indicator, and theory still within the tolerance."""
    code, found = answer(capsys, *LAB, "--formulation", "convex", "--pressure", "effective", "--height", "0.05",
                         "--simulate", "4", "--points", "2")  # fmt: skip
    assert code == 0 and not found["checks"]["convex"]["certified"]
    assert found["checks"]["convex"]["error_vs_theory"] < 1e-3


PARTS = {(0.0, 0.0, 0.4): (1.0, 0.4, 0.2), (-0.4, 0.0, 0.15): (0.2, 0.4, 0.3), (0.4, 0.0, 0.15): (0.2, 0.4, 0.3)}
TWO_FEET = (
    header("convex", 0.7, 1e10)
    + block("floor", (0.0, 0.0, -0.1), (3.0, 2.0, 0.2), "fixed = true")
    + '[[blocks]]\nname = "bridge"\nmaterial = "stone"\n'
    + "".join(f"[[blocks.parts]]\nbox = {list(box)}\nposition = {list(at)}\n" for at, box in PARTS.items())
    + jack("bridge", (0.5, 0.0, 0.0), (0.3, 1.0, 0.0))
    + '[control]\nkind = "yield"\n'
)


@pytest.fixture
def two_feet(tmp_path):
    path = tmp_path / "bridge.toml"
    path.write_text(TWO_FEET)
    return str(path)


def test_a_block_on_two_feet_does_not_tip_between_them(capsys, two_feet):
    """Torsion about the middle: mu N times the mean distance of the feet's area from it. The run's limit lies on it."""
    code, found = answer(capsys, "--scenario", two_feet, "--simulate", "3", "--points", "2")
    x, y = np.meshgrid(0.3 + 0.2 * (np.arange(400) + 0.5) / 400, -0.2 + 0.4 * (np.arange(400) + 0.5) / 400)
    slides = 0.7 * 2000.0 * abs(GRAVITY[2]) * (0.4 * 0.2 + 2 * 0.2 * 0.4 * 0.3)
    assert code == 0 and found["rows"][0]["V"] == pytest.approx(slides, rel=1e-9)
    assert found["rows"][1]["M_T"] == pytest.approx(slides * np.hypot(x, y).mean(), rel=1e-5)
    point = dembrick.simulate(dembrick.loads(TWO_FEET), progress=False).yield_point
    turned = str(np.degrees(np.arctan2(1.0, 0.3)))
    _, found = answer(capsys, "--scenario", two_feet, "--shear-angle", turned, "--points", "181")
    V, M_T = ([row[name] for row in found["rows"]] for name in ("V", "M_T"))
    assert np.interp(-np.hypot(point.V_1, point.V_2), -np.array(V), M_T) == pytest.approx(point.M_T, rel=2e-3)


@pytest.mark.parametrize(
    "words, said",
    [
        (["--eccentricity", "0.51", "0"], "lies 10 mm outside the joint, where N overturns the block"),
        (
            ["--formulation", "concave"],
            "a joint of several feet is known only for the convex formulation with full pressure, without cohesion",
        ),
        (["--pressure", "linear"], "with full pressure, without cohesion"),
        (
            ["--cohesion", "1e4"],
            "a joint of several feet is known only for the convex formulation with full pressure, without cohesion",
        ),
    ],
)
def test_what_the_domain_of_two_feet_does_not_know_is_said(capsys, two_feet, words, said):
    assert main(["domain", "--scenario", two_feet, "--simulate", "2", *words]) == 2
    assert said in capsys.readouterr().err


COUPLE = (
    header("convex", 0.6, 1e9, keys='pressure = "linear"')
    + block("floor", (0.0, 0.0, -0.1), (3.0, 2.0, 0.2), "fixed = true")
    + block("stone", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1))
    + '[[loads]]\nblock = "stone"\nforce = [0.0, 0.0, -300.0]\npoint = [0.15, 0.0, 0.1]\n'
    + jack("stone", (0.1, 0.0, 0.0), (0.0, 1.0, 0.0))
    + jack("stone", (-0.1, 0.0, 0.0), (0.0, -1.0, 0.0)).replace("jack", "other")
    + '[control]\nkind = "yield"\n'
)


def test_the_domain_of_a_scenario_has_its_pressure(capsys, tmp_path):
    """Torsion under an eccentric N is 40 % less with linear than with full pressure; a guide has no domain."""
    path = tmp_path / "couple.toml"
    path.write_text(COUPLE, encoding="utf-8")
    code, found = answer(capsys, "--scenario", str(path), "--points", "2")
    point = dembrick.simulate(dembrick.loads(COUPLE), record=False).yield_point
    assert code == 0 and found["rows"][-1]["pressure"] == "linear"
    assert found["rows"][-1]["M_T"] == pytest.approx(point.M_T, rel=1e-6)
    path.write_text(COUPLE.replace("0.05]", '0.05]\nheld = ["ry"]'), encoding="utf-8")
    assert main(["domain", "--scenario", str(path)]) == 2 and "blocks.held" in capsys.readouterr().err


@pytest.fixture
def figures(monkeypatch):
    """The figures that would be saved."""
    drawn = []
    monkeypatch.setattr(plot, "save", lambda figure, path: drawn.append(figure))
    return drawn


def test_the_picture_has_the_eccentricity_and_the_direction_of_the_table(capsys, figures):
    """Four corners under an eccentric N: all in compression, by N / 4 (1 + 4 e_1 x / a^2 + 4 e_2 y / b^2) each."""
    e, turned = np.array([0.03, -0.02]), np.radians(30.0)
    beside = ["--eccentricity", *map(str, e), "--shear-angle", "30"]
    code, found = answer(capsys, *LAB, *beside, "--formulation", "concave", "--simulate", "5", "--to", "domain.png")
    axes = figures[0].axes[0]
    (curve,) = (line.get_xydata() for line in axes.lines if line.get_label() == "concave")
    corners = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
    bearing = 0.64 * 467 / 4 * (1.0 + corners @ (4.0 * e / [0.3**2, 0.2**2]))
    x, y = np.meshgrid(np.linspace(-0.15, 0.15, 601), np.linspace(-0.1, 0.1, 401))
    couple = sum(own * np.hypot(x - r[0], y - r[1]) for own, r in zip(bearing, corners, strict=True)).min()
    assert curve[-1] == pytest.approx([0.0, couple], rel=1e-5, abs=1e-9)  # it turns about the point of least work
    # pure shear turns too: minimise over all slips on which the force does the same work and torsion none
    along, across = np.array([np.cos(turned), np.sin(turned)]), np.array([-np.sin(turned), np.cos(turned)])
    v, w = np.meshgrid(np.linspace(-1.0, 1.0, 401), np.linspace(-10.0, 10.0, 2001))
    slip = [along[k] + v * across[k] for k in (0, 1)]
    work = sum(own * np.hypot(slip[0] - w * r[1], slip[1] + w * r[0]) for own, r in zip(bearing, corners, strict=True))
    assert curve[0] == pytest.approx([work.min(), 0.0], rel=1e-4, abs=1e-9) and curve[0, 0] < 0.98 * bearing.sum()
    assert code == 0 and _off(found, curve) < 1e-3
    assert "at 30° from $t_1$" in axes.get_xlabel() and "N = 467 N at (30, -20) mm" in axes.get_title()


@pytest.mark.parametrize("words", [["--pressure", "linear"], ["--pressure", "effective", "--height", "0.04"]])
def test_the_picture_has_the_pressure_and_the_height_of_the_table(capsys, figures, words):
    beside = ["--eccentricity", "0.08", "0.03", "--formulation", "convex"]
    code, found = answer(capsys, *LAB, *beside, *words, "--simulate", "5", "--to", "domain.png")
    (curve,) = (line.get_xydata() for line in figures[0].axes[0].lines if line.get_label().startswith("convex, "))
    assert code == 0 and _off(found, curve) < 1e-3


def _off(found: dict, curve: np.ndarray) -> float:
    """Greatest distance of the simulated points from the drawn curve, over their distance from the origin."""
    points = np.array([(row["V"], row["M_T"]) for row in found["rows"] if row["source"] == "DEM"])
    scale = np.abs(points).max(axis=0)
    turn = [np.arctan2(own[:, 1], own[:, 0]) for own in (points / scale, curve / scale)]
    size = [np.hypot(*own.T) for own in (points / scale, curve / scale)]
    return float(np.abs(np.interp(turn[0], turn[1], size[1]) / size[0] - 1.0).max())


def test_formulations_with_one_curve_share_it(capsys, figures):
    assert answer(capsys, *LAB, "--to", "domain.png")[0] == 0
    names = [line.get_label() for line in figures[0].axes[0].lines]
    assert names == ["concave", "corrected = corrected-shear", "convex = distributed"]


def test_from_python():
    found = dembrick.simulate_domain(a=0.3, b=0.2, friction=0.64, normal_force=467.0, count=60, space="all")
    assert found.points.shape == (60, 3) and found.convexity().holds and found.normality().holds
    gauge = dembrick.simulate_domain(
        [[1, 1], [1.3, 1], [1.3, 1.2], [1, 1.2]], friction=0.64, normal_force=467.0, count=60, space="all"
    )
    np.testing.assert_allclose(gauge.points, found.points, rtol=1e-9, atol=1e-6)


def test_the_joint_of_an_eccentric_scene():
    """N and its point of application, from statics, for either order of the blocks."""
    base = lab_scenario("set4a", "convex")
    joint = domain.DomainJoint.of_assembly(build.assemble(base))
    assert joint.edges == pytest.approx((0.3, 0.2)) and joint.eccentricity == (0.0, 0.0)


@pytest.mark.parametrize(
    "arguments, words",
    [
        ([*LAB, "--formulation", "convexx"], "did you mean 'convex'?"),
        ([*LAB, "--simulate", "1"], "too few"),
        ([*LAB, "--simulate", "-3"], "--simulate = -3"),
        ([*LAB, "--space", "half", "--simulate", "4"], "quarter, plane, all"),
        ([*LAB, "--pressure", "linea"], "did you mean 'linear'?"),
        (["--a", "0.3", "--b", "0.2", "--N", "467"], "--mu is missing"),
        (["--a", "0.3", "--mu", "0.6", "--N", "467"], "--b is missing"),
        (["--mu", "0.6", "--N", "467"], "--polygon, or by --scenario"),
        (["--polygon", "0,0;1;1,1", "--mu", "0.6", "--N", "467"], "not a list of corners"),
        (["--polygon", "0,0;1,0;0.2,0.2;0,1", "--mu", "0.6", "--N", "467", "--simulate", "4"], "not convex"),
        (["--polygon", "0,0;1,0;0,1", "--mu", "0.6", "--N", "467", "--plot", "d.png"], "not a rectangle: use --csv"),
        ([*LAB, "--space", "plane", "--plot", "d.png"], "leave --space out"),
        (["--a", "0.3", "--b", "0.2", "--mu", "-1", "--N", "467"], "friction = -1.0"),
        ([*LAB, "--eccentricity", "0", "0.12", "--formulation", "concave"], "outside the joint"),
    ],
)
def test_bad_requests(capsys, arguments, words):
    assert main(["domain", *arguments]) == 2
    captured = capsys.readouterr()
    assert words in captured.err and "Traceback" not in captured.err


def test_a_joint_is_given_once():
    with pytest.raises(ScenarioError, match="either by its polygon or by the edges"):
        dembrick.simulate_domain(friction=0.6, normal_force=1.0)


@pytest.mark.parametrize(
    "words, said",
    [
        (["--tolerance", "1e-4"], "add --simulate n"),
        (["--pressure", "linear", "--formulation", "concave"], "add --formulation convex"),
        (["--eccentricity", "1", "0", "--formulation", "convex"], "lies 850 mm outside the joint"),
    ],
)
def test_options_that_do_nothing_are_refused(words, said, capsys):
    assert main(["domain", *LAB, *words]) == 2
    assert said in capsys.readouterr().err


def test_a_joint_with_cohesion(capsys):
    """c A + mu N = 898.88 N in shear, times c_T in torsion: by theory and by one search per direction."""
    wanted = ["--cohesion", "1e4", "--formulation", "convex", "concave", "--simulate", "3", "--points", "2"]
    code, found = answer(capsys, *LAB, *wanted)
    assert code == 0 and found["joint"]["cohesion"] == 1e4
    for name, torsion in (("convex", 87.021121), ("concave", 162.047897)):
        shear, *_, twist = [row for row in found["rows"] if row["source"] == "theory" and row["formulation"] == name]
        assert shear["V"] == pytest.approx(898.88, rel=1e-9) and twist["M_T"] == pytest.approx(torsion, rel=1e-6)
        assert found["checks"][name]["error_vs_theory"] < 1e-3 and not found["checks"][name]["certified"]


def test_a_bonded_scenario_has_the_domain_of_its_theory():
    """Ductile joints are compared with theory; brittle points and tied blocks are not."""
    given = lab_scenario("set4a", "concave")
    ductile, brittle = (
        dataclasses.replace(given, joint=dataclasses.replace(given.joint, cohesion=1e4, residual_cohesion=residual))
        for residual in (1e4, None)
    )
    assert theory_of(build.assemble(ductile)).V == pytest.approx(765.6174, rel=2e-7)
    assert theory_of(build.assemble(brittle)) is None
    convex = dataclasses.replace(brittle, joint=dataclasses.replace(brittle.joint, formulation="convex"))
    assert theory_of(build.assemble(convex)).V == pytest.approx(649.7841, rel=2e-7)
    assert theory_of(build.assemble(convex), after_slip=True) is None
    assert domain.DomainJoint.of_assembly(build.assemble(ductile)).cohesion == 1e4
    with pytest.raises(ScenarioError, match="keeps its strength"):
        domain.DomainJoint.of_assembly(build.assemble(brittle))
    ends = TieEnd("lower", (0.0, 0.0, -0.1)), TieEnd("upper", (0.0, 0.0, 0.1))
    tied = build.assemble(dataclasses.replace(given, ties=(Tie(ends, 1e6),)))
    assert theory_of(tied) is None
    with pytest.raises(ScenarioError, match="leave it out"):
        domain.DomainJoint.of_assembly(tied)


def test_a_torsion_has_its_own_bar(capsys):
    """The load keeps its direction, so V and M_T are wrong by the same part of each, also where V is zero."""
    triangle = ["--polygon", "0,0;0.3,0;0,0.3", "--mu", "0.5", "--N", "500", "--formulation", "concave"]
    code, found = answer(capsys, *triangle, "--simulate", "3", "--points", "3")
    row = found["rows"][-1]
    assert code == 0 and row["V"] == 0.0 and row["half_width"] == 0.0
    bar, torsion = row["M_T_half_width"], found["rows"][2]["M_T"]  # by theory
    assert 0.0 < abs(row["M_T"] - torsion) <= bar == pytest.approx(row["relative_half_width"] * row["M_T"], rel=1e-12)
    assert main(["domain", *triangle, "--simulate", "3", "--points", "3"]) == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.endswith("both +- [%]") and float(lines[5].split()[-1]) == pytest.approx(1e2 * bar / torsion, rel=0.1)
