"""Draw a joint with its axes, forces and signs into docs/images/joint_signs.svg.

    python tools/joint_signs.py [--out docs/images/joint_signs.svg]

Block b is lifted off block a along n to show the face of a, on which the forces are drawn.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon

ROOT = Path(__file__).resolve().parent.parent
A, B, HEIGHT, LIFT = 3.0, 2.0, 1.0, 2.35  # sides of the joint, height of the blocks, lift of b
AXES = np.array([[0.86, -0.24], [0.62, 0.36], [0.0, 1.0]])  # t1, t2, n in the drawing plane
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
LARGE, SMALL = 15, 10.5


def on_paper(points) -> np.ndarray:
    """Projection (n, 2) onto the drawing plane of points (n, 3) in t1, t2, n."""
    return np.atleast_2d(np.asarray(points, float)) @ AXES


class Drawing:
    """Lines, arrows and text in one axes object, in coordinates along t1, t2, n from O of block a."""

    def __init__(self):
        self.figure = Figure(figsize=(6.2, 8.0))
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set_aspect("equal")
        self.axes.axis("off")

    def face(self, corners, colour: str, alpha: float, edge: str = GREY) -> None:
        self.axes.add_patch(Polygon(on_paper(corners), facecolor=colour, edgecolor="none", alpha=alpha, zorder=1))
        self.axes.add_patch(Polygon(on_paper(corners), facecolor="none", edgecolor=edge, lw=1.0, zorder=2))

    def line(self, points, **look) -> None:
        self.axes.plot(*on_paper(points).T, **({"color": GREY, "lw": 1.0, "zorder": 2} | look))

    def arrow(self, start, end, colour: str, style: str = "-|>", width: float = 2.2) -> None:
        (tail,), (head,) = on_paper(start), on_paper(end)
        look = {"arrowstyle": style, "mutation_scale": 17, "color": colour, "lw": width, "zorder": 5}
        self.axes.add_patch(FancyArrowPatch(tail, head, shrinkA=0, shrinkB=0, **look))

    def moment(self, start, end, colour: str) -> None:
        """Draw a moment as a vector with two heads, by the right-hand rule."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        self.arrow(start, end, colour)
        self.arrow(start, start + 0.84 * (end - start), colour)

    def word(self, place, text: str, colour: str = "black", size: float = LARGE, **look) -> None:
        (at,) = on_paper(place)
        centred = {"ha": "center", "va": "center", "zorder": 6}
        self.axes.text(*at, text, color=colour, fontsize=size, **(centred | look))


