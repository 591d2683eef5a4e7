"""The figures of the lab replay, each drawn from the history files: layouts, curves, domains, the turning block."""

from __future__ import annotations

import os

from dembrick import history
from dembrick.errors import MissingDependency
from dembrick.runs.lab import LabReplay
from dembrick.theory.paper_tables import SETS
from dembrick.views import plot
from dembrick.views.export import export

ENDINGS = (".png", ".pdf")
TURNING = ("4b", "convex")  # the replay whose block is shown turning


def draw(replayed: LabReplay, folder: str, console) -> list[str]:
    """Draw all figures into ``folder``; returns the files. A 3D picture that cannot be drawn is left out, and said."""
    plane = [row for row in replayed.rows if not row["load_height"]]
    layouts = {row["set"]: row for row in replayed.rows if row["load_height"]}  # that of the rig
    points = [history.read(row["history"]) for row in plane]
    figures = {
        "fig4_interaction": plot.interaction(points, approximations=("ellipse", "parabola", "bi-linear")),
        "fig5_domains": plot.domains(points),
        "layouts": plot.layout([history.read(row["history"]) for row in layouts.values()]),
        "curves": _curves(replayed),
    }
    files = []
    for name, figure in figures.items():
        for ending in ENDINGS:
            files.append(plot.save(figure, os.path.join(folder, name + ending)))
            figure.set_layout_engine("none")  # its parts stay where the first format has them
    turning = [path for path in replayed.curves if TURNING[1] in os.path.basename(path)]
    if turning:
        from dembrick.views import render

        motion = history.read(turning[-1])
        files += export(motion, os.path.join(folder, "turning_block.vtkhdf"))
        path = os.path.join(folder, "turning_block.png")
        try:
            render.picture(motion, path)
            files.append(path)
        except MissingDependency as error:
            console.remark(f"no picture of the block: {error}")
    return files


def _curves(replayed: LabReplay):
    """Force-displacement curves of the constant-rate tests, a panel a set, with experiment and printed values."""
    panels = []
    for name, test in SETS.items():
        files = [path for path in replayed.curves if f"set{name}_curve" in os.path.basename(path)]
        if files:
            curves = [history.read(path) for path in files]
            labels = [curve.results["formulation"] for curve in curves]
            panels.append(plot.CurvePanel(f"Set {name}", curves, labels, test.experiment))
    return plot.curve_panels(panels)
