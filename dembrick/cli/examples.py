"""``dembrick examples [NAME] [--copy DIR]``: the scenarios that ship with the package."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument("name", nargs="?", help="print the file of this example")
    parser.add_argument("--copy", metavar="DIR", help="copy the example, or all examples, into a folder")


def run(options, console) -> int:
    import os
    import shutil
    from pathlib import Path

    from dembrick.errors import OutputError, ScenarioError, WriteError
    from dembrick.scenario import shipped
    from dembrick.scenario.checks import nearest

    found = shipped.examples()
    if options.name is not None:
        path = shipped.find(options.name)
        if path is None:
            raise ScenarioError(f"there is no example {options.name!r}; {nearest(options.name, found)}")
        found = {options.name: path}
    if options.copy is None:
        told = {name: shipped.kind_and_title(path) for name, path in found.items()}
        if options.name is not None:
            console.result({"name": options.name, "text": path.read_text(encoding="utf-8")}, path.read_text("utf-8"))
        else:
            lines = [f"{name:24} {one['kind']:17} {one['title']}" for name, one in told.items()]
            lines.append("\n'dembrick examples NAME' prints one, 'dembrick run NAME' runs it, --copy DIR copies them")
            console.result({"examples": told}, "\n".join(lines))
        return 0
    folder = Path(options.copy)
    copied = []
    for name, path in found.items():
        target = folder / Path(f"{name}.toml").relative_to(".") if options.name is None else folder / path.name
        if os.path.exists(target):
            raise OutputError(f"{target}: this file already exists; choose another folder")
        copied.append((path, target))
    for path in shipped.folder().glob("*.csv") if options.name is None else ():
        copied.append((path, folder / path.name))
    schema = folder / shipped.SCHEMA
    if not os.path.exists(schema):
        copied.append((shipped.folder() / shipped.SCHEMA, schema))
    try:
        for path, target in copied:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
    except OSError as error:
        raise WriteError(f"{folder}: the examples cannot be copied here ({error.strerror})") from error
    console.result({"copied": [str(target) for _, target in copied]}, f"{len(copied)} files copied into {folder}")
    return 0
