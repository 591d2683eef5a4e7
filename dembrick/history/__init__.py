"""History files (HDF5): written as the run goes, readable at any moment, also after a kill.

A file that is being written has all its datasets from the start, longer than needed. New rows are put into the
reserved space with plain writes, then the count in ``/written`` is raised: HDF5's own structure, which no system
writes in one piece, is never touched while the run goes on. Growing past the reserved space and finishing make a new
file beside the old one and rename it.
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

read_history = read  # its name at the top of the package

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
