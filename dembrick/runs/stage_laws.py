"""Joint laws that change from one stage to the next: which of their numbers may, and which would need a new joint."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.assembly.validation import refuse
from dembrick.scenario.checks import show
from dembrick.scenario.stages import at_stage, laws_change
from dembrick.simulation.joint_strengths import has_strengths, strengths_of

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.joint_laws import JointLaw
    from dembrick.scenario.model import Scenario

MAY = ("friction", "residual_friction", "cohesion", "tensile_strength", "residual_cohesion")


def check_laws(scenario: Scenario, number: int, deformed: bool) -> None:
    """ScenarioError if the stage ``number`` gives a joint a law that what it remembers of the stage before cannot go on
    with; ``deformed``: that one has left a deformed geometry."""
    if number == 1 or not laws_change(scenario):
        return
    one, other = (assemblies.assemble(at_stage(scenario, n)) for n in (number - 1, number))
    check_change(scenario, one, other, f"stage {number}", deformed)


def check_change(scenario: Scenario, one: Assembly, other: Assembly, when: str, deformed: bool) -> None:
    """ScenarioError if joints cannot go on with the laws that they have in the ``other`` assembly of the same blocks;
    ``when`` they change, for a message; ``deformed``: in a deformed geometry."""
    before, now = one.joints.law, other.joints.law
    if len(before) != len(now):
        refuse(scenario, f"{when} changes the formulation of joints, which stays as it is")
    checked: set[tuple[int, int]] = set()
    for j, (had, has) in enumerate(zip(before, now, strict=True)):
        if (id(had), id(has)) in checked:
            continue
        checked.add((id(had), id(has)))
        a, b = (other.names[i] for i in (other.joints.block_a[j], other.joints.block_b[j]))
        joint = f"{when} of the joint between {show(a)} and {show(b)}"
        for key in (field.name for field in fields(has)):
            if key not in MAY and getattr(had, key) != getattr(has, key):
                refuse(scenario, f"{joint}: {key} stays as it is; what may change is {_LISTED}")
        if had.bonded != has.bonded:
            how = "form: give it a weak one from the start" if has.bonded else "vanish: leave it a weak one"
            refuse(scenario, f"{joint}: bonds break by what they bear, and do not {how}")
    points = [j for j, law in enumerate(now) if law.formulation != "convex"]
    if deformed and _sorted([before[j] for j in points]) != _sorted([now[j] for j in points]):
        refuse(
            scenario,
            f"{when} tells laws of joints apart that were one before, or puts them in another order, which "
            'joints with contact points cannot take in a deformed geometry: take formulation = "convex", or change all '
            "of them alike",
        )


_LISTED = f"{', '.join(MAY[:-1])} and {MAY[-1]}"


def _sorted(laws: list[JointLaw]) -> list[list[int]]:
    """How laws lie in the memory of a run in the deformed geometry, that sorts them by their numbers."""
    if not laws:
        return []
    tables = [np.array([(law.normal_stiffness, law.shear_stiffness, law.friction) for law in laws])]
    if has_strengths(laws):
        tables.append(np.column_stack(strengths_of(laws)[:-1]))  # type: ignore[index]
    return [np.unique(table, axis=0, return_inverse=True)[1].reshape(-1).tolist() for table in tables]
