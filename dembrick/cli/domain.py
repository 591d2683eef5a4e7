"""``dembrick domain``: yield domain of a rectangular joint by theory, and by simulation."""

from __future__ import annotations

_HEADER = f"{'formulation':16}{'source':>8}{'V [N]':>12}{'M_T [N m]':>12}{'+-':>11}"


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("--a", type=float, required=True, help="edge along x, m")
    parser.add_argument("--b", type=float, required=True, help="edge along y (of the shear), m")
    parser.add_argument("--mu", type=float, required=True, help="friction coefficient")
    parser.add_argument("--N", type=float, required=True, help="normal force, N")
    parser.add_argument("--formulation", nargs="+", metavar="F", help="default: all five")
    parser.add_argument("--points", type=int, default=13, metavar="n", help="points of each curve by theory")
    parser.add_argument("--simulate", type=int, default=0, metavar="n", help="replays in n directions of (V, M_T)")
    parser.add_argument("--tolerance", type=float, default=1e-3, help="of the replays")
    parser.add_argument("--csv", metavar="FILE.csv", help="write the points")
    parser.add_argument("--plot", metavar="FILE", help="draw the domain (PNG, SVG, PDF)")


def run(options, console) -> int:
    """Print the domains."""
    from dembrick import domain
    from dembrick.lab import write_csv
    from dembrick.model import FORMULATIONS

    joint = domain.JointOfInterest(options.a, options.b, options.mu, options.N)
    formulations = options.formulation or FORMULATIONS
    rows = domain.by_theory(joint, formulations, options.points)
    simulated = domain.by_simulation(joint, formulations, options.simulate, options.tolerance, console.progress)
    if options.csv:
        write_csv(rows + simulated, options.csv)
    if options.plot:
        from dembrick import plot

        curves = [name for name in formulations if name in ("convex", "concave", "corrected")]
        figure = plot.domains(simulated, joint=joint, formulations=curves, experiments={})
        plot.save(figure, options.plot)
    lines = [_HEADER]
    for row in rows + simulated:
        half = "" if row["half_width"] is None else f"{row['half_width']:11.4g}"
        lines.append(f"{row['formulation']:16}{row['source']:>8}{row['V']:12.5g}{row['M_T']:12.5g}{half}")
    console.result({"joint": joint._asdict(), "rows": rows + simulated}, "\n".join(lines))
    return 0
