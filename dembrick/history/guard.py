"""Safe reading of untrusted HDF5 files: no other file is opened and no excessive memory is allocated.

Every function raises HistoryError with one sentence. Refused are links other than plain members of the file (soft,
external), data stored in other files (external storage, virtual datasets), filters that would load a plug-in, shapes
and types other than expected, and sizes that the bytes in the file cannot contain.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5l, h5t, h5z

from dembrick.errors import HistoryError
from dembrick.history.hdf5_files import check_heaps

MAX_READ = 4 << 30  # bytes of one read: anything longer is a mistake or an attack
_CACHE = 1 << 20  # bytes of uncompressed chunks cached per dataset; some versions of HDF5 would cache eight times that
_FILTERS = {h5z.FILTER_DEFLATE, h5z.FILTER_SHUFFLE, h5z.FILTER_FLETCHER32}
_GZIP_BOUND = 1100  # largest compression ratio: gzip reaches at most 1032
_KINDS = {"number": (h5t.FLOAT, h5t.INTEGER), "integer": (h5t.INTEGER,), "text": (h5t.STRING,)}
_DAMAGE = (OSError, KeyError, ValueError, TypeError, RuntimeError, OverflowError, MemoryError, AttributeError)


@contextmanager
def damaged(path: str, what: str) -> Iterator[None]:
    """Turn any error of HDF5 on damaged bytes into one sentence."""
    try:
        yield
    except _DAMAGE as error:
        raise HistoryError(
            f"{path}: {what} cannot be read; the file is damaged or was not written by dembrick"
        ) from error


def open_file(path: str | os.PathLike) -> h5py.File:
    """Open for reading, even while a run is writing the file, as its writer ignores locks.

    The lock is h5py's default: otherwise HDF5 would refuse a second `h5py.File` of the same process for this file. If
    no lock is available, or the file is open without one already, it is opened without.
    """
    path = os.fspath(path)
    if not os.path.exists(path):
        raise HistoryError(f"{path}: there is no such file")
    if not os.path.isfile(path):
        raise HistoryError(f"{path}: this is not a file; give the name of a history (.h5)")
    if not os.access(path, os.R_OK):
        raise HistoryError(f"{path}: no permission to read this file")
    check_heaps(path)
    try:
        try:
            return h5py.File(path, "r", rdcc_nbytes=_CACHE)
        except OSError as error:
            if "lock" not in str(error):
                raise
            return h5py.File(path, "r", locking=False, rdcc_nbytes=_CACHE)
    except _DAMAGE as error:
        if os.path.getsize(path) and "truncated" in str(error):
            raise HistoryError(f"{path}: the file is truncated; copy it again") from error
        if path.endswith(".toml"):
            raise HistoryError(
                f"{path}: this is a scenario, not a history; run it first: dembrick run {path}"
            ) from error
        raise HistoryError(f"{path}: this is not an HDF5 file, so it is not a history") from error


def attribute(owner: h5py.File | h5py.Dataset, name: str) -> str | int | None:
    """A scalar text or integer attribute of the root or a dataset; None if it is missing or of another type."""
    with damaged(owner.file.filename, f"the attribute {name!r}"):
        if not h5a.exists(owner.id, name.encode()):
            return None
        found = h5a.open(owner.id, name.encode())
        if found.shape != () or found.get_type().get_class() not in (h5t.STRING, h5t.INTEGER):
            return None
        value = owner.attrs[name]
        return value if isinstance(value, str) else int(value)


def exists(file: h5py.File, name: str) -> bool:
    """Whether the root has a member of that name, of any type."""
    with damaged(file.filename, name):
        root = _group(file, "")
        return bool(root.links.exists(name.encode()))


def members(file: h5py.File, path: str) -> list[str]:
    """Names of the datasets in a group; empty if the group is missing."""
    with damaged(file.filename, path):
        parent, _, last = path.rpartition("/")
        above = _group(file, parent)
        if not above.links.exists(last.encode()):
            return []
        group = _group(file, path)
        if group.get_num_objs() > 1000:
            raise HistoryError(f"{file.filename}: {path} has too many entries for a history")
        return sorted(name.decode() for name in group)


def dataset(file: h5py.File, path: str, kind: str, shape: tuple[int | None, ...]) -> h5py.Dataset:
    """Open the dataset ``path``; it must be stored in this file, with numbers or text of that shape (None: any)."""
    where = f"{file.filename}: {path}"
    with damaged(file.filename, path):
        parent, _, name = path.rpartition("/")
        group = _group(file, parent)
        _plain_link(file, group, name.encode(), path)
        data = h5d.open(group, name.encode())
        if data.get_type().get_class() not in _KINDS[kind] or data.get_type().get_size() > 16:
            raise HistoryError(f"{where} does not hold {kind} values, so this is not a dembrick history")
        if len(data.shape) != len(shape) or any(
            want not in (None, got) for want, got in zip(shape, data.shape, strict=True)
        ):
            wanted = " x ".join("any" if n is None else str(n) for n in shape)
            raise HistoryError(f"{where} has the shape {data.shape}; {wanted or 'a single value'} was expected")
        # of the open file: a run may have replaced it by a smaller one
        _check_storage(data, where, os.fstat(file.id.get_vfd_handle()).st_size)
        return h5py.Dataset(data)


def values(data: h5py.Dataset, start: int = 0, stop: int | None = None) -> np.ndarray:
    """Read entries start to stop along the first axis only."""
    count = (data.shape[0] if stop is None else stop) - start
    size = count * data.dtype.itemsize * math.prod(data.shape[1:])
    if size > MAX_READ:
        raise HistoryError(
            f"{data.file.filename}: {data.name} is too long to read at once ({size / 2**30:.0f} GiB); read it in parts"
        )
    try:
        return data[start : start + count]
    except _DAMAGE as error:
        name = f"{data.file.filename}: {data.name}" if data.id.valid else "a closed history"
        raise HistoryError(f"{name} cannot be read; the file is damaged or closed") from error


def texts(data: h5py.Dataset) -> list[str]:
    """All strings of a dataset of text."""
    with damaged(data.file.filename, data.name):
        return [str(text) for text in data.asstr()[:]]


def _plain_link(file, group, name: bytes, path: str) -> None:
    if not group.links.exists(name):
        raise HistoryError(f"{file.filename}: {path} is missing, so this is not a dembrick history")
    if group.links.get_info(name).type != h5l.TYPE_HARD:
        raise HistoryError(f"{file.filename}: {path} is a link to another place; such links are not followed")


def _group(file, path: str):
    """Open a group by plain members only, so that no link is followed."""
    group = h5g.open(file.id, b"/")
    for name in filter(None, path.split("/")):
        _plain_link(file, group, name.encode(), path)
        group = h5g.open(group, name.encode())
    return group


def _check_storage(data, where: str, file_size: int) -> None:
    how = data.get_create_plist()
    if how.get_layout() == h5d.VIRTUAL or how.get_external_count():
        raise HistoryError(f"{where} keeps its values in another file, which is not opened")
    if any(how.get_filter(i)[0] not in _FILTERS for i in range(how.get_nfilters())):
        raise HistoryError(f"{where} is compressed by a method that histories do not use")
    size = data.get_type().get_size() * math.prod(data.shape)
    stored = data.get_storage_size()
    bound = stored * _GZIP_BOUND if how.get_layout() == h5d.CHUNKED else stored
    if size > bound or stored > file_size:
        raise HistoryError(f"{where} claims {size} bytes, more than the file holds")
