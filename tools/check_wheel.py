"""Install a wheel with kernels beside this Python's packages and check that first runs compile nothing.

    python tools/check_wheel.py dist/dembrick-*.whl

A new environment uses the dependencies of dembrick from the one that runs this. With empty caches it runs a laboratory
set, a wall, a ground motion record and ``lab``; each must succeed without any compilation, and V of the set must equal
that of the dembrick that runs this, compiled here, to the last digit. Exits with 1 otherwise.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import tempfile
import time
import venv
from pathlib import Path

COUNTED = """
import sys
from dembrick._jit import hearing
from dembrick.cli import main
begun = []
with hearing(("numba:compile",), lambda: begun.append(1)):
    code = main(sys.argv[1:])
print(f"compiled {len(begun)}", file=sys.stderr)
sys.exit(code)
"""
RUNS = (
    ["run", "set4a", "--json", "--out", "set4a.h5"],
    ["run", "wall_tilt", "--out", "wall.h5"],
    ["run", "newmark_pulse", "--out", "record.h5"],
    ["lab", "--out", "lab"],
)


def installed(wheel: Path, folder: Path) -> Path:
    """Python of a new environment with the wheel and the packages of this environment."""
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    site = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", site, str(wheel)]
    subprocess.run(command, check=True)
    (Path(site) / "beside.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return python


def run(python: Path | str, folder: Path, arguments: list[str]) -> tuple[str, int]:
    """Output of a command of dembrick, and number of kernels that it compiled; an error ends the check."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "DEMBRICK_"))}
    environment.pop("PYTHONPATH", None)
    if str(python) != sys.executable:
        environment["DEMBRICK_CACHE_DIR"] = str(folder / "cache")
    command = [str(python), "-c", COUNTED, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"error: dembrick {' '.join(arguments)}:\n{done.stderr}")
    return done.stdout, int(done.stderr.split()[-1])


def main() -> int:
    """Install, run, compare."""
    if len(sys.argv) != 2:
        sys.exit(__doc__.split("\n\n")[1].strip())
    wheel = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(prefix="dembrick-check-") as name:
        folder = Path(name)
        python = installed(wheel, folder)
        wrong, said = [], {}
        for arguments in RUNS:
            began = time.perf_counter()
            said[arguments[1]], compiled = run(python, folder, arguments)
            print(f"{' '.join(arguments[:2]):20} {time.perf_counter() - began:6.2f} s, {compiled} kernels compiled")
            if compiled:
                wrong.append(f"dembrick {' '.join(arguments[:2])} compiled {compiled} kernels")
        here = folder / "here"
        here.mkdir()
        V = [json.loads(text)["yield_point"]["V"] for text in (said["set4a"], run(sys.executable, here, RUNS[0])[0])]
        print(f"V {V[0]!r} N, compiled here {V[1]!r} N")
        if V[0] != V[1]:
            wrong.append("V of set4a is another than that of kernels compiled here")
    print(*wrong, sep="\n", end="\n" if wrong else "")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
