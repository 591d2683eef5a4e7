"""``dembrick render FILE.h5 --to FILE.png``."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--to", metavar="FILE", required=True, help="picture (.png) or page (.html)")
    parser.add_argument("--view", choices=["iso", "front", "side", "top"], default="iso", help="camera")
    parser.add_argument("--frame", type=int, default=-1, help="frame number, negative from the end (default: last)")
    parser.add_argument("--magnification", type=float, help="of the displacements (default: so that they are seen)")


def run(options, console) -> int:
    """Draw the picture."""
    if options.to.lower().endswith((".html", ".htm")):
        from dembrick import page

        page.write(options.history, options.to)
        console.result({"page": options.to}, f"page: {options.to}")
        return 0
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
