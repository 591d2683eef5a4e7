"""Reader of all CSV files: motions of supports, load histories, laboratory curves, measured yield points, studies.

The first line that is not a comment (``#``) names the columns, with their units in brackets::

    time [s], acceleration [g]
    0.00, 0.000
    0.01, 0.012

The delimiter is a comma, semicolon or tab, whichever the first line uses. With semicolons or tabs, a decimal comma is
allowed; numbers that may contain thousands separators are refused. Byte order marks, both kinds of line ends and empty
lines are accepted. Every column of numbers states its unit, ``[mm]`` or ``(mm)``: see `units`. A column is found by its
unit, and by its name where several have a suitable unit. Records of the PEER database (``.AT2``, ``.VT2``, ``.DT2``)
are read too.
"""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario import units
from dembrick.scenario.checks import nearest, present, show
from dembrick.scenario.text_files import read_text

PEER = {".at2": "acceleration", ".vt2": "velocity", ".dt2": "displacement"}  # suffixes of PEER records
_TITLE = re.compile(r"\s*(.*?)\s*(?:\[\s*([^\[\]]*?)\s*\]|\(\s*([^()]*?)\s*\))?\s*", re.DOTALL)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?")
_WITH_MARK = re.compile(r"\s*[-+]?\d*([.,])\d+(?:[eE][-+]?\d+)?\s*")  # a number with a decimal point or comma
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}[.,]\d{3}")  # thousands, or a number with three decimals
_ALSO = {"time": "t", "force": "load"}  # alternative names of columns
_EXAMPLES = {"time": "time [s]", "displacement": "displacement [mm]", "velocity": "velocity [m/s]",
             "acceleration": "acceleration [m/s2]", "force": "force [N]", "factor": "factor [1]"}  # fmt: skip


@dataclass(frozen=True)
class Table:
    """A CSV file as text: ``titles`` of the columns, and the other lines as (line number, cells)."""

    path: str
    titles: tuple[str, ...]
    lines: tuple[tuple[int, tuple[str, ...]], ...]
    decimal_comma: bool

    def number(self, line: int, title: str, cell: str) -> float:
        """Convert a cell to a finite float; a ScenarioError names the line and the column."""
        text = cell.strip()
        if self.decimal_comma:
            text = text.replace(",", ".")
        try:
            value = math.nan if "_" in text else float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            what = show(name_of(title))
            raise ScenarioError(
                f"{self.path}, line {line}: {show(cell.strip())} in column {what} is not a finite number"
            )
        return value


def read_table(path: str | os.PathLike, what: str) -> Table:
    """Read the cells of a CSV file, called ``what`` in messages ("a measured curve"). ScenarioError names the line."""
    path = os.fsdecode(path)
    text = read_text(path, f"{what} (CSV)")
    titles: tuple[str, ...] = ()
    lines, divider = [], ","
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if not titles:
            divider = next((sign for sign in ("\t", ";") if sign in line), ",")
            titles = _cells(path, number, line, divider)
            continue
        cells = _cells(path, number, line, divider)
        if not any(cell.strip() for cell in cells):
            continue  # an empty line as spreadsheets write it
        if len(cells) != len(titles):
            commas = divider == "," and len(cells) > len(titles) and "." not in line
            remedy = "; with decimal commas, separate the columns by semicolons" if commas else ""
            raise ScenarioError(f"{path}, line {number}: {len(cells)} values for {len(titles)} columns{remedy}")
        lines.append((number, cells))
    if not titles:
        raise ScenarioError(f"{path}: the file is empty; {what} begins with a line that names its columns")
    if divider != "," and "," in text:
        _check_decimals(path, lines)
    return Table(path, titles, tuple(lines), divider != ",")


def _check_decimals(path: str, lines: Sequence[tuple[int, tuple[str, ...]]]) -> None:
    """Raise a ScenarioError if all commas may be thousands separators, or all points beside decimal commas."""
    seen: dict[str, list[tuple[int, str]]] = {",": [], ".": []}
    for number, cells in lines:
        for cell in cells:
            if found := _WITH_MARK.fullmatch(cell):
                seen[found[1]].append((number, cell.strip()))
    for mark, other in ((",", "."), (".", ",")):
        if not seen[mark] or (mark == "." and not seen[other]):
            continue
        if all(_THOUSANDS.fullmatch(cell) for _, cell in seen[mark]):
            line, cell = seen[mark][0]
            raise ScenarioError(
                f"{path}, line {line}: {cell} may mean {cell.replace(mark, '')} or {cell.replace(mark, '.')}; "
                "write decimal points, and no thousands separators"
            )


def _cells(path: str, number: int, line: str, divider: str) -> tuple[str, ...]:
    """Split one line into cells; a quoted cell cannot span lines."""
    if '"' not in line:
        return tuple(line.split(divider))
    try:
        return tuple(next(csv.reader([line], delimiter=divider, strict=True, skipinitialspace=True)))
    except csv.Error as error:
        raise ScenarioError(f"{path}, line {number}: {error}") from None


def name_of(title: str) -> str:
    """Name in the title of a column, without the unit."""
    return _parts(title)[0]


