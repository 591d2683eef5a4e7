"""Energies of a row of the record of a run in real time, from the energy terms; sums are those of numpy."""

import numpy as np

from dembrick._jit import jit_rounded
from dembrick.kernels.dynamics.energy import collect_all_losses, kinetic_energy, spring_energies
from dembrick.kernels.joint.ties import tie_energy
from dembrick.kernels.math.sums import sum_in_pairs

# Energies (J) of a row, by the names of their channels
BALANCE = np.dtype((np.record, [(name, float) for name in (
    "kinetic", "elastic", "external", "friction", "dashpots", "released", "stepping", "new_contacts", "crushing",
    "fracture", "yielding",
)]))  # fmt: skip


@jit_rounded
def sum_of_losses(record, energy_terms):
    """Losses of all joints (J): by friction, release of springs, opening and closing in steps, crushing, fracture."""
    lost = energy_terms.lost
    each = record.of_joints
    halves = record.halves
    for j in range(lost.size):
        each[j] = lost[j].friction
    friction = sum_in_pairs(each, halves)
    for j in range(lost.size):
        each[j] = lost[j].released
    released = sum_in_pairs(each, halves)
    for j in range(lost.size):
        each[j] = lost[j].stepping
    stepping = sum_in_pairs(each, halves)
    for j in range(lost.size):
        each[j] = lost[j].crushing
    crushing = sum_in_pairs(each, halves)
    for j in range(lost.size):
        each[j] = lost[j].fracture
    return friction, released, stepping, crushing, sum_in_pairs(each, halves)


@jit_rounded
def write_energies(record, bodies, links, corners, faces, ties, energy_terms, dt, out):
    """Write the energies at the last forces into the record `BALANCE` ``out``."""
    if energy_terms.begun[0] == 0.0:
        out.kinetic = record.energy_start[0]
        out.elastic = out.external = out.friction = out.dashpots = out.released = out.stepping = 0.0
        out.new_contacts = out.crushing = out.fracture = out.yielding = 0.0
        return
    collect_all_losses(energy_terms, links)
    g = energy_terms.gravity
    total = energy_terms.total[0]
    each = record.of_joints
    spring_energies(links, corners, faces, record.held, each)
    for j in range(each.size):
        each[j] *= energy_terms.share[j]
    springs = sum_in_pairs(each, record.halves)
    friction, released, stepping, crushing, fracture = sum_of_losses(record, energy_terms)
    out.kinetic = kinetic_energy(bodies, links.wrenches, g[0], g[1], g[2], dt)
    out.elastic = springs + tie_energy(ties) - record.energy_start[1]
    out.external = sum_in_pairs(energy_terms.fallen, record.halves) + total.loads
    out.friction = friction
    out.dashpots = sum_in_pairs(energy_terms.damped, record.halves)
    out.released = released + total.handed
    out.stepping = stepping + total.ties_stepped
    out.new_contacts = -total.contacts
    out.crushing = crushing
    out.fracture = fracture
    out.yielding = total.ties_yielded
