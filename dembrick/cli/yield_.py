"""``dembrick yield FILE.h5 ...``: yield points out of histories."""

from __future__ import annotations

import math

from dembrick.cli.paths import add_force, require_ending


def add_arguments(parser) -> None:
    parser.add_argument("histories", nargs="+", metavar="FILE.h5", help="history files")
    parser.add_argument("--csv", metavar="FILE.csv", help="write the table")
    parser.add_argument("--plot", metavar="FILE", help="draw the points on the yield domain (PNG, SVG, PDF)")
    add_force(parser)


def run(options, console) -> int:
    from dembrick import history
    from dembrick.errors import HistoryError
    from dembrick.runs.lab import write_csv
    from dembrick.views.summary import on_one_path, part

    files = [history.read(path) for path in options.histories]
    rows = []
    for path, file in zip(options.histories, files, strict=True):
        point = (file.results or {}).get("yield_point")
        if not point:
            raise HistoryError(f"{path}: this history has no yield point (status {file.status}); run it to the end")
        theory = (file.results or {}).get("theory") or {}
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
            | {"digits_open": on_one_path(part(file.results, "path"))}
        )
    texts = [file.scenario_text for file in files]
    with history.product("yield domain", texts, options.histories, options.force):
        if options.csv:
            require_ending(options.csv, [".csv"], "a table")
            write_csv(rows, options.csv)
        if options.plot:
            from dembrick.views import plot

            plot.save(plot.domains(files), options.plot)
    console.result({"rows": rows}, _text(rows))
    return 0


def _text(rows: list[dict]) -> str:
    from dembrick.views.summary import known

    width = max(len(row["history"]) for row in rows)
    newtons = any(row["load_unit"] == "N" for row in rows)
    if newtons and any(row["load_unit"] != "N" for row in rows):
        apart = [[row for row in rows if (row["load_unit"] == "N") is wanted] for wanted in (True, False)]
        return "\n\n".join(map(_text, apart))
    load = "V [N]" if newtons else "load factor"
    head = f"{'history':{width}} {'formulation':16}{load:>12}{'+-':>10}{'V_peak':>12}{'M_T [N m]':>12}  mechanism"
    lines = [head]
    for row in rows:
        if row["V"] is None:
            lines.append(f"{row['history']:{width}} {row['formulation'] or '':16}{'unlimited':>12}")
            continue
        half = math.inf if row["V_upper"] is None else 0.5 * (row["V_upper"] - row["V_lower"])
        V, peak, bar = f"{row['V']:.4f}", f"{row['V_peak']:.4f}", f"{half:.4f}"
        if row["digits_open"]:
            V, peak, bar = known(row["V"], None), known(row["V_peak"], None), "one path"
        lines.append(
            f"{row['history']:{width}} {row['formulation'] or '':16}{V:>12}{bar:>10}{peak:>12}{row['M_T']:12.4f}  "
            f"{row['mechanism']} ({row['bracket']})"
        )
    return "\n".join(lines)
