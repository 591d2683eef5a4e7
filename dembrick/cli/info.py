"""``dembrick info FILE.h5``: what a history holds."""

from __future__ import annotations

import math


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--scenario", action="store_true", help="print the scenario text instead")
    parser.add_argument("--profile", action="store_true", help="only where the time of the run went")


def run(options, console) -> int:
    """Summarise the file without reading its data."""
    from dembrick import history

    file = history.read(options.history)
    if options.scenario:
        console.result({"scenario": file.scenario_text}, file.scenario_text)
        return 0
    results = file.results or {}
    wall = results.get("wall") or {}
    if options.profile:
        console.result({"wall": wall}, "\n".join(f"{part:10}{seconds:12.6f} s" for part, seconds in wall.items()))
        return 0
    data = {
        "history": options.history,
        "title": file.title,
        "status": file.status,
        "blocks": list(file.block_names),
        "joints": file.n_joint,
        "rows": file.n_row,
        "frames": file.n_frames,
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
    if point:
        half = math.inf if point["V_upper"] is None else 0.5 * (point["V_upper"] - point["V_lower"])
        lines.append(f"V             {point['V']:.6g} N +- {half:.2g} N ({point['bracket']}), {point['mechanism']}")
    lines += [f"{part:14}{seconds:.6f} s" for part, seconds in wall.items()]
    lines.append("versions      " + ", ".join(f"{name} {version}" for name, version in file.versions.items()))
    console.result(data, "\n".join(lines))
    return 0
