"""``dembrick render FILE.h5 --to FILE.png`` (``.gif``, ``.mp4``, ``.html``); a scenario is drawn as before a run."""

from __future__ import annotations

import os
from contextlib import ExitStack

from dembrick.cli.paths import FRAME, add_force, frame_of

FPS, COUNT = 20.0, 100
BELONGS = {"frame": "picture", "time": "picture", "fps": "movie", "count": "movie"}  # options of one kind only


def add_arguments(parser) -> None:
    parser.add_argument(
        "histories",
        nargs="+",
        metavar="FILE",
        help="history file, or scenario (.toml) as it is before a run; several are drawn side by side",
    )
    parser.add_argument(
        "--to",
        metavar="FILE",
        required=True,
        action="append",
        help="picture (.png), movie (.gif, .mp4) or page (.html); may be repeated",
    )
    add_look(parser)
    one = parser.add_argument_group("picture").add_mutually_exclusive_group()
    one.add_argument("--frame", type=frame_of, metavar="{peak,last,N}", help=FRAME)
    one.add_argument("--time", type=float, metavar="SECONDS", help="show the frame nearest to this time")
    movie = parser.add_argument_group("movie")
    movie.add_argument("--fps", type=float, help=f"frames per second (default: {FPS:g})")
    movie.add_argument("--count", type=int, help=f"greatest number of frames, evenly spaced in time (default: {COUNT})")
    add_force(parser)
    parser.add_argument("--size", type=int, nargs=2, metavar=("WIDTH", "HEIGHT"), help="pixels")


def add_look(parser) -> None:
    """Add the options for the look of a drawing."""
    look = parser.add_argument_group("look")
    look.add_argument(
        "--camera",
        "--view",
        choices=["iso", "iso-back", "front", "back", "side", "top"],
        default="iso",
        help="view direction (default: iso, from +x, -y and above)",
    )
    look.add_argument(
        "--magnify",
        "--magnification",
        type=float,
        metavar="FACTOR",
        help="magnification of the motion (default: enough to make it visible)",
    )
    look.add_argument(
        "--color",
        choices=["displacement", "utilisation", "slip", "energy", "none"],
        default="displacement",
        help="quantity that colours the blocks (default: displacement)",
    )
    look.add_argument(
        "--names",
        choices=["none", "blocks", "joints", "all"],
        default="none",
        help="write the names of these parts if they move",
    )
    look.add_argument("--thrust", action="store_true", help="draw the line of thrust, and the hinges as dots")
    look.add_argument(
        "--reactions", action="store_true", help="draw the reactions of the supports as arrows below them"
    )
    look.add_argument("--forces", action="store_true", help="draw the forces of joints and of new contacts as arrows")


def is_scenario(path: str) -> bool:
    """Whether a path is that of a scenario, or the name of a shipped one."""
    from dembrick.scenario import shipped

    return path.lower().endswith(".toml") or (not os.path.exists(path) and shipped.find(path) is not None)


def opened(path: str):
    """Context manager with a history file, or with a scenario before its run as a history."""
    from dembrick import history

    if not is_scenario(path):
        return history.read(path)
    from dembrick.assembly.build import assemble
    from dembrick.runs import mechanism_history
    from dembrick.scenario import toml

    scenario = toml.load(path)
    return mechanism_history.before_a_run(scenario, assemble(scenario))


def look_of(options) -> dict:
    """Keywords of the drawing functions, from the options."""
    look = {"view": options.camera, "magnification": options.magnify, "color": options.color}
    drawn = {"forces": options.forces, "thrust": options.thrust, "reactions": options.reactions}
    return look | drawn | {"names": options.names}


def run(options, console) -> int:
    from dembrick import history
    from dembrick.errors import ScenarioError

    kinds = [_kind(path, options) for path in options.to]
    for name, kind in BELONGS.items():
        if getattr(options, name) is not None and kind not in kinds:
            raise ScenarioError(f"--{name} belongs to a {kind}, and --to names none: {', '.join(options.to)}")
    before = [is_scenario(path) for path in options.histories]
    with ExitStack() as stack:
        found = [stack.enter_context(opened(path)) for path in options.histories]
        texts = [own.scenario_text for own in found]
        read = [*options.histories, *(path for own in found for path in own.sources)]
        look = look_of(options) | ({"color": "none"} if all(before) else {})
        for kind, path in zip(kinds, options.to, strict=True):
            with history.product(kind, texts, read, options.force):
                console.meter.busy("drawing")
                if kind == "page":
                    from dembrick.views import page

                    page.write(found[0], path)
                else:
                    _draw(found, kind, path, options, console, look)
            console.part(f"{kind}: {path}")
    console.result(dict(zip(kinds, options.to, strict=True)) | {"files": options.to}, "")
    return 0


KINDS = {".png": "picture", ".gif": "movie", ".mp4": "movie", ".html": "page", ".htm": "page"}


def _kind(path: str, options) -> str:
    """Kind of a file by its ending: page, movie or picture."""
    from dembrick.cli.paths import require_ending
    from dembrick.errors import ScenarioError

    require_ending(path, tuple(KINDS), "a picture, movie or page")
    kind = KINDS[os.path.splitext(path)[1].lower()]
    if kind == "page" and len(options.histories) > 1:
        raise ScenarioError("a page shows one run; use --to FILE.png or FILE.gif to draw several side by side")
    return kind


def _draw(found, kind: str, path: str, options, console, look: dict) -> None:
    from dembrick.views import render

    size = tuple(options.size) if options.size else None
    if kind == "picture":
        render.picture(found, path, **look, size=size, frame=options.frame, time=options.time)
        return
    render.movie(
        found,
        path,
        **look,
        size=size,
        fps=FPS if options.fps is None else options.fps,
        count=COUNT if options.count is None else options.count,
        progress=lambda done, total: console.progress(done, total, "frames"),
    )
