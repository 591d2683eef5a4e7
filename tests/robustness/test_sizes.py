"""Limits on the length of modules and functions, and on the number of parameters of a function."""

import ast
from collections import Counter
from pathlib import Path

import dembrick

PACKAGE, TESTS = Path(dembrick.__file__).parent, Path(__file__).parents[1]
MODULE, FUNCTION, PARAMETERS, MOST = 450, 100, 10, 12
ROOM = 26  # modules in a folder


def functions(kernels=True):
    """Functions of the package, with the names of their modules."""
    for path in sorted(PACKAGE.rglob("*.py")):
        if kernels or path.relative_to(PACKAGE).parts[0] != "kernels":
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    yield f"{path.relative_to(PACKAGE)}: {node.name}", node


def test_modules_can_be_read_at_a_sitting():
    for root in (PACKAGE, TESTS):
        lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in root.rglob("*.py")}
        assert len(lines) > 50
        assert not {str(path): n for path, n in lines.items() if n > MODULE}


def test_folders_can_be_taken_in_at_a_glance():
    count = Counter(path.parent for path in PACKAGE.rglob("*.py"))
    assert not {str(folder): n for folder, n in count.items() if n > ROOM}


def test_functions_are_short():
    assert not [name for name, node in functions(kernels=False) if node.end_lineno - node.lineno >= FUNCTION]


def test_few_functions_have_many_parameters():
    many = {}
    for name, node in functions():
        given = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        count = len([a for a in given if a not in ("self", "cls")])
        if count > PARAMETERS:
            many[name] = count
    assert len(many) <= 5 and max(many.values()) <= MOST, many
