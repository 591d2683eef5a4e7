"""Run every shipped scenario and draw it for the gallery of the documentation: picture, number, time.

    python tools/gallery.py [NAME ...]

Writes ``docs/gallery/NAME.png`` and the entry of NAME in ``docs/gallery/gallery.json``; without names for all
scenarios, which takes some minutes. The documentation is built from these files without any run. Times are processor
seconds of a run after compilation, so they depend little on the load of the machine.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import dembrick
from dembrick import history
from dembrick.scenario import shipped
from dembrick.views import plot, render
from dembrick.views.key_numbers import key_numbers
from dembrick.views.number_lines import KeyNumber

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "gallery"
SIZE = (640, 480)
TWICE = 20.0  # s: shorter runs are repeated after everything is compiled
LONG = {"studies/drum_column_domain"}  # eight minutes: run only if named
LOOKS: dict[str, dict] = {  # display options that suit the structure
    "wall_door": {"view": "front"},
    "ferris_tinloi_1": {"view": "front"},
    "ferris_tinloi_2": {"view": "front"},
    "ferris_tinloi_3": {"view": "front"},
    "arch": {"view": "front", "thrust": True, "color": "utilisation"},
    "arch_filled": {"view": "front", "thrust": True, "color": "utilisation"},
    "arch_tied": {"view": "front", "thrust": True, "color": "utilisation"},
    "arch_tilt": {"view": "front", "thrust": True, "color": "utilisation"},
    "oppenheim": {"view": "front", "thrust": True, "color": "utilisation"},
    "arch_spread": {"view": "front", "magnification": 1.0},
    "arch_shaken": {"view": "front", "magnification": 1.0},
    "pier_settles": {"view": "front"},
    "dam": {"view": "front"},
    "slope_weak_joints": {"view": "front"},
    "wall_collapse": {"magnification": 1.0},
    "rocking_block": {"view": "front"},
    "rocking_push": {"view": "front"},
}


def timed(path: Path, target: Path) -> tuple[object, float]:
    """A run and its processor seconds, without compiling."""
    before = time.process_time()
    result = dembrick.simulate(path, target, progress=False)
    seconds = time.process_time() - before
    if seconds < TWICE:
        before = time.process_time()
        result = dembrick.simulate(path, target, force=True, progress=False)
        seconds = time.process_time() - before
    return result, seconds


def scenario_entry(name: str, path: Path, folder: Path) -> dict:
    """Run a scenario and draw it; returns its gallery entry."""
    result, seconds = timed(path, folder / "run.h5")
    results = result.results
    with history.read(folder / "run.h5") as found:
        render.picture(found, FOLDER / f"{name}.png", size=SIZE, **LOOKS.get(name, {}))
        kind, blocks, unit = dembrick.load(path).control.kind, found.n_block, found.curve.unit
    (folder / "run.h5").unlink()
    return {
        "title": results["title"],
        "kind": kind,
        "blocks": blocks,
        "number": number_of(results, unit),
        "seconds": float(f"{seconds:.2g}"),
    }


def number_of(results: dict, unit: str) -> str:
    """The most important number of the results, with its name."""
    first = next(line for line in key_numbers(results, unit) if _is_answer(line))
    return f"{first.name} {first.value}"


def _is_answer(line: KeyNumber) -> bool:
    """Whether a line of the summary is the most important number for the gallery."""
    return line.name != "drift" and any(letter.isdecimal() for letter in line.value)


def study_entry(name: str, path: Path, folder: Path) -> dict:
    """Run a study and draw its answers; returns its gallery entry with the number of cases."""
    before = time.process_time()
    dembrick.sweep(path, folder / "study", jobs=1)
    seconds = time.process_time() - before
    table = plot.read_study(str(folder / "study" / "table.csv"))
    plot.save(plot.study(table), FOLDER / f"{name.replace('/', '_')}.png")
    return {
        "title": name,
        "kind": "study",
        "blocks": None,
        "number": f"{len(table.rows)} cases",
        "seconds": float(f"{seconds:.2g}"),
    }


def main() -> None:
    """Draw the named scenarios, by default all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="shipped scenarios (default: all)")
    asked = parser.parse_args().names
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / "gallery.json"
    shipped_now = shipped.examples()
    for name in asked or [name for name in shipped_now if name not in LONG]:
        path = shipped_now[name]
        with tempfile.TemporaryDirectory() as folder:
            make = study_entry if name.startswith(f"{shipped.STUDIES}/") else scenario_entry
            entry = make(name, path, Path(folder))
        entries = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        entries[name] = entry
        print(name, entries[name]["number"], f"{entries[name]['seconds']} s", flush=True)
        kept = {key: entries[key] for key in shipped_now if key in entries}
        file.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
