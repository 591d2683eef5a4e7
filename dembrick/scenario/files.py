"""The files that a scenario names, as paths: they are looked for beside the scenario, and are never written over."""

from __future__ import annotations

import os

from dembrick.scenario.blocks import Block, Part
from dembrick.scenario.model import Scenario


def inputs_of(scenario: Scenario) -> list[str]:
    """The scenario's own file, and every mesh and history in time that it names."""
    shaken = getattr(scenario.control, "file", None)
    named = [*(shaken if isinstance(shaken, tuple) else [shaken]), *(load.history for load in scenario.loads)]
    for block in scenario.all_blocks:
        solids: list[Block | Part] = [block, *(block.parts or ())]
        named += [solid.mesh.file for solid in solids if solid.mesh is not None]
    named += [model.file for model in scenario.models]
    folder = os.path.dirname(scenario.path or "")
    own = [scenario.path] if scenario.path else []
    return own + [os.path.join(folder, name) for name in dict.fromkeys(named) if name]
