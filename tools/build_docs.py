"""Build the documentation: ``python tools/build_docs.py [OUT]``. Without network; a warning is an error.

The tutorials are run while they are built, so their numbers and pictures are those of this version. Executed pages are
cached in the output folder: a second build runs only what has changed.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    """Run Sphinx; returns its exit code."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "_build"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", ROOT / "docs", out / "html"]
    return subprocess.call([*map(str, command), "-d", str(out / "doctrees")])


if __name__ == "__main__":
    sys.exit(main())
