"""Random scenes that combine features by a pairwise covering design, each judged by independent answers.

    python tools/drawn_features.py [--count 2000] [--seed 1] [--jobs 2] [--table]

Every pair of levels of the factors below occurs in some scene, and all pairs again with other numbers, until the count
is reached. A scene is judged independently of the search: by limit analysis, which no state can exceed; by a second
route to the same answer (constant rate, or the path of equilibria in the deformed geometry, beside the search in the
initial one); by the transformed scene (rotated, mirrored, scaled, blocks permuted); and for a single dry box by the
lesser of sliding and overturning. It is wrong if a bracket lies above the bound, if routes that claim a unique answer
disagree by more than their error bars, or if a transformation changes an answer reported as unique (one that depends on
the path may depend on rounding as well). Prints counts, with ``--table`` the table of features and engines of
docs/verification.md; exits with 1 if an answer is wrong.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context

import numpy as np
from feature_scenes import FACTORS, NAMES, QUICK, Drawn, covering, drawn, seen
from numba.core.compiler_lock import global_compiler_lock

from dembrick.errors import DembrickError
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import (
    DisplacementControl,
    SettlementControl,
    YieldControl,
)
from dembrick.scenario.model import Scenario
from dembrick.scenario.stages import controls_of
from dembrick.scenario.ties import Tie, TieEnd

ROUNDING = 1e-6
SECOND_ORDER = 4e-3  # relative: allowed difference between deformed and initial geometry in these scenes
VIEW = 2e-5  # relative: allowed change by rounding in a transformed scene, besides the error bars
PATIENCE = 10.0  # s for one answer
INSIDE = ("corrected", "corrected-shear", "distributed")  # formulations whose points lie inside the faces
NO_ANSWER = ("refused", "undecided", "slow")


@dataclass(frozen=True)
class Answer:
    """The answer of one route: a load with its bracket, "stands" or "falls", "unlimited", or why it was refused."""

    said: str  # "load", "stands", "falls", "undecided", "unlimited", "refused"
    V: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    unique: bool = True
    why: str = ""
    moved: dict[str, np.ndarray] = field(default_factory=dict)  # m, of the blocks on a path in the deformed geometry


@contextmanager
def patience() -> Iterator[None]:
    """Context that raises TimeoutError after `PATIENCE`, so that slow runs in the deformed geometry are cut short."""

    def stop(*_):
        if global_compiler_lock.is_locked():  # an interrupted compiler would leave an incomplete kernel
            signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        else:
            raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def answer(scenario: Scenario) -> Answer:
    """The answer of the program for a scene."""
    try:
        with warnings.catch_warnings(), patience():
            warnings.simplefilter("error", RuntimeWarning)
            result = simulate(scenario, record=False)
    except DembrickError as error:
        return Answer("refused", why=str(error))
    except (TimeoutError, TypeError) as error:
        if not isinstance(error, TimeoutError) and not isinstance(error.__cause__, TimeoutError):  # numpy wraps it
            raise
        return Answer("slow", why=f"no answer within {PATIENCE:g} s")
    told = result.as_dict()
    if "statics" in told:
        stands = told["statics"]["stands"]
        return Answer("undecided" if stands is None else "stands" if stands else "falls")
    if told.get("unlimited"):
        return Answer("unlimited", lower=told["yield_point"]["V_lower"])
    point = told["yield_point"]
    path = told.get("path") or told.get("collapse") or {}
    dependent = told.get("path_dependent", path.get("path_dependent", False))
    bounds = [math.nan if point[key] is None else point[key] for key in ("V", "V_lower", "V_upper")]
    moved = dict(zip(result.assembly.names, result.displacement, strict=True)) if told.get("moved") else {}
    return Answer("load", *bounds, unique=not dependent, moved=moved)


def bound(scenario: Scenario) -> Answer:
    """Bound by limit analysis with the joints of the run: no state carries more than ``upper``. Earlier stages have no
    other effect on it."""
    loads = tuple(load for load in scenario.loads if load.stages is None)
    try:
        found = limit(replace(scenario, stages=(), loads=loads, among=controls_of(scenario))).as_dict()
    except DembrickError as error:
        return Answer("refused", why=str(error))
    if "statics" in found or found.get("status") in ("stands", "falls"):
        return Answer(found["status"])
    if found.get("unlimited"):
        return Answer("unlimited")
    return Answer("load", found.get("load_factor", math.nan), found["lower"], found["upper"])


def other_route(scenario: Scenario) -> Scenario | None:
    """The same question for another engine: in the deformed instead of the initial geometry, or vice versa."""
    control = scenario.control
    if isinstance(control, DisplacementControl):
        return replace(scenario, control=YieldControl(1e-3, large_displacements=control.large_displacements))
    if hasattr(control, "large_displacements") and not any(isinstance(s, SettlementControl) for s in scenario.stages):
        return replace(scenario, control=replace(control, large_displacements=not control.large_displacements))
    return None


def judged(one: Drawn, deformed: bool = True) -> tuple[str, str]:
    """Verdict and reason: "right", "told" (reported as depending on the path), "refused", "undecided", "WRONG"; without
    ``deformed`` there is no second route in the deformed geometry, which takes seconds."""
    scenario, levels = one.scenario, one.levels
    first = answer(scenario)
    if first.said in NO_ANSWER:
        return first.said, first.why[:160]
    wrong = []
    proven = bound(_with_edges(scenario) if levels["geometry"] == "deformed" else scenario)
    large = levels["geometry"] == "deformed" or levels["before"] == "a settlement"
    slack = ROUNDING + (SECOND_ORDER if large else 0.0)
    if first.moved and scenario.ties and proven.said == "load":  # ties rotate as their blocks move, and may bear more
        turned = bound(_with_ties_at(scenario, first.moved))
        proven = max(proven, turned, key=lambda one: one.upper if one.said == "load" else -math.inf)
    if proven.said == "falls" and first.said != "falls":
        wrong.append(f"limit analysis says that it falls, the run {first.said}")
    if proven.said == "load" and first.said == "unlimited" and first.lower > proven.upper * (1.0 + slack):
        wrong.append(f"called unlimited, limit analysis says at most {proven.upper:.6g}")
    if proven.said == "load" and first.said == "load":
        if first.lower > proven.upper * (1.0 + slack):
            wrong.append(f"V at least {first.lower:.7g}, limit analysis says at most {proven.upper:.7g}")
        if first.V > proven.upper * (1.0 + slack + 1e-3):
            wrong.append(f"V {first.V:.7g}, limit analysis says at most {proven.upper:.7g}")
    if deformed or isinstance(scenario.control, DisplacementControl):
        wrong += _disagreement(first, levels, scenario, slack)
    view, factor = seen(scenario, levels["seen"], np.random.default_rng([one.number, 7]))
    again = answer(view)
    if levels["control"] in ("pushover", "tilt") or levels["load"] == "driven pressure":
        factor = 1.0  # V is a load factor
    if again.said not in (first.said, *NO_ANSWER):
        wrong.append(f"{levels['seen']}: {again.said} for {first.said}")
    elif (
        first.said == again.said == "load"
        and (first.unique or again.unique)  # else another order of blocks may take another path, as both report
        and not _overlap(first, again, factor, VIEW + (SECOND_ORDER if large else 0.0))
    ):
        text = f"{again.lower / factor:.7g} to {again.upper / factor:.7g} for {first.lower:.7g} to {first.upper:.7g}"
        wrong.append(f"{levels['seen']}: {text}")
    if wrong:
        return "WRONG", "; ".join(wrong)
    return ("right" if first.unique else "told"), ""


def _with_ties_at(scenario: Scenario, moved: dict[str, np.ndarray]) -> Scenario:
    """The scene with its ties in the directions that they have after the blocks have ``moved``: their first ends, at
    supports, are shifted horizontally in the opposite direction."""

    def turned(tie: Tie) -> Tie:
        support, free = tie.between
        point = np.subtract(support.point, (moved[free.block] - moved[support.block]) * (1.0, 1.0, 0.0))
        return replace(tie, between=(TieEnd(support.block, tuple(point.tolist())), free))

    return _with_edges(replace(scenario, ties=tuple(map(turned, scenario.ties))))


def _with_edges(scenario: Scenario) -> Scenario:
    """The scene with joints that reach to the edges of their faces: in the deformed geometry a block that tips over
    points inside the face is then supported by its edges."""
    law = scenario.joint
    return replace(scenario, joint=replace(law, formulation="concave")) if law.formulation in INSIDE else scenario


def _disagreement(first: Answer, levels: dict[str, str], scenario: Scenario, slack: float) -> list[str]:
    """Contradictions by a second route, if both routes claim a unique answer."""
    route = other_route(scenario)
    if route is None:
        return []
    second = answer(route)
    if {first.said, second.said} == {"stands", "falls"}:
        return [f"{first.said}, the other route {second.said}"]
    if first.said != second.said or first.said != "load" or not (first.unique and second.unique):
        return []
    if isinstance(scenario.control, DisplacementControl):
        if first.lower > second.upper * (1.0 + slack + 2e-3):  # a test that stops early gives less, never more
            return [f"{first.lower:.7g} to {first.upper:.7g}, by its search {second.lower:.7g} to {second.upper:.7g}"]
        return []
    if _overlap(first, second, 1.0, SECOND_ORDER):
        return []
    if (
        levels["formulation"] == "convex"
    ):  # the toe has a finite width, which the search in the initial geometry neglects
        deformed, start = (first, second) if scenario.control.large_displacements else (second, first)
        if start.lower * (1.0 - toe(scenario.joint.normal_stiffness)) <= deformed.V <= start.upper:
            return []
    return [f"{first.lower:.7g} to {first.upper:.7g}, by the other route {second.lower:.7g} to {second.upper:.7g}"]


def toe(stiffness: float) -> float:
    """Relative loss of load by the toe of a convex block of 0.2 m that rocks over a corner: a triangle carries its
    weight, and its depth grows with the cube root of weight over stiffness (Pa/m)."""
    return 0.3 * (stiffness / 1e8) ** (-1.0 / 3.0)


def _overlap(one: Answer, other: Answer, factor: float, slack: float) -> bool:
    low, high = max(one.lower, other.lower / factor), min(one.upper, other.upper / factor)
    return not low > high + slack * max(abs(low), abs(high))


def of_number(
    task: tuple[int, dict[str, str], int], deformed: bool = True
) -> tuple[int, dict[str, str], str, str, float]:
    """Number, levels, verdict, reason and seconds of a scene."""
    began = time.perf_counter()
    number, levels, seed = task
    try:
        one = drawn(number, levels, seed)
    except DembrickError as error:
        return number, levels, "refused", str(error)[:160], 0.0
    verdict, why = judged(one, deformed)
    return number, levels, verdict, why, time.perf_counter() - began


def scenes(count: int, seed: int, quick: bool = False) -> list[tuple[int, dict[str, str], int]]:
    """Numbers, levels and seed of the first scenes of the design; ``quick``: with `QUICK` levels only."""
    rows = covering(np.random.default_rng(seed), QUICK if quick else FACTORS)
    return [(number, next(rows), seed) for number in range(count)]


def table(found: list) -> str:
    """Table of features (rows) by controls (columns): numbers of right or told scenes, and of refused ones."""
    columns = FACTORS["control"]
    lines = ["| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for name in NAMES:
        if name in ("control", "seen"):
            continue
        for level in FACTORS[name]:
            cells = []
            for control in columns:
                here = [v for _, levels, v, *_ in found if levels[name] == level and levels["control"] == control]
                count = Counter(here)
                good, refused = count["right"] + count["told"], count["refused"] + count["undecided"]
                cells.append(f"{good}" + (f" ({refused} refused)" if refused else ""))
            lines.append(f"| {name}: {level} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> int:
    """Draw random scenes, run them, count verdicts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", type=int, default=None, help="number of one scene: its levels, answers and verdict")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="only what answers in a tenth of a second, and no second route in the deformed geometry",
    )
    parser.add_argument("--table", action="store_true", help="print features against controls")
    options = parser.parse_args()
    tasks = scenes(options.count if options.only is None else options.only + 1, options.seed, options.quick)
    if options.only is not None:
        number, levels, seed = tasks[-1]
        one = drawn(number, levels, seed)
        route = other_route(one.scenario)
        print(levels, answer(one.scenario), bound(one.scenario), route and answer(route), judged(one), sep="\n")
        return 0
    found = []
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        for result in pool.map(partial(of_number, deformed=not options.quick), tasks, chunksize=4):
            found.append(result)
            number, levels, verdict, why, seconds = result
            if verdict == "WRONG":
                print(f"{number:5} WRONG {why}\n      {levels}", flush=True)
            elif seconds > 20.0:
                print(f"{number:5} took {seconds:.0f} s: {levels}", flush=True)
    count = Counter(verdict for *_, verdict, _, _ in found)
    print(", ".join(f"{number} {verdict}" for verdict, number in count.most_common()))
    reasons = Counter(why[:70] for _, _, verdict, why, _ in found if verdict == "refused")
    print("refused:", *(f"{number:5} {why}" for why, number in reasons.most_common(25)), sep="\n")
    times = np.array([seconds for *_, seconds in found])
    late = np.quantile(times, 0.95)
    print(f"seconds a scene: median {np.median(times):.2f}, 95 % within {late:.1f}, sum {times.sum():.0f}")
    if options.table:
        print(table(found))
    return 1 if count["WRONG"] else 0


if __name__ == "__main__":
    sys.exit(main())
