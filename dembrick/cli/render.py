"""``dembrick render FILE.h5 --to FILE.png``."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--to", metavar="FILE.png", required=True, help="picture")
    parser.add_argument("--view", choices=["iso", "front", "side", "top"], default="iso", help="camera")
    parser.add_argument("--frame", type=int, default=-1, help="frame number, negative from the end (default: last)")
    parser.add_argument("--magnification", type=float, help="of the displacements (default: so that they are seen)")


def run(options, console) -> int:
    """Draw the picture."""
    from dembrick import history, render

    render.picture(
        history.read(options.history),
        options.to,
        frame=options.frame,
        view=options.view,
        magnification=options.magnification,
    )
    console.result({"picture": options.to}, f"picture: {options.to}")
    return 0
