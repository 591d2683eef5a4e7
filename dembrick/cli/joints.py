"""``dembrick joints FILE.h5``: forces of every joint and every support at one moment."""

from __future__ import annotations

from dembrick.cli.paths import FRAME, add_force, frame_of, require_ending

MOST = 40  # lines of the printed table
ROUNDING = 1e-8  # of the largest value of a column: smaller values are printed as zero
SHORT = 1e-3  # m, least arm of the forces in the scale for rounding moments and eccentricities to zero
TITLES = ("N [N]", "V_1 [N]", "V_2 [N]", "M_T [N m]", "e_1 [mm]", "e_2 [mm]", "slip [mm]", "open", "utilisation")
COLUMNS = {
    "N": 1.0,
    "V_1": 1.0,
    "V_2": 1.0,
    "M_T": 1.0,
    "e_1": 1e3,
    "e_2": 1e3,
    "slip": 1e3,
    "open_share": 1.0,
    "utilisation": 1.0,
}  # factors to the units of TITLES
OF_CONTACTS = {
    "N": ("N [N]", 1.0),
    "V": ("V [N]", 1.0),
    "M_T": ("M_T [N m]", 1.0),
    "area": ("area [m2]", 1.0),
    "slip": ("slip [mm]", 1e3),
    "x": ("x [m]", 1.0),
    "y": ("y [m]", 1.0),
    "z": ("z [m]", 1.0),
}


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    one = parser.add_mutually_exclusive_group()
    one.add_argument("--frame", type=frame_of, metavar="{peak,last,N}", help=FRAME)
    one.add_argument("--time", type=float, metavar="SECONDS", help="show the row nearest to this time")
    parser.add_argument("--csv", metavar="FILE.csv", help="write the table to this file")
    add_force(parser)
    parser.add_argument("--all", action="store_true", help=f"print all joints, not only the {MOST} most utilised")


def run(options, console) -> int:
    from dembrick import history
    from dembrick.runs.lab import write_csv

    with history.read(options.history) as found:
        data, text = state(found, options.frame, options.time, whole=options.all)
        given, sources = found.scenario_text, found.sources
    if options.csv:
        require_ending(options.csv, [".csv"], "a table")
        with history.product("joints", [given], sources, options.force):
            write_csv(data["joints"], options.csv)
    console.result({"history": options.history, **data}, text)
    return 0


def state(file, frame: int | str | None, time: float | None, whole: bool = False) -> tuple[dict, str]:
    """Forces of the joints and supports at a moment, as JSON and as text; ``whole``: the text has all joints."""
    from dembrick.scenario.checks import listed
    from dembrick.views.motion.moments import words, words_of_row
    from dembrick.views.motion.table import REACTION, cut_joints, joint_table, moment, new_contact_table, reaction_table

    rows, reactions = joint_table(file, frame, time), reaction_table(file, frame, time)
    met = new_contact_table(file, frame, time)
    at = moment(file, frame, time)
    told = words(file, at.frame) if time is None else words_of_row(file, at.row)
    if time is not None and at.frame_time != at.time:
        what = "openings and new contacts" if met else "openings"
        told.append(f"{what} of the frame at {at.frame_time:.4g}{'' if file.counts_equilibria else ' s'}")
    text = f"{', '.join(told)}\n\n{_text(rows, len(rows) if whole else MOST)}"
    cut = cut_joints(file, at.frame)
    if cut:
        text += f"\n\ncut at an edge: {listed(cut)}; M_T and e about O of the start, in the series about what is left"
    if met is None:
        text += '\n\nforces of new contacts were not recorded; to record them, add "contacts" to output.channels'
    elif met:
        text += "\n\n" + _text_of_contacts(met, len(met) if whole else MOST)
    if reactions:
        text += "\n\n" + _text_of_reactions(reactions, len(reactions) if whole else MOST)
    of_supports = {row["support"]: [row[name] for name in REACTION] for row in reactions}
    shown = {"time": at.time, "frame": at.frame, "frame_time": at.frame_time}
    return shown | {"joints": rows, "new_contacts": met, "reactions": of_supports}, text


def _text(rows: list[dict], most: int) -> str:
    """Table of the joints, the most utilised first; joints whose utilisation is unknown or infinite come before all."""
    rows = sorted(rows, key=lambda row: -1e300 if row["utilisation"] is None else -row["utilisation"])
    width = max([5, *(len(row["joint"]) for row in rows[:most])])
    largest = {name: max((abs(row[name] or 0.0) for row in rows), default=0.0) for name in COLUMNS}
    force, arm = max(largest["N"], largest["V_1"], largest["V_2"]), max(largest["e_1"], largest["e_2"], SHORT)
    largest |= dict.fromkeys(("V_1", "V_2"), force) | dict.fromkeys(("e_1", "e_2"), arm)
    largest["M_T"] = max(largest["M_T"], force * arm)
    lines = [f"{'joint':{width}}" + "".join(f"{title:>12}" for title in TITLES) + "  state"]
    for row in rows[:most]:
        cells = "".join(f"{_cell(row[name], largest[name], factor):>12}" for name, factor in COLUMNS.items())
        lines.append(f"{row['joint']:{width}}{cells}  {row['state']}")
    if len(rows) > most:
        lines.append(f"and {len(rows) - most} less utilised joints: show them with --all or --csv")
    return "\n".join(lines)


def _text_of_contacts(rows: list[dict], most: int) -> str:
    """Table of the forces of new contacts, the largest normal force first."""
    rows = sorted(rows, key=lambda row: -row["N"])
    width = max([11, *(len(row["contact"]) for row in rows[:most])])
    largest = {name: max(abs(row[name]) for row in rows) for name in OF_CONTACTS}
    largest["V"] = max(largest["N"], largest["V"])
    largest["M_T"] = max(largest["M_T"], SHORT * largest["V"])
    largest |= dict.fromkeys("xyz", max(largest["x"], largest["y"], largest["z"], SHORT))
    lines = [f"{'new contact':{width}}" + "".join(f"{title:>12}" for title, _ in OF_CONTACTS.values())]
    for row in rows[:most]:
        cells = (_cell(row[name], largest[name], factor) for name, (_, factor) in OF_CONTACTS.items())
        lines.append(f"{row['contact']:{width}}" + "".join(f"{cell:>12}" for cell in cells))
    if len(rows) > most:
        lines.append(f"and {len(rows) - most} new contacts with smaller forces: show them with --all")
    return "\n".join(lines)


def _text_of_reactions(rows: list[dict], most: int) -> str:
    """Table of the force of every support, and its moment about the centroid at the start."""
    units = dict.fromkeys(("F_x", "F_y", "F_z"), "N") | dict.fromkeys(("M_x", "M_y", "M_z"), "N m")
    width = max([7, *(len(row["support"]) for row in rows[:most])])
    largest = {
        unit: max(abs(row[name]) for row in rows for name in units if units[name] == unit) for unit in ("N", "N m")
    }
    lines = [f"{'support':{width}}" + "".join(f"{f'{name} [{unit}]':>12}" for name, unit in units.items())]
    for row in rows[:most]:
        cells = "".join(f"{_cell(row[name], largest[unit], 1.0):>12}" for name, unit in units.items())
        lines.append(f"{row['support']:{width}}{cells}")
    if len(rows) > most:
        lines.append(f"and {len(rows) - most} more supports: show them with --all")
    return "\n".join(lines)


def _cell(value: float | None, largest: float, factor: float) -> str:
    if value is None:
        return "-"
    return f"{factor * value:.5g}" if abs(value) > ROUNDING * largest else "0"
