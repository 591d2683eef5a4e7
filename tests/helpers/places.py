"""Folders of the repository, and modules of tools/."""

import importlib
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
SCENARIOS = ROOT / "scenarios"
TOOLS = ROOT / "tools"


def tool_module(name):
    """A module of tools/, imported with its folder on the path so that it finds the other tools."""
    sys.path.insert(0, str(TOOLS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(TOOLS))
