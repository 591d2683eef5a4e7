"""Scenarios that ship with the package: their files, names, titles and descriptions.

The name of a shipped scenario is its file name without ``.toml``: ``dembrick run set4a`` finds it wherever the package
is installed. Studies, templates, verification and validation cases are in folders of their own.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

TEMPLATES = "templates"
STUDIES = "studies"
VERIFICATION = "verification"
VALIDATION = "validation"


SCHEMA = "scenario.schema.json"  # beside the scenarios, which refer to it in their first line


def folder() -> Path:
    """Folder of the scenario files: in the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "scenarios"
    return inside if inside.is_dir() else package.parent / "scenarios"


def examples() -> dict[str, Path]:
    """Name -> file of every shipped scenario and study that can be run as it is, sorted by name."""
    found = {path.stem: path for path in folder().glob("*.toml")}
    found |= {f"{STUDIES}/{path.stem}": path for path in (folder() / STUDIES).glob("*.toml")}
    return dict(sorted(found.items()))


def templates() -> dict[str, Path]:
    """Name -> file of every template, sorted by name."""
    return {path.stem: path for path in sorted((folder() / TEMPLATES).glob("*.toml"))}


def find(name: str) -> Path | None:
    """File of a shipped scenario or study by its name, with or without ``.toml``; None if there is none."""
    stem = name.removesuffix(".toml")
    for place in ("", STUDIES, VERIFICATION, VALIDATION):
        path = folder() / place / f"{stem}.toml"
        if stem and "/" not in stem and "\\" not in stem and os.path.isfile(path):
            return path
    return examples().get(stem)


def table(path: str | os.PathLike) -> Path:
    """Path of a CSV file; if there is no such file, of the shipped one of that name."""
    inside = folder() / os.path.basename(path)
    named = os.path.basename(path) == os.fspath(path) and not os.path.exists(path)
    return inside if named and inside.suffix == ".csv" and inside.is_file() else Path(path)


def kind_and_title(path: Path) -> dict[str, str]:
    """The ``kind`` of run of a shipped scenario or study, and its ``title``."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    control = data.get("control", {"kind": "study"})
    kind = f"{control['kind']}, search" if control.get("quasi_static") else control["kind"]
    return {"kind": kind, "title": data["title"]}


def description(path: Path) -> str:
    """Comments at the head of a scenario file as one text; empty if there are none."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#:"):  # a directive for editors
            continue
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return " ".join(lines)
