"""Energy balance of a run in real time: opened at the start, read at every row, and audited.

It is set up in the frame of the supports: the effect of shaking or tilting them is work of gravity, which changes in
that frame. The work of supports that move relative to the others counts as that of loads. A row's energies are those of
the last forces, a step before it.
"""

from __future__ import annotations

import numpy as np

from dembrick.kernels.dynamics.energy import collect_all_losses, spring_energies, work_ahead
from dembrick.kernels.dynamics.energy_terms import CARRIED, LEDGER, LOST, PRESSURE, TOTAL, EnergyTerms
from dembrick.kernels.dynamics.tiles import put_in_lanes, rows_of_lanes
from dembrick.kernels.joint.ties import tie_energy
from dembrick.simulation.checkpoint_arrays import plain
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.joint_polygons import Polygons
from dembrick.simulation.dynamics.known_types import KnownTypes
from dembrick.simulation.dynamics.state import MovingState, out_of_balance
from dembrick.simulation.energy_audit import Sums

FLOOR = 1e-3  # of the elastic energy at the start: least reference energy for errors, which are rounding below it


class MotionEnergy:
    """The energy terms of one run: ``table`` is updated by the loop, None if energies are not wanted.

    ``start`` (2,) J: kinetic energy, and elastic energy of the joints, at time zero.
    """

    def __init__(self, state: MovingState, loads: int = 0, wanted: bool = True, supports: int = 0):
        self.start = np.zeros(2)
        self.table = _blank(state, loads, supports) if wanted else None
        self._known = KnownTypes()

    @property
    def wanted(self) -> bool:
        return self.table is not None

    def fit(self, loads: int, supports: int) -> None:
        """Resize the table for so many loads, and enlarge it for so many moving supports if necessary."""
        if self.wanted and len(self.table.load) != loads:
            self.table = self.table._replace(load=np.zeros((loads, 6)))
        if self.wanted and len(self.table.support) < supports:
            self.table = self.table._replace(support=np.zeros((supports, 6)))

    def begin(self, state: MovingState, velocity, spin, inertia, gravity, dt: float, share: np.ndarray) -> None:
        """Note the energies at time zero, after the first evaluation of forces: blocks with ``velocity`` and ``spin``
        (n, 3), ``inertia`` (n, 3, 3) in world axes, under ``gravity``; ``share`` (j,): part of the force that joints
        still carry beside new contacts. Kinetic energy is that of the leapfrog scheme, as at every later row."""
        if not self.wanted:
            return
        free, half = state.bodies.free, 0.5 * dt
        force, torque = out_of_balance(state, gravity)
        mass, v, w = state.bodies.mass[free, None], velocity[free], spin[free]
        moved = half * force[free] / mass
        turned = np.linalg.solve(inertia[free], half * torque[free, :, None])[..., 0]
        twice = (mass * (v * v - moved * moved)).sum()
        twice += (np.einsum("nij,nj,ni->n", inertia[free], w, w) - half * (torque[free] * turned).sum(axis=1)).sum()
        self.table.share[:] = share
        # the forces of new contacts are included there: only their change by the first step works over half a step
        self.table.push[:] *= -1.0
        self.start[:] = 0.5 * twice, (share * self._springs(state)[1]).sum() + tie_energy(state.ties)

    def open(self, state: MovingState) -> None:
        """Restart the balance with the next step, discarding what was summed before time zero."""
        if self.wanted:
            self.table.begun[:] = 0.0
            self._put_springs(state, self._springs(state)[0])

    def cut(self, polygons: Polygons) -> None:
        """Cut the polygons that have moved too far; the loss of elastic energy counts as released.

        The blocks have moved on meanwhile, and over that step half the work is that of the forces before the cut.
        """
        if not self.wanted:
            polygons.cut_stale()
            return
        stale, table = polygons.stale(), self.table
        held, before = self._springs(polygons.state)
        worked = self._work_ahead(polygons.state, held, stale)
        polygons.cut(stale)
        after, energy = self._springs(polygons.state)
        worked -= self._work_ahead(polygons.state, after, stale)
        self._put_springs(polygons.state, after)
        table.lost["released"][stale] += table.share[stale] * ((before - energy)[stale] + 0.5 * worked)

    def _put_springs(self, state: MovingState, held: np.ndarray) -> None:
        """Write N and its moments (a, 3) of the springs of all convex joints: the loop reads them for all joints of a
        tile or for none."""
        if state.faces is not None:
            put_in_lanes(self.table.springs, "pressure", state.faces.place, held)
            self.table.partly[:] = 1

    def _springs(self, state: MovingState) -> tuple[np.ndarray, np.ndarray]:
        """N and its moments (a, 3) of the springs of convex joints, and energy (j,) J of those of all joints."""
        n = len(state.links.host)
        held, energy = np.zeros((len(joint_families.convex_joints(state)), 3)), np.zeros(n)
        self._known.call(state, spring_energies, state.links, *joint_families.springs(state), held, energy)
        return held, energy

    def _work_ahead(self, state: MovingState, held: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Work (k,) in J of the springs of ``joints`` (k,) over the step since the last evaluation, at constant forces;
        ``held``: see `spring_energies`."""
        worked = np.zeros(len(joints))
        of_state = state.links, *joint_families.springs(state), state.bodies
        self._known.call(state, work_ahead, *of_state, held, self.table.place, joints, worked)
        return worked

    def sums(self, state: MovingState, rounding: float) -> Sums | None:
        """Sums for the audit; None without energies. ``rounding`` (J): error that rounding may cause."""
        if not self.wanted:
            return None
        table = self.table
        collect_all_losses(table, state.links)
        lost, least = _sums_of(table.lost), float(table.least.min(initial=0.0))
        stepping = lost["stepping"] + float(table.total[0].ties_stepped)
        return Sums(lost["friction"], lost["by_law"], least, stepping, FLOOR * self.start[1], rounding)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays for a restart."""
        table = {} if self.table is None else self.table._asdict()
        return {f"energy.{name}": plain(array) for name, array in table.items()} | {"energy.start": self.start}


def _sums_of(lost: np.ndarray) -> dict[str, float]:
    """Losses (J) of all joints together, by name."""
    return {name: float(lost[name].sum()) for name in LOST.names or ()}


def _blank(state: MovingState, loads: int, supports: int) -> EnergyTerms:
    """`EnergyTerms` that are all zero."""
    n, j = len(state.bodies.mass), len(state.links.host)
    tiles, convex = len(state.links.like), 0 if state.faces is None else len(state.faces.used)
    return EnergyTerms(
        dashpots=rows_of_lanes(tiles, CARRIED),
        ledger=rows_of_lanes(tiles, LEDGER),
        springs=rows_of_lanes(convex, PRESSURE),
        partly=np.zeros(convex, np.int64),
        damped=np.zeros(j),
        lost=np.zeros(j, LOST),
        least=np.zeros(j),
        share=np.ones(j),
        place=joint_families.places(state),
        fallen=np.zeros(n),
        load=np.zeros((loads, 6)),
        support=np.zeros((supports, 6)),
        push=np.zeros((n, 6)),
        total=np.zeros(1, TOTAL),
        gravity=np.zeros(3),
        begun=np.zeros(1),
    )
