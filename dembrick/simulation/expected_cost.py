"""Expected steps and seconds of a run before it starts: measured costs of steps times expected counts.

The costs are processor time of one core of a usual server, of compiled code; docs/performance.md has the tables. They
are accurate to a factor of about two, and `slowness` compares the present machine with that server. The number of
Newton steps of a search is not known beforehand: walls of twenty to two hundred blocks that rock took 3 to 56, those
with sliding joints, as limit analysis counts them, 55 to 1,055. For 33 of 36 such walls the estimate here was right to
a factor of four.
"""

from __future__ import annotations

import math
import time
from functools import cache

USUAL_PASS = 3.8e-8  # s per pass of the loop of `slowness` on the machine of all costs below
START_SECONDS = 0.7  # of a command: start-up, loading compiled code, building, writing
LONG = 3600.0  # s: a longer run reports its duration before it starts
ROCKING = 13.0  # steps of a search that rocks, however many blocks
FIRST_SLIDING, NEWTON_PER_JOINT = 45.0, 2.0  # of one that slides, and more for every sliding joint,
FEW_SLIDING, MORE_SLIDING = 7.0, 1.1  # but at most so many times the number of them to that power: a dam that slides on
# its foot took 7, four slabs on a slope 17, a wall with seven sliding joints 117
CONVEX_ROCKING = 1.4  # factor on the steps if convex joints rock
EQUILIBRIA = 32  # on the path of a search: some ten to sixty are recorded
WITHIN = 4.0  # factor by which the steps of a search of several joints may be off
WASTED = 1e8  # failed iterations before blocks are pushed on, times free blocks squared
LEAST_WASTED = 12  # and at least
MOST_USEFUL = 300  # successful iterations before that
PUSHED_SECONDS = 2e-3  # s per joint for all pushes of driven relaxation
NEWTON_SECONDS = 1.2e-5  # s per joint and Newton step: equations, joint forces, bracket
STATICS_STEPS = 50  # of a dead-load equilibrium of an assembly: 1 to 300 have been seen if it stands
RELAXATION_SECONDS = 1.5e-6  # s per joint and step of a dead-load equilibrium
LOOP_SECONDS, POINT_SECONDS = 4e-7, 8e-9  # s per joint and step of a constant-rate test, and per contact point
MOTION_SECONDS, MOTION_JOINT_SECONDS = 9e-6, 5e-8  # s per step in real time, and per joint, with contact detection
DRY_POINT_SECONDS, POINT_LAW_SECONDS = 1.5e-8, 4e-8  # s per contact point and step in motion; with more than friction
PATH_SECONDS = 2.5e-6  # s per step of relaxation on a path of equilibria, which meets few new contacts
BREAKING_PER_BOND, BREAKING_OF_ALL = 0.5, 8.0  # equilibria of a growing load per bond, of its root at the most,
BREAKING_BY_TOLERANCE = 0.25  # and over the tolerance: on 660 points 193 equilibria more than without bonds
TORN_PER_BOND = 2.5  # equilibria of a prescribed travel per bond: 194 with 48 of them, 527 with 192
TRIED, TRIED_ON_TRAVELS = 3.0, 1.5  # steps of such paths over those kept: attempts that fail are long
PATH_WITHIN = 3.0  # factor by which the steps of a path may be off if bonds break on it
ROW_SECONDS = 4e-5  # s per row of the record in real time
HEAP_BLOCK_SECONDS = 1.2e-5  # s per step and block, if blocks fall and meet anywhere
SEARCH_FIRST, SEARCH_PER_DIGIT = 10, 1.2  # Newton steps of a search of a lone joint to 1e-2, and per further digit
BENT_FIRST, BENT_PER_DIGIT = 18, 3  # the same if friction depends on the load
LONE_SECONDS, LONE_POINT_SECONDS = 2.5e-6, 6e-8  # s per Newton step of it, and per contact point


