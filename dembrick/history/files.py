"""Atomic file output: checks of an output path, and writing under a temporary name.

All output of the package goes through :func:`replacing`: the bytes are written to a hidden file ``.NAME.PID.part`` in
the same folder, which is renamed when it is complete.
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
    """The operating system's words for a failed write, extracted from HDF5's long messages if need be."""
    found = re.search(r"errno = (\d+)", str(error))
    if found:
        return os.strerror(int(found.group(1)))
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return (text.splitlines() or [type(error).__name__])[0]


def part_name(path: str) -> str:
    """Temporary file of this process for ``path``."""
    folder, name = os.path.split(path)
    return os.path.join(folder, f".{name}.{os.getpid()}.part")


def clear_parts(path: str) -> None:
    """Remove the temporary files for ``path`` left by killed processes of this machine."""
    folder, name = os.path.split(path)
    if os.name != "posix":  # on Windows, the test whether a process exists may end it
        return
    part = re.compile(re.escape(f".{name}.") + r"([0-9]{1,9})\.part", re.ASCII)
    for found in filter(None, map(part.fullmatch, os.listdir(folder or "."))):
        try:
            os.kill(int(found[1]), 0)
        except ProcessLookupError:
            with suppress(OSError):
                os.unlink(os.path.join(folder, found[0]))
        except OSError:
            continue  # the process exists and belongs to another user


def check_output(path: str | os.PathLike) -> str:
    """The real path of ``path`` if a file can be written there; its folder is made if missing.

    Raises OutputError if the path is invalid, if the parent of its folder is missing too (usually a typing error), or
    if it is a foreign file (see `products`); WriteError if the system refuses. Whether the folder is writable is found
    out by a trial write: permissions do not reveal a read-only disk.
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
    """Make ``folder``, the only one missing for ``path``."""
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
    """Turn a failed write into a WriteError, which names ``what`` was to be written to ``path``."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # HDF5 reports a failed write by either
        raise WriteError(f"{path}: the {what} cannot be written ({reason(error)}); choose another path") from error


@contextmanager
def replacing(path: str, sync: bool = False) -> Iterator[str]:
    """Yield a temporary name to write to; on success the file is renamed to ``path``, on any error it is removed.

    ``sync``: flush the bytes to the disk before the rename, so that a power cut cannot leave an empty file.
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
                os.fsync(folder)  # for the new name too
            finally:
                os.close(folder)
    except BaseException:
        with suppress(OSError):
            os.unlink(part)
        raise


def write_whole(path: str | os.PathLike, content: bytes | str, what: str) -> None:
    """Write a file at once; ``what`` is its name, "page", in the WriteError if that fails."""
    target = check_output(path)
    with writing(path, what), replacing(target) as part, open(part, "wb") as file:
        # file names are text in which Python escapes bytes that its locale cannot decode
        file.write(content.encode(errors="surrogateescape") if isinstance(content, str) else content)
