"""``dembrick lab``: the tests of the paper, replayed."""

from __future__ import annotations

import os

from dembrick.cli.paths import add_force


def add_arguments(parser) -> None:
    parser.add_argument("--formulation", nargs="+", metavar="F", help="only these formulations")
    parser.add_argument("--sets", nargs="+", metavar="SET", help="only these sets (2a 2b 4a 4b)")
    parser.add_argument("--tolerance", type=float, help="relative half-width of the bracket (default 1e-3)")
    parser.add_argument("--out", metavar="DIR", help="folder for histories, tables and figures (default results/lab)")
    add_force(parser)
    parser.add_argument("--no-figures", action="store_true", help="draw no figures and run no constant-rate curves")


def run(options, console) -> int:
    """Replay, print the tables, write histories, CSV and figures."""
    from dembrick.cli.paths import default_output, make_folder
    from dembrick.runs import lab
    from dembrick.scenario.model import FORMULATIONS
    from dembrick.theory.paper_tables import SETS

    folder = str(make_folder(options.out) if options.out else make_folder(default_output("lab")))
    if not options.force:
        lab.refuse_foreign_folder(folder)

    figures: list[str] = []

    def tell(replayed: lab.LabReplay) -> None:
        """Write, print and draw the rows before the constant-rate tests, which take as long again."""
        lab.write_csv(replayed.rows, os.path.join(folder, "yield_points.csv"))
        text = [lab.table_3(replayed.rows), "", lab.notes(replayed.rows)]
        if replayed.rows_table_1:
            lab.write_csv(replayed.rows_table_1, os.path.join(folder, "table_1.csv"))
            text += ["", lab.table_1(replayed.rows_table_1)]
        console.part("\n".join([*text, ""]))
        if not options.no_figures:
            figures.extend(lab.draw_rows(replayed, folder))

    try:
        replayed = lab.replay_lab(
            options.sets or tuple(SETS),
            options.formulation or FORMULATIONS,
            options.tolerance,
            folder,
            curves=not options.no_figures,
            progress=console.progress,
            told=tell,
        )
    except KeyboardInterrupt as stopped:
        if console.json and hasattr(stopped, "answer"):
            console.result(stopped.answer, "")
        raise
    data, text = replayed.as_dict(), []
    if not options.no_figures:
        drawn, exported = lab.draw_curves(replayed, folder, console)
        data |= {"figures": figures + drawn, "exports": exported}
        text = [f"figures: {', '.join(data['figures'])}", ""]
        if exported:
            text.insert(1, f"for ParaView: {', '.join(exported)}")
    console.result(data, "\n".join([*text, f"histories: {folder}"]))
    if replayed.agrees:
        return 0
    console.error("theory and simulation disagree in at least one row")
    return 3
