"""Check that this numba has the private names that `_numba` uses, as numba does not guarantee them.

If one is missing, or this version of numba was not tested, `_jit` compiles by numba's public API (`_numba_public`).
``DEMBRICK_NUMBA`` in the environment: "public" selects that always, "private" allows an untested version.
"""

from __future__ import annotations

import os
from contextlib import suppress
from importlib import import_module

import numba

SWITCH = "DEMBRICK_NUMBA"
TRIED = (0, 62), (0, 68)  # first and last version of numba with which all tests passed
USED = (
    "numba._dispatcher.compute_fingerprint",
    "numba.core.caching.FunctionCache._guard_against_spurious_io_errors",
    "numba.core.caching.FunctionCache._impl_class._locator_classes",
    "numba.core.caching.FunctionCache._index_key",
    "numba.core.caching.FunctionCache._load_overload",
    "numba.core.caching.IndexDataCacheFile.load",
    "numba.core.caching.IndexDataCacheFile.save",
    "numba.core.cgutils.create_struct_proxy",
    "numba.core.cgutils.get_or_insert_function",
    "numba.core.cgutils.if_unlikely",
    "numba.core.codegen.JITCodeLibrary._finalize_dynamic_globals",
    "numba.core.codegen.JITCodeLibrary._finalize_final_module",
    "numba.core.codegen.JITCodeLibrary._get_module_for_linking",
    "numba.core.codegen.JITCodeLibrary._optimize_final_module",
    "numba.core.codegen.JITCodeLibrary._set_compiled_object",
    "numba.core.codegen.JITCodeLibrary._unserialize",
    "numba.core.codegen.JITCodeLibrary.enable_object_caching",
    "numba.core.codegen.JITCPUCodegen._library_class",
    "numba.core.compiler.Compiler",
    "numba.core.event.trigger_event",
    "numba.core.registry.CPUDispatcher._compilation_chain_init_hook",
    "numba.core.registry.CPUDispatcher.add_overload",
    "numba.core.registry.CPUDispatcher.typeof_pyval",
    "numba.core.registry.cpu_target.target_context",
    "numba.core.types.BaseNamedTuple",
    "numba.core.typing.typeof.typeof",
    "numba.np.numpy_support.from_dtype",
    "numba.np.numpy_support.map_layout",
)

USED_OF_CODEGEN = ("_engine._defined_symbols", "create_library", "magic_tuple")  # made only on compilation


def moved(names=USED) -> list[str]:
    """Those of some dotted names of numba that are missing in this version."""
    return [name for name in names if not _is_there(name)]


def moved_from(thing, names) -> list[str]:
    """Those of some dotted names that an object lacks."""
    return [name for name in names if not _has(thing, name.split("."))]


def _is_there(name: str) -> bool:
    parts = name.split(".")
    for length in range(len(parts) - 1, 0, -1):
        with suppress(ImportError):
            return _has(import_module(".".join(parts[:length])), parts[length:])
    return False


def _has(thing, parts: list[str]) -> bool:
    for part in parts:
        if not hasattr(thing, part):
            return False
        thing = getattr(thing, part)
    return True


def refusal(version: str = numba.__version__, names=USED) -> str:
    """Reason for not using private names; empty if they are used."""
    switch = os.environ.get(SWITCH)
    if switch == "public":
        return f"{SWITCH} is public"
    first, last = TRIED
    if switch != "private" and not first <= tuple(int(part) for part in version.split(".")[:2]) <= last:
        return f"numba {version} was not tried, {'.'.join(map(str, last))} is the last that was"
    missing = moved(names)
    return f"numba {version} has no {', '.join(missing)}" if missing else ""
