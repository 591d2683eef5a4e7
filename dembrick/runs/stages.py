"""Stages of a scenario: quasi-static controls one after the other, each on the state that the last one left.

A checkpoint holds the number of the stage, the results of those before it and the state that they left, beside what the
stage itself goes on from. Between two stages it is that state alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.assembly.validation import refuse
from dembrick.errors import DembrickError, HistoryError, UndecidedError
from dembrick.runs.drivers import driver_of
from dembrick.runs.result import fell
from dembrick.runs.stage_laws import check_laws
from dembrick.scenario.checks import present, show
from dembrick.scenario.stages import at_stage, controls_of, ties_before
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.energy_audit import Auditor
from dembrick.simulation.session import Kept, Prefixed, Session, Snapshot
from dembrick.simulation.statics.state import State, initial_state

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

_NUMBER, _RESULTS, _AUDIT, _LEFT = "stages.number", "stages.results", "stages.audit", "stages.left."
_BETWEEN = "stages.between"  # what a checkpoint between two stages has, and no other
_LONGEST = 1 << 24  # bytes of the results of all stages


@dataclass
class Stages:
    """The stages before the last: how many are ``done``, their ``results``, and the state that they ``left``."""

    scenario: Scenario
    done: int = 0
    results: list[dict] = field(default_factory=list)
    left: State | Kept | None = None
    auditor: Auditor = field(default_factory=Auditor)

    def run(self, session: Session) -> Session:
        """Carry out the stages that are not done yet; the surroundings of the last one.

        Raises ScenarioError if a stage falls, on which no other can start, UndecidedError
        if that is not known; what a stage itself raises names it.
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
            session, keep=self._keeping(session), start=self.left, ties_before=ties_before(self.scenario, last)
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
        )
        try:
            assembly = assemblies.assemble(scenario)
            check_laws(self.scenario, number, isinstance(self.left, Kept))
            run = driver_of(scenario.control).run(scenario, assembly, own)
            audit = None if run.energy is None else self.auditor.result(run.energy)
        except DembrickError as error:
            error.args = (f"stage {number} ({scenario.control.kind}): {error}", *error.args[1:])
            raise
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
            refuse(
                scenario,
                f"stage {number} of kind {show(scenario.control.kind)} fell, and no stage can start on blocks that "
                "fall: end the stages there, or change what brings them down",
            )
        told = {"stage": number, "kind": scenario.control.kind, **answer}
        self.results.append(json.loads(json.dumps(told)))  # as a checkpoint gives it back
        left = getattr(run, "left", None) or getattr(run, "state", None)  # of a search the state at its limit
        self.done, self.left, self.auditor = number, present(left), Auditor()

    def _audit(self, rows: Mapping, _) -> None:
        self.auditor.add(rows["energy"])

    def _keeping(self, session: Session, between: bool = False):
        """Function that writes a checkpoint of a stage, with what the stages before it have left."""
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
        """Take the stages before from a snapshot; what the stage that was running goes on from, None between two."""
        done, size = snapshot.array(_NUMBER, np.zeros(2)).tolist()
        if not (done in range(len(self.scenario.stages) + 1) and size in range(_LONGEST)):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no stage of this run")
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
            self.left = Kept({}, Prefixed(snapshot, _LEFT))  # read as the stage after it begins
        elif self.done:
            state = initial_state(assemblies.assemble(at_stage(self.scenario, self.done)))
            self.left = restored_state(state, Prefixed(snapshot, _LEFT))
        return None if _BETWEEN in snapshot else snapshot
