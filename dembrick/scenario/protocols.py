"""Protocols of displacement-controlled tests: turning points of the jack's end, and the time between them.

A protocol is a list of turning points, or a CSV file of a measured protocol: a column of displacement, whose extremes
are the turning points, and optionally a column of time, which then sets the speed.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import check_name, present, real, require, require_type
from dembrick.scenario.units import size_of

if TYPE_CHECKING:
    import numpy as np

    from dembrick.scenario.controls import DisplacementControl
    from dembrick.scenario.model import Scenario

MOST = 10_000  # limit on the number of turning points
NOISE = 0.02  # of the range of a measured protocol: smaller reversals are noise


class Protocol(NamedTuple):
    """Turning points ``turns`` (t,), from the start on, in m, or in N if the force is driven; ``seconds`` (t - 1,):
    duration of each path between two of them."""

    turns: np.ndarray
    seconds: np.ndarray
    by_force: bool = False

    @classmethod
    def one_way(cls, travel: float, rate: float) -> Protocol:
        """Protocol of one path of ``travel`` (m) at ``rate`` (m/s), without a turn."""
        import numpy as np

        return cls(np.array([0.0, travel]), np.array([travel / rate]))

    @property
    def ways(self) -> np.ndarray:
        """Changes from each turning point to the next (t - 1,)."""
        import numpy as np

        return np.diff(self.turns)

    @property
    def cycles(self) -> bool:
        """Whether there is any turn."""
        return len(self.turns) > 2


def checked(key: str, value: object) -> tuple[float, ...] | str:
    """Check a protocol of a scenario: numbers that alternate in direction, or the name of a file."""
    if isinstance(value, str):
        return check_name(key, value)
    value = value.tolist() if hasattr(value, "tolist") else value
    require_type(isinstance(value, list | tuple), key, value, "a list of turning points, or the name of a CSV file")
    points = tuple(real(f"{key}[{i}]", one) for i, one in enumerate(value))  # type: ignore[arg-type]
    require(len(points) <= MOST, key, len(points), f"at most {MOST} turning points")
    ways = [b - a for a, b in pairwise((0.0, *points[1:]) if points[:1] == (0.0,) else (0.0, *points))]
    differ = bool(ways) and all(ways)
    require(differ, key, list(points), "every turning point must differ from the one before")
    turns = len(ways) > 1 and all(math.copysign(1.0, a) != math.copysign(1.0, b) for a, b in pairwise(ways))
    what = "it must have a turn, and reverse at each of its points; for a path without a turn use control.travel"
    require(turns, key, list(points), what)
    return points


def protocol_of(scenario: Scenario) -> Protocol:
    """The protocol of a scenario whose control is ``displacement``; for a ``travel`` it has no turn.

    Raises ScenarioError for a file that cannot be read or has no turning point.
    """
    import numpy as np

    control: DisplacementControl = scenario.control  # type: ignore[assignment]
    given = control.protocol if control.force_protocol is None else control.force_protocol
    by_force, rate = control.force_protocol is not None, control.rate or 1.0  # without a rate no time passes
    if given is None:
        return Protocol.one_way(present(control.travel), rate)
    if isinstance(given, str):
        from dembrick.scenario.text_files import require_file

        key = "force_protocol" if by_force else "protocol"
        return _measured(require_file(scenario, key, given), rate, by_force)
    turns = np.array(given if given[0] == 0.0 else (0.0, *given))
    return Protocol(turns, np.abs(np.diff(turns)) / rate, by_force)


def _measured(path: str, rate: float, by_force: bool) -> Protocol:
    import numpy as np

    from dembrick.scenario.csv_tables import read_columns, read_table

    quantity, what = "force" if by_force else "displacement", "a protocol"
    timed = any(size_of("time", unit) is not None for title in read_table(path, what).titles for unit in _units(title))
    found, _ = read_columns(path, what, ("time", quantity) if timed else (quantity,))
    values = found[quantity]
    at = turning_points(np.concatenate([[0.0], values]))
    turns = np.concatenate([[0.0], values])[at]
    if len(turns) < 3:
        raise ScenarioError(f"{path}: this protocol has no turning point; for a path without a turn use control.travel")
    seconds = np.abs(np.diff(turns)) / rate
    if timed:
        times = np.concatenate([[found["time"][0]], found["time"]])[at]
        seconds = np.diff(times)
        if not (seconds > 0.0).all():
            raise ScenarioError(
                f"{path}: the times of this protocol do not increase from one turning point to the next"
            )
    return Protocol(turns, seconds, by_force)


def _units(title: str) -> list[str]:
    """Parts of a column title that may be its unit."""
    return [part.rstrip(")] ") for part in title.replace("(", "[").split("[")[1:]]


def turning_points(values: np.ndarray) -> np.ndarray:
    """Indices of the first value, of the extremes after which the values reverse by more than `NOISE` of the range, and
    of the last extreme if it differs from these."""
    import numpy as np

    least = NOISE * float(np.ptp(values))
    kept, last, way = [0], 0, 0.0
    for i in range(1, len(values)):
        change = values[i] - values[last]
        if way == 0.0:
            if abs(change) > least:
                way, last = float(np.sign(change)), i
        elif change * way >= 0.0:
            last = i
        elif abs(change) > least:
            kept.append(last)
            way, last = -way, i
    if last != kept[-1]:
        kept.append(last)
    return np.array(kept)
