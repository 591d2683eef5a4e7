"""The path of a joint's shear force and torsion on its yield domain."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick import theory
from dembrick.errors import ScenarioError
from dembrick.history.rest_geometry import STRENGTHS
from dembrick.views import summary
from dembrick.views.given import accepts_paths
from dembrick.views.plot import runs, style, subject
from dembrick.views.plot.curves import head_and_legend
from dembrick.views.plot.runs import labelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dembrick.history.reader import History

BROKEN = "bond broken"  # of a section: with the residual strengths only
CUT_AT_EDGE = "cut at an edge: torsion about what is left; no domain is drawn, as it changes with the shape"
_RAYS = 90  # steps between the rays of a section through a limit surface, from pure shear to pure torsion
_VISITS = 0.01  # of the greatest V or M_T: a path that is further across an axis visits the quarter behind it
_PURE = 1e-6  # of the strength: a smaller shear force counts as zero
ALONG = 0.015  # component of a direction across an axis: with less it is along that axis
_CHANGES = 1e-3  # of the greatest N of the record: if N varies by more, there is no single domain


class Section(NamedTuple):
    """Section of a limit surface by the plane of a shear direction and the torsion axis: ``V`` and ``M_T`` (N, N m) in
    the quarters of its path, in the sense from V to M_T. ``bond``: state of a breakable bond, "bonded" or "bond
    broken"; empty without one."""

    formulation: str
    V: np.ndarray
    M_T: np.ndarray
    bond: str = ""

    @property
    def name(self) -> str:
        """Name in a legend."""
        shown = "convex, exact" if self.formulation == "convex" else self.formulation
        return f"limit surface, {shown}{self.bond and f', {self.bond}'}"


class JointPath(NamedTuple):
    """Load path of a joint. ``V`` (T,) N: shear force along ``direction`` (in t1, t2); ``M_T`` (T,) N m: torsion times
    ``sense``; each is positive in the sense of its greatest value, of the first if several are nearly as great.
    ``quarters``: where the sections begin and end, in right angles from V > 0: (0, 1) is the first quarter, (-1, 3) are
    all four. ``sections``: the joint's own yield domain at the last row, and the exact one of the convex formulation if
    different, with the cohesion of the joint. If slip destroys the bond, there are two: the bonded one, taken at the
    greatest V if the bond broke, and the residual one.

    A domain grows with N. If N varies, ``strength`` (T,) N is c A + mu N for the current state of the bond, NaN without
    strength, and the sections are those of a joint with centred N, over its strengths in shear and in torsion; the
    latter is ``radius`` (m) times the former, in the joint's ``formulation``. Otherwise ``strength`` is None.

    ``M_T`` is about the centroid of what is left of a joint that was ``cut`` as it slid over an edge; such a joint has
    no sections, as the domain of the whole joint is not its own.
    """

    joint: str
    number: int
    normal_force: float
    direction: np.ndarray
    V: np.ndarray
    M_T: np.ndarray
    quarters: tuple[int, int]
    sections: tuple[Section, ...]
    strength: np.ndarray | None = None
    radius: float = 1.0
    formulation: str = ""
    cohesive: bool = False
    sense: float = 1.0
    cut: bool = False

    @property
    def told(self) -> tuple[str, str, str, str]:
        """Its joint, N, the direction of V, and its torsion with the sign it is shown with."""
        pressed = "N of the moment" if self.strength is not None else f"N = {summary.load_text(self.normal_force)}"
        torsion = "torsion $M_T$" if self.sense > 0.0 else "torsion $-M_T$"
        return f"joint {style.plain(self.joint)}", pressed, f"V {direction_in_words(self.direction)}", torsion

    @property
    def drawn(self) -> tuple[np.ndarray, np.ndarray]:
        """V and M_T (T,) in the units of the sections: N and N m, or relative to the current strengths."""
        if self.strength is None:
            return self.V, self.M_T
        return self.V / self.strength, self.M_T / (self.strength * self.radius)


