"""The rows of a study on disk: written one by one while it runs, as one table at the end.

A study writes into its own folder. ``rows_I_of_N.jsonl`` (one per shard) gets a line for each finished case: a
kill loses at most the line being written, and finished cases are not run again. ``table.csv`` and ``table.h5``
are made from all these lines, in the order of the cases. The first line of every file names the study by its digest,
so that rows of another study are never mixed in.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import h5py
import numpy as np

from dembrick.errors import OutputError, WriteError
from dembrick.history.files import check_output, reason, replacing
from dembrick.history.hdf5_files import rewritten
from dembrick.history.products import refuse_inputs
from dembrick.runs.study.case import COLUMNS, TEXTS, UNANSWERED
from dembrick.scenario.checks import present

FORMAT = 1
TABLES = "table.csv", "table.h5"
_BATCH = 4096  # rows that are written to the tables at a time
_TEXT = h5py.string_dtype()


class Rows:
    """The row file of one shard of a study, open for appending; a context manager.

    With ``force``, rows of another study in the folder are removed."""

    def __init__(
        self,
        folder: str | os.PathLike,
        digest: str,
        cases: int,
        label: str = "1/1",
        columns: Sequence[str] = tuple(COLUMNS),
        force: bool = False,
    ):
        self._columns = columns
        self.folder = Path(folder)
        self._head = {"dembrick_study": FORMAT, "digest": digest, "cases": cases}
        self.path = self.folder / f"rows_{label.replace('/', '_of_')}.jsonl"
        check_output(self.path)
        for other in row_files(self.folder):
            if not _has_head(other, self._head):
                _remove_rows(other, force)
        self._file: TextIO | None = None

    def done(self, retry: bool = False) -> set[int]:
        """Numbers of the cases that have a row, in any shard's file; without the failed ones if ``retry``."""
        rows = stored(self.folder, self._columns)
        return {row["case"] for row in rows if not (retry and row["status"] in UNANSWERED)}

    def __enter__(self) -> Rows:
        fresh = not self.path.exists()
        if not fresh:
            _drop_torn_line(self.path)
        self._file = open(self.path, "a", encoding="utf-8")  # noqa: SIM115 - closed by __exit__
        if fresh or not self.path.stat().st_size:
            self._write(self._head)
        return self

    def append(self, rows: Iterable[dict]) -> None:
        """Add rows; they are passed to the operating system when this returns."""
        for row in rows:
            self._write(row)

    def _write(self, item: dict) -> None:
        try:
            file = present(self._file)
            file.write(json.dumps(item, allow_nan=False) + "\n")
            file.flush()
        except OSError as error:
            raise WriteError(
                f"{self.path}: writing failed ({reason(error)}); earlier rows are kept, and the same command "
                "continues from there"
            ) from error

    def __exit__(self, *_) -> None:
        present(self._file).close()


def row_files(folder: str | os.PathLike) -> list[Path]:
    """The row files in the folder of a study."""
    return sorted(Path(folder).glob("rows_*_of_*.jsonl"))


def refuse_read(folder: Path, inputs: Sequence[str]) -> None:
    """Raise OutputError if a table or rows of a study would replace a file that it reads."""
    for path in (*(folder / name for name in TABLES), *row_files(folder)):
        refuse_inputs(path, str(path), inputs)


def refuse_foreign(folder: Path) -> None:
    """Raise OutputError if a folder has tables but no rows, as something other than a study has written them."""
    for name in TABLES:
        path = folder / name
        if not row_files(folder) and path.exists() and path.stat().st_size:
            raise OutputError(
                f"{path}: this file exists without the rows of a study beside it; choose another --out, or --force "
                "replaces it"
            )


def stored(folder: str | os.PathLike, columns: Sequence[str] = tuple(COLUMNS)) -> Iterator[dict]:
    """The row of each case in the folder, in their order; ``columns``: those after the case and its keys.

    A line that a kill has truncated, or that is damaged otherwise, is left out, and its case is run again. If a case
    was run again after it had failed, perhaps in another shard, the row with an answer counts.
    """
    yield from _read(_order(Path(folder), columns))


def _rows_of(path: Path, columns: Sequence[str]) -> Iterator[tuple[int, dict]]:
    """The valid rows of a file, each with its offset."""
    with open(path, "rb") as file:
        head = file.readline()
        cases = (_parsed(head.decode("utf-8", "replace")) or {}).get("cases")
        offset = len(head)
        for line in file:
            row = _row(line.decode("utf-8", "replace"), columns)
            if row is not None and isinstance(cases, int) and row["case"] < cases:
                yield offset, row
            offset += len(line)


def _parsed(line: str) -> dict | None:
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return row if isinstance(row, dict) else None


