"""``dembrick info FILE.h5``: what a history holds."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--scenario", action="store_true", help="print the scenario text instead")
    parser.add_argument("--profile", action="store_true", help="where the time of the run went")


def run(options, console) -> int:
    """Summarise the file without reading its data."""
    from dembrick import history

    with history.read(options.history) as file:
        return _report(file, options, console)


def _report(file, options, console) -> int:
    from dembrick.views.summary import limit_text, mechanism, part, plain, start_text

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
    if point and point["V"] is None:
        lines.append(f"answer        {results.get('answer')}")
    elif point:
        name, unit = ("V", "N") if file.curve.unit == "N" else ("load factor", "")
        lines.append(f"{name:13} {plain(str(limit_text(point, part(results, 'path'), unit)))}, by {mechanism(results)}")
        start = start_text(part(results, "path"), unit)
        lines += [] if start is None else [f"start         {start}"]
    lines += _moved(results)
    audit = results.get("energy")
    if isinstance(audit, dict) and _is_number(audit.get("relative_residual")):
        lines.append(f"energy        balance off by {audit['relative_residual']:.1e} of what was put in")
    lines += [f"{part:14}{seconds:.6f} s" for part, seconds in wall.items() if _is_number(seconds)]
    lines.append("versions      " + ", ".join(f"{name} {version}" for name, version in file.versions.items()))
    console.result(data, "\n".join(lines))
    return 0


def _moved(results: dict) -> list[str]:
    """Angle and load factor of a collapse in real time, or how far the blocks came."""
    if results.get("yield_point"):
        return []
    collapse = results.get("collapse")
    collapse = collapse if isinstance(collapse, dict) else {}
    way = f", by {collapse.get('mechanism')}"
    told = [("angle", collapse.get("angle"), " deg"), ("load factor", collapse.get("load_factor"), way)]
    told += [
        ("settlement", collapse.get("settlement"), f" m{way}"),
        ("displacement", results.get("displacement"), " m"),
    ]
    return [f"{name:14}{value:.5g}{unit}" for name, value, unit in told if _is_number(value)]


def _profile(file, results: dict, console) -> int:
    """Where the time of the run went, as it was measured in the run; the loop by phases, if it has any."""
    from dembrick.errors import HistoryError

    wall = results.get("wall")
    wall = dict(wall) if isinstance(wall, dict) else {}
    phases = wall.pop("phases", {})
    seconds = [wall.get("loop"), *wall.values(), *(phases.values() if isinstance(phases, dict) else [None])]
    if not all(_is_number(t) for t in seconds):
        raise HistoryError(f"{file.path}: status {file.status}; only a run that was finished has a profile")
    lines = []
    for part, took in wall.items():
        lines.append(f"{part.replace('_', '-'):16}{took:12.6f} s")
        if part == "loop":
            lines += [
                f"  {name.replace('_', ' '):14}{t:12.6f} s {100 * t / max(took, 1e-300):5.1f} %"
                for name, t in phases.items()
            ]
    console.result({"history": file.path, "wall": wall, "loop": phases or None}, "\n".join(lines))
    return 0


def _is_number(value) -> bool:
    return isinstance(value, int | float)