@accepts_paths
def joint_path(history: History, joint: str | int | None = None, quarters: tuple[int, int] = (0, 1)) -> JointPath:
    """The path of one joint (see :func:`dembrick.views.plot.subject.chosen_joint`) through the whole record.

    Its sections are in ``quarters`` and wherever else the path goes.
    """
    number = subject.chosen_joint(history, joint)
    own, now = history.joints[number], subject.carried_by(history, number)
    V_1, V_2, M_T = (history.joint(name)[:, number] for name in ("V_1", "V_2", "M_T"))
    size = np.hypot(V_1, V_2)
    furthest = int(np.argmax(size))
    reach = float(np.hypot(*own["polygon"].T).max())
    most = max(float(subject.shear_strength(own, now["N"])), float(np.abs(M_T).max()) / reach)
    sliding = size[furthest] > _PURE * most
    direction = np.array([V_1[furthest], V_2[furthest]]) / size[furthest] if sliding else np.array([0.0, 1.0])
    direction = math.copysign(1.0, _first_of_the_greatest(np.stack([V_1, V_2], axis=1) @ direction)) * direction
    sense = -1.0 if _first_of_the_greatest(M_T) < -_PURE * most * reach else 1.0
    N, strength, radius = history.joint("N")[:, number], None, 1.0
    held = _held(history, number)
    broke = subject.is_brittle(own) and held[-1] < 1.0
    surfaces: list[tuple[str, theory.Law | None]] = []
    cut = subject.cut_at_edge(history, number)
    if cut:
        pass
    elif own["friction"] > 0.0 and N.max() > 0.0 and np.ptp(N) > _CHANGES * N.max():
        strength = held * subject.shear_strength(own, N)
        strength = strength + (1.0 - held) * np.where(N > 0.0, subject.shear_strength(own, N, True), 0.0)
        strength = np.where(strength > 0.0, strength, np.nan)
        own, now = _of_friction_1(own), {"N": 1.0, "M_1": 0.0, "M_2": 0.0}
        surfaces = [("", subject.limit_surface(own, now))]
    elif subject.is_brittle(own):
        whole = subject.carried_by(history, number, furthest) if broke else now
        surfaces = [
            ("bonded", subject.limit_surface(own, whole)), (BROKEN, subject.limit_surface(own, now, broken=True))
        ]  # fmt: skip
    else:
        surfaces = [("", subject.limit_surface(own, now))]
    laws = [(bond, law) for bond, law in surfaces if law is not None]
    if strength is not None and laws:
        radius = theory.torsion_strength(laws[0][1])
    along = np.stack([V_1, V_2], axis=1) @ direction
    quarters = _all_of([quarters, _visited(along, sense * M_T, _PURE * most, _PURE * most * reach)])

    def section(formulation: str, law: theory.Law, bond: str) -> Section:
        V, M_T = _section(law, direction, sense, quarters)
        return Section(formulation, V, M_T / radius, bond)

    sections = [section(_formulation(own), law, bond) for bond, law in laws]
    V_0 = float(subject.shear_strength(own, now["N"]))
    if not cut and V_0 > 0.0 and (now["N"] > 0.0 or subject.is_brittle(own)) and _formulation(own) != "convex":
        exact = theory.convex(subject.outlines(own), 0.0, 0.0, V_0 / own["area"])
        sections.append(section("convex", exact, surfaces[0][0]))
    name = subject.joint_names(history)[number]
    given = history.joints[number]
    return JointPath(
        name, number, float(N[-1]), direction, along, sense * M_T, quarters, tuple(sections), strength, radius,
        _formulation(own), subject.strengths(given)[1] > 0.0 or subject.is_brittle(given), sense, cut,
    )  # fmt: skip


def _held(history: History, number: int) -> np.ndarray:
    """(T,): share of a joint's area whose bond holds, in the last frame up to each row; 1 if not recorded, and for
    joints without a breakable bond."""
    held = history.frame_values("bond", 0, history.n_frames) if history.n_frames else None
    if held is None or not len(held) or not subject.is_brittle(history.joints[number]):
        return np.ones(history.n_row)
    frame = np.searchsorted(history.frame_time, history.time, side="right") - 1
    return held[np.maximum(frame, 0), number]


def _of_friction_1(joint: dict) -> dict:
    """The same joint without a bond and with friction 1: its limit surface at N = 1 is relative to the strength."""
    return {key: value for key, value in joint.items() if key not in STRENGTHS} | {"friction": 1.0}


def _formulation(joint: dict) -> str:
    """The formulation, with its pressure if that is not the paper's."""
    follows = joint["formulation"] == "convex" and joint["pressure"] != "full"
    return f"convex, {joint['pressure']} pressure" if follows else joint["formulation"]


