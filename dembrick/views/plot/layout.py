"""Loading layouts in plan: the pushed block, its actuators with their arms, the torsion centre (paper Table 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.theory.polygons import convex_hull
from dembrick.views.given import accepts_paths
from dembrick.views.plot import style
from dembrick.views.plot.subject import pushes_several

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL = (2.3, 2.9)  # inches
_SIDEWAYS = 0.3  # of a force, to the left: what stands at the tip of its arrow is beyond it


class Plan(NamedTuple):
    """A panel in plan (x, y), m: outline (k, 2) of the block, the joint's centroid, actuators, torsion centre."""

    title: str
    outline: np.ndarray
    centre: np.ndarray
    points: np.ndarray
    directions: np.ndarray
    weights: np.ndarray
    torsion_centre: np.ndarray | None


@accepts_paths
def layout(sources, ax: Axes | None = None, torsion_centre: bool = True) -> Figure:
    """Plan views of scenarios or histories, side by side. ``ax``: one axes, or one for each source.

    ``torsion_centre``: mark the point about which the joint of a history turned, if it did.
    """
    sources = list(sources) if isinstance(sources, list | tuple) else [sources]
    if not sources:
        raise ScenarioError("a figure needs at least one history or scenario")
    plans = [_plan(source) for source in sources]
    with style.settings():
        figure, axes = style.panels(ax, len(plans), "layouts", (max(3.2, _PANEL[0] * len(plans)), _PANEL[1]))
        if ax is None:
            figure.set_layout_engine(
                "constrained", h_pad=0.12
            )  # inches; titles of three lines end at the edge otherwise
        for own, plan in zip(axes, plans, strict=True):
            _draw(own, plan, torsion_centre)
        if ax is None and torsion_centre and any(plan.torsion_centre is not None for plan in plans):
            figure.supxlabel("O: centroid of the joint, C: torsion centre", fontsize=8)
    return figure


def _plan(source) -> Plan:
    """Plan of a history, or of a scenario, which is assembled first."""
    if hasattr(source, "block_vertices"):
        actuators = source.actuators
        if not actuators:
            raise ScenarioError(f"{source.path}: it has no actuator, so there is no loading layout to draw")
        if pushes_several(source):
            raise ScenarioError(
                f"{source.path}: its load acts on several blocks, but a loading layout is the plan of one; use "
                "dembrick render to draw them all"
            )
        block = actuators[0]["block"]
        vertices = source.block_vertices(block) @ rotation_matrix(source.orientation0[block]).T
        point, direction = (np.array([actuator[key] for actuator in actuators]) for key in ("point", "direction"))
        weight = np.array([actuator["weight"] for actuator in actuators])
        joint = next((j for j in source.joints if block in (j["block_a"], j["block_b"])), None)
        origin = source.position0[block] if joint is None else joint["origin"]
        turning = (source.results.get("yield_point") or {}).get("torsion_centre")
        centre = None
        if turning is not None and joint is not None:
            centre = (origin + np.asarray(turning, float) @ joint["axes"][:2])[:2]
        where, title = source.position0[block], source.title
    else:
        from dembrick.assembly.build import assemble

        built = assemble(source)
        if not built.actuators.names:
            raise ScenarioError("a loading layout needs an actuator, and this scenario has none")
        if len(set(built.actuators.at.block.tolist())) > 1:
            raise ScenarioError("the load acts on several blocks, but a loading layout is the plan of one")
        block = int(built.actuators.at.block[0])
        vertices, where = built.shapes[block].vertices @ built.rotation[block].T, built.position[block]
        point = built.actuators.at.start(built.position)
        direction, weight = built.actuators.direction, built.actuators.weight
        joint = next((j for j in built.joints if block in (j.block_a, j.block_b)), None)
        origin, centre, title = where if joint is None else joint.origin, None, source.title
    return Plan(
        title, convex_hull((vertices + where)[:, :2]), origin[:2], point[:, :2], direction[:, :2], weight, centre
    )


