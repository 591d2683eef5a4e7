"""Memory that a scene needs and memory that is available, compared before anything is allocated."""

from __future__ import annotations

import os
import sys

from dembrick.errors import ScenarioError

# Bytes per block of a wall at the peak of the build, with joints and the state of a run: measured 5.6 kB with
# four-point joints and 8.9 kB with convex ones; rounded up. After that peak a run needs much less.
BYTES_PER_BLOCK = 10_000
_CHECKED_ABOVE = 10_000  # blocks: fewer fit on any machine
MOST_BLOCKS = 1_000_000  # blocks in a scene; the largest scene run so far has a tenth of this


def available() -> int | None:
    """Bytes of memory that this process may still allocate, as reported by the system; None if unknown."""
    found = [amount for amount in (_meminfo(), _group_limit()) if amount is not None]
    if found:
        return min(found)
    if sys.platform == "win32":  # has no sysconf
        return None
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError):
        return None


def check_memory(asked: list[tuple[str, int]], others: int = 0) -> None:
    """Raise a ScenarioError if the structures ``asked`` for (their keys, numbers of blocks) and ``others`` blocks
    exceed `MOST_BLOCKS` or the available memory."""
    total = others + sum(count for _, count in asked)
    if total <= _CHECKED_ABOVE:
        return
    keys, count = max(asked, key=lambda pair: pair[1]) if asked else ("", others)
    who = f"{keys} would make {count} blocks" if count > others else f"the scenario has {others} blocks"
    if total > MOST_BLOCKS:
        raise ScenarioError(
            f"{who}: at most {MOST_BLOCKS} can be built, as more would take far too long; use fewer, or divide the "
            "structure"
        )
    there, needed = available(), total * BYTES_PER_BLOCK
    if there is not None and needed > there:
        raise ScenarioError(
            f"{who}: the scene would take about {needed / 1e9:.3g} GB of memory, but {there / 1e9:.3g} GB are free; "
            "use fewer blocks or a machine with more memory"
        )


def _meminfo() -> int | None:
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return 1024 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    return None


def _group_limit() -> int | None:
    """Memory that the container may still use (control groups, version 2)."""
    try:
        with open("/sys/fs/cgroup/memory.max", encoding="ascii") as file:
            limit = int(file.read())
        with open("/sys/fs/cgroup/memory.current", encoding="ascii") as file:
            return max(0, limit - int(file.read()))
    except (OSError, ValueError):
        return None
