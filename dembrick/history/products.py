"""Protection of existing files: one is replaced only by output of the same kind for the same scenario.

Figures, pictures, movies, pages and exports have a mark at their end, in a comment of their format; pictures of a
scenario that is being written have a second one, and replace one another after every edit of its file. A table (CSV) or
a scenario (TOML) has none and is replaced only by identical text. A command declares its output by `product`, and
`files.check_output` and `files.replacing` apply the rule. Outside of such a context, as in a user's script, any path is
accepted.
"""

from __future__ import annotations

import filecmp
import hashlib
import os
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from dembrick.errors import OutputError

_TEXTS = (".csv", ".toml")
_TAIL = 1024  # bytes at the end of a file in which a mark is searched for
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


@dataclass(frozen=True)
class Product:
    """Output of a command: its ``marks``, of which a file that it replaces has at least one, the files that it reads,
    and whether it may replace any file."""

    marks: tuple[bytes, ...]
    inputs: tuple[str, ...]
    force: bool


_making: ContextVar[Product | None] = ContextVar("product", default=None)


@contextmanager
def product(
    kind: str,
    texts: Iterable[str],
    inputs: Iterable[str | os.PathLike] = (),
    force: bool = False,
    draft_of: str | None = None,
) -> Iterator:
    """Context in which files are output of ``kind`` ("curve", "page") for the scenarios ``texts``; ``inputs`` must not
    be overwritten, and with ``force`` any other file may be replaced. Drafts of a file ``draft_of`` replace one
    another, whatever its text was."""
    marks = [_mark(kind, sorted(texts))]
    if draft_of is not None:
        marks.append(_mark(f"draft {kind}", [os.path.realpath(draft_of)]))
    given = Product(tuple(marks), tuple(map(os.fspath, inputs)), force)
    token = _making.set(given)
    try:
        yield
    finally:
        _making.reset(token)


def _mark(kind: str, texts: Iterable[str]) -> bytes:
    digest = hashlib.sha256("\0".join(texts).encode("utf-8", "backslashreplace")).hexdigest()[:16]
    return f"dembrick {kind} {digest}".encode()


def is_ours(target: str) -> bool:
    """Whether the current output may replace ``target`` without loss: it does not exist, is empty, or has a mark."""
    making = _making.get()
    if making is None or making.force or not os.path.exists(target) or os.path.getsize(target) == 0:
        return True
    with open(target, "rb") as file:
        file.seek(max(0, os.path.getsize(target) - _TAIL))
        tail = file.read()
    return any(mark in tail for mark in making.marks)


def refuse_foreign(path: str | os.PathLike, target: str) -> None:
    """Raise an OutputError if the current output must not replace ``target``, the file behind ``path``."""
    making = _making.get()
    if making is None:
        return
    refuse_inputs(path, target, making.inputs)
    if not _is_text(target) and not is_ours(target):  # texts are compared when the new one is written
        raise OutputError(_other(path))


def refuse_inputs(path: str | os.PathLike, target: str, inputs: Iterable[str]) -> None:
    """Raise an OutputError if ``target`` is one of the files that are read."""
    for file in inputs:
        if os.path.exists(target) and os.path.exists(file) and os.path.samefile(target, file):
            raise OutputError(
                f"{path}: this file is an input of the command and is not overwritten; choose another name"
            )


def refuse_other_text(target: str, part: str) -> None:
    """Raise an OutputError if the text in ``target`` differs from the new one, ``part``."""
    making = _making.get()
    if making is None or making.force or not _is_text(target) or not os.path.exists(target):
        return
    if os.path.getsize(target) and not filecmp.cmp(target, part, shallow=False):
        raise OutputError(_other(target))


def _is_text(target: str) -> bool:
    return target.lower().endswith(_TEXTS)


def _other(path: str | os.PathLike) -> str:
    return (
        f"{path}: this file exists, and was not written by this command from the same scenario; choose another name, "
        "or --force replaces it"
    )


def sign(target: str, part: str) -> None:
    """Append the marks to the new file ``part``, as a comment in the format of ``target``."""
    making = _making.get()
    ending = os.path.splitext(target)[1].lower()
    if making is None or ending in (*_TEXTS, ".vtu"):
        return
    mark = b" ".join(making.marks)
    with open(part, "r+b") as file:
        file.seek(0, os.SEEK_END)
        if ending in (".svg", ".html", ".htm", ".pvd"):
            file.write(b"<!-- " + mark + b" -->\n")
        elif ending == ".pdf":
            file.write(b"% " + mark + b"\n")
        elif ending == ".png":
            file.seek(-len(_PNG_END), os.SEEK_END)
            chunk = b"tEXtSource\0" + mark
            size, check = (number.to_bytes(4, "big") for number in (len(chunk) - 4, zlib.crc32(chunk)))
            file.write(size + chunk + check + _PNG_END)
        elif ending == ".gif":
            file.seek(-1, os.SEEK_END)
            file.write(b"!\xfe" + bytes([len(mark)]) + mark + b"\0;")  # a comment, then the trailer again
        elif ending == ".mp4":
            file.write((8 + len(mark)).to_bytes(4, "big") + b"free" + mark)
        else:
            file.write(mark)  # HDF5 ignores bytes after its end of file
