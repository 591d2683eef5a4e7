"""Limit analysis of a scenario: limit(scenario) -> LimitResult."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.assembly.actuators import recorded_curve
from dembrick.errors import DembrickError, NotConvergedError, ScenarioError
from dembrick.runs.left_out import LeftOut, left_out
from dembrick.runs.limit_cases import StandingResult, assembled, failure, finite, stands
from dembrick.runs.outcomes.result import heading, tied
from dembrick.runs.reading import load
from dembrick.scenario.checks import listed, present
from dembrick.scenario.controls import DEAD_LOAD, DEFORMED_REST, Control
from dembrick.scenario.model import Scenario
from dembrick.scenario.regimes import SETTLEMENT
from dembrick.simulation.floating_point import faults_raised
from dembrick.simulation.limit_analysis import analysis, solver
from dembrick.simulation.limit_analysis.mechanism import names_of
from dembrick.simulation.limit_analysis.non_associative import SecondOpinion, second_opinion
from dembrick.views.number_lines import KeyNumber, aligned
from dembrick.views.structure_numbers import of_ties

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

SLIDES, PRESSES = 1e-3, 1e-6  # of the greatest motion, and of the greatest N: joints that slide, and that press
SECONDS_A_BLOCK = 3e-3  # of processor time, roughly; large assemblies take more


@dataclass(repr=False)
class LimitResult:
    """The limit of a ``scenario``'s load by rigid-block limit analysis of its ``assembly``, associative flow.

    ``limit``: load factor with its bounds, joint forces, mechanism. ``load_factor`` is V in N if actuators push.
    ``second_opinion``: heuristic without dilatancy, if asked for. ``left_out``: effects that the joint laws leave out;
    ``remarks``: sentences on the meaning of the answer; ``wall``: seconds.
    """

    scenario: Scenario
    assembly: assemblies.Assembly
    limit: analysis.Limit
    left_out: list[LeftOut]
    wall: dict
    second_opinion: SecondOpinion | None = None
    remarks: list[str] = field(default_factory=list)

    @property
    def load_factor(self) -> float:
        """The multiplier of the load; infinite if nothing limits it."""
        return self.limit.load_factor

    @property
    def lower(self) -> float:
        """Lower bound: a load that joint forces within their strengths balance."""
        return self.limit.lower

    @property
    def upper(self) -> float:
        """Upper bound: the load at which a mechanism moves."""
        return self.limit.upper

    @property
    def mechanism(self) -> str | None:
        """rocking, sliding, torsion, torsion-shear; None if nothing moves."""
        return None if self.limit.mechanism is None else self.limit.mechanism.kind

    @property
    def blocks(self) -> list[str]:
        """Names of the blocks that move."""
        return names_of(self.assembly, self.limit.mechanism)

    @property
    def angle(self) -> float | None:
        """Angle of a tilting table (deg); 90 if the blocks stand at any tilt."""
        return self.scenario.control.angle(self.load_factor)

    @property
    def status(self) -> str:
        """ "limit", or "unlimited"."""
        return "unlimited" if self.limit.unlimited else "limit"

    def __repr__(self) -> str:
        return f"<LimitResult {self.scenario.title!r}: {self.status}, {self.lower:.6g} to {self.upper:.6g}>"

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick limit --json``."""
        found = {
            **heading(self.scenario, self.assembly),
            "status": self.status,
            "unlimited": self.limit.unlimited,
            "load_factor": finite(self.load_factor),
            "lower": finite(self.lower),
            "upper": finite(self.upper),
            "angle": self.angle,
            "flow": "associative",
            "mechanism": self.mechanism,
            "blocks": self.blocks,
            "left_out": [one.as_dict() for one in self.left_out],
            "remarks": self.remarks,
            "rounds": self.limit.rounds,
            "wall": self.wall,
        }
        if self._ties():
            found["ties"] = self._ties()
        if self.second_opinion is not None:
            one = self.second_opinion
            found["second_opinion"] = {
                "flow": "without dilatancy (heuristic)",
                "load_factor": one.load_factor,
                "low": one.low,
                "high": one.high,
                "settled": one.settled,
                "programmes": one.programmes,
                "ended": one.ended,
                "mechanism": one.mechanism.kind,
            }
        return found

    def _ties(self) -> list[dict]:
        """The tension (N) of every tie in the limit state."""
        return [] if self.limit.forces is None else tied(self.assembly, tension=self.limit.forces.tension)

    def text(self) -> str:
        """Text of the command line."""
        unit = " N" if recorded_curve(self.scenario.control, self.assembly.actuators).unit == "N" else ""
        if self.limit.unlimited:
            lines = [self.scenario.title, *aligned([KeyNumber("limit", _unlimited(self.scenario.control))])]
            return "\n".join([*lines, *self.remarks])
        what = "V" if unit else "load factor"
        angle = "" if self.angle is None else f"{self.angle:.6g} deg, "
        digits = _digits(self.limit)
        ends = f"{_rounded(self.lower, digits + 1, ROUND_FLOOR)} and {_rounded(self.upper, digits + 1, ROUND_CEILING)}"
        numbers = [
            KeyNumber("limit", f"{angle}{what} {self.load_factor:.{digits}g}{unit}, proven between {ends}{unit}")
        ]
        numbers += of_ties({"ties": self._ties()})
        numbers.append(KeyNumber("flow", "associative: an upper bound for friction without dilatancy"))
        numbers += [KeyNumber("mechanism", present(self.mechanism)), KeyNumber("blocks", listed(self.blocks))]
        if self.second_opinion is not None:
            one = self.second_opinion
            bound = f"without dilatancy, no bound: the sequence of programmes {one.ended}"
            numbers.append(KeyNumber("heuristic", f"{one.load_factor:.5g}{unit} {bound}"))
        numbers += [KeyNumber("left out", one.text) for one in self.left_out]
        numbers += [KeyNumber("remark", remark) for remark in self.remarks]
        return "\n".join([self.scenario.title, *aligned(numbers)])

    def picture(self, path: str | os.PathLike, **look) -> str:
        """A PNG of the mechanism; ``look`` as for ``dembrick.views.render.picture``."""
        from dembrick.runs.mechanism_history import picture

        return picture(self, path, **look)

    def write(self, path: str | os.PathLike, force: bool = False) -> str:
        """Write the mechanism as a history of two frames, which ``dembrick render`` draws."""
        from dembrick.runs.mechanism_history import write

        return write(self, path, force)


