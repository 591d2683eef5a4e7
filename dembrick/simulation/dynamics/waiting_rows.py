"""Rows and frames of a run in real time, until the observer of its session gets some of them together."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

TOGETHER = 64  # rows, at the most
MOST_WAITING = 1 << 20  # bytes of them
HELD = 0.05  # s, for which rows wait at the most while others come


class WaitingRows:
    """Gathers rows and frames for ``observe``, each call of which takes longer than the steps to a row of one block.

    ``rows`` are by name, each a number or an array, or a mapping of these; what the observer gets has one entry a row
    in each. Whoever keeps a checkpoint, or ends the run, passes on what waits before.
    """

    def __init__(self, observe: Callable[[Mapping, Mapping], None]):
        self._observe = observe
        self._rows: dict[str, Any] = {}
        self._frames: list[dict] = []
        self._count, self._room, self._passed_on = 0, 0, -math.inf

    def add(self, row: Mapping[str, Any], frames: dict) -> bool:
        """Take a row, and the frames that are due with it; returns whether it is time to pass them on."""
        if not self._rows:
            self._room = max(1, min(TOGETHER, MOST_WAITING // _bytes(row)))
            self._rows = _room_for(row, self._room)
        _put(self._rows, self._count, row)
        self._count += 1
        if frames:
            self._frames.append(frames)
        return self._count == self._room or time.monotonic() - self._passed_on >= HELD

    def pass_on(self) -> None:
        """Let the observer have all that waits."""
        if not self._count:
            return
        rows, frames = _first(self._rows, self._count), joined(self._frames)
        self._rows, self._frames, self._count = {}, [], 0
        self._observe(rows, frames)
        self._passed_on = time.monotonic()


def _bytes(row: Mapping[str, Any]) -> int:
    return sum(_bytes(value) if isinstance(value, Mapping) else 8 * np.size(value) for value in row.values())


def _room_for(row: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Arrays for so many rows like that one."""
    return {
        name: _room_for(value, count) if isinstance(value, Mapping) else np.empty((count, *np.shape(value)))
        for name, value in row.items()
    }


def _put(rows: Mapping[str, Any], place: int, row: Mapping[str, Any]) -> None:
    for name, value in row.items():
        if isinstance(value, dict):
            _put(rows[name], place, value)
        else:
            rows[name][place] = value


def _first(rows: Mapping[str, Any], count: int) -> dict[str, Any]:
    """The first so many of the rows."""
    return {name: _first(value, count) if isinstance(value, Mapping) else value[:count] for name, value in rows.items()}


def no_rows(row: Mapping[str, Any]) -> dict[str, Any]:
    """None of the rows like that one."""
    return _first(_room_for(row, 1), 0)


def joined(parts: Sequence[Mapping]) -> Mapping:
    """Chunks as one mapping of arrays (or of mappings of arrays)."""
    if len(parts) < 2:
        return parts[0] if parts else {}
    first = parts[0]
    return {
        name: joined([part[name] for part in parts])
        if isinstance(first[name], Mapping)
        else np.concatenate([part[name] for part in parts])
        for name in first
    }
