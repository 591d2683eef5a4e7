"""Yield domains of paths that go back and forth: drawn in all quarters that the path visits, and on the limit surface
in each, also where opposite signs of V have different domains."""

import numpy as np
import pytest

import dembrick
from dembrick import history, plot, theory
from dembrick.views.page import content
from dembrick.views.plot import subject
from helpers.scenario_text import block, header, jack

U = 2e-5
ASIDE = '[[loads]]\nblock = "stone"\nforce = [0.0, 0.0, -200.0]\npoint = [0.1, 0.05, 0.1]\n'
TWISTED = ASIDE + "".join(
    f'[[loads]]\nblock = "stone"\nforce = [0.0, {force}, 0.0]\npoint = [{at}, 0.0, 0.05]\n'
    for force, at in ((30.0, 0.2), (-30.0, -0.2))
)
DIAGONAL = (0.8, 0.6, 0.0)


def swung(path, formulation, aside=0.0, loads="", direction=(1.0, 0.0, 0.0), begins=1.0):
    """Run a stone that a jack, beside its middle by ``aside`` (m), pushes to and fro."""
    text = header(formulation=formulation, friction=0.5, normal_stiffness=1e10)
    text += block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true") + block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1))
    text += jack("stone", (0.0, aside, 0.0), direction) + loads
    text += f'[control]\nkind = "displacement"\nrate = 1e-4\nprotocol = [{begins * U}, {-begins * U}, {begins * U}]\n'
    dembrick.simulate(dembrick.loads(text), path)
    return path


@pytest.mark.parametrize(
    "formulation, aside, loads, direction, quarters",
    [
        ("convex", 0.0, "", (1.0, 0.0, 0.0), (0, 2)),
        ("convex", 0.1, "", (1.0, 0.0, 0.0), (-1, 3)),
        ("concave", 0.1, ASIDE, DIAGONAL, (-1, 3)),
        ("corrected", 0.0, TWISTED, DIAGONAL, (0, 2)),
        ("corrected-shear", 0.0, TWISTED, DIAGONAL, (0, 2)),
        ("distributed", 0.0, TWISTED, DIAGONAL, (0, 2)),
    ],
)
def test_a_path_has_its_domain_wherever_it_goes(tmp_path, formulation, aside, loads, direction, quarters):
    """Each point of a section lies on the surface: the largest power over dissipation of all twists is 1."""
    with history.read(swung(tmp_path / "run.h5", formulation, aside, loads, direction)) as run:
        path = plot.joint_path(run)
        law = subject.limit_surface(run.joints[0], subject.carried_by(run, 0))
        lines = content.collect(run)["path"]["lines"]
        (axes,) = plot.load_path(run).axes
    assert path.quarters == quarters
    own = path.sections[0]
    assert own.V.min() < 0.9 * path.V.min() and (own.M_T.min() < 0.9 * path.M_T.min() or path.M_T.min() > -1e-6)
    assert min(lines[0]["x"]) == pytest.approx(own.V.min())
    for low, values in ((axes.get_xlim()[0], own.V), (axes.get_ylim()[0], own.M_T)):
        assert low <= values.min()
    way, reach = 2.0 * np.pi * np.arange(400) / 400, law.radius * np.tan(np.linspace(-1.5, 1.5, 301))
    w = np.repeat(1.0 / reach[reach != 0.0], 400)
    v = np.tile(np.stack([np.cos(way), np.sin(way)], axis=1), (len(w) // 400, 1))
    twists = np.column_stack([v, w])
    forces = np.column_stack([own.V[::30, None] * path.direction, path.sense * own.M_T[::30]])
    most = (forces @ twists.T / law.dissipation(twists)).max(axis=1)
    assert most == pytest.approx(np.ones(len(most)), abs=2e-3) and most.max() < 1.0 + 1e-9


def test_opposite_signs_of_v_have_their_own_domain_under_eccentric_pressure(tmp_path):
    """A torsion at V < 0 of another size than at V > 0, which a mirrored quarter would not have."""
    with history.read(swung(tmp_path / "run.h5", "concave", 0.0, TWISTED, DIAGONAL)) as run:
        own, law = plot.joint_path(run).sections[0], subject.limit_surface(run.joints[0], subject.carried_by(run, 0))
    right, left = (np.interp(0.6 * law.strength, *_ascending(sign * own.V, own.M_T)) for sign in (1.0, -1.0))
    assert abs(right / left - 1.0) > 0.05


def _ascending(V, M_T):
    order = np.argsort(V)
    return V[order], M_T[order]


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_a_mirrored_path_has_a_mirrored_direction_and_the_same_figure(tmp_path, formulation):
    """Both directions carry as much but for rounding: the first one counts as positive."""
    paths = []
    for begins in (1.0, -1.0):
        with history.read(swung(tmp_path / f"{begins}.h5", formulation, 0.1, begins=begins)) as run:
            paths.append(plot.joint_path(run))
    one, other = paths
    assert one.direction[0] == pytest.approx(-other.direction[0]) and one.sense == -other.sense
    assert one.V == pytest.approx(other.V, abs=1e-6 * one.V.max())
    assert one.V[: len(one.V) // 5].max() > 0.9 * one.V.max()


def test_runs_in_one_figure_have_their_domains_in_the_same_quarters(tmp_path):
    runs = [swung(tmp_path / "one.h5", "convex"), swung(tmp_path / "two.h5", "convex", 0.1)]
    surfaces = [own for own in plot.load_path(runs).axes[0].lines if "limit surface" in own.get_label()]
    assert len(surfaces) == 1 and surfaces[0].get_xdata().min() < 0.0 > surfaces[0].get_ydata().min()
    N = 0.4 * 0.4 * 0.1 * 2000.0 * 9.81
    M_T0 = theory.torsion_strength(theory.formulation_law("convex", 0.4, 0.4, 0.5, N))
    assert np.abs(surfaces[0].get_ydata()).max() == pytest.approx(M_T0, rel=1e-3)
