"""Hashes of the kernels' sources, which name cached machine code so that none is used after an edit of its source.

numba's own cache checks only the file of a kernel, and would continue to use old machine code after an edit in a module
that the kernel imports. Here each kernel's machine code has the hash of its module and of all that the module imports.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

import numba

PACKAGE = Path(__file__).parent
# Besides numba, files on which all machine code depends.
TOOLS = ("_jit.py", "_kernel_cache.py", "_numba.py", "_numba_check.py", "_numba_public.py")
_IMPORT = re.compile(r"^[ ]*(?:from ([\w.]+) import (?:\(([^)]*)\)|([^\n]*))|import ([^\n]*))", re.M)
_NAME = re.compile(r"([\w.]+)(?: as \w+)?")
_COMMENT = re.compile(r"#[^\n]*")


@cache
def kernel_hash() -> str:
    """Hash of everything that affects machine code, for the sources at the first call."""
    return source_hash(PACKAGE)


def source_hash(package: Path) -> str:
    """Hash of the compiler (`compiler_hash`) and of all kernel sources in a copy of the package, at any depth."""
    digest = hashlib.sha256(compiler_hash(package).encode())
    for source in sorted((package / "kernels").rglob("*.py")):
        digest.update(_entry(package, source))
    return digest.hexdigest()[:16]


def compiler_hash(package: Path = PACKAGE) -> str:
    """Hash of everything on which all machine code depends.

    For numba this is its version, its bounds checks (``NUMBA_BOUNDSCHECK``) and its optimisation level (``NUMBA_OPT``),
    which its own cache ignores. The path is not included: copies with equal sources share machine code.
    """
    digest = hashlib.sha256(f"{numba.__version__} {numba.config.BOUNDSCHECK} {numba.config.OPT}".encode())
    for name in TOOLS:
        digest.update(_entry(package, package / name))
    return digest.hexdigest()[:16]


@cache
def closure_hash(module: str, package: Path = PACKAGE) -> str:
    """Hash of a kernel module and of all kernel modules that it imports, directly or not."""
    digest = hashlib.sha256(module.encode())
    for source in sorted(import_closure(module, package)):
        digest.update(_entry(package, source))
    return digest.hexdigest()[:16]


def import_closure(module: str, package: Path = PACKAGE) -> set[Path]:
    """Files of a module (its dotted name) and of all kernel modules that it imports, directly or not."""
    found: set[Path] = set()
    open_ends = [source_of(module, package)]
    while open_ends:
        source = open_ends.pop()
        if source is not None and source not in found:
            found.add(source)
            open_ends.extend(imported(source, package))
    return found


@cache
def imported(source: Path, package: Path) -> tuple[Path, ...]:
    """Files of the kernel modules that a source imports, at any place in it."""
    found = []
    for origin, listed, line, plain in _IMPORT.findall(source.read_text(encoding="utf-8")):
        given = _NAME.findall(_COMMENT.sub("", listed or line or plain))
        module = source_of(origin, package) if origin else None
        found.append(module)
        if not origin or module is not None and module.name == "__init__.py":
            found += [source_of(f"{origin}.{name}".lstrip("."), package) for name in given]
    return tuple(dict.fromkeys(path for path in found if path is not None))


def source_of(module: str, package: Path = PACKAGE) -> Path | None:
    """File of a kernel module by its dotted name; None if it is not a kernel module."""
    first, *rest = module.split(".")
    if first != PACKAGE.name or rest[:1] != ["kernels"]:
        return None
    place = package.joinpath(*rest)
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def _entry(package: Path, source: Path) -> bytes:
    return f"\n{source.relative_to(package).as_posix()}\n".encode() + source.read_bytes()
