"""Results of a search or a constant-rate test: the yield point, the record, and theory beside them."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import recorded_curve
from dembrick.assembly.build import Assembly
from dembrick.assembly.contact_points import largest_edge_shortfall
from dembrick.errors import HistoryError, UndecidedError
from dembrick.runs import theory_check
from dembrick.runs.outcomes.cycles import cycles_of
from dembrick.scenario.checks import show
from dembrick.scenario.joint_laws import described
from dembrick.scenario.model import Scenario
from dembrick.scenario.regimes import ACTUATORS, COMPLETED, STEEPEST, YIELD, Control, Curve
from dembrick.simulation.channels import counts_equilibria
from dembrick.simulation.energy_audit import EnergyAudit
from dembrick.simulation.statics.load_system import Replay
from dembrick.simulation.statics.yield_point import YieldPoint, moving_blocks
from dembrick.views.key_numbers import key_numbers
from dembrick.views.number_lines import KeyNumber, aligned

if TYPE_CHECKING:
    import pandas
    import pyvista
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dembrick.runs.path_dependence import OtherPaths
    from dembrick.simulation.dynamics.run import MotionRun
    from dembrick.simulation.statics.rest.dead_load import Standing


BRACKET_SLACK = 1e-9  # of V: rounding by which theory may lie outside a certified bracket


def fell(answer: Mapping) -> bool:
    """Whether a run fell, by the JSON object of its result: its status is "collapse" or "falls", or a block has fallen
    at its end. UndecidedError if that is not known."""
    if answer["status"] == UndecidedError.status:
        raise UndecidedError(str(answer.get("answer") or answer.get("error")))
    return answer["status"] in ("collapse", "falls") or bool(answer.get("fallen"))


@dataclasses.dataclass(repr=False)
class RunResult(ABC):
    """Result of any run: the ``scenario`` that was run and its geometry (``assembly``), the finished ``run`` with its
    state, the record, the ``energy`` audit (None if nothing was recorded), and how long it took (``wall``, s).

    ``rows``: time, load, displacement, unbalanced, lower, upper (T,), actuator_displacement and actuator_force (T, k),
    reaction (T, s, 6: F_x, F_y, F_z, M_x, M_y, M_z of every support), joint (T, j, 7: N, V_1, V_2, M_T, M_1, M_2,
    slip), energy (name: (T,)). ``frames``: time (F,), displacement (F, n, 3), orientation (F, n, 4), velocity and spin
    (F, n, 3), contact_force (F, c, 3). Only the channels of the scenario's output are there. ``history``: its
    file. ``stages``: the JSON objects of earlier stages. SI units.
    """

    scenario: Scenario
    assembly: Assembly
    run: Replay | MotionRun | Standing
    rows: Mapping[str, np.ndarray]
    frames: Mapping[str, np.ndarray]
    wall: dict
    history: str | None = None
    energy: EnergyAudit | None = None
    stages: list[dict] = dataclasses.field(default_factory=list)

    @abstractmethod
    def entries(self) -> dict:
        """Entries of the JSON object that are those of this kind of run."""

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick run --json``."""
        ties = tied(self.assembly, **self.run.ties) if len(self.assembly.ties) else []
        return {
            **heading(self.scenario, self.assembly),
            **self.entries(),
            "reactions": self.reactions,
            "energy": None if self.energy is None else self.energy.as_dict(),
            "wall": self.wall,
            "history": self.history,
            **({"ties": ties} if ties else {}),
            **({} if self.cycles is None else {"cycles": self.cycles}),
            **({"stages": self.stages} if self.scenario.stages else {}),
            **({} if (law := self.assembly.custom_law) is None else {"custom_law": law.as_dict()}),
        }

    @property
    @abstractmethod
    def status(self) -> str:
        """How the run ended, in a word."""

    @property
    def collapse(self) -> dict | None:
        """The collapse; None without one."""
        return None

    @property
    def yield_point(self) -> YieldPoint | None:
        """Limit load, bracket, torsion centre; None for a run that looks for no limit load."""
        return None

    @property
    def control_points(self) -> dict[str, list[float]]:
        """Displacement (3) of every control point from the start (m), at the end."""
        watched = self.assembly.control_points
        return dict(zip(watched.names, watched.displacement(*self.run.pose).tolist(), strict=True))

    @property
    def counts_equilibria(self) -> bool:
        """Whether the times of rows and frames are the numbers of equilibria."""
        return counts_equilibria(self.scenario.control, self.assembly)

    @cached_property
    def cycles(self) -> list[dict] | None:
        """Peaks with their bars (N), dissipated energy (J), damping and residual displacement (m) of every cycle of a
        protocol, see `cycles.cycles_of`; None without one, or without a record."""
        turns = getattr(self.run, "turns", None) or ()
        weight = float(np.abs(self.assembly.actuators.weight).sum())
        return cycles_of(self.scenario, self.rows, turns, weight)

    @property
    def reactions(self) -> dict[str, list[float]] | None:
        """[Fx, Fy, Fz, Mx, My, Mz] of every support on the structure at the end, and of the guides on every block that
        they hold, about its centroid (N, N m; world axes); None if no equilibrium was found."""
        names = (name for name, own in zip(self.assembly.names, self.assembly.supporting, strict=True) if own)
        return dict(zip(names, (self.run.reactions + 0.0).tolist(), strict=True))

    def text(self) -> str:
        """Text of the command line: the title, the formulation, and the key numbers."""
        law = self.assembly.custom_law
        lines = [KeyNumber("formulation", formulations(self.scenario, self.assembly))]
        lines += [] if law is None else [KeyNumber("joint law", described(law.as_dict()))]
        lines += key_numbers(self.as_dict(), self.curve.unit)
        lines += [] if self.history is None else [KeyNumber("history", self.history)]
        return "\n".join([self.scenario.title, *aligned(lines)])

    def agrees(self) -> bool:
        """Whether theory, where one holds, agrees."""
        return True

    @property
    def curve(self) -> Curve:
        """Curve of the record: names of load and displacement, and the unit of the load."""
        return recorded_curve(self.scenario.control, self.assembly.actuators)

    def series(self, name: str) -> np.ndarray:
        """The values of every row by the name of ``rows``; HistoryError if the run kept no record of them."""
        if name not in self.rows:
            raise HistoryError(f"this run kept no record of {show(name)}: simulate with record = True")
        return self.rows[name]

    @property
    def results(self) -> dict:
        """The object of ``run --json``, named as in a history."""
        return self.as_dict()

    def plot(self, ax: Axes | None = None) -> Figure:
        """Load over displacement, or displacement over time, as a matplotlib figure; drawn into ``ax`` if given."""
        from dembrick.views import plot

        return plot.force_displacement([self], ax=ax)

    def meshes(
        self, frame: int | str | None = None, *, time: float | None = None, magnification: float = 1.0
    ) -> pyvista.MultiBlock:
        """The blocks in a ``frame`` ("peak", "last" or a number; None: the peak of a search, else the last), or at a
        ``time`` (s), as a ``pyvista.MultiBlock`` of their names; the motion times
        ``magnification``."""
        from dembrick.runs import in_memory
        from dembrick.views import render

        with in_memory.recording(self) as found:
            return render.meshes(found, frame, magnification, time)

    def to_pandas(self) -> pandas.DataFrame:
        """The series as a ``pandas.DataFrame`` by time, units in the headings; MissingDependency without pandas,
        HistoryError if the run kept no record."""
        from dembrick.runs import in_memory

        with in_memory.recording(self) as found:
            return found.to_pandas()

    def to_xarray(self) -> xarray.Dataset:
        """Series and frames as an ``xarray.Dataset`` with named dimensions and units; MissingDependency without xarray,
        HistoryError if the run kept no record."""
        from dembrick.runs import in_memory

        with in_memory.recording(self) as found:
            return found.to_xarray()

    def __repr__(self) -> str:
        """The title and the first key number with its error bar."""
        first = [f"{number.name} {number.value}" for number in key_numbers(self.as_dict(), self.curve.unit)[:1]]
        return f"<{type(self).__name__} {self.scenario.title!r}: {', '.join([self.status, *first])}>"

    def _repr_html_(self) -> str:
        """HTML for a notebook: the title, the key numbers with their error bars, the curve."""
        from dembrick.views import page

        return page.fragment(self)


