"""Structures that a scenario describes as a whole: walls, stacks, arches, domes. Each makes named blocks.

A generator is frozen data like everything a scenario says; ``build()`` lays its blocks, ``count()`` says beforehand
how many there will be at most. Walls are laid together, by ``corners.lay``, as they may meet.
"""

from dembrick.scenario.generators.arches import Arch, Dome
from dembrick.scenario.generators.stacks import Stack
from dembrick.scenario.generators.walls import Opening, Return, Wall

__all__ = ["GENERATORS", "Arch", "Dome", "Opening", "Return", "Stack", "Wall", "sizes_of"]

GENERATORS = {"walls": Wall, "stacks": Stack, "arches": Arch, "domes": Dome}  # key of the scenario: class
SIZES = ("courses", "rings", "voussoirs", "blocks")  # keys that count stones, of any generator


def sizes_of(generator: Wall | Stack | Arch | Dome) -> str:
    """The keys of a generator that say how many blocks it has, for a message."""
    values = ((key, getattr(generator, key, None)) for key in SIZES)
    return " and ".join(f"{key} = {value}" for key, value in values if value is not None) or "its pattern"
