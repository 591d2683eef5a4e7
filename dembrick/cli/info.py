"""``dembrick info FILE.h5``: what a history holds."""

from __future__ import annotations

import math


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--scenario", action="store_true", help="print the scenario text instead")
    parser.add_argument("--profile", action="store_true", help="where the time of the run went (times its loop again)")


def run(options, console) -> int:
    """Summarise the file without reading its data."""
    from dembrick import history

    with history.read(options.history) as file:
        return _report(file, options, console)


def _report(file, options, console) -> int:
    if options.scenario:
        console.result({"scenario": file.scenario_text}, file.scenario_text)
        return 0
    results = file.results or {}
    wall = results.get("wall") or {}
    if options.profile:
        return _profile(file, results, console)
    data = {
        "history": options.history,
        "title": file.title,
        "status": file.status,
        "blocks": list(file.block_names),
        "joints": file.n_joint,
        "rows": file.n_row,
        "frames": file.n_frames,
        "new_contacts": file.new_contacts_before(file.n_frames) if file.has_new_contacts else None,
        "settings": file.settings,
        "versions": file.versions,
        "results": results,
    }
    point = results.get("yield_point") or {}
    lines = [
        file.title,
        f"status        {file.status}",
        f"blocks        {len(data['blocks'])}, joints {data['joints']}",
        f"rows          {data['rows']}, frames {data['frames']}",
    ]
    if file.has_new_contacts:
        lines.append(f"new contacts  {data['new_contacts']} in all frames")
    if point:
        half = math.inf if point["V_upper"] is None else 0.5 * (point["V_upper"] - point["V_lower"])
        lines.append(f"V             {point['V']:.6g} N +- {half:.2g} N ({point['bracket']}), {point['mechanism']}")
    audit = results.get("energy")
    if isinstance(audit, dict) and _is_number(audit.get("relative_residual")):
        lines.append(f"energy        balance off by {audit['relative_residual']:.1e} of what was put in")
    lines += [f"{part:14}{seconds:.6f} s" for part, seconds in wall.items() if _is_number(seconds)]
    lines.append("versions      " + ", ".join(f"{name} {version}" for name, version in file.versions.items()))
    console.result(data, "\n".join(lines))
    return 0


def _profile(file, results: dict, console) -> int:
    """Where the time went, the loop by phases as `dembrick.profile` tells them apart."""
    from dembrick.errors import HistoryError, ScenarioError
    from dembrick.runs.profile import loop_phases
    from dembrick.scenario import toml as scenarios

    wall, steps = results.get("wall"), results.get("steps")
    wall = dict(wall) if isinstance(wall, dict) else {}
    measured = wall.pop("phases", {})
    timed = isinstance(measured, dict) and isinstance(steps, int)
    if not timed or not all(_is_number(t) for t in (wall.get("loop"), *wall.values(), *measured.values())):
        raise HistoryError(f"{file.path}: status {file.status}; only a run that was finished has a profile")
    why = "measured in the run"
    if not measured or "steps" in measured:
        why = "the loop is split by timing short loops here, of this scenario half-way or after a second's run"
        why = f"{why}; what lies between its compiled steps was measured in the run" if measured else why
    try:
        phases = loop_phases(scenarios.loads(file.scenario_text, file.path), results)
    except ScenarioError as error:
        phases, why = measured or None, str(error)
    lines = []
    for part, seconds in wall.items():
        lines.append(f"{part.replace('_', '-'):16}{seconds:12.6f} s")
        if part == "loop" and phases:
            lines += [
                f"  {name.replace('_', ' '):14}{t:12.6f} s {100 * t / max(seconds, 1e-300):5.1f} %"
                for name, t in phases.items()
            ]
    lines += [why]
    console.result({"history": file.path, "wall": wall, "loop": phases}, "\n".join(lines))
    return 0


def _is_number(value) -> bool:
    return isinstance(value, int | float)
