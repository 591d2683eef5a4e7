"""The user's input: blocks, joint laws, loads, actuators, controls and output, as frozen dataclasses.

``model.Scenario`` is the root; ``toml`` reads and writes it; ``generators`` build walls, arches, stacks and domes.
A scenario is data that has been validated (``checks``, ``units``); it contains no physics and runs nothing.
Input is TOML text or Python objects; output is a ``Scenario``, or a ``ScenarioError`` naming key, value and remedy.
"""
