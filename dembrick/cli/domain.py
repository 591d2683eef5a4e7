"""``dembrick domain``: yield domain of a joint by theory, and by simulation."""

from __future__ import annotations

import math

from dembrick.cli.paths import FIGURES, add_force, require_ending

TOLERANCE = 1e-3
SMOOTH = 91  # points of a curve in a picture, at least
_HEADER = f"{'formulation':16}{'source':>8}{'V [N]':>12}{'M_T [N m]':>12}{'both +- [%]':>13}"


def add_arguments(parser) -> None:
    parser.add_argument("--a", type=float, help="edge along x (t1) of a rectangular joint, m")
    parser.add_argument("--b", type=float, help="edge along y (t2), m")
    parser.add_argument("--polygon", metavar="'x,y;x,y;...'", help="corners of a convex joint, m")
    parser.add_argument("--scenario", metavar="FILE.toml", help="joint, friction and N of a scenario with two blocks")
    parser.add_argument("--mu", type=float, help="friction coefficient")
    parser.add_argument("--N", type=float, help="normal force, N")
    parser.add_argument("--cohesion", type=float, metavar="C", help="cohesion, kept after slip, Pa (default: 0)")
    parser.add_argument(
        "--eccentricity", type=float, nargs=2, metavar=("EX", "EY"), help="eccentricity of N from the centroid, m"
    )
    parser.add_argument("--formulation", nargs="+", metavar="F", help="formulations (default: all five)")
    parser.add_argument(
        "--pressure",
        metavar="P",
        help="pressure of convex joints: full, effective or linear (default: that of the scenario, else full)",
    )
    parser.add_argument("--points", type=int, default=13, metavar="n", help="points of each theoretical curve")
    parser.add_argument(
        "--simulate", type=int, default=0, metavar="n", help="simulate tests in n directions of (V, M_T)"
    )
    parser.add_argument(
        "--space",
        default="quarter",
        metavar="S",
        help="directions of these tests: quarter, plane, or all of (V_1, V_2, M_T)",
    )
    parser.add_argument(
        "--shear-angle", type=float, default=90.0, metavar="DEG", help="angle of V from t1 (default: 90)"
    )
    parser.add_argument("--height", type=float, default=0.0, metavar="m", help="height of the load above the joint")
    parser.add_argument("--tolerance", type=float, help=f"tolerance of the simulated tests (default: {TOLERANCE:g})")
    parser.add_argument("--csv", metavar="FILE.csv", help="write the points as a table")
    parser.add_argument("--plot", "--to", metavar="FILE", help="draw the domain of a rectangle (PNG, SVG, PDF)")
    add_force(parser)


def run(options, console) -> int:
    """Print the domains; exit code 3 if replay and theory disagree, or certified points form no convex set."""
    from dembrick import history
    from dembrick.errors import ScenarioError
    from dembrick.runs import domain
    from dembrick.runs.lab import write_csv
    from dembrick.scenario.model import FORMULATIONS

    joint, law, inputs = _joint(options)
    formulations = options.formulation or ([law.formulation] if law else FORMULATIONS)
    if options.tolerance is not None and not options.simulate:
        raise ScenarioError("--tolerance belongs to simulated tests, and theory needs none: add --simulate n")
    if options.pressure not in (None, "full") and "convex" not in formulations:
        raise ScenarioError(f"--pressure {options.pressure} belongs to convex joints: add --formulation convex")
    tolerance = TOLERANCE if options.tolerance is None else options.tolerance
    pressure, points = (law.pressure, law.points) if law else ("full", None)
    request = domain.Request(
        options.space, options.shear_angle, options.height, options.pressure or pressure, points, tolerance
    )
    if options.plot and options.space != "quarter":
        raise ScenarioError("--plot draws the quarter V, M_T of a rectangle: leave --space out")
    if options.plot and joint.edges is None:
        raise ScenarioError(
            "--plot draws the quarter V, M_T of a rectangle, and this joint is not a rectangle: use --csv"
        )
    if options.simulate < 0:
        raise ScenarioError(f"--simulate = {options.simulate} is out of range: use 0, or at least 2 directions")
    with history.product("domain", [repr(joint.as_dict())], inputs, options.force):
        for path, endings, what in ((options.csv, [".csv"], "a table"), (options.plot, FIGURES, "a figure")):
            if path:
                require_ending(path, endings, what)
                history.check_output(path)  # before the simulation, not after it
    rows = domain.by_theory(joint, formulations, options.points, request)
    simulated, checks = domain.by_simulation(joint, formulations, options.simulate, request, console.progress)
    lines = [_HEADER]
    for row in rows + simulated:
        half = f"{100.0 * row['relative_half_width']:13.2g}" if "relative_half_width" in row else ""
        lines.append(f"{row['formulation']:16}{row['source']:>8}{row['V']:12.5g}{row['M_T']:12.5g}{half}")
    lines += [_said(name, found) for name, found in checks.items()]
    result = {"joint": joint.as_dict(), "space": options.space, "rows": rows + simulated, "checks": checks}
    console.result(result, "\n".join(lines))  # first, so that a write error loses nothing
    with history.product("domain", [repr(joint.as_dict())], inputs, options.force):
        if options.csv:
            write_csv([{key: row.get(key) for key in (rows + simulated)[-1]} for row in rows + simulated], options.csv)
        if options.plot:
            from dembrick.views import plot

            turned = math.radians(options.shear_angle)
            smooth = domain.by_theory(joint, formulations, max(options.points, SMOOTH), request)
            curves = _curves(smooth, options.height)
            a, b = joint.edges
            shown = plot.RectangularJoint(
                a, b, joint.friction, joint.normal_force, joint.cohesion,
                direction=(math.cos(turned), math.sin(turned)), eccentricity=joint.eccentricity,
            )  # fmt: skip
            figure = plot.domains(simulated, joint=shown, formulations=curves, experiments={})
            plot.save(figure, options.plot)
    sound = all(_sound(found, tolerance) for found in checks.values())
    return 0 if sound else 3


