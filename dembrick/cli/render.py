"""``dembrick render FILE.h5 --to FILE.png`` (``.gif``, ``.mp4``, ``.html``); of a scenario, before anything runs."""

from __future__ import annotations

import os

from dembrick.cli.paths import add_force


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE", help="history file, or a scenario (.toml): as it is before a run")
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


def is_scenario(path: str) -> bool:
    """Whether a path is that of a scenario, or the name of a shipped one."""
    from dembrick.scenario import shipped

    return path.lower().endswith(".toml") or (not os.path.exists(path) and shipped.find(path) is not None)


def opened(path: str):
    """A history file, or what a scenario looks like before a run, as a history; a context."""
    from dembrick import history

    if not is_scenario(path):
        return history.read(path)
    from dembrick.assembly.build import assemble
    from dembrick.runs import mechanism_history
    from dembrick.scenario import toml

    scenario = toml.load(path)
    return mechanism_history.before_a_run(scenario, assemble(scenario))


def run(options, console) -> int:
    """Draw the picture, the movie or the page."""
    ending = options.to.lower().rpartition(".")[2]
    if ending in ("html", "htm"):
        from dembrick import history
        from dembrick.views import page

        with (
            opened(options.history) as found,
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
    if is_scenario(options.history):
        look["color"] = "none"  # nothing has moved yet
    if options.size:
        look["size"] = tuple(options.size)
    kind = "movie" if ending in ("gif", "mp4") else "picture"
    with (
        opened(options.history) as found,
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
