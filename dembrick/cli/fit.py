"""``dembrick fit --lab DATA.csv``, and ``dembrick fit --lab CURVE.csv SCENARIO --vary KEYS``."""

from __future__ import annotations

from dembrick.cli.paths import add_force, require_ending


def add_arguments(parser) -> None:
    parser.add_argument(
        "scenario",
        nargs="*",
        metavar="SCENARIO",
        help="scenario of the measured curves: one for all, or one for each",
    )
    parser.add_argument(
        "--lab", metavar="DATA.csv", required=True, action="append",
        help="measured yield points: columns test, scenario, V [N]; or with SCENARIO a measured curve: columns of "
        "displacement and force with their units (may be repeated)",
    )  # fmt: skip
    parser.add_argument("--vary", metavar="KEY,KEY", help="keys of SCENARIO to fit, as for --set: joint.friction")
    parser.add_argument("--out", metavar="FITTED.toml", help="write SCENARIO with the fitted values")
    parser.add_argument(
        "--formulation", nargs="+", metavar="F", help="formulations of a fit to yield points (default: all five)"
    )
    add_force(parser)


def run(options, console) -> int:
    """Print mu under each formulation, with its confidence interval and the residual of every test."""
    from dembrick.errors import ScenarioError
    from dembrick.runs import fit
    from dembrick.scenario.checks import nearest, show
    from dembrick.scenario.model import FORMULATIONS

    if options.scenario:
        return _curves(options, console)
    if len(options.lab) > 1 or options.vary or options.out:
        raise ScenarioError("--vary, --out and several --lab belong to measured curves: add the SCENARIO of the curves")
    for name in options.formulation or ():
        if name not in FORMULATIONS:
            raise ScenarioError(f"--formulation {show(name)} is unknown; {nearest(name, FORMULATIONS)}")
    fits = fit.fit(fit.read(options.lab[0]), options.formulation or FORMULATIONS, console.progress)
    console.result({"confidence": fit.CONFIDENCE, "fits": fit.as_dicts(fits)}, _text(fits, fit.CONFIDENCE))
    return 0


def _curves(options, console) -> int:
    """Fit keys of scenarios to measured curves of force over displacement."""
    from dembrick import history
    from dembrick.errors import ScenarioError
    from dembrick.runs import curve_fit
    from dembrick.scenario import toml
    from dembrick.scenario.files import inputs_of
    from dembrick.views import plot

    if options.formulation:
        raise ScenarioError("--formulation belongs to yield points; the scenario of a curve states its own")
    if not options.vary:
        raise ScenarioError("--vary is missing: name the keys to fit, for instance --vary joint.friction")
    if options.out and len(options.scenario) > 1:
        raise ScenarioError("--out writes one scenario, and several are given; set the values in each yourself")
    if options.out:
        require_ending(options.out, (".toml",), "a scenario")
    measured = [plot.read_measured(path) for path in options.lab]
    given = [toml.load(path) for path in options.scenario]
    keys = [key.strip() for key in options.vary.split(",") if key.strip()]
    found = curve_fit.fit_curves(given, measured, keys, console.meter.run)
    answer, lines = found.as_dict(), curve_fit.lines_of(found)
    if options.out:
        read = [*options.lab, *(path for scenario in given for path in inputs_of(scenario))]
        with history.product("scenario", [toml.text_of(given[0])], read, options.force):
            curve_fit.write(found.scenarios[0], options.out, ", ".join(options.lab))
        answer["file"] = options.out
        lines.append(f"scenario      {options.out}")
    console.result(answer, "\n".join(lines))
    return 0


def _text(fits, confidence: float) -> str:
    from dembrick.views.summary import barred

    lines = [f"friction coefficient, +- half the {100 * confidence:.0f} % confidence interval"]
    for one in fits:
        known = f"{one.mu:.4f}  (no interval from one test)"
        if one.half_width is not None:
            known = " +- ".join(barred(one.mu, one.half_width))
        lines.append(f"\n{one.formulation:16} mu = {known}")
        lines.append(f"{'test':>10}{'measured [N]':>14}{'fitted [N]':>12}{'residual':>10}{'mu alone':>10}")
        for test in one.tests:
            alone = "-" if test["mu"] is None else f"{test['mu']:.4f}"
            lines.append(
                f"{test['test']:>10}{test['V_measured']:14.5g}{test['V_fitted']:12.5g}"
                f"{test['residual_percent']:+z8.1f} %{alone:>10}"
            )
    return "\n".join(lines)
