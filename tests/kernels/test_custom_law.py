"""A user's own joint law at a point: both engines call it alike, and dashpots and energy terms are added to it."""

import numpy as np
import pytest

from dembrick.kernels.dynamics import tiles
from dembrick.scenario.joint_laws import JointLaw
from dembrick.simulation.joint_laws import rows_of
from tests.helpers import joints_of_engines as engines
from tests.helpers.custom_laws import BILINEAR, COULOMB, FOLLOWING
from tests.kernels.test_one_law import PATHS, hold_together, random_states

LAW = JointLaw("concave", engines.MU, engines.K_N, engines.K_S)
LAWS = {
    "coulomb": COULOMB,
    "following slip": FOLLOWING.with_parameters(slip_distance=1e-5),
    "bilinear": BILINEAR.with_parameters(knee=5e-6),
}


class StaticCustom(engines.StaticPoints):
    """A joint of four points with a user's own law in the searches."""

    def __init__(self, law):
        super().__init__()
        self.joint = self.joint._replace(custom=rows_of(law, [LAW] * 4, engines.AREAS))


class MovingCustom(engines.MovingPoints):
    """The same joint in a tile of the dynamics."""

    def __init__(self, law):
        super().__init__()
        self.custom = rows_of(law, [LAW] * 4 * tiles.W, np.repeat(engines.AREAS, tiles.W))


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_both_engines_call_it_alike(law):
    opened = slid = 0
    for path in random_states():
        one, other = StaticCustom(law), MovingCustom(law)
        opened += hold_together(one, other, path)
        slid += one.slip.max() > 0.0
        own = other.custom.memory.reshape(4, tiles.W, -1)[:, 3]
        np.testing.assert_allclose(own, one.joint.custom.memory, rtol=1e-9, atol=1e-9)
    assert opened > PATHS / 3 and slid > PATHS / 2


def test_without_dashpots_coulomb_is_the_programs_own_law(monkeypatch):
    monkeypatch.setattr(engines, "VISCOUS", 0.0)
    slid = 0
    for path in random_states():
        dry, own = engines.StaticPoints(), StaticCustom(COULOMB)
        for motion, change, twist in path:
            force, same = dry.step(motion, change, twist), own.step(motion, change, twist)
            np.testing.assert_allclose(same, force, rtol=1e-12, atol=1e-12 * (1.0 + np.abs(force).max()))
            np.testing.assert_allclose(own.memory, dry.memory, rtol=1e-12, atol=1e-9)
            np.testing.assert_allclose(own.slip, dry.slip, rtol=1e-9, atol=1e-14)
        slid += dry.slip.max() > 0.0
    assert slid > PATHS / 2


def test_what_the_law_does_not_hold_is_lost():
    """The work of the forces along any path is the energy stored at its end, the energy lost and that of the dashpots:
    by the trapezoidal rule also with dashpots, as in the time loop."""
    arm = np.array([1.0, -1.0, -1.0, -1.0, -1.0, -1.0])  # action on b: N against the opening, shear along the slip
    for path in random_states():
        joint, before, work = StaticCustom(FOLLOWING), np.zeros(6), 0.0
        for motion, change, twist in path:
            force = joint.step(motion, change, twist)
            moved = np.array([-change[0], *-np.array(twist), -change[1], -change[2]])
            work += 0.5 * float(((before + force) * arm * moved)[:4].sum())
            work += 0.5 * float((before + force)[4:] @ np.array(change)[1:])
            before = force
        lost = joint.energy.work[0]
        held = joint.joint.custom.memory[:, 3].sum()
        assert lost.sliding == lost.by_law
        assert work == pytest.approx(held + lost.sliding + lost.damping, rel=1e-9, abs=1e-15)


def test_dashpots_act_where_the_law_answers_elastically():
    """The whole dashpot acts in a joint that sticks, none in one that slides steadily or is open."""
    joint, rate = StaticCustom(COULOMB), engines.VISCOUS
    k = engines.K_S * engines.AREAS.sum()
    joint.step((-1e-5, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    sticking = joint.step((-1e-5, 0.0, 0.0), (0.0, 0.0, 0.0), (1e-7, 0.0, 0.0))
    assert sticking[1] == pytest.approx((1.0 + rate) * k * 1e-7, rel=1e-12)
    for _ in range(3):
        sliding = joint.step((-1e-5, 0.0, 0.0), (0.0, 0.0, 0.0), (1e-4, 0.0, 0.0))
    assert sliding[1] == pytest.approx(engines.MU * sliding[0], rel=1e-12)
    closing = joint.step((-1e-5, 0.0, 0.0), (-1e-7, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert closing[0] == pytest.approx(engines.K_N * engines.AREAS.sum() * (1e-5 + (1.0 + rate) * 1e-7), rel=1e-12)
    assert not joint.step((1e-6, 0.0, 0.0), (1e-6, 0.0, 0.0), (1e-6, 0.0, 0.0)).any()
