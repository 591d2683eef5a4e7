"""The ties of a scenario as geometry: which blocks, where, and along which line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import NO_VECTORS, check_inside
from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.model import Scenario


@dataclass(frozen=True, eq=False)
class TieTable:
    """Ties: ``block_a``, ``block_b`` (t,); ``arm_a``, ``arm_b`` (t, 3) m from the centroids to the ends at the start,
    world; ``direction`` (t, 3) unit, from a to b; ``length`` (t,) m; ``stiffness`` (t,) N/m, ``strength`` (t,) N,
    infinite if it never yields; ``prestress`` (t,) N; ``tension_only`` (t,)."""

    block_a: np.ndarray
    block_b: np.ndarray
    arm_a: np.ndarray
    arm_b: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    stiffness: np.ndarray
    strength: np.ndarray
    prestress: np.ndarray
    tension_only: np.ndarray

    def __len__(self) -> int:
        return len(self.block_a)


_NO_BLOCKS, _NONE = np.zeros(0, np.int64), np.zeros(0)
NO_TIES = TieTable(
    _NO_BLOCKS, _NO_BLOCKS, NO_VECTORS, NO_VECTORS, NO_VECTORS, _NONE, _NONE, _NONE, _NONE, np.zeros(0, bool)
)


def given_ties(scenario: Scenario, number: dict[str, int], bare: Assembly) -> TieTable:
    """The ties of a scenario; ``number`` of every block by name. ScenarioError if an end lies outside its block, or if
    both blocks are fixed."""
    if not scenario.ties:
        return NO_TIES
    blocks, arms, points = [], [], []
    for k, tie in enumerate(scenario.ties, 1):
        own = [number[end.block] for end in tie.between]
        if all(bare.fixed[i] for i in own):
            names = " and ".join(show(end.block) for end in tie.between)
            raise ScenarioError(f"tie number {k} joins {names}, which are both fixed, so that nothing feels it")
        blocks.append(own)
        points.append([end.point for end in tie.between])
        arms.append(
            [check_inside(f"tie number {k}", end.point, bare, i) for end, i in zip(tie.between, own, strict=True)]
        )
    block, arm, point = np.array(blocks, np.int64), np.array(arms), np.array(points, float)
    line = point[:, 1] - point[:, 0]
    length = np.sqrt((line * line).sum(axis=1))
    strength = [np.inf if tie.strength is None else tie.strength for tie in scenario.ties]
    return TieTable(
        block_a=block[:, 0].copy(),
        block_b=block[:, 1].copy(),
        arm_a=arm[:, 0].copy(),
        arm_b=arm[:, 1].copy(),
        direction=line / length[:, None],
        length=length,
        stiffness=np.array([tie.stiffness for tie in scenario.ties], float),
        strength=np.array(strength, float),
        prestress=np.array([tie.prestress for tie in scenario.ties], float),
        tension_only=np.array([tie.tension_only for tie in scenario.ties], bool),
    )
