"""The energy audit of a run: whether the energy balances, and whether friction only dissipates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from dembrick.errors import EnergyAuditError
from dembrick.kernels.state import Energy

LIMIT = 1e-3  # of the energy put in: beyond it the integration is not reliable
MOTION = 1e-2  # the same of a run in real time: when blocks tumble, joints turn within a step
STEPPING = 0.1  # of the energy put in: if blocks may bounce, an impact loses at most (w dt)^2 / 4 = 0.09 of its own
GIVEN = 1e-3  # of the energy put in: energy that joints may return by rounding and by opening within steps
NEGATIVE = 1e-6  # of the energy put in: energy that friction may return in an increment in which slip reverses
BROKEN = 1e-3  # the same if brittle bonds break: blocks swing then, as in a run in real time
SLIP = 0.1  # of the energy put in: between the friction work and the sum of mu N |slip increment|, of first order


@dataclass(frozen=True)
class EnergyAudit:
    """Result of the audit.

    ``relative_residual``: kinetic + elastic + actuator spring + friction + dashpots - external work, the worst row,
    over the energy put in. ``friction_law_error``: friction work over the sum of mu N |slip increment| (the dissipation
    function for a convex joint), minus 1; of first order in the step. ``least_friction_increment`` (J).
    """

    relative_residual: float
    friction_law_error: float
    least_friction_increment: float

    def as_dict(self) -> dict:
        return asdict(self)


@dataclass(frozen=True)
class MotionAudit(EnergyAudit):
    """Result of the audit of a run in real time, relative to the external work and the initial kinetic energy.

    So is ``friction_law_error``, friction work less that of its law, as friction may be negligible in impacts.
    ``step_error``: net energy that contacts took from the motion by opening or closing within a time step.
    It is of second order in the step; at an impact no more than (w dt)^2 / 4 of its energy, w the frequency of the
    contact.
    """

    step_error: float


@dataclass(frozen=True)
class Sums:
    """Energies of a run in real time for the audit (J): friction, the same by its law, the least of a step;
    ``stepping``: energy taken by contacts that open and close within steps; ``floor``: least reference energy for
    errors; ``rounding``: energy that rounding of positions may create, below which there is no error."""

    friction: float
    by_law: float
    least: float
    stepping: float
    floor: float
    rounding: float


class Auditor:
    """Audits energies as they are recorded.

    ``worst`` (3,) J: greatest residual, most energy put in so far, kinetic energy of the first row (NaN before it).
    The energy put in is the external work plus the initial kinetic energy; or the forces of actuators times
    their displacements plus the latter, if that is more, as a rocking block passes their work on to gravity.
    """

    def __init__(self):
        self.worst = np.array([0.0, 0.0, np.nan])

    def observe(self, rows: Mapping) -> Auditor:
        """Add the next rows of a record, with the work of their actuators. Returns itself."""
        if not np.size(rows.get("actuator_force", ())):
            return self.add(rows["energy"])
        return self.add(rows["energy"], np.abs(rows["actuator_force"] * rows["actuator_displacement"]).sum(axis=1))

    def add(self, energies: Mapping[str, np.ndarray], pushed: np.ndarray | float = 0.0) -> Auditor:
        """Add the next energies, (T,) in J by name; some runs have none. ``pushed`` (T,) J: forces of actuators times
        their displacements. Returns itself."""
        if not energies or not len(energies["external"]):
            return self
        if np.isnan(self.worst[2]):
            self.worst[2] = energies["kinetic"][0]
        there = self.worst[2]
        gone = sum(values for name, values in energies.items() if name != "external")
        put_in = np.maximum(np.abs(energies["external"]), pushed) + there
        for i, term in enumerate((gone - energies["external"] - there, put_in)):
            self.worst[i] = np.maximum(self.worst[i], np.abs(term).max())  # a NaN stays
        return self

    def result(self, energy: Energy | Sums, custom: bool = False) -> EnergyAudit:
        """The audit; EnergyAuditError if the energy terms do not balance, or if joints with a ``custom`` law returned
        more energy than they took, which no built-in law does."""
        residual, scale = (float(value) for value in self.worst[:2])
        friction = float(energy.friction if isinstance(energy, Sums) else energy.work[0].sliding)
        if custom and friction < -GIVEN * scale:
            raise EnergyAuditError(
                f"the joints gave back {-friction:.2g} J more than they took: a custom joint law must return the "
                "energy that its springs store at the forces that it returns"
            )
        if isinstance(energy, Sums):
            return _of_motion(residual, max(scale, energy.floor, energy.rounding / MOTION), energy)
        by_law = float(energy.work[0].by_law)
        scale = max(scale, by_law)  # with few rows none may show the energy put in
        relative = residual / scale if scale else 0.0
        result = EnergyAudit(relative, friction / by_law - 1.0 if by_law else 0.0, float(energy.work[0].least))
        breaks = float(energy.work[0].fracture) > 0.0
        limit, negative = (MOTION, BROKEN) if breaks else (LIMIT, NEGATIVE)
        if not relative <= limit:
            raise EnergyAuditError(
                f"the energy balance is off by {relative:.2g} of the energy put in (limit {limit:g}): the time step "
                "does not resolve this motion; lower solver.step_factor or the rate"
            )
        if not abs(friction - by_law) <= SLIP * scale:
            raise EnergyAuditError(
                f"the friction work is off by {(friction - by_law) / scale:.2g} of the energy put in (limit "
                f"{SLIP:g}): the steps do not resolve the slip; lower solver.step_factor or the rate"
            )
        if result.least_friction_increment < -negative * scale:
            raise EnergyAuditError(
                f"friction gave back {-result.least_friction_increment:.2g} J in one increment: slip reverses within "
                "a time step; lower solver.step_factor or the rate"
            )
        return result


def _of_motion(residual: float, scale: float, energy: Sums) -> MotionAudit:
    """The audit of a run in real time, residual and scale in J."""
    relative, stepping = (residual / scale, energy.stepping / scale) if scale else (0.0, 0.0)
    law_error = (energy.friction - energy.by_law) / scale if scale else 0.0
    result = MotionAudit(relative, law_error, energy.least, stepping)
    if not relative <= MOTION:
        raise EnergyAuditError(
            f"the energy balance is off by {relative:.2g} of the energy put in (limit {MOTION:g}): the time step "
            "does not resolve this motion; lower solver.step_factor"
        )
    if not abs(stepping) <= STEPPING:
        raise EnergyAuditError(
            f"contacts that open and close within a time step created or removed {abs(stepping):.2g} of the energy "
            f"put in (limit {STEPPING:g}): lower solver.step_factor"
        )
    return result
