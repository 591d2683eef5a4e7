"""Names at the top of the package: imported when they are used, and known to type checkers all the same."""

import ast
from pathlib import Path

import dembrick


def test_every_name_is_imported_for_type_checkers():
    tree = ast.parse(Path(dembrick.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {(alias.asname or alias.name): node.module for node in block.body for alias in node.names}
    assert typed == dembrick._HOMES
    assert sorted([*typed, "__version__"]) == sorted(dembrick.__all__)


def test_every_name_is_there():
    for name in dembrick.__all__:
        assert getattr(dembrick, name) is not None


def test_the_package_says_that_it_has_types():
    assert (Path(dembrick.__file__).parent / "py.typed").is_file()
