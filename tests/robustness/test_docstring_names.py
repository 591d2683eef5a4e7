"""Names in backticks of docstrings and comments: what they name must be there."""

import ast
import builtins
import importlib.util
import re
from pathlib import Path

import pytest

import dembrick

PACKAGE = Path(dembrick.__file__).parent
NAMED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)")


def sources():
    return sorted(path for path in PACKAGE.rglob("*.py"))


def names_of(tree):
    """Every name that a module defines, imports, assigns or takes as a parameter, at any depth."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.alias):
            yield (node.asname or node.name).split(".")[-1]
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.keyword) and node.arg:
            yield node.arg


@pytest.fixture(scope="module")
def known():
    """Names of each module, by its dotted name without the package, and the modules themselves."""
    found = {}
    for path in sources():
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = set(names_of(ast.parse(path.read_text(encoding="utf-8"))))
    return found


def resolves(name, known):
    """Whether a dotted name is a module, a name in one that ends with its front part, or fields of a known name."""
    parts = name.removeprefix("dembrick.").split(".")
    modules = {one for one in known if one}
    if any(one == ".".join(parts) or one.endswith("." + ".".join(parts)) for one in modules):
        return True
    if len(parts) == 1:
        return any(parts[0] in names for names in known.values())
    for cut in range(len(parts) - 1, 0, -1):
        front, rest = ".".join(parts[:cut]), parts[cut:]
        inside = [known[one] for one in modules if one == front or one.endswith(f".{front}")]
        if inside:
            return any(set(rest) <= names for names in inside)
    if any(parts[0] in names for names in known.values()) or hasattr(builtins, parts[0]):
        return all(any(part in names for names in known.values()) for part in parts[1:])
    return parts[0] in {"numpy", "numba", "h5py"} and importlib.util.find_spec(parts[0]) is not None


def test_names_in_backticks_are_there(known):
    lost = []
    for path in sources():
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            lost += [
                f"{path.relative_to(PACKAGE)}:{number}: {n}" for n in NAMED.findall(line) if not resolves(n, known)
            ]
    assert not lost, "\n".join(lost)
