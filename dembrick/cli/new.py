"""``dembrick new [TEMPLATE] [FILE.toml]``: a complete commented scenario to start from, a template or a shipped one."""

from __future__ import annotations

from dembrick.cli.paths import add_force, require_ending


def add_arguments(parser) -> None:
    parser.add_argument("template", nargs="?", help="template or example to copy (default: list the templates)")
    parser.add_argument("file", nargs="?", help="file to write (default: TEMPLATE.toml)")
    add_force(parser)


def run(options, console) -> int:
    import os
    from pathlib import Path

    from dembrick import history
    from dembrick.errors import ScenarioError
    from dembrick.scenario import shipped
    from dembrick.scenario.checks import nearest

    templates = shipped.templates()
    if options.template is None:
        told = {name: shipped.description(path) for name, path in templates.items()}
        lines = [f"{name:14} {text.split('. ')[0].rstrip('.')}" for name, text in told.items()]
        lines.append("\n'dembrick new TEMPLATE' writes one; the names that 'dembrick examples' lists work too")
        console.result({"templates": told}, "\n".join(lines))
        return 0
    templates = {name: path for name, path in shipped.examples().items() if "/" not in name} | templates
    if options.template not in templates:
        raise ScenarioError(f"there is no template {options.template!r}; {nearest(options.template, templates)}")
    path = options.file or f"{options.template}.toml"
    require_ending(path, (".toml",), "a scenario")
    text = (
        templates[options.template].read_text(encoding="utf-8").replace(f"../{shipped.SCHEMA}", f"./{shipped.SCHEMA}")
    )
    with history.product("scenario", [options.template], force=options.force):
        history.write_whole(path, text, "file")
    schema = Path(path).parent / shipped.SCHEMA
    if shipped.SCHEMA in text and not os.path.lexists(schema):  # with which editors complete and check the file
        history.write_whole(schema, (shipped.folder() / shipped.SCHEMA).read_bytes(), "schema")
    verb = "sweep" if options.template == "study" else "run"
    check = "" if options.template == "study" else f"check it with 'dembrick check {path}', "
    console.result(
        {"file": path, "template": options.template},
        f"{path} written; {check}run it with 'dembrick {verb} {path}'",
    )
    return 0
