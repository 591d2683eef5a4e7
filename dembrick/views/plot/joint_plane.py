"""The plane of one joint, stage by stage: the motion of b over a, its torsion centre, and the resisting friction.

This figure shows how formulations differ. The torsion centre starts at the point given by the elastic stiffness and
moves, as the load grows, to the point given by the normal of the limit surface, which is a different one for contact
points at the corners than for the whole area.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick import theory
from dembrick.errors import HistoryError, ScenarioError
from dembrick.geometry.polygons import distance_outside, pieces
from dembrick.views import summary
from dembrick.views.given import accepts_paths
from dembrick.views.motion.joint_frames import CHANNELS, JointFrames
from dembrick.views.motion.joints import HINGE, JointMotion
from dembrick.views.plot import style, subject
from dembrick.views.plot.runs import heading, labelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dembrick.history.reader import History

SLIDES_FROM = 0.995  # utilisation from which the friction is drawn at its limit
_MOST_POINTS = 40  # greatest number of contact points drawn; if there are more, and for convex joints, a grid is used
_WEAKER = 0.98  # of its greatest force: a joint with less at the end has lost strength
_GRID = 6  # grid points over the longer side of a joint
_ARROW = {True: 0.22, False: 0.16}  # longest arrow over the joint's size: with few points, with many
_SHEAR = 100.0  # joint sizes from O: a torsion centre beyond means pure shear and is not drawn
_NEAR = 1.6  # joint sizes from O: a torsion centre beyond is marked at the edge of the picture


class Stage(NamedTuple):
    """One moment of a joint, at ``points`` (k, 2) m.

    ``load``: that of the row; ``utilisation``: of friction; ``bending``: utilisation in bending, 1 at a hinge;
    ``movement`` (k, 2) m: displacement of b over a since the previous stage, elastic part included; ``centre`` (2,) m:
    its torsion centre, NaN in pure shear. ``friction`` (k, 2): on b, as recorded, else computed if the joint slides;
    None if not known. ``limit``: greatest possible friction at a point. Both are in N if all contact points are shown,
    in Pa at points that represent the area.
    """

    frame: int
    time: float
    load: float
    utilisation: float
    bending: float
    points: np.ndarray
    movement: np.ndarray
    centre: np.ndarray
    friction: np.ndarray | None
    limit: float


@accepts_paths
def joint_plane(
    history: History, joint: str | int | None = None, stages: int = 4, frames: Sequence[int] | None = None
) -> list[Stage]:
    """The stages of one joint, at ``frames``, or by default ``stages`` of them, spread over the growth of its force.

    Raises HistoryError if no motion was recorded, ScenarioError for frames that do not exist.
    """
    number = subject.chosen_joint(history, joint)
    subject.carried_by(history, number)
    if history.n_frames < 2:
        raise HistoryError(f"{history.path}: the motion of a joint needs two frames; record the channel frames")
    if frames is None:
        if stages < 1:
            raise ScenarioError(f"stages = {stages} is out of range: at least one is drawn")
        frames = _growing(history, number, stages)
    else:
        frames = [int(k) % history.n_frames for k in frames if -history.n_frames <= k < history.n_frames]
        if not frames or sorted(set(frames)) != frames or frames[0] == 0:
            raise ScenarioError(f"frames of a joint's stages must ascend and lie within 1 and {history.n_frames - 1}")
    own, motion = history.joints[number], JointMotion(history, number)
    shown = _shown(own, motion)
    points = motion.grid(0, _GRID) if shown is None else own["shear_arms"][shown]
    found, since = [], 0
    for frame in frames:
        both = motion.at([since, frame]).relative
        movement = both[1].slip(0, points) - both[0].slip(0, points)
        now = motion.at([frame])
        used, bent = float(now.friction_utilisation[0, 0]), float(now.bending_utilisation[0, 0])
        friction, limit = _friction(own, now, points, shown, SLIDES_FROM <= used < np.inf)
        row = int(motion.rows(frame))
        load = float(history.series("load", row, row + 1)[0])
        centre = motion.torsion_centre(frame, since)[0]
        centre = np.where(np.hypot(*centre) <= _SHEAR * motion.size[0], centre, np.nan)
        found.append(
            Stage(frame, float(history.frame_time[frame]), load, used, bent, points, movement, centre, friction, limit)
        )
        since = frame
    return found


def _load_of(stage: Stage, diagram: subject.Diagram) -> str:
    if diagram.load is None:
        return f"at {stage.time:.4g} s"
    if diagram.tilts:
        return rf"$\theta$ = {diagram.loads(stage.load):.4g} deg"
    return f"load factor {stage.load:.4g}" if diagram.unit == "-" else f"V = {summary.load_text(stage.load)}"


def _shown(joint: dict, motion: JointMotion) -> np.ndarray | None:
    """Indices of the contact points to draw: all, or those nearest to a grid if there are many; None without any."""
    arms = joint["shear_arms"]
    if not len(arms):
        return None
    if len(arms) <= _MOST_POINTS:
        return np.arange(len(arms))
    nearest = [int(np.argmin(((arms - place) ** 2).sum(axis=1))) for place in motion.grid(0, _GRID)]
    return np.unique(nearest)


def _friction(
    joint: dict, now: JointFrames, points: np.ndarray, shown: np.ndarray | None, slides: bool
) -> tuple[np.ndarray | None, float]:
    """Friction on b at points, and its greatest possible value. It is the recorded one, or if the joint slides the one
    that gives its resultant, opposite to the slip twist along the normal of the limit surface there."""
    carried = now.resultants[0, 0]
    law: theory.Law | None = None
    if shown is None:
        bent = dict(zip(CHANNELS, carried, strict=True))
        law = subject.limit_surface(joint, bent, broken=now.held is not None and now.held[0, 0] < 0.5)
        if law is None:
            return None, 0.0
        pressed = points - subject.pressure_centre(bent)
        limit = np.maximum(law.level + pressed @ law.slope, 0.0) * _inside(points, law.parts)
    else:
        normal, forces = now.normal_forces[0], now.point_forces
        share = 1.0 if len(shown) == len(normal) else joint["areas"][shown]
        strength = joint["friction"] * normal if now.point_strength is None else now.point_strength[0]
        limit = strength[shown] / share
        if forces is not None:
            along = forces[0, shown] @ now.seen_axes[0, 0, :2].T
            return along / np.reshape(share, (-1, 1)), float(limit.max())
    if not slides:
        return None, float(limit.max())
    if law is None:
        law = theory.points(joint["shear_arms"], strength, 1.0)
    v_1, v_2, w = theory.limit_load(law, carried[1:4]).twist
    slip = np.stack([v_1 - w * points[:, 1], v_2 + w * points[:, 0]], axis=1)
    speed = np.linalg.norm(slip, axis=1, keepdims=True)
    way = np.divide(slip, speed, out=np.zeros_like(slip), where=speed > 1e-9 * speed.max())
    return -limit[:, None] * way, float(limit.max())


def _inside(points: np.ndarray, parts) -> np.ndarray:
    """Whether each of the points (k, 2) lies in a union of convex polygons."""
    found = np.zeros(len(points), bool)
    for part in parts:
        found |= distance_outside(points, part) <= 0.0
    return found


def _growing(history: History, number: int, stages: int) -> list[int]:
    """Frames at which the joint's force first reaches half its final value, then approaches it, and the last frame. For
    a joint that has lost force by then, because a bond broke, frames up to its peak, and the last."""
    motion = JointMotion(history, number)
    everyone = np.arange(1, history.n_frames)
    force = motion.at(everyone).resultants[:, 0, 1:4] * np.array([1.0, 1.0, 1.0 / motion.size[0]])
    size = np.linalg.norm(force, axis=1)
    top = int(np.argmax(size))
    if stages == 1 or size[-1] >= _WEAKER * size[top]:
        top = len(everyone) - 1
    ends = {int(everyone[top]), int(everyone[-1])}
    way, on_the_way = force[: top + 1] @ force[top], everyone[: top + 1]
    reached = np.maximum.accumulate(way / way[-1] if way[-1] > 0.0 else on_the_way / on_the_way[-1])
    shares = 1.0 - 10.0 ** -np.linspace(math.log10(2.0), 3.0, stages - len(ends))
    chosen = np.searchsorted(reached, shares)
    return sorted({int(on_the_way[min(k, top)]) for k in chosen} | ends)


@accepts_paths
def joint_stages(
    histories,
    labels: Sequence[str] | None = None,
    joint: str | int | None = None,
    stages: int = 4,
    frames: Sequence[int] | None = None,
    ax: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """The stages of one joint side by side (see :func:`joint_plane`), one row per history, all to the same scale.

    ``ax``: axes, one for each stage, row after row.
    """
    above = heading(histories, labels)
    histories, labels = labelled(histories, labels)
    rows = [joint_plane(history, joint, stages, frames) for history in histories]
    numbers = [subject.chosen_joint(history, joint) for history in histories]
    polygons = [history.joints[number]["polygon"] for history, number in zip(histories, numbers, strict=True)]
    names = [
        style.plain(subject.joint_names(history)[number]) for history, number in zip(histories, numbers, strict=True)
    ]
    if len(set(names)) == 1:
        above = "; ".join(filter(None, (above, f"joint {names[0]}")))
    else:
        labels = [f"{label}; joint {name}" for label, name in zip(labels, names, strict=True)]
    corners = np.concatenate([_extent(polygon, row) for polygon, row in zip(polygons, rows, strict=True)])
    extent = np.stack([corners.min(axis=0), corners.max(axis=0)])
    columns = max(map(len, rows))
    with style.settings():
        if ax is None:
            shape = np.ptp(extent, axis=0)
            width = max(1.9, min(2.3, 1.7 * shape[0] / shape[1]))
            high = width * shape[1] / shape[0] + 0.75
            figure = style.new_figure((max(4.5, width * columns + 0.3), high * len(rows) + 0.45))
            figure.set_layout_engine("constrained", h_pad=0.1)  # inches: between the titles and the heading above
            grid = figure.subplots(len(rows), columns, squeeze=False)
            axes = [own for row, line in zip(rows, grid, strict=True) for own in line[: len(row)]]
            for row, line, label in zip(rows, grid, labels, strict=True):
                line[0].set_ylabel(style.wrapped(label, 26))
                for unused in line[len(row) :]:
                    unused.remove()
        else:
            figure, axes = style.panels(ax, sum(map(len, rows)), "stages", (0.0, 0.0))
        shown = [
            (row[: i + 1], polygon, _load_of(row[i], subject.diagram_of(history)))
            for history, row, polygon in zip(histories, rows, polygons, strict=True)
            for i in range(len(row))
        ]
        for own, (so_far, polygon, load) in zip(axes, shown, strict=True):
            _draw(own, polygon, so_far, extent, load)
        if ax is None:
            if above:
                figure.suptitle(style.wrapped(above, 26 * columns), fontsize=9)
            style.legend(figure, axes, True, columns=4 if columns > 2 else 2)
    return figure


def _extent(polygon: np.ndarray, stages: list[Stage]) -> np.ndarray:
    """Lower left and upper right corner (2, 2) m of the joint with its arrows and nearby centres, over all stages."""
    size = float(np.hypot(*polygon.T).max())
    margin = 1.1 * _arrow_of(stages[0]) * size
    centres = [_at_rim(stage.centre, size)[None] for stage in stages if np.isfinite(stage.centre).all()]
    shown = np.concatenate([polygon, *centres])
    return np.stack([shown.min(axis=0) - margin, shown.max(axis=0) + margin])


def _arrow_of(stage: Stage) -> float:
    return _ARROW[len(stage.points) <= 12]


def _at_rim(centre: np.ndarray, size: float) -> np.ndarray:
    """A torsion centre, or the point at the edge of the picture in its direction if it is farther away."""
    return centre * min(1.0, _NEAR * size / max(float(np.hypot(*centre)), 1e-300))


def _draw(axes, polygon: np.ndarray, stages: list[Stage], extent: np.ndarray, load: str) -> None:
    """Draw the last of ``stages`` under its ``load``, and the torsion centres of the earlier ones."""
    from matplotlib.patches import Polygon

    stage, size = stages[-1], float(np.hypot(*polygon.T).max())
    for piece in pieces(polygon):
        axes.add_patch(Polygon(polygon[piece], closed=True, fc="#F0F0F0", ec="black", lw=1.0, zorder=1))
    axes.plot(0.0, 0.0, "+", color=style.GREY, ms=6, zorder=2)
    length = _arrow_of(stage) * size
    longest = float(np.linalg.norm(stage.movement, axis=1).max())
    _arrows(axes, stage.points, stage.movement, length, longest, style.BLUE, "movement since the previous stage")
    if stage.friction is not None:
        name = "friction (longest: at its limit)"
        _arrows(axes, stage.points, stage.friction, length, stage.limit, style.VERMILLION, name)
    axes.plot(*stage.points.T, ".", color="black", ms=2.5, zorder=4)
    centres = [one.centre for one in stages if np.isfinite(one.centre).all()]
    if centres:
        axes.plot(*np.array([_at_rim(one, size) for one in centres]).T, color="black", lw=0.7, zorder=5)
    for one in centres[:-1]:
        axes.plot(
            *_at_rim(one, size), "o", mfc="white", mec="black", mew=0.8, ms=4, zorder=6, label="its previous positions"
        )
    if np.isfinite(stage.centre).all():
        place, far = _at_rim(stage.centre, size), float(np.hypot(*stage.centre))
        axes.plot(*place, "X", mfc=style.ORANGE, mec="black", mew=0.8, ms=9, zorder=7, label="torsion centre")
        if far > _NEAR * size:
            side = "left" if place[0] < 0.0 else "right"  # inwards
            axes.annotate(f"{1e3 * far:.3g} mm", place, (0, 7), textcoords="offset points", fontsize=7, ha=side)
    axes.set_aspect("equal")
    axes.set_xlim(*extent[:, 0])
    axes.set_ylim(*extent[:, 1])
    axes.set(xticks=[], yticks=[])
    axes.grid(False)
    axes.spines[:].set_visible(False)
    moved = float(np.linalg.norm(stage.movement, axis=1).max())
    used = _used(stage.utilisation, stage.bending)
    axes.set_title(f"{load}\n{used}\nmoved {summary.length(moved)}", fontsize=8)


def _used(utilisation: float, bending: float = 0.0) -> str:
    """Utilisation of friction in words, even if it is not a finite number, and that in bending if it is greater."""
    if math.isnan(utilisation):
        return "utilisation not known: cut at an edge"
    if not math.isfinite(utilisation):
        return "loaded without friction strength"
    if bending > utilisation:
        return f"friction used {utilisation:.3g}\n{'a hinge' if bending > HINGE else f'bending used {bending:.3g}'}"
    return f"utilisation {utilisation:.3g}"


def _arrows(axes, points: np.ndarray, vectors: np.ndarray, length: float, full: float, colour: str, label: str) -> None:
    """Draw vectors as arrows; one of size ``full`` has the ``length`` (m)."""
    if full > 0.0 and vectors.any():
        axes.quiver(*points.T, *(vectors * (length / full)).T, color=colour, angles="xy", scale_units="xy", scale=1.0,
                    units="inches", width=0.016, headwidth=4.0, headlength=4.5, headaxislength=4.0, minlength=0.5,
                    zorder=3, label=label)  # fmt: skip
