"""``dembrick export FILE.h5 --to FILE.vtkhdf`` (or ``.pvd``, ``.csv``)."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("history", metavar="FILE.h5", help="history file")
    parser.add_argument("--to", metavar="FILE", required=True, help="output; .vtkhdf, .pvd or .csv")
    layers = ["blocks", "joints", "contacts"]
    parser.add_argument("--layers", nargs="+", choices=layers, default=layers, help="what to write (default: all)")


def run(options, console) -> int:
    """Write the export."""
    from dembrick import history
    from dembrick.views.export import export

    written = export(history.read(options.history), options.to, console.remark, options.layers)
    console.result({"files": [str(path) for path in written]}, "\n".join(str(path) for path in written))
    return 0
