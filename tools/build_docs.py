"""Build the documentation: ``python tools/build_docs.py [OUT]``. Needs no network; a warning is an error.

The tutorials are run during the build, so their numbers and pictures are those of this version. Executed pages are
cached in the output folder: a second build runs only those that have changed.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


LOG = re.compile(r"(/\S+\.log)\b")


def main() -> int:
    """Run Sphinx; returns its exit code. If a cell of a tutorial fails, the last line of its error is printed."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "_build"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", ROOT / "docs", out / "html"]
    done = subprocess.run(
        [*map(str, command), "-d", str(out / "doctrees")], stderr=subprocess.PIPE, text=True, errors="replace"
    )
    print(done.stderr, end="", file=sys.stderr)
    if done.returncode:
        for path in dict.fromkeys(LOG.findall(done.stderr)):
            line = last_error(Path(path))
            if line:
                print(f"the cell that failed: {line}", file=sys.stderr)
    return done.returncode


def last_error(log: Path) -> str:
    """The last line ``SomeError: reason`` in a Sphinx log that names an exception of a cell, or an empty text."""
    if not log.is_file():
        return ""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", log.read_text(encoding="utf-8", errors="replace"))
    lines = [line.strip() for line in plain.splitlines()]
    errors = [line for line in lines if re.match(r"[A-Za-z_.]+(Error|Dependency|Exception)\b.*: \S", line)]
    return next((line for line in reversed(errors) if "ExecutionError" not in line and "Sphinx" not in line), "")


if __name__ == "__main__":
    sys.exit(main())
