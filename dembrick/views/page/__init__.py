"""One web page that holds a whole run: the motion in 3D, the curve, the path on the yield domain, the numbers.

The page is a single file that needs no network. A history may come from an untrusted source, so all its texts are
escaped, and a content security policy lets the page run only its own script, identified by its hash.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from html import escape
from importlib import resources
from string import Template
from typing import TYPE_CHECKING

import dembrick
from dembrick import history as histories
from dembrick.errors import OutputError
from dembrick.history.files import check_output, write_whole
from dembrick.views.key_numbers import key_numbers
from dembrick.views.motion.frames import START
from dembrick.views.page import content

if TYPE_CHECKING:
    from dembrick.history.reader import History

ENDINGS = (".html", ".htm")
_SCRIPTS = ("viewer.js", "charts.js", "page.js")
_LONGEST_TEXT = 200_000  # characters of the scenario shown at most


def write(history: History, path: str | os.PathLike) -> str:
    """Write the page of a history, or of a history file, to ``path``; returns the path.

    Raises OutputError for a path that cannot be written, HistoryError if the history holds nothing to show.
    """
    path = os.fspath(path)
    if os.path.splitext(path)[1].lower() not in ENDINGS:
        raise OutputError(f"{path}: a page is written as HTML; its name must end in .html")
    check_output(path)  # before the work
    if isinstance(history, str | os.PathLike):
        with histories.read(history) as opened:
            text = document(opened)
    else:
        text = document(history)
    write_whole(path, text, "page")
    return path


def document(history: History) -> str:
    """The page as text."""
    data = content.collect(history)
    script = "\n".join(_own(name) for name in _SCRIPTS)
    style = _own("style.css")
    scenario = history.scenario_text
    if len(scenario) > _LONGEST_TEXT:
        scenario = scenario[:_LONGEST_TEXT] + f"\n... and {len(scenario) - _LONGEST_TEXT} characters more"
    return Template(_own("template.html")).substitute(
        version=escape(dembrick.__version__),
        title=escape(history.title or os.path.basename(history.path)),
        subtitle=escape(_subtitle(history)),
        moment="Equilibrium" if history.counts_equilibria else "Time",
        legend=escape(_legend(data)),
        frames_note=escape(_frames_note(history, data)),
        results=results_table(history.results, history.curve.unit),
        record_note=escape(_record_note(history, data)),
        scenario=escape(scenario),
        footer=escape(_origin(history)),
        style=style,
        style_hash=_hash(style),
        script=script,
        script_hash=_hash(script),
        data=_as_script(data),
    )


def fragment(result) -> str:
    """HTML of a result for a notebook: the title, the key numbers with their error bars, the curve."""
    text = f"<strong>{escape(result.scenario.title)}</strong>{results_table(result.results, result.curve.unit)}"
    if len(result.rows.get("load", ())):
        from dembrick.views import plot

        text += plot.inline_svg(plot.force_displacement([result]))
    return text


def results_table(results: dict, unit: str = "N") -> str:
    """The key numbers of a run as an HTML table; ``unit``: that of its load, "1" for a load factor."""
    lines = key_numbers(results, unit)
    if not lines:
        return "<p>There are no results yet: the run has not ended.</p>"
    rows = []
    for name, value, remark in lines:
        note = f'<br><small class="quiet">{escape(remark)}</small>' if remark else ""
        rows.append(f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}{note}</td></tr>')
    return f"<table>{''.join(rows)}</table>"


def _own(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _as_script(data: dict) -> str:
    """JSON that can neither close the script element that holds it nor open a comment in it."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _subtitle(history: History) -> str:
    """One line: formulation, status, number of blocks and joints."""
    results = history.results
    formulation = results.get("formulation")
    words = [f"formulation {formulation}"] if isinstance(formulation, str) else []
    told = {"running": "still running, or stopped before its end", START: "before the run"}
    words.append(told.get(history.status, history.status))
    joints = "1 joint" if history.n_joint == 1 else f"{history.n_joint} joints"
    return ", ".join([*words, f"{history.n_block} blocks, {joints}"])


def _legend(data: dict) -> str:
    """Legend of the lines and arrows of the 3D picture."""
    words = "Grey lines: initial position."
    if data["actuators"]:
        words += " Orange arrows: actuators, length by load."
    if data["loads"]:
        words += " Violet arrows: dead loads."
    if data["ties"]:
        words += " Magenta rods: ties."
    if data["centre"]:
        words += " Blue rod: the torsion centre of the joint."
    return words


def _frames_note(history: History, data: dict) -> str:
    """Note on how many frames are shown; empty if all are."""
    shown = len(data["time"])
    return "" if shown == history.n_frames else f"{shown} of {history.n_frames} recorded frames are shown."


def _record_note(history: History, data: dict) -> str:
    """Note on the record offered for download."""
    if data["record"] is None:
        return "No row was recorded."
    joint = " and the chosen joint's forces" if data["joints"] else ""
    some = "" if data["record"]["rows"] == history.n_row else f" {data['record']['rows']} of {history.n_row} rows;"
    return f"Time, load, displacement{joint}.{some} dembrick export writes everything."


def _origin(history: History) -> str:
    """Provenance of the page: the history file and the versions of the programs."""
    versions = [f"{name} {version}" for name, version in history.versions.items()]
    return f"dembrick {dembrick.__version__} made this page from {os.path.basename(history.path)}. The run: " + (
        ", ".join(versions) or "no versions recorded"
    )
