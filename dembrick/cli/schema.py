"""``dembrick schema``: the JSON schema of a scenario, with which editors complete and check a TOML file."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument("--out", metavar="FILE.json", help="file to write (default: print the schema)")


def run(options, console) -> int:
    import json
    import os

    from dembrick import history
    from dembrick.cli.paths import require_ending
    from dembrick.cli.streams import print_output
    from dembrick.errors import OutputError
    from dembrick.scenario.keys import json_schema

    path, text = options.out, json.dumps(json_schema(), indent=2)
    if path is None:
        print_output(text)
        return 0
    require_ending(path, (".json",), "the schema")
    if os.path.exists(path):
        raise OutputError(f"{path}: this file already exists; choose another name")
    history.write_whole(path, f"{text}\n", "schema")
    console.result({"file": path}, f"{path} written; let the first line of a scenario be: #:schema {path}")
    return 0
