"""``dembrick view FILE.h5``: a window with a time slider."""

from __future__ import annotations

from dembrick.cli.render import add_look, look_of


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    add_look(parser)


def run(options, console) -> int:
    """Open the window and wait until it is closed."""
    from dembrick import history
    from dembrick.views import render

    with history.read(options.history) as found:
        render.view(found, **look_of(options))
    return 0