def box(drawing: Drawing, base: float, seen_from_below: bool) -> None:
    """Draw a block above the joint's rectangle from ``base`` (along n): its top and two sides, or its edges."""
    x, y = 0.5 * A, 0.5 * B
    corners = {(i, j, k): (i * x, j * y, base + k * HEIGHT) for i in (-1, 1) for j in (-1, 1) for k in (0, 1)}
    top = [corners[i, j, 1] for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    front = [corners[i, -1, k] for i, k in ((-1, 0), (1, 0), (1, 1), (-1, 1))]
    right = [corners[1, j, k] for j, k in ((-1, 0), (1, 0), (1, 1), (-1, 1))]
    if not seen_from_below:
        for face, grey in ((top, "#BFD8EA"), (front, "#E4E4E4"), (right, "#CFCFCF")):
            drawing.face(face, grey, 1.0)
        return
    bottom = [corners[i, j, 0] for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    drawing.face(bottom, "#BFD8EA", 0.9)
    for face in (top, front, right):
        drawing.face(face, "#E4E4E4", 0.18)
    for first, second in (((-1, 1, 0), (-1, 1, 1)),):
        drawing.line([corners[first], corners[second]], ls=":")


def forces_on_a(drawing: Drawing) -> None:
    """Draw the six forces and moments of b on a, each positive, about O on the face of a."""
    centre = np.zeros(3)
    drawing.arrow(centre + [0.0, 0.0, 1.75], centre, BLUE)
    drawing.word(centre + [0.17, 0.0, 1.5], "$N$", BLUE)
    drawing.arrow(centre, centre + [0.95, 0.0, 0.0], ORANGE)
    drawing.word(centre + [0.86, 0.0, -0.2], "$V_1$", ORANGE)
    drawing.arrow(centre, centre + [0.0, 0.7, 0.0], ORANGE)
    drawing.word(centre + [0.17, 0.86, 0.0], "$V_2$", ORANGE)
    drawing.moment(centre + [0.5 * A + 0.05, 0.0, 0.0], centre + [0.5 * A + 1.0, 0.0, 0.0], GREEN)
    drawing.word(centre + [0.5 * A + 1.25, 0.0, 0.0], "$M_1$", GREEN)
    drawing.moment(centre + [0.0, 0.5 * B + 0.05, 0.0], centre + [0.0, 0.5 * B + 1.0, 0.0], GREEN)
    drawing.word(centre + [0.0, 0.5 * B + 1.3, 0.0], "$M_2$", GREEN)
    turn = np.radians(np.linspace(-150.0, 100.0, 80))
    ring = centre + np.column_stack([0.42 * np.cos(turn), 0.42 * np.sin(turn), np.full(80, 1.05)])
    drawing.line(ring[:-3], color=GREEN, lw=2.2, zorder=5)
    drawing.arrow(ring[-6], ring[-1], GREEN)
    drawing.word(centre + [0.82, -0.1, 1.1], "$M_T$", GREEN)


def axes_of_b(drawing: Drawing) -> None:
    """Draw O and the axes of the joint on the face of b."""
    centre = np.array([0.0, 0.0, LIFT])
    for end, name, place in (
        ((0.8, 0.0, 0.0), "$t_1$", (0.97, 0.0, 0.0)),
        ((0.0, 0.7, 0.0), "$t_2$", (0.0, 0.92, 0.0)),
        ((0.0, 0.0, 0.75), "$n$", (0.14, 0.0, 0.8)),
    ):
        drawing.arrow(centre, centre + end, "black", width=1.4)
        drawing.word(centre + place, name)
    drawing.word(centre + [-0.12, -0.06, 0.06], "$O$")
    drawing.word((-0.12, -0.06, 0.06), "$O$")


def drawn() -> Figure:
    """The whole drawing."""
    drawing = Drawing()
    box(drawing, -HEIGHT, seen_from_below=False)
    for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):  # from the face of a to that of b
        drawing.line(
            [(0.5 * x * A, 0.5 * y * B, 0.0), (0.5 * x * A, 0.5 * y * B, LIFT)], ls=(0, (2, 3)), lw=0.7, zorder=0
        )
    box(drawing, LIFT, seen_from_below=True)
    axes_of_b(drawing)
    forces_on_a(drawing)
    drawing.word((-0.5 * A + 0.55, -0.5 * B, -0.5 * HEIGHT), "block a", size=SMALL + 2)
    drawing.word((-0.5 * A + 0.55, -0.5 * B, LIFT + 0.5 * HEIGHT), "block b", size=SMALL + 2)
    drawing.word((-0.88, -0.05, 0.02), "joint of area $A$", size=SMALL)
    drawing.word((0.3, 0.0, -2.3), "What b does to a, each drawn positive; b feels the opposite.\n"
                 "N presses, along -n on a; moments turn by the right-hand rule.", size=SMALL)  # fmt: skip
    drawing.axes.set_xlim(-2.6, 3.1)
    drawing.axes.set_ylim(-2.75, 4.65)
    return drawing.figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images" / "joint_signs.svg")
    out = parser.parse_args().out
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "joint", "svg.fonttype": "path"}):
        drawn().savefig(out, metadata={"Date": None} if out.suffix == ".svg" else None, dpi=110)
    print(out)


if __name__ == "__main__":
    main()
