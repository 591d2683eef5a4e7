"""``dembrick run SCENARIO.toml``, or the history of an earlier run; ``--to`` writes the result to other files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from dembrick.cli import export
from dembrick.cli.paths import add_force, add_set, default_output, require_ending

HISTORIES = (".h5", ".hdf5")


def add_arguments(parser) -> None:
    parser.add_argument("scenario", help="the TOML file, or a history to run again")
    parser.add_argument(
        "--out",
        metavar="FILE.h5",
        help="history file (default: results/<scenario>.h5, with a number added if that holds another scenario)",
    )
    add_set(parser)
    parser.add_argument("--tolerance", type=float, help="short for --set control.tolerance=...")
    parser.add_argument(
        "--refine",
        action="store_true",
        help="estimate the error of the answer by further runs: searches with other stiffness ratios, shorter steps "
        "and locked-in forces; real time with stiffer joints and at half the rate; deformed geometry with "
        "stiffer joints and half the steps",
    )
    parser.add_argument(
        "--bound",
        action="store_true",
        help="add limit analysis, whatever it costs: for a search the associative bound, which no load path "
        "exceeds; for supports that settle the least and the greatest reaction before they move",
    )
    export.add_to(parser, default=[])
    add_force(parser)


def run(options, console) -> int:
    """Run the scenario; exit code 3 if theory and replay disagree."""
    from dembrick import history
    from dembrick.runs.reading import load
    from dembrick.runs.simulate import simulate
    from dembrick.scenario import toml as scenarios
    from dembrick.scenario.files import inputs_of
    from dembrick.simulation.dynamics.time_histories import records_of

    export.check_names(options.to)
    changes = list(options.set)
    if options.tolerance is not None:
        changes.append(f"control.tolerance={options.tolerance!r}")
    scenario = load(options.scenario, changes)
    if options.out:
        require_ending(options.out, HISTORIES, "a history")
        history.refuse_inputs(options.out, os.path.realpath(options.out), inputs_of(scenario))
        path, force = options.out, options.force
    else:
        path, force = _default_path(scenario, console), options.force or history.OWN
    given = [options.scenario, *inputs_of(scenario)]
    export.check_free(options.to, scenarios.text_of(scenario), given, options.force)
    for record in records_of(scenario):
        console.detail(f"shaken by {record}")
    shown = {"report": console.remark, "progress": console.meter.run}
    asked = {"refine": options.refine, "bound": options.bound}
    return answer(
        lambda: simulate(scenario, path, force=force, **asked, **shown), path, console, options.to, options.force
    )


def _default_path(scenario, console) -> str:
    """``results/<scenario>.h5``, or another name if that file holds the run of another scenario or of other --set."""
    from dembrick import history
    from dembrick.errors import HistoryError
    from dembrick.scenario import toml as scenarios

    text, taken = scenarios.text_of(scenario), []

    def is_free(path: str) -> bool:
        if not os.path.exists(path) or os.path.getsize(path) == 0:
            return True
        try:
            with history.read(path) as there:
                own = history.is_of(there, text, scenario.path)
        except HistoryError:
            own = False
        if not own:
            taken.append(path)
        return own

    path = default_output(Path(scenario.path).stem + ".h5", is_free)
    if taken:
        console.remark(f"{taken[0]} holds another scenario or other --set values; this run is written to {path}")
    return path


def answer(simulated: Callable, path: str, console, to: Sequence[str] = (), force: bool = False) -> int:
    """Execute a run, print its result and write the files ``to``; return the exit code."""
    from dembrick.errors import DembrickError, UndecidedError
    from dembrick.simulation.interrupts import Interrupted

    try:
        result = simulated()
    except Interrupted:
        if console.json:
            console.result({"status": "interrupted", "history": path}, "")
        raise
    except DembrickError as error:
        if error.exit_code != 1:
            raise
        left = os.path.exists(path)  # none if the folder cannot be written
        failed = {"status": "failed", "error": str(error)} | ({"history": path} if left else {})
        console.result(error.answer or failed, "")
        console.error(str(error))
        if left:
            console.remark(f"history: {path}")
        return 1
    for phase, seconds in {**result.wall, **(result.run.phases or {})}.items():
        if isinstance(seconds, float):
            console.detail(f"{phase.replace('_', ' ')}: {seconds:.3g} s")
    console.part(result.text())
    files: list[str] = []
    try:
        _show(path, to, force, files, console)
    finally:
        console.result(result.as_dict() | ({"files": files} if to else {}), "")
    if result.status == UndecidedError.status:
        console.error(result.plain_answer)
        return 1
    if result.agrees():
        return 0
    if getattr(result, "points_miss", None) is not None:
        alone = result.theory is not None
        remedy = 'Take pressure = "linear" of a convex joint' if alone else "Take concave or convex joints"
        console.error(
            f"the points of a distributed joint deviate from the continuum by {100 * result.points_miss:+.2g} %, "
            f"more than the tolerance, because it opens. {remedy}, or set joint.points"
        )
        return 3
    console.error(
        "theory and simulation disagree: V is off by more than its tolerance, or theory outside the certified bracket"
    )
    return 3


def _show(path: str, to: Sequence[str], force: bool, files: list[str], console) -> None:
    """Write the files ``to`` from the history at ``path``; add their names to ``files``."""
    if not to:
        return
    from dembrick import history

    with history.read(path) as found:
        for written in export.write(to, found, console, force=force):
            files += written
            console.part(export.told(written))
