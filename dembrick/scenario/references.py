"""Checks of names in a scenario: names are unique, and whatever is referred to exists."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block
from dembrick.scenario.checks import nearest, show
from dembrick.scenario.generators import GENERATORS

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario


class Fault(NamedTuple):
    """One error: its message, the heading of the table that it concerns, and the number of the table among those."""

    message: str
    table: str = ""
    number: int = 1


class ScenarioErrors(ScenarioError):
    """All errors among the tables of a scenario, one per line."""

    def __init__(self, faults: list[Fault]):
        super().__init__("\n".join(fault.message for fault in faults))
        self.faults = faults


def check_references(scenario: Scenario) -> None:
    """Raise ScenarioErrors for duplicate names, and for references to things that do not exist or are unsuitable."""
    faults = [*_names(scenario), *_blocks(scenario)]
    numbers = {block.name: i for i, block in enumerate(scenario.all_blocks)}
    faults += [*_loads(scenario, numbers), *_support_paths(scenario, numbers), *_others(scenario, numbers)]
    if faults:
        raise ScenarioErrors(faults)


def unknown(label: str, name: str, blocks, groups) -> str | None:
    """Message about a ``name`` that is neither a block nor a group; None if it is one."""
    if name in blocks or name in groups:
        return None
    kind = "block or a group" if groups else "block"
    return f"{label} = {show(name)} is not the name of a {kind}; {nearest(name, [*groups, *blocks])}"


def _names(scenario: Scenario) -> Iterator[Fault]:
    """Names shared by two blocks, actuators or control points, or by a block and a group."""
    named: dict[str, tuple] = {
        "block": scenario.all_blocks,
        "actuator": scenario.actuators,
        "control point": scenario.control_points,
    }
    for kind, members in named.items():
        for name, times in Counter(member.name for member in members).items():
            if times > 1:
                table = f"{kind}s".replace(" ", "_")
                last = max((i for i, one in enumerate(getattr(scenario, table), 1) if one.name == name), default=0)
                message = f"two {kind}s are named {show(name)}; every {kind} needs its own name"
                yield Fault(message, table if last else "", last or 1)
    blocks = {block.name for block in scenario.all_blocks}
    for name in scenario.groups:
        if name in blocks:
            yield Fault(f"{show(name)} names a block and a group; give one of them another name")


def _blocks(scenario: Scenario) -> Iterator[Fault]:
    """Fixed or held blocks with a velocity, and undefined materials, each with the first block that uses it."""
    for i, block in enumerate(scenario.all_blocks, 1):
        if block.fixed and any((*block.velocity, *block.angular_velocity)):
            message = (
                f"block {show(block.name)} is fixed and has a velocity; remove one of the two (supports that move: "
                'control.kind = "base-motion")'
            )
            yield Fault(message, *_of_block(scenario, i))
        elif block.held and any(value for value, held in zip(_rates(block), block.guides, strict=True) if held):
            message = (
                f"block {show(block.name)} has a velocity in a direction in which it is held; remove one of the two"
            )
            yield Fault(message, *_of_block(scenario, i))
    first = {block.material: (i, block) for i, block in reversed([*enumerate(scenario.all_blocks, 1)])}
    for name, (i, block) in first.items():
        if name not in scenario.materials:
            label, known = f"material of block {show(block.name)}", nearest(name, scenario.materials)
            yield Fault(f"{label} = {show(name)} is not the name of a material; {known}", *_of_block(scenario, i))


def _rates(block: Block) -> tuple[float, ...]:
    """Velocity and angular velocity, in the order of `blocks.DIRECTIONS`."""
    return *block.velocity, *block.angular_velocity


def _of_block(scenario: Scenario, number: int) -> tuple[str, int]:
    """Table and number of a block, or of the generator that makes it; the top of the file if there is neither."""
    if number <= len(scenario.blocks):
        return "blocks", number
    name = scenario.all_blocks[number - 1].name
    for key in GENERATORS:
        for i, laid in enumerate(getattr(scenario, key), 1):
            if name.startswith(f"{laid.name}."):
                return key, i
    return "", 1


def _loads(scenario: Scenario, numbers: dict[str, int]) -> Iterator[Fault]:
    """Loads on something that does not exist or is fixed, and varying loads in runs without time."""
    for i, load in enumerate(scenario.loads, 1):
        if message := unknown(f"block of load number {i}", load.block, numbers, scenario.groups):
            yield Fault(message, "loads", i)
            continue
        if load.point is not None and load.block in scenario.groups:
            message = f"load number {i} has a point and acts on group {show(load.block)}; name one of its blocks"
            yield Fault(message, "loads", i)
        if all(scenario.all_blocks[k].fixed for k in scenario.groups.get(load.block) or (numbers[load.block],)):
            message = (
                f"load number {i} acts on {show(load.block)}, which is fixed, so it has no effect; remove the load, "
                "or name a block that can move"
            )
            yield Fault(message, "loads", i)
        if load.varies and not scenario.control.loads_vary:
            message = (
                f"load number {i} on {show(load.block)} varies with time, which a test of kind "
                f"{show(scenario.control.kind)} does not allow; remove its {'history' if load.history else 'sine'}"
            )
            yield Fault(message, "loads", i)


def _support_paths(scenario: Scenario, numbers: dict[str, int]) -> Iterator[Fault]:
    """Supports that the control moves but that do not exist, are not fixed, or are moved in two ways."""
    moved: dict[int, tuple] = {}
    for path in scenario.control.support_paths:
        for name in path.supports:
            if message := unknown("supports of the control", name, numbers, scenario.groups):
                yield Fault(message, "control")
                continue
            for i in scenario.groups.get(name) or (numbers[name],):
                block, way = scenario.all_blocks[i], (path.displacement, path.rotation)
                if not block.fixed:
                    message = (
                        f"the control moves {show(block.name)}, which is not a support: give it fixed = true, or name "
                        "it in supports at the top of the scenario"
                    )
                    yield Fault(message, "control")
                    break
                if moved.setdefault(i, way) != way:
                    message = (
                        f"support {show(block.name)} has two motions at once; name it in only one of the motions of "
                        "the control"
                    )
                    yield Fault(message, "control")


def _others(scenario: Scenario, numbers: dict[str, int]) -> Iterator[Fault]:
    """Pressures, fills, ties, actuators, control points and joint overrides that name blocks which do not exist."""
    groups = scenario.groups
    for i, pressure in enumerate(scenario.pressures, 1):
        if message := unknown(f"block of pressure number {i}", pressure.block, numbers, groups):
            yield Fault(message, "pressures", i)
    for i, fill in enumerate(scenario.fills, 1):
        if message := unknown(f"block of fill number {i}", fill.block, numbers, groups):
            yield Fault(message, "fills", i)
    for i, tie in enumerate(scenario.ties, 1):
        for end in tie.between:
            if message := unknown(f"block of tie number {i}", end.block, numbers, {}):
                yield Fault(message, "ties", i)
    of_one_block: dict[str, tuple] = {"actuator": scenario.actuators, "control point": scenario.control_points}
    for kind, members in of_one_block.items():
        for i, member in enumerate(members, 1):
            label, table = f"block of {kind} {show(member.name)}", f"{kind}s".replace(" ", "_")
            if member.block in groups:
                yield Fault(f"{label} = {show(member.block)} is a group; name one block of it", table, i)
            elif message := unknown(label, member.block, numbers, {}):
                yield Fault(message, table, i)
    for i, override in enumerate(scenario.joints, 1):
        for name in override.between:
            if message := unknown("between", name, numbers, groups):
                yield Fault(message, "joints", i)
        if override.between[0] == override.between[1] and override.between[0] in numbers:
            message = f"between = {show(override.between)} is out of range: a block has no joint with itself"
            yield Fault(message, "joints", i)
        later = (other for other in scenario.joints[i:] if other.stages == override.stages)
        if any(sorted(other.between) == sorted(override.between) for other in later):
            message = (
                f"between = {show(override.between)}: a later entry names the same joints, so this one has no effect"
            )
            yield Fault(message, "joints", i)