def _curves(rows: list[dict], height: float) -> dict:
    """V and M_T of the rows by formulation; its name states the pressure and the ``height`` (m) of the load if they
    differ from the paper."""
    import numpy as np

    above = f", load {1e3 * height:.3g} mm above the joint" if height else ""
    curves: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        pressed = "" if row["pressure"] == "full" else f", {row['pressure']} pressure"
        curves.setdefault(row["formulation"] + pressed + above, []).append((row["V"], row["M_T"]))
    return {name: np.array(points).T for name, points in curves.items()}


def _joint(options):
    """The joint asked for, its law in the scenario (None without one), and the files that were read."""
    from dembrick.errors import ScenarioError
    from dembrick.runs.domain import DomainJoint

    given = [options.a is not None or options.b is not None, options.polygon is not None, options.scenario is not None]
    if sum(given) != 1:
        raise ScenarioError("give the joint by --a and --b, by --polygon, or by --scenario")
    more = {} if options.eccentricity is None else {"eccentricity": tuple(options.eccentricity)}
    if options.cohesion is not None:
        more["cohesion"] = options.cohesion
    if options.scenario is not None:
        import dataclasses

        from dembrick.assembly import build
        from dembrick.runs.reading import load
        from dembrick.scenario.files import inputs_of

        scenario = load(options.scenario)
        built = build.assemble(scenario)
        joint = DomainJoint.of_assembly(built)
        changed = {"friction": options.mu, "normal_force": options.N} | more
        changed = {key: value for key, value in changed.items() if value is not None}
        return (
            dataclasses.replace(joint, **changed),
            built.joints[0].law,
            [options.scenario, *inputs_of(scenario)],
        )
    for name in ("a", "b") if given[0] else ():
        if getattr(options, name) is None:
            raise ScenarioError(f"--{name} is missing: a rectangle needs --a and --b")
    for name in ("mu", "N"):
        if getattr(options, name) is None:
            raise ScenarioError(f"--{name} is missing: a domain needs friction and a normal force")
    if given[0]:
        return DomainJoint.rectangle(options.a, options.b, options.mu, options.N, **more), None, []
    try:
        corners = [tuple(map(float, corner.split(","))) for corner in options.polygon.strip(";").split(";")]
        if {len(corner) for corner in corners} != {2}:
            raise ValueError
    except ValueError:
        raise ScenarioError(
            f"--polygon {options.polygon!r} is not a list of corners: write x,y;x,y;x,y in m, in quotes"
        ) from None
    return DomainJoint.from_corners(corners, options.mu, options.N, **more), None, []


def _sound(found: dict, tolerance: float) -> bool:
    certified = not found["certified"] or (found["convexity"]["holds"] and found["normality"]["holds"])
    return certified and found["error_vs_theory"] <= tolerance


def _said(name: str, found: dict) -> str:
    """One line on convexity, normality and error of the simulated points of a formulation."""
    convexity, normality = found["convexity"], found["normality"]
    note = "" if found["certified"] else " (the normal forces change with the load, so flow is not associated)"
    return (
        f"{name}: convex within {convexity['value']:.2g} and slip normal within {normality['value']:.2g} "
        f"(error bars allow {convexity['tolerance']:.2g}), theory within {found['error_vs_theory']:.2g}{note}"
    )
