#!/bin/sh
# Runs the tests that a plain `pytest` leaves out because they take minutes, and kernels compiled with bounds checked.
# Further arguments go to the first. $PYTHON names the interpreter, by default the `python` of the active environment.
set -eu
cd "$(dirname "$0")/.."
"${PYTHON:-python}" -m pytest -m slow "$@"
NUMBA_OPT=1 NUMBA_BOUNDSCHECK=1 exec "${PYTHON:-python}" -m pytest tests/kernels