def heading(scenario: Scenario, assembly: Assembly | None = None) -> dict:
    """First entries in the JSON object of a run or limit analysis; a failed one may have no ``assembly``."""
    formulation = formulations(scenario, assembly)
    return {"scenario": scenario.path or "", "title": scenario.title, "formulation": formulation}


def formulations(scenario: Scenario, assembly: Assembly | None) -> str:
    """The formulations of the joints, separated by commas; that of ``[joint]`` if no joints are known."""
    names = [] if assembly is None else [law.formulation for law in assembly.joints.law]
    return ", ".join(dict.fromkeys(names or [scenario.joint.formulation]))


def load_in_words(control: Control, V: float) -> str:
    """A load for a sentence."""
    return f"V = {V:.3g} N" if control.drives == ACTUATORS else f"a load factor of {V:.3g}"


def tied(assembly: Assembly, **values: np.ndarray) -> list[dict]:
    """The blocks of every tie and its ``values`` by name: tension (N), the elongation (m) that it keeps."""
    ties, names = assembly.ties, assembly.names
    numbers = zip(*ties.ends.block.T, *(own.tolist() for own in values.values()), strict=True)
    return [{"between": [names[a], names[b]]} | dict(zip(values, own, strict=True)) for a, b, *own in numbers]


@dataclasses.dataclass(repr=False)
class Result(RunResult):
    """Result of a search or a constant-rate test: the yield point with its bracket, and theory beside it.

    ``theory`` is None if none holds. ``fallen``: the collapse under a load on every block; ``path``: entries beside
    the limit load of an assembly, its associative bound and the range of other paths; ``others``: what is proven of
    these (see `path_dependence`).
    """

    run: Replay
    theory: theory_check.Theory | None = None
    fallen: dict | None = None
    path: dict | None = None
    others: OtherPaths | None = None

    @property
    def collapse(self) -> dict | None:
        """The collapse under a load on every block, with the entries beside its load factor; None for actuators."""
        return None if self.fallen is None else self.fallen | (self.path or {})

    @property
    def after(self) -> dict | None:
        """Motion beyond the limit of the path, if other blocks move at its end: their names (``blocks``), their
        ``mechanism``, the greatest ``displacement`` (m), and the ``load`` then; else None."""
        found = self.run.after
        if found is None:
            return None
        return found._asdict() | {"blocks": [self.assembly.names[i] for i in found.blocks]}

    @property
    def yield_point(self) -> YieldPoint:
        """Limit load, bracket, torsion centre."""
        return self.run.yield_point

    @property
    def blocks(self) -> list[str]:
        """Names of the blocks that move at the limit."""
        if self.collapse is not None:
            return self.collapse["blocks"]
        return [self.assembly.names[i] for i in moving_blocks(self.run.state)]

    @property
    def load(self) -> np.ndarray:
        """V of every row (N); HistoryError if the run kept no record."""
        return self.series("load")

    @property
    def displacement(self) -> np.ndarray:
        """Driven displacement of every row (m); HistoryError if the run kept no record."""
        return self.series("displacement")

    @property
    def status(self) -> str:
        """ "yield" for a limit load, "collapse" for that of all blocks, "completed" for a constant-rate test and where
        nothing limits the load."""
        return COMPLETED if self.unlimited else self.scenario.control.ends_with

    @property
    def unlimited(self) -> bool:
        """Whether no mechanism was found up to the load that the search followed (`YieldPoint.V_lower`)."""
        return self.yield_point.unlimited

    @property
    def plain_answer(self) -> str | None:
        """Sentence on what an unlimited load means for the control; None if there is a limit."""
        if not self.unlimited:
            return None
        control, V = self.scenario.control, self.yield_point.V_lower
        if control.tilt_axis is not None:
            return f"stands at any tilt up to {STEEPEST:g} deg (followed to a load factor of {V:.3g})"
        load = load_in_words(control, V)
        if not self.run.settings.get("gave_way", True):
            return f"unlimited: this load cannot move the blocks; no joint slid or opened up to {load}"
        return f"unlimited: the blocks jam, and no mechanism was found up to {load}"

    @property
    def points_miss(self) -> float | None:
        """The relative gap between the points of ``distributed`` joints chosen by the program and the continuum, if it
        is beyond the tolerance (as for a joint that overturns, whose edge no points reach); else None."""
        control = self.scenario.control
        if self.theory is None:
            mechanism = self.yield_point.mechanism if self.collapse is None else self.collapse["mechanism"]
            table = self.assembly.joints, self.assembly.contact_points
            gap = -largest_edge_shortfall(*table, chosen=True)[0] if mechanism == "rocking" else 0.0
        else:
            found = self.theory.discretisation_error
            if found is None or control.ends_with != YIELD or self.assembly.joints.law[0].points is not None:
                return None
            gap = found
        return gap if abs(gap) > (control.tolerance or math.inf) else None

    def agrees(self) -> bool:
        """Whether theory lies in the bracket and, for a limit load, V is within the tolerance of it."""
        if self.points_miss is not None:
            return False
        if self.theory is None or self.unlimited:
            return True
        V, point = self.theory.V, self.yield_point
        slack = BRACKET_SLACK * abs(V)
        inside = point.V_lower - slack <= V and (point.V_upper is None or V <= point.V_upper + slack)
        if self.scenario.control.ends_with != YIELD:
            return inside or point.bracket != "certified"
        asked = self.scenario.control.tolerance or 0.0
        close = self.theory.error is not None and abs(self.theory.error) <= asked
        return close and (inside or point.bracket != "certified")

    def entries(self) -> dict:
        run = self.run
        return dict(
            status=self.status,
            unlimited=self.unlimited,
            answer=self.plain_answer,
            collapse=self.collapse,
            path=self.path,
            after=self.after,
            **({} if self.others is None else self.others.as_dict()),
            **({"path_dependent": True} if run.broke else {}),
            blocks=self.blocks,
            yield_point=self.yield_point.as_dict(),
            theory=None if self.theory is None else dataclasses.asdict(self.theory),
            steps=run.steps,
            time_step=run.time_step,
            critical_time_step=run.critical_time_step,
            simulated_time=run.simulated_time,
            unbalanced=run.unbalanced,
            control_points=self.control_points,
        )
