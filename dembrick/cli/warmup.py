"""``dembrick warmup``: compile the kernels into the cache, in one or more processes; no results are kept."""

from __future__ import annotations

FORMULATIONS = ("concave", "convex")


def add_arguments(parser) -> None:
    parser.add_argument("--jobs", type=int, metavar="N", help="number of processes (default: one per core)")
    parser.add_argument("--all", action="store_true", help="also compile what few scenarios need: joints with bonds")


def run(options, console) -> int:
    """Run a small scene for each family of joints and each kind of run, and a batch of limit loads."""
    import os
    import time

    from dembrick._kernel_cache import CACHE_FOLDER
    from dembrick.errors import ScenarioError
    from dembrick.runs.study.executors import run_here, run_local

    if options.jobs is not None and options.jobs < 1:
        raise ScenarioError(f"--jobs = {options.jobs} is out of range: it must be at least 1")
    began = time.perf_counter()
    kinds = (*KINDS, *RARE) if options.all else KINDS
    tasks = [(kind, formulation) for kind in kinds for formulation in FORMULATIONS]
    jobs = min(options.jobs or os.cpu_count() or 1, len(tasks))
    chunks = [[task] for task in tasks]
    done = run_here(_compile, chunks) if jobs == 1 else run_local(_compile, chunks, jobs)
    console.progress(0, len(tasks), "")
    for i, names in enumerate(done):
        console.progress(i + 1, len(tasks), names[0])
    seconds = time.perf_counter() - began
    found = {"seconds": seconds, "jobs": jobs, "cache": str(CACHE_FOLDER)}
    console.result(found, f"warm after {seconds:.1f} s: {CACHE_FOLDER}")
    return 0


def _compile(tasks: list[tuple[str, str]]) -> list[str]:
    """Run scenes that compile the kernels of some kinds; return their names. Several processes may share the cache."""
    for kind, formulation in tasks:
        (KINDS | RARE)[kind](formulation)
    return [f"{kind}, {formulation}" for kind, formulation in tasks]


def _simulate(*scenarios) -> None:
    from dembrick.runs import simulate

    for scenario in scenarios:
        simulate.simulate(scenario)


def _tables(*scenarios) -> None:
    """Run scenarios with a history, and compute the utilisation of joints as figures and tables do."""
    import os
    import tempfile

    from dembrick import history
    from dembrick.runs import simulate
    from dembrick.views.motion.table import joint_table

    with tempfile.TemporaryDirectory() as folder:
        for i, scenario in enumerate(scenarios):
            path = os.path.join(folder, f"{i}.h5")
            simulate.simulate(scenario, path)
            with history.read(path) as found:
                joint_table(found, None, None)


def _scene(formulation: str, control, *free, **strengths):
    """Blocks on a floor: position (m) and velocity (m/s) of each; strengths of their joints."""
    from dembrick.scenario.model import Block, JointLaw, Material, Output, Scenario

    return Scenario(
        title="warm up",
        gravity=(0.0, 0.0, -9.81),
        joint=JointLaw(formulation, 0.64, 1e9, 4e8, **strengths),
        materials={"stone": Material(2000.0)},
        blocks=(
            Block("floor", "stone", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
            *(
                Block(f"block {i}", "stone", (0.3, 0.2, 0.1), place, velocity=velocity)
                for i, (place, velocity) in enumerate(free)
            ),
        ),
        control=control,
        output=Output(("joints", "energy", "frames", "velocity")),
    )


LOW, HIGH = (((0.0, 0.0, z), (0.0, 0.0, 0.0)) for z in (0.05, 0.15))
SLIDING = (0.0, 0.0, 0.05), (0.3, 0.0, 0.0)  # so far that its polygon must be checked
THROWN = (0.5, 0.0, 0.051), (0.0, 0.0, -1.0)


def _motion(formulation: str) -> None:
    """Motion with and without contact detection, in one process, as both share most of their code."""
    from dembrick.scenario.controls import DynamicControl

    _simulate(
        _scene(formulation, DynamicControl(1e-3), SLIDING), _scene(formulation, DynamicControl(2e-3), LOW, THROWN)
    )


def _equilibria(formulation: str) -> None:
    from dembrick.scenario.controls import PushoverControl

    _tables(_scene(formulation, PushoverControl((1.0, 0.0, 0.0), tolerance=1e-2), LOW, HIGH))


def _single_joints(formulation: str) -> None:
    """Single joints: a limit load, a constant-rate test, and a batch of limit loads."""
    from dembrick.runs import domain
    from dembrick.runs.lab import lab_scenario

    _tables(lab_scenario("set4a", formulation), lab_scenario("set4a_curve", formulation))
    domain.simulate_domain(a=0.3, b=0.2, friction=0.64, normal_force=467.0, formulation=formulation, count=4)


def _bonds(formulation: str) -> None:
    """Joints with cohesion, at rest and in motion."""
    from dembrick.scenario.controls import DynamicControl, PushoverControl

    push = PushoverControl((1.0, 0.0, 0.0), tolerance=1e-2)
    _simulate(_scene(formulation, push, LOW, HIGH, cohesion=1e4))
    _simulate(_scene(formulation, DynamicControl(1e-3), LOW, cohesion=1e4))
    _simulate(_scene(formulation, DynamicControl(2e-3), LOW, THROWN, cohesion=1e4))


KINDS = {"motion": _motion, "equilibria": _equilibria, "single joints": _single_joints}  # the longest first
RARE = {"bonds": _bonds}
