"""The scenarios that ship with the package: where they are, how they are called, and what each says of itself.

A shipped scenario goes by its file name without ``.toml``: ``dembrick run set4a`` finds it wherever the package is
installed. Studies, templates, verification and validation cases lie in folders of their own.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

TEMPLATES = "templates"
STUDIES = "studies"
VERIFICATION = "verification"
VALIDATION = "validation"


SCHEMA = "scenario.schema.json"  # beside the scenarios, which name it in their first line


def folder() -> Path:
    """Where the scenario files are: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "scenarios"
    return inside if inside.is_dir() else package.parent / "scenarios"


def examples() -> dict[str, Path]:
    """Name -> file of every shipped scenario and study that is meant to be run as it is, sorted by name."""
    found = {path.stem: path for path in folder().glob("*.toml")}
    found |= {f"{STUDIES}/{path.stem}": path for path in (folder() / STUDIES).glob("*.toml")}
    return dict(sorted(found.items()))


def templates() -> dict[str, Path]:
    """Name -> file of every template, sorted by name."""
    return {path.stem: path for path in sorted((folder() / TEMPLATES).glob("*.toml"))}


def find(name: str) -> Path | None:
    """The file of a shipped scenario or study by its name, with or without ``.toml``; None if there is no such one."""
    stem = name.removesuffix(".toml")
    for place in ("", STUDIES, VERIFICATION, VALIDATION):
        path = folder() / place / f"{stem}.toml"
        if stem and "/" not in stem and "\\" not in stem and os.path.isfile(path):
            return path
    return examples().get(stem)


def table(path: str | os.PathLike) -> Path:
    """A CSV file, or the shipped one of that name where there is no such file."""
    inside = folder() / os.path.basename(path)
    named = os.path.basename(path) == os.fspath(path) and not os.path.exists(path)
    return inside if named and inside.suffix == ".csv" and inside.is_file() else Path(path)


def kind_and_title(path: Path) -> dict[str, str]:
    """Of a shipped scenario or study which ``kind`` of run it is, and its ``title``, which says what it shows."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    control = data.get("control", {"kind": "study"})
    kind = f"{control['kind']}, search" if control.get("quasi_static") else control["kind"]
    return {"kind": kind, "title": data["title"]}


def description(path: Path) -> str:
    """The remarks at the head of a scenario file as one text; empty if it has none."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#:"):  # for editors
            continue
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return " ".join(lines)
