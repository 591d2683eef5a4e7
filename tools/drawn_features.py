"""Scenes in which features meet: drawn by a pairwise covering design, each judged by independent answers.

    python tools/drawn_features.py [--count 2000] [--seed 1] [--jobs 2] [--table]

Every pair of levels of the factors below meets in some scene, and all pairs meet again with other numbers, until the
count is reached. A scene is judged by what does not know the search: limit analysis, which no state can exceed; a
second route to the same answer (constant rate or the path of equilibria in the deformed geometry beside the search in
that of the start); the same scene seen otherwise (turned, mirrored, scaled, its blocks permuted); and for a single dry
box the least of sliding and overturning. It is wrong if a bracket lies above the bound, if routes that claim one
answer disagree by more than their bars, or if the view changes an answer that is said to be unique (one that depends on
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
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product
from multiprocessing import get_context

import numpy as np
from numba.core.compiler_lock import global_compiler_lock

from dembrick.errors import DembrickError
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Part
from dembrick.scenario.controls import (
    DisplacementControl,
    PushoverControl,
    SettlementControl,
    StaticsControl,
    TiltControl,
    YieldControl,
)
from dembrick.scenario.model import Actuator, Block, JointLaw, Load, Material, Pressure, Scenario, Tie
from dembrick.scenario.ties import TieEnd

FACTORS = {
    "structure": ("block", "stack", "wall", "arch"),
    "shape": ("box", "L", "ring"),
    "formulation": ("concave", "convex", "corrected", "corrected-shear", "distributed"),
    "control": ("yield", "pushover", "tilt", "displacement", "statics"),
    "geometry": ("start", "deformed"),
    "load": ("none", "off the centre", "oblique", "pressure", "driven pressure"),
    "tie": ("none", "soft", "prestressed", "bar"),
    "strength": ("none", "cohesion", "tension", "residual", "dilation", "crushing"),
    "before": ("nothing", "statics", "a push", "a settlement"),
    "seen": ("turned", "mirrored", "scaled", "permuted"),
}
NAMES = tuple(FACTORS)
QUICK = FACTORS | {  # levels that answer in some tenths of a second
    "structure": ("block", "stack", "wall"),
    "control": ("yield", "pushover", "tilt", "statics"),
    "geometry": ("start",),
    "before": ("nothing", "statics", "a push"),
}
GRAVITY, DENSITY = 9.81, 2000.0
STIFFNESS = {"start": 1e11, "deformed": 2e8}  # Pa/m: what joints give is then far below what routes differ by
ROUNDING = 1e-6
SECOND_ORDER = 4e-3  # relative: what the deformed geometry may differ from that of the start in these scenes
VIEW = 2e-5  # relative: what a view may change by rounding, beside the bars
PATIENCE = 10.0  # s for one answer
NO_ANSWER = ("refused", "undecided", "slow")
SUPPORT_MOVES = 2e-4  # m: of a settlement before the search; far below the size of a block


def covering(rng: np.random.Generator, factors: dict[str, tuple[str, ...]]) -> Iterator[dict[str, str]]:
    """Rows of a pairwise covering design without end: all pairs of levels meet before any row of the next design."""
    pairs = list(combinations(range(len(NAMES)), 2))
    while True:
        missing = {(i, a, j, b) for i, j in pairs for a, b in product(factors[NAMES[i]], factors[NAMES[j]])}
        while missing:
            best: tuple[int, list[str]] = (0, [])
            for _ in range(30):
                row = [str(rng.choice(factors[name])) for name in NAMES]
                i, a, j, b = min(missing)
                row[i], row[j] = a, b
                met = sum((i, row[i], j, row[j]) in missing for i, j in pairs)
                best = max(best, (met, row))
            row = best[1]
            missing -= {(i, row[i], j, row[j]) for i, j in pairs}
            yield dict(zip(NAMES, row, strict=True))


@dataclass(frozen=True)
class Drawn:
    """One scene: its number, the levels of its factors, and the scenario."""

    number: int
    levels: dict[str, str]
    scenario: Scenario


def drawn(number: int, levels: dict[str, str], seed: int) -> Drawn:
    """The scene of a row of the design, with numbers of its own."""
    rng = np.random.default_rng([seed, number])
    blocks, top = _blocks(levels, rng)
    law = _law(levels, rng)
    weight = DENSITY * GRAVITY * 0.2 * 0.2 * 0.2
    size = 0.2
    loads, pressures, ties = (), (), ()
    if levels["load"] == "off the centre":
        place = (rng.uniform(-0.09, 0.09), rng.uniform(-0.095, -0.055), top[2])  # on an L and a ring as well
        loads = (Load(_last(blocks), (0.0, 0.0, -float(rng.uniform(0.2, 2.0)) * weight), tuple(map(float, place))),)
    elif levels["load"] == "oblique":
        force = weight * np.array([rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(-1.0, 0.1)])
        loads = (Load(_last(blocks), tuple(map(float, force))),)
    elif levels["load"] in ("pressure", "driven pressure"):
        driven = levels["load"] == "driven pressure"
        value = float(rng.uniform(0.02, 0.1)) * weight / size**2
        face = (0.0, 0.0, 1.0) if levels["structure"] == "arch" else (-1.0, 0.0, 0.0)
        pressures = (Pressure(_last(blocks), face, value, actuator=driven),)
    if levels["tie"] != "none":
        ties = (_tie(levels["tie"], blocks, top, weight, rng),)
    if levels["before"] == "a push":
        loads += (Load(_last(blocks), (0.15 * weight, -0.1 * weight, 0.0), stages=(1,)),)
    actuators = ()
    control = _control(levels, rng)
    if levels["control"] in ("yield", "displacement") and levels["load"] != "driven pressure":
        turn, slope = rng.uniform(-0.5, 0.5), rng.choice([0.0, rng.uniform(-0.5, 0.5)])
        direction = (math.cos(turn), math.sin(turn), float(slope))
        point = top + np.array([-0.1, rng.uniform(-0.095, -0.025), -rng.uniform(0.02, 0.18)])
        if levels["structure"] == "arch":  # its flanks are covered, so it is pressed down
            point, direction = top + np.array([-0.05, 0.0, 0.0]), (0.3 * direction[0], 0.3 * direction[1], -1.0)
        actuators = (Actuator("jack", _last(blocks), tuple(map(float, point)), direction),)
    stages = _before(levels, control)
    scenario = Scenario(
        f"drawn {number}", (0.0, 0.0, -GRAVITY), law, {"stone": Material(DENSITY)}, tuple(blocks), control,
        loads=loads, actuators=actuators, pressures=pressures, ties=ties, stages=stages,
    )  # fmt: skip
    return Drawn(number, levels, scenario)


def _last(blocks: list[Block]) -> str:
    return next(block.name for block in reversed(blocks) if not block.fixed)


def _blocks(levels: dict[str, str], rng: np.random.Generator) -> tuple[list[Block], np.ndarray]:
    """Blocks, the fixed ones first, and the middle (m) of the top of the last one, which is 0.2 m wide there."""
    kind, size = levels["structure"], 0.2
    floor = [Block("floor", "stone", (4.0, 4.0, 0.4), (0.0, 0.0, -0.2), fixed=True)]
    if kind == "arch":
        return _flat_arch(rng)
    if kind == "block":
        under, base = floor, 0.0
    elif kind == "stack":
        wide = float(rng.uniform(0.2, 0.4))
        under = [*floor, Block("lower", "stone", (wide, wide, size), (0.0, 0.0, 0.1))]
        base = size
    else:
        halves = [Block(f"half {i}", "stone", (size, size, size), (x, 0.0, 0.1)) for i, x in enumerate((-0.1, 0.1))]
        under, base = [*floor, *halves], size
    if levels["shape"] == "box":
        under.append(Block("top", "stone", (size, size, size), (0.0, 0.0, base + 0.1)))
        return under, np.array([0.0, 0.0, base + size])
    parts = _parts(levels["shape"], base)
    under.append(Block("top", "stone", parts=parts))
    return under, np.array([0.0, 0.0, base + size])


def _parts(shape: str, base: float) -> tuple[Part, ...]:
    """Convex parts of a block 0.2 m wide and high with an L or a ring for its bed."""
    if shape == "L":
        boxes = [((0.2, 0.08, 0.2), (0.0, -0.06)), ((0.08, 0.12, 0.2), (-0.06, 0.04))]
    else:
        boxes = [((0.2, 0.05, 0.2), (0.0, s * 0.075)) for s in (-1, 1)]
        boxes += [((0.05, 0.1, 0.2), (s * 0.075, 0.0)) for s in (-1, 1)]
    return tuple(Part(box=edges, position=(*centre, base + 0.1)) for edges, centre in boxes)


def _flat_arch(rng: np.random.Generator) -> tuple[list[Block], np.ndarray]:
    """Three wedges between two abutments, the one in the middle 0.2 m wide at its top."""
    lean = float(rng.uniform(0.02, 0.06))
    top, low = np.array([-0.1, 0.1]), np.array([-0.1 + lean, 0.1 - lean])

    def wedge(name: str, above, below, fixed: bool = False) -> Block:
        corners = [(float(x), y, z) for y in (-0.1, 0.1) for z, xs in ((0.2, above), (0.0, below)) for x in xs]
        return Block(name, "stone", vertices=tuple(corners), fixed=fixed)

    left = (-0.3, -0.1), (-0.3 + 2 * lean, -0.1 + lean)
    right = tuple((-b, -a) for a, b in left)
    walls = (-0.6, -0.3), (-0.6, -0.3 + 2 * lean)
    blocks = [
        wedge("wall left", *walls, fixed=True),
        wedge("wall right", *((-b, -a) for a, b in walls), fixed=True),
        wedge("left", *left),
        wedge("right", *right),
        wedge("top", top, low),
    ]
    return blocks, np.array([0.0, 0.0, 0.2])


def _law(levels: dict[str, str], rng: np.random.Generator) -> JointLaw:
    friction = float(rng.uniform(0.3, 0.9))
    slow = levels["before"] == "a settlement" or levels["control"] == "displacement"
    stiffness = STIFFNESS["deformed" if slow else levels["geometry"]]
    law = JointLaw(levels["formulation"], friction, stiffness, 0.4 * stiffness)
    pressure = DENSITY * GRAVITY * 0.2
    cohesion = float(rng.uniform(0.2, 1.0)) * pressure
    changes: dict[str, dict] = {
        "none": {},
        "cohesion": {"cohesion": cohesion, "residual_cohesion": cohesion},
        "tension": {"cohesion": cohesion, "tensile_strength": 0.5 * cohesion},
        "residual": {"cohesion": cohesion, "residual_friction": 0.8 * friction, "residual_cohesion": 0.5 * cohesion},
        "dilation": {"dilation": float(rng.uniform(0.05, 0.25))},
        "crushing": {"compressive_strength": float(rng.uniform(20.0, 100.0)) * pressure},
    }
    return replace(law, **changes[levels["strength"]])


def _tie(kind: str, blocks: list[Block], top: np.ndarray, weight: float, rng: np.random.Generator) -> Tie:
    """A tie from the top of the last block to a support, stretched by a push along +x."""
    support = blocks[0].name
    foot = top + np.array([-0.35, float(rng.uniform(-0.1, 0.1)), -0.05])
    if blocks[0].name == "floor":
        foot[2] = 0.0
    ends = (TieEnd(support, tuple(map(float, foot))), TieEnd(_last(blocks), tuple(map(float, top + (-0.05, 0.0, 0.0)))))
    strength = float(rng.uniform(0.1, 1.0)) * weight
    stiffness = float(10 ** rng.uniform(6.0, 8.0)) if kind == "soft" else 1e8
    prestress = float(rng.uniform(0.1, 0.9)) * strength if kind == "prestressed" else 0.0
    return Tie(ends, stiffness, strength, prestress, tension_only=kind != "bar")


def _control(levels: dict[str, str], rng: np.random.Generator):
    large = levels["geometry"] == "deformed"
    turn = float(rng.uniform(-0.5, 0.5))
    ahead = (math.cos(turn), math.sin(turn), 0.0)
    kind = levels["control"]
    if kind == "yield":
        return YieldControl(1e-3, large_displacements=large)
    if kind == "displacement":
        return DisplacementControl(1e-3, 1e-4, large_displacements=large)
    if kind == "pushover":
        return PushoverControl(ahead, large_displacements=large)
    if kind == "tilt":
        return TiltControl((-ahead[1], ahead[0], 0.0), large_displacements=large)
    return StaticsControl(large_displacements=large)


def _before(levels: dict[str, str], control) -> tuple:
    """The stages before the search; a load that pushes acts in the first one, and is taken off in the next."""
    if levels["before"] == "statics":
        return (StaticsControl(),)
    if levels["before"] == "a push":
        return StaticsControl(), StaticsControl()
    if levels["before"] == "a settlement":
        support = "wall right" if levels["structure"] == "arch" else "floor"
        return (SettlementControl((support,), (SUPPORT_MOVES, 0.0, 0.0)),)
    return ()


# What is seen otherwise: the same structure to another observer.


def seen(scenario: Scenario, kind: str, rng: np.random.Generator) -> tuple[Scenario, float]:
    """The scene turned about the vertical, mirrored, scaled, or with its blocks in another order; and the factor of V
    that follows for forces."""
    if kind == "permuted":
        order = rng.permutation(len(scenario.blocks))
        return replace(scenario, blocks=tuple(scenario.blocks[i] for i in order)), 1.0
    if kind == "scaled":
        return _scaled(scenario, 2.0), 8.0
    if kind == "mirrored":
        return _mapped(scenario, np.diag([1.0, -1.0, 1.0])), 1.0
    angle = float(rng.uniform(0.3, 1.2))
    c, s = math.cos(angle), math.sin(angle)
    return _mapped(scenario, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])), 1.0


def _corners(block: Block | Part) -> np.ndarray:
    if block.vertices is not None:
        return np.array(block.vertices, float)
    half = 0.5 * np.array(block.box)
    return np.array(block.position) + np.array([np.array(s) * half for s in product((-1, 1), repeat=3)])


def _mapped(scenario: Scenario, matrix: np.ndarray, factor: float = 1.0) -> Scenario:
    """All places and directions under an orthogonal matrix, lengths by a factor, forces by its cube."""

    def along(v):
        return tuple(float(x) for x in matrix @ np.array(v, float))

    def place(v):
        return tuple(factor * x for x in along(v))

    def block(one: Block) -> Block:
        if one.parts is not None:
            parts = tuple(Part(vertices=tuple(place(v) for v in _corners(part))) for part in one.parts)
            return Block(one.name, one.material, parts=parts, fixed=one.fixed)
        return Block(one.name, one.material, vertices=tuple(place(v) for v in _corners(one)), fixed=one.fixed)

    def control(one):
        if isinstance(one, PushoverControl):
            return replace(one, direction=along(one.direction))
        if isinstance(one, TiltControl):
            return replace(one, axis=tuple(np.linalg.det(matrix) * x for x in along(one.axis)))
        if isinstance(one, SettlementControl):
            return replace(one, displacement=place(one.displacement))
        if isinstance(one, DisplacementControl):
            return replace(one, rate=factor * one.rate, travel=factor * one.travel)
        return one

    volume = factor**3
    law = scenario.joint
    stresses = ("cohesion", "tensile_strength", "residual_cohesion", "compressive_strength")
    strengths = {key: factor * getattr(law, key) for key in stresses if getattr(law, key)}
    return replace(
        scenario,
        joint=replace(law, **strengths),
        blocks=tuple(block(one) for one in scenario.blocks),
        control=control(scenario.control),
        stages=tuple(control(one) for one in scenario.stages),
        loads=tuple(
            replace(load, force=tuple(volume * x for x in along(load.force)), point=load.point and place(load.point))
            for load in scenario.loads
        ),
        actuators=tuple(
            replace(one, point=place(one.point), direction=along(one.direction)) for one in scenario.actuators
        ),
        pressures=tuple(
            replace(one, direction=along(one.direction), value=factor * one.value) for one in scenario.pressures
        ),
        ties=tuple(
            replace(
                tie,
                between=tuple(TieEnd(end.block, place(end.point)) for end in tie.between),
                stiffness=factor**2 * tie.stiffness,
                strength=volume * tie.strength,
                prestress=volume * tie.prestress,
            )
            for tie in scenario.ties
        ),
    )


def _scaled(scenario: Scenario, factor: float) -> Scenario:
    """The same structure of another size: stresses grow with it, forces by its cube, load factors stay."""
    return _mapped(scenario, np.eye(3), factor)


# How a scene is judged.


@dataclass(frozen=True)
class Answer:
    """What one route said: a load with its bracket, "stands" or "falls", "unlimited", or why it refused."""

    said: str  # "load", "stands", "falls", "undecided", "unlimited", "refused"
    V: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    unique: bool = True
    why: str = ""


@contextmanager
def patience() -> Iterator[None]:
    """Within, TimeoutError after `PATIENCE`: what takes long in the deformed geometry holds up the others."""

    def stop(*_):
        if global_compiler_lock.is_locked():  # a compiler that is interrupted leaves half a kernel behind
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
    """What the program says of a scene."""
    try:
        with warnings.catch_warnings(), patience():
            warnings.simplefilter("error", RuntimeWarning)
            result = simulate(scenario, record=False)
    except DembrickError as error:
        return Answer("refused", why=str(error))
    except TimeoutError:
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
    return Answer("load", *bounds, unique=not dependent)


def bound(scenario: Scenario) -> Answer:
    """What limit analysis proves: no state carries more than ``upper``. Earlier stages have no say in it."""
    loads = tuple(load for load in scenario.loads if load.stages is None)
    try:
        found = limit(replace(scenario, stages=(), loads=loads)).as_dict()
    except DembrickError as error:
        return Answer("refused", why=str(error))
    if "statics" in found or found.get("status") in ("stands", "falls"):
        return Answer(found["status"])
    if found.get("unlimited"):
        return Answer("unlimited")
    return Answer("load", found.get("load_factor", math.nan), found["lower"], found["upper"])


def other_route(scenario: Scenario) -> Scenario | None:
    """The same question by another engine: deformed geometry for that of the start, and the other way round."""
    control = scenario.control
    if isinstance(control, DisplacementControl):
        return replace(scenario, control=YieldControl(1e-3, large_displacements=control.large_displacements))
    if hasattr(control, "large_displacements") and not any(isinstance(s, SettlementControl) for s in scenario.stages):
        return replace(scenario, control=replace(control, large_displacements=not control.large_displacements))
    return None


def judged(one: Drawn, deformed: bool = True) -> tuple[str, str]:
    """Verdict and reason: "right", "told" (that it depends on the path), "refused", "undecided", "WRONG"; without
    ``deformed`` no second route is taken through the deformed geometry, which takes seconds."""
    scenario, levels = one.scenario, one.levels
    first = answer(scenario)
    if first.said in NO_ANSWER:
        return first.said, first.why[:160]
    wrong = []
    proven = bound(scenario)
    large = levels["geometry"] == "deformed" or levels["before"] == "a settlement"
    slack = ROUNDING + (SECOND_ORDER if large else 0.0)
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
        and (first.unique or again.unique)  # else another order of blocks may take another path, as both say
        and not _overlap(first, again, factor, VIEW + (SECOND_ORDER if large else 0.0))
    ):
        text = f"{again.lower / factor:.7g} to {again.upper / factor:.7g} for {first.lower:.7g} to {first.upper:.7g}"
        wrong.append(f"{levels['seen']}: {text}")
    if wrong:
        return "WRONG", "; ".join(wrong)
    return ("right" if first.unique else "told"), ""


def _disagreement(first: Answer, levels: dict[str, str], scenario: Scenario, slack: float) -> list[str]:
    """What a second route says otherwise, if both claim that there is one answer."""
    route = other_route(scenario)
    if route is None:
        return []
    second = answer(route)
    if {first.said, second.said} == {"stands", "falls"}:
        return [f"{first.said}, the other route {second.said}"]
    if first.said != second.said or first.said != "load" or not (first.unique and second.unique):
        return []
    if isinstance(scenario.control, DisplacementControl):
        if first.lower > second.upper * (1.0 + slack + 2e-3):  # a test that stops early bears less, none more
            return [f"{first.lower:.7g} to {first.upper:.7g}, by its search {second.lower:.7g} to {second.upper:.7g}"]
        return []
    if _overlap(first, second, 1.0, SECOND_ORDER):
        return []
    if (
        levels["formulation"] == "convex"
    ):  # its toe has a width, which the search in the geometry of the start leaves out
        deformed, start = (first, second) if scenario.control.large_displacements else (second, first)
        if start.lower * (1.0 - toe(scenario.joint.normal_stiffness)) <= deformed.V <= start.upper:
            return []
    return [f"{first.lower:.7g} to {first.upper:.7g}, by the other route {second.lower:.7g} to {second.upper:.7g}"]


def toe(stiffness: float) -> float:
    """Relative loss by the toe of a convex block of 0.2 m that rocks over a corner: a triangle that bears its weight,
    with a depth as the third root of weight over stiffness (Pa/m)."""
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
    """Numbers, levels and seed of the first scenes of the design; ``quick``: only `QUICK` ones."""
    rows = covering(np.random.default_rng(seed), QUICK if quick else FACTORS)
    return [(number, next(rows), seed) for number in range(count)]


def table(found: list) -> str:
    """Rows of features, columns of controls: how many were right or told, and how many refused."""
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
    """Draw, run, count."""
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
