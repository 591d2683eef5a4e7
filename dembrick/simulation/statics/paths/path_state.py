"""State of a search along a path of equilibria, from which it can be restarted without any difference."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from dembrick.errors import HistoryError
from dembrick.kernels.statics.load_bounds import NEVER
from dembrick.simulation.session import Snapshot

MOST_EQUILIBRIA = 400  # of a path
FIRST_DRAG = 0.01


@dataclass
class Path:
    """A followed path: whether the bracket became narrow enough, the numbers of Newton iterations and equilibria, and
    seconds by phase; the phase ``path`` is the remainder, such as the choice of steps.

    ``wanders``: the bracket cannot become narrower, as blocks snap again and again. ``unlimited``: V grew beyond all
    dead loads; ``moved``: whether anything slid or opened. ``peak``: bounds of the greatest V on the path (N).
    """

    converged: bool
    unlimited: bool
    wanders: bool
    moved: bool
    peak: tuple[float, float]
    iterations: int
    equilibria: int
    phases: dict[str, float]


@dataclass
class Drift:
    """Released blocks: the motion (6 f,) to which they have drifted, V there, the drag and the steps taken."""

    motion: np.ndarray
    V: float
    drag: float = 1.0  # over the elastic stiffness
    steps: int = 0


@dataclass
class PathState:
    """Progress of a path, and its next step. Motions (6 f,) are those of the free blocks."""

    motion: np.ndarray  # at the last equilibrium
    direction: np.ndarray  # in which the next is sought: motion per metre of the driven displacement
    spare: np.ndarray  # another direction, tried if that fails ...
    drift: Drift | None = None
    has_spare: bool = False
    spare_gain: float = 0.0  # ... and how V grows along it
    V: float = 0.0  # N
    driven: float = 0.0  # m
    step: float = 0.0  # m, of the driven displacement, to the next equilibrium
    elastic: float = 0.0  # m, of the first steps
    usual: float = 0.0  # m, the longest step so far without releasing the blocks
    longest: float = 0.0  # m, the longest step, or the inelastic displacement
    gain: float = 0.0  # N/m, predicted slope of V
    balanced: float = 0.0  # tolerance of the out-of-balance over the joint forces
    closest: float = 1e-9  # its least value; raised once no equilibrium was found to it
    tried: int = 0  # iterations of the last search for an equilibrium
    equilibria: int = 0
    iterations: int = 0
    since_failure: int = 0  # steps since one failed
    jumps: int = 0  # times that the blocks were released
    drag: float = FIRST_DRAG  # over the elastic stiffness, of the next step that needs one
    dragged: int = 0  # steps still to take with it
    wasted: int = 0  # iterations of steps that found no equilibrium, or only with a drag
    pushes: int = 0  # pushes by driven relaxation
    kept: int = 0  # value of `jumps` when the direction was last taken from a relaxed state
    external: float = 0.0  # J, work of actuators and dead loads
    friction: float = 0.0  # J
    lost: float = 0.0  # J, to the drag
    crushing: float = 0.0  # J
    fracture: float = 0.0  # J
    yielding: float = 0.0  # J, of ties
    limit: int = 0  # number of the equilibrium that is the limit so far
    limit_load: float = 0.0  # N, load that it certainly carried
    reached_load: float = 0.0  # N, load of the equilibrium from which the next stage starts
    limit_found: bool = False  # whether the bracket has been narrow enough
    framed: int = 0  # number of the last equilibrium with a frame in the record
    broke: bool = False  # whether bonds broke at the last equilibrium, so that the next is only a redistribution
    # of every equilibrium: inelastic displacement (m), V, lower and upper bound (N), whether a gap is closing
    seen: list[tuple[float, float, float, float, bool]] = field(default_factory=lambda: [(0.0, 0.0, 0.0, NEVER, False)])

    def turn_to(self, direction: np.ndarray, gain: float) -> None:
        """Seek the next equilibrium in another ``direction``, and in the present one only if that fails."""
        self.spare, self.spare_gain, self.has_spare = self.direction, self.gain, True
        self.direction, self.gain = direction, gain

    def snapshot(self) -> dict[str, np.ndarray]:
        """All of it as arrays."""
        seen, drift = np.zeros((MOST_EQUILIBRIA + 1, 5)), self.drift or Drift(np.zeros_like(self.motion), 0.0, 0.0)
        seen[: len(self.seen)] = self.seen
        return {
            "way.numbers": np.array([float(getattr(self, name)) for name in NUMBERS]),
            "way.motion": self.motion.copy(),
            "way.direction": self.direction.copy(),
            "way.spare": self.spare.copy(),
            "way.drift": np.array([drift.V, drift.drag, drift.steps]),
            "way.drifted": drift.motion.copy(),
            "way.seen": seen,
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Restore it from a snapshot of the same scene; HistoryError if it is of another."""
        numbers = snapshot.array("way.numbers", np.zeros(len(NUMBERS))).tolist()
        for (name, kind), number in zip(NUMBERS.items(), numbers, strict=True):
            if kind is not float and not (number.is_integer() and 0.0 <= abs(number) < 1e15):
                raise HistoryError(f"{snapshot.path}: way.numbers does not belong to this run ({name} is not a count)")
            setattr(self, name, kind(number))
        if not 0 <= self.equilibria <= MOST_EQUILIBRIA:
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no step of this run")
        for name in ("motion", "direction", "spare"):
            setattr(self, name, snapshot.array(f"way.{name}", self.motion).copy())
        V, drag, steps = snapshot.array("way.drift", np.zeros(3)).tolist()
        drifted = snapshot.array("way.drifted", self.motion).copy()
        self.drift = Drift(drifted, V, drag, int(steps)) if drag > 0.0 else None
        rows = snapshot.array("way.seen", np.zeros((MOST_EQUILIBRIA + 1, 5)))[: self.equilibria + 1].tolist()
        self.seen = [(*row[:4], bool(row[4])) for row in rows]


_KINDS = {"float": float, "int": int, "bool": bool}
NUMBERS = {part.name: _KINDS[part.type] for part in fields(PathState) if part.type in _KINDS}
