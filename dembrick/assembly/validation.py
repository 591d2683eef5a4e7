"""Checks of an assembly: overlaps, missing supports, overrides that match no joint, joints too soft for their load.

Each check raises ScenarioError or returns warnings; messages name the blocks and quantify the error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import partial
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from dembrick.assembly.broad_phase import Bodies, close_pairs, overlap_depths, separating_translation
from dembrick.assembly.contact_points import DISCRETISATION, PointTable, largest_edge_shortfall
from dembrick.assembly.joints import TOLERANCE, JointTable, find_joints, united
from dembrick.assembly.laws import Laws
from dembrick.errors import DivergedError, OverlapError, ScenarioError
from dembrick.geometry import polygons
from dembrick.geometry.shapes import Shape
from dembrick.scenario.cad_models import NEAR
from dembrick.scenario.checks import show
from dembrick.scenario.controls import BaseMotionControl, Control
from dembrick.scenario.model import Scenario, Solver
from dembrick.scenario.regimes import (
    ASK_FOR_REST,
    DEAD_LOAD,
    DRIVEN_PATH,
    LIMIT_LOAD,
    NOTHING,
    PATH_FOLLOWING,
    REAL_TIME,
)
from dembrick.scenario.stages import acting_in, controls_of, driven_entries
from dembrick.scenario.units import unit_slips

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


SOFT_WARNING = 1e-3  # elastic closure or shear displacement of a joint under its dead load, over its short side
SOFT_LIMIT = 1e-2
ROUNDED = 1e-5  # of the greatest velocity: a smaller jump comes from rounding of the phase
_MONOTONE = (LIMIT_LOAD, PATH_FOLLOWING, DEAD_LOAD)  # regimes in which loads only increase
_NAMED = 5  # blocks that a warning names
_FAR = 0.1  # of the smaller block's diameter: search distance for a block that was probably meant to touch


def refuse(scenario: Scenario, message: str) -> NoReturn:
    """Raise ScenarioError with the path of the scenario before the message."""
    raise ScenarioError(f"{scenario.path}: {message}" if scenario.path else message)


def check_overlap(scenario: Scenario, bodies: Bodies, pairs) -> None:
    """Refuse blocks, or convex parts of one block, that overlap."""
    allowed = TOLERANCE * bodies.table.diameter[pairs].min(axis=1)
    depths = overlap_depths(bodies, pairs, allowed)
    over = np.flatnonzero(depths > allowed)
    if not len(over):
        return
    worst = over[np.argmax(depths[over])]
    blocks = bodies.owner[pairs[worst]]
    first, second = (show(scenario.all_blocks[i].name) for i in blocks)
    if blocks[0] == blocks[1]:
        one, two = pairs[worst] - np.searchsorted(bodies.owner, blocks[0])
        refuse(
            scenario,
            f"parts[{one}] and parts[{two}] of block {first} overlap by {depths[worst]:.6g} m; "
            "their common volume would count twice: let them touch",
        )
    more = {1: "", 2: " (1 more pair overlaps less)"}.get(len(over), f" ({len(over) - 1} more pairs overlap less)")
    overlap = f"blocks {first} and {second} overlap by {depths[worst]:.6g} m{more}"
    of_file = f"{scenario.path}: " if scenario.path else ""
    those = tuple(sorted({int(i) for i in bodies.owner[pairs[over]].flat}))
    if all(scenario.all_blocks[i].fixed for i in blocks):
        remedy = "make one fixed block of both, or one of them smaller"
        raise OverlapError(f"{of_file}{overlap}; they are supports: {remedy}{_of_models(scenario)}", those)
    way = separating_translation(bodies, pairs[worst])
    if scenario.all_blocks[blocks[1]].fixed and not scenario.all_blocks[blocks[0]].fixed:
        first, second, way = second, first, -way
    other = f", or {first} as far the other way" if not any(scenario.all_blocks[i].fixed for i in blocks) else ""
    message = f"{overlap}; they touch if {second} moves by {_told(way)}{other}{_of_models(scenario)}"
    raise OverlapError(f"{of_file}{message}", those)


def _told(way: np.ndarray) -> str:
    """A translation in words: ``0.2 m along +z``, or its components if it is not along an axis."""
    length = float(np.linalg.norm(way))
    axis = int(np.argmax(np.abs(way)))
    if abs(way[axis]) > (1.0 - 1e-9) * length:
        return f"{length:.6g} m along {'+' if way[axis] > 0 else '-'}{'xyz'[axis]}"
    parts = ", ".join(f"{0.0 if abs(part) < 1e-9 * length else part:.6g}" for part in way)
    return f"[{parts}] m"


def check_pieces(scenario: Scenario, joints: JointTable, bodies: Bodies) -> None:
    """Refuse corrected joints between moving blocks that touch with several parts in one plane.

    The points of a corrected joint are moved inwards until the whole joint has the torsion strength of the continuum.
    With moving blocks each pair of parts is a joint of its own, and its points would move towards its own centre.
    """
    several = np.bincount(bodies.owner, minlength=len(scenario.all_blocks)) > 1
    if not (several.any() and any(law.formulation.startswith("corrected") for law in joints.law)):
        return
    for joint in united(joints, several, TOLERANCE):
        if joint.pieces and joint.law.formulation.startswith("corrected"):
            first, second = (show(scenario.all_blocks[i].name) for i in (joint.block_a, joint.block_b))
            refuse(
                scenario,
                f"formulation = {show(joint.law.formulation)} handles the joint between {first} and {second}, of "
                f"{len(joint.pieces)} pieces in one plane, only in the geometry of the start: where blocks move each "
                'piece is a separate joint; use "concave", "convex" or "distributed" there',
            )


def check_overrides(scenario: Scenario, laws: Laws, joints, fixed: np.ndarray) -> None:
    """Refuse an entry of [[joints]] between blocks that have no joint."""
    pairs = set(zip(joints.block_a.tolist(), joints.block_b.tolist(), strict=True)) if scenario.joints else ()
    for number, entry in enumerate(scenario.joints):
        if any(laws.covers(number, a, b) for a, b in pairs):
            continue
        first, second = laws.ends[number]
        both_fixed = all(fixed[i] for i in first | second)
        reason = "both are fixed" if both_fixed else "they do not touch face to face"
        kind = "groups" if any(name in scenario.groups for name in entry.between) else "blocks"
        refuse(
            scenario,
            f"[[joints]] between {show(entry.between)}: there is no joint between these {kind}, as {reason}; "
            "remove the entry or move the blocks together",
        )


def check_gaps(scenario: Scenario, bodies: Bodies, positions, fixed: np.ndarray, joints: JointTable) -> tuple[str, ...]:
    """Remark on blocks whose faces nearly touch without a joint; for CAD models the reader makes such remarks."""
    blocks, written = scenario.all_blocks, len(scenario.blocks)
    names = [block.name.partition(".")[0] if i >= written else f".{i}" for i, block in enumerate(blocks)]
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    if len(numbers) < 2:
        return ()
    source = np.array([numbers[name] for name in names])[bodies.owner]
    pairs = close_pairs(bodies, NEAR)
    pairs = pairs[source[pairs[:, 0]] != source[pairs[:, 1]]]
    near = find_joints((), positions, (), fixed, lambda a, b: scenario.joint, NEAR, (bodies, pairs), False)
    touching = set(zip(joints.block_a.tolist(), joints.block_b.tolist(), strict=True))
    missed = [
        joint for joint in near if not touching & {(joint.block_a, joint.block_b), (joint.block_b, joint.block_a)}
    ]
    if not missed:
        return ()
    widest = max(missed, key=lambda joint: abs(joint.gap))
    first, second = (show(blocks[i].name) for i in sorted((widest.block_a, widest.block_b)))
    pairs_of = f"{len(missed)} pair{'s' if len(missed) > 1 else ''} of faces"
    return (
        f"{pairs_of} up to {1e3 * abs(widest.gap):.3g} mm apart share no joint, among them those of {first} and "
        f"{second}; if they are to touch, move the blocks onto one plane",
    )


def refuse_unsupported(scenario: Scenario, shapes, position, orientation, fixed, loose: np.ndarray) -> NoReturn:
    """Raise an error that names the blocks without a chain of joints to a support, and the nearest face they miss."""
    missed = [
        joint
        for joint in find_joints(shapes, position, orientation, fixed, lambda a, b: scenario.joint, _FAR)
        if loose[joint.block_a] != loose[joint.block_b]
    ]
    name, hint = show(scenario.all_blocks[int(np.flatnonzero(loose)[0])].name), "put it on another block, face to face"
    if missed:
        nearest = min(missed, key=lambda joint: abs(joint.gap))
        pair = (nearest.block_a, nearest.block_b)
        here, there = pair if loose[pair[0]] else pair[::-1]
        name = show(scenario.all_blocks[here].name)
        hint = f"the nearest face is that of {show(scenario.all_blocks[there].name)}, {abs(nearest.gap):.6g} m away"
        if abs(nearest.gap) <= TOLERANCE * min(shapes[here].diameter, shapes[there].diameter):
            hint = f"it touches {show(scenario.all_blocks[there].name)}, but their faces are not parallel"
    others = f" (nor from {int(loose.sum()) - 1} more)" if loose.sum() > 1 else ""
    loosely = f"block {name} rests on nothing: no chain of joints leads from it to a fixed block{others}; {hint}"
    refuse(scenario, loosely + _of_models(scenario))


def _of_models(scenario: Scenario) -> str:
    """Remarks from reading CAD models, for a message on blocks that do not touch as they should."""
    return "".join(f"; {remark}" for remark in scenario.remarks)


def check_rim(scenario: Scenario, joints: JointTable, points: PointTable) -> tuple[str, ...]:
    """Warn where rocking blocks would topple early because no contact point reaches the edge of their joint."""
    warnings = []
    for formulation, remedy in (("distributed", ", or more joint.points"), ("corrected", "")):
        gap, j = largest_edge_shortfall(joints, points, formulation=formulation)
        if gap > DISCRETISATION:
            first, second = (show(scenario.all_blocks[i].name) for i in (joints.block_a[j], joints.block_b[j]))
            warnings.append(
                f"the outermost points of the {formulation} joint between {first} and {second} lie "
                f"{100.0 * gap:.2g} % of its half width inside the edge: rocking blocks topple too early by as much. "
                f"Use concave or convex joints{remedy}"
            )
    return tuple(warnings)


def check_strengths(scenario: Scenario, joints: JointTable) -> tuple[str, ...]:
    """Refuse strengths that a formulation cannot represent, and warn about implications of the law."""
    warnings = []
    laws = [law for law in {id(law): law for law in joints.law}.values() if not law.dry]
    for law in laws:
        if law.formulation == "convex" and law.pressure != "full":
            refuse(
                scenario,
                f"joint.pressure = {show(law.pressure)} assumes the pressure of a dry joint: with cohesion or any "
                'other strength besides friction use pressure = "full", or formulation = "distributed"',
            )
        crushes = law.compressive_strength is not None
        if law.formulation == "convex" and crushes and scenario.control.regime not in _MONOTONE:
            refuse(
                scenario,
                "joint.compressive_strength of convex joints is an envelope without memory, valid if loads only "
                f"grow, but under control.kind = {show(scenario.control.kind)} they can fall: use formulation = "
                '"distributed", whose points remember how far they were crushed',
            )
    if any(law.bonded and law.cohesion > 0.0 and law.residual_cohesion is None for law in laws):
        warnings.append(
            "bonds are brittle: their cohesion is gone after the first slip or opening, as joint.residual_cohesion "
            "is left out; write residual_cohesion = cohesion for a ductile joint"
        )
    corners = [law for law in laws if law.formulation.startswith(("concave", "corrected"))]
    if any(law.compressive_strength is not None for law in corners):
        warnings.append(
            "points at the corners miss the crushing of a toe: they crush only if N is above half of "
            'compressive_strength times the area; use formulation = "distributed" or "convex"'
        )
    return tuple(warnings)


def check_control(scenario: Scenario) -> tuple[str, ...]:
    """Warn about settings without effect under the control, and about supports whose velocity starts with a jump."""
    control = scenario.control
    if said := _carries_nothing(scenario):
        return said
    idle = tuple(f"{what} has no effect {why}" for what, why in _idle(scenario))
    return idle + (_check_base_motion(control) if isinstance(control, BaseMotionControl) else ())


def check_stages(scenario: Scenario) -> tuple[str, ...]:
    """Warn about settings without effect in any stage, or in one before the last."""
    idle = ((n, *one) for n, control in enumerate(scenario.stages, 1) for one in _idle_keys(control))
    return _carries_nothing(scenario) + tuple(f"{what} of stage {n} has no effect {why}" for n, what, why in idle)


def _carries_nothing(scenario: Scenario) -> tuple[str, ...]:
    """Remark on actuators, and driven pressures, that are active only in runs under the dead loads alone."""
    controls = controls_of(scenario)
    idle = [
        entry
        for entry in driven_entries(scenario)
        if all(control.regime in ASK_FOR_REST for control in acting_in(entry, controls))
    ]
    if not idle:
        return ()
    driven = ["[[actuators]]"] if any(entry in scenario.actuators for entry in idle) else []
    driven += ["[[pressures]] with actuator = true"] if any(entry in scenario.pressures for entry in idle) else []
    kind = show(acting_in(idle[0], controls)[0].kind)
    return (
        f"{' and '.join(driven)} have no effect in a run of kind {kind}, which applies dead loads only: give forces "
        "as [[loads]], pressures without actuator = true",
    )


def _idle(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Settings other than the default that have no effect in this run, and why."""
    control, stages = scenario.control, scenario.among or (scenario.control,)
    yield from ((f"control.{what}", why) for what, why in _idle_keys(control))
    searches = all(one.regime in (PATH_FOLLOWING, DEAD_LOAD) for one in stages)
    if searches and scenario.solver.step_factor != Solver().step_factor:
        yield f"solver.step_factor = {scenario.solver.step_factor:g}", "in a search, which takes no time steps"
    thrown = [show(block.name) for block in scenario.blocks if any((*block.velocity, *block.angular_velocity))]
    if thrown and (control.drives != NOTHING or control.regime is not REAL_TIME):
        yield (
            f"the velocity of {', '.join(thrown[:_NAMED])}{' and others' if len(thrown) > _NAMED else ''}",
            f"under control.kind = {show(control.kind)}, which begins at rest; a run of kind dynamic begins with it",
        )


