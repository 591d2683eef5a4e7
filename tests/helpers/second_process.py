"""Functions that tests run in a second process, and a way to start scripts."""

import os
import subprocess
import sys
import time
from pathlib import Path

from dembrick import _kernel_cache


def hold(folder, byte):
    """Claim a byte and keep it as long as this process lives."""
    assert _kernel_cache.claims_in(Path(folder)).take(byte)
    time.sleep(600.0)


def python(code, cache):
    """Start a script in its own process with its own kernel cache; it may start a second process on any machine."""
    environment = {**os.environ, "DEMBRICK_CACHE_DIR": str(cache), "DEMBRICK_COMPILE_AHEAD": "1"}
    helpers = str(Path(__file__).parents[1])
    environment["PYTHONPATH"] = os.pathsep.join([environment["PYTHONPATH"], helpers])
    code = "from dembrick import _ahead\n_ahead.cores = lambda: 2\n" + code
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code], env=environment, stdin=pipe, stdout=pipe, text=True)