def _first_of_the_greatest(values: np.ndarray) -> float:
    """The first value nearly as great, in size, as the greatest: cycles reach about the same in both directions."""
    size = np.abs(values)
    return float(values[int(np.argmax(size >= (1.0 - _VISITS) * size.max()))])


def _visited(V: np.ndarray, M_T: np.ndarray, least_V: float, least_M_T: float) -> tuple[int, int]:
    """Quarters of a path, see `JointPath`: the first, those beside it that it visits, and all if it visits the opposite
    one. Smaller forces than the least (N, N m) count as zero."""
    back, below = (
        own < -max(_VISITS * float(np.abs(own).max()), least) for own, least in ((V, least_V), (M_T, least_M_T))
    )
    if (back & below).any():
        return -1, 3
    return -int(below.any()), 1 + int(back.any())


def _all_of(quarters: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Quarters that include all of the given ones."""
    begins, ends = zip(*quarters, strict=True)
    return min(begins), max(ends)


def _section(
    law: theory.Law, direction: np.ndarray, sense: float, quarters: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """V and M_T of a limit surface in some ``quarters``. Opposite ones are equal, as its power does not depend on the
    sign of the twist; others only with N in the middle and shear along an axis of symmetry."""
    steps = np.arange(_RAYS * quarters[0], _RAYS * quarters[1] + 1)
    half = steps[: 2 * _RAYS + 1]
    angle = 0.5 * np.pi / _RAYS * half
    v, m = np.cos(angle), law.radius * np.sin(angle)
    v[half % (2 * _RAYS) == _RAYS] = m[half % (2 * _RAYS) == 0] = 0.0
    found = theory.surface_along(law, np.column_stack([v * direction[0], v * direction[1], sense * m]))
    found = np.concatenate([found, -found[1 : 1 + len(steps) - len(half)]])
    return found[:, :2] @ direction, sense * found[:, 2]


@accepts_paths
def load_path(
    histories, labels: Sequence[str] | None = None, ax: Axes | None = None, joint: str | int | None = None
) -> Figure:
    """M_T over V of one joint throughout the record, on its yield domain; several histories in one figure.

    The domain, in all quarters that a path visits, is that of the joint's formulation, with the exact one of the convex
    formulation for comparison, and with the cohesion of the joint; for a breakable bond also the residual one. If a
    normal force varies, everything is drawn relative to the strength at the current N, torsion relative to that of the
    joint's formulation. ``joint``: ``"a/b"`` by the names of its blocks; by default the joint that failed.
    """
    above = runs.heading(histories, labels)
    histories, labels = labelled(histories, labels)
    paths = [joint_path(history, joint) for history in histories]
    quarters = _all_of([path.quarters for path in paths])
    paths = [
        path if path.quarters == quarters else joint_path(history, joint, quarters)
        for history, path in zip(histories, paths, strict=True)
    ]
    relative = any(path.strength is not None for path in paths)
    if relative and not all(path.strength is not None for path in paths):
        if any(path.cut for path in paths):
            raise ScenarioError("in some of the runs the joint is cut at an edge, in others it is not; draw each")
        raise ScenarioError("N of the joint changes in some of the runs and not in others; draw each by itself")
    shear_in, shear = ("-", 1.0) if relative else runs.unit_of_loads([path.V for path in paths], "N")
    torsion_in, torsion = ("-", 1.0) if relative else runs.unit_of_loads([path.M_T for path in paths], "N m")
    told = [set(own) for own in zip(*(path.told for path in paths), strict=True)]
    joint_told, pressed, way, turned = (own.pop() if len(own) == 1 else "" for own in told)
    shared = (joint_told, pressed, way, turned)
    apart = [", ".join(own for own, same in zip(path.told, shared, strict=True) if not same) for path in paths]
    labels = [f"{label}, {own}" if own else label for label, own in zip(labels, apart, strict=True)]
    with style.settings():
        figure, axes = style.canvas(ax)
        formulations = [
            history.joints[path.number]["formulation"] for history, path in zip(histories, paths, strict=True)
        ]
        looks = runs.looks(formulations)
        if len(paths) == 1:
            looks = [looks[0]._replace(colour=style.BLACK, line="-")]
        mixed = relative and len({path.formulation for path in paths}) > 1  # each over its own strength in torsion
        surfaces = [path.sections[:1] if mixed else path.sections for path in paths]
        told_apart = len(set(formulations)) == len(paths)  # else the domains step back behind the colours of the runs
        owners = apart if len(set(apart)) == len(apart) else labels
        for section, owner, of_whom in _named_once(surfaces, owners):
            colour, line, _ = style.FORMULATION[section.formulation.split(",")[0]]
            colour = looks[owner].colour if of_whom else colour if told_apart else style.GREY
            width = 0.7 if section.bond == BROKEN else 1.0
            name = f"{section.name}: {of_whom}" if of_whom else section.name
            axes.plot(shear * section.V, torsion * section.M_T, color=colour, ls=line, lw=width, label=name)
        starred = False
        for path, label, history, look in zip(paths, labels, histories, looks, strict=True):
            x, y = path.drawn
            axes.plot(shear * x, torsion * y, color=look.colour, ls=look.line, lw=1.6, marker=look.marker, ms=3.2,
                      markevery=max(1, len(path.V) // 12), label=label, zorder=3)  # fmt: skip
            point = summary.yield_point(history.results)
            own = path.number == subject.chosen_joint(history) and not path.cut  # else M_T is about O of the start
            if {"V_1", "V_2", "M_T"} <= set(point) and own:
                x = float(np.array([point["V_1"], point["V_2"]]) @ path.direction)
                y = path.sense * point["M_T"]
                if relative:
                    strength = subject.shear_strength(history.joints[path.number], point.get("N", np.nan))
                    x, y = x / strength, y / (strength * path.radius)
                axes.plot(shear * x, torsion * y, marker="*", ms=11, color=look.colour, mec="white", mew=0.7, ls="none",
                          zorder=5, clip_on=False, label="_nolegend_" if starred else "yield point")  # fmt: skip
                starred = True
        cohesive = any(path.cohesive for path in paths)
        over = (r"over $c\,A + \mu N$ [-]" if cohesive else r"over $\mu N$ [-]") if relative else f"[{shear_in}]"
        axes.set_xlabel(f"shear force {way or 'V'} {over}")
        over = f"over {torsion_strength(paths)} [-]" if relative else f"[{torsion_in}]"
        axes.set_ylabel(f"{turned or 'torsion'} {over}")
        drawn = [*(path.drawn for path in paths), *(section[1:3] for own in surfaces for section in own)]
        least_V, least_M_T = np.min([np.nanmin(own, axis=1, initial=0.0) for own in drawn], axis=0)
        axes.set_xlim(left=1.05 * shear * least_V)
        axes.set_ylim(bottom=1.05 * torsion * least_M_T)
        of_joint = ", ".join(filter(None, (joint_told, pressed)))
        cut = CUT_AT_EDGE if any(path.cut for path in paths) else ""
        head_and_legend(figure, axes, ax is None, "; ".join(filter(None, (above, of_joint, cut))))
    return figure


def _named_once(surfaces: Sequence[Sequence[Section]], owners: Sequence[str]) -> list[tuple[Section, int, str]]:
    """The different sections of several paths, each with the number of the first path that has it and, where others
    have the same name, with all of its ``owners``."""
    found: dict[tuple, tuple[Section, list[int]]] = {}
    for i, sections in enumerate(surfaces):
        for section in sections:
            key = (section.name, *(f"{value:.6g}" for value in (*section.V[::30], *section.M_T[::30])))
            found.setdefault(key, (section, []))[1].append(i)
    count = Counter(section.name for section, _ in found.values())
    return [
        (section, own[0], " and ".join(dict.fromkeys(owners[i] for i in own)) if count[section.name] > 1 else "")
        for section, own in found.values()
    ]


def torsion_strength(paths: Sequence[JointPath]) -> str:
    """Name of the strength by which the torsion of paths is divided, that at the current N."""
    names = {path.formulation for path in paths}
    return f"the {names.pop()} strength at its N" if len(names) == 1 else "the strength of each formulation at its N"


def direction_in_words(direction: Sequence[float] | np.ndarray) -> str:
    """A direction in the joint in words: along an axis or against it, or its angle from the first one."""
    for i in (0, 1):
        if abs(direction[1 - i]) <= ALONG:
            return f"along $t_{i + 1}$" if direction[i] > 0.0 else f"along $-t_{i + 1}$"
    return f"at {np.degrees(np.arctan2(direction[1], direction[0])):.3g}° from $t_1$"
