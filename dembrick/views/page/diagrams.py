"""The two diagrams of a page and the numbers below its picture: curves, and the point of the run in each frame."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.scenario.regimes import OF_ACTUATORS
from dembrick.views import summary
from dembrick.views.plot.paths import BROKEN, CUT_AT_EDGE, JointPath, torsion_strength
from dembrick.views.plot.subject import Diagram, diagram_of

if TYPE_CHECKING:
    from dembrick.history.reader import History

MOST_ROWS = 1500  # points of a curve


class Record(NamedTuple):
    """The record at the time (f,) s of each frame.

    ``load`` (f,): the load of ``diagram`` times ``load_factor``, in ``load_unit``; None if the diagram has no load.
    ``travel`` (f,): the displacement of the diagram in ``unit``, which is the displacement in m times ``factor``.
    """

    diagram: Diagram
    time: np.ndarray
    load: np.ndarray | None
    travel: np.ndarray
    unit: str
    factor: float
    load_unit: str = "-"
    load_factor: float = 1.0


def record_at(history: History, time: np.ndarray, moved: np.ndarray) -> Record:
    """The record at the times of the frames; without rows, ``moved`` (f,) m, the greatest displacement, is shown."""
    diagram = diagram_of(history)
    if not history.n_row:
        unit, factor = summary.travel_unit(float(moved.max(initial=0.0)))
        return Record(Diagram(None, "", "greatest displacement"), time, None, factor * moved, unit, factor)
    unit, factor = summary.travel_unit(float(np.abs(history.displacement).max()))
    travel = factor * np.interp(time, history.time, history.displacement)
    if diagram.load is None:
        return Record(diagram, time, None, travel, unit, factor)
    load_unit, scale = summary.load_unit(float(np.abs(history.load).max()), diagram.unit)
    load = scale * diagram.loads(np.interp(time, history.time, history.load))
    return Record(diagram, time, load, travel, unit, factor, load_unit, scale)


def curve(history: History, record: Record) -> dict:
    """Load over displacement with bracket, theory and bounds of limit analysis, or displacement over time."""
    x_name, travel = f"{record.diagram.displacement} [{record.unit}]", listed(record.travel)
    if record.load is None:
        line = {"x": listed(record.time), "y": travel, "look": "run", "name": ""}
        return _chart("Displacement over time", "time [s]", x_name, [line], line["x"], travel)
    kept = thinned(history)
    load = record.load_factor * record.diagram.loads(history.load[kept])
    line = {"x": listed(record.factor * history.displacement[kept]), "y": listed(load), "look": "run"}
    y_name = f"{record.diagram.load} [{record.load_unit}]"
    chart = _chart("Load over displacement", x_name, y_name, [line | {"name": "run"}], travel, listed(record.load))
    V, scale = summary.number(summary.part(history.results, "theory").get("V")), record.load_factor
    if V is not None:
        V = float(scale * record.diagram.loads(V))
        chart["levels"] = [{"y": V, "look": "theory", "name": f"theory {V:.6g} {record.load_unit.strip('-')}".rstrip()}]
    limit = record.diagram.limit(history.results)
    if limit is not None:
        lower, upper, said = limit
        if upper is None:
            chart["levels"].append({"y": scale * lower, "look": "least", "name": said})
        else:
            chart |= {"band": [scale * lower, scale * upper], "bandName": said}
    for which, (value, said) in record.diagram.allowed(history.results).items():
        chart["levels"].append({"y": scale * value, "look": which, "name": said})
    return chart


def yield_domain(history: History, record: Record, path: JointPath, rows: np.ndarray | None = None) -> dict:
    """Torsion over shear force of a joint, with its limit surface; ``rows`` of the record, by default `thinned`."""
    x, y = path.drawn
    kept = thinned(history) if rows is None else rows
    kept = kept[np.isfinite(x[kept])]  # an open joint has no strength by which to divide its forces
    relative = path.strength is not None
    shear_in, shear = ("-", 1.0) if relative else summary.load_unit(float(np.abs(path.V).max()))
    torsion_in, torsion = ("-", 1.0) if relative else summary.load_unit(float(np.abs(path.M_T).max()), "N m")
    lines = []
    for section in path.sections:
        line = {"x": listed(shear * section.V), "y": listed(torsion * section.M_T), "name": section.name}
        look = section.formulation.split(",")[0] + (" broken" if section.bond == BROKEN else "")
        lines.append(line | {"look": look})
    lines.append({"x": listed(shear * x[kept]), "y": listed(torsion * y[kept]), "look": "run", "name": "run"})
    now = [listed(np.interp(record.time, history.time, own)) for own in (shear * x, torsion * y)]
    title, turned = f"Yield domain of the joint {path.joint}", "M_T" if path.sense > 0.0 else "-M_T"
    if path.cut:
        title = f"Joint {path.joint}, {CUT_AT_EDGE},"
    if relative:
        over = "cA + μN" if path.cohesive else "μN"
        torsion_name = f"torsion {turned} over {torsion_strength([path])} [-]"
        return _chart(f"{title} at N of the moment", f"shear force V over {over} [-]", torsion_name, lines, *now)
    return _chart(f"{title} at N = {summary.load_text(path.normal_force)}", f"shear force V [{shear_in}]",
                  f"torsion {turned} [{torsion_in}]", lines, *now)  # fmt: skip


def readout(history: History, record: Record, path: JointPath | None) -> list[dict]:
    """The numbers shown below the picture, one value per frame each."""
    name, unit = ("equilibrium", "") if history.counts_equilibria else ("time", "s")
    items = [{"name": name, "unit": unit, "digits": 4, "values": listed(record.time)}]
    if record.load is not None:
        name = "V" if record.diagram.load == OF_ACTUATORS.load else record.diagram.load
        items.append({"name": name, "unit": record.load_unit.strip("-"), "digits": 5, "values": listed(record.load)})
    items.append({"name": "displacement", "unit": record.unit, "digits": 4, "values": listed(record.travel)})
    if path is not None and record.diagram.unit == "N":
        torsion = np.interp(record.time, history.time, path.sense * path.M_T)
        torsion[np.abs(torsion) <= summary.ROUNDING * np.abs(history.joint("N")[:, path.number]).max()] = 0.0
        items.append({"name": "torsion", "unit": "N m", "digits": 4, "values": listed(torsion)})
    return items


def listed(values: np.ndarray) -> list[float | None]:
    """Numbers to eight digits; None for those that are not finite."""
    return [float(f"{value:.8g}") if math.isfinite(value) else None for value in np.asarray(values, float).tolist()]


def _chart(title: str, x_name: str, y_name: str, lines: list[dict], x: list, y: list) -> dict:
    chart = {"title": title, "xName": x_name, "yName": y_name, "lines": lines, "x": x, "y": y}
    return chart | {"levels": [], "band": None, "bandName": ""}


def thinned(history: History, most: int = MOST_ROWS) -> np.ndarray:
    """Indices of about ``most`` rows at most, including the first, the last and the one with the greatest load."""
    if history.n_row <= most:
        return np.arange(history.n_row)
    even = np.linspace(0, history.n_row - 1, most).round().astype(int)
    return np.unique(np.append(even, int(np.argmax(np.abs(history.load)))))
