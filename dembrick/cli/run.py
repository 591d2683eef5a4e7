"""``dembrick run SCENARIO.toml``."""

from __future__ import annotations

from pathlib import Path


def add_arguments(parser) -> None:
    """Options of the command."""
    parser.add_argument("scenario", help="the TOML file")
    parser.add_argument("--out", metavar="FILE.h5", help="history file (default: results/<scenario>.h5)")
    parser.add_argument(
        "--set", metavar="KEY.PATH=VALUE", action="append", default=[], help="change a key of the scenario"
    )
    parser.add_argument("--tolerance", type=float, help="short for --set control.tolerance=...")
    parser.add_argument("--force", action="store_true", help="replace a finished history")


def run(options, console) -> int:
    """Run the scenario; exit code 3 where theory and replay disagree."""
    from dembrick import scenario as scenarios
    from dembrick.cli.paths import default_output
    from dembrick.errors import DembrickError
    from dembrick.result import failure, simulate

    changes = list(options.set)
    if options.tolerance is not None:
        changes.append(f"control.tolerance={options.tolerance!r}")
    scenario = scenarios.load(options.scenario, changes)
    path = options.out or default_output(Path(options.scenario).stem + ".h5")
    try:
        result = simulate(scenario, path, force=options.force or not options.out, report=console.remark)
    except DembrickError as error:
        if error.exit_code != 1:
            raise
        console.result(failure(scenario, error, path), "")
        console.error(str(error))
        console.remark(f"history: {path}")
        return 1
    console.result(result.as_dict(), _text(result))
    if result.agrees():
        return 0
    console.error(
        "theory and replay disagree: V lies outside the tolerance of theory, or theory outside the certified bracket"
    )
    return 3


def _text(result) -> str:
    point, run = result.yield_point, result.replay
    lines = [result.scenario.title, f"formulation   {result.scenario.joint.formulation}"]
    lines.append(f"V             {point.V:.6g} N +- {point.half_width:.2g} N ({point.bracket})")
    if result.theory is not None:
        error = result.theory.error
        compared = "" if error is None else f"  (replay {100 * error:+.2g} %)"
        lines.append(f"theory        {result.theory.V:.6g} N{compared}")
        if result.theory.discretisation_error is not None:
            lines.append(f"discretised   {100 * result.theory.discretisation_error:+.2g} % from the continuum")
    lines.append(f"V_peak        {point.V_peak:.6g} N at {1e6 * point.displacement_at_peak:.3g} um")
    lines.append(f"joint         N = {point.N:.6g} N, V_1 = {point.V_1:.6g} N, V_2 = {point.V_2:.6g} N, "
                 f"M_T = {point.M_T:.6g} N m")  # fmt: skip
    where = ""
    if point.torsion_centre is not None:
        where = f", centre ({point.torsion_centre[0]:.5g}, {point.torsion_centre[1]:.5g}) m"
    lines.append(f"mechanism     {point.mechanism}{where}")
    lines.append(
        f"time step     {run.time_step:.3g} s (critical {run.critical_time_step:.3g} s), {run.steps} steps, "
        f"loop {1e3 * run.loop_seconds:.3g} ms"
    )
    lines.append(f"history       {result.history}")
    return "\n".join(lines)
