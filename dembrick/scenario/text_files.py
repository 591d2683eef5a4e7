"""Text files that a user names: read whole, limited in size, regular files only; and line numbers for messages.

A scenario may come from a stranger and may name any path: endless devices, pipes without a writer and files of
gigabytes are refused before they are read.

The TOML library reports no positions of tables and keys. Headers and keys are found here line by line; for a table in
another notation (inline, or with dotted keys) no line is found, and the message contains none.
"""

from __future__ import annotations

import os
import re
import select
import stat
from typing import TYPE_CHECKING

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

PATIENCE = 10.0  # s: longest silence of a pipe
LARGEST_FILE = 16 << 20  # bytes; a scenario of some hundred thousand blocks, or a million lines of numbers


def read_bytes(path: str | os.PathLike, what: str, regular: bool = True) -> bytes:
    """Read the bytes of a file; messages call it ``what``, "a scenario file".

    Raises ScenarioError if the file does not exist, cannot be read, is larger than ``LARGEST_FILE`` or, where it must
    be ``regular``, is a device, a pipe or a socket. A pipe that is silent for `PATIENCE` is refused as well.
    """
    path = os.fsdecode(path)
    try:
        pipe = not regular and stat.S_ISFIFO(os.stat(path).st_mode)
        handle = os.open(path, os.O_RDONLY | (getattr(os, "O_NONBLOCK", 0) if regular or pipe else 0) | _BINARY)
        with open(handle, "rb") as file:
            if pipe:
                return _through_pipe(handle, path, what)
            if regular and not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise ScenarioError(f"{path}: not an ordinary file (a device or a pipe); name {what}")
            data = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise ScenarioError(f"{path}: there is no such file") from None
    except IsADirectoryError:
        raise ScenarioError(f"{path}: this is a folder; name {what} in it") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a null character
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{path}: the file cannot be read: {reason}") from None
    if len(data) > LARGEST_FILE:
        raise ScenarioError(f"{path}: longer than {LARGEST_FILE >> 20} MiB, so it is not {what}")
    return data


def read_text(path: str | os.PathLike, what: str, regular: bool = True) -> str:
    """Read the text of a file in UTF-8, with or without a byte order mark; errors as in `read_bytes`."""
    data = read_bytes(path, what, regular)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{os.fsdecode(path)}: not UTF-8 text (line {line}); {what} must be UTF-8 text") from None


def _through_pipe(handle: int, path: str, what: str) -> bytes:
    """Read from a non-blocking pipe until its writer closes it."""
    found, waited = b"", False
    while True:
        try:
            part = os.read(handle, 1 << 20)  # empty: no writer yet, or no longer
            if not part and (found or waited):
                return found
        except BlockingIOError:
            part = b""
        if not part:
            waited = bool(select.select([handle], [], [], PATIENCE)[0])
            if not waited:
                raise ScenarioError(f"{path}: nothing came through this pipe within {PATIENCE:g} s; name {what}")
        found += part
        if len(found) > LARGEST_FILE:
            raise ScenarioError(f"{path}: longer than {LARGEST_FILE >> 20} MiB, so it is not {what}")


_BINARY = getattr(os, "O_BINARY", 0)


_HEADER = re.compile(r"\s*\[\[?\s*([A-Za-z_]\w*(?:\s*\.\s*(?:[\w-]+|\"[^\"]*\"|'[^']*'))*)\s*\]\]?\s*(?:#.*)?$")


def line_of(text: str, table: str, number: int = 1, key: str = "") -> int | None:
    """Line, from 1, of a ``key`` in the ``number``-th table of that name ("" is the top of the file); of the header of
    the table if the key is not found; None if the table is not."""
    begin, end = _extent(text.split("\n"), table, number)
    if begin is None:
        return None
    lines = text.split("\n")[begin:end]
    for i, line in enumerate(lines, begin + 1):
        if key and re.match(rf"""\s*["']?{re.escape(key)}["']?\s*[=.]""", line):
            return i
    return begin if table else None


def _extent(lines: list[str], table: str, number: int) -> tuple[int | None, int]:
    """Line number of a table's header, and of the last line of its body."""
    begin = 0 if not table else None
    for i, line in enumerate(lines, 1):
        header = _HEADER.match(line)
        if header is None:
            continue
        if begin is not None:
            return begin, i - 1
        number -= header.group(1).replace(" ", "") == table
        if number == 0:
            begin = i
    return begin, len(lines)


def require_file(scenario: Scenario, key: str, name: str) -> str:
    """The path of a file of this ``name``; ScenarioError with the ``key`` that names it, and its line, if it is not
    there."""
    path = scenario.path_of(name)
    if os.path.exists(path):
        return path
    line = _line_naming(scenario.path, name)
    where = f"{scenario.path}{f':{line}' if line else ''}: " if scenario.path else ""
    raise ScenarioError(f"{where}{key}: {path}: there is no such file")


def _line_naming(path: str | None, name: str) -> int | None:
    """The line in the scenario at a path that names a file, as a text in quotes; None if no line does."""
    try:
        text = read_text(path or "", "a scenario file (TOML)")
    except ScenarioError:
        return None
    quoted = (f'"{name}"', f"'{name}'")
    lines = enumerate(text.split("\n"), 1)
    return next((i for i, line in lines if any(one in line.partition("#")[0] for one in quoted)), None)


def hint_of(text: str, error: str) -> str:
    """The line of a text that a TOML error names, and a hint if quotes or a decimal point seem to be missing."""
    found = re.search(r"at line (\d+)", error)
    lines = text.split("\n")
    if found is None or not 1 <= int(found.group(1)) <= len(lines):
        return ""
    line = lines[int(found.group(1)) - 1].strip()
    bare = re.fullmatch(r"""[^=#]+=\s*([^\W\d][^"'\[\]{}=#]*?)\s*(?:#.*)?""", line)
    quotes = f'; texts need quotes: "{bare.group(1)}"' if bare and bare.group(1) not in ("true", "false") else ""
    comma = re.fullmatch(r"[^=#]+=\s*([+-]?\d+),(\d+)\s*(?:#.*)?", line)
    return f": {show(line)}{quotes}" + (f"; with a decimal point: {comma.group(1)}.{comma.group(2)}" if comma else "")
