"""Expected steps and seconds of a run, before it is made: measured costs of steps times expected counts.

The costs are processor time of one core of a usual server, of compiled code; docs/performance.md has the tables. They
are good to a factor of two or so, and `slowness` compares the machine at hand with that server. What nobody knows
beforehand is how many Newton steps a search takes: walls of twenty to two hundred blocks that rock took 3 to 56, those
whose joints slide over one another, as limit analysis counts them, 55 to 1,055. Of 36 such walls 33 took the steps told
here to a factor of four.
"""

from __future__ import annotations

import math
import time
from functools import cache

USUAL_PASS = 3.8e-8  # s of a pass of the loop of `slowness` on the machine that all costs below are of
START_SECONDS = 0.7  # of a command: start-up, loading what is compiled, building, writing
LONG = 3600.0  # s: a run that takes more says so before it starts
ROCKING = 13.0  # steps of a search that rocks, however many blocks
FIRST_SLIDING, NEWTON_PER_JOINT = 45.0, 2.0  # of one that slides: and more with every joint that does
FEW_SLIDING, MORE_SLIDING = 7.0, 1.1  # at most so many times the number of them to that power: a dam that slides on its
# foot took 7, four slabs on a slope 17, a wall with seven joints that slide 117
CONVEX_ROCKING = 1.4  # times as many steps where convex joints rock
EQUILIBRIA = 32  # on the path of a search: some ten to sixty are recorded
WITHIN = 4.0  # factor by which the steps of a search of several joints may be off
WASTED = 1e8  # iterations in vain before blocks are pushed on, times free blocks squared
LEAST_WASTED = 12  # and at least
MOST_USEFUL = 300  # of those before that are not in vain
PUSHED_SECONDS = 2e-3  # s a joint of all pushes of driven relaxation
NEWTON_SECONDS = 1.2e-5  # s a joint and Newton step: equations, joint forces, bracket
STATICS_STEPS = 50  # of a dead-load equilibrium of an assembly: 1 to 300 have been seen where it stands
RELAXATION_SECONDS = 1.5e-6  # s a joint and step of a dead-load equilibrium
LOOP_SECONDS, POINT_SECONDS = 4e-7, 8e-9  # s a joint and step of a constant-rate test, and a contact point more
MOTION_SECONDS, MOTION_JOINT_SECONDS = 9e-6, 5e-8  # s a step in real time, and a joint more, contacts sought as well
ROW_SECONDS = 4e-5  # s a row of the record in real time
HEAP_BLOCK_SECONDS = 1.2e-5  # s a step and block, where blocks fall and meet anywhere
SEARCH_FIRST, SEARCH_PER_DIGIT = 10, 1.2  # Newton steps of a search of a lone joint to 1e-2, and of every digit more
BENT_FIRST, BENT_PER_DIGIT = 18, 3  # of one whose friction follows the load
LONE_SECONDS, LONE_POINT_SECONDS = 2.5e-6, 6e-8  # s of a Newton step of it, and a contact point more


@cache
def slowness() -> float:
    """Time that this machine takes now over that of the costs, by a plain loop of Python; some 5 ms of work."""
    n_passes, least = 10_000, math.inf
    for _ in range(12):
        value, began = 0.0, time.perf_counter()
        for _ in range(n_passes):
            value = 0.5 * value + 1.0
        least = min(least, time.perf_counter() - began)
    return least / n_passes / USUAL_PASS


def search_steps(tolerance: float, bent: bool = False) -> int:
    """Newton steps of the search for the limit load of a lone joint; ``bent``: one whose friction follows the load."""
    first, per_digit = (BENT_FIRST, BENT_PER_DIGIT) if bent else (SEARCH_FIRST, SEARCH_PER_DIGIT)
    return first + round(per_digit * max(0.0, -math.log10(tolerance) - 2.0))


def newton_steps(convex: bool, sliding: int = 0) -> int:
    """Newton steps of a search through equilibria, ``sliding`` joints of which slide in the mechanism."""
    if sliding:
        return round(min(FEW_SLIDING * sliding**MORE_SLIDING, FIRST_SLIDING + NEWTON_PER_JOINT * sliding))
    return round(ROCKING * (CONVEX_ROCKING if convex else 1.0))


def newton_seconds(steps: int, joints: int) -> float:
    """Of a search through equilibria."""
    return NEWTON_SECONDS * steps * joints


def longest_search(blocks: int, joints: int) -> tuple[int, float]:
    """Newton steps and seconds of a search whose blocks snap, until driven relaxation has pushed them on."""
    steps = MOST_USEFUL + round(max(LEAST_WASTED, WASTED / max(blocks, 1) ** 2))
    return steps, newton_seconds(steps, joints) + PUSHED_SECONDS * joints


def lone_seconds(steps: int, points: int) -> float:
    """Of a search of a lone joint with so many contact points."""
    return steps * (LONE_SECONDS + LONE_POINT_SECONDS * points)


def relaxation_seconds(steps: int, joints: int) -> float:
    """Of a dead-load equilibrium."""
    return RELAXATION_SECONDS * steps * joints


def loop_seconds(steps: int, joints: int, points: int) -> float:
    """Of the loop of a constant-rate test."""
    return steps * (LOOP_SECONDS * joints + POINT_SECONDS * points)


def motion_seconds(steps: int, joints: int) -> float:
    """Of a run in real time on one thread."""
    return steps * (MOTION_SECONDS + MOTION_JOINT_SECONDS * joints)


def row_seconds(rows: int) -> float:
    """Of the rows of a run in real time."""
    return ROW_SECONDS * rows


def heap_seconds(steps: int, blocks: int) -> float:
    """Of a run in real time in which so many blocks come down, and contacts form and part everywhere."""
    return steps * (MOTION_SECONDS + HEAP_BLOCK_SECONDS * blocks)


def fall_seconds(displacement: float, rate: float, gravity: float) -> float:
    """How long (s) a block takes to move by ``displacement`` (m) on a table that turns on at ``rate`` (deg/s) from
    where the block leaves its balance: it accelerates as g times the angle that the table has gone since."""
    return (6.0 * displacement / (gravity * math.radians(rate))) ** (1.0 / 3.0)


def duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 1.0 else f"{seconds:.1g} s"