def _parts(title: str) -> tuple[str, str | None]:
    """Name and unit of a column; the unit is None if there is none."""
    name, square, round_ = present(_TITLE.fullmatch(title)).groups()
    return name, square if square is not None else round_


def read_columns(
    path: str | os.PathLike, what: str, quantities: Sequence[str], columns: Sequence[str] | None = None
) -> tuple[dict[str, np.ndarray], list[int]]:
    """Read one column for each of the ``quantities`` (of `units.UNITS`), in SI, and the line numbers of its values.

    ``columns`` picks them by name, in the order of the quantities; otherwise a column is found by its unit. Raises a
    ScenarioError that names the line and says what to write, also for a single line of numbers.
    """
    path = os.fsdecode(path)
    ending = os.path.splitext(path)[1].lower()
    if ending in PEER:
        found, numbers = _read_peer(path, what, quantities)
    else:
        table = read_table(path, what)
        places = _places(table, quantities, columns)
        found = {
            quantity: np.array([size * table.number(k, table.titles[i], cells[i]) for k, cells in table.lines])
            for quantity, (i, size) in places.items()
        }
        numbers = [number for number, _ in table.lines]
    if len(numbers) < 2:
        raise ScenarioError(f"{path}: {what} needs at least 2 lines of numbers below its header")
    return found, numbers


def example(quantities: Sequence[str]) -> str:
    """Example of a correct header, for a message."""
    return f'write a first line such as "{", ".join(_EXAMPLES[quantity] for quantity in quantities)}"'


def _places(table: Table, quantities: Sequence[str], columns: Sequence[str] | None) -> dict[str, tuple[int, float]]:
    """For each quantity, the number of its column and the factor of its unit to SI."""
    parts = [_parts(title) for title in table.titles]
    names = [name for name, _ in parts]
    if columns is not None:
        if len(columns) != len(quantities):
            wanted = ", ".join(quantities)
            raise ScenarioError(f"{table.path}: columns = {show(list(columns))} must name {len(quantities)}: {wanted}")
        return {
            quantity: _picked(table, parts, quantity, name) for quantity, name in zip(quantities, columns, strict=True)
        }
    places = {}
    for quantity in quantities:
        sizes = {
            i: size
            for i, (_, unit) in enumerate(parts)
            if unit is not None and (size := units.size_of(quantity, unit)) is not None
        }
        fitting = list(sizes)
        called = [i for i, name in enumerate(names) if name.lower() in (quantity, _ALSO.get(quantity))]
        if called and not any(i in sizes for i in called):
            other = next((i for i in called if parts[i][1] is not None and _is_unit(present(parts[i][1]))), None)
            if other is not None:  # a column of that name has a unit of another quantity
                raise ScenarioError(_unfit(table, *parts[other], quantity))
        if len(fitting) > 1:
            named = [i for i in fitting if i in called]
            if len(named) != 1:
                both = ", ".join(show(names[i]) for i in fitting)
                raise ScenarioError(
                    f"{table.path}: the columns {both} all have a unit of {quantity}; call one {quantity!r}, "
                    "or pick it by columns = [...] in the scenario"
                )
            fitting = named
        if not fitting:
            raise ScenarioError(_missing(table, parts, quantity, quantities))
        (i,) = fitting
        places[quantity] = i, sizes[i]
    return places


def _missing(table: Table, parts: Sequence[tuple[str, str | None]], quantity: str, quantities: Sequence[str]) -> str:
    """Message that no column has a unit of the quantity, with what to write."""
    if all(_NUMBER.fullmatch(title.strip()) for title in table.titles):
        return f"{table.path}: the first line must name the columns and their units; {example(quantities)}"
    named = [i for i, (name, _) in enumerate(parts) if _stem(name) == _stem(quantity)]
    others = [i for i, (_, unit) in enumerate(parts) if unit is None or not _is_unit(unit)]
    suspect = (named or (others if len(others) == 1 else []))[:1]
    for i in suspect:
        name, unit = parts[i]
        if unit is None:
            return (
                f"{table.path}: the column {show(name)} has no unit; write it in brackets, as in "
                f"{_EXAMPLES[quantity]!r}; known units: {units.known(quantity)}"
            )
        if not _is_unit(unit):
            return (
                f"{table.path}: the unit {show(unit)} of the column {show(name)} is unknown; write one of "
                f"{units.known(quantity)}"
            )
    have = ", ".join(show(title.strip()) for title in table.titles)
    return (
        f"{table.path}: no column has a unit of {quantity} ({units.known(quantity)}), the columns are {have}; "
        f"{example(quantities)}"
    )


def _stem(name: str) -> str:
    """Common beginning of the names of a quantity: that of "acc", "Acceleration x" and "acceleration" is the same."""
    name = name.strip().lower()
    return next((quantity for quantity, other in _ALSO.items() if name == other), name)[:3]


def _is_unit(unit: str) -> bool:
    return any(units.size_of(quantity, unit) is not None for quantity in units.UNITS)


