"""``dembrick completion bash|zsh|tcsh|fish``: a script that completes commands, options and files in a shell."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument("shell", choices=["bash", "zsh", "tcsh", "fish"], help="the shell")


def run(options, console) -> int:
    """Print the script; ``eval "$(dembrick completion bash)"`` in a start-up file activates it."""
    from dembrick.cli import full_parser
    from dembrick.cli.streams import print_output
    from dembrick.errors import MissingDependency

    try:
        import shtab
    except ImportError:
        raise MissingDependency(
            "shell completion needs the package shtab; install it with: pip install shtab"
        ) from None
    print_output(shtab.complete(full_parser(), options.shell))
    return 0
