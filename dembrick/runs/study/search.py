"""Search of a study: the value of a key at which a run begins to fall, by bisection, one search for each case.

A study asks for it by a table::

    [search]
    key       = "control.scale"   # any key of the scenario with a real number
    low       = 0.1
    high      = 2.0               # the run stands at one end and falls at the other
    tolerance = 0.01              # relative half-width of the bracket at which the search ends
    scan      = 8                 # scan the range in so many steps first, from the end that stands

A run *falls* if its status is "collapse" or "falls", or if a block has fallen at its end without being taken
along by a support: its centroid is lower by more than half of its least dimension, or it has turned by more than 45
deg, or if one of its stages falls. An undecided run is neither: the search tries values beside it, and ends without an
answer if all are undecided.

The bracket is an error bar of the runs. If their model error exceeds it, as for blocks that rock about contact points
which stop short of the edge, there is no error bar, and a remark says why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dembrick.assembly.contact_points import largest_edge_shortfall
from dembrick.errors import DembrickError, NotConvergedError, ScenarioError, StageFellError, UndecidedError
from dembrick.runs.outcomes.result import fell
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import nearest, real, show
from dembrick.scenario.model import Scenario

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

COLUMNS = ("status", "searched", "value", "half_width", "stands", "falls", "runs", "loop", "remark", "error")
FOUND = "found"
_KEYS = ("key", "low", "high", "tolerance")  # all required
_SCAN = "scan"
_PARTS = (0.5, 0.25, 0.75)  # of the bracket, from its standing end: the middle, then others if it is undecided
_INSIDE = ("distributed", "corrected")  # formulations whose points stop short of the edge
_ROUNDING = 1e-9  # of the searched range: least width of a bracket, as for a value of zero


class Bracket(NamedTuple):
    """Bracket of a search: the last values at which a run ``stands`` and ``falls``, and the number of ``runs``."""

    stands: float
    falls: float
    runs: int

    @property
    def value(self) -> float:
        """The middle."""
        return 0.5 * (self.stands + self.falls)

    @property
    def half_width(self) -> float:
        """Error bar of the value."""
        return 0.5 * abs(self.falls - self.stands)


@dataclass(frozen=True)
class Search:
    """A search: its key and range, the relative half-width of the bracket at which it ends, and the number of steps, of
    equal ratio if the range is positive, of a ``scan`` for the first change before it."""

    key: str
    low: float
    high: float
    tolerance: float
    scan: int = 1

    def bisect(self, falls_at: Callable[[float], bool | None]) -> Bracket:
        """Bracket of the value at which ``falls_at`` changes; it is None if undecided. Either end may stand.

        If it changes several times, one change is found: the first one that `scan` meets. Raises
        NotConvergedError if both ends stand, or both fall, and UndecidedError if that is not known or the bracket
        cannot be made as narrow as asked for.
        """
        ends = (self.low, self.high)
        outcome = [falls_at(value) for value in ends]
        if None in outcome:
            raise UndecidedError(f"at {self.key} = {ends[outcome.index(None)]:g} it is undecided whether it falls")
        if outcome[0] == outcome[1]:
            what, remedy = ("falls", "whether it stands at all") if outcome[0] else ("stands", "what makes it fall")
            raise NotConvergedError(
                f"it {what} at both ends, {self.key} = {self.low:g} and {self.high:g}; widen search.low and "
                f"search.high, or check {remedy}"
            )
        stands, falls = ends if outcome[1] else reversed(ends)
        runs = 2
        for value in self._between(stands, falls):
            runs += 1
            found = falls_at(value)
            if found:
                falls = value
                break
            stands = stands if found is None else value
        while not self._close(stands, falls):
            for part in _PARTS:
                value, runs = stands + part * (falls - stands), runs + 1
                found = falls_at(value)
                if found is not None:
                    break
            if found is None:
                raise UndecidedError(
                    f"it stands at {self.key} = {stands:.9g} and falls at {falls:.9g}, and between these it is "
                    "undecided: use a larger search.tolerance"
                )
            stands, falls = (stands, value) if found else (value, falls)
        return Bracket(stands, falls, runs)

    def _between(self, first: float, last: float) -> list[float]:
        """The values of the scan between one end and the other."""
        spaced = np.geomspace if self.low > 0.0 else np.linspace
        return spaced(first, last, self.scan + 1)[1:-1].tolist()

    def _close(self, stands: float, falls: float) -> bool:
        size = max(abs(0.5 * (stands + falls)), _ROUNDING / self.tolerance * (self.high - self.low))
        return 0.5 * abs(falls - stands) <= self.tolerance * size


def read(table: Any, swept: Sequence[str]) -> Search:
    """The search that a table of a study states; ``swept``: keys that change from case to case already. ScenarioError
    for an invalid table."""
    if not isinstance(table, dict):
        raise ScenarioError(f"search must be a table with {', '.join(_KEYS)}, not {show(table)}")
    for name in table:
        if name not in (*_KEYS, _SCAN):
            raise ScenarioError(f"search: unknown key {show(name)}; {nearest(name, (*_KEYS, _SCAN))}")
    missing = next((name for name in _KEYS if name not in table), None)
    if missing is not None:
        raise ScenarioError(f"search: missing key {show(missing)}; it has no default")
    key = table["key"]
    if not isinstance(key, str):
        raise ScenarioError(f'search.key = {show(key)} must be the path of a key as text, such as "joint.friction"')
    if key in swept:
        raise ScenarioError(f"search.key = {show(key)} already varies from case to case; keep it in one of the two")
    low, high, tolerance = (real(f"search.{name}", table[name]) for name in _KEYS[1:])
    if not low < high:
        raise ScenarioError(f"search.low = {low:g} must be below search.high = {high:g}")
    if not 1e-6 <= tolerance <= 0.5:
        raise ScenarioError(
            f"search.tolerance = {tolerance:g} is out of range: it is the relative half-width of the bracket, between "
            "1e-6 and 0.5; 0.01 is usual"
        )
    scan = table.get(_SCAN, 1)
    if not isinstance(scan, int) or isinstance(scan, bool) or not 1 <= scan <= 1000:
        raise ScenarioError(f"search.scan = {show(scan)} must be a whole number of steps, from 1 to 1000")
    return Search(key, low, high, tolerance, scan)


def check(scenario: Scenario) -> None:
    """Raise ScenarioError for a control whose runs neither stand nor fall."""
    control = scenario.control
    if not control.regime.stands_or_falls:
        raise ScenarioError(
            f"search: a run of kind {show(control.kind)} neither stands nor falls, it gives a load; a [search] needs a "
            'kind such as "statics", "dynamic" or "base-motion"'
        )


def run_searches(search: Search, base: str, base_path: str, cases: Sequence[tuple]) -> list[dict]:
    """The rows of several cases, each given as (number, changes, history): the TOML text ``base`` with its changes."""
    return [{"case": number, **changes} | _row(search, base, base_path, changes) for number, changes, _ in cases]


def _row(search: Search, base: str, base_path: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(COLUMNS) | {"searched": search.key}
    seconds, short = 0.0, {}  # type: float, dict[float, str | None]

    def falls_at(value: float) -> bool | None:
        nonlocal seconds
        try:
            scenario = scenarios.varied(base, base_path, {**changes, search.key: value})
            check(scenario)
            try:
                found = simulate(scenario, record=False, progress=False)
            except StageFellError as error:
                found = error.result
            result = found.as_dict()
            seconds += result["wall"]["loop"]
            short[value] = _short_of_the_edge(found.assembly, result, search.tolerance)
            return fell(result)
        except UndecidedError:
            return None
        except DembrickError as error:
            raise NotConvergedError(f"{search.key} = {value:.9g}: {error}") from error

    try:
        found = search.bisect(falls_at)
    except DembrickError as error:
        return row | {"status": error.status, "error": str(error), "loop": seconds}
    remark = short[found.falls]
    numbers = {"value": found.value, "half_width": None if remark else found.half_width, **found._asdict()}
    return row | {"status": FOUND, "loop": seconds, "remark": remark} | numbers


def _short_of_the_edge(assembly: Assembly, result: Mapping, tolerance: float) -> str | None:
    """Remark if blocks fall, other than by sliding, about points that stop short of the edge by more than the
    ``tolerance``; else None."""
    ways = [(result.get(name) or {}).get("mechanism") for name in ("statics", "collapse")]
    if "sliding" in ways:
        return None
    gap, formulation = max(
        (largest_edge_shortfall(assembly.joints, assembly.contact_points, formulation=f)[0], f) for f in _INSIDE
    )
    if gap <= tolerance:
        return None
    return (
        f"no error bar: blocks topple {100.0 * gap:.2g} % early, about {formulation} points inside the edge; use "
        "concave or convex joints"
    )
