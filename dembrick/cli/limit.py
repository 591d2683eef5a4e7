"""``dembrick limit SCENARIO.toml``: rigid-block limit analysis of the same scenario."""

from __future__ import annotations

import os

from dembrick.cli.paths import add_force, add_set, require_ending
from dembrick.cli.run import HISTORIES


def add_arguments(parser) -> None:
    parser.add_argument("scenario", help="the TOML file")
    add_set(parser)
    parser.add_argument(
        "--heuristic",
        action="store_true",
        help="add an estimate without dilatancy: a sequence of programmes, not a bound (Gilbert and others 2006)",
    )
    parser.add_argument("--picture", "--to", metavar="FILE.png", help="draw the mechanism")
    parser.add_argument("--out", metavar="FILE.h5", help="write the mechanism as a history, for dembrick render")
    add_force(parser)
    reaction = parser.add_argument_group("reaction of a support that may move, under the dead loads")
    reaction.add_argument(
        "--reaction",
        metavar="SUPPORT",
        help="fixed block or group whose least and greatest force are computed; or A/B, for the force of a block or "
        "group A on another, B, in the joints between them",
    )
    reaction.add_argument(
        "--direction",
        metavar="X,Y,Z",
        help="direction in which its force on the other blocks counts as positive",
    )


def run(options, console) -> int:
    """Analyse the scenario; exit code 1 if it does not stand under its dead loads or the solver fails."""
    from dembrick import history
    from dembrick.errors import DembrickError, ScenarioError
    from dembrick.runs import limit, limit_cases, reactions
    from dembrick.runs.reading import load
    from dembrick.scenario.controls import DEAD_LOAD, DEFORMED_REST
    from dembrick.scenario.files import inputs_of

    if (options.reaction is None) != (options.direction is None):
        raise ScenarioError("--reaction and --direction belong together: --reaction SUPPORT --direction X,Y,Z")
    if options.reaction is not None and (options.picture or options.out or options.heuristic):
        raise ScenarioError("--picture, --out and --heuristic belong to a load, not to --reaction")
    scenario = load(options.scenario, options.set)
    inputs = [options.scenario, *inputs_of(scenario)]
    for path, endings, what in ((options.out, HISTORIES, "a history"), (options.picture, [".png"], "a picture")):
        if path:
            require_ending(path, endings, what)
            history.refuse_inputs(path, os.path.realpath(path), inputs)
    statics = scenario.control.regime in (DEAD_LOAD, DEFORMED_REST) and options.reaction is None
    if statics and (options.picture or options.out or options.heuristic):
        raise ScenarioError('--picture, --out and --heuristic belong to a load, and kind "statics" has none')
    try:
        found: reactions.ReactionResult | limit.LimitResult | limit_cases.StandingResult
        if options.reaction is not None:
            found = reactions.reaction(scenario, options.reaction, _vector(options.direction), report=console.remark)
        else:
            found = limit.limit(scenario, heuristic=options.heuristic, report=console.remark)
    except DembrickError as error:
        if error.exit_code != 1:
            raise
        console.result(error.answer or {"status": "failed", "error": str(error)}, "")
        console.error(str(error))
        return 1
    console.result(found.as_dict(), found.text())
    if options.out and isinstance(found, limit.LimitResult):
        console.remark(f"history: {found.write(options.out, options.force)}")
    if options.picture and isinstance(found, limit.LimitResult):
        console.remark(f"picture: {found.picture(options.picture)}")
    return 0


def _vector(text: str) -> tuple[float, ...]:
    from dembrick.errors import ScenarioError

    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ScenarioError(f"--direction {text} must be three numbers separated by commas, such as 1,0,0") from None
