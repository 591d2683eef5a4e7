"""``dembrick info FILE.h5``: summary of a history."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dembrick.cli.paths import FRAME, frame_of

if TYPE_CHECKING:
    from dembrick.views.number_lines import KeyNumber


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    one = parser.add_argument_group("forces of all joints, printed too").add_mutually_exclusive_group()
    one.add_argument("--frame", type=frame_of, metavar="{peak,last,N}", help=FRAME)
    one.add_argument("--time", type=float, metavar="SECONDS", help="at the row nearest to this time")
    parser.add_argument("--scenario", action="store_true", help="print the scenario text instead")
    parser.add_argument("--profile", action="store_true", help="print where the time of the run went")


def run(options, console) -> int:
    """Summarise the file without reading its data."""
    from dembrick import history

    with history.read(options.history) as file:
        return _report(file, options, console)


def _report(file, options, console) -> int:
    from dembrick.scenario.joint_laws import described
    from dembrick.views.key_numbers import key_numbers
    from dembrick.views.number_lines import KeyNumber, aligned
    from dembrick.views.summary import number

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
    numbers = [
        KeyNumber("status", file.status),
        KeyNumber("blocks", f"{len(data['blocks'])}, joints {data['joints']}"),
        KeyNumber("rows", f"{data['rows']}, frames {data['frames']}"),
    ]
    if isinstance(law := file.settings.get("custom_law"), dict):
        numbers.append(KeyNumber("joint law", described(law)))
    if file.has_new_contacts:
        numbers.append(KeyNumber("new contacts", f"{data['new_contacts']} in all frames"))
    numbers += key_numbers(results, file.curve.unit)
    if (took := number(wall.get("total"))) is not None:
        numbers.append(KeyNumber("wall time", f"{took:.3g} s", "--profile lists its parts"))
    numbers.append(KeyNumber("versions", ", ".join(f"{name} {version}" for name, version in file.versions.items())))
    lines = [file.title, *aligned([*numbers, *_run_again(file, options.history)])]
    if options.time is not None or options.frame is not None:
        from dembrick.cli.joints import state

        data["at"], told = state(file, options.frame, options.time, whole=True)
        lines += ["", told]
    console.result(data, "\n".join(lines))
    return 0


def _run_again(file, path: str) -> list[KeyNumber]:
    """Commands that repeat the run of a history, or continue it; or why no command can."""
    from dembrick.views.number_lines import KeyNumber

    if isinstance(file.settings.get("custom_law"), dict):
        return [
            KeyNumber("run again", "only in Python, because its joint law is a function that the file does not hold")
        ]
    killed = {"interrupted": "", "running": " (if it was killed)"}.get(file.status)  # others have ended
    goes_on = [] if killed is None else [KeyNumber("go on", f"dembrick restart {path}{killed}")]
    with_files = f", with {len(file.inputs)} file{'s' * (len(file.inputs) > 1)} that it holds" if file.inputs else ""
    return [
        *goes_on,
        KeyNumber("scenario", f"dembrick info {path} --scenario"),
        KeyNumber("run again", f"dembrick run {path} --set KEY.PATH=VALUE --out NEW.h5{with_files}"),
    ]


def _profile(file, results: dict, console) -> int:
    """Print the wall time of the parts of the run, as measured in it, and of the phases of its loop if it has any."""
    from dembrick.errors import HistoryError
    from dembrick.views.summary import number

    wall = results.get("wall")
    wall = dict(wall) if isinstance(wall, dict) else {}
    phases = wall.pop("phases", {})
    seconds = [wall.get("loop"), *wall.values(), *(phases.values() if isinstance(phases, dict) else [None])]
    if None in map(number, seconds):
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
