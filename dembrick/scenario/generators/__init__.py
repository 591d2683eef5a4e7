"""Structures that a scenario describes as a whole: walls, stacks, arches, domes. Each makes named blocks.

A generator is frozen data like everything a scenario says; ``build()`` lays its blocks, ``count()`` says beforehand
how many there will be at most. Walls are laid together, by ``corners.lay``, as they may meet.
"""

from dembrick.scenario.generators.arches import Arch, Dome
from dembrick.scenario.generators.stacks import Stack
from dembrick.scenario.generators.walls import Opening, Return, Wall

__all__ = ["GENERATORS", "Arch", "Dome", "Opening", "Return", "Stack", "Wall"]

GENERATORS = {"walls": Wall, "stacks": Stack, "arches": Arch, "domes": Dome}  # key of the scenario: class
