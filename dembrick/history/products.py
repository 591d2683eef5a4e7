"""Whose a file is: nothing replaces a file that this program did not write, as the same kind, from the same scenario.

Figures, pictures, movies, pages and exports carry a mark at their end, in a remark that their format passes over; a
table (CSV) or a scenario (TOML) has none and gives way only to the same text. A command states what it makes by
`product`; then `files.check_output` and `files.replacing` see to it. Outside of one, as in a script of the user's, a
path is taken as it is given.
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
_TAIL = 1024  # bytes at the end of a file that are searched for a mark
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


@dataclass(frozen=True)
class Product:
    """Product of a command: its ``mark``, the files that it reads, and whether it may replace whatever is there."""

    mark: bytes
    inputs: tuple[str, ...]
    force: bool


_making: ContextVar[Product | None] = ContextVar("product", default=None)


@contextmanager
def product(kind: str, texts: Iterable[str], inputs: Iterable[str | os.PathLike] = (), force: bool = False) -> Iterator:
    """Within, files are written as ``kind`` ("curve", "page") from the scenarios ``texts``; ``inputs`` stay as they
    are, and with ``force`` anything else may be replaced."""
    digest = hashlib.sha256("\0".join(sorted(texts)).encode("utf-8", "backslashreplace")).hexdigest()[:16]
    given = Product(f"dembrick {kind} {digest}".encode(), tuple(map(os.fspath, inputs)), force)
    token = _making.set(given)
    try:
        yield
    finally:
        _making.reset(token)


def is_ours(target: str) -> bool:
    """Whether nothing is lost where the product of now takes the place of ``target``: it is not there, or empty, or
    carries the mark."""
    making = _making.get()
    if making is None or making.force or not os.path.exists(target) or os.path.getsize(target) == 0:
        return True
    with open(target, "rb") as file:
        file.seek(max(0, os.path.getsize(target) - _TAIL))
        return making.mark in file.read()


def refuse_foreign(path: str | os.PathLike, target: str) -> None:
    """OutputError if ``target``, the file behind ``path``, is not for the product of now to replace."""
    making = _making.get()
    if making is None:
        return
    refuse_inputs(path, target, making.inputs)
    if not _is_text(target) and not is_ours(target):  # texts are told apart when the new one is there
        raise OutputError(_other(path))


def refuse_inputs(path: str | os.PathLike, target: str, inputs: Iterable[str]) -> None:
    """OutputError if ``target`` is one of the files that are read."""
    for file in inputs:
        if os.path.exists(target) and os.path.exists(file) and os.path.samefile(target, file):
            raise OutputError(
                f"{path}: this file is an input of the command and is not written over; choose another name"
            )


def refuse_other_text(target: str, part: str) -> None:
    """OutputError if ``target`` is a text that says something else than the new one, ``part``."""
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
    """Put the mark at the end of the new file ``part``, as remarks are written in the format of ``target``."""
    making = _making.get()
    ending = os.path.splitext(target)[1].lower()
    if making is None or ending in (*_TEXTS, ".vtu"):
        return
    mark = making.mark
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
            file.write(b"!\xfe" + bytes([len(mark)]) + mark + b"\0;")  # a comment, then the end again
        elif ending == ".mp4":
            file.write((8 + len(mark)).to_bytes(4, "big") + b"free" + mark)
        else:
            file.write(mark)  # HDF5 knows where its file ends
