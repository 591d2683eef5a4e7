"""Verification: cases that ship with the package, each with its source, its reference and the answer of this program.

In go the cases of ``scenarios/verification/cases.toml``; out come rows of value, error bar, error and time, as a table,
as JSON and as an HTML page. Nothing here knows how an answer is found: every case is a scenario that ``simulate`` runs.
"""
