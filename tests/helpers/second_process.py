"""What tests have a second process do, and scripts that start one."""

import os
import subprocess
import sys
import time
from pathlib import Path

from dembrick import _kernel_cache


def hold(folder, byte):
    """Claim a byte for as long as this process lives."""
    assert _kernel_cache.claims_in(Path(folder)).take(byte)
    time.sleep(600.0)


def python(code, cache):
    """Start a script in a process of its own, with a kernel cache of its own, that may start another on any machine."""
    environment = {**os.environ, "DEMBRICK_CACHE_DIR": str(cache), "DEMBRICK_COMPILE_AHEAD": "1"}
    helpers = str(Path(__file__).parents[1])
    environment["PYTHONPATH"] = os.pathsep.join([environment["PYTHONPATH"], helpers])
    code = "from dembrick import _ahead\n_ahead.cores = lambda: 2\n" + code
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code], env=environment, stdin=pipe, stdout=pipe, text=True)
