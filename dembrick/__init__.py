"""Replays of laboratory tests of dry-stacked stone blocks by explicit dynamics.

    >>> import dembrick
    >>> result = dembrick.simulate("scenarios/set4a.toml")
    >>> result.yield_point.V, result.yield_point.half_width

Nothing heavy is imported until a name is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # for editors and type checkers, which do not follow names that are imported when they are used
    from dembrick.history import read as read_history  # noqa: F401
    from dembrick.runs.domain import simulate_domain as simulate_domain
    from dembrick.runs.lab import replay_lab as replay_lab
    from dembrick.runs.limit import limit as limit
    from dembrick.runs.limit import reaction as reaction
    from dembrick.runs.result import Result as Result
    from dembrick.runs.simulate import restart as restart
    from dembrick.runs.simulate import simulate as simulate
    from dembrick.runs.study import sweep as sweep
    from dembrick.scenario.toml import dumps as dumps
    from dembrick.scenario.toml import load as load
    from dembrick.scenario.toml import loads as loads

__version__ = "0.1.0"

_HOMES = {
    "load": "dembrick.scenario.toml",
    "loads": "dembrick.scenario.toml",
    "dumps": "dembrick.scenario.toml",
    "simulate": "dembrick.runs.simulate",
    "restart": "dembrick.runs.simulate",
    "limit": "dembrick.runs.limit",
    "reaction": "dembrick.runs.limit",
    "simulate_domain": "dembrick.runs.domain",
    "Result": "dembrick.runs.result",
    "read_history": "dembrick.history",
    "replay_lab": "dembrick.runs.lab",
    "sweep": "dembrick.runs.study",
}
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module 'dembrick' has no attribute {name!r}")
    from importlib import import_module

    home = import_module(_HOMES[name])
    return getattr(home, "read" if name == "read_history" else name)


def __dir__():
    return sorted(__all__)
