"""Studies: one scenario with keys that change from case to case, run in parallel, with one table of results.

``sweep(study)`` runs the cases that are still missing and writes ``table.csv`` and ``table.h5``.
"""

from __future__ import annotations

import itertools
import math
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean, stdev

from dembrick.errors import OutputError
from dembrick.runs.fit import CONFIDENCE, student
from dembrick.runs.study.case import UNANSWERED, run_cases
from dembrick.runs.study.executors import run_here, run_local, run_on_cluster
from dembrick.runs.study.plan import Study, load, scenario_of, shard
from dembrick.runs.study.search import run_searches
from dembrick.runs.study.table import Rows, refuse_foreign, refuse_read, stored, write_tables
from dembrick.simulation.expected_cost import duration
from dembrick.simulation.interrupts import Interrupted

__all__ = ["Outcome", "Study", "load", "scenario_of", "sweep"]

_CHUNK = 64  # most cases sent to a worker at a time
_COMPILED_BY = ("joint.formulation", "joint.pressure", "control.kind")  # keys that decide which kernels are compiled


@dataclass(frozen=True)
class Outcome:
    """Outcome of a sweep: how many ``cases`` the study has, how many of them this call ``ran``, how many have their row
    (``finished``) and how many ``failed``; the paths of the tables (``csv``, ``h5``), and the ``wall`` time (s).

    ``statistics``: a row for each combination of the keys that are not drawn at random, with the number of cases that
    gave a V (of a search: a value), its mean, its standard deviation and the standard error of the mean;
    ``half_width``, the mean half-width of the brackets, and how many cases have no answer (``unanswered``). For several
    cases ``mean_error`` is the error of the mean: that half-width plus the 95 % error by the scatter of the draws
    (Student's t); None if a bracket is open. ``digits_open``: whether a V depends on the path by an unknown amount.
    """

    cases: int
    ran: int
    finished: int
    failed: int
    csv: str
    h5: str
    statistics: list[dict]
    wall: float

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick sweep --json``."""
        return dict(self.__dict__)


def sweep(
    study: Study | str | os.PathLike,
    folder: str | os.PathLike,
    *,
    jobs: int = 1,
    part: str | None = None,
    scheduler: str | None = None,
    timeout: float = 30.0,
    retry: bool = False,
    force: bool = False,
    progress: Callable[[int, int, str], None] | None = None,
) -> Outcome:
    """Run the cases of a study that have no row in ``folder`` yet, and write the tables of all that have.

    ``jobs`` local processes, or a Dask ``scheduler`` (address or file) that must answer within ``timeout`` seconds.
    ``part`` "i/n" runs every n-th case only; the shards may share the folder. ``retry`` runs failed cases again.
    ``force``: rows of another study and foreign tables in the folder are replaced.

    Raises ScenarioError for an invalid study, OutputError without ``force`` for a folder with rows of another study or
    with foreign tables, ClusterError for a scheduler that does not answer. A case that fails gets a row with its error,
    and the other cases are run.
    """
    began = time.perf_counter()
    study = study if isinstance(study, Study) else load(study)
    numbers, label = shard(len(study), part)
    folder = Path(folder)
    _make(folder)
    refuse_read(folder, study.reads)
    if not force:
        refuse_foreign(folder)
    if study.histories:
        _make(folder / "histories")
    rows = Rows(folder, study.digest, len(study), label, study.columns, force)
    done = rows.done(retry)
    todo = [number for number in numbers if number not in done]
    ran = 0
    if progress and todo:
        progress(0, len(todo), "cases")
    try:
        with rows:
            for finished in _run(study, folder, todo, jobs, scheduler, timeout):
                rows.append(finished)
                ran += len(finished)
                if progress:
                    left = (time.perf_counter() - began) / ran * (len(todo) - ran)
                    progress(ran, len(todo), f"cases, {duration(left)} left")
    except Interrupted as stopped:
        kept = f"{len(done) + ran} of {len(study)} cases are recorded in {folder}; repeat the command to continue"
        raise Interrupted(stopped.signum, f"interrupted: {kept}") from None
    about = {"digest": study.digest, "title": study.title, "quantity": study.quantity}
    csv_path, h5_path, total = write_tables(folder, about, study.keys, study.columns)
    statistics, failed = _statistics(study, folder)
    wall = time.perf_counter() - began
    return Outcome(len(study), ran, total, failed, str(csv_path), str(h5_path), statistics, wall)


def _run(study: Study, folder: Path, todo: list[int], jobs: int, scheduler, timeout) -> Iterator[list[dict]]:
    def case(number: int) -> tuple:
        history = str(folder / "histories" / f"case_{number:06d}.h5") if study.histories else None
        return number, study.changes(number), history

    def chunks(numbers, size):
        numbers = iter(numbers)
        while part := list(itertools.islice(numbers, size)):
            yield [case(number) for number in part]

    run, most = run_cases, _CHUNK
    if study.search is not None:
        run, most = partial(run_searches, study.search), 1  # a case has many runs
    base = (study.base, study.base_path)
    if jobs == 1 and scheduler is None:
        yield from run_here(run, chunks(todo, most), *base)
        return
    # Processes that fill a cold cache of compiled code together can crash one another: this one fills it first.
    first = _first_of_each_kind(study, todo)
    yield from run_here(run, chunks(first, 1), *base)
    rest = [number for number in todo if number not in set(first)]
    size = max(1, min(most, math.ceil(len(rest) / (4 * max(jobs, 1)))))
    if scheduler is not None:
        yield from run_on_cluster(run, chunks(rest, size), scheduler, timeout, *base)
    else:
        yield from run_local(run, chunks(rest, size), jobs, *base)


def _first_of_each_kind(study: Study, todo: list[int]) -> list[int]:
    """One case for every combination of the keys that decide which kernels are compiled."""
    varying = [key for key in study.keys if key in _COMPILED_BY]
    seen: dict[str, int] = {}
    for number in todo if varying else todo[:1]:
        changes = study.changes(number)
        seen.setdefault(repr([changes[key] for key in varying]), number)
    return list(seen.values())


BAR = ("V_lower", "V_upper", "bracket", "digits_open", "half_width")  # columns of the error bar of an answer
_OF_SEARCHES = ("stands", "falls", "remark")


def _statistics(study: Study, folder: Path) -> tuple[list[dict], int]:
    """Mean and scatter of the answers over the draws of each population, and how many cases have none."""
    cells: dict[str, tuple[dict, list, list]] = {}
    unanswered: Counter[str] = Counter()
    rows = stored(folder, study.columns)
    wanted = ("status", study.answer, *BAR, *_OF_SEARCHES)
    found = {row["case"]: {name: row.get(name) for name in wanted} for row in rows}
    for case, row in found.items():
        fixed = study.cell(case)
        if row[study.answer] is None or row["status"] in UNANSWERED:
            unanswered[repr(fixed)] += 1
        else:
            _, answers, bars = cells.setdefault(repr(fixed), (fixed, [], []))
            answers.append(row[study.answer])
            bars.append({name: row[name] for name in (*BAR, *_OF_SEARCHES)})
    statistics = []
    for key, (fixed, answers, bars) in cells.items():
        deviation = stdev(answers) if len(answers) > 1 else None
        error = None if deviation is None else deviation / math.sqrt(len(answers))
        widths = [_half_width(one, answer) for one, answer in zip(bars, answers, strict=True)]
        closed = [width for width in widths if width is not None]
        half = fmean(closed) if len(closed) == len(widths) else None
        bar: dict = {"half_width": half}
        if study.search is not None:
            below = {one["falls"] < one["stands"] for one in bars}
            falls = "at" if len(below) > 1 else "below" if True in below else "above"
            bar |= {"falls": falls, "remark": bars[0]["remark"]}
        elif len(bars) == 1:
            bar = {name: bars[0][name] for name in BAR if name != "half_width"}
        else:
            bar["digits_open"] = any(one["digits_open"] in (True, "true") for one in bars)
        if error is not None:
            scatter = student(CONFIDENCE, len(answers) - 1) * error
            bar["mean_error"] = None if half is None else half + scatter
        numbers = {"count": len(answers), "mean": fmean(answers), "deviation": deviation, "standard_error": error}
        statistics.append({**fixed, **numbers, **bar, "unanswered": unanswered[key]})
    return statistics, sum(row["status"] in UNANSWERED for row in found.values())


def _half_width(bar: dict, answer: float) -> float | None:
    """Error of an answer by its bracket; None if that is open."""
    if bar["half_width"] is not None:
        return bar["half_width"]
    lower, upper = bar["V_lower"], bar["V_upper"]
    return None if lower is None or upper is None else max(upper - answer, answer - lower)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except FileNotFoundError:
        raise OutputError(f"{folder}: its parent folder does not exist; make it first or choose another path") from None
    except OSError as error:
        raise OutputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another path") from None
