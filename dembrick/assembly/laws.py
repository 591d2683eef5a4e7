"""Lookup of the joint law between two blocks: the default, or the last override that names them."""

from __future__ import annotations

from dembrick.scenario.model import JointLaw, Scenario


class Laws:
    """Joint laws of a scenario; the law of two blocks is the last override that names them or their groups."""

    def __init__(self, scenario: Scenario):
        self.default = scenario.joint
        self.overrides = scenario.joints
        self.ends = [tuple(frozenset(scenario.members(name)) for name in entry.between) for entry in scenario.joints]

    @property
    def all(self) -> tuple[JointLaw, ...]:
        """The laws of the scenario: its default and those of the overrides."""
        return (self.default, *(entry.law for entry in self.overrides))

    def covers(self, number: int, a: int, b: int) -> bool:
        """Whether the override ``number`` applies to a pair of blocks."""
        first, second = self.ends[number]
        return (a in first and b in second) or (a in second and b in first)

    def between(self, a: int, b: int) -> JointLaw:
        """The law of the joints between two blocks."""
        for number in range(len(self.overrides) - 1, -1, -1):
            if self.covers(number, a, b):
                return self.overrides[number].law
        return self.default
