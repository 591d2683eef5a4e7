"""Torsion-shear yield domains with simulated and measured points on them (paper Fig. 4 and Fig. 5)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dembrick import theory
from dembrick.errors import HistoryError, ScenarioError
from dembrick.theory.paper_tables import SETS
from dembrick.views import summary
from dembrick.views.motion.frames import default_row, frame_number
from dembrick.views.plot import runs, style
from dembrick.views.plot.rectangular_joint import (
    SAME,
    RectangularJoint,
    domain_curve,
    domain_curves,
    require_one_curve,
    same_shape,
    shear_of,
    shown,
    torsion_strength,
    under,
    under_points,
)
from dembrick.views.plot.subject import (
    carried_by,
    chosen_joint,
    cut_at_edge,
    is_brittle,
    pressure_centre,
    pushes_several,
    strengths,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dembrick.history.reader import History

CURVES = ("convex", "concave", "corrected")
_LAB_JOINT = (0.3, 0.2, 467.0)  # a, b (m), N of the laboratory's sets
_OF_DOMAIN = {
    "a": "the edge a of its joint (m)", "b": "the edge b of its joint (m)", "friction": "its friction",
    "N": "its normal force N (N)", "cohesion": "its cohesion (Pa)",
}  # fmt: skip
_OVER = 3.3  # z-order of measured points: above simulated ones with larger markers, below those with smaller ones
_APPROXIMATE = (":", "--", "-.", (0, (10, 3)))


def domain_points(histories) -> list[dict]:
    """One row per history with a yield point: ``V``, its bounds, ``V_1``, ``V_2``, ``M_T``, ``N``, the formulation,
    edges ``a`` and ``b`` (m) of the joint, its ``friction`` and ``cohesion`` (Pa) before slip, whether slip reduces
    them (``brittle``), its ``pressure``, the ``load_height`` (m) of the actuators above it, and the ``eccentricity``
    (m) of N without the part due to this height.

    Histories that reached no yield point give no row; HistoryError if the joint is not a rectangle.
    """
    rows = []
    for history in histories:
        point = history.results.get("yield_point")
        if not point or any(point.get(key) is None for key in ("V", "V_1", "V_2", "M_T", "N")):
            continue
        if pushes_several(history):
            raise ScenarioError(
                f"{history.path}: its load acts on several blocks, so its yield point does not belong to the domain "
                "of one joint; use --kind path to draw the forces of a joint"
            )
        number = _yielding_joint(history)
        joint = history.joints[number]
        if history.n_frames and cut_at_edge(history, number, frame_number(history)):
            raise HistoryError(
                f"{history.path}: its joint was cut at an edge as its block slid, so the domain of the whole joint is "
                "not its own; --kind path draws its forces"
            )
        a, b = np.ptp(joint["polygon"], axis=0)
        if abs(a * b - joint["area"]) > 1e-6 * joint["area"]:
            raise HistoryError(f"{history.path}: its joint is not a rectangle, so no domain can be drawn for it")
        heights = [(actuator["point"] - joint["origin"]) @ joint["axes"][2] for actuator in history.actuators]
        row = {key: point.get(key) for key in ("V", "V_lower", "V_upper", "bracket", "V_1", "V_2", "M_T", "N")}
        row |= {"a": float(a), "b": float(b), "friction": joint["friction"], "title": history.title}
        row |= {"cohesion": strengths(joint)[1], "brittle": is_brittle(joint)}
        row |= {"formulation": joint["formulation"]}
        row |= {"load_height": float(np.mean(heights)) if heights else 0.0, "history": history.path}
        row |= {"pressure": joint["pressure"], "eccentricity": _eccentricity(history, number, row["load_height"])}
        rows.append(row)
    return rows


def _eccentricity(history: History, number: int, height: float) -> tuple[float, float]:
    """Point (m from O) where N acted in the row of the yield point, without the moment of the shear force at ``height``
    (m) above O."""
    carried = carried_by(history, number, default_row(history))
    carried |= {"M_1": carried["M_1"] + height * carried["V_2"], "M_2": carried["M_2"] - height * carried["V_1"]}
    x, y = pressure_centre(carried) if carried["N"] > 0.0 else (0.0, 0.0)
    return float(x), float(y)


def _yielding_joint(history: History) -> int:
    """Number of the joint of the yield point; HistoryError if the block that the actuators push has no joint."""
    loaded = {actuator["block"] for actuator in history.actuators}
    number = chosen_joint(history)
    joint = history.joints[number]
    if not loaded or loaded & {joint["block_a"], joint["block_b"]}:
        return number
    raise HistoryError(f"{history.path}: the pushed block has no joint, so no domain can be drawn for it")


def interaction(
    points=(),
    joint: Sequence[float] | None = None,
    formulations: Sequence[str] = CURVES,
    approximations: Sequence[str] = (),
    ax: Axes | None = None,
) -> Figure:
    """Non-dimensional curves M_T / M_T0 over V / V_0, like the paper's Fig. 4.

    ``points``: histories, or rows of :func:`domain_points`; they set the shear direction and the eccentricity of N of
    the curves, by default along t2 and zero. ``joint``: (a, b, friction, N), by default that of the first point. Each
    point is normalised by its own V_0 and by the M_T0 of its formulation. ScenarioError if the joints of the points
    differ in the ratio of their edges, or if their loads have different curves.
    """
    rows = _rows(points)
    if joint is None:
        _require_alike(rows, {"a/b": "the ratio of its edges a/b"})
    joint = _loaded(rows, joint)
    require_one_curve(rows, joint, formulations)
    with style.settings():
        figure, axes = style.canvas(ax)
        for names in same_shape(shown(formulations, rows, joint), joint):
            v, m = domain_curve(names[0], joint).normalised
            colour, line, _ = style.FORMULATION[names[0]]
            axes.plot(v, m, color=colour, ls=line, label=" = ".join(names))
        for i, name in enumerate(approximations):
            domain = theory.approximate_domain(name, *joint[:5], direction=joint.direction)
            axes.plot(
                *domain.curve(), color=style.GREY, lw=0.9, ls=_APPROXIMATE[i % len(_APPROXIMATE)], label=domain.label
            )
        for row in rows:
            own = under(_joint([row], None, fallback=joint), row, joint)
            V_0 = own.strength
            M_T0 = torsion_strength(row["formulation"], own)
            _mark(axes, row, shear_of(row) / V_0, abs(row["M_T"]) / M_T0)
        axes.set_xlabel(r"$V / V_0$ [-]")
        axes.set_ylabel(r"$M_T / M_{T0}$ [-]")
        way = {"along $t_1$": "along a", "along $t_2$": "along b"}.get(joint.sheared, joint.sheared)
        axes.set_title(f"a/b = {joint.a / joint.b:.3g}, shear {way}{joint.pressed_at and f', N{joint.pressed_at}'}")
        axes.set(xlim=(0.0, None), ylim=(0.0, None))
        axes.set_aspect("equal")
        style.legend(figure, axes, ax is None)
    return figure


def domains(
    points=(),
    joint: Sequence[float] | None = None,
    formulations: Sequence[str] | Mapping[str, tuple[np.ndarray, np.ndarray]] = CURVES,
    experiments: Mapping[str, tuple[float, float]] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Dimensional domains M_T (N m) over V (N) with simulated and measured points, like the paper's Fig. 5.

    ``points`` and ``joint`` as for :func:`interaction`; without ``joint`` all points must have equal joints and N.
    ScenarioError otherwise, and if their loads have different curves. ``formulations``: those whose domains are drawn,
    or the curves themselves by name, (V, M_T) in N and N m, for the shear direction and the eccentricity of a ``joint``
    that is a :class:`RectangularJoint`. ``experiments``: name -> (V, M_T); by default the measured sets of the paper if
    the joint is that of the laboratory; {} for none.
    """
    rows = _rows(points)
    if joint is None:
        _require_alike(rows, _OF_DOMAIN)
    joint = _loaded(rows, joint)
    if not isinstance(formulations, Mapping):
        require_one_curve(rows, joint, formulations)
    if experiments is None:
        mine = (joint.a, joint.b, joint.normal_force)
        is_lab = (
            joint.centred
            and joint.sheared == "along $t_2$"
            and all(abs(x - y) <= SAME * y for x, y in zip(mine, _LAB_JOINT, strict=True))
        )
        experiments = lab_points() if is_lab else {}
    with style.settings():
        figure, axes = style.canvas(ax)
        curves = formulations
        if not isinstance(curves, Mapping):
            curves = domain_curves(shown(formulations, rows, joint), joint)
        shear_in, shear = runs.unit_of_loads([V for V, _ in curves.values()], "N")
        torsion_in, torsion = runs.unit_of_loads([M_T for _, M_T in curves.values()], "N m")
        for names in _coinciding(curves):
            (V, M_T), (colour, line, _) = curves[names[0]], style.FORMULATION[names[0].split(",")[0]]
            axes.plot(shear * V, torsion * M_T, color=colour, ls=line, label=" = ".join(names))
        for row in rows:
            _mark(axes, row, shear * shear_of(row), torsion * abs(row["M_T"]))
        if experiments:
            V, M_T = np.array(list(experiments.values())).T * [[shear], [torsion]]
            axes.plot(V, M_T, label="experiment", zorder=_OVER, clip_on=False, **style.EXPERIMENT)
            named: dict[float, list[tuple[float, str]]] = {}
            for name, x, y in zip(experiments, V.tolist(), M_T.tolist(), strict=True):
                named.setdefault(x, []).append((y, name))
            for x, column in named.items():  # one label per column of points, at its top
                y, name = max(column)[0], ", ".join(name for _, name in sorted(column))
                axes.annotate(name, (x, y), (7, 2), textcoords="offset points", ha="left", va="bottom")
        axes.set_xlabel(f"V {joint.sheared} [{shear_in}]")
        axes.set_ylabel(rf"$M_T$ [{torsion_in}]")
        a, b, friction, normal, cohesion = joint[:5]
        bond = f", cohesion {1e-3 * cohesion:.3g} kPa" if cohesion else ""
        bond += "\nbefore any bond breaks" if any(row.get("brittle") for row in rows) else ""
        pressed = f"N = {summary.load_text(normal)}{joint.pressed_at}"
        axes.set_title(f"joint {a:.3g} x {b:.3g} m, {pressed}, friction {friction:.3g}{bond}")
        axes.set(xlim=(0.0, None), ylim=(0.0, None))
        style.legend(figure, axes, ax is None)
    return figure


