"""``dembrick new [TEMPLATE] [FILE.toml]``: a complete commented scenario to start from."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("template", nargs="?", help="torsion-test, wall, arch, column or study (default: list them)")
    parser.add_argument("file", nargs="?", help="file to write (default: TEMPLATE.toml)")
    parser.add_argument("--force", action="store_true", help="replace the file if it exists")


def run(options, console) -> int:
    """Write a copy of a template."""
    from difflib import get_close_matches
    from pathlib import Path

    from dembrick.errors import OutputError, ScenarioError, WriteError
    from dembrick.scenario import shipped

    templates = shipped.templates()
    if options.template is None:
        told = {name: shipped.description(path) for name, path in templates.items()}
        lines = [f"{name:14} {text.split('. ')[0].rstrip('.')}" for name, text in told.items()]
        console.result({"templates": told}, "\n".join([*lines, "\n'dembrick new TEMPLATE' writes one"]))
        return 0
    if options.template not in templates:
        nearest = get_close_matches(options.template, templates, 1)
        hint = f"did you mean {nearest[0]!r}?" if nearest else f"the templates are {', '.join(templates)}"
        raise ScenarioError(f"no template is called {options.template!r}; {hint}")
    path = Path(options.file or f"{options.template}.toml")
    if path.suffix != ".toml":
        raise OutputError(f"{path}: a scenario is a TOML file; give a name that ends in .toml")
    if path.exists() and not options.force:
        raise OutputError(f"{path}: this file exists; choose another name, or --force to replace it")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: its parent folder does not exist; make it first or choose another path")
    try:
        path.write_bytes(templates[options.template].read_bytes())
    except OSError as error:
        raise WriteError(f"{path}: the file cannot be written ({error.strerror})") from error
    verb = "sweep" if options.template == "study" else "run"
    check = "" if options.template == "study" else f"check it with 'dembrick check {path}', "
    console.result(
        {"file": str(path), "template": options.template},
        f"{path} written; {check}run it with 'dembrick {verb} {path}'",
    )
    return 0
