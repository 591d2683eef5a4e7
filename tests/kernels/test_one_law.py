"""One joint law: searches and real time give the same forces, memory, slip and dissipation for the same joint state.

Each state is a motion of a single joint over a step, given to the kernels of each engine in its own form: to `statics`
as opening, tilts and slip twist at O, to `dynamics` as rows of a tile. No blocks and no loop are involved.
"""

from functools import partial

import numpy as np
import pytest

from dembrick.geometry import polygons
from dembrick.kernels.dynamics import area_energy
from dembrick.kernels.dynamics import area_joints as moving_areas
from dembrick.kernels.dynamics.energy_terms import LEDGER, Counted
from dembrick.kernels.joint.point_law import point_law
from tests.helpers.joints_of_engines import (
    FIVE_CORNERS,
    K_N,
    MU,
    OUTLINE,
    MovingArea,
    MovingPoints,
    StaticArea,
    StaticPoints,
    area_force,
    place,
)
from tests.helpers.plain_python import cases

PATHS = cases(60, 20)  # number of random states
# opening and tilts a step ago (m, rad), their change in the step, and its slip twist
SHUT = (-1e-5, 0.0, 0.0)
STATES = {
    "closed": [(SHUT, (-1e-6, 0.0, 0.0), (0.0, 0.0, 0.0))],
    "sticking": [(SHUT, (0.0, 0.0, 0.0), (2e-6, 1e-6, 3e-6))],
    "sliding": [(SHUT, (0.0, 1e-6, 0.0), (1e-5, -8e-6, 0.0))],
    "torsion with shear": [(SHUT, (0.0, 0.0, 2e-6), (4e-6, 3e-6, 6e-5))],
    "just touching": [((4e-6, 0.0, 0.0), (-7e-6, 0.0, 0.0), (1e-6, 2e-6, 0.0))],
    "touching at one corner": [((4e-6, 1e-5, 2e-5), (-7e-6, 0.0, 1e-5), (1e-6, 2e-6, 1e-5))],
    "just opened": [(SHUT, (0.0, 0.0, 0.0), (2e-6, 1e-6, 3e-6)), (SHUT, (1.2e-5, 0.0, 0.0), (1e-6, 0.0, 0.0))],
    "opening too fast for its dashpot": [
        (SHUT, (0.0, 0.0, 0.0), (2e-6, 1e-6, 3e-6)),
        ((-1e-5, 0.0, 0.0), (9e-6, 0.0, 0.0), (1e-6, 0.0, 0.0)),
    ],
    "half open": [
        (SHUT, (0.0, 0.0, 0.0), (2e-6, 1e-6, 3e-6)),
        (SHUT, (1e-6, 8e-5, 3e-5), (1e-6, 0.0, 2e-6)),
    ],
}  # fmt: skip


# pressures are some 500 Pa: bonds that random paths break, and one law of each kind
BRITTLE = {"cohesion": 4e2, "tension": 3e2, "residual": 0.8}
LAWS = {
    "brittle": BRITTLE,
    "ductile": {"cohesion": 4e2, "tension": 2e2, "residual_cohesion": 4e2},
    "dilating": {"dilation": 0.3},
    "bond that dilates": BRITTLE | {"dilation": 0.2, "residual_cohesion": 1e2},
}
CRUSHES = LAWS | {"crushing": {"crushing": 1.5e3}, "all": BRITTLE | {"dilation": 0.2, "crushing": 1.5e3}}


def random_states():
    """Paths of a joint that closes, slides, rotates, rocks and opens."""
    rng = np.random.default_rng(7)
    for _ in range(PATHS):
        motion, path = np.array([-5e-6, 0.0, 0.0]), []
        for _ in range(12):
            change = rng.normal(size=3) * [4e-6, 4e-5, 4e-5]
            path.append((tuple(motion), tuple(change), tuple(rng.normal(size=3) * [4e-6, 4e-6, 3e-5])))
            motion = motion + change
        yield path


FAMILIES = {
    "points": (StaticPoints, MovingPoints),
    "area": (StaticArea, MovingArea),
    "area of five corners": (partial(StaticArea, outline=FIVE_CORNERS), partial(MovingArea, outline=FIVE_CORNERS)),
    "effective pressure": (partial(StaticArea, pressure="effective"), partial(MovingArea, pressure="effective")),
    "linear pressure": (partial(StaticArea, pressure="linear"), partial(MovingArea, pressure="linear")),
}


