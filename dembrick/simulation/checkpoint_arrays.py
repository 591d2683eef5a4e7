"""Conversion of named tuples of arrays to named arrays of a checkpoint, and back."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from dembrick.errors import HistoryError
from dembrick.simulation.joint_laws import room_of
from dembrick.simulation.session import Snapshot

COUNTERS = ("state.areas.evaluations", "state.areas.pressed.count")  # integers of a state that change


def flattened(parts: Mapping[str, NamedTuple | None]) -> dict[str, np.ndarray]:
    """Fields of named tuples as arrays ``part.field``, not copied; parts and fields that are None are left out."""
    arrays: dict[str, np.ndarray] = {}
    for name, part in parts.items():
        for field, value in () if part is None else part._asdict().items():
            if _is_part(value):
                arrays |= flattened({f"{name}.{field}": value})
            elif value is not None:
                arrays[f"{name}.{field}"] = plain(np.asarray(value))
    return arrays


def plain(array: np.ndarray) -> np.ndarray:
    """View of an array of records, whose fields have one type, as plain numbers; any other array unchanged."""
    if array.dtype.names is None:
        return array
    return array.view(array.dtype[0].base)


def arrays_of(part: Iterable) -> Iterator[np.ndarray]:
    """All arrays of a named tuple and of the tuples in it, as they are."""
    for value in part:
        if isinstance(value, tuple):
            yield from arrays_of(value)
        elif isinstance(value, np.ndarray):
            yield value


def restored_state(state, snapshot: Snapshot):
    """The state of statics from ``snapshot``, where it is named "state"; HistoryError if it is of another scene."""
    pressed = None if state.areas is None else state.areas.pressed
    if pressed is not None:  # check before anything is restored, as counts are used as indices
        count = snapshot.array(COUNTERS[1], pressed.count)
        if (count < 0).any() or (count > room_of(pressed)).any():
            raise HistoryError(f"{snapshot.path}: {COUNTERS[1]} is outside the range of its polygons")
    return restored("state", state, snapshot, COUNTERS)


def _is_part(value) -> bool:
    """Whether a field is itself a named tuple, such as the pressed part of convex joints."""
    return hasattr(value, "_asdict")


def restored(name: str, part, snapshot: Snapshot, counters: Container[str] = ()):
    """A named tuple with the arrays and numbers of ``snapshot``; arrays are filled in place.

    Integers are constant indices and must be the same as in ``part``, because others could be out of bounds;
    ``counters``: names of those that may change. HistoryError if the snapshot is of another scene.
    """
    if part is None:
        return None
    numbers = {}
    for field, value in part._asdict().items():
        if value is None:
            continue
        if _is_part(value):
            numbers[field] = restored(f"{name}.{field}", value, snapshot, counters)
            continue
        path, own = f"{name}.{field}", plain(np.asarray(value))
        found = snapshot.array(path, own)
        if own.dtype.kind in "iub" and path not in counters and not np.array_equal(found, own):
            raise HistoryError(f"{snapshot.path}: {path} does not belong to this scenario")
        if isinstance(value, np.ndarray):
            own[...] = found
        else:
            numbers[field] = found.item()
    return part._replace(**numbers)
