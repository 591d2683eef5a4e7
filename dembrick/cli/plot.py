"""``dembrick plot FILE.h5 ...``: curves; PNG, SVG or PDF by the ending."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("histories", nargs="+", metavar="FILE.h5", help="history files, drawn into one figure")
    parser.add_argument("--to", metavar="FILE", help="figure file (default: results/<first history>.png)")
    parser.add_argument("--labels", nargs="+", metavar="TEXT", help="one label a history")
    parser.add_argument(
        "--what", choices=["curve", "unbalanced", "layout", "domain"], default="curve", help="what to draw"
    )


def run(options, console) -> int:
    """Draw the figure."""
    from pathlib import Path

    from dembrick import history, plot
    from dembrick.cli.paths import default_output
    from dembrick.errors import ScenarioError

    if options.labels and len(options.labels) != len(options.histories):
        raise ScenarioError(
            f"--labels: {len(options.labels)} labels for {len(options.histories)} histories; give one each"
        )
    files = [history.read(path) for path in options.histories]
    if options.what == "curve":
        figure = plot.force_displacement(files, labels=options.labels)
    elif options.what == "unbalanced":
        figure = plot.unbalanced(files, labels=options.labels)
    elif options.what == "layout":
        figure = plot.layout(files)
    else:
        figure = plot.domains(files)
    path = options.to or default_output(Path(options.histories[0]).stem + ".png")
    plot.save(figure, path)
    console.result({"figure": path}, f"figure: {path}")
    return 0
