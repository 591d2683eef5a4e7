"""Verification: cases that ship with the package, each with its source, its reference and the answer of this program.

Input are the cases of ``scenarios/verification/cases.toml``, output are rows of value, error bar, error and time, as a
table, as JSON and as an HTML page. Every case is a scenario that ``simulate`` runs like any other.
"""
