"""The logger ``dembrick`` of runs from Python: remarks have the level WARNING, scenarios and results INFO.

It stays silent until the user sets up logging, as by ``logging.basicConfig(level="INFO")``.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial

LOGGER = logging.getLogger("dembrick")
LOGGER.addHandler(logging.NullHandler())


def heard_by(report: Callable[[str], None] | None) -> Callable[[str], None] | None:
    """Function that receives the remarks of a run: ``report``, else the logger if it has a handler, else None."""
    if report is not None:
        return report
    logger: logging.Logger | None = LOGGER
    while logger is not None:
        if any(not isinstance(handler, logging.NullHandler) for handler in logger.handlers):
            return partial(LOGGER.warning, "%s")
        logger = logger.parent if logger.propagate else None
    return None
