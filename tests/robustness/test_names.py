"""Names in backticks in docstrings, comments and docs exist in the code, so that a reader can find them."""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

import dembrick
from helpers.places import ROOT

PACKAGE = Path(dembrick.__file__).parent
ROOMS = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"} - {"__init__", "__pycache__"}
QUOTED = re.compile(r"(?<![`\w])`([A-Za-z_][\w./]*)(?:\(\))?`(?!`)")
LIBRARIES = {"numpy", "h5py", "numba"}  # names that begin with these are not checked
GROUPS = {"history"}  # groups of a file: `history/time` is a dataset
SCOPES = ast.Module | ast.ClassDef | ast.FunctionDef


def names_of(body):
    """Names defined in the body of a module or a class; a class maps to the names in its own body."""
    found = {}
    for node in body:
        if isinstance(node, ast.ClassDef):
            found[node.name] = names_of(node.body)
            for base in (base.id for base in node.bases if isinstance(base, ast.Name)):
                found[node.name] |= found.get(base) or {}
        elif isinstance(node, ast.FunctionDef):
            found[node.name] = {}
            attributes = (one for one in ast.walk(node) if isinstance(one, ast.Attribute))
            found |= {one.attr: {} for one in attributes if getattr(one.value, "id", "") == "self"}
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {(alias.asname or alias.name).split(".")[0]: {} for alias in node.names}
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {one.id: {} for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
        elif isinstance(node, ast.If | ast.Try):
            found |= names_of([*node.body, *node.orelse])
    return found


@cache
def modules():
    """Dotted names of the package's modules and packages, and the names that each defines."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(parts).removesuffix(".__init__")] = names_of(ast.parse(path.read_text(encoding="utf-8")).body)
    return found


@cache
def everywhere():
    """Names of all modules, names that they define, and members of classes."""
    found = set()
    for module, names in modules().items():
        found |= {*module.split("."), *names, *(name for inner in names.values() for name in inner)}
    return found


def is_there(name, around=frozenset()):
    """Whether a name is a module, a name defined in one, or a member; ``around`` adds local names."""
    parts = name.replace("/", ".").removesuffix(".py").split(".")
    if len(parts) == 1:
        return name in everywhere() or name in around
    for module, names in modules().items():
        for length in range(len(parts), 0, -1):
            if f".{module}".endswith("." + ".".join(parts[:length])) and within(parts[length:], names):
                return True
        if parts[0] in names and within(parts, names):
            return True
    return parts[0] in around and parts[-1] in everywhere()


def within(parts, names):
    """Whether each name is a member of the one before it."""
    return not parts or (parts[0] in names and within(parts[1:], names[parts[0]]))


def missing_in(path):
    """Names in backticks in a module's docstrings that do not exist."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, SCOPES):
            for name in QUOTED.findall(ast.get_docstring(node) or ""):
                elsewhere = name.split(".")[0] in LIBRARIES or (ROOT / name).is_file()
                if not elsewhere and not is_there(name) and not is_there(name, local_names(node)):
                    yield f"{path.relative_to(PACKAGE)}: `{name}` in {getattr(node, 'name', 'the module')}"


def missing_in_comments(path):
    """Names in backticks in a module's comments that exist neither in the package nor in that module."""
    text = path.read_text(encoding="utf-8")
    if not re.search("#.*`", text):
        return
    around = local_names(ast.parse(text))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            for name in QUOTED.findall(token.string):
                if not is_there(name) and not is_there(name, around):
                    yield f"{path.relative_to(PACKAGE)}:{token.start[0]}: `{name}`"


def local_names(node):
    """Arguments and variables of a function or a class."""
    found = {one.arg for one in ast.walk(node) if isinstance(one, ast.arg)}
    return found | {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


def test_names_in_docstrings_and_comments_are_there():
    missing = [fault for path in sorted(PACKAGE.rglob("*.py")) for fault in missing_in(path)]
    missing += [fault for path in sorted(PACKAGE.rglob("*.py")) for fault in missing_in_comments(path)]
    assert not missing, "\n".join(missing)


def test_names_in_docs_are_there():
    """Only names that begin with the package or one of its subpackages; others are keys, files and commands."""
    missing = []
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    for page in sorted(pages):
        for name in QUOTED.findall(page.read_text(encoding="utf-8")):
            first, *rest = re.split(r"[./]", name)
            if rest and first in {"dembrick", *ROOMS} - GROUPS and not is_there(name):
                missing.append(f"{page.relative_to(ROOT)}: `{name}`")
    assert not missing, "\n".join(missing)


@pytest.mark.parametrize("name", ["kernels.joint.no_such_law", "no_such_name", "kernels/gone", "Kernel.no_such_member"])
def test_what_is_gone_is_found(name):
    assert not is_there(name)


@pytest.mark.parametrize(
    "name", ["kernels.joint.point_law", "joint/point_law", "_numba.Kernel.ready", "Kernel.address"]
)
def test_what_is_there_is_found(name):
    assert is_there(name)


KINDS_FIRST = (
    "assembly",
    "simulation",
    "history",
    "views",
    "runs",
)  # packages whose docstrings already follow the rule; more will be added


@pytest.mark.parametrize("room", KINDS_FIRST)
def test_docstrings_begin_with_the_kind_of_thing(room):
    """A docstring such as "What joints carry" tells a reader neither that it is an array nor of which quantity."""
    found = []
    for path in sorted((PACKAGE / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, SCOPES) and (ast.get_docstring(node) or "").startswith("What "):
                found.append(f"{path.relative_to(PACKAGE)}: {getattr(node, 'name', 'the module')}")
    assert not found, "\n".join(found)