def _idle_keys(control: Control) -> Iterator[tuple[str, str]]:
    """Keys of a control, other than the default, that have no effect, and why."""
    defaults = {one.name: one.default for one in fields(control)}  # type: ignore[arg-type]

    def given(key: str, why: str) -> Iterator[tuple[str, str]]:
        value = getattr(control, key, None)
        if key in defaults and value != defaults[key]:
            yield f"{key} = {str(value).lower() if isinstance(value, bool) else f'{value:g}'}", why

    if control.regime is PATH_FOLLOWING:
        no_time = "with quasi_static = true: the limit is searched through equilibria, without time"
        yield from given("rate", no_time)
        yield from given("damping", no_time)
    if control.regime is DRIVEN_PATH:
        yield from given("rate", "with large_displacements = true: equilibria in the deformed geometry have no rate")
    if control.regime is REAL_TIME:
        yield from given("tolerance", "in real time, which searches for no limit: --refine gives an error bar")
        yield from given("large_displacements", "in real time, where the geometry is always the deformed one")


def _check_base_motion(control: BaseMotionControl) -> tuple[str, ...]:
    """Warn about a pulse outside of the run, and about a velocity that does not start from zero."""
    warnings = []
    amplitude = next((one.amplitude for one in (control.pulse, control.sine) if one is not None), 1.0)
    if control.scale * amplitude == 0.0:
        warnings.append("the amplitude of the motion times control.scale is zero: nothing shakes")
    if control.pulse is not None and control.pulse.start >= control.duration:
        warnings.append(
            f"the pulse begins at {control.pulse.start:g} s and the run ends at {control.duration:g} s: nothing "
            "shakes; start it earlier, or lengthen control.duration"
        )
    if control.sine is not None and control.quantity != "acceleration":
        sine = control.sine
        velocity = control.quantity == "velocity"
        first = (
            control.scale
            * sine.amplitude
            * (math.sin(sine.phase) if velocity else 2.0 * math.pi * sine.frequency * math.cos(sine.phase))
        )
        fastest = abs(control.scale * sine.amplitude) * (1.0 if velocity else 2.0 * math.pi * sine.frequency)
        if abs(first) > ROUNDED * fastest:
            rest = "0" if velocity else f"{0.5 * math.pi:.6g}"
            warnings.append(
                f"the supports jump from rest to {first:.4g} m/s at time zero, as the sine of {control.quantity} "
                f"begins; with sine.phase = {rest} they would start from rest"
            )
    return tuple(warnings)


