"""``dembrick render FILE.h5 --to FILE.png`` (``.gif``, ``.mp4``, ``.html``)."""

from __future__ import annotations

from dembrick.cli.paths import add_force


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument(
        "--to", metavar="FILE", required=True, help="picture (.png), movie (.gif, .mp4) or page (.html)"
    )
    add_look(parser)
    one = parser.add_argument_group("picture").add_mutually_exclusive_group()
    one.add_argument("--frame", type=int, default=-1, help="frame number, negative from the end (default: last)")
    one.add_argument("--time", type=float, metavar="SECONDS", help="show the frame nearest to this time")
    movie = parser.add_argument_group("movie")
    movie.add_argument("--fps", type=float, default=20.0, help="frames a second (default: 20)")
    movie.add_argument(
        "--count", type=int, default=100, help="most frames, spread evenly over the time of the run (default: 100)"
    )
    add_force(parser)
    parser.add_argument("--size", type=int, nargs=2, metavar=("WIDTH", "HEIGHT"), help="pixels")


def add_look(parser) -> None:
    """Options of how a history is shown."""
    look = parser.add_argument_group("look")
    look.add_argument("--camera", "--view", choices=["iso", "front", "side", "top"], default="iso", help="camera")
    look.add_argument(
        "--magnify",
        "--magnification",
        type=float,
        metavar="FACTOR",
        help="magnification of the motion (default: so that it is seen)",
    )
    look.add_argument(
        "--color",
        choices=["displacement", "utilisation", "slip", "energy", "none"],
        default="displacement",
        help="what the blocks are coloured by (default: displacement)",
    )
    look.add_argument("--forces", action="store_true", help="draw the forces of joints and of new contacts as arrows")


def run(options, console) -> int:
    """Draw the picture, the movie or the page."""
    ending = options.to.lower().rpartition(".")[2]
    if ending in ("html", "htm"):
        from dembrick import history
        from dembrick.views import page

        with (
            history.read(options.history) as found,
            history.product("page", [found.scenario_text], [options.history], options.force),
        ):
            console.meter.busy("drawing")
            page.write(found, options.to)
        console.result({"page": options.to}, f"page: {options.to}")
        return 0
    from dembrick import history
    from dembrick.views import render

    look = {"view": options.camera, "magnification": options.magnify, "color": options.color}
    look |= {"forces": options.forces}
    if options.size:
        look["size"] = tuple(options.size)
    kind = "movie" if ending in ("gif", "mp4") else "picture"
    with (
        history.read(options.history) as found,
        history.product(kind, [found.scenario_text], [options.history], options.force),
    ):
        console.meter.busy("drawing")
        if kind == "movie":
            render.movie(
                found,
                options.to,
                **look,
                fps=options.fps,
                count=options.count,
                progress=lambda done, total: console.progress(done, total, "frames"),
            )
        else:
            render.picture(found, options.to, **look, frame=options.frame, time=options.time)
    console.result({kind: options.to}, f"{kind}: {options.to}")
    return 0
