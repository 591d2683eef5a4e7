"""Generators of whole structures: walls, stacks, arches, domes. Each makes named blocks.

A generator is frozen data like the rest of a scenario; ``build()`` makes its blocks, ``count()`` gives an upper bound
of their number in advance. Walls are built together, by ``corners.lay``, as they may meet.
"""

from dembrick.scenario.generators.arches import Arch, Dome
from dembrick.scenario.generators.stacks import Stack
from dembrick.scenario.generators.walls import Opening, Return, Wall

__all__ = ["GENERATORS", "Arch", "Dome", "Opening", "Return", "Stack", "Wall", "sizes_of"]

GENERATORS = {"walls": Wall, "stacks": Stack, "arches": Arch, "domes": Dome}  # key of the scenario: class
SIZES = ("courses", "rings", "voussoirs", "blocks")  # keys that set numbers of blocks, of all generators


def sizes_of(generator: Wall | Stack | Arch | Dome) -> str:
    """The keys of a generator that set its number of blocks, for a message."""
    values = ((key, getattr(generator, key, None)) for key in SIZES)
    return " and ".join(f"{key} = {value}" for key, value in values if value is not None) or "its pattern"
