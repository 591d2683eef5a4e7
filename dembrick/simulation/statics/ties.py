"""Ties in statics: springs along the line between two points, ductile at their strength, slack in compression.

T = T_0 + k (e - e_0 - e_p), not below zero if the tie takes tension only, and at most T_y. The elongation e is that of
small displacements, e_0 that at which the tie was added, e_p the permanent elongation. Ties are few, so their
forces are found here and added to the dead loads of the kernels, before every evaluation of the joints.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.joint.ties import Ties as MovingTies
from dembrick.simulation.channels import energies
from dembrick.simulation.moving_ties import at_ends, moving_ties
from dembrick.simulation.statics.stiffness import to_joint

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.state import Blocks
    from dembrick.kernels.statics.record import Record
    from dembrick.scenario.stages import TiesBefore
    from dembrick.simulation.statics.state import State


class Ties(NamedTuple):
    """The t ties of a scene."""

    block_a: np.ndarray  # (t,) int64
    block_b: np.ndarray  # (t,) int64
    seen_a: np.ndarray  # (t, 6, 6) from the motion of block a to that of its end, along the tie third
    seen_b: np.ndarray  # (t, 6, 6) likewise of b
    length: np.ndarray  # (t,) m, as drawn
    stiffness: np.ndarray  # (t,) N/m
    strength: np.ndarray  # (t,) N, infinite if it never yields
    least: np.ndarray  # (t,) N, zero if it takes tension only, else minus the strength
    prestress: np.ndarray  # (t,) N
    dead: np.ndarray  # (n, 6) N, N m: dead loads on the blocks without the ties
    yielded: np.ndarray  # (t,) m, permanent elongation
    tension: np.ndarray  # (t,) N, now
    elongation: np.ndarray  # (t,) m, now
    rest: np.ndarray  # (t,) m, elongation at which the tie was added


def at_rest(assembly: Assembly) -> Ties | None:
    """The ties of an assembly, as drawn; None without any."""
    table = assembly.ties
    if not len(table):
        return None
    across = np.eye(3)[np.argmin(np.abs(table.direction), axis=1)]
    first = np.cross(table.direction, across)
    first /= np.sqrt((first * first).sum(axis=1))[:, None]
    axes = np.stack([first, np.cross(table.direction, first), table.direction], axis=1)
    return Ties(
        block_a=table.ends.block[:, 0].copy(),
        block_b=table.ends.block[:, 1].copy(),
        seen_a=to_joint(axes, table.ends.arm[:, 0]),
        seen_b=to_joint(axes, table.ends.arm[:, 1]),
        length=table.length.copy(),
        stiffness=table.stiffness.copy(),
        strength=table.strength.copy(),
        least=np.where(table.tension_only, 0.0, -table.strength),
        prestress=table.prestress.copy(),
        dead=np.concatenate([assembly.dead_force, assembly.dead_torque], axis=1),
        yielded=np.zeros(len(table)),
        tension=table.prestress.copy(),
        elongation=np.zeros(len(table)),
        rest=np.zeros(len(table)),
    )


def pull(state: State) -> None:
    """Update the ties of a state, if it has any, to the positions of its blocks, and apply their forces."""
    ties = state.ties
    if ties is None:
        return
    _elongate(state)
    ties.tension[:] = np.clip(_trial(ties), ties.least, ties.strength)
    act(state)


def go_on(state: State, left: Ties | None, before: TiesBefore | None) -> None:
    """Copy the history of the ties ``left`` by a previous run to those of a state whose blocks are in place; others are
    added now."""
    ties = state.ties
    if ties is None or (left is None and before is None):
        return
    old = np.arange(len(ties.rest)) if before is None else np.array(before.of, np.int64)
    kept = old >= 0
    if left is not None:
        ties.yielded[kept], ties.rest[kept] = left.yielded[old[kept]], left.rest[old[kept]]
    _elongate(state)
    ties.rest[~kept] = ties.elongation[~kept]


def _elongate(state: State) -> None:
    """Update the elongations of the ties."""
    ties, blocks = state.ties, state.blocks
    motion = np.concatenate([blocks.displacement, blocks.rotation], axis=1)
    of_b = np.einsum("tk,tk->t", ties.seen_b[:, 2], motion[ties.block_b])
    ties.elongation[:] = of_b - np.einsum("tk,tk->t", ties.seen_a[:, 2], motion[ties.block_a])


def act(state: State) -> None:
    """Add the tensions of the ties to the dead loads of the blocks."""
    ties, blocks = state.ties, state.blocks
    wrench = ties.dead.copy()
    np.add.at(wrench, ties.block_a, ties.tension[:, None] * ties.seen_a[:, 2])
    np.add.at(wrench, ties.block_b, -ties.tension[:, None] * ties.seen_b[:, 2])
    blocks.dead_force[:], blocks.dead_torque[:] = wrench[:, :3], wrench[:, 3:]


def _trial(ties: Ties) -> np.ndarray:
    """Elastic trial tension (t,) from the permanent elongation."""
    return ties.prestress + ties.stiffness * (ties.elongation - ties.rest - ties.yielded)


def tangent(ties: Ties) -> np.ndarray:
    """dT/de of the ties now, in place of the tangents of joints (t, 6, 6)."""
    trial = _trial(ties)
    found = np.zeros((len(trial), 6, 6))
    found[:, 2, 2] = np.where((trial > ties.least) & (trial < ties.strength), ties.stiffness, 0.0)
    return found


def remember(state: State) -> float:
    """Update the permanent elongation of the ties; return the work dissipated (J)."""
    ties = state.ties
    if ties is None:
        return 0.0
    trial, slack = _trial(ties), ties.least == 0.0
    short = np.where(slack, 0.0, np.minimum(trial - ties.least, 0.0))  # of a bar that is pressed
    given = np.where(trial > ties.strength, trial - ties.strength, short) / ties.stiffness
    ties.yielded[:] += given
    return float((ties.tension * given).sum())


def unspent(state: State, most: float) -> float:
    """Additional work (J) of the ties against the motion of the last step once they have yielded or gone slack; ties
    that never yield count with a strength of ``most`` (N).

    A cable whose prestress stretches it by more than its length stands for a weight on a rope: its tension stays when
    it shortens.
    """
    ties, blocks = state.ties, state.blocks
    if ties is None:
        return 0.0
    step = np.concatenate([blocks.velocity, blocks.spin], axis=1)
    stretched = np.einsum("tk,tk->t", ties.seen_b[:, 2], step[ties.block_b])
    stretched -= np.einsum("tk,tk->t", ties.seen_a[:, 2], step[ties.block_a])
    weight_on_rope = (ties.least == 0.0) & (ties.tension > ties.stiffness * ties.length)
    let_go = np.where(weight_on_rope, ties.tension, np.maximum(ties.least, -most))
    end = np.where(stretched > 0.0, np.minimum(ties.strength, most), let_go)
    return float(np.maximum((end - ties.tension) * stretched, 0.0).sum())


def energy(state: State) -> float:
    """Elastic energy of the ties (J), zero if they carry nothing."""
    ties = state.ties
    return 0.0 if ties is None else float(0.5 * (ties.tension**2 / ties.stiffness).sum())


def dead_loads(state: State) -> np.ndarray:
    """Dead loads (n, 6) on the blocks, without ties."""
    if state.ties is not None:
        return state.ties.dead
    return np.concatenate([state.blocks.dead_force, state.blocks.dead_torque], axis=1)


def put_dead_loads(state: State, wrench: np.ndarray) -> None:
    """Set the dead loads on the blocks to ``wrench`` (n, 6); the tie forces stay as `pull` found them."""
    blocks = state.blocks
    if state.ties is not None:
        state.ties.dead[:] = wrench
        act(state)
    else:
        blocks.dead_force[:], blocks.dead_torque[:] = wrench[:, :3], wrench[:, 3:]


def on_blocks(state: State) -> np.ndarray:
    """Forces and moments of the ties on the blocks (n, 6) at present, N and N m."""
    return np.concatenate([state.blocks.dead_force, state.blocks.dead_torque], axis=1) - dead_loads(state)


def on_supports(state: State, support: np.ndarray) -> np.ndarray:
    """Wrenches of the supports on the structure through the ties (s, 6), N and N m; zero for guided blocks.
    ``support`` (n,): number of each block among the supports, or -1."""
    found = -on_blocks(state)
    found[state.blocks.guided] = 0.0
    return found[support >= 0]


def write(state: State, record: Record) -> None:
    """Add the energy, tensions, reactions and permanent elongations of the ties to the last row of a record."""
    if state.ties is None:
        return
    row = record.count[0] - 1
    record.energy[row, energies(real_time=False).index("elastic")] += energy(state)
    record.reaction[row] += on_supports(state, record.support)
    record.tension[row], record.yielded[row] = state.ties.tension, state.ties.yielded


def start_moving(state: State, assembly: Assembly) -> MovingTies:
    """The ties of a dead-load equilibrium in moving geometry; their forces then no longer count as dead loads."""
    moving = moving_ties(assembly.ties, assembly.position, assembly.rotation)
    if state.ties is not None:
        now, ties = moving.now, state.ties
        now["yielded"] = ties.yielded
        moving.length[:] += ties.rest
        _stretch(moving, state.blocks)
        moving.before[:] = moving.now
        state.blocks.dead_force[:], state.blocks.dead_torque[:] = ties.dead[:, :3], ties.dead[:, 3:]
    return moving


def _stretch(moving: MovingTies, blocks: Blocks) -> None:
    """Set the length and tension of the ties to the finite motion of their blocks."""
    now, moved = moving.now, blocks.displacement[moving.block]
    arm = np.einsum("tsij,tsj->tsi", rotation_matrix(blocks.orientation[moving.block]), moving.lever)
    line = moving.offset + moved[:, 1] - moved[:, 0] + arm[:, 1] - arm[:, 0]
    now["length"] = np.linalg.norm(line, axis=1)
    tension = moving.prestress + moving.stiffness * (now["length"] - moving.length - now["yielded"])
    now["tension"] = np.clip(tension, moving.least, moving.strength)


def stop_moving(state: State, moving: MovingTies) -> None:
    """Copy the ties at the end of a run in moving geometry back to the state."""
    ties = state.ties
    if ties is None:
        return
    ties.tension[:], ties.yielded[:] = moving.now["tension"], moving.now["yielded"]
    ties.elongation[:] = moving.now["length"] - (moving.length - ties.rest)
    wrench = ties.dead + at_ends(moving, len(ties.dead))
    state.blocks.dead_force[:], state.blocks.dead_torque[:] = wrench[:, :3], wrench[:, 3:]


def bound(state: State) -> np.ndarray:
    """Stiffness (n, 6, 6) of blocks on their ties, doubled for ties between free blocks: an upper bound of that of all
    ties together."""
    n = len(state.blocks.displacement)
    found, free = np.zeros((n, 6, 6)), np.zeros(n, bool)
    free[state.blocks.free] = True
    ties = state.ties
    if ties is not None:
        k = ties.stiffness * np.where(free[ties.block_a] & free[ties.block_b], 2.0, 1.0)
        for block, seen in ((ties.block_a, ties.seen_a), (ties.block_b, ties.seen_b)):
            np.add.at(found, block, k[:, None, None] * seen[:, 2, :, None] * seen[:, 2, None, :])
    return found
