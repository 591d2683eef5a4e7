"""``dembrick verify [CASE ...]``: the verification cases, or laboratory tests, that ship with the package."""

from __future__ import annotations

from dembrick.cli.paths import add_force, require_ending
from dembrick.cli.streams import print_output


def add_arguments(parser) -> None:
    parser.add_argument("case", nargs="*", help="cases by name or by the beginning of their names (default: all)")
    parser.add_argument("--validation", action="store_true", help="compare with laboratory tests; takes minutes")
    parser.add_argument("--quick", action="store_true", help="run only a few cases, in seconds")
    parser.add_argument("--list", action="store_true", help="list the cases without running them")
    parser.add_argument("--report", metavar="FILE.html", help="write the table as a web page")
    add_force(parser)


def run(options, console) -> int:
    """Run the cases; exit code 3 if a verification case fails. A validation test that is not met is a finding: 0."""
    from dembrick import history
    from dembrick.runs.validation import cases as validation
    from dembrick.runs.verification import cases as verification

    cases = validation if options.validation else verification
    picked = cases.chosen(options.case, options.quick)
    if options.list:
        console.result(
            {"cases": [{"case": case.name, "title": case.title, "source": case.source} for case in picked]},
            "\n".join(f"{case.name:28} {case.title}" for case in picked),
        )
        return 0
    kind = "validation" if options.validation else "verification"
    with history.product(f"{kind} report", [case.name for case in picked], force=options.force):
        if options.report:
            require_ending(options.report, (".html",), "a report")
            history.check_output(options.report)  # refused before the cases run
        return _validate(picked, options, console) if options.validation else _verify(picked, options, console)


def _table(picked, console, module, execute) -> list:
    """Outcomes of the cases by ``execute``, each printed as a row of the table of its ``module``."""
    found: list = []
    if not console.json:
        print_output(module.text_header())
    for one in execute(picked, lambda case: console.progress(len(found), len(picked), case.name)):
        found.append(one)
        if not console.json:
            console.progress(len(found), len(picked), "")
            print_output(module.text_row(one))
    return found


def _verify(picked, options, console) -> int:
    from dembrick import __version__, history
    from dembrick.runs.verification import verify

    outcomes: list[verify.Outcome] = _table(picked, console, verify, verify.verify)
    passed = all(outcome.passed for outcome in outcomes)
    rows = [outcome.as_dict() for outcome in outcomes]
    console.result({"cases": rows, "passed": passed, "version": __version__}, verify.summary(outcomes))
    if options.report:
        history.write_whole(options.report, verify.html(outcomes, __version__), "report")
    for outcome in outcomes:
        if not outcome.passed:
            console.error(f"{outcome.case.name}: {outcome.failure or _why(outcome)}")
    return 0 if passed else 3


def _validate(picked, options, console) -> int:
    from dembrick import __version__, history
    from dembrick.runs.validation import compare

    found: list[compare.Comparison] = _table(picked, console, compare, compare.compare)
    rows = [one.as_dict() for one in found]
    console.result({"cases": rows, "version": __version__}, f"{compare.summary(found)}\n{compare.remarks(found)}")
    if options.report:
        history.write_whole(options.report, compare.html(found, __version__), "report")
    return 0


def _why(outcome) -> str:
    from dembrick.runs.verification.verify import error_text

    if outcome.case.relation == "at most":
        return f"above its bound by {error_text(outcome)}"
    if abs(outcome.error) > outcome.case.tolerance:
        return f"off by {error_text(outcome)}, more than its tolerance of {100 * outcome.case.tolerance:g} %"
    return "the reference lies outside the error bar"
