"""``dembrick sweep STUDY.toml``."""

from __future__ import annotations

from pathlib import Path

from dembrick.cli.paths import add_force

_MOST_LINES = 40  # of the statistics on the screen; the tables have all


def add_arguments(parser) -> None:
    parser.add_argument("study", help="TOML file of the study: a base scenario, and the keys that vary or are searched")
    parser.add_argument("--out", metavar="FOLDER", help="folder for rows and tables (default: results/<study>)")
    parser.add_argument("--jobs", type=int, metavar="N", help="number of local processes (default: one per core)")
    parser.add_argument(
        "--shard", metavar="i/n", help="run only every n-th case, for job arrays; all shards need the same --out"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run on this Dask scheduler (address or scheduler file)")
    parser.add_argument(
        "--timeout", type=float, default=30.0, metavar="S", help="longest time without an answer from the scheduler"
    )
    parser.add_argument("--retry", action="store_true", help="run failed cases again")
    add_force(parser)


def run(options, console) -> int:
    """Run the cases of the study that have no row yet; exit code 1 if cases failed."""
    import os

    from dembrick.cli.paths import default_output
    from dembrick.errors import ScenarioError
    from dembrick.runs import study as studies
    from dembrick.runs.study.target import asks_for_causes

    if asks_for_causes(options.study):
        return _find_causes(options, console)
    if options.jobs is not None and options.jobs < 1:
        raise ScenarioError(f"--jobs = {options.jobs} is out of range: it must be at least 1")
    study = studies.load(options.study)
    outcome = studies.sweep(
        study,
        options.out or default_output(Path(options.study).stem),
        jobs=options.jobs or os.cpu_count() or 1,
        part=options.shard,
        scheduler=options.scheduler,
        timeout=options.timeout,
        retry=options.retry,
        force=options.force,
        progress=console.progress,
    )
    console.result(outcome.as_dict(), _text(study, outcome))
    if outcome.failed:
        console.error(
            f"{outcome.failed} of {outcome.finished} cases failed; the column 'error' of the table gives the reasons"
        )
        return 1
    return 0


def _find_causes(options, console) -> int:
    """Find which support has moved: print the answer, write its figure and its table; exit code 0."""
    from dembrick import history
    from dembrick.cli.paths import default_output, make_folder
    from dembrick.runs import causes
    from dembrick.runs.study import target
    from dembrick.scenario.files import inputs_of
    from dembrick.scenario.toml import text_of
    from dembrick.views import plot

    asked = target.read(options.study)
    folder = Path(options.out or default_output(Path(options.study).stem))
    make_folder(folder)
    figure, table = folder / "causes.png", folder / "causes.csv"
    product = "causes", [text_of(asked.scenario)], [options.study, *inputs_of(asked.scenario)], options.force
    with history.product(*product):
        history.check_output(figure)  # before the search
    found = causes.find(asked)
    panels = [plot.Motion(cause.title, cause.velocity, cause.opening) for cause in found.likely or found.causes[:1]]
    console.result(found.as_dict(), found.text())  # first, so that a write error loses nothing
    with history.product(*product):
        plot.save(plot.causes(found.assembly, found.judged == 1, panels), figure)
        found.write(table)
    console.remark(f"figure: {figure}")
    console.remark(f"table: {table}")
    return 0


def _answer(cell: dict, unit: str) -> str:
    """Text for V of a cell: of a single case as its run prints it, of several the mean and the scatter."""
    from dembrick.views.summary import known, limit_text, plain

    if cell["count"] == 1:
        one_path = {"digits_open": cell["digits_open"] == "true"}
        return plain(str(limit_text({"V": cell["mean"], **cell}, one_path, unit)))
    if cell["digits_open"]:
        return f"about {known(cell['mean'], None)} {unit}".rstrip() + f" (of these paths){_on_average(cell, unit)}"
    return _mean(cell, unit) + _on_average(cell, unit)


def _mean(cell: dict, unit: str) -> str:
    """Text for the mean of several cases with its error bar, which includes 95 % of the scatter."""
    from dembrick.views.summary import NO_BAR, known, plain, with_error

    if cell["mean_error"] is None:
        return f"{known(cell['mean'], cell['standard_error'])} {unit}".rstrip() + f" ({NO_BAR.partition(':')[0]})"
    return plain(with_error(cell["mean"], cell["mean_error"], unit))


def _on_average(cell: dict, unit: str) -> str:
    sure = " (95 %)" if cell["mean_error"] is not None and not cell.get("digits_open") else ""
    return f" on average of {cell['count']} cases{sure}, standard deviation {cell['deviation']:.4g} {unit}".rstrip()


def _text(study, outcome) -> str:
    from dembrick.runs.study.plan import scenario_of
    from dembrick.scenario.checks import show
    from dembrick.views.summary import barred

    unit = "N" if study.search is None and scenario_of(study, 0).actuators else ""
    lines = [
        study.title,
        f"cases         {outcome.finished} of {outcome.cases} done, {outcome.ran} in this run, {outcome.failed} failed",
        f"tables        {outcome.csv}, {outcome.h5}",
        f"time          {outcome.wall:.3g} s",
    ]
    for cell in outcome.statistics[:_MOST_LINES]:
        own = {key: value for key, value in cell.items() if key in study.keys}
        fixed = ", ".join(f"{key} = {value if isinstance(value, str) else show(value)}" for key, value in own.items())
        missing = f"  {cell['unanswered']} more without an answer" if cell["unanswered"] else ""
        if study.search is not None:
            half = cell["half_width"]
            if cell["count"] > 1:
                found = _mean(cell, "") + _on_average(cell, "")
            else:
                found = (
                    f"{cell['mean']:.5g} ({cell['remark']})"
                    if half is None
                    else " +- ".join(barred(cell["mean"], half))
                )
            lines.append(f"{'falls ' + cell['falls']:13} {study.search.key} = {found}  {fixed}".rstrip() + missing)
            continue
        lines.append(f"V             {_answer(cell, unit)}  {fixed}".rstrip() + missing)
    if len(outcome.statistics) > _MOST_LINES:
        lines.append(f"              and {len(outcome.statistics) - _MOST_LINES} more in the tables")
    return "\n".join(lines)
