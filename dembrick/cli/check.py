"""``dembrick check SCENARIO.toml``: validate and describe, without running."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import asdict
from typing import TYPE_CHECKING

from dembrick.cli.paths import add_force, add_set

if TYPE_CHECKING:
    from dembrick.assembly.actuators import ActuatorTable
    from dembrick.simulation.dynamics.time_histories import Record
    from dembrick.simulation.session import Plan

LOADS = {"actuators": "actuator", "pressures": "pressure", "body_forces": "body force"}  # key of --json -> kind


def add_arguments(parser) -> None:
    parser.add_argument("scenario", help="the TOML file")
    parser.add_argument("--picture", "--to", metavar="FILE.png", help="draw the blocks as they are before the run")
    add_force(parser)
    add_set(parser)


def run(options, console) -> int:
    from dembrick.assembly.build import assemble
    from dembrick.errors import OutputError, OverlapError
    from dembrick.runs.drivers import driver_of
    from dembrick.runs.reading import load
    from dembrick.runs.stages import warnings_before
    from dembrick.scenario.units import unit_slips
    from dembrick.simulation.dynamics.time_histories import records_of

    scenario = load(options.scenario, options.set)
    try:
        assembly = assemble(scenario)
    except OverlapError as error:
        if options.picture:
            try:
                _draw_overlap(scenario, error.blocks, options, console)
            except OutputError as refused:
                console.remark(f"no picture: {refused}")
        raise
    before = [warning for warning in warnings_before(scenario) if warning.partition(": ")[2] not in assembly.warnings]
    records = records_of(scenario)
    strong = [record.warning for record in records if record.warning]
    warnings = [*unit_slips(scenario, assembly.shapes), *strong, *before, *assembly.warnings]
    for warning in warnings:
        console.remark(f"warning: {warning}")
    plan = driver_of(scenario.control).plan(scenario, assembly)
    joints = [
        {
            "between": [assembly.names[joint.block_a], assembly.names[joint.block_b]],
            "formulation": joint.law.formulation,
            "area": float(joint.area),
            "contact_points": 0 if points is None else len(points.area),
        }
        for joint, points in zip(assembly.joints, assembly.contact_points, strict=True)
    ]
    data = {
        "scenario": scenario.path or "",
        "title": scenario.title,
        "control": scenario.control.kind,
        "stages": [stage.kind for stage in scenario.stages],
        "blocks": len(assembly.names),
        "free_blocks": int((~assembly.fixed).sum()),
        "joints": joints,
        "contact_points": sum(joint["contact_points"] for joint in joints),
        **{key: _named_so(assembly.actuators, kind) for key, kind in LOADS.items()},
        "records": [asdict(record) for record in records],
        "time_step": plan.time_step,
        "critical_time_step": plan.critical_time_step,
        "expected_steps": plan.steps,
        "expected_memory": plan.memory,
        "expected_seconds": _here(plan.seconds),
        "expected_seconds_snapping": _here(plan.seconds_snapping),
        "expected_seconds_falling": _here(plan.seconds_falling),
        "warnings": warnings,
    }
    console.result(data, _text(data, plan, records))  # first, so that a picture that cannot be written hides nothing
    if options.picture:
        _draw(scenario, assembly, options, console)
    return 0


def _draw(scenario, assembly, options, console) -> None:
    from dembrick.runs import mechanism_history
    from dembrick.views import render

    with (
        mechanism_history.before_a_run(scenario, assembly) as found,
        _picture_of(scenario, found.scenario_text, options),
    ):
        console.meter.busy("drawing")
        render.picture(found, options.picture, color="none")


def _draw_overlap(scenario, blocks, options, console) -> None:
    from dembrick.scenario import toml
    from dembrick.views.render.overlap import overlap_picture

    with _picture_of(scenario, toml.text_of(scenario), options):
        console.meter.busy("drawing")
        overlap_picture(scenario, blocks, options.picture)
    console.remark(f"{options.picture}: the blocks that overlap are red")


def _picture_of(scenario, text: str, options) -> AbstractContextManager:
    """Context in which pictures are of this scenario with this ``text``, and replace those before an edit."""
    from dembrick import history
    from dembrick.scenario.files import inputs_of

    read = [options.scenario, *inputs_of(scenario)]
    return history.product("picture", [text], read, options.force, draft_of=scenario.path or options.scenario)


def _here(seconds: float | None) -> float | None:
    """Expected time (s) of a command on this machine, if its loops take ``seconds`` on the reference machine."""
    from dembrick.simulation.expected_cost import START_SECONDS, slowness

    return None if seconds is None else slowness() * (START_SECONDS + seconds)


def _text(data: dict, plan: Plan, records: list[Record]) -> str:
    from dembrick.scenario.checks import listed
    from dembrick.simulation.expected_cost import duration

    lines = [
        data["title"],
        f"control       {', then '.join([*data['stages'], data['control']])}",
        f"blocks        {data['blocks']} ({data['free_blocks']} free)",
        f"joints        {len(data['joints'])}, contact points {data['contact_points']}",
    ]
    lines += [
        f"  {' - '.join(joint['between'])}: {joint['formulation']}, {joint['area']:.6g} m2, "
        f"{joint['contact_points'] or 'no'} contact points"
        for joint in data["joints"][:20]
    ]
    if len(data["joints"]) > 20:
        lines.append(f"  ... and {len(data['joints']) - 20} more")
    lines += [f"{kind + 's':13} {listed(data[key], 8)}" for key, kind in LOADS.items() if data[key]]
    lines += [f"record        {record}" for record in records]
    lines.append(f"time step     {data['time_step']:.3g} s (critical {data['critical_time_step']:.3g} s)")
    bound = "at most " if plan.at_most else "" if plan.exact else "about "
    seconds = data["expected_seconds"]
    took = "" if seconds is None else f", {duration(seconds)} on one core once compiled"
    if data["expected_seconds_falling"] is not None and data["free_blocks"] > 1:
        took += f" ({duration(data['expected_seconds_falling'])} if all of it collapses)"
    if data["expected_seconds_snapping"] is not None:
        took += f" (up to {duration(data['expected_seconds_snapping'])} if blocks slide and snap)"
    memory = max(1, round(plan.memory / 1e6))
    doubt = f" (usually within a factor of {plan.within:g})" if plan.within > 2.0 else ""
    lines.append(f"expected      {bound}{plan.steps} steps{doubt}{took}, {memory} MB besides the program's own")
    return "\n".join(lines)


def _named_so(actuators: ActuatorTable, kind: str) -> list[str]:
    """Names of the parts of the load that are of a kind."""
    return [name for name, own in zip(actuators.names, actuators.kind, strict=True) if own == kind]
