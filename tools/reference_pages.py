"""Write the generated pages: scenario keys, commands, layout of a history, verification cases, gallery.

    python tools/reference_pages.py [FOLDER]

Everything comes from the program itself: keys from its dataclasses, options from its argument parsers, datasets from
histories that it writes, cases and examples from the shipped files. Only headings are written by hand.
"""

from __future__ import annotations

import argparse
import inspect
import json
import tempfile
from collections.abc import Callable
from dataclasses import MISSING
from functools import partial
from pathlib import Path

import dembrick
from dembrick.cli import VERBS, full_parser
from dembrick.runs.verification import cases
from dembrick.scenario import keys, shipped

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "gallery"
FIRST = ("wall_door", "arch_spread", "set4a")  # a wall, an arch and a joint
GALLERY = {  # subject: first parts of the names of its scenarios
    "Walls": ("wall_", "house", "ferris_tinloi_"),
    "Arches, domes and piers": ("arch", "oppenheim", "dome", "pier_"),
    "Dams and slopes": ("dam", "slope_"),
    "Joints in the laboratory": ("set", "shear", "table1_"),
    "Blocks and columns in motion": ("rocking_", "newmark_", "spinning_"),
    "Studies": ("studies/",),
}
COLUMNS = 3  # of pictures on the page


