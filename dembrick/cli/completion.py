"""``dembrick completion bash|zsh|tcsh``: a script that completes commands, options and files in a shell."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument("shell", choices=["bash", "zsh", "tcsh", "fish"], help="the shell")


def run(options, console) -> int:
    """Print the script; ``eval "$(dembrick completion bash)"`` in a start-up file takes it up."""
    from dembrick.cli import full_parser
    from dembrick.errors import MissingDependency

    if options.shell == "fish":
        print(_fish(full_parser()))
        return 0
    try:
        import shtab
    except ImportError:
        raise MissingDependency("shell completion needs the package shtab: pip install shtab") from None
    print(shtab.complete(full_parser(), options.shell))
    return 0


def _fish(parser) -> str:
    """Completion for fish, which shtab does not write: commands, options and files."""
    import argparse

    (verbs,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    lines = ["complete -c dembrick -n __fish_use_subcommand -f"]
    for verb, sub in verbs.choices.items():
        told = (sub.description or "").replace("'", "\\'")
        lines.append(f"complete -c dembrick -n __fish_use_subcommand -a {verb} -d '{told}'")
        for action in sub._actions:
            for option in action.option_strings:
                if option.startswith("--"):
                    text = (action.help or "").replace("'", "\\'").replace("%%", "%")
                    needs = "" if action.nargs == 0 else " -r"
                    seen = f"complete -c dembrick -n '__fish_seen_subcommand_from {verb}'"
                    lines.append(f"{seen} -l {option[2:]}{needs} -d '{text}'")
    return "\n".join(lines)
