"""The user's input: blocks, joint laws, loads, actuators, controls and output, as frozen dataclasses.

``model.Scenario`` is the root; ``toml`` reads and writes it; ``generators`` lay walls, arches, stacks and domes.
A scenario is data: it is checked for sense (``checks``, ``limits``), it holds no physics and runs nothing.
In goes TOML text or Python objects, out comes a ``Scenario`` or a ``ScenarioError`` that names key, value and remedy.
"""