def write(folder: Path) -> None:
    """Write all pages into ``folder``; unchanged pages are not written, so that a rebuild is quick."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in makers().items():
        path, text = folder / name, make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def makers() -> dict[str, Callable[[], str]]:
    """The function that makes each page, by its path from ``docs/reference``."""
    return {
        "scenario.md": scenario_page,
        "commands.md": commands_page,
        "history.md": history_page,
        "python_names.md": python_names,
        "cases.md": cases_page,
        "../gallery.md": partial(gallery_page, PICTURES),
    }


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table; a bar in a cell is escaped."""
    lines = [" | ".join(header), " | ".join("---" for _ in header)]
    lines += [" | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) for row in rows]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def scenario_page() -> str:
    """Every table of a scenario file with its keys."""
    parts = [
        "# Scenario keys\n\nA scenario is a TOML file of these tables, or the same as Python dataclasses. SI units. A "
        "key that is not known is an error that names the nearest known one. `dembrick schema` prints a JSON schema "
        "with which editors complete and check a file.\n"
    ]
    for heading, kind in keys.tables().items():
        title = f"`{heading}`" if heading else "The top of the file"
        parts.append(f"## {title}\n\n{plain(kind) if heading else first_paragraph(kind)}\n")
        rows = []
        for field in keys.written_fields(kind):
            key, default = keys.keys_of(kind)[field.name], keys.default_of(field)
            rows.append([f"`{field.name}`", key.unit, default_text(default), key.allowed, key.meaning])
        parts.append(table(["key", "unit", "default", "allowed", "meaning"], rows))
    return "\n".join(parts)


def plain(kind: type) -> str:
    """The whole docstring of a class as Markdown, paragraph by paragraph; lists and examples as they are."""
    text = inspect.cleandoc(kind.__doc__ or "")
    return text.replace("``", "`").replace(":class:", "")


def first_paragraph(kind: type) -> str:
    """The first paragraph of a class's docstring as plain Markdown."""
    text = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
    return text.replace("``", "`").replace(":class:", "")


def default_text(default) -> str:
    """A default as TOML would write it."""
    if default is MISSING:
        return "required"
    if default is None or default == ():
        return "none"
    if isinstance(default, bool):
        return "`true`" if default else "`false`"
    if isinstance(default, tuple):
        return f"`[{', '.join(default_text(part).strip('`') for part in default)}]`"
    if isinstance(default, str):
        return f'`"{default}"`'
    return f"`{default:g}`" if isinstance(default, int | float) else "see its table"


def commands_page() -> str:
    """Every command with its options."""
    parser = full_parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    parts = [
        "# Commands\n\n`dembrick` and `python -m dembrick` are the same. Every command that reports takes `--json`: "
        "one object on standard output, remarks and progress on standard error.\n\n"
        + table(
            ["exit code", "meaning"],
            [
                ["0", "ok"],
                ["1", "no answer: not converged, diverged, energy audit, a write that failed; the history is kept"],
                ["2", "invalid input or usage"],
                ["3", "answered, but theory and simulation disagree, or a verification case fails"],
                ["4", "an optional dependency is missing"],
                ["130, 143", "interrupted; what was simulated is on disk"],
            ],
        )
    ]
    for verb, text in VERBS.items():
        sub = commands.choices[verb]
        parts.append(f"## dembrick {verb}\n\n{text[0].upper()}{text[1:]}.\n")
        rows = []
        for action in sub._actions:
            if action.dest == "help":
                continue
            name = ", ".join(action.option_strings) or action.metavar or action.dest
            metavar = f" {action.metavar}" if action.option_strings and isinstance(action.metavar, str) else ""
            rows.append([f"`{name}{metavar}`", (action.help or "").replace("%%", "%")])
        parts.append(table(["argument", "meaning"], rows))
    return "\n".join(parts)


RECORDED = {
    "a test at a constant rate, with every channel": (
        "set4a_curve",
        ['output.channels=["joints","energy","frames","velocity","contacts"]', "output.rows=50", "output.frames=10"],
    ),
    "a run in real time, with every channel": (
        "newmark_pulse",
        ['output.channels=["joints","energy","frames","velocity","contacts"]', "output.rows=50", "output.frames=10"],
    ),
}


def history_page() -> str:
    """The datasets of histories, read from histories written for this purpose."""
    import h5py

    parts = [
        "# Layout of a history\n\nA history is one HDF5 file. Every dataset has `units` and `description`. T is the "
        "number of rows, F of frames. A history opened while it is written, or after a kill, reads up to its last "
        "flush; `/written` says how many rows and frames are valid.\n"
    ]
    with tempfile.TemporaryDirectory() as folder:
        for title, (name, changes) in RECORDED.items():
            path = Path(folder) / f"{name}.h5"
            dembrick.simulate(dembrick.load(name, changes), path)
            with h5py.File(path) as file:
                rows: list[list[str]] = []
                file.visititems(lambda place, item, rows=rows: _dataset_row(rows, place, item))
            parts.append(f"## {title[0].upper()}{title[1:]}\n\nWritten by `dembrick run {name}`.\n")
            parts.append(table(["dataset", "shape", "units", "description"], rows))
    return "\n".join(parts)


def _dataset_row(rows: list[list[str]], place: str, item) -> None:
    if hasattr(item, "shape"):
        told = {key: item.attrs.get(key, "") for key in ("units", "description")}
        rows.append([f"`/{place}`", str(item.shape).replace(",)", ")"), str(told["units"]), str(told["description"])])


def cases_page() -> str:
    """The verification cases with their sources and references."""
    rows = [
        [f"`{case.name}`", case.title, f"{case.reference:.7g} {case.unit if case.unit != '1' else ''}", case.source]
        for case in cases.all_cases().values()
    ]
    return (
        f"# Verification cases\n\n{len(rows)} cases ship with the package; `dembrick verify` runs them and says how "
        "far off each answer is and whether its error bar holds the reference.\n\n"
        + table(["case", "what", "reference", "source"], rows)
    )


PYTHON = {  # heading of the Python reference: names at the top level of the package
    "Runs": "simulate restart restart_at steps sweep find_causes limit reaction simulate_domain replay_lab",
    "Results and histories": "Result LoadPathResult StaticsResult MotionResult LimitResult StandingResult "
    "ReactionResult YieldPoint Theory Step Outcome Causes History read_history export",
    "Errors": "DembrickError ScenarioError OverlapError StageFellError HistoryError OutputError WriteError "
    "DivergedError NotConvergedError UndecidedError BracketError EnergyAuditError MissingDependency Interrupted "
    "ClusterError",
    "Studies": "Study",
    "Scenarios": "load loads dumps Scenario Material JointLaw JointOverride Load Pressure Fill Tie TieEnd Actuator "
    "ControlPoint Solver Output Sine Pulse",
    "Joint laws of your own": "joint_law CustomLaw",
    "Blocks and structures": "Block Part Prism Voussoir Mesh Wall Opening Return Stack Arch Dome CadModel",
    "Controls": "YieldControl DisplacementControl StaticsControl TiltControl PushoverControl SettlementControl "
    "SupportPath Turn DynamicControl BaseMotionControl Control",
}
MODULES = {  # module at the top level: its functions
    "plot": "force_displacement control_points energies unbalanced load_path joint_stages layout domains interaction "
    "read_measured read_study study spectra read_spectrum save",
    "render": "picture movie view meshes",
    "theory": "limit_load limit_loads limit_load_at_height overturning_load torsion_strength convex points "
    "linear_pressure interaction_curve approximate_domain gauge response_spectrum",
    "generators": "",
}
HELD = {  # classes returned by functions, which are documented with their members
    "Result": "dembrick.runs.outcomes.result.Result",
    "MotionResult": "dembrick.runs.outcomes.motion_result.MotionResult",
    "StaticsResult": "dembrick.runs.outcomes.statics_result.StaticsResult",
    "History": "dembrick.history.reader.History",
}


def python_names() -> str:
    """Every public name of the package and its modules, as directives for Sphinx, which adds the docstrings."""
    parts = []
    for heading, names in PYTHON.items():
        lines = []
        for name in names.split():
            thing = getattr(dembrick, name)
            kind = "autoclass" if isinstance(thing, type) else "autofunction" if callable(thing) else "autodata"
            lines.append(f".. {kind}:: {HELD.get(name, f'dembrick.{name}')}")
            if name in HELD:
                lines += ["   :members:", "   :inherited-members:", ""]
        parts.append(_block(heading, lines))
    for module, names in MODULES.items():
        if names:
            lines = [f".. autofunction:: dembrick.{module}.{name}" for name in names.split()]
            parts.append(_block(f"`dembrick.{module}`", lines))
    return "\n".join(parts)


def _block(heading: str, lines: list[str]) -> str:
    return f"## {heading}\n\n```{{eval-rst}}\n" + "\n".join(lines) + "\n```\n"


def gallery_page(pictures: Path) -> str:
    """The shipped scenarios, each with its picture, number and time from ``tools/gallery.py``."""
    entries = json.loads((pictures / "gallery.json").read_text(encoding="utf-8"))
    parts = [
        "# Gallery\n\n`dembrick run NAME` runs one of these, `dembrick examples NAME` prints it, `dembrick examples "
        "--copy DIR` copies them all. Pictures, numbers and times are those of `tools/gallery.py`; seconds "
        "are those of one processor, once compiled.\n",
        _grid([(name, entries[name]) for name in FIRST if name in entries]),
    ]
    for subject, names in subjects().items():
        shown = [(name, entries[name]) for name in names if name in entries and name not in FIRST]
        parts.append(f"## {subject}\n\n{_grid(shown)}")
    return "\n".join(parts)


def subjects() -> dict[str, list[str]]:
    """The shipped scenarios of each subject."""
    return {
        subject: [name for name in shipped.examples() if name.startswith(begin)] for subject, begin in GALLERY.items()
    }


def _grid(shown: list[tuple[str, dict]]) -> str:
    """Pictures in rows, each with name, answer and title below."""
    paths, parts = shipped.examples(), []
    for start in range(0, len(shown), COLUMNS):
        row = shown[start : start + COLUMNS]
        pictures, texts = [], []
        for name, entry in row:
            blocks = f"{entry['blocks']} blocks, " if entry["blocks"] else ""
            pictures.append(f"![{name}](gallery/{name.replace('/', '_')}.png){{width=100%}}")
            answer = f"`{name}` **{entry['title']}**: {entry['number']} ({blocks}{entry['seconds']:g} s)."
            texts.append(f"{answer} {shipped.description(paths[name])}".replace("|", "\\|").replace("\n", " "))
        empty = [""] * (COLUMNS - len(row))
        parts.append(table([*pictures, *empty], [[*texts, *empty]]))
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    there = Path(__file__).resolve().parent.parent / "docs" / "reference"
    parser.add_argument("folder", nargs="?", type=Path, default=there)
    write(parser.parse_args().folder)


if __name__ == "__main__":
    main()
