"""Scenes that combine features by a pairwise covering design, and transformed versions of the same scenes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

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
    "held": ("free", "upright", "untwisted", "in plane"),
    "seen": ("turned", "mirrored", "scaled", "permuted"),
}
HELD = {"free": None, "upright": ("rx", "ry"), "untwisted": ("rz",), "in plane": ("y", "rx", "rz")}  # of the last block
NAMES = tuple(FACTORS)
QUICK = FACTORS | {  # levels that take some tenths of a second
    "structure": ("block", "stack", "wall"),
    "control": ("yield", "pushover", "tilt", "statics"),
    "geometry": ("start",),
    "before": ("nothing", "statics", "a push"),
}
GRAVITY, DENSITY = 9.81, 2000.0
STIFFNESS = {"start": 1e11, "deformed": 2e8}  # Pa/m: makes the effect of compliance far smaller than the slack
SUPPORT_MOVES = 2e-4  # m: settlement before the search, far below the size of a block


def covering(rng: np.random.Generator, factors: dict[str, tuple[str, ...]]) -> Iterator[dict[str, str]]:
    """Endless rows of pairwise covering designs: each design contains all pairs of levels before the next begins."""
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
    """The scene of a row of the design, with random numbers of its own."""
    rng = np.random.default_rng([seed, number])
    blocks, top = _blocks(levels, rng)
    last = next(i for i, block in enumerate(blocks) if block.name == _last(blocks))
    blocks[last] = replace(blocks[last], held=HELD[levels["held"]])
    law = _law(levels, rng)
    weight = DENSITY * GRAVITY * 0.2 * 0.2 * 0.2
    size = 0.2
    loads, pressures, ties = (), (), ()
    if levels["load"] == "off the centre":
        place = (rng.uniform(-0.09, 0.09), rng.uniform(-0.095, -0.055), top[2])  # also inside an L and a ring
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
    """Convex parts of a block 0.2 m wide and high whose bed face is an L or a ring."""
    if shape == "L":
        boxes = [((0.2, 0.08, 0.2), (0.0, -0.06)), ((0.08, 0.12, 0.2), (-0.06, 0.04))]
    else:
        boxes = [((0.2, 0.05, 0.2), (0.0, s * 0.075)) for s in (-1, 1)]
        boxes += [((0.05, 0.1, 0.2), (s * 0.075, 0.0)) for s in (-1, 1)]
    return tuple(Part(box=edges, position=(*centre, base + 0.1)) for edges, centre in boxes)


def _flat_arch(rng: np.random.Generator) -> tuple[list[Block], np.ndarray]:
    """Three wedges between two abutments; the middle one is 0.2 m wide at its top."""
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
    """The stages before the search; a pushing load acts in the first one and is removed in the next."""
    if levels["before"] == "statics":
        return (StaticsControl(),)
    if levels["before"] == "a push":
        return StaticsControl(), StaticsControl()
    if levels["before"] == "a settlement":
        support = "wall right" if levels["structure"] == "arch" else "floor"
        return (SettlementControl((support,), (SUPPORT_MOVES, 0.0, 0.0)),)
    return ()


# Transformations of a scene that must not change the physics.


def seen(scenario: Scenario, kind: str, rng: np.random.Generator) -> tuple[Scenario, float]:
    """The scene rotated about the vertical, mirrored, scaled, or with its blocks in another order; and the resulting
    factor of V if it is a force."""
    if kind == "permuted":
        order = rng.permutation(len(scenario.blocks))
        return replace(scenario, blocks=tuple(scenario.blocks[i] for i in order)), 1.0
    if kind == "scaled":
        return _scaled(scenario, 2.0), 8.0
    if kind == "mirrored":
        return _mapped(scenario, np.diag([1.0, -1.0, 1.0])), 1.0
    if any("y" in (block.held or ()) for block in scenario.blocks):
        return _mapped(scenario, np.diag([1.0, -1.0, 1.0])), 1.0  # restraints do not rotate with the scene
    angle = float(rng.uniform(0.3, 1.2))
    c, s = math.cos(angle), math.sin(angle)
    return _mapped(scenario, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])), 1.0


def _corners(block: Block | Part) -> np.ndarray:
    if block.vertices is not None:
        return np.array(block.vertices, float)
    half = 0.5 * np.array(block.box)
    return np.array(block.position) + np.array([np.array(s) * half for s in product((-1, 1), repeat=3)])


def _mapped(scenario: Scenario, matrix: np.ndarray, factor: float = 1.0) -> Scenario:
    """The scene with positions and directions multiplied by an orthogonal matrix, lengths by a factor, forces by its
    cube."""

    def along(v):
        return tuple(float(x) for x in matrix @ np.array(v, float))

    def place(v):
        return tuple(factor * x for x in along(v))

    def block(one: Block) -> Block:
        if one.parts is not None:
            parts = tuple(Part(vertices=tuple(place(v) for v in _corners(part))) for part in one.parts)
            return Block(one.name, one.material, parts=parts, fixed=one.fixed, held=one.held)
        corners = tuple(place(v) for v in _corners(one))
        return Block(one.name, one.material, vertices=corners, fixed=one.fixed, held=one.held)

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
    """The same structure at another size: stresses scale with the factor, forces with its cube, load factors stay."""
    return _mapped(scenario, np.eye(3), factor)


# Judging a scene.