def hold_together(one, other, path):
    """Run both engines along a path and compare forces, memory, slip and dissipation to rounding; return the number of
    steps in which the joint was open."""
    opened = 0
    arm = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    for motion, change, twist in path:
        force, same = one.step(motion, change, twist), other.step(motion, change, twist)
        scale = 2e-12 * (1.0 + np.abs(force[:3]).max())  # the lift of a step is found to a relative 1e-12
        np.testing.assert_allclose(same / arm, force / arm, rtol=1e-11, atol=scale)
        np.testing.assert_allclose(other.memory, one.memory, rtol=1e-10, atol=scale)
        np.testing.assert_allclose(other.slip, one.slip, rtol=1e-11, atol=1e-19)
        opened += force[0] == 0.0
    np.testing.assert_allclose(other.dissipated, one.dissipated, rtol=1e-9, atol=1e-16)
    return opened


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("state", STATES)
def test_both_engines_at_the_same_state(family, state):
    one, other = (kind() for kind in FAMILIES[family])
    hold_together(one, other, STATES[state])
    if state == "just opened":
        assert not one.memory.any()  # an open joint has no memory


@pytest.mark.parametrize("family", FAMILIES)
def test_both_engines_through_random_states(family):
    opened = slid = 0
    for path in random_states():
        one, other = (kind() for kind in FAMILIES[family])
        opened += hold_together(one, other, path)
        slid += one.slip.max() > 0.0
    assert opened > PATHS / 3 and slid > PATHS / 2


def families_and_laws():
    """The families with the laws of strengths that they support in real time."""
    points = [(StaticPoints, MovingPoints, law) for law in CRUSHES.values()]
    return points + [(StaticArea, MovingArea, law) for law in LAWS.values()]


@pytest.mark.parametrize("one, other, law", families_and_laws(), ids=[*CRUSHES, *(f"area {name}" for name in LAWS)])
def test_both_engines_with_strengths(one, other, law):
    """Broken bonds, crushed depth, rise and the energies lost are the same in either engine."""
    kept = broke = grew = 0
    for path in random_states():
        first, second = one(law=law), other(law=law)
        hold_together(first, second, path[:2])
        kept += bool(first.bonds.any())
        hold_together(first, second, path[2:])
        np.testing.assert_allclose(second.bonds, first.bonds, rtol=1e-9, atol=1e-17)
        broke += bool(first.energy.work["fracture"][0] != 0.0)
        grew += bool(first.bonds.any())
    assert kept > PATHS / 12
    assert broke > PATHS / 3 or "cohesion" not in law
    assert grew > PATHS / 12 or set(law) <= {"cohesion", "tension", "residual", "residual_cohesion"}


def test_convex_joints_side_by_side_do_what_they_do_one_by_one():
    """Sticking, wholly closed ones use `stick`; others with four corners use `press`; both equal the general kernel."""
    stuck = set()
    for path in random_states():
        one, other = MovingArea(), MovingArea(outline=FIVE_CORNERS)
        for motion, change, twist in path:
            small = np.multiply(0.1, change)  # so that some stick
            found = one.step(motion, small, twist)
            place(other.work, motion, small, twist)
            joint = other.joint
            counted = Counted(other.energy.dashpots[0], other.energy.ledger[0])
            moving_areas.face_force(
                joint, None, 0, other.tile, other.seen, joint.tiles[0], joint.sheared[0], 0, other.work, counted
            )  # fmt: skip
            other.work.rest[0] = 1.0
            area_energy.add_work(
                other.energy, 0, other.energy.dashpots[0], other.energy.ledger[0], other.tile, other.joint.tiles[0],
                other.work, True, 1,
            )  # fmt: skip
            alone = area_force(other.work)
            np.testing.assert_allclose(found, alone, rtol=1e-12, atol=1e-9)
            np.testing.assert_allclose(one.memory, other.memory, rtol=1e-12, atol=1e-9)
            np.testing.assert_allclose(one.dissipated, other.dissipated, rtol=1e-12, atol=1e-18)
            ledgers = (one.energy.ledger, other.energy.ledger)
            energies = ([ledger[name][0, 0] for name in LEDGER.names] for ledger in ledgers)
            np.testing.assert_allclose(*energies, rtol=1e-9, atol=1e-15)
            stuck.add(bool(one.work.rest[0] == 0.0))
    assert stuck == {True, False}