def _coinciding(curves: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> list[list[str]]:
    """The names of curves, in groups of coinciding curves."""
    groups: list[list[str]] = []
    for name, (V, M_T) in curves.items():
        for group in groups:
            first = curves[group[0]]
            if len(first[0]) == len(V) and all(
                np.allclose(one, other, rtol=0.0, atol=1e-6 * np.abs(other).max())
                for one, other in zip((V, M_T), first, strict=True)
            ):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def lab_points() -> dict[str, tuple[float, float]]:
    """The measured sets in the plane of Fig. 5: (V on the joint, M_T); a couple gives no shear on the joint."""
    a = _LAB_JOINT[0]
    return {
        name: (0.0 if own.loading == "couple" else own.experiment, own.arm_over_a * a * own.experiment)
        for name, own in SETS.items()
    }


def _rows(points) -> list[dict]:
    points = list(points) if isinstance(points, Iterable) and not isinstance(points, Mapping) else [points]
    rows: list[dict] = []
    for point in points:
        rows += [dict(point)] if isinstance(point, Mapping) else domain_points([point])
    needed = ("formulation", "V_1", "V_2", "M_T", "N")
    for row in rows:
        missing = [key for key in needed if row.get(key) is None]
        if missing:
            raise ScenarioError(f"a point of a yield domain needs {', '.join(needed)}; {', '.join(missing)} is missing")
    return rows


def _require_alike(rows: Sequence[Mapping], keys: Mapping[str, str]) -> None:
    """ScenarioError if the joints of points differ from the first in one of the ``keys``, given with descriptions."""

    def value(row: Mapping, key: str) -> float | None:
        if key == "a/b":
            return row["a"] / row["b"] if row.get("a") and row.get("b") else None
        return row.get(key)

    for row in rows[1:]:
        for key, what in keys.items():
            first, other = value(rows[0], key), value(row, key)
            if first is None or other is None or abs(first - other) <= SAME * max(abs(first), abs(other)):
                continue
            named = [own.get("history") or "a point" for own in (rows[0], row)]
            raise ScenarioError(
                f"{named[1]} belongs to another yield domain than {named[0]}: {what} is {other:.6g} there and "
                f"{first:.6g} here; draw each by itself"
            )


def _joint(rows: Sequence[Mapping], given, fallback: RectangularJoint | None = None) -> RectangularJoint:
    """The joint ``given``, else that of the first row, else ``fallback`` under the row's N."""
    if given is not None:
        return RectangularJoint(*given)
    keys = ("a", "b", "friction", "N")
    if rows and all(rows[0].get(key) is not None for key in keys):
        a, b, friction, force = (float(rows[0][key]) for key in keys)
        return RectangularJoint(a, b, friction, force, float(rows[0].get("cohesion") or 0.0))
    if fallback is not None:
        return fallback._replace(normal_force=float(rows[0]["N"])) if rows else fallback
    raise ScenarioError("a yield domain needs a joint (a, b, friction, N) or a history that reached its yield point")


def _loaded(rows: Sequence[Mapping], given) -> RectangularJoint:
    """The joint under the load of its points, unless it is ``given`` with its load."""
    joint = _joint(rows, given)
    return joint if isinstance(given, RectangularJoint) or not rows else under_points(joint, rows)


def _mark(axes, row: Mapping, x: float, y: float) -> None:
    """Draw a simulated point with its bracket: hollow if the load acts in the joint plane, filled if above it."""
    colour, _, marker = style.FORMULATION[row["formulation"]]
    height = row.get("load_height") or 0.0
    label = f"DEM {row['formulation']}" + (
        f", load {1e3 * height:.3g} mm above the joint" if abs(height) > 1e-9 else ""
    )
    V = row.get("V")
    bars = {}
    if V and row.get("V_lower") is not None and row.get("V_upper") is not None:
        # the load grows along its ray, so both components share the relative error
        below, above = (max(0.0, 1 - row["V_lower"] / V), max(0.0, row["V_upper"] / V - 1))
        bars = {"xerr": [[x * below], [x * above]], "yerr": [[y * below], [y * above]]}
    if label in axes.get_legend_handles_labels()[1]:
        label = "_nolegend_"
    fill = colour if abs(height) > 1e-9 else "white"
    size = style.MARKER_SIZE[row["formulation"]]
    axes.errorbar(
        x, y, **bars, fmt=marker, color=colour, mfc=fill, mew=1.1, ms=size, zorder=4 - 0.1 * size,
        elinewidth=1.0, capsize=2, label=label, clip_on=False,
    )  # fmt: skip
