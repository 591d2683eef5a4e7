"""Compare the cost that `dembrick check` estimates for every shipped scenario with that of its run.

    python tools/bench_estimates.py [NAME ...] [--jobs 1]

A row for each scenario: steps and processor seconds, estimated and measured, and their ratios. Each run is a process of
its own, including start-up. A run off by more than a factor of two is repeated, as it may have compiled, and the
quicker one counts. The last line gives the number of scenarios within a factor of two in steps, in seconds and in both.
It takes some minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT)]

from dembrick.scenario import shipped  # noqa: E402

FACTOR = 2.0


class Row(NamedTuple):
    """Steps and processor seconds of a scenario, each estimated and measured."""

    name: str
    steps: tuple[int, int]
    seconds: tuple[float, float]

    @property
    def ratios(self) -> tuple[float, float]:
        """Estimated over measured: steps, seconds."""
        return self.steps[0] / max(self.steps[1], 1), self.seconds[0] / self.seconds[1]


def within(ratio: float) -> bool:
    """Whether a ratio is between 0.5 and 2."""
    return 1.0 / FACTOR <= ratio <= FACTOR


def ran(*words: str) -> tuple[dict, float]:
    """JSON output of a command in a process of its own, and its processor seconds."""
    with tempfile.TemporaryFile() as out:
        surroundings = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "dembrick", *words, "--json", "--quiet"]
        actions = [(os.POSIX_SPAWN_DUP2, out.fileno(), 1)]
        number = os.posix_spawn(sys.executable, command, surroundings, file_actions=actions)
        _, status, used = os.wait4(number, 0)
        out.seek(0)
        text = out.read()
    if os.waitstatus_to_exitcode(status) not in (0, 1):
        raise SystemExit(f"{' '.join(words)}: exit code {os.waitstatus_to_exitcode(status)}")
    return json.loads(text), used.ru_utime + used.ru_stime


def measured(name: str) -> Row:
    """The row of one scenario."""
    expected, _ = ran("check", name)
    with tempfile.TemporaryDirectory() as folder:
        taken, seconds = ran("run", name, "--out", os.path.join(folder, "a.h5"))
        row = Row(name, (expected["expected_steps"], taken["steps"]), (expected["expected_seconds"], seconds))
        if not within(row.ratios[1]):
            _, again = ran("run", name, "--out", os.path.join(folder, "b.h5"))
            row = row._replace(seconds=(row.seconds[0], min(seconds, again)))
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="scenarios (default: all that ship)")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    names = options.names or [name for name in shipped.examples() if not name.startswith(shipped.STUDIES)]
    print(f"{'scenario':24}{'steps':>22}{'ratio':>8}{'processor, s':>18}{'ratio':>8}")
    rows = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for row in pool.map(measured, names):
            rows.append(row)
            marks = ["" if within(ratio) else " !" for ratio in row.ratios]
            steps, seconds = f"{row.steps[0]} / {row.steps[1]}", f"{row.seconds[0]:.1f} / {row.seconds[1]:.1f}"
            print(
                f"{row.name:24}{steps:>22}{row.ratios[0]:8.2f}{marks[0]:2}{seconds:>16}{row.ratios[1]:8.2f}{marks[1]}",
                flush=True,
            )
    counts = [sum(within(row.ratios[i]) for row in rows) for i in (0, 1)]
    both = sum(within(row.ratios[0]) and within(row.ratios[1]) for row in rows)
    print(f"within a factor of {FACTOR:g} of {len(rows)}: steps {counts[0]}, seconds {counts[1]}, both {both}")


if __name__ == "__main__":
    main()
