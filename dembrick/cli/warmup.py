"""``dembrick warmup``: compile the kernels into the cache, one process, nothing kept."""

from __future__ import annotations

SIMULATES = True  # and so may compile


def add_arguments(parser) -> None:
    """No options beyond the common ones."""


def run(options, console) -> int:
    """Run one small scene of each family of joints and each way to run, and a few limit loads together."""
    import time

    from dembrick._jit import CACHE_FOLDER
    from dembrick.runs import domain
    from dembrick.runs.simulate import simulate

    began = time.perf_counter()
    scenes = _scenes()
    for i, (name, scenario) in enumerate(scenes.items()):
        console.progress(i, len(scenes) + 1, name)
        simulate(scenario)
    console.progress(len(scenes), len(scenes) + 1, "limit loads together")
    for formulation in ("concave", "convex"):
        domain.simulate_domain(a=0.3, b=0.2, friction=0.64, normal_force=467.0, formulation=formulation, count=4)
    console.progress(len(scenes) + 1, len(scenes) + 1, "")
    seconds = time.perf_counter() - began
    console.result({"seconds": seconds, "cache": str(CACHE_FOLDER)}, f"warm after {seconds:.1f} s: {CACHE_FOLDER}")
    return 0


def _scenes() -> dict:
    """Scenes by what they compile."""
    from dembrick.runs.lab import lab_scenario
    from dembrick.scenario.controls import DynamicControl, PushoverControl
    from dembrick.scenario.model import Block, JointLaw, Material, Output, Scenario

    def scene(formulation, control, *free) -> Scenario:
        return Scenario(
            title="warm up",
            gravity=(0.0, 0.0, -9.81),
            joint=JointLaw(formulation, 0.64, 1e9, 4e8),
            materials={"stone": Material(2000.0)},
            blocks=(
                Block("floor", "stone", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
                *(
                    Block(f"block {i}", "stone", (0.3, 0.2, 0.1), place, velocity=(0.0, 0.0, speed))
                    for i, (place, speed) in enumerate(free)
                ),
            ),
            control=control,
            output=Output(("joints", "energy", "frames", "velocity")),
        )

    low, high, thrown = ((0.0, 0.0, 0.05), 0.0), ((0.0, 0.0, 0.15), 0.0), ((0.5, 0.0, 0.051), -1.0)
    push = PushoverControl((1.0, 0.0, 0.0), tolerance=1e-2)
    found = {}
    for formulation in ("concave", "convex"):
        found[f"limit load, {formulation}"] = lab_scenario("set4a", formulation)
        found[f"constant rate, {formulation}"] = lab_scenario("set4a_curve", formulation)
        found[f"equilibria, {formulation}"] = scene(formulation, push, low, high)
        found[f"motion, {formulation}"] = scene(formulation, DynamicControl(1e-3), low)
        found[f"impact, {formulation}"] = scene(formulation, DynamicControl(2e-3), low, thrown)
    return found
