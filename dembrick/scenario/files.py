"""Paths of the files that a scenario names: relative ones start at the scenario's folder; none is ever overwritten."""

from __future__ import annotations

import os

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Part
from dembrick.scenario.model import Scenario
from dembrick.scenario.stages import controls_of


def names_of(scenario: Scenario) -> list[str]:
    """Names of all meshes, models and time histories that the scenario reads, each once."""
    named = [load.history for load in scenario.loads]
    named += [name for control in controls_of(scenario) for name in control.files]
    for block in scenario.all_blocks:
        solids: list[Block | Part] = [block, *(block.parts or ())]
        named += [solid.mesh.file for solid in solids if solid.mesh is not None]
    named += [model.file for model in scenario.models]
    return [name for name in dict.fromkeys(named) if name]


def companions_of(path: str) -> list[str]:
    """Files that the file at a path refers to, relative to its folder: the buffers of a glTF scene."""
    if os.path.splitext(path)[1].lower() not in (".gltf", ".glb"):
        return []
    from dembrick.geometry.gltf_file import buffers_beside

    try:
        return buffers_beside(path)
    except ScenarioError:
        return []  # the reader of the scene reports the error


def inputs_of(scenario: Scenario) -> list[str]:
    """The scenario's own file, and every mesh and time history that it names."""
    own = [scenario.path] if scenario.path else []
    return own + [scenario.path_of(name) for name in names_of(scenario)]