def _draw(axes, plan: Plan, torsion_centre: bool) -> None:
    from matplotlib.patches import Polygon

    lower, upper = plan.outline.min(axis=0), plan.outline.max(axis=0)
    a, b = upper - lower
    size = float(max(a, b))
    axes.add_patch(Polygon(plan.outline, closed=True, fc="#EFEFEF", ec="black", lw=1.2))
    axes.plot(*plan.centre, "+", color="black", ms=7, label="centroid O")
    axes.annotate("O", plan.centre, (3, 3), textcoords="offset points")
    forces = plan.directions * plan.weights[:, None]
    ends = [lower, upper]  # of the outline and the arrows with what stands at their tips
    for i, (point, force) in enumerate(zip(plan.points, forces, strict=True)):
        length = float(np.hypot(*force))
        if length < 1e-9:
            continue  # an actuator along z is not visible in plan
        way = force / length
        tip = point + 0.42 * size * way
        _arrow(axes, point, tip, style.VERMILLION, "-|>", 1.8)
        axes.plot(*point, "o", color=style.VERMILLION, ms=3.5)
        factor = "" if abs(abs(plan.weights[i]) - 1.0) < 1e-9 else f"{abs(plan.weights[i]):.3g} "
        side = -1 if way[0] < -_SIDEWAYS else 1
        axes.annotate(f"{factor}V", tip, (5 * side, 0), textcoords="offset points", ha="left" if side > 0 else "right",
                      va="center", color=style.VERMILLION)  # fmt: skip
        ends += [tip, tip + size * np.array([side * (0.08 + 0.09 * len(f"{factor}V")), 0.08 * way[1]])]
    ends += _arms(axes, plan, forces, size, a, np.array(ends))
    lowest, highest = np.min(ends, axis=0), np.max(ends, axis=0)
    below = min(-0.52 * size, lowest[1] - lower[1] - 0.1 * size)
    _dimension(axes, lower, [upper[0], lower[1]], [0.0, below], f"a = {a:.3g} m", "top")
    left = min(-0.12 * size, lowest[0] - lower[0] - 0.06 * size)
    _dimension(axes, [lower[0], lower[1]], [lower[0], upper[1]], [left, 0.0], f"b = {b:.3g} m", "side")
    if torsion_centre and plan.torsion_centre is not None:
        axes.plot(*plan.torsion_centre, "x", color=style.BLUE, ms=7, mew=1.8)
        axes.annotate("C", plan.torsion_centre, (0, 5), textcoords="offset points", color=style.BLUE, ha="center")
    heading, _, rest = style.plain(plan.title).partition(":")
    axes.set_title("\n".join([heading, style.wrapped(rest.strip(), 30)]).rstrip(), fontsize=8)
    axes.set_aspect("equal")
    axes.set_xlim(lower[0] + left - 0.24 * size, max(upper[0] + 0.2 * size, highest[0]))
    axes.set_ylim(lower[1] + below - 0.18 * size, max(upper[1] + 0.4 * size, highest[1]))
    axes.set(xticks=[], yticks=[])  # "axis off" would leave the title out of the figure's layout
    axes.spines[:].set_visible(False)


def _arms(axes, plan: Plan, forces: np.ndarray, size: float, a: float, ends: np.ndarray) -> list[np.ndarray]:
    """Draw the arm of a couple of actuators, or the eccentricity of a single one, measured normal to the force, clear
    of the ``ends`` (k, 2) of what is drawn. Returns the end of this drawing if that is beyond them."""
    sizes = np.hypot(*forces.T)
    couple = len(forces) == 2 and np.allclose(forces.sum(axis=0), 0.0, atol=1e-9) and sizes[0] > 1e-9
    if not (couple or (len(forces) == 1 and sizes[0] > 1e-9)):
        return []
    along = forces[0] / sizes[0]
    feet = plan.points + ((plan.centre - plan.points) @ along)[:, None] * along  # of O on the lines of action
    start, end = (feet[1], feet[0]) if couple else (plan.centre, feet[0])
    distance = float(np.hypot(*(end - start)))
    if distance < 1e-9:
        return []
    if end[0] < start[0]:
        start, end = end, start
    down = along if along[1] < 0 else -along
    name = "arm" if couple else "e"
    side = "side" if abs(along[0]) > abs(along[1]) else "top"
    reach = 0.5 * float(np.ptp(plan.outline @ along)) + (0.2 if couple else 0.12) * size
    beyond = float(((ends - plan.centre) @ down).max()) + 0.1 * size
    in_the_way = beyond > reach or side == "side"
    reach = max(reach, beyond)
    text = f"{name} = {distance:.4g} m"
    if abs(abs(along[1]) - 1.0) < 1e-9:  # along y, the arm runs along a
        text = f"{name} = {distance:.4g} m\n= {distance / a:.3g} a"
    _dimension(axes, start, end, reach * down, text, side)
    return [plan.centre + (reach + 0.3 * size) * down] if in_the_way else []


def _dimension(axes, start, end, offset, text: str, side: str) -> None:
    """Draw a dimension line between two points, moved by ``offset``, with its extension lines."""
    start, end, offset = (np.asarray(value, float) for value in (start, end, offset))
    for point in (start, end):
        axes.plot(*np.array([point, point + 1.08 * offset]).T, color=style.GREY, lw=0.5)
    _arrow(axes, start + offset, end + offset, style.GREY, "<|-|>", 0.8)
    middle = 0.5 * (start + end) + offset
    if side == "side":
        axes.annotate(text, middle, (-3, 0), textcoords="offset points", rotation=90, ha="right", va="center", size=8)
    else:
        axes.annotate(text, middle, (0, -3), textcoords="offset points", ha="center", va="top", size=8,
                      bbox={"fc": "white", "ec": "none", "pad": 0.6})  # fmt: skip


def _arrow(axes, start, end, colour: str, kind: str, width: float) -> None:
    scale = 11 if width > 1 else 6
    how = {"arrowstyle": kind, "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0, "mutation_scale": scale}
    axes.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=how)
