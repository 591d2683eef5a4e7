"""``dembrick restart FILE.h5``: go on with a run that was killed or interrupted."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history of the run")


def run(options, console) -> int:
    """Go on from the last good checkpoint; the result is that of one uninterrupted run."""
    from dembrick.cli.run import answer
    from dembrick.runs.simulate import restart

    return answer(
        lambda: restart(options.history, report=console.remark, progress=console.meter.run), options.history, console
    )
