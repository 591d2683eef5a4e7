"""The validation table: comparisons as text and as an HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from dembrick.runs.validation.compare import Comparison
from dembrick.runs.verification.report import STYLE


def verdict(found: Comparison) -> str:
    """In a word: within, outside, or no answer."""
    return "no answer" if found.within is None else "within" if found.within else "OUTSIDE"


def number(value: float | None) -> str:
    """Four digits, or a dash for what there is none of."""
    return "-" if value is None else f"{value:.4g}"


def small(value: float | None) -> str:
    """Two digits, or a dash for what there is none of."""
    return "-" if value is None else f"{value:.2g}"


def text_row(found: Comparison) -> str:
    """One line of the table on the terminal."""
    case = found.case
    mark = "*" if case.scatter_of else " "
    error = "-" if found.E is None else f"{found.E:+.3g}"
    percent = "-" if found.E is None else f"{100.0 * found.E / case.D:+.1f} %"
    unit = "" if case.unit == "1" else case.unit
    return (
        f"{case.name:17} {number(case.D):>8} {small(case.u_D):>8}{mark} {number(found.S):>8} {small(found.u_num):>9} "
        f"{error:>8} {percent:>9} {unit:3} {found.seconds:6.1f} s  {verdict(found)}"
    )


def text_header() -> str:
    """The heads of the columns of :func:`text_row`."""
    return (
        f"{'case':17} {'D':>8} {'u_D':>8}  {'S':>8} {'u_num':>9} {'E':>8} {'E / D':>9} {'':3} {'time':>6}    "
        "|E| and what is open"
    )


def summary(found: Sequence[Comparison]) -> str:
    """How many are met, and what the columns say."""
    met = sum(one.within is True for one in found)
    seconds = sum(one.seconds for one in found)
    lines = [
        f"{met} of {len(found)} tests are met: |E| = |S - D| within the root of u_D^2 + u_num^2, {seconds:.1f} s",
        "D measured, u_D half the range of all peaks, S simulated, u_num its error bar without what was not known.",
    ]
    if any(one.case.scatter_of for one in found):
        names = sorted({one.case.scatter_of for one in found if one.case.scatter_of})
        lines.append(f"* one value only: u_D relative as of {', '.join(names)}, the largest of the others.")
    return "\n".join(lines)


def remarks(found: Sequence[Comparison]) -> str:
    """Inputs and what was not known, once for the cases of one series; then what single cases show or lack."""
    lines, last = [], ""
    for one in found:
        case = one.case
        if case.source != last:
            unknown = f"  not known   {case.unknown}"
            lines += ["", f"{case.title}: {case.source}", f"  inputs      {case.inputs}", unknown]
            last = case.source
        lines += [f"  {case.name}: {said}" for said in (case.finding, one.failure) if said]
    return "\n".join(lines)


def html(found: Sequence[Comparison], version: str) -> str:
    """The page of the report."""
    rows = "\n".join(_html_row(one) for one in found)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>dembrick {escape(version)}: validation</title><style>{STYLE}</style></head>
<body><h1>Validation of dembrick {escape(version)}</h1>
<p>{escape(summary(found))}</p>
<table><thead><tr><th>test</th><th>source, inputs, not known</th><th>D</th><th>u_D</th><th>S</th><th>u_num</th>
<th>E</th><th></th></tr></thead><tbody>
{rows}
</tbody></table></body></html>
"""


def _html_row(found: Comparison) -> str:
    case = found.case
    changes = "".join(f" --set {escape(change)}" for change in case.set)
    said = "".join(f"<br><small>{escape(text)}</small>" for text in (case.finding, found.failure) if text)
    unit = "" if case.unit == "1" else f" {case.unit}"
    numbers = (
        number(case.D) + unit,
        small(case.u_D),
        number(found.S) + unit,
        small(found.u_num),
        "-" if found.E is None else f"{found.E:+.3g}",
    )
    cells = "".join(f"<td class=n>{escape(text)}</td>" for text in numbers)
    return (
        f"<tr><td>{escape(case.title)}, {escape(case.load)}<br><small><code>{escape(case.name)}: "
        f"{escape(case.scenario)}{changes}</code></small></td><td>{escape(case.source)}<br><small>{escape(case.inputs)}."
        f"<br>Not known: {escape(found.unknown)}</small>{said}</td>{cells}"
        f"<td class='{'' if found.within else 'bad'}'>{verdict(found)}</td></tr>"
    )
