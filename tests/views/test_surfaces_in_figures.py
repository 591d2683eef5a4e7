"""Limit surfaces in figures of joints and on pages: with the cohesion of the joint, scaled by the strength of what is
drawn, and only for joints of one kind under one normal force."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dembrick import cli, history, theory
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import BaseMotionControl
from dembrick.scenario.model import Block, JointLaw, Material, Scenario
from dembrick.scenario.time_functions import Sine
from dembrick.views import plot
from dembrick.views.page import content
from helpers.one_joint import MU, A, B, N, scene, single

COHESION, G = 1e4, 9.81
BONDED = COHESION * A * B + MU * N


def pushed(path, formulation="concave", normal=N, a=A, friction=MU, **law):
    """Run a search with an eccentric jack on a joint with cohesion."""
    given = scene(formulation, a=a, normal=normal, friction=friction, jacks=single((0.075, 0.0)))
    simulate(dataclasses.replace(given, joint=dataclasses.replace(given.joint, **{"cohesion": COHESION} | law)), path)
    return path


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_a_brittle_joint_has_the_surface_of_its_bond_and_that_of_what_is_left(tmp_path, formulation):
    run = pushed(tmp_path / "run.h5", formulation, residual_friction=0.5)
    path = plot.joint_path(run)
    ends = {(own.formulation, own.bond): own.V[0] for own in path.sections}
    expected = {(formulation, "bonded"): BONDED, (formulation, "bond broken"): 0.5 * N}
    assert ends == pytest.approx(expected | ({} if formulation == "convex" else {("convex", "bonded"): BONDED}))
    whole = next(own for own in path.sections if own.bond == "bonded")
    law = theory.formulation_law(formulation, A, B, MU, N, COHESION)
    assert whole.M_T[-1] == pytest.approx(theory.torsion_strength(law), rel=1e-6)
    peak, order = int(np.argmax(path.V)), np.argsort(whole.V)
    share = path.M_T[peak] / np.interp(path.V[peak], whole.V[order], whole.M_T[order])
    assert 0.98 < share < 1.01 if formulation == "convex" else share < 1.0  # corners break one by one, an area at once
    names = [line.get_label() for line in plot.load_path(run).axes[0].lines]
    assert any(name.endswith(", bonded") for name in names) and any(name.endswith(", bond broken") for name in names)
    with history.read(run) as found:
        lines = content.collect(found)["path"]["lines"]
    assert max(lines[0]["x"]) == pytest.approx(BONDED, rel=1e-6) and lines[0]["name"].endswith(", bonded")
    assert [line["look"] for line in lines[:2]] == [formulation, f"{formulation} broken"]


def test_a_ductile_joint_ends_on_the_surface_that_has_its_cohesion(tmp_path):
    run = pushed(tmp_path / "run.h5", residual_cohesion=COHESION)
    path = plot.joint_path(run)
    own, exact = path.sections
    assert own.bond == exact.bond == "" and own.V[0] == pytest.approx(BONDED) == exact.V[0]
    order = np.argsort(own.V)
    assert np.interp(path.V[-1], own.V[order], own.M_T[order]) == pytest.approx(path.M_T[-1], rel=1e-3)


def test_domains_have_the_cohesion_of_the_joints_of_their_points(tmp_path):
    run = pushed(tmp_path / "run.h5", residual_cohesion=COHESION)
    with history.read(run) as found:
        axes, (row,) = plot.domains([found]).axes[0], plot.domain_points([found])
        scaled = plot.interaction([found]).axes[0]
    assert [line.get_xdata().max() for line in axes.lines[:3]] == pytest.approx([BONDED] * 3)
    assert "cohesion 10 kPa" in axes.get_title() and "breaks" not in axes.get_title()
    shown = next(own for own in scaled.lines if own.get_marker() == "s").get_xydata()[0]
    M_T0 = theory.torsion_strength(theory.formulation_law("concave", A, B, MU, N, COHESION))
    assert shown == pytest.approx([abs(row["V_2"]) / BONDED, abs(row["M_T"]) / M_T0], rel=1e-6)
    with history.read(pushed(tmp_path / "brittle.h5")) as brittle:
        assert plot.domains([brittle]).axes[0].get_title().endswith("before any bond breaks")


@pytest.mark.parametrize(
    "other, said",
    [
        ({"normal": 2.0 * N}, "its normal force N (N) is 934 there and 467 here"),
        ({"friction": 0.5}, "its friction is 0.5 there and 0.64 here"),
        ({"cohesion": 2e4}, "its cohesion (Pa) is 20000 there and 10000 here"),
        ({"a": 0.4}, "the edge a of its joint (m) is 0.4 there and 0.3 here"),
    ],
)
def test_points_of_another_joint_are_not_judged_by_the_domain_of_the_first(tmp_path, capsys, other, said):
    one, two = str(pushed(tmp_path / "one.h5")), str(pushed(tmp_path / "two.h5", **other))
    assert cli.main(["plot", one, two, "--kind", "domain", "--to", str(tmp_path / "f.png")]) == 2
    told = capsys.readouterr().err
    assert said in told and "draw each by itself" in told and not (tmp_path / "f.png").exists()
    assert cli.main(["plot", one, one, "--kind", "domain", "--to", str(tmp_path / "f.png")]) == 0


def test_points_over_strengths_must_be_of_joints_of_one_shape(tmp_path):
    made = [{}, {"normal": 2.0 * N}, {"a": 0.4}]
    one, pressed, wide = (history.read(pushed(tmp_path / f"{i}.h5", **own)) for i, own in enumerate(made))
    with one, pressed, wide:
        assert plot.interaction([one, pressed]).axes  # each is scaled by its own strength
        with pytest.raises(ScenarioError, match="the ratio of its edges a/b is 2 there and 1.5 here"):
            plot.interaction([one, wide])


def shaken(path, **law):
    """Run a block that is shaken vertically and sideways, with N varying by half."""
    control = BaseMotionControl(duration=0.4, direction=(1.0, 0.0, 0.5), sine=Sine(0.5 * G, 5.0))
    joint = JointLaw(
        **{"formulation": "concave", "friction": 0.3, "normal_stiffness": 1e9, "shear_stiffness": 4e8} | law
    )
    floor = Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.4, 0.4, 0.1), (0.0, 0.0, 0.05))
    simulate(Scenario("shaken", (0.0, 0.0, -G), joint, {"stone": Material(2000.0)}, (floor, block), control), path)
    return path


def test_torsion_under_a_changing_normal_force_is_over_the_strength_that_is_drawn(tmp_path):
    """The scaled surface of each formulation begins and ends at 1, and the axis names the strength used."""
    runs = {name: shaken(tmp_path / f"{name}.h5", formulation=name) for name in ("convex", "concave")}
    for name, run in runs.items():
        own = plot.joint_path(run).sections[0]
        assert own.formulation == name and (own.V[0], own.M_T.max()) == pytest.approx((1.0, 1.0))
        said = f"over the {name} strength at its N [-]"
        assert plot.load_path(run).axes[0].get_ylabel().endswith(said)
        with history.read(run) as found:
            assert content.collect(found)["path"]["yName"].endswith(said)
    both = plot.load_path(list(runs.values())).axes[0]
    assert both.get_ylabel().endswith("over the strength of each formulation at its N [-]")
    surfaces = [line for line in both.lines if line.get_label().startswith("limit surface")]
    assert len(surfaces) == 2 and [line.get_ydata().max() for line in surfaces] == pytest.approx([1.0, 1.0])


def test_a_bonded_joint_under_a_changing_normal_force_is_drawn_over_what_it_may_carry(tmp_path):
    """The joint sticks by its cohesion: V exceeds mu N but not c A + mu N, by which the figure scales it."""
    run = shaken(tmp_path / "run.h5", cohesion=500.0)
    path = plot.joint_path(run)
    along = np.abs(path.drawn[0])
    with history.read(run) as found:
        normal = found.joint("N")[:, 0]
        assert (found.frame("bond", -1) == 1.0).all()
    np.testing.assert_allclose(path.strength, 500.0 * 0.16 + 0.3 * normal, rtol=1e-9)
    assert np.abs(path.V / (0.3 * normal)).max() > 1.05 and np.nanmax(along) < 1.0
    assert r"over $c\,A + \mu N$ [-]" in plot.load_path(run).axes[0].get_xlabel()