def pressed_integrals(g):
    """Integrals of <g>+, x <g>+ and y <g>+ over the polygon, g = g[0] + g[1] x + g[2] y, by its part with g > 0."""
    corners = []
    for here, there in zip(OUTLINE, np.roll(OUTLINE, -1, axis=0), strict=True):
        depth, other = (g[0] + g[1:] @ place for place in (here, there))
        if depth >= 0.0:
            corners.append(here)
        if depth * other < 0.0:
            corners.append(here + depth / (depth - other) * (there - here))
    if len(corners) < 3:
        return np.zeros(3)
    area, x, y = polygons.area_and_centroid(np.array(corners))
    yy, xx, xy = polygons.second_moments(np.array(corners))
    x, y = area * x, area * y
    return np.array([[area, x, y], [x, xx, xy], [y, xy, yy]]) @ g


def test_springs_of_convex_joints_give_back_what_they_took_but_for_opening_and_closing():
    """Their work by the trapezoidal rule is the growth of stored energy plus the error of opening and closing within a
    step, also if nothing is stored of a joint that was wholly closed or wholly open."""
    still, up = (0.0, 0.0, 0.0), (1.2e-5, 0.0, 0.0)
    through = [(SHUT, up, still), ((2e-6, 0.0, 0.0), (-7e-6, 0.0, 0.0), still), ((-5e-6, 0.0, 0.0), still, still)]
    taken = []
    for path in (through, *random_states()):
        joint, work, start = MovingArea(), 0.0, None
        joint.energy.springs["pressure"], joint.energy.partly[:] = np.nan, 0
        for motion, change, twist in path:
            joint.step(motion, change, twist)
            before, now = (np.array([-m[0], m[2], -m[1]]) for m in (motion, np.add(motion, change)))
            p, q = pressed_integrals(before), pressed_integrals(now)
            start = 0.5 * p @ before if start is None else start
            work += 0.5 * (p + q) @ (now - before)
        taken.append(K_N * (work + start - 0.5 * q @ now))
        stepping = joint.energy.ledger[0].stepping[0]
        assert stepping == pytest.approx(taken[-1], rel=1e-9, abs=1e-17)
    assert abs(taken[0]) > 1e-5 and np.median(np.abs(taken)) > 1e-6


@pytest.mark.parametrize("family", FAMILIES)
def test_both_engines_without_friction(family):
    """Slip without friction has a slip path, too, and no dissipation."""
    one, other = (kind(mu=0.0) for kind in FAMILIES[family])
    hold_together(one, other, [(SHUT, (0.0, 0.0, 0.0), (3e-6, 4e-6, 0.0))] * 3)
    assert one.slip == pytest.approx(15e-6, rel=1e-12)
    assert one.dissipated[0] == 0.0


def impulse(step, phase):
    """Impulse of a point that is driven in and out at constant speed, with a given dashpot c, in steps of ``step`` (s),
    contact beginning at ``phase`` of a step."""
    speed, c, k, depth = 1.0, 2.0, 1e3, 1e-2
    turn, total, before = phase * step + depth / speed, 0.0, -1.0
    viscous = c / (k * step)
    for i in range(-1, int(turn / step) + 1):
        g = speed * (i * step - phase * step)
        none = (0.0, 0.0)
        normal = point_law(g, g - before, none, none, (k, 1.0), 0.0, (viscous, 1.0, 1.0))[0] if i >= 0 else 0.0
        total += step * normal
        before, last = g, g
    # the rest, up to half a step after the last force, exactly
    end = last + 0.5 * speed * step
    return total - (0.5 * k * end * end / speed + c * end)


def test_the_onset_rule_makes_the_impulse_right_to_second_order():
    """The impulse in closed form is k g^2 / 2 v + c g. With the onset rule the error is at most k v dt^2 / 8, whatever
    the phase of the step at which contact begins; a dashpot on the growth within the step alone errs by c v dt / 2.
    """
    k, c, speed = 1e3, 2.0, 1.0
    for step in (1e-3, 5e-4, 2.5e-4):
        errors = [impulse(step, phase) for phase in np.linspace(0.05, 0.95, 10)]
        assert np.abs(errors).max() <= 0.126 * k * speed * step * step
        assert np.abs(errors).max() < 0.1 * c * speed * step


def test_an_opened_point_remembers_nothing_as_its_dashpot_fades():
    """A dashpot beside the spring of an open point would relax it at the rate k / c; without one its force vanishes at
    once. The rule is that limit and does not depend on the dashpot of the contact."""
    for viscous in (0.3, 0.03, 0.0):
        normal, t1, t2, e1, e2, slid = point_law(
            -1e-9, -1e-6, (1e-6, 0.0), (5.0, 0.0), (1e6, 5e5), MU, (viscous, 1.0 + viscous, 1.0 / (1.0 + viscous))
        )  # fmt: skip
        assert (normal, t1, t2, e1, e2, slid) == (0.0,) * 6
