"""Export of histories to other programs: VTKHDF and PVD for ParaView, CSV for everything else; tables for pandas and
xarray.

A picture has up to four layers, each in a file of its own: the blocks, their joints (``<stem>_joints``), the forces at
the contact points (``<stem>_contacts``) and the ties (``<stem>_ties``). See ``layers`` for their quantities.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from functools import partial

from dembrick.errors import OutputError, ScenarioError
from dembrick.history import History
from dembrick.history.tables import to_pandas, to_xarray
from dembrick.views.export.layers import LAYERS
from dembrick.views.export.pvd import to_pvd
from dembrick.views.export.text import to_csv
from dembrick.views.export.vtkhdf import to_vtkhdf
from dembrick.views.given import accepts_paths

__all__ = ["LAYERS", "export", "to_csv", "to_pandas", "to_pvd", "to_vtkhdf", "to_xarray"]


@accepts_paths
def export(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """Write the history in the format given by the ending of ``path``; returns the files written, in the folder as
    ``path`` spells it.

    ``report`` is called with a sentence, including the remedy, for each quantity missing in the history. ``only``: the
    layers to write (blocks, joints, contacts, ties); a text file always has all series.
    """
    unknown = [layer for layer in only if layer not in LAYERS]
    if unknown or not only:
        raise ScenarioError(f"layers = {list(only)} is empty or has unknown names; choose from {', '.join(LAYERS)}")
    ending = os.path.splitext(os.fspath(path))[1].lower()
    writers = {".vtkhdf": partial(to_vtkhdf, only=only), ".pvd": partial(to_pvd, only=only), ".csv": to_csv}
    if ending not in writers:
        raise OutputError(f"{path}: no export has the ending {ending!r}; use one of {', '.join(writers)}")
    folder = os.path.dirname(os.fspath(path))
    home = os.path.join(os.path.realpath(folder), "")
    files = [
        os.path.join(folder, file.removeprefix(home)) if file.startswith(home) else file  # else a link elsewhere
        for file in writers[ending](history, path, report)
    ]
    if not files:
        raise ScenarioError(f"{path}: the history has no {' or '.join(only)}; leave --layers out")
    return files
