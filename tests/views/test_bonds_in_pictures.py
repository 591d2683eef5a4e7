"""Utilisation of bonded joints: 1 at the bonded strength, in shear, torsion and tension."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from dembrick import history
from dembrick.runs.simulate import simulate
from dembrick.views.motion.bonds import Bonds
from dembrick.views.motion.joints import JointMotion
from dembrick.views.plot import joint_plane
from helpers.one_joint import A, scene, single

FORCE = single((0.25 * A, 0.0))
BENDING = (((0.0, 0.0, 0.1), (0.0, 1.0, 0.0), 1.0), ((0.0, 0.0, 0.0), (0.0, -1.0, 0.0), 1.0))


def used(path, formulation, jacks, normal=467.0, **law):
    """V, utilisation and bonded share of the area in all frames of a recorded search."""
    given = scene(formulation, jacks=jacks, normal=normal)
    result = simulate(dataclasses.replace(given, joint=dataclasses.replace(given.joint, **law)), path)
    with history.read(path) as found:
        motion = JointMotion(found)
        rows = motion.rows(range(found.n_frames))
        return found.load[rows], motion.at(range(found.n_frames)).utilisation[:, 0], result.frames["bond"][:, 0]


@pytest.mark.parametrize("formulation, limit", [("convex", 649.7841), ("concave", 765.6174), ("corrected-shear", None)])
def test_a_ductile_joint_at_its_limit(tmp_path, formulation, limit):
    """The utilisation of the convex joint is V / V_limit throughout; at the limit that of every formulation is 1."""
    V, found, _ = used(tmp_path / "a.h5", formulation, FORCE, cohesion=1e4, residual_cohesion=1e4)
    assert found[-1] == pytest.approx(1.0, rel=2e-3)
    with history.read(tmp_path / "a.h5") as one:  # the figure of the joint alone shows the same
        stages = joint_plane(one)
    np.testing.assert_allclose([stage.utilisation for stage in stages], found[[stage.frame for stage in stages]])
    if limit is not None:
        assert V[-1] == pytest.approx(limit, rel=1e-3)
    if formulation == "convex":
        np.testing.assert_allclose(found, V / limit, atol=1e-3)


def test_a_brittle_joint_before_and_after(tmp_path):
    """In shear the utilisation is V over 898.88 N before the bond breaks, and 1 at 233.5 N afterwards."""
    law = {"cohesion": 1e4, "residual_friction": 0.5}
    V, found, held = used(tmp_path / "b.h5", "convex", single((0.0, 0.0)), **law)
    whole = held == 1.0
    np.testing.assert_allclose(found[whole], V[whole] / 898.88, atol=1e-6)
    assert V[whole].max() > 0.9 * 898.88 and not whole[-1]
    assert found[-1] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("formulation, crack", [("convex", 555.667), ("concave", 1667.0)])
def test_tension_is_used_up_at_the_first_crack(tmp_path, formulation, crack):
    """Cracking moment (f_t + N / A) W for a linear stress, (f_t A + N) b / 2 for corners, over an arm of 0.1 m."""
    law = {"cohesion": 2e4, "tensile_strength": 2e4}
    V, found, held = used(tmp_path / "c.h5", formulation, BENDING, **law)
    pulls = (held == 1.0) & (found > 1e-3)
    V_0 = 467.0 * 0.2 / (6.0 if formulation == "convex" else 2.0) / 0.1  # onset of tension
    np.testing.assert_allclose(found[pulls], (V[pulls] - V_0) / (crack - V_0), atol=2e-3)
    assert found[pulls].max() > 0.8


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_stages_of_a_brittle_joint_show_its_peak_and_what_it_carries_after(tmp_path, formulation):
    """In shear the peak is c A + mu N and the residual strength mu_r N, which the friction in the figure balances."""
    law = {"cohesion": 1e4, "residual_friction": 0.5}
    used(tmp_path / "b.h5", formulation, single((0.0, 0.0)), **law)
    with history.read(tmp_path / "b.h5") as found:
        stages, peak = joint_plane(found), float(found.load.max())
        shear = [float(found.joint("V_2")[JointMotion(found).rows([stage.frame])[0], 0]) for stage in stages]
    loads = [stage.load for stage in stages]
    assert max(loads) > 0.98 * peak > 2.0 * loads[-1] and loads[-1] == pytest.approx(0.5 * 467.0, rel=1e-2)
    assert loads[:-1] == sorted(loads[:-1]) and len(stages) <= 4
    *_, last = stages
    whole = 0.06 / len(last.points) if formulation == "convex" else 1.0
    assert whole * last.friction.sum(axis=0)[1] == pytest.approx(-shear[-1], rel=2e-2)
    assert last.limit * whole * len(last.points) == pytest.approx(0.5 * 467.0, rel=1e-2)


@pytest.mark.parametrize("recorded", [True, False])
def test_of_a_joint_that_has_lost_part_of_its_bond_the_next_point_counts(tmp_path, recorded):
    """A couple breaks 4 rows of points one by one, each at a utilisation of 1 (a linear stress over the joint gave
    0.81): the recorded tension over f_t A or shear over c A + mu N. Without recorded forces it is not known."""
    strength, area = 2e4, A * 0.2 / 24
    law = {"cohesion": strength, "tensile_strength": strength}
    given = scene("distributed", jacks=BENDING, points=(6, 4))
    given = dataclasses.replace(given, joint=dataclasses.replace(given.joint, **law))
    channels = ("joints", "frames", "contacts") if recorded else ("joints", "frames")
    given = dataclasses.replace(given, output=dataclasses.replace(given.output, channels=channels))
    frames = simulate(given, tmp_path / "cracked.h5").frames
    held = frames["bond"][:, 0]
    apart = (held > 0.0) & (held < 1.0)
    assert apart.sum() > 2 and (held == 1.0).sum() > 2
    with history.read(tmp_path / "cracked.h5") as found:
        used = JointMotion(found).at(range(found.n_frames)).utilisation[:, 0]
    assert np.isfinite(used[~apart]).all()
    if not recorded:
        assert np.isnan(used[apart]).all()
        return
    force = np.array(frames["contact_force"])[apart]  # the joint axes are the world axes
    pull = -force[..., 2] / (strength * area)
    shear = np.hypot(force[..., 0], force[..., 1]) / (strength * area + 0.64 * np.maximum(force[..., 2], 0.0))
    expected = np.maximum(np.maximum(pull, shear).max(axis=1), 0.0)
    np.testing.assert_allclose(used[apart], expected, rtol=1e-6, atol=1e-9)
    before = np.flatnonzero((held[1:] < held[:-1]) & apart[:-1])
    assert len(before) == 2
    np.testing.assert_allclose(used[before], 1.0, rtol=2e-3)


def test_the_use_of_points_by_hand():
    """Two joints of two points: tension over f_t A and shear over c A + mu N, each the maximum over the points."""
    bonds = SimpleNamespace(
        _owner=np.array([0, 0, 1, 1]), tension=np.array([2e4, 1e4]), cohesion=np.array([3e4, 0.0]),
        _friction=np.array([0.5, 0.6]),
    )  # fmt: skip
    forces = np.array([[[30.0, 40.0, 20.0], [3.0, 4.0, -10.0], [0.0, 6.0, 20.0], [0.0, 0.0, -4.0]]])
    pull, shear = Bonds.use_of_points(bonds, forces, np.full(4, 1e-3))
    np.testing.assert_allclose(pull, [[10.0 / 20.0, 4.0 / 10.0]], rtol=1e-12)
    np.testing.assert_allclose(shear, [[50.0 / (30.0 + 10.0), 6.0 / 12.0]], rtol=1e-12)
