"""``dembrick export FILE.h5 --to FILE ...``: write a history in other formats, by the endings of the names.

The commands that run a scenario have the same option: ``--to wall.png curve.pdf wall.vtkhdf page.html``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence

from dembrick.cli.paths import add_force

LAYERS = ("blocks", "joints", "contacts", "ties")  # of .vtkhdf, .pvd and .csv


def add_to(parser, **how) -> None:
    """Add the option ``--to``; ``how``: further keywords for argparse."""
    told = "; ".join(f"{', '.join(endings)}: {what}" for what, endings, _ in WRITERS)
    parser.add_argument(
        "--to",
        metavar="FILE",
        nargs="+",
        action="extend",
        help=f"files to write, each in the format of its ending: {told}",
        **how,
    )


def check_names(paths: Sequence[str]) -> None:
    """Raise OutputError for a name with an unknown ending or given twice, before anything runs."""
    from dembrick.errors import OutputError

    for number, path in enumerate(paths):
        ending = os.path.splitext(path)[1].lower()
        if ending not in BY_ENDING:
            known = ", ".join(BY_ENDING)
            raise OutputError(f"{path}: no file can be written with the ending '{ending}'; use one of {known}")
        if os.path.realpath(path) in map(os.path.realpath, paths[:number]):
            raise OutputError(f"{path}: --to names this file twice; name it once")


def check_free(paths: Sequence[str], text: str, inputs: Iterable[str], force: bool) -> None:
    """Raise OutputError for an existing file that this command may not replace, before the scenario ``text`` runs."""
    from dembrick import history

    for path in paths:
        with history.product(_kind(path, LAYERS), [text], inputs, force):
            history.refuse_foreign(path, os.path.realpath(path))


def _kind(path: str, layers: Sequence[str]) -> str:
    what, writer = BY_ENDING[os.path.splitext(path)[1].lower()]
    return "export " + " ".join(layers) if writer is _export else what


def write(
    paths: Iterable[str], file, console, layers: Sequence[str] = LAYERS, force: bool = False
) -> Iterator[list[str]]:
    """Write each of ``paths`` from a history; yield the files of each once they are written."""
    from dembrick import history

    for path in paths:
        _, writer = BY_ENDING[os.path.splitext(path)[1].lower()]
        with history.product(_kind(path, layers), [file.scenario_text], file.sources, force):
            if writer in (_picture, _page):
                console.meter.busy("drawing")
            written = writer(file, path, console, layers)
        yield written


def told(written: Sequence[str]) -> str:
    """Lines that list the files written; the frames of a series are counted."""
    frames = [path for path in written if path.endswith(".vtu")]
    lines = [path for path in written if not path.endswith(".vtu")]
    if frames:
        lines.append(f"{len(frames)} frames in {os.path.dirname(frames[0])}")
    return "\n".join(f"written       {line}" for line in lines)


def _looked_at(file) -> dict:
    """Look of a drawing without options: arches alone, unless they fall sideways, are drawn from the front, with their
    line of thrust and their hinges."""
    import tomllib

    given = tomllib.loads(file.scenario_text)
    channels = given.get("output", {}).get("channels", ["joints"])
    arched = "arches" in given and not {"walls", "domes", "models"} & given.keys() and "joints" in channels
    return {"view": "front", "thrust": True} if arched and not _falls_sideways(file) else {}


def _falls_sideways(file) -> bool:
    """Whether blocks move mostly towards or away from one who looks from the front, at the frame that is drawn."""
    from dembrick.views.motion.frames import frame_number

    if not file.has_frames:
        return False
    moved = file.frame("displacement", frame_number(file, in_rows=True))
    x, y, z = (moved**2).sum(axis=0)
    return bool(y > x + z)


def _picture(file, path: str, console, layers) -> list[str]:
    from dembrick.views import render

    return [render.picture(file, path, **_looked_at(file))]


def _movie(file, path: str, console, layers) -> list[str]:
    from dembrick.views import render

    def progress(done: int, total: int) -> None:
        console.progress(done, total, "frames")

    return [render.movie(file, path, progress=progress)]


def _page(file, path: str, console, layers) -> list[str]:
    from dembrick.views import page

    page.write(file, path)
    return [path]


def _figure(file, path: str, console, layers) -> list[str]:
    from dembrick.views import plot

    plot.save(plot.force_displacement([file], None), path)
    return [path]


def _export(file, path: str, console, layers) -> list[str]:
    from dembrick.views.export import export

    return export(file, path, console.remark, list(layers))


Writer = Callable[..., list[str]]
WRITERS: tuple[tuple[str, tuple[str, ...], Writer], ...] = (
    ("picture", (".png",), _picture),
    ("movie", (".gif", ".mp4"), _movie),
    ("page", (".html", ".htm"), _page),
    ("curve", (".pdf", ".svg"), _figure),
    ("ParaView", (".vtkhdf", ".pvd"), _export),
    ("table", (".csv",), _export),
)
BY_ENDING: dict[str, tuple[str, Writer]] = {
    ending: (what, writer) for what, endings, writer in WRITERS for ending in endings
}


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    add_to(parser, required=True)
    add_force(parser)
    layers = list(LAYERS)
    parser.add_argument(
        "--layers", nargs="+", choices=layers, default=layers, help="contents of the ParaView files (default: all)"
    )


def run(options, console) -> int:
    from dembrick import history

    check_names(options.to)
    files: list[str] = []
    with history.read(options.history) as found:
        for written in write(options.to, found, console, options.layers, options.force):
            files += written
            console.part(told(written))
    console.result({"files": files}, "")
    return 0
