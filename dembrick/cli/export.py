"""``dembrick export FILE.h5 --to FILE.vtkhdf`` (or ``.pvd``, ``.csv``)."""

from __future__ import annotations

import os

from dembrick.cli.paths import add_force


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--to", metavar="FILE", required=True, help="output; .vtkhdf, .pvd or .csv")
    add_force(parser)
    layers = ["blocks", "joints", "contacts", "ties"]
    parser.add_argument("--layers", nargs="+", choices=layers, default=layers, help="what to write (default: all)")


def run(options, console) -> int:
    from dembrick import history
    from dembrick.views.export import export

    with history.read(options.history) as found:
        kind = "export " + " ".join(options.layers)
        with history.product(kind, [found.scenario_text], [options.history], options.force):
            written = export(found, options.to, console.remark, options.layers)
    frames = [path for path in written if path.endswith(".vtu")]
    lines = [path for path in written if not path.endswith(".vtu")]
    if frames:
        lines.append(f"{len(frames)} frames in {os.path.dirname(frames[0])}")
    console.result({"files": written}, "\n".join(lines))
    return 0
