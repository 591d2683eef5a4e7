#!/bin/sh
# Runs the tests that a plain `pytest` leaves out because they take minutes. Further arguments go to pytest.
# $PYTHON names the interpreter, by default the `python` of the active environment.
set -eu
cd "$(dirname "$0")/.."
exec "${PYTHON:-python}" -m pytest -m slow "$@"
