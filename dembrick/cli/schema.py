"""``dembrick schema``: the JSON schema of a scenario, with which editors complete and check a TOML file."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("--out", metavar="FILE.json", help="write it to a file (default: print it)")


def run(options, console) -> int:
    """Print or write the schema."""
    import json
    import os
    from pathlib import Path

    from dembrick.errors import OutputError, WriteError
    from dembrick.scenario.keys import json_schema

    text = json.dumps(json_schema(), indent=2)
    if options.out is None:
        print(text)
        return 0
    path = Path(options.out)
    if path.suffix != ".json":
        raise OutputError(f"{path}: the schema is JSON; give a name that ends in .json")
    if os.path.exists(path):
        raise OutputError(f"{path}: this file exists; choose another name")
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise WriteError(f"{path}: the schema cannot be written ({error.strerror})") from error
    console.result({"file": str(path)}, f"{path} written; name it in the first line of a scenario: #:schema {path}")
    return 0
