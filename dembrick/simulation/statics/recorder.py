"""The record of a replay: buffers that the compiled loop fills, passed on after every chunk; and forces of
supports and ties at the end of a search or constant-rate test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from dembrick.assembly.actuators import NO_CONTROL_POINTS, ControlPoints
from dembrick.kernels.statics.energy import elastic_energy
from dembrick.kernels.statics.record import ROW, Record, write_guides, write_reactions, write_row
from dembrick.simulation.channels import energies
from dembrick.simulation.session import Session
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.state import State, for_kernels, rotations
from dembrick.simulation.statics.tilting_table import Before, frames_on_table, rows_on_table

ENERGIES = energies(real_time=False)
BUFFER_BYTES = 4 << 20  # memory for the rows of a chunk, and the same for its frames; a chunk ends when they are full


class Recorder:
    """Rows and frames of a run; the session's ``observe(rows, frames)``, if there is one, gets copies of those of each
    chunk.

    ``rows``: time, load, displacement, unbalanced, lower, upper (T,), actuator_displacement and actuator_force (T, k),
    reaction (T, s, 6), energy (name: (T,)), with ties tension and yielded (T, t), with control points control_point
    (T, w, 3), and with the channel "joints" joint (T, j, 7).
    ``frames`` with the channel "frames": time (F,),
    displacement (F, n, 3), orientation (F, n, 4); "velocity" adds velocity and spin (F, n, 3), "contacts"
    contact_force (F, c, 3); joints with strengths add bond (F, j). A row is taken every ``rows_every`` steps, a frame
    every ``frames_every`` rows and at the last row of a search. ``longest_chunk``: the most steps between two calls of
    `drain`.
    """

    def __init__(
        self,
        state: State,
        session: Session,
        chunk: int,
        rows_every: int = 1,
        frames_every: int = 1,
        watched: ControlPoints = NO_CONTROL_POINTS,
    ):
        channels = session.output.channels if session.observe else ()
        n_block, n_joint = len(state.blocks.displacement), len(state.joints.block_a)
        support, n_tie = support_numbers(state), 0 if state.ties is None else len(state.ties.stiffness)
        n_point, moving = joint_families.contact_points(state), "velocity" in channels
        rows_of = (  # field of the record, channel, shape of an entry, whether it is wanted
            ("actuator", "actuator_displacement", (len(state.actuators.block),), True),
            ("joint", "joint", (n_joint, 7), "joints" in channels),
            ("reaction", "reaction", (int(support.max(initial=-1)) + 1, 6), True),
            ("tension", "tension", (n_tie,), n_tie > 0),
            ("yielded", "yielded", (n_tie,), n_tie > 0),
            ("way", "control_point", (len(watched.at), 3), len(watched.at) > 0),
        )
        frames_of = (
            ("frame_time", "time", (), True),
            ("frame_displacement", "displacement", (n_block, 3), True),
            ("frame_orientation", "orientation", (n_block, 4), True),
            ("frame_velocity", "velocity", (n_block, 3), moving),
            ("frame_spin", "spin", (n_block, 3), moving),
            ("frame_contact", "contact_force", (n_point, 3), "contacts" in channels),
            ("frame_bond", "bond", (n_joint,), joint_families.has_strengths(state)),
        )
        of_rows, of_frames = (
            {name: shape if wanted else (0, *shape[1:]) for name, _, shape, wanted in table}
            for table in (rows_of, frames_of)
        )
        of_rows["energy"] = (len(ENERGIES),)
        self._rows, self._frames = (
            {name: channel for name, channel, _, wanted in table if wanted} for table in (rows_of, frames_of)
        )
        rows, frames = _capacity(chunk // rows_every, of_rows | {"row": (len(ROW),)}), 0
        self.longest_chunk = min(chunk, (rows - 2) * rows_every)
        if "frames" in channels:
            every = rows_every * frames_every
            frames = _capacity(chunk // every, of_frames)
            self.longest_chunk = min(self.longest_chunk, (frames - 2) * every)
        self._observe, self._weight, self._channels = session.observe, state.actuators.weight, channels
        self._before = Before.of(state, watched, session.start is not None) if session.tilts else None
        self._load_factors: dict[float, float] = {}  # of equilibria that may have a frame, by their time
        self.record = Record(
            every=np.array([rows_every, rows_every * frames_every], np.int64),
            count=np.zeros(2, np.int64),
            support=support,
            watched=watched.at.block,
            lever=watched.at.lever,
            arm=watched.at.arm,
            row=np.zeros(rows, ROW),
            **{name: np.zeros((rows, *shape)) for name, shape in of_rows.items()},
            **{name: np.zeros((frames, *shape)) for name, shape in of_frames.items()},
        )

    def write_equilibrium(
        self,
        state: State,
        number: int,
        before: float,
        bracket: np.ndarray,
        terms: Mapping[str, float] | None = None,
        framed: bool = False,
    ) -> bool:
        """Add the equilibrium with this ``number`` on a path to the record.

        ``before`` (J): elastic energy at the beginning of the path; ``terms`` (J): other energies by name, zero if
        not given; ``bracket`` (2,) N of the limit. ``framed``: whether to write a frame whatever the number. Returns
        whether it has one.
        """
        record = self.record
        frames = int(record.count[1])
        energies = {"elastic": elastic_energy(for_kernels(state), None) - before} | dict(terms or {})
        record.energy[record.count[0]] = [energies.get(name, 0.0) for name in ENERGIES]
        bounds, load = (float(bracket[0]), float(bracket[1])), float(state.actuators.driven[0].load)
        write_row(record, number, float(number), for_kernels(state), load, 0.0, bounds, framed)
        ties.write(state, record)
        return int(record.count[1]) > frames

    def write_frame(self, state: State, number: int) -> None:
        """Add the frame of the equilibrium with this ``number``, whose row is in the record."""
        rows = int(self.record.count[0])
        self._load_factors[float(number)] = float(state.actuators.driven[0].load)
        write_row(self.record, number, float(number), for_kernels(state), 0.0, 0.0, (0.0, 0.0), True)
        self.record.count[0] = rows

    def drain(self) -> None:
        """Pass on the rows and frames that the loop has written since the last call."""
        record = self.record
        n, f = (int(c) for c in record.count)
        record.count[:] = 0
        if self._observe is None:
            return
        rows = {name: record.row[name][:n].copy() for name in ROW.names or ()}
        rows["actuator_force"] = rows["load"][:, None] * self._weight
        rows["energy"] = dict(zip(ENERGIES, record.energy[:n].copy().T, strict=True))
        rows |= self._written(self._rows, n)
        frames = self._written(self._frames, f) if "frames" in self._channels else {}
        if self._before is not None:
            rows, frames = self._on_table(rows, frames, self._before)
        self._observe(rows, frames)

    def _on_table(self, rows: dict, frames: dict, before: Before) -> tuple[dict, dict]:
        """Rows and frames of a table that tilts."""
        self._load_factors |= zip(rows["time"].tolist(), rows["load"].tolist(), strict=True)
        if frames:
            load_factors = np.array([self._load_factors[time] for time in frames["time"].tolist()])
            frames = frames_on_table(frames, load_factors, before)
        return rows_on_table(rows, before), frames

    def _written(self, channels: Mapping[str, str], count: int) -> dict[str, np.ndarray]:
        """Copies of the first ``count`` entries of fields of the record, by their ``channels``."""
        return {channel: getattr(self.record, name)[:count].copy() for name, channel in channels.items()}


def _capacity(wanted: int, shapes: Mapping[str, tuple[int, ...]]) -> int:
    """Entries of a buffer: those of a chunk (and one at either end), or as many as fit into ``BUFFER_BYTES``."""
    return max(3, min(wanted + 2, BUFFER_BYTES // (8 * sum(math.prod(shape) for shape in shapes.values()))))


def support_numbers(state: State) -> np.ndarray:
    """The number (n,) of each block among those that are fixed, or held in some directions; -1 of the others."""
    supporting = np.ones(len(state.blocks.displacement), bool)
    supporting[state.blocks.free] = False
    supporting[state.blocks.guided] = True
    return np.where(supporting, np.cumsum(supporting) - 1, -1)


def reactions(state: State) -> np.ndarray:
    """Force (N) and moment (N m, about its centroid) of every fixed block on the structure, through its joints and
    ties, and of the guides on every block that they hold (s, 6).

    World axes: a floor pushes a block at rest upwards.
    """
    support = support_numbers(state)
    out = np.zeros((int(support.max(initial=-1)) + 1, 6))
    write_reactions(state.joints, support, out)
    if state.ties is not None:
        out += ties.on_supports(state, support)
    write_guides(state.blocks, support, out)
    return out


class Ended:
    """Blocks, reactions and ties in the last ``state`` of a finished search or test."""

    state: State

    @property
    def reactions(self) -> np.ndarray:
        """Reactions of the supports (s, 6), see `reactions`."""
        return reactions(self.state)

    @property
    def ties(self) -> dict[str, np.ndarray]:
        """Tension (t,) N of the ties at the end, and their permanent elongation (t,) m."""
        return {"tension": self.state.ties.tension, "yielded": self.state.ties.yielded}

    @property
    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n, 3) m of every centroid from the start, and rotation (n, 3, 3) from body axes, at the end."""
        return self.state.blocks.displacement, rotations(self.state)
