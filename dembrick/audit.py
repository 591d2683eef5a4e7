"""The energy audit of a run: do the books balance, and did friction only ever take energy away?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from dembrick.errors import EnergyAuditError
from dembrick.state import BY_LAW, LEAST, SLIDING, Energy

LIMIT = 1e-3  # of the external work: beyond it the integration is not to be trusted
NEGATIVE = 1e-12  # of the external work: friction work of one increment below minus this is no rounding


@dataclass(frozen=True)
class EnergyAudit:
    """Result of the audit.

    ``relative_residual``: kinetic + elastic + jack spring + friction + dashpots - external work, the worst row, over
    the external work. ``friction_law_error``: friction work over the sum of mu N |slip increment| (the dissipation
    function for a convex joint), minus 1; of first order in the step. ``least_friction_increment`` (J).
    """

    relative_residual: float
    friction_law_error: float
    least_friction_increment: float

    def as_dict(self) -> dict:
        """As in the JSON output."""
        return asdict(self)


class Auditor:
    """Audits recorded energies as they come; ``worst`` (2,) J: greatest residual, greatest external work so far."""

    def __init__(self):
        self.worst = np.zeros(2)

    def add(self, energies: Mapping[str, np.ndarray]) -> None:
        """Take the next rows, (T,) in J by name; a run in real time has none."""
        if not energies:
            return
        stored = energies["kinetic"] + energies["elastic"] + energies["jack_spring"]
        residual = stored + energies["friction"] + energies["dashpots"] - energies["external"]
        for i, term in enumerate((residual, energies["external"])):
            self.worst[i] = np.maximum(self.worst[i], np.abs(term).max(initial=0.0))  # a NaN stays

    def result(self, books: Energy) -> EnergyAudit:
        """The audit; EnergyAuditError where the books do not balance."""
        residual, scale = (float(value) for value in self.worst)
        relative = residual / scale if scale else 0.0
        by_law, friction = float(books.work[BY_LAW]), float(books.work[SLIDING])
        result = EnergyAudit(relative, friction / by_law - 1.0 if by_law else 0.0, float(books.work[LEAST]))
        if not relative <= LIMIT:
            raise EnergyAuditError(
                f"the energy books are off by {relative:.2g} of the external work (limit {LIMIT:g}): the time step "
                "does not resolve this motion; lower solver.step_factor or the rate"
            )
        if result.least_friction_increment < -NEGATIVE * scale:
            raise EnergyAuditError(
                f"friction gave back {-result.least_friction_increment:.2g} J in one increment: slip turns about "
                "within a time step; lower solver.step_factor or the rate"
            )
        return result


def audit(energies: Mapping[str, np.ndarray], books: Energy) -> EnergyAudit:
    """Audit recorded energies (T,) in J; EnergyAuditError where they do not balance."""
    auditor = Auditor()
    auditor.add(energies)
    return auditor.result(books)
