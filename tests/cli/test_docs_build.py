"""The documentation build reports why a cell of a tutorial failed."""

from dembrick.scenario import keys
from helpers.places import tool_module

build_docs, reference_pages = tool_module("build_docs"), tool_module("reference_pages")


def test_the_reason_of_a_failed_cell_is_found(tmp_path):
    log = tmp_path / "python.err.log"
    log.write_text(
        "Traceback (most recent call last):\n  File x\n\x1b[31mMissingDependency\x1b[0m: a table needs pandas\n\n"
        "myst_nb.core.execute.base.ExecutionError: docs/tutorials/python.md\n"
    )
    assert build_docs.last_error(log) == "MissingDependency: a table needs pandas"
    assert build_docs.LOG.findall(f"traceback saved in: {log} (see it)") == [str(log)]


def test_the_key_reference_tells_what_docstrings_tell():
    told = " ".join(reference_pages.plain(keys.tables()["[[walls]]"]).split())
    assert "left end of the wall's axis" in told and "name.left.course.number" in told
