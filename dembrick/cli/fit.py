"""``dembrick fit --lab DATA.csv``."""

from __future__ import annotations


def add_arguments(parser) -> None:
    parser.add_argument(
        "--lab", metavar="DATA.csv", required=True, help="measured yield points: columns test, scenario, V [N]"
    )
    parser.add_argument("--formulation", nargs="+", metavar="F", help="default: all five")


def run(options, console) -> int:
    """Print mu under each formulation, with its confidence interval and the residual of every test."""
    from dembrick.errors import ScenarioError
    from dembrick.runs import fit
    from dembrick.scenario.checks import nearest, show
    from dembrick.scenario.model import FORMULATIONS

    for name in options.formulation or ():
        if name not in FORMULATIONS:
            raise ScenarioError(f"--formulation {show(name)} is unknown; {nearest(name, FORMULATIONS)}")
    fits = fit.fit(fit.read(options.lab), options.formulation or FORMULATIONS, console.progress)
    console.result({"confidence": fit.CONFIDENCE, "fits": fit.as_dicts(fits)}, _text(fits, fit.CONFIDENCE))
    return 0


def _text(fits, confidence: float) -> str:
    lines = [f"friction coefficient, +- half the {100 * confidence:.0f} % confidence interval"]
    for one in fits:
        half = "  (one test: no interval)" if one.half_width is None else f" +- {one.half_width:.4f}"
        lines.append(f"\n{one.formulation:16} mu = {one.mu:.4f}{half}")
        lines.append(f"{'test':>10}{'measured [N]':>14}{'fitted [N]':>12}{'residual':>10}{'mu alone':>10}")
        for test in one.tests:
            alone = "-" if test["mu"] is None else f"{test['mu']:.4f}"
            lines.append(
                f"{test['test']:>10}{test['V_measured']:14.5g}{test['V_fitted']:12.5g}"
                f"{test['residual_percent']:+8.1f} %{alone:>10}"
            )
    return "\n".join(lines)
