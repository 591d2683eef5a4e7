"""mypy finds types, not Any, in scripts that use the installed package: correct ones pass, wrong ones are reported."""

import os
import re
import shutil
import site
import subprocess
import sys
from pathlib import Path

import pytest

import dembrick
from dembrick.scenario.controls import CONTROLS
from helpers.places import ROOT

pytest.importorskip("mypy")

# Other packages are skipped, as reading them takes most of the time; our types can be checked without theirs.
SETTINGS = """
[mypy]
strict = true
ignore_missing_imports = true
follow_imports = silent
[mypy-numpy.*,numba.*,h5py.*,scipy.*,matplotlib.*,pyvista.*,vtkmodules.*,pandas.*,xarray.*,distributed.*,dask.*]
follow_imports = skip
follow_imports_for_stubs = true
"""

WRONG = """
import dembrick

wall = dembrick.Wall("wall", "stone", block=(0.3, 0.2, 0.1), courses="six", blocks=4)
result = dembrick.simulate("set4a", refines=True)
print(dembrick.load("set4a").joint.friktion)
searched_or_shaken = dembrick.simulate("set4a")
print(searched_or_shaken.yield_point.V)
stands: dembrick.Scenario[dembrick.StaticsControl]
dembrick.simulate(stands).mass
"""
SAID = ('"courses"', '"refines"', '"friktion"', '"V"', '"mass"')


def test_types_are_found_outside_the_checkout(tmp_path):
    """mypy in a folder of the user, strict, with other packages skipped."""
    here, right = Path(__file__).parent, tmp_path / "right"
    right.mkdir()
    for script in ("users_script.py", "users_controls.py"):
        shutil.copy(here / script, right)
    snippets = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    (right / "readme.py").write_text("\n".join(snippets))
    assert "simulate" in snippets[0]
    controls = (here / "users_controls.py").read_text()
    assert all(f"dembrick.{kind.__name__}(" in controls for kind in CONTROLS.values())
    (tmp_path / "wrong.py").write_text(WRONG)
    home = Path(dembrick.__file__).resolve().parents[1]
    found = {**os.environ}
    if home not in {Path(folder).resolve() for folder in site.getsitepackages()}:  # a checkout, not an installation
        found["MYPYPATH"] = str(home)
    (tmp_path / "mypy.ini").write_text(SETTINGS)
    command = [sys.executable, "-m", "mypy", "--config-file=mypy.ini", "--cache-dir=cache", "right", "wrong.py"]
    done = subprocess.run(command, cwd=tmp_path, env=found, capture_output=True, text=True, check=False)
    faults: dict[str, str] = {}  # the first fault of every line
    for place, _, fault in (line.partition(": error: ") for line in done.stdout.splitlines() if ": error: " in line):
        faults.setdefault(place, fault)
    assert not [line for line in done.stdout.splitlines() if "right" in line], done.stdout + done.stderr
    for fault, said in zip(faults.values(), SAID, strict=True):
        assert said in fault
