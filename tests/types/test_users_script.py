"""mypy of a user's script against the installed package finds types, not Any: right ones pass, wrong ones do not."""

import os
import shutil
import site
import subprocess
import sys
from pathlib import Path

import pytest

import dembrick

pytest.importorskip("mypy")

# Packages beside ours are not read, which takes most of the time; the types of ours hold without theirs.
SETTINGS = """
[mypy]
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
"""


def test_types_are_found_outside_the_checkout(tmp_path):
    """In a folder of the user's, with no setting but that other packages are passed over."""
    shutil.copy(Path(__file__).with_name("users_script.py"), tmp_path / "right.py")
    (tmp_path / "wrong.py").write_text(WRONG)
    home = Path(dembrick.__file__).resolve().parents[1]
    found = {**os.environ}
    if home not in {Path(folder).resolve() for folder in site.getsitepackages()}:  # a checkout, beside the tests
        found["MYPYPATH"] = str(home)
    (tmp_path / "mypy.ini").write_text(SETTINGS)
    command = [sys.executable, "-m", "mypy", "--config-file=mypy.ini", "--cache-dir=cache", "right.py", "wrong.py"]
    done = subprocess.run(command, cwd=tmp_path, env=found, capture_output=True, text=True, check=False)
    faults = [line.partition(": error: ")[2] for line in done.stdout.splitlines() if ": error: " in line]
    assert "right.py" not in done.stdout, done.stdout + done.stderr
    assert len(faults) == 3, done.stdout + done.stderr
    for fault, said in zip(faults, ('"courses"', '"refines"', '"friktion"'), strict=True):
        assert said in fault