def _row(line: str, columns: Sequence[str]) -> dict | None:
    """The row of a case; None if the line is damaged: without a case number or a column, or with a wrong type."""
    row = _parsed(line)
    if row is None or "\ufffd" in line or not row.keys() >= {"case", *columns[:2]}:
        return None
    case = row["case"]
    if not isinstance(case, int) or isinstance(case, bool) or case < 0 or not isinstance(row["status"], str):
        return None
    for name in columns:
        value, kind = row.get(name), str if name in TEXTS else int | float
        if value is not None and (not isinstance(value, kind) or isinstance(value, bool)):
            return None
    return None if "\\u" in line and not _storable(row) else row


def _storable(row: dict) -> bool:
    """Whether the texts of a row can be written: no null character, no lone surrogate."""
    try:
        return "\\u0000" not in json.dumps(row, ensure_ascii=False).encode().decode()
    except UnicodeEncodeError:
        return False


def _has_head(path: Path, head: dict) -> bool:
    """Whether a row file belongs to the study with this head; an empty one does to any."""
    with open(path, encoding="utf-8", errors="replace") as file:
        return path.stat().st_size == 0 or _parsed(file.readline()) == head


def _remove_rows(path: Path, force: bool) -> None:
    """Remove the rows of another study; raise OutputError without ``force``, WriteError if the system refuses."""
    if not force:
        raise OutputError(
            f"{path}: these are rows of another study (or the study, its base scenario or a file that they read has "
            "changed since); choose another --out, or --force replaces them"
        )
    try:
        path.unlink(missing_ok=True)  # another shard may have removed them
    except OSError as error:
        raise WriteError(f"{path}: the rows of another study cannot be removed ({reason(error)})") from error


def _drop_torn_line(path: Path) -> None:
    """Cut off a last line that has no line end."""
    with open(path, "rb+") as file:
        end = file.seek(0, os.SEEK_END)
        back = min(end, 1 << 20)
        file.seek(end - back)
        tail = file.read()
        file.truncate(end - back + tail.rfind(b"\n") + 1)


def write_tables(
    folder: str | os.PathLike, about: Mapping[str, str], keys: Sequence[str], columns: Sequence[str] = tuple(COLUMNS)
) -> tuple[Path, Path, int]:
    """Write ``table.csv`` and ``table.h5`` of the `stored` rows, the latter with texts ``about`` the study; return both
    paths and the number of rows."""
    folder = Path(folder)
    order = _order(folder, columns)
    names = ["case", *keys, *columns]
    csv_path, h5_path = (folder / name for name in TABLES)
    try:
        with replacing(str(csv_path)) as part, open(part, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            for row in _read(order):
                writer.writerow(["" if row.get(name) is None else _cell(row[name]) for name in names])
        with replacing(str(h5_path)) as part, rewritten(part) as (table, check):
            table.attrs.update({"format": FORMAT, "rows": len(order), **about})
            _write_columns(table, names, keys, order, check)
    except OSError as error:
        raise WriteError(
            f"{folder}: the tables could not be written ({reason(error)}); the rows of all cases are kept; repeat "
            "the command to write the tables"
        ) from error
    return csv_path, h5_path, len(order)


def _order(folder: Path, columns: Sequence[str]) -> list[tuple[Path, int]]:
    """Place of the row of each case (file, offset), in the order of the cases."""
    place: dict[int, tuple[bool, Path, int]] = {}
    for path in row_files(folder):
        for offset, row in _rows_of(path, columns):
            found = row["status"] not in UNANSWERED, path, offset
            if row["case"] not in place or found[0] >= place[row["case"]][0]:
                place[row["case"]] = found
    return [place[number][1:] for number in sorted(place)]


def _read(order: Iterable[tuple[Path, int]]) -> Iterator[dict]:
    files: dict[Path, Any] = {}
    try:
        for path, offset in order:
            if path not in files:
                files[path] = open(path, "rb")  # noqa: SIM115 - closed below
            files[path].seek(offset)
            yield json.loads(files[path].readline())
    finally:
        for file in files.values():
            file.close()


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value


def _write_columns(file, names: Sequence[str], keys: Sequence[str], order: list, check: Callable[[], None]) -> None:
    """Write a dataset per column: text, or float64 with NaN for a missing value; a key with a non-number is text."""
    numeric = {name: name not in TEXTS for name in names}
    for row in _read(order):
        for key in keys:
            if not isinstance(row.get(key), int | float) or isinstance(row.get(key), bool):
                numeric[key] = False
    for name in names:
        kind = "<i8" if name == "case" else "<f8" if numeric[name] else _TEXT
        data = file.create_dataset(
            name.replace("/", "_"), (len(order),), kind, chunks=(max(1, min(len(order), _BATCH)),)
        )
        data.attrs["description"] = f"changed key {name}" if name in keys else name.replace("_", " ")
    for start in range(0, len(order), _BATCH):
        rows = list(_read(order[start : start + _BATCH]))
        for name in names:
            values = [row.get(name) for row in rows]
            if numeric[name]:
                column = np.array([np.nan if value is None else value for value in values], float)
            else:
                column = np.array(["" if value is None else str(_cell(value)) for value in values], object)
            file[name.replace("/", "_")][start : start + len(rows)] = column
            check()
