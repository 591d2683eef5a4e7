"""``dembrick run SCENARIO.toml``, or the history of an earlier run; ``--to`` shows what came of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from dembrick.cli import export
from dembrick.cli.paths import add_force, default_output, require_ending

HISTORIES = (".h5", ".hdf5")


def add_arguments(parser) -> None:
    parser.add_argument("scenario", help="the TOML file, or a history to run again")
    parser.add_argument(
        "--out",
        metavar="FILE.h5",
        help="history file (default: results/<scenario>.h5, or a name with a number where that is of another scenario)",
    )
    parser.add_argument(
        "--set", metavar="KEY.PATH=VALUE", action="append", default=[], help="change a key of the scenario"
    )
    parser.add_argument("--tolerance", type=float, help="short for --set control.tolerance=...")
    parser.add_argument(
        "--refine",
        action="store_true",
        help="how far the answer is known: searches again with other stiffness ratios, shorter steps and forces locked "
        "in; in real time with stiffer joints and at half the rate",
    )
    parser.add_argument(
        "--bound",
        action="store_true",
        help="what limit analysis says, whatever it costs: of a search the associative bound, which no path exceeds; "
        "of supports that settle the least and the greatest reaction before they move",
    )
    export.add_to(parser, default=[])
    add_force(parser)


def run(options, console) -> int:
    """Run the scenario; exit code 3 where theory and replay disagree."""
    from dembrick import history
    from dembrick.runs.reading import load
    from dembrick.runs.simulate import simulate
    from dembrick.scenario.files import inputs_of

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
    shown = {"report": console.remark, "progress": console.meter.run}
    asked = {"refine": options.refine, "bound": options.bound}
    return answer(
        lambda: simulate(scenario, path, force=force, **asked, **shown), path, console, options.to, options.force
    )


def _default_path(scenario, console) -> str:
    """``results/<scenario>.h5``, or another name where that one holds the run of another scenario or of other --set."""
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
        console.remark(f"{taken[0]} holds another scenario, or other --set; this one goes to {path}")
    return path


def answer(simulated: Callable, path: str, console, to: Sequence[str] = (), force: bool = False) -> int:
    """Carry a run out, print what came of it and write the files ``to``; returns the exit code."""
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
        left = os.path.exists(path)  # none where the folder cannot be written
        failed = {"status": "failed", "error": str(error)} | ({"history": path} if left else {})
        console.result(error.answer or failed, "")
        console.error(str(error))
        if left:
            console.remark(f"history: {path}")
        return 1
    for phase, seconds in {**result.wall, **(result.run.phases or {})}.items():
        if isinstance(seconds, float):
            console.detail(f"{phase.replace('_', ' ')}: {seconds:.3g} s")
    console.part(_text(result))
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
            f"the contact points of a distributed joint miss the continuum by {100 * result.points_miss:+.2g} %, more "
            f"than the tolerance: it opens. {remedy}, or state joint.points of your own"
        )
        return 3
    console.error(
        "theory and replay disagree: V lies outside the tolerance of theory, or theory outside the certified bracket"
    )
    return 3


def _show(path: str, to: Sequence[str], force: bool, files: list[str], console) -> None:
    """Write the files ``to`` from the history at ``path``; ``files`` gathers all that are there."""
    if not to:
        return
    from dembrick import history

    with history.read(path) as found:
        for written in export.write(to, found, console, force=force):
            files += written
            console.part(export.told(written))


def _text(result) -> str:
    from dembrick.runs.collapse import after_lines, collapse_lines
    from dembrick.runs.outcomes.result import Result, printed
    from dembrick.runs.path_dependence import path_lines
    from dembrick.scenario.regimes import CONSTANT_RATE
    from dembrick.views.summary import limit_text, peak_text, plain

    if not isinstance(result, Result):
        return result.text()
    point, run = result.yield_point, result.run
    lines = result.heading_lines
    unit, path = " N" if result.curve.unit == "N" else "", getattr(result, "path", None) or {}
    found = point.as_dict()
    if result.collapse is not None:
        lines += collapse_lines(result.collapse, found)
    if result.unlimited:
        return "\n".join([*lines, f"answer        {result.plain_answer}", f"history       {result.history}"])
    if result.collapse is None:
        lines += [f"V             {plain(str(limit_text(found, path, unit.strip())))}", *path_lines(path, unit)]
    lines += after_lines(result.after, unit)
    if result.theory is not None:
        error = result.theory.error
        compared = "" if error is None else f"  (replay {100 * error:+.2g} %)"
        lines.append(f"theory        {result.theory.V:.6g}{unit}{compared}")
        if result.theory.discretisation_error is not None:
            lines.append(f"discretised   {100 * result.theory.discretisation_error:+.2g} % from the continuum")
    peak, where = peak_text(found, path, unit.strip(), result.scenario.control.regime is CONSTANT_RATE)
    lines.append(f"V_peak        {plain(f'{peak}, {where}')}")
    carried = (point.N, point.V_1, point.V_2, point.M_T)
    N, V_1, V_2, M_T = printed(carried, max(map(abs, carried)))
    which = f"{' / '.join(point.joint)}: " if len(result.assembly.joints) > 1 else ""
    when = "at the end" if point.limit_at is None and point.bracket != "certified" else "at the limit"
    lines.append(f"joint         {when}, {which}N = {N} N, V_1 = {V_1} N, V_2 = {V_2} N, M_T = {M_T} N m")
    where = ""
    if point.torsion_centre is not None:
        x, y = printed(point.torsion_centre, max(map(abs, point.torsion_centre)))
        where = f", centre ({x}, {y}) m"
    moves = "mechanism" if result.collapse is None else "joint moves"  # of several, that of the collapse is above
    lines.append(f"{moves:14}{point.mechanism}{where}")
    took = f"loop {1e3 * run.loop_seconds:.3g} ms"
    if "equilibria" in run.settings:
        lines.append(f"equilibria    {run.settings['equilibria']}, by {run.steps} Newton steps, {took}")
    else:
        lines.append(
            f"time step     {run.time_step:.3g} s (critical {run.critical_time_step:.3g} s), {run.steps} steps, {took}"
        )
    lines += result.force_lines
    lines.append(f"history       {result.history}")
    return "\n".join(lines)
