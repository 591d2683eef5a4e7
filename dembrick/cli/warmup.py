"""``dembrick warmup``: compile the kernels into the cache, one process, nothing kept."""

from __future__ import annotations


def add_arguments(parser) -> None:
    """No options beyond the common ones."""


def run(options, console) -> int:
    """Run one small test of each family of joints and each kind of control."""
    import time

    from dembrick._jit import CACHE_FOLDER
    from dembrick.lab import lab_scenario
    from dembrick.result import simulate

    began = time.perf_counter()
    cases = [(name, f) for name in ("set4a", "set4a_curve") for f in ("concave", "convex")]
    for i, (name, formulation) in enumerate(cases):
        console.progress(i, len(cases), f"{name} {formulation}")
        simulate(lab_scenario(name, formulation))
    console.progress(len(cases), len(cases), "")
    seconds = time.perf_counter() - began
    console.result({"seconds": seconds, "cache": str(CACHE_FOLDER)}, f"warm after {seconds:.1f} s: {CACHE_FOLDER}")
    return 0
