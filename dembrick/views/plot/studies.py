"""Figures of studies: the answer of every case over the varied keys, from the table that a sweep writes."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from dembrick.errors import HistoryError, ScenarioError
from dembrick.history import guard
from dembrick.scenario import keys
from dembrick.scenario.checks import nearest, show
from dembrick.scenario.csv_tables import Table, read_table
from dembrick.scenario.support_controls import QUANTITIES
from dembrick.views import summary
from dembrick.views.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TABLE = "table.csv"
ANSWERS = ("value", "V", "collapse_load_factor", "greatest_displacement")  # default: the first that any case has
_LIMITS = ("V", "collapse_load_factor")
_LOADS = ("V", "V_lower", "V_upper", "V_peak", "theory", "associative")  # in the unit of the load
_UNITS = {
    "N": ("V_1", "V_2", "N"),
    "N m": ("M_T",),
    "m": ("displacement", "collapse_displacement", "greatest_displacement", "torsion_centre_1", "torsion_centre_2"),
    "-": ("collapse_load_factor", "error_vs_theory"),
    "deg": ("collapse_angle",),
    "s": ("loop",),
}
_FORMULATION = "joint.formulation"
_LAST_WORD = re.compile(r"[^.]*[^.\d][^.]*(\.\d+)*$")  # of a key, and the numbers after it
_MOST_LINES = 8  # in the legend of a panel; with more, the cases are drawn as unconnected points


class StudyTable(NamedTuple):
    """The table of a study: its ``path``, the varied ``keys``, the ``columns`` of answers, a row for each case that has
    one, the ``title``, and the ``quantity`` of the base motion of all cases; both are empty for a table on its own."""

    path: str
    keys: tuple[str, ...]
    columns: tuple[str, ...]
    rows: list[dict[str, str]]
    title: str = ""
    quantity: str = ""

    def numbers(self, name: str) -> list[float | None]:
        """A column as numbers, None if a cell holds none or the table has no such column."""
        return [_number(row.get(name, "")) for row in self.rows]


def is_study(path: str | os.PathLike) -> bool:
    """Whether a path is that of the table or the folder of a study."""
    return Path(path).suffix.lower() == ".csv" or os.path.isdir(path)


def read_study(path: str | os.PathLike) -> StudyTable:
    """Read the table of a sweep from STUDY/table.csv or the folder STUDY; ScenarioError if it is no such table."""
    path = Path(path) / TABLE if os.path.isdir(path) else Path(path)
    table: Table = read_table(path, "the table of a study")
    titles = table.titles
    if titles[:1] != ("case",) or "status" not in titles:
        raise ScenarioError(f"{path}: this is not the table of a study; 'dembrick sweep' writes table.csv")
    rows = [dict(zip(titles, cells, strict=True)) for _, cells in table.lines]
    sound = [row for row in rows if row["status"] not in ("failed", "undecided")]
    if not sound:
        raise ScenarioError(f"{path}: no case of this study has an answer; its column 'error' gives the reasons")
    place = titles.index("status")
    return StudyTable(str(path), titles[1:place], titles[place:], sound, *_about(path))


def _about(path: Path) -> list[str]:
    """The title of the study and the quantity of its base motion, from the ``table.h5`` beside its table."""
    try:
        with guard.open_file(path.with_name("table.h5")) as file:
            found = [guard.attribute(file, name) for name in ("title", "quantity")]
    except HistoryError:
        return ["", ""]
    return [own if isinstance(own, str) else "" for own in found]


def study(table: StudyTable, answer: str | None = None, over: Sequence[str] = ()) -> Figure:
    """The ``answer`` of every case over each varied key, one panel per key (or only those in ``over``).

    Cases that differ in the key of the panel only are joined by a line. Error bars: ``half_width`` of a search, V_lower
    and V_upper of a limit load. ScenarioError for columns that the table does not have.
    """
    answer = _answer(table, answer)
    for key in over:
        if key not in table.keys:
            raise ScenarioError(f"{table.path}: no key {show(key)} varies in this study; {nearest(key, table.keys)}")
    panels = list(over) or [key for key in table.keys if len({row[key] for row in table.rows}) > 1]
    if not panels:
        raise ScenarioError(f"{table.path}: no key varies in this study, so there is nothing to draw its answer over")
    with style.settings():
        figure = style.new_figure((max(5.2, 3.4 * len(panels)), 4.0))
        for axes, key in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            _panel(axes, table, answer, key)
            if axes.get_legend_handles_labels()[1]:
                axes.legend(loc="best")
        if table.title:
            figure.suptitle(style.wrapped(style.plain(table.title), 60 * len(panels)), fontsize=9)
    return figure


def _answer(table: StudyTable, answer: str | None) -> str:
    if answer is not None:
        if answer not in table.columns:
            raise ScenarioError(f"{table.path}: there is no column {show(answer)}; {nearest(answer, table.columns)}")
        if not any(value is not None for value in table.numbers(answer)):
            raise ScenarioError(f"{table.path}: the column {show(answer)} holds no numbers; choose another")
        return answer
    for name in ANSWERS:
        if name in table.columns and any(value is not None for value in table.numbers(name)):
            return name
    raise ScenarioError(f"{table.path}: no column of answers holds numbers; choose one of {', '.join(table.columns)}")


def _panel(axes: Axes, table: StudyTable, answer: str, key: str) -> None:
    """Draw one panel: a line for each combination of the other varied keys."""
    others = [name for name in table.keys if name != key and len({row[name] for row in table.rows}) > 1]
    lines: dict[tuple[str, ...], list[int]] = {}
    for i, row in enumerate(table.rows):
        lines.setdefault(tuple(row[name] for name in others), []).append(i)
    x, numeric = _places(table, key)
    axis = _axis(table, answer)
    y, bars = axis.shown(table.numbers(answer)), _bars(table, answer, axis)
    if len(lines) > _MOST_LINES or all(len(line) == 1 for line in lines.values()):
        lines, others = {(): list(range(len(table.rows)))}, []
        joined = False
    else:
        joined = numeric
    if key == _FORMULATION and not others:
        names = [row[key] for row in table.rows]
        lines = {(name,): [i for i, own in enumerate(names) if own == name] for name in dict.fromkeys(names)}
    for i, (values, line) in enumerate(lines.items()):
        colour, dashes, marker = _look(others or [key], values, i)
        shown = sorted((j for j in line if y[j] is not None), key=lambda j: x[j])
        label = ", ".join(f"{name} {value}" for name, value in zip(_short(others), values, strict=False))
        error = None if bars is None else [[bars[j][side] for j in shown] for side in (0, 1)]
        axes.errorbar([x[j] for j in shown], [y[j] for j in shown], error, color=colour, marker=marker, capsize=2.5,
                      ls=dashes if joined else "none", label=style.plain(label) if label else None)  # fmt: skip
    limits = [j for j in range(len(table.rows)) if y[j] is not None and answer in _LIMITS]
    for mark, found, bar in (
        ("o", _path_dependence_unknown, "to the bound of all paths"),
        ("s", _on_several, "what was found"),
    ):
        some = [j for j in limits if found(table, j)]
        if some:
            told = f"; bar: {bar}" if bars is not None and any(max(bars[j]) > 0.0 for j in some) else ""
            axes.plot([x[j] for j in some], [y[j] for j in some], ls="none", marker=mark, mfc="white", mec=style.BLACK,
                      zorder=4, label=f"depends on the load path{told}")  # fmt: skip
    no_end = [j for j in limits if table.rows[j].get("bracket") == "open"]
    for j in no_end:
        style.upwards(axes, (x[j], y[j]), "data", style.GREY)
    if no_end:
        axes.plot([], [], ls="none", marker=r"$\uparrow$", color=style.GREY, ms=9, label="no upper bound")
    if not numeric:
        names = list(dict.fromkeys(row[key] for row in table.rows))
        axes.set_xticks(range(len(names)), [style.plain(name) for name in names])
    axes.set_xlabel(style.plain(_with_unit(key, unit_of(key, table.quantity) if numeric else "")))
    axes.set_ylabel(_with_unit(axis.name, axis.unit))


def _places(table: StudyTable, key: str) -> tuple[list[float], bool]:
    """Positions of the cases along the axis of a key, and whether they are its numbers, not the ranks of its texts."""
    found = table.numbers(key)
    if all(value is not None for value in found):
        return [value for value in found if value is not None], True
    order = {name: float(i) for i, name in enumerate(dict.fromkeys(row[key] for row in table.rows))}
    return [order[row[key]] for row in table.rows], False


def _short(keys_: Sequence[str]) -> list[str]:
    """The ends of keys, from their last word on, where these tell them apart."""
    ends = [_LAST_WORD.search(key) for key in keys_]
    found = [key if end is None else end[0] for key, end in zip(keys_, ends, strict=True)]
    return found if len(set(found)) == len(found) else list(keys_)


def _look(others: Sequence[str], values: Sequence[str], number: int) -> tuple:
    """Colour, line style and marker of a line: those of the formulation if the lines differ in it."""
    named = dict(zip(others, values, strict=False))
    own = style.FORMULATION.get(named.get(_FORMULATION, ""))
    return own if own and len(named) == 1 else style.look(number)


class _Axis(NamedTuple):
    """The axis of an answer: its ``name``, its ``unit``, and the ``factor`` from numbers of the table to it. If it
    ``tilts``, these are tangents of angles, and the angles are shown in degrees."""

    name: str
    unit: str
    factor: float = 1.0
    tilts: bool = False

    def shown(self, values: Sequence[float | None]) -> list[float | None]:
        return [None if value is None else self._one(value) for value in values]

    def _one(self, value: float) -> float:
        return math.degrees(math.atan(value)) if self.tilts else self.factor * value


def _axis(table: StudyTable, answer: str) -> _Axis:
    """The axis of an answer, with a suitable unit."""
    searched = table.rows[0].get("searched") if answer == "value" else None
    if searched:
        return _Axis(style.plain(f"{searched} at collapse"), unit_of(searched, table.quantity))
    if answer in _LIMITS and _tilts(table):
        return _Axis(r"table angle $\theta$ at the limit", "deg", tilts=True)
    unit = next((u for u, c in _UNITS.items() if answer in c), "")
    if answer in _LOADS:
        unit = _unit_of_loads(table)
    largest = max((abs(value) for value in table.numbers(answer) if value is not None), default=0.0)
    name, factor = summary.travel_unit(largest) if unit == "m" else summary.load_unit(largest, unit)
    said = "load factor V" if answer == "V" and unit == "-" else answer.replace("_", " ")
    return _Axis(style.plain(said), name, factor)


def _unit_of_loads(table: StudyTable) -> str:
    """The unit that all cases have their loads in, empty where they have several; of a table that does not tell it, "-"
    if it has collapse load factors."""
    units = {row.get("load_unit", "") for row in table.rows} - {""}
    if not units:
        return "-" if any(factor is not None for factor in table.numbers("collapse_load_factor")) else "N"
    return {"1": "-"}.get(own := units.pop(), own) if len(units) == 1 else ""


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def unit_of(key: str, quantity: str = "") -> str:
    """The unit of a scenario key in the notation of studies (``joint.friction``, ``walls.house.block.1``); "-" for a
    dimensionless number, empty if there is none. The amplitude of a base motion has the unit of its ``quantity``, that
    of a load is a factor."""
    parts = [part.partition("[")[0] for part in key.split(".") if not part.isdecimal()] or [""]
    first, last = parts[0] if len(parts) > 1 else "", parts[-1]
    if last == "amplitude":
        return QUANTITIES.get(quantity, "") if first == "control" else "-"
    told = {heading.strip("[]{} =").split(".")[0].split("]")[0]: table for heading, table in keys.tables().items()}
    of_controls = [table for heading, table in keys.tables().items() if heading.startswith("[control]")]
    inner = [table for name, table in told.items() if name in key.split(".")[1:]]
    for table in (*inner, *(of_controls if first == "control" else [told[first]] if first in told else ())):
        found = keys.keys_of(table).get(last)
        if found is not None:
            return {"1": "-"}.get(found.unit, found.unit)
    return ""


def _bars(table: StudyTable, answer: str, axis: _Axis) -> list[tuple[float, float]] | None:
    """Error bars (below, above) of an answer; None if it has none."""
    values = table.numbers(answer)
    if answer == "value":
        return [(width or 0.0,) * 2 for width in table.numbers("half_width")]
    if answer != "V":
        return None
    bounds = table.numbers("associative") if "associative" in table.columns else [None] * len(values)
    bars = []
    for j, ends in enumerate(zip(values, table.numbers("V_lower"), table.numbers("V_upper"), bounds, strict=True)):
        V, low, high, bound = ends
        if V is None:
            bars.append((0.0, 0.0))
            continue
        if _path_dependence_unknown(table, j):  # its bracket holds for that path only
            low, high = None, bound
        middle, below, above = axis.shown([V, V if low is None else low, V if high is None else high])
        bars.append((max(0.0, middle - below), max(0.0, above - middle)))
    return bars


def _path_dependence_unknown(table: StudyTable, row: int) -> bool:
    """Whether a limit load depends on the path by an unknown amount."""
    return table.rows[row].get("digits_open") == "true"


def _on_several(table: StudyTable, row: int) -> bool:
    """Whether a limit load depends on the path by an amount shown by its bar: the load wanders, or was refined."""
    return table.rows[row].get("path_dependent") == "true" and not _path_dependence_unknown(table, row)


def _tilts(table: StudyTable) -> bool:
    """Whether the cases are tilting tables."""
    return "collapse_angle" in table.columns and any(angle is not None for angle in table.numbers("collapse_angle"))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