def check_stiffness(scenario: Scenario, shapes: tuple[Shape, ...], joints, joint_force: np.ndarray) -> tuple[str, ...]:
    """Refuse joints whose elastic closure or shear displacement under dead load exceeds 1% of their short side.

    If a number of the scenario or a size of its ``shapes`` suggests a wrong unit, the message names that as the cause.
    The formulations presume stiff joints (undeformed geometry); a tenth of the limit gives a warning.
    """
    if not len(joints):
        return ()
    laws, area, side = joints.law, joints.area, np.empty(len(joints))
    for numbers, corners in joints.by_corners():
        side[numbers] = polygons.width(corners)
    for number, pieces in joints.pieces.items():
        side[number] = max(polygons.width(piece) for piece in pieces)
    normal = np.maximum((joint_force * joints.axes[:, 2]).sum(axis=1), 0.0)
    strength = normal * [law.friction for law in laws]
    closing = normal / (area * [law.normal_stiffness for law in laws] * side)
    sliding = strength / (area * [law.shear_stiffness for law in laws] * side)
    worst = int(np.argmax(np.maximum(closing, sliding)))
    softness = max(closing[worst], sliding[worst])
    if not softness > SOFT_WARNING:
        return ()
    first, second = (show(scenario.all_blocks[i].name) for i in (joints.block_a[worst], joints.block_b[worst]))
    numbers = (
        f"the joint between {first} and {second} is soft for its load: N = {normal[worst]:.6g} N closes it by "
        f"N/(kn A) = {closing[worst]:.3g} of its short side ({side[worst]:.6g} m), and V_0 = {strength[worst]:.6g} N "
        f"shears it by V_0/(ks A) = {sliding[worst]:.3g} of it"
    )
    keys = [
        key
        for key, value in (("normal_stiffness", closing[worst]), ("shear_stiffness", sliding[worst]))
        if value > SOFT_WARNING
    ]
    if softness > SOFT_LIMIT:
        remedy = "; ".join(unit_slips(scenario, shapes)) or f"raise {' and '.join(keys)}"
        refuse(scenario, f"{numbers}; at most {SOFT_LIMIT:g} is accepted: {remedy}")
    count = int((np.maximum(closing, sliding) > SOFT_WARNING).sum())
    others = {1: "", 2: " (1 more joint is above it too)"}.get(count, f" ({count - 1} more joints are above it too)")
    effect = f"above {SOFT_WARNING:g} the deformed geometry affects the result"
    return (f"{numbers}; {effect}{others}: raise {' and '.join(keys)}",)


