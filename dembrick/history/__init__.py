"""History files (HDF5): written during the run, readable at any time, also after a kill.

A file in progress has all its datasets from the start, longer than needed. New rows go into the reserved space by plain
writes, then the count in ``/written`` is increased. HDF5's own structure, which cannot be updated atomically, is never
modified during the run. To extend the reserved space, and to finish, a new file is made beside the old one and renamed.
"""

from dembrick.history import recorded
from dembrick.history.checkpoint import Checkpoint, Checkpoints
from dembrick.history.claims import claimed
from dembrick.history.files import check_output, part_name, reason, replacing, write_whole
from dembrick.history.hdf5_files import rewritten
from dembrick.history.inputs import inputs_of
from dembrick.history.products import is_ours, product, refuse_foreign, refuse_inputs
from dembrick.history.reader import History, is_of, read
from dembrick.history.writer import OWN, HistoryWriter

read_history = read  # name at the top level of the package

__all__ = [
    "OWN",
    "Checkpoint",
    "Checkpoints",
    "History",
    "HistoryWriter",
    "check_output",
    "claimed",
    "inputs_of",
    "is_of",
    "is_ours",
    "part_name",
    "product",
    "read",
    "read_history",
    "reason",
    "recorded",
    "refuse_foreign",
    "refuse_inputs",
    "replacing",
    "rewritten",
    "write_whole",
]
