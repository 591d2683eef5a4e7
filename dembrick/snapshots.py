"""Named tuples of arrays to arrays by name and back: what a checkpoint holds of a run."""

from __future__ import annotations

from collections.abc import Container, Mapping

import numpy as np

from dembrick.errors import HistoryError
from dembrick.session import Snapshot


def flattened(parts: Mapping[str, tuple | None]) -> dict[str, np.ndarray]:
    """All fields as arrays ``part.field``, without copying; what the scene does not have is None and left out."""
    return {
        f"{name}.{field}": np.asarray(value)
        for name, part in parts.items()
        if part is not None
        for field, value in part._asdict().items()
        if value is not None
    }


def restored(name: str, part, snapshot: Snapshot, counters: Container[str] = ()):
    """A named tuple whose arrays and numbers are those of ``snapshot``; arrays are filled in place.

    Integers are indices that nothing changes and must be the same as in ``part``, because another one could lead out
    of its array; ``counters`` are the names of those that do change. HistoryError where the snapshot is of another
    scene.
    """
    if part is None:
        return None
    numbers = {}
    for field, value in part._asdict().items():
        if value is None:
            continue
        path, own = f"{name}.{field}", np.asarray(value)
        found = snapshot.array(path, own)
        if own.dtype.kind in "iub" and path not in counters and not np.array_equal(found, own):
            raise HistoryError(f"{snapshot.path}: {path} is not that of this scenario")
        if isinstance(value, np.ndarray):
            value[...] = found
        else:
            numbers[field] = found.item()
    return part._replace(**numbers)
