"""Progress bar of a run in a notebook."""

from __future__ import annotations

import html
import sys
import time
from collections.abc import Callable

from dembrick.simulation.session import Progress

PATIENCE = 1.0  # s: a run that takes less shows nothing


def notebook_bar() -> Callable[[Progress], None] | None:
    """Progress bar in the output of a cell; None if this is no notebook."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython.display import HTML, display

    began, handle = time.monotonic(), None

    def show(progress: Progress) -> None:
        nonlocal handle
        if time.monotonic() - began < PATIENCE:
            return
        picture = HTML(as_html(progress))
        if handle is None:
            handle = display(picture, display_id=True)
        else:
            handle.update(picture)

    return show


def as_html(progress: Progress) -> str:
    """HTML of a bar with a line of text."""
    share = f' value="{progress.done}" max="{progress.total}"' if progress.total else ""
    of = "" if progress.total is None else f" of {'at most ' if progress.at_most else ''}{progress.total}"
    at = "" if progress.time is None else f", t = {progress.time:.4g} s"
    return f"<progress{share}></progress> {html.escape(f'{progress.stage} {progress.done}{of}{at}')}"