OF_BLOCKS = ("position", "rotation", "mass", "inertia", "velocity", "angular_velocity", "dead_force", "dead_torque")
OF_JOINTS = ("origin", "axes", "area", "arm_a", "arm_b")


def check_finite(assembly: Assembly) -> None:
    """Raise a DivergedError that names the block, joint or actuator with a number that is not finite. Comparisons with
    NaN are false, so that a solver might take such a state for equilibrium."""
    for name in OF_BLOCKS:
        _check(name, getattr(assembly, name), lambda i: f"block {assembly.names[i]!r}")
    joints = assembly.joints
    for name in OF_JOINTS:
        _check(name, getattr(joints, name), lambda i: f"joint {i + 1}")
    for law in {id(law): law for law in joints.law}.values():
        numbers = [law.friction, law.normal_stiffness, law.shear_stiffness, law.cohesion, law.tensile_strength]
        _check("law", np.array(numbers, float), partial(_of_law, law.formulation))
    actuators = assembly.actuators
    for name, values in (("arm", actuators.at.arm), ("direction", actuators.direction), ("weight", actuators.weight)):
        _check(name, values, lambda i: f"actuator {actuators.names[i]!r}")


def _check(what: str, values: np.ndarray, whose: Callable[[int], str]) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        i = int(np.argwhere(bad)[0][0])
        raise DivergedError(f"{what} of {whose(i)} is not a finite number, so the run cannot start")


def _of_law(formulation: str, _: int) -> str:
    return f"a {formulation} joint"
