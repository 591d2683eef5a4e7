"""Studies written for a test, and the tables that they produce."""

import csv


def write_study(folder, body, base):
    """Write the file of a study with that ``body`` beside the scenario ``base``."""
    (folder / "base.toml").write_text(base, encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(f'base = "base.toml"\n{body}', encoding="utf-8")
    return path


def read_csv(path):
    """The rows of a table as mappings from column names."""
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
