"""Accuracy of limit analysis: known load factors, random assemblies against the search, walls of Ferris and Tin-Loi.

    python tools/limit_study.py [--table] [--drawn 100] [--walls] [--speed]

Without an option: all but ``--speed``. ``--table`` prints load factors, bounds and references of six assemblies with
concave and convex joints, and of bonded and crushing ones. ``--drawn`` compares random walls, arches, corners and
stacks, pushed in any direction, with the search: counts of agreement if nothing slides, and of searches above the
bound. ``--walls`` prints associative bound, heuristic without dilatancy, search and range of other paths of the six
walls. ``--speed`` times walls of 30 x 30 and 70 x 70 blocks.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from dembrick.assembly import build  # noqa: E402
from dembrick.errors import DembrickError  # noqa: E402
from dembrick.runs.limit import limit  # noqa: E402
from dembrick.runs.limit_cases import searched  # noqa: E402
from dembrick.runs.simulate import simulate  # noqa: E402
from dembrick.scenario import toml  # noqa: E402
from dembrick.scenario.generators import Arch, Stack, Wall  # noqa: E402
from dembrick.scenario.generators.walls import Return  # noqa: E402
from dembrick.simulation.limit_analysis import analysis  # noqa: E402
from helpers import pushed_assemblies as scenes  # noqa: E402
from helpers.stone_scenes import law  # noqa: E402

X, Y, DIAGONAL = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0)
SLIDES = 1e-3  # of the greatest motion of a joint: slip of a loaded corner from which it counts as sliding
TABLE = [  # assembly, scene, its arguments after the law, friction, references: concave, convex
    ("wall 3 x 12 along", scenes.wall, (3, 12, X), 0.64, 0.6058426, 0.6058426),
    ("wall 3 x 12 along", scenes.wall, (3, 12, X), 0.4, 0.4, 0.4),
    ("wall 6 x 16 along", scenes.wall, (6, 16, X), 0.64, 0.6248173, None),
    ("wall 6 x 16 along", scenes.wall, (6, 16, X), 0.5, 0.5, None),
    ("wall 4 x 6 along", scenes.wall, (4, 6, X), 0.64, 0.64, 0.64),
    ("wall 4 x 6 across", scenes.wall, (4, 6, Y), 0.64, 0.3333333, 0.3333333),
    ("wall 4 x 6 askew", scenes.wall, (4, 6, DIAGONAL), 0.64, 0.4714045, 0.4714045),
    ("wall 4 x 6 askew", scenes.wall, (4, 6, DIAGONAL), 0.3, 0.3, 0.3),
    ("wall 3 x 12 across", scenes.wall, (3, 12, Y), 0.64, 0.1666667, 0.1666667),
    ("wall 3 x 12 askew", scenes.wall, (3, 12, DIAGONAL), 0.64, 0.2357023, 0.2357023),
    ("actuator, middle block [N]", scenes.wall_with_actuator, (), 0.64, 202.1894, 203.4692),
    ("actuator, middle block [N]", scenes.wall_with_actuator, (), 0.3, 66.49477, 66.49477),
    ("actuator, last block [N]", scenes.wall_with_actuator, ("wall.6.4", 0.9), 0.64, 144.8306, 144.8306),
    ("corner +x", scenes.corner, ((1.0, 0.0, 0.0),), 0.64, 0.6328315, 0.601284),
    ("corner -x", scenes.corner, ((-1.0, 0.0, 0.0),), 0.64, 0.5762355, 0.558705),
    ("corner +y", scenes.corner, ((0.0, 1.0, 0.0),), 0.64, 0.5638456, 0.539676),
    ("corner -y", scenes.corner, ((0.0, -1.0, 0.0),), 0.64, 0.3948452, 0.3948452),
    ("arch along", scenes.arch, (X,), 0.7, 0.2856458, None),
    ("arch across", scenes.arch, (Y,), 0.7, 0.2614675, 0.2614675),
    ("arch askew", scenes.arch, (DIAGONAL,), 0.7, 0.3697708, 0.356016),
    ("arch along", scenes.arch, (X,), 0.4, 0.0992021, None),
    ("arch across", scenes.arch, (Y,), 0.4, 0.2415385, None),
    ("arch askew", scenes.arch, (DIAGONAL,), 0.4, 0.1325254, None),
]
BONDED = [  # a stack of five courses; strengths in Pa; references: concave, convex
    ("stack across, c 10, f_t 5 kPa", Y, 0.64, {"cohesion": 1e4, "tensile_strength": 5e3}, 0.6038736, 0.6038736),
    ("stack along, c 10, f_t 5 kPa", X, 0.64, {"cohesion": 1e4, "tensile_strength": 5e3}, 0.9058104, 0.9058104),
    ("stack along, c 1, f_t 3 kPa", X, 0.3, {"cohesion": 1e3, "tensile_strength": 3e3}, 0.4019368, 0.4019368),
    ("stack across, f_c 15 kPa", Y, 0.64, {"compressive_strength": 15e3}, 0.2116208, 0.1384),
]


def shown(name: str, friction: float, kind: str, found, reference: float | None) -> None:
    """Print one row of the table."""
    error = "" if reference is None else f"{found.load_factor / reference - 1.0:+.1e}"
    known = "-" if reference is None else f"{reference:.7g}"
    print(
        f"{name:32} {friction:5g} {kind:8} {found.load_factor:12.8g} {found.lower:13.9g} {found.upper:13.9g} "
        f"{found.gap:8.1e} {known:>10} {error:>9} {found.mechanism.kind:8} {found.rounds:3} {found.seconds:6.2f}"
    )


def table() -> None:
    """Print load factors and proven bounds beside the references."""
    print(
        f"{'assembly':32} {'mu':>5} {'joints':8} {'load factor':>12} {'lower':>13} {'upper':>13} {'gap':>8} "
        f"{'reference':>10} {'error':>9} {'':8} {'n':>3} {'s':>6}"
    )
    for name, scene, arguments, friction, *references in TABLE:
        for kind, reference in zip(("concave", "convex"), references, strict=True):
            assembly = build.assemble(scene(law(kind, friction), *arguments))
            shown(name, friction, kind, analysis.limit_load(assembly), reference)
    for name, direction, friction, strengths, *references in BONDED:
        for kind, reference in zip(("concave", "convex"), references, strict=True):
            joint = law(kind, friction, **strengths)
            shown(name, friction, kind, analysis.limit_load(build.assemble(scenes.stack(joint, direction))), reference)


def drawn_scene(rng: np.random.Generator):
    """A random wall, arch, corner or stack, pushed in any direction in space, mostly sideways."""
    angle, rise = rng.uniform(0.0, 2.0 * np.pi), rng.choice([0.0, 0.0, 0.2, -0.2])
    direction = (float(np.cos(angle)), float(np.sin(angle)), float(rise))
    joint = law("concave", float(rng.choice([0.3, 0.64, 1.0])))
    block = tuple(rng.uniform((0.2, 0.1, 0.08), (0.5, 0.3, 0.25)).tolist())
    kind = rng.choice(["wall", "arch", "corner", "stack"])
    heading = float(rng.choice([0.0, 30.0]))
    courses, blocks = int(rng.integers(2, 6)), int(rng.integers(2, 5))
    if kind == "wall":
        parts = {"walls": (Wall("wall", "stone", block, courses, blocks, base=0.2, heading=heading),)}
    elif kind == "corner":
        block = (2.0 * block[1], block[1], block[2])
        turn = (Return("right", "front", 3),)
        parts = {"walls": (Wall("wall", "stone", block, courses, 3, base=0.2, heading=heading, returns=turn),)}
    elif kind == "arch":
        joint = replace(joint, friction=max(joint.friction, 0.64))
        arch = Arch("arch", "stone", 1.5, float(rng.uniform(0.25, 0.4)), 0.5, int(rng.integers(5, 14)), heading=heading)
        parts = {"arches": (arch,)}
    else:
        parts = {"stacks": (Stack("stack", "stone", courses, block, base=0.2),)}
    return str(kind), scenes.pushed(joint, direction, **parts)


def drawn(count: int, seed: int = 0) -> None:
    """Compare searches with bounds, and count outcomes."""
    rng, rocked, agree, above, slid, failed = np.random.default_rng(seed), 0, 0, [], [], []
    for number in range(count):
        kind, scenario = drawn_scene(rng)
        try:
            bound = limit(scenario)
            found = simulate(scenario, record=False)
        except DembrickError as error:
            failed.append(f"{number} ({kind}): {error}")
            continue
        tolerance, factor = scenario.control.tolerance, found.collapse["load_factor"]
        if not bound.load_factor > 0.0 or bound.limit.unlimited:
            failed.append(f"{number} ({kind}): bound {bound.load_factor}, search {factor}")
            continue
        ratio = factor / bound.load_factor
        if ratio > bound.upper / bound.load_factor + tolerance:
            above.append(f"{number} ({kind}): {ratio - 1.0:+.2e}")
        relative = bound.limit.mechanism.relative
        reach = float(np.abs(bound.assembly.joints.corner).max())
        pressed = bound.limit.resultants[:, 0] > 1e-6 * bound.limit.resultants[:, 0].max()
        motion = np.linalg.norm(relative[:, :3], axis=1) + reach * np.linalg.norm(relative[:, 3:], axis=1)
        sliding = _corner_slip(bound, pressed) > SLIDES * float(motion.max())
        if sliding:
            slid.append(ratio)
        else:
            rocked += 1
            agree += abs(ratio - 1.0) <= tolerance
    print(
        f"{count} drawn assemblies: {rocked} only rock, and in {agree} of them search and bound agree to the tolerance"
    )
    if slid:
        print(f"{len(slid)} slide: the search reaches {min(slid):.3f} to {max(slid):.4f} of the bound")
    print(f"{len(above)} searches are above the bound by more than the tolerance", *above, sep="\n  ")
    print(f"{len(failed)} without an answer of one of the two", *failed, sep="\n  ")


def _corner_slip(found, pressed: np.ndarray) -> float:
    """The greatest slip velocity of a loaded corner."""
    joints, moved, most = found.assembly.joints, found.limit.mechanism.relative, 0.0
    table, force = found.assembly.contact_points, found.limit.forces.normal
    owner = np.repeat(np.arange(len(joints)), np.diff(table.start))
    x, y = table.shear_arm.T
    u = moved[owner, 0] - moved[owner, 5] * y
    v = moved[owner, 1] + moved[owner, 5] * x
    carries = pressed[owner] & (force > 1e-6 * force.max())
    if carries.any():
        most = float(np.hypot(u, v)[carries].max())
    return most


def walls() -> None:
    """Print bound, heuristic, path and its range for the walls of Ferris and Tin-Loi."""
    heads = f"{'associative':>12} {'published':>10} {'heuristic':>10} {'path':>9} {'its range':>20}"
    print(f"{'wall':6} {heads}  how the heuristic ended")
    published = (0.64286, 0.58000, 0.40369, 0.33195, 0.23964, 0.34782)
    for number, known in enumerate(published, 1):
        folder = ROOT / "scenarios" / ("verification" if number > 3 else "")
        scenario = searched(toml.load(str(folder / f"ferris_tinloi_{number}.toml")))
        found = limit(scenario, heuristic=True)
        opinion = found.second_opinion
        path = simulate(scenario, record=False, refine=True).collapse
        low, high = path["path_range"]
        print(
            f"{number:<6} {found.load_factor:12.7f} {known:10.5f} {opinion.load_factor:10.5f} "
            f"{path['load_factor']:9.5f} {f'{low:.5f} to {high:.5f}':>20}  {opinion.ended}",
            flush=True,
        )


def speed() -> None:
    """Print processor and wall-clock seconds of large walls."""
    for size in (30, 70):
        for direction in (X, Y, DIAGONAL):
            began, used = time.perf_counter(), time.process_time()
            found = analysis.limit_load(build.assemble(scenes.wall(law(), size, size, direction)))
            print(
                f"{size} x {size} along {direction}: {found.load_factor:.7f}, gap {found.gap:.1e}, "
                f"{time.perf_counter() - began:.1f} s, processor {time.process_time() - used:.1f} s",
                flush=True,
            )


def main() -> None:
    """Print the requested tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--drawn", type=int, metavar="COUNT")
    parser.add_argument("--walls", action="store_true")
    parser.add_argument("--speed", action="store_true")
    options = parser.parse_args()
    everything = not (options.table or options.drawn or options.walls or options.speed)
    if options.table or everything:
        table()
    if options.walls or everything:
        walls()
    if options.drawn or everything:
        drawn(options.drawn or 100)
    if options.speed:
        speed()


if __name__ == "__main__":
    main()
