"""The subject of a figure: the joint of a history with its limit surface, and the diagram that suits the run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick import theory
from dembrick.errors import HistoryError, ScenarioError
from dembrick.geometry.polygons import pieces
from dembrick.scenario.regimes import TILT_LOAD
from dembrick.views import summary
from dembrick.views.structure_numbers import BEFORE

if TYPE_CHECKING:
    from dembrick.history.reader import History
    from dembrick.theory.limit_surface import PointLaw, PolygonLaw

CUT = 0.01  # of a joint's size: its centroid moves by more if much of it is cut off


def time_name(record) -> str:
    """Axis label for the times of a record."""
    return "number of the equilibrium" if record.counts_equilibria else "time [s]"


def joint_names(history: History) -> list[str]:
    """``lower/upper`` for each joint: its two blocks, with its number if the same two share several joints."""
    pairs = _pairs(history)
    count = Counter(pairs)
    return [f"{pair} #{i}" if count[pair] > 1 else pair for i, pair in enumerate(pairs)]


def _pairs(history: History) -> list[str]:
    names = history.block_names
    return [f"{names[joint['block_a']]}/{names[joint['block_b']]}" for joint in history.joints]


def pushes_several(history: History) -> bool:
    """Whether the load acts on several blocks, as the shares of their weights do in a tilt or a pushover."""
    return len({actuator["block"] for actuator in history.actuators}) > 1


def chosen_joint(history: History, name: str | int | None = None) -> int:
    """Number of the joint called ``a/b`` (or ``b / a``, ``a/b #3``, or 3); without a name the one that failed.

    That is the joint of the yield point, else the first joint of a pushed block, else the one that slipped most.
    Raises HistoryError if there is no joint, ScenarioError if no joint has the name.
    """
    joints = history.joints
    if not joints:
        raise HistoryError(f"{history.path}: it has no joint to draw")
    if isinstance(name, int):
        if not 0 <= name < len(joints):
            raise ScenarioError(f"joint {name} is out of range: {history.path} has the joints 0 to {len(joints) - 1}")
        return name
    pairs = _pairs(history)
    if name:
        names = joint_names(history)
        for asked in (name, *_other_ways(name)):
            for known in (names, pairs):
                if asked in known:
                    return known.index(asked)
        if name.isdecimal():
            return chosen_joint(history, int(name))
        shown = ", ".join(names[:8]) + (" ..." if len(names) > 8 else "")
        raise ScenarioError(f"{history.path} has no joint {name!r}; its joints are {shown}")
    of_yield = summary.part(history.results, "yield_point").get("joint")
    if isinstance(of_yield, list | tuple) and "/".join(map(str, of_yield)) in pairs:
        return pairs.index("/".join(map(str, of_yield)))
    pushed = {actuator["block"] for actuator in history.actuators}
    for i, joint in enumerate(joints):
        if pushed & {joint["block_a"], joint["block_b"]}:
            return i
    return int(np.argmax(history.joint("slip")[-1])) if history.n_row and history.has_joints else 0


def _other_ways(name: str) -> Iterator[str]:
    """Other spellings of a joint's name: without spaces around the slash, as in the hinges of results, and with its
    blocks in the other order. Names of blocks may contain a slash."""
    pair, sign, number = name.strip().rpartition("#")
    pair, end = (pair.strip(), f" #{number.strip()}") if sign and number.strip().isdecimal() else (name.strip(), "")
    for cut in [i for i, letter in enumerate(pair) if letter == "/"]:
        one, other = pair[:cut].strip(), pair[cut + 1 :].strip()
        yield f"{one}/{other}{end}"
        yield f"{other}/{one}{end}"


def pressure_centre(carried: Mapping[str, float]) -> np.ndarray:
    """Centre of pressure (2,) m from O: the point where N alone has the moments M_1 and M_2."""
    return np.array([carried["M_2"], -carried["M_1"]]) / carried["N"]


def strengths(joint: Mapping, broken: bool = False) -> tuple[float, float]:
    """Friction coefficient and cohesion (Pa) of a joint of a history, with its bond intact or ``broken``."""
    if broken:
        return joint.get("residual_friction", joint["friction"]), joint.get("residual_cohesion", 0.0)
    return joint["friction"], joint.get("cohesion", 0.0)


def is_brittle(joint: Mapping) -> bool:
    """Whether a joint loses strength when it slips."""
    return strengths(joint) != strengths(joint, True)


def shear_strength(joint: Mapping, N, broken: bool = False):
    """c A + mu N of a joint (N), which may be negative in tension."""
    friction, cohesion = strengths(joint, broken)
    return cohesion * joint["area"] + friction * N


def limit_surface(joint: Mapping, carried: Mapping[str, float], broken: bool = False) -> PolygonLaw | PointLaw | None:
    """The torsion-shear limit surface of a joint in its own formulation, under the ``carried`` ``N``, ``M_1`` and
    ``M_2``, with its cohesion, or the residual one if the bond is ``broken``.

    Contact points press like springs under the eccentric normal force; with an intact bond they may be in tension. None
    if the joint has no strength, or if it has no intact bond and is open or its N acts outside it.
    """
    friction, cohesion = strengths(joint, broken)
    held = is_brittle(joint) and not broken
    strength = float(shear_strength(joint, carried["N"], broken))
    if not (strength > 0.0 and (held or carried["N"] > 0.0)):
        return None
    try:
        if joint["formulation"] == "convex":
            if held or cohesion > 0.0:
                return theory.convex(outlines(joint), 0.0, 0.0, strength / joint["area"])
            own = theory.polygon_formulation(outlines(joint), friction, joint["pressure"])
        elif held:
            force = linear_stress(joint["normal_arms"], joint["areas"], carried) * joint["areas"]
            bearing = np.maximum(cohesion * joint["areas"] + friction * force, 0.0)
            return theory.points(joint["shear_arms"], bearing, 1.0)
        else:
            arms = joint["normal_arms"], joint["areas"], friction, joint["shear_arms"]
            own = theory.point_formulation(*arms, joint["formulation"], cohesion)
        return own.law(carried["N"], pressure_centre(carried))
    except ScenarioError:
        return None


def outlines(joint: Mapping) -> list[np.ndarray]:
    """The convex polygons (m, 2) m of a joint of a history, one for each of its pieces."""
    return [joint["polygon"][corners] for corners in pieces(joint["polygon"])]


def linear_stress(arms: np.ndarray, areas: np.ndarray, carried: Mapping[str, float]) -> np.ndarray:
    """Normal stress (n,) Pa at points of a joint that can be in tension: linear over their ``arms``, in equilibrium
    with N, M_1 and M_2."""
    phi = np.column_stack([np.ones(len(arms)), arms])
    spread = np.linalg.pinv((phi * np.asarray(areas)[:, None]).T @ phi, rcond=1e-12, hermitian=True)
    return phi @ spread @ np.array([carried["N"], carried["M_2"], -carried["M_1"]])


def cut_at_edge(history: History, number: int, frame: int | None = None) -> bool:
    """Whether so much of a joint was cut off as it slid over an edge, in a ``frame`` or in any, that the limit surface
    of the whole joint is not its own."""
    first, last = (0, history.n_frames) if frame is None else (frame, frame + 1)
    shift = history.frame_values("joint_shift", first, last) if history.n_frames else None
    if shift is None:
        return False
    size = float(np.hypot(*history.joints[number]["polygon"].T).max())
    return bool(np.hypot(*shift[:, number].T).max() > CUT * size)


def carried_by(history: History, number: int, row: int = -1) -> dict[str, float]:
    """Forces of joint ``number`` in a row: N, V_1, V_2, M_T, M_1, M_2 (N, N m)."""
    if not (history.n_row and history.has_joints):
        raise HistoryError(f"{history.path}: the forces of its joints were not recorded; record the channel joints")
    row %= history.n_row
    names = ("N", "V_1", "V_2", "M_T", "M_1", "M_2")
    return {name: float(history.series(f"joint/{name}", row, row + 1)[0, number]) for name in names}


class Diagram(NamedTuple):
    """Axes of the diagram of a run: ``load`` over ``displacement``, by their names, and ``unit`` of the load. ``load``
    is None if no load grows; the displacement is then shown over time. ``tilts``: the load is shown as the angle of a
    tilting table in degrees; the record has its tangent."""

    load: str | None
    unit: str
    displacement: str
    tilts: bool = False

    def loads(self, recorded):
        """Loads (T,) of the record, or a single one, converted to ``unit``."""
        return np.degrees(np.arctan(recorded)) if self.tilts else recorded

    def limit(self, results: Mapping) -> tuple[float, float | None, str] | None:
        """Bounds of the limit load in ``unit``, the upper one None if there is none, and the limit in words; None
        without a lower bound, for a cyclic test and for a failed run."""
        point = summary.yield_point(results)
        if "cycles" in results or "error" in results or any(key not in point for key in ("V", "V_lower")):
            return None
        beside = summary.part(results, "path") | summary.part(results, "collapse")
        if self.tilts:
            said = summary.angle_text(point, beside)
        else:
            unit, factor = summary.load_unit(abs(point["V"]), self.unit.strip("-"))
            said = summary.limit_text(*summary.converted(point, beside, lambda V: factor * V), unit)
        lower, upper = float(self.loads(point["V_lower"])), point.get("V_upper")
        if upper is None or point.get("bracket", "open") == "open":
            return lower, None, str(said)
        return lower, float(self.loads(upper)), str(said)

    def allowed(self, results: Mapping) -> dict[str, tuple[float, str]]:
        """Reactions (N) "least" and "greatest" along the motion of the supports by limit analysis, before they move,
        each with its legend text; those without a limit are left out, all if limit analysis was not requested."""
        found = summary.part(summary.part(results, "settlement"), "limit_analysis")
        ends = {which: summary.number(found.get(which)) for which in ("least", "greatest")}
        return {
            which: (value, f"{which} by limit analysis, {BEFORE}: {summary.load_text(value)}")
            for which, value in ends.items()
            if value is not None
        }


class Record(NamedTuple):
    """Time (T,) s, load (T,) and displacement (T,) m of a run."""

    time: np.ndarray
    load: np.ndarray
    displacement: np.ndarray


def record_of(source) -> Record:
    """The rows of a history or of a result."""
    rows = getattr(source, "rows", None)
    return Record(*(np.asarray(getattr(source, n) if rows is None else rows[n]) for n in Record._fields))


def diagram_of(source) -> Diagram:
    """The diagram for a history or a result, from the curve that its control defines."""
    curve = source.curve
    if curve.load is None:
        return Diagram(None, "", curve.displacement)
    if curve.load == TILT_LOAD:
        return Diagram("table angle θ", "deg", curve.displacement, tilts=True)
    return Diagram(curve.load, "-" if curve.unit == "1" else curve.unit, curve.displacement)