@cache
def slowness() -> float:
    """Time of this machine over that of the machine of the costs, by a plain loop of Python; some 5 ms of work."""
    n_passes, least = 10_000, math.inf
    for _ in range(12):
        value, began = 0.0, time.perf_counter()
        for _ in range(n_passes):
            value = 0.5 * value + 1.0
        least = min(least, time.perf_counter() - began)
    return least / n_passes / USUAL_PASS


def search_steps(tolerance: float, bent: bool = False) -> int:
    """Newton steps of the search for the limit load of a lone joint; ``bent``: whether friction depends on the load."""
    first, per_digit = (BENT_FIRST, BENT_PER_DIGIT) if bent else (SEARCH_FIRST, SEARCH_PER_DIGIT)
    return first + round(per_digit * max(0.0, -math.log10(tolerance) - 2.0))


def newton_steps(convex: bool, sliding: int = 0) -> int:
    """Newton steps of path following, with so many ``sliding`` joints in the mechanism."""
    if sliding:
        return round(min(FEW_SLIDING * sliding**MORE_SLIDING, FIRST_SLIDING + NEWTON_PER_JOINT * sliding))
    return round(ROCKING * (CONVEX_ROCKING if convex else 1.0))


def newton_seconds(steps: int, joints: int) -> float:
    """Seconds of path following."""
    return NEWTON_SECONDS * steps * joints


def longest_search(blocks: int, joints: int) -> tuple[int, float]:
    """Newton steps and seconds of a search whose blocks snap, until driven relaxation has pushed them on."""
    steps = MOST_USEFUL + round(max(LEAST_WASTED, WASTED / max(blocks, 1) ** 2))
    return steps, newton_seconds(steps, joints) + PUSHED_SECONDS * joints


def lone_seconds(steps: int, points: int) -> float:
    """Seconds of a search of a lone joint with so many contact ``points``."""
    return steps * (LONE_SECONDS + LONE_POINT_SECONDS * points)


def relaxation_seconds(steps: int, joints: int) -> float:
    """Seconds of a dead-load equilibrium."""
    return RELAXATION_SECONDS * steps * joints


def loop_seconds(steps: int, joints: int, points: int) -> float:
    """Seconds of the loop of a constant-rate test."""
    return steps * (LOOP_SECONDS * joints + POINT_SECONDS * points)


def motion_seconds(steps: int, joints: int, points: int = 0, strengths: bool = False) -> float:
    """Seconds of a run in real time on one thread. ``points``: contact points, four of a joint included, and
    ``strengths``: whether their law is more than friction."""
    further = POINT_LAW_SECONDS * points if strengths else DRY_POINT_SECONDS * max(0, points - 4 * joints)
    return steps * (MOTION_SECONDS + MOTION_JOINT_SECONDS * joints + further)


def path_seconds(steps: float, convex: int, points: int, strengths: bool) -> float:
    """Seconds of so many steps of relaxation with so many ``convex`` joints and contact ``points`` of all others."""
    each = POINT_LAW_SECONDS if strengths else DRY_POINT_SECONDS
    return steps * (PATH_SECONDS + MOTION_JOINT_SECONDS * convex + each * points)


def breaking_equilibria(bonds: int, tolerance: float) -> int:
    """Equilibria of a growing load that are added as so many ``bonds`` break one after the other."""
    return round(min(BREAKING_PER_BOND * bonds, BREAKING_OF_ALL * math.sqrt(bonds), BREAKING_BY_TOLERANCE / tolerance))


def row_seconds(rows: int) -> float:
    """Seconds for the rows of a run in real time."""
    return ROW_SECONDS * rows


def heap_seconds(steps: int, blocks: int) -> float:
    """Seconds of a run in real time in which so many ``blocks`` fall, and contacts form and part everywhere."""
    return steps * (MOTION_SECONDS + HEAP_BLOCK_SECONDS * blocks)


def fall_seconds(displacement: float, rate: float, gravity: float) -> float:
    """Time (s) in which a block moves by ``displacement`` (m) after it has lost its balance on a table that tilts on at
    ``rate`` (deg/s): its acceleration is g times the angle since then."""
    return (6.0 * displacement / (gravity * math.radians(rate))) ** (1.0 / 3.0)


def duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 1.0 else f"{seconds:.1g} s"
