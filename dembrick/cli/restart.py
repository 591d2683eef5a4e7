"""``dembrick restart FILE.h5``: continue a run that was killed or interrupted, or any run from a given time."""

from __future__ import annotations

from functools import partial

from dembrick.cli import export
from dembrick.cli.paths import add_force, require_ending
from dembrick.errors import ScenarioError


def add_arguments(parser) -> None:
    parser.add_argument("history", metavar="FILE.h5", help="history of the run")
    parser.add_argument(
        "--at",
        metavar="T",
        type=float,
        help="continue from this time of the run, even if it has ended; FILE.h5 stays unchanged",
    )
    parser.add_argument(
        "--set",
        metavar="KEY.PATH=VALUE",
        action="append",
        default=[],
        help="with --at: change a joint law, a load, a tie, ... from then on; 'run FILE.h5 --set ... --out NEW.h5' "
        "makes the change from the start",
    )
    parser.add_argument("--out", metavar="NEW.h5", help="with --at: file of the new history")
    export.add_to(parser, default=[])
    add_force(parser)


def run(options, console) -> int:
    """Continue from the last good checkpoint, with the result of an uninterrupted run; or from the time ``--at``."""
    from dembrick.cli.run import HISTORIES, answer
    from dembrick.runs.simulate import restart, restart_at

    export.check_names(options.to)
    shown = {"report": console.remark, "progress": console.meter.run}
    if options.at is None:
        if options.set or options.out:
            changes = " ".join(f"--set {change}" for change in options.set) or "--set KEY.PATH=VALUE"
            new = options.out or "NEW.h5"
            raise ScenarioError(
                "--set and --out need --at T, the time from which the run continues; to change the whole run: "
                f"dembrick run {options.history} {changes} --out {new}"
            )
        return answer(lambda: restart(options.history, **shown), options.history, console, options.to)
    if not options.out:
        raise ScenarioError(
            "--at T writes a new history and leaves the old one unchanged; name the new one: --out NEW.h5"
        )
    require_ending(options.out, HISTORIES, "a history")
    given = {"changes": options.set, "force": options.force, **shown}
    went_on = partial(restart_at, options.history, options.at, options.out, **given)
    return answer(went_on, options.out, console, options.to, options.force)
