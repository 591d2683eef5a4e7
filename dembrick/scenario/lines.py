"""Lines of a scenario file: where in the text a table and a key stand, for the messages of errors.

The library that reads TOML tells no positions. Headers and keys are found line by line; a table that is written in
some other way (inline, or by dotted keys) has no line, and the message goes without.
"""

from __future__ import annotations

import re

_HEADER = re.compile(r"\s*\[\[?\s*([A-Za-z_]\w*(?:\s*\.\s*(?:[\w-]+|\"[^\"]*\"|'[^']*'))*)\s*\]\]?\s*(?:#.*)?$")


def line_of(text: str, table: str, number: int = 1, key: str = "") -> int | None:
    """Line, from 1, of a ``key`` in the ``number``-th table of that name ("" is the top of the file), else of the
    header of the table, else None."""
    begin, end = _extent(text.split("\n"), table, number)
    if begin is None:
        return None
    lines = text.split("\n")[begin:end]
    for i, line in enumerate(lines, begin + 1):
        if key and re.match(rf"""\s*["']?{re.escape(key)}["']?\s*[=.]""", line):
            return i
    return begin if table else None


def _extent(lines: list[str], table: str, number: int) -> tuple[int | None, int]:
    """Where the body of a table begins (the number of the line of its header) and where it ends."""
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
