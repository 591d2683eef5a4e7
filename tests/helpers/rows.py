"""A row of a run in real time, computed from its present state."""

from dembrick.kernels.dynamics.record import write_row
from dembrick.kernels.dynamics.row_energies import BALANCE
from dembrick.simulation.dynamics.outcome import Extremes
from dembrick.simulation.dynamics.row_arrays import record_of, scene_of


def energies(moving):
    """The energies (J) of the last forces, by name."""
    record = record_of(moving, 1, balanced=True)
    write_row(record, scene_of(moving), Extremes.of(moving).noted, (0, moving.time_step, 0.0, 0.0, 0.0))
    return {name: float(record.energy[name][0]) for name in BALANCE.names}
