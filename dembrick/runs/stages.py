"""Stages of a scenario: controls executed in sequence, each from the state that the last one left.

A checkpoint holds the number of the stage, the results of the stages before it and the state that they left, beside the
checkpoint of the stage itself, which is missing between two stages. Joint laws may change from one stage to the next,
except for numbers that would need a new joint.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.assembly.validation import refuse
from dembrick.errors import DembrickError, HistoryError, StageFellError, UndecidedError
from dembrick.runs.drivers import driver_of
from dembrick.runs.outcomes.result import fell
from dembrick.scenario.checks import present, show
from dembrick.scenario.stages import at_stage, controls_of, laws_change, ties_before
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.energy_audit import Auditor
from dembrick.simulation.joint_laws import has_strengths, strengths_of
from dembrick.simulation.load_increments import left_by
from dembrick.simulation.session import Kept, Prefixed, Session, Snapshot
from dembrick.simulation.statics.joint_families import broke
from dembrick.simulation.statics.state import State, initial_state

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.joint_laws import JointLaw
    from dembrick.scenario.model import Scenario


_NUMBER, _RESULTS, _AUDIT, _LEFT = "stages.number", "stages.results", "stages.audit", "stages.left."
_BETWEEN = "stages.between"  # only a checkpoint between two stages has it
_LONGEST = 1 << 24  # bytes, at most, of the results of all stages


@contextmanager
def _named(number: int, scenario: Scenario) -> Iterator[None]:
    """Context in which errors name the stage."""
    try:
        yield
    except DembrickError as error:
        error.args = (f"stage {number} ({scenario.control.kind}): {error}", *error.args[1:])
        raise


def warnings_before(scenario: Scenario) -> list[str]:
    """Warnings on the stages before the last. Errors of their assembly or plan are raised and name the stage; so are
    errors for joint laws with which a stage cannot continue."""
    found = []
    for number, control in enumerate(scenario.stages, 1):
        own = at_stage(scenario, number)
        with _named(number, own):
            assembly = assemblies.assemble(own)
            check_laws(scenario, number, number > 1 and scenario.stages[number - 2].regime.real_time)
            driver_of(control).plan(own, assembly)
        found += [f"stage {number} ({control.kind}): {warning}" for warning in assembly.warnings]
    if scenario.stages:
        check_laws(scenario, len(scenario.stages) + 1, scenario.stages[-1].regime.real_time)
    return found


@dataclass
class Stages:
    """The stages before the last: how many are ``done``, their ``results``, and the state that they ``left``."""

    scenario: Scenario
    done: int = 0
    results: list[dict] = field(default_factory=list)
    left: State | Kept | None = None
    auditor: Auditor = field(default_factory=Auditor)

    def run(self, session: Session) -> Session:
        """Execute the stages that are not done yet; return the session of the last control.

        Raises ScenarioError if blocks fall in a stage, as no other can start from that, UndecidedError
        if that is not known; errors of a stage name it.
        """
        if session.resumed is not None:
            session = replace(session, resumed=self._resumed(session.resumed))
        while self.done < len(self.scenario.stages):
            self._one(session)
            session = replace(session, resumed=None)
            keep = self._keeping(session, between=True)
            if keep is not None:
                keep({}, f"stage {self.done} of {len(self.scenario.stages) + 1}")
        last = self.done + 1
        check_laws(self.scenario, last, isinstance(self.left, Kept))
        return replace(
            session,
            keep=self._keeping(session),
            start=self.left,
            ties_before=ties_before(self.scenario, last),
            force_error=left_by(self.results),
        )

    def _one(self, session: Session) -> None:
        number = self.done + 1
        scenario = at_stage(self.scenario, number)
        own = Session(
            observe=self._audit,
            output=scenario.output,
            keep=self._keeping(session),
            resumed=session.resumed,
            tell=session.tell,
            report=session.report,
            start=self.left,
            ties_before=ties_before(self.scenario, number),
            force_error=left_by(self.results),
            hands_on=True,
        )
        with _named(number, scenario):
            assembly = assemblies.assemble(scenario)
            check_laws(self.scenario, number, isinstance(self.left, Kept))
            run = driver_of(scenario.control).run(scenario, assembly, own)
            audit = None if run.energy is None else self.auditor.result(run.energy)
        seconds = {"compile": run.compile_seconds, "loop": run.loop_seconds}
        result = driver_of(scenario.control).result(
            scenario=scenario, assembly=assembly, run=run, rows={}, frames={}, wall=seconds, energy=audit
        )
        answer = result.as_dict()
        try:
            down = scenario.control.regime.stands_or_falls and fell(answer)
        except UndecidedError as error:
            raise UndecidedError(f"stage {number} ({scenario.control.kind}): {error}") from None
        if down:
            raise StageFellError(
                f"{f'{scenario.path}: ' if scenario.path else ''}stage {number} of kind {show(scenario.control.kind)} "
                "fell, and no stage can start on blocks that fall: end the stages there, or change what brings them "
                "down",
                result,
            )
        told = {"stage": number, "kind": scenario.control.kind, **answer}
        self.results.append(json.loads(json.dumps(told)))  # as a checkpoint gives it back
        left = getattr(run, "reached", None) or getattr(run, "left", None) or getattr(run, "state", None)
        remark = _bonds_at_limit(assembly, run)
        if remark and session.report:
            session.report(f"stage {number} ({scenario.control.kind}): {remark}")
        self.done, self.left, self.auditor = number, present(left), Auditor()

    def _audit(self, rows: Mapping, _) -> None:
        self.auditor.observe(rows)

    def _keeping(self, session: Session, between: bool = False):
        """Function that writes a checkpoint of a stage, with the results and the state that earlier stages left."""
        keep = session.keep
        if keep is None:
            return None

        def kept(arrays: Mapping[str, np.ndarray], where: str) -> None:
            text = np.frombuffer(json.dumps(self.results).encode(), np.uint8)
            number = np.array([self.done, len(text)], float)
            own: dict[str, Any] = {_NUMBER: number, _RESULTS: text, _AUDIT: self.auditor.worst}
            if self.left is not None:
                left = self.left.arrays if isinstance(self.left, Kept) else flattened({"state": self.left})
                own |= {f"{_LEFT}{name}": array for name, array in left.items()}
            if between:
                own[_BETWEEN] = number
            keep({**arrays, **own}, where if between else f"{where} of stage {self.done + 1}")

        return kept

    def _resumed(self, snapshot: Snapshot) -> Snapshot | None:
        """Restore earlier stages from a snapshot; return it for the stage that was running, None between two."""
        done, size = snapshot.array(_NUMBER, np.zeros(2)).tolist()
        if not (done in range(len(self.scenario.stages) + 1) and size in range(_LONGEST)):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no stage of this run")
        text = snapshot.array(_RESULTS, np.zeros(int(size), np.uint8)).tobytes()
        try:
            results = json.loads(text)
        except ValueError:
            results = None
        if not isinstance(results, list) or len(results) != done:
            raise HistoryError(f"{snapshot.path}: the results of its stages cannot be read")
        self.done, self.results = int(done), results
        self.auditor.worst[:] = snapshot.array(_AUDIT, self.auditor.worst)
        if self.done and controls_of(self.scenario)[self.done - 1].regime.real_time:
            self.left = Kept({}, Prefixed(snapshot, _LEFT))  # read when the next stage begins
        elif self.done:
            state = initial_state(assemblies.assemble(at_stage(self.scenario, self.done)))
            self.left = restored_state(state, Prefixed(snapshot, _LEFT))
        return None if _BETWEEN in snapshot else snapshot


def _bonds_at_limit(assembly: Assembly, run) -> str | None:
    """Remark on bonds that break at the limit of a search, and how the next stage inherits them."""
    left, limit = getattr(run, "left", None), getattr(run, "state", None)
    if isinstance(left, State) and isinstance(limit, State) and broke(left, limit):
        return "bonds that break at the limit stay broken in later stages"
    breaks = getattr(run, "collapse", None) is not None and any(law.bonded for law in assembly.joints.law)
    said = (
        "the next stage starts from the last equilibrium before collapse; bonds that broke in the collapse are intact"
    )
    return said if breaks else None


MAY = ("friction", "residual_friction", "cohesion", "tensile_strength", "residual_cohesion")


def check_laws(scenario: Scenario, number: int, deformed: bool) -> None:
    """Raise ScenarioError if stage ``number`` gives a joint a law that cannot continue its history of the stage before;
    ``deformed``: whether that stage left a deformed geometry."""
    if number == 1 or not laws_change(scenario):
        return
    one, other = (assemblies.assemble(at_stage(scenario, n)) for n in (number - 1, number))
    check_change(scenario, one, other, f"in stage {number}", deformed)


def check_change(scenario: Scenario, one: Assembly, other: Assembly, when: str, deformed: bool) -> None:
    """Raise ScenarioError if joints cannot continue with their laws in the ``other`` assembly of the same blocks;
    ``when`` they change, for a message; ``deformed``: whether in a deformed geometry."""
    before, now = one.joints.law, other.joints.law
    if len(before) != len(now):
        refuse(scenario, f"the formulation of joints cannot change {when}")
    checked: set[tuple[int, int]] = set()
    for j, (had, has) in enumerate(zip(before, now, strict=True)):
        if (id(had), id(has)) in checked:
            continue
        checked.add((id(had), id(has)))
        a, b = (other.names[i] for i in (other.joints.block_a[j], other.joints.block_b[j]))
        joint = f"of the joint between {show(a)} and {show(b)}"
        for key in (entry.name for entry in fields(has)):
            if key not in MAY and getattr(had, key) != getattr(has, key):
                refuse(scenario, f"{key} {joint} cannot change {when}; only {_LISTED} can")
        if had.bonded != has.bonded:
            how, remedy = (
                ("form", "give the joint a weak bond from the start")
                if has.bonded
                else ("vanish", "leave the joint a weak bond")
            )
            refuse(scenario, f"bonds {joint} break only by stress, and cannot {how} {when}: {remedy}")
    points = [j for j, law in enumerate(now) if law.formulation != "convex"]
    if deformed and _sorted([before[j] for j in points]) != _sorted([now[j] for j in points]):
        refuse(
            scenario,
            f"laws of joints that were one before are told apart {when}, or come in another order, which "
            'joints with contact points cannot take in a deformed geometry: take formulation = "convex", or change all '
            "of them alike",
        )


_LISTED = f"{', '.join(MAY[:-1])} and {MAY[-1]}"


def _sorted(laws: list[JointLaw]) -> list[list[int]]:
    """Places of the laws in the tables of a run in the deformed geometry, which sorts them by their numbers."""
    if not laws:
        return []
    tables = [np.array([(law.normal_stiffness, law.shear_stiffness, law.friction) for law in laws])]
    if has_strengths(laws):
        tables.append(np.column_stack(strengths_of(laws)[:-1]))  # type: ignore[index]
    return [np.unique(table, axis=0, return_inverse=True)[1].reshape(-1).tolist() for table in tables]
