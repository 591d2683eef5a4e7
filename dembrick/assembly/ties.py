"""The ties of a scenario as geometry: blocks, end points and directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import NO_VECTORS, Attached, check_inside
from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.model import Scenario


@dataclass(frozen=True, eq=False)
class TieTable:
    """Ties: ``ends`` (t, 2) on a block a and a block b; ``direction`` (t, 3) unit, from a to b; ``length`` (t,) m;
    ``stiffness`` (t,) N/m; ``strength`` (t,) N, infinite if it never yields; ``prestress`` (t,) N; ``tension_only``
    (t,)."""

    ends: Attached
    direction: np.ndarray
    length: np.ndarray
    stiffness: np.ndarray
    strength: np.ndarray
    prestress: np.ndarray
    tension_only: np.ndarray

    def __len__(self) -> int:
        return len(self.ends)


_NONE = np.zeros(0)
_NO_ENDS = Attached(np.zeros((0, 2), np.int64), np.zeros((0, 2, 3)), np.zeros((0, 2, 3)))
NO_TIES = TieTable(_NO_ENDS, NO_VECTORS, _NONE, _NONE, _NONE, _NONE, np.zeros(0, bool))


def given_ties(scenario: Scenario, number: dict[str, int], bare: Assembly) -> TieTable:
    """The ties of a scenario; ``number``: index of every block by name. Raises ScenarioError if an end lies outside its
    block, or if both blocks are fixed."""
    if not scenario.ties:
        return NO_TIES
    blocks, arms, points = [], [], []
    for k, tie in enumerate(scenario.ties, 1):
        own = [number[end.block] for end in tie.between]
        if all(bare.fixed[i] for i in own):
            names = " and ".join(show(end.block) for end in tie.between)
            raise ScenarioError(f"tie number {k} joins {names}, which are both fixed, so it has no effect; remove it")
        blocks.append(own)
        points.append([end.point for end in tie.between])
        arms.append(
            [check_inside(f"tie number {k}", end.point, bare, i) for end, i in zip(tie.between, own, strict=True)]
        )
    point = np.array(points, float)
    line = point[:, 1] - point[:, 0]
    length = np.sqrt((line * line).sum(axis=1))
    strength = [np.inf if tie.strength is None else tie.strength for tie in scenario.ties]
    return TieTable(
        ends=Attached.to(bare, blocks, arms),
        direction=line / length[:, None],
        length=length,
        stiffness=np.array([tie.stiffness for tie in scenario.ties], float),
        strength=np.array(strength, float),
        prestress=np.array([tie.prestress for tie in scenario.ties], float),
        tension_only=np.array([tie.tension_only for tie in scenario.ties], bool),
    )
