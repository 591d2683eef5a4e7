"""``dembrick yield FILE.h5 ...``: table and plot of the yield points of histories."""

from __future__ import annotations

from dembrick.cli.paths import add_force, require_ending


def add_arguments(parser) -> None:
    parser.add_argument("histories", nargs="+", metavar="FILE.h5", help="history files")
    parser.add_argument("--csv", metavar="FILE.csv", help="write the table to this file")
    parser.add_argument("--plot", metavar="FILE", help="draw the points on the yield domain (PNG, SVG, PDF)")
    add_force(parser)


def run(options, console) -> int:
    from dembrick import history
    from dembrick.errors import HistoryError
    from dembrick.runs.lab import write_csv
    from dembrick.scenario.checks import listed
    from dembrick.scenario.regimes import REGIMES
    from dembrick.views.summary import limit_text, mechanism, part, path_dependence_unknown, plain, yield_point

    loading = {regime.name for regime in REGIMES if not regime.stands_or_falls}
    read = {path: history.read(path) for path in options.histories}
    files = {path: file for path, file in read.items() if file.regime in loading}
    if not files:
        raise HistoryError(f"{listed([*read])}: this run searched no limit load; 'dembrick info' summarises a history")
    if without := [path for path in read if path not in files]:
        console.remark(f"left out because no limit load was searched: {listed(without)}")
    faults = {path: fault for path, file in files.items() if (fault := _without_point(file))}
    if len(faults) == len(files):
        path, fault = next(iter(faults.items()))
        raise HistoryError(f"{path}: {fault}")
    for path, fault in faults.items():
        console.remark(f"{path} is left out: {fault}")
        del files[path]
    said = []
    rows = []
    for path, file in files.items():
        point = file.results["yield_point"]
        told = yield_point(file.results)
        point |= {key: told[key] for key in ("V_lower", "V_upper", "bracket") if key in told}
        theory, beside = (file.results or {}).get("theory") or {}, part(file.results, "path")
        text = "unlimited" if point["V"] is None else str(limit_text(point, beside, file.curve.unit.strip("1")))
        said.append((plain(text), mechanism(file.results)))
        centre = point.pop("torsion_centre", None) or [None, None]
        joint = point.pop("joint", None) or []
        rows.append(
            {
                "history": path,
                "title": file.title,
                "formulation": file.results.get("formulation"),
                "status": file.status,
                "load_unit": file.curve.unit,
            }
            | point
            | {"torsion_centre_1": centre[0], "torsion_centre_2": centre[1], "joint": " - ".join(joint)}
            | {"theory": theory.get("V"), "error_vs_theory": theory.get("error")}
            | {"path_dependent": (file.results or {}).get("path_dependent")}
            | {"digits_open": path_dependence_unknown(beside)}
        )
    texts = [file.scenario_text for file in files.values()]
    inputs = [path for file in files.values() for path in file.sources]
    with history.product("yield domain", texts, inputs, options.force):
        if options.csv:
            require_ending(options.csv, [".csv"], "a table")
            write_csv(rows, options.csv)
        if options.plot:
            from dembrick.views import plot

            plot.save(plot.domains([*files.values()]), options.plot)
    console.result({"rows": rows}, _text(rows, said))
    return 0


def _without_point(file) -> str:
    """Why a history of a search or test has no yield point; empty if it has one."""
    results = file.results or {}
    if not results.get("yield_point"):
        return f"this history has no yield point (status {file.status}); run it to its end"
    error = results.get("error")
    return f"this run found no yield point: {error}" if isinstance(error, str) else ""


def _text(rows: list[dict], said: list[tuple[str, str]]) -> str:
    """Table with a line per history: limit and mechanism (the texts ``said``), the largest load, the torsion."""
    from dembrick.views.summary import ROUNDING, known

    cells = [("history", "formulation", "limit", "V_peak", "M_T [N m]", "mechanism")]
    for row, (text, by) in zip(rows, said, strict=True):
        numbers = "", "", ""
        if row["V"] is not None:
            upper = row["V_lower"] if row["V_upper"] is None else row["V_upper"]
            peak = known(row["V_peak"], None if row["digits_open"] else 0.1 * (upper - row["V_lower"]))
            torsion = row["M_T"] if abs(row["M_T"]) > ROUNDING * abs(row["N"]) else 0.0
            numbers = peak, f"{torsion:.6g}", by
        cells.append((row["history"], row["formulation"] or "", text, *numbers))
    wide = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(
            f"{cell:>{width}}" if name in ("V_peak", "M_T [N m]") else f"{cell:{width}}"
            for name, cell, width in zip(cells[0], line, wide, strict=True)
        ).rstrip()
        for line in cells
    )