def limit(
    scenario: Scenario | str | os.PathLike,
    *,
    heuristic: bool = False,
    report: Callable[[str], None] | None = None,
) -> LimitResult | StandingResult:
    """Rigid-block limit analysis of a scenario (or the TOML file of one): the greatest load of its control; or, for
    ``kind = "statics"``, which has no load, whether it stands: a `StandingResult`, see `limit_cases.stands`.

    Supports, loads and joints are those of the search; ``heuristic`` adds the second opinion without dilatancy. Raises
    ScenarioError for input that is no test or has no load, NotConvergedError if it does not stand under its dead
    loads or the solver fails, MissingDependency without the extra ``limit``.
    """
    scenario = scenario if isinstance(scenario, Scenario) else load(scenario)
    if scenario.control.regime in (DEAD_LOAD, DEFORMED_REST):
        if heuristic:
            raise ScenarioError('the second opinion belongs to a load, and kind "statics" has none')
        return stands(scenario, report=report)
    if scenario.control.regime is SETTLEMENT:
        raise ScenarioError(
            "a settlement has no load to multiply; for the least and greatest reaction of a support before it moves "
            "give --reaction SUPPORT --direction X,Y,Z"
        )
    began = time.perf_counter()
    given, assembly, built = assembled(scenario, began, report)
    tilt = given.control.tilt_axis is not None
    try:
        with faults_raised():
            found = analysis.limit_load(assembly, tilt=tilt)
        opinion = second_opinion(assembly) if heuristic and not found.unlimited else None
        beside = (
            []
            if found.unlimited
            else left_out(assembly, found.load_factor, found.resultants, _moves(assembly, found), tilt)
        )
    except DembrickError as error:
        if isinstance(error, NotConvergedError):
            error.answer = failure(given, error)
        raise
    remarks = []
    if analysis.bounded_by_corners(assembly.joints).any():
        remarks.append(
            "joints of effective or linear pressure have no convex limit surface, so points at their corners bound them"
        )
    wall = {"build": built, "solve": found.seconds, "total": time.perf_counter() - began}
    return LimitResult(given, assembly, found, beside, wall, opinion, remarks)


def associative_bound(assembly: Assembly, control: Control) -> dict | None:
    """``collapse.associative`` of a search: load factor of limit analysis with its bounds; None if nothing limits
    it. ``assembly`` as the search has it. Raises as :func:`limit` does."""
    found = analysis.limit_load(assembly, tilt=control.tilt_axis is not None)
    if found.unlimited:
        return None
    return {"load_factor": found.load_factor, "lower": found.lower, "upper": found.upper}


def sliding_joints(assembly: Assembly, control: Control) -> int:
    """Number of pressed joints that slide in the mechanism of limit analysis; 0 if nothing limits the load. Raises as
    :func:`limit` does."""
    found = analysis.limit_load(assembly, tilt=control.tilt_axis is not None)
    if found.unlimited:
        return 0
    slid, turned, tilted = _moves(assembly, found).T
    slips = np.maximum(slid, turned)
    pressed = found.resultants[:, 0] > PRESSES * found.resultants[:, 0].max(initial=0.0)
    return int(((slips > SLIDES * max(slips.max(), tilted.max())) & pressed).sum())


def cheaper_than(seconds: float, assembly: Assembly) -> bool:
    """Whether limit analysis is installed and surely takes less than ``seconds`` for an assembly."""
    return expected_seconds(assembly) < seconds and solver.installed()


def expected_seconds(assembly: Assembly) -> float:
    """Estimated time of limit analysis of an assembly (s), imports of its packages included."""
    blocks = int((~assembly.fixed).sum())
    return 0.5 + SECONDS_A_BLOCK * blocks * max(1.0, blocks / 1000.0) ** 0.5


def _moves(assembly: Assembly, found: analysis.Limit) -> np.ndarray:
    """Motion (j, 3) of the rims of the joints in the mechanism: by sliding, turning about the normal, and tilting."""
    moved = present(found.mechanism).relative
    reach = np.array([np.abs(joint.polygon).max() for joint in assembly.joints])
    return np.stack(
        [
            np.hypot(moved[:, 0], moved[:, 1]),
            reach * np.abs(moved[:, 5]),
            reach * np.hypot(moved[:, 3], moved[:, 4]),
        ],
        axis=1,
    )


def _unlimited(control: Control) -> str:
    if control.tilt_axis is not None:
        return "stands at any tilt up to 90 deg: no mechanism exists at any angle"
    return "unlimited: no mechanism exists along the load, so rigid blocks carry any load"


def _digits(found: analysis.Limit) -> int:
    """Significant digits of the load factor that its bounds justify."""
    gap = max(found.gap, 1e-10)
    return int(min(9, max(4, math.floor(-math.log10(gap)) + 1)))


def _rounded(value: float, digits: int, way: str) -> str:
    """A bound with so many significant digits, rounded away from the other bound."""
    return f"{float(Context(prec=digits, rounding=way).create_decimal_from_float(value)):.{digits}g}"
