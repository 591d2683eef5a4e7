"""Histories in the formats of other programs: VTKHDF and PVD for ParaView, CSV for everything else.

A picture has three layers, each with a file of its own: the blocks, their joints (``<stem>_joints``) and the forces in
the contact points (``<stem>_contacts``). See ``layers`` for what they carry.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from dembrick.errors import OutputError
from dembrick.export.pvd import to_pvd
from dembrick.export.text import to_csv
from dembrick.export.vtkhdf import to_vtkhdf
from dembrick.history import History

__all__ = ["export", "to_csv", "to_pvd", "to_vtkhdf"]


def export(history: History, path: str | os.PathLike, report: Callable[[str], None] | None = None) -> list[str]:
    """Write the history in the format that the ending of ``path`` names; returns the files written.

    ``report`` gets a sentence for each quantity that the history does not hold, with the remedy.
    """
    ending = os.path.splitext(os.fspath(path))[1].lower()
    writers = {".vtkhdf": to_vtkhdf, ".pvd": to_pvd, ".csv": to_csv}
    if ending not in writers:
        raise OutputError(f"{path}: no export has the ending {ending!r}; the known endings are {', '.join(writers)}")
    return writers[ending](history, path, report)
