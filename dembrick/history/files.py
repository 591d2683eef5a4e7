"""Files that appear whole or not at all: checks of an output path, and writing under a temporary name.

Everything the package leaves behind goes through :func:`replacing`: the bytes are written to a hidden neighbour
``.NAME.PID.part`` which takes the final name only when it is complete.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from dembrick.errors import OutputError, WriteError
from dembrick.history import products


def reason(error: BaseException) -> str:
    """The operating system's words for a failed write, also out of HDF5's long messages."""
    found = re.search(r"errno = (\d+)", str(error))
    if found:
        return os.strerror(int(found.group(1)))
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return (text.splitlines() or [type(error).__name__])[0]


def part_name(path: str) -> str:
    """The temporary neighbour of ``path``, of this process alone."""
    folder, name = os.path.split(path)
    return os.path.join(folder, f".{name}.{os.getpid()}.part")


def clear_parts(path: str) -> None:
    """Remove the temporary neighbours of ``path`` that killed processes of this machine left behind."""
    folder, name = os.path.split(path)
    if os.name != "posix":  # where asking for a process may end it
        return
    part = re.compile(re.escape(f".{name}.") + r"([0-9]{1,9})\.part", re.ASCII)
    for found in filter(None, map(part.fullmatch, os.listdir(folder or "."))):
        try:
            os.kill(int(found[1]), 0)
        except ProcessLookupError:
            with suppress(OSError):
                os.unlink(os.path.join(folder, found[0]))
        except OSError:
            continue  # it lives, and belongs to somebody else


def check_output(path: str | os.PathLike) -> str:
    """The real path behind ``path`` if a file can be written there; its folder is made if missing.

    OutputError if the path makes no sense, if its folder has no parent either (a slip of the pen, as a rule), or if
    another's file is there (see `products`); WriteError if the system refuses.
    Whether the folder can be written is tried, not asked: permissions alone do not tell of a read-only disk.
    """
    real = os.path.realpath(path)
    folder = os.path.dirname(real)
    if os.path.isdir(real):
        raise OutputError(f"{path}: this is a folder; give the name of a file in it")
    if os.path.isfile(folder):
        raise OutputError(f"{path}: {folder} is a file, not a folder; choose another path")
    if not os.path.isdir(folder):
        _make(folder, path)
    if os.path.exists(real) and not os.path.isfile(real):
        raise OutputError(f"{path}: this is not an ordinary file; choose another path")
    products.refuse_foreign(path, real)
    part = part_name(real)
    try:
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT, 0o666))
        os.unlink(part)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise OutputError(f"{path}: the name is too long; choose a shorter one") from error
        raise WriteError(
            f"{path}: the folder {folder} cannot be written ({reason(error)}); choose another path"
        ) from error
    return real


def _make(folder: str, path: str | os.PathLike) -> None:
    """Make the one ``folder`` that ``path`` lacks."""
    parent = os.path.dirname(folder)
    if not os.path.isdir(parent):
        raise OutputError(f"{path}: the folder {parent} does not exist; make it first or choose another path")
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise OutputError(f"{path}: the name is too long; choose a shorter one") from error
        raise WriteError(
            f"{path}: the folder {folder} cannot be made ({reason(error)}); choose another path"
        ) from error


@contextmanager
def writing(path: str | os.PathLike, what: str) -> Iterator[None]:
    """A failed write becomes a WriteError that names ``what`` was to go to ``path``."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # HDF5 tells of a failed write by either
        raise WriteError(f"{path}: the {what} cannot be written ({reason(error)}); choose another path") from error


@contextmanager
def replacing(path: str, sync: bool = False) -> Iterator[str]:
    """Give a temporary name to write to; on success the file takes the name ``path``, on any error it goes away.

    ``sync``: put the bytes on the disk before the rename, so that a power cut cannot leave an empty file.
    """
    products.refuse_foreign(path, path)
    part = part_name(path)
    try:
        yield part
        products.refuse_other_text(path, part)
        products.sign(path, part)
        if sync:
            with open(part, "rb+") as file:
                os.fsync(file.fileno())
        os.replace(part, path)
        if sync and os.name == "posix":
            folder = os.open(os.path.dirname(path) or ".", os.O_RDONLY)
            try:
                os.fsync(folder)  # the new name too
            finally:
                os.close(folder)
    except BaseException:
        with suppress(OSError):
            os.unlink(part)
        raise


def write_whole(path: str | os.PathLike, content: bytes | str, what: str) -> None:
    """Write a file at once; ``what`` it is, "page", for the WriteError if that fails."""
    target = check_output(path)
    with writing(path, what), replacing(target) as part, open(part, "wb") as file:
        # names of files are text in which Python keeps bytes that its locale does not know
        file.write(content.encode(errors="surrogateescape") if isinstance(content, str) else content)
