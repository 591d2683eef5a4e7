"""The ``%%bash`` of the tutorials: prints the output of the commands in one piece, and raises if one of them fails."""

import os
import subprocess
import sys

from IPython.core.magic import register_cell_magic

ENVIRONMENT = {**os.environ, "NO_COLOR": "1", "PATH": os.path.dirname(sys.executable) + os.pathsep + os.environ["PATH"]}


@register_cell_magic
def bash(line: str, cell: str) -> None:
    """Run a cell by bash, in the folder of the tutorial."""
    done = subprocess.run(["bash", "-eu", "-c", cell], capture_output=True, text=True, env=ENVIRONMENT)
    print(done.stdout, end="")
    if done.returncode:
        raise RuntimeError(f"{cell.strip()} ended with exit code {done.returncode}: {done.stderr}")