def _picked(table: Table, parts: Sequence[tuple[str, str | None]], quantity: str, name: str) -> tuple[int, float]:
    """Find the column of that name, given with or without unit; its unit must fit the quantity."""
    names = [own for own, _ in parts]
    found = [i for i, own in enumerate(names) if name.strip() in (own, table.titles[i].strip())]
    if not found:
        raise ScenarioError(f"{table.path}: there is no column {show(name)}; {nearest(name, names)}")
    if len(found) > 1:
        raise ScenarioError(f"{table.path}: two columns are called {show(name)}; give each its own name")
    (i,) = found
    unit = parts[i][1]
    size = None if unit is None else units.size_of(quantity, unit)
    if size is None:
        raise ScenarioError(_unfit(table, name, unit, quantity))
    return i, size


def _unfit(table: Table, name: str, unit: str | None, quantity: str) -> str:
    """Message about a column whose unit does not fit the quantity."""
    state = "has no unit" if unit is None else f"has the unit {show(unit)}, which is not one of {quantity}"
    return (
        f"{table.path}: the column {show(name)} {state}; write one of {units.known(quantity)} in brackets after its "
        f"name, as in {_EXAMPLES[quantity]!r}"
    )


def cells_by_name(
    table: Table, known: Mapping[str, bool], forces: Sequence[str], hint: str = ""
) -> dict[str, tuple[int, float]]:
    """Find the columns of a table of texts and numbers by name: (number, factor of its unit to SI).

    ``known``: allowed names, and whether each is required; those in ``forces`` have a unit of force. ``hint``: end of
    the message about other names.
    """
    columns: dict[str, tuple[int, float]] = {}
    for i, title in enumerate(table.titles):
        name, unit = _parts(title)
        if name not in known:
            raise ScenarioError(f"{table.path}: unknown column {show(title.strip())}; {nearest(name, known)}{hint}")
        if name in columns:
            raise ScenarioError(f"{table.path}: two columns are called {show(name)}")
        size = 1.0
        if name in forces:
            found = None if unit is None else units.size_of("force", unit)
            if found is None:
                raise ScenarioError(
                    f"{table.path}: column {show(title.strip())} needs its unit in the header: "
                    f"{' or '.join(repr(f'{name} [{one}]') for one in units.UNITS['force'])}"
                )
            size = found
        columns[name] = i, size
    for name, required in known.items():
        if required and name not in columns:
            header = ",".join(f"{key} [N]" if key in forces else key for key, needed in known.items() if needed)
            raise ScenarioError(f"{table.path}: there is no column {show(name)}; the header is {header}")
    return columns


def _read_peer(path: str, what: str, quantities: Sequence[str]) -> tuple[dict[str, np.ndarray], list[int]]:
    """Read a record of the PEER database: four header lines, the third with the unit, the fourth with the number of
    values and their time step in seconds, then the values."""
    lines = read_text(path, f"{what} (PEER record)").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if len(lines) < 5:
        raise ScenarioError(f"{path}: a PEER record has four lines of header and its values below them")
    unit = re.search(r"UNITS\s+OF\s+([A-Za-z/0-9]+)", lines[2], re.IGNORECASE)
    if unit is None:
        raise ScenarioError(f"{path}, line 3: a PEER record states its unit here, as in 'IN UNITS OF G'")
    spelled = unit.group(1).lower().replace("sec", "s")
    quantity = next((one for one in units.UNITS if units.size_of(one, spelled) is not None), None)
    if quantity is None or quantity not in quantities:
        read = f"of {quantity} ({unit.group(1)})" if quantity else f"in the unit {show(unit.group(1))}"
        wanted = " or ".join(one for one in quantities if one != "time")
        raise ScenarioError(f"{path}, line 3: the record is {read}, but {wanted} is needed: see control.quantity")
    size = present(units.size_of(quantity, spelled))
    counted = re.search(r"NPTS\s*=\s*(\d+)\s*,?\s*DT\s*=\s*([0-9.eE+-]+)", lines[3], re.IGNORECASE)
    counted = counted or re.match(r"\s*(\d+)\s+([0-9.eE+-]+)\s+NPTS", lines[3], re.IGNORECASE)
    try:
        count, step = (int(counted[1]), float(counted[2].rstrip("."))) if counted else (0, 0.0)
    except ValueError:
        count, step = 0, 0.0
    if not (0 < count <= 100_000_000 and 0.0 < step < math.inf):
        raise ScenarioError(
            f"{path}, line 4: a PEER record states NPTS= and DT= here, as in 'NPTS= 7807, DT= .0050 SEC'"
        )
    values, numbers = [], []
    for number, line in enumerate(lines[4:], 5):
        if _NUMBER.sub("", line).strip():
            raise ScenarioError(f"{path}, line {number}: {show(line.strip())} is not a line of numbers")
        found = [float(text.lower().replace("d", "e")) for text in _NUMBER.findall(line)]
        values += found
        numbers += [number] * len(found)
    if len(values) != count or not np.isfinite(values).all():
        raise ScenarioError(f"{path}: {len(values)} values where line 4 says NPTS= {count}; the record is incomplete")
    return {"time": step * np.arange(count), quantity: size * np.array(values)}, numbers
