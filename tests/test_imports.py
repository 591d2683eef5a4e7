"""Which module may import which: arrows point down only, wherever in a module the import stands."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import dembrick

PACKAGE = Path(dembrick.__file__).parent

# Rank of a module by its place in the house; an import must go to a lower rank. Modules of the same rank may not
# import one another, except inside one folder named in TOGETHER.
FLOORS = {
    -1: ["errors"],
    -0.95: ["interruption"],
    -0.9: ["checks"],
    -0.85: ["magnitudes"],
    -0.8: ["blocks", "memory"],
    -0.75: ["controls"],
    -0.7: ["generators"],
    0: ["_jit", "state", "model"],
    1: ["kernels"],
    2: ["polygons"],
    2.5: ["cases"],
    3: ["shapes"],
    3.1: ["polyhedra"],
    3.15: ["mesh_file"],
    3.2: ["solids"],
    4: ["neighbours", "limit_set", "clipping"],
    4.5: ["facing"],
    5: ["point_rules"],
    6: ["joints"],
    6.5: ["point_table", "body_forces"],
    6.6: ["attachments"],
    7: ["assembly", "simulation"],
    7.1: ["moving_state", "driving"],
    7.2: ["moving_polygons", "frequencies", "pushing"],
    7.3: ["touching_state"],
    7.4: ["audit"],
    7.5: ["motion_books"],
    8: ["session", "stability", "certificate", "elastic"],
    8.5: ["meetings"],
    9: ["recorder", "snapshots", "yield_point", "dynamics"],
    9.5: ["equilibrium", "equilibria", "path_limit", "way"],
    10: ["stepping", "motion_run", "quasi_static"],
    10.5: ["guards", "steadiness"],
    11: ["replay"],
    12: ["batch"],
    13: ["yield_domain"],
}
RANK = {name: rank for rank, names in FLOORS.items() for name in names}
TOP = 20  # files, screens, arguments: everything that is not named above
TOGETHER = {"kernels", "theory", "generators"}
KERNELS_MAY = {"_jit", "kernels", "state"}  # of the package
THEORY_MAY = {"errors", "theory"}
ALLOWED_OUTSIDE = {  # third-party modules by rank: no files and no screens below the top
    **dict.fromkeys((-1, -0.95, -0.9, -0.85, -0.8, -0.75, -0.7), set()),
    0: {"numba", "numpy"},
    1: {"numpy"},
    **{rank: {"numpy"} for rank in FLOORS if rank > 1},
    3.15: {"numpy", "meshio"},  # the one module that reads mesh files, imported when a scene has one
}


def modules():
    """Dotted names of all modules, without the package's own, and their trees."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        yield name, path, ast.parse(path.read_text(encoding="utf-8"))


def imported(tree, name, path):
    """Absolute dotted names that a module imports anywhere in it; names out of a package count as its modules."""
    package = ["dembrick", *name.split(".")] if path.name == "__init__.py" else ["dembrick", *name.split(".")[:-1]]
    package = [part for part in package if part]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
            for alias in node.names:
                inner = PACKAGE.joinpath(*f"{base}.{alias.name}".split(".")[1:])
                is_module = base.split(".")[0] == "dembrick" and (inner.with_suffix(".py").exists() or inner.is_dir())
                yield f"{base}.{alias.name}" if is_module else base
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in (
            "import_module",
            "__import__",
        ):
            yield from (argument.value for argument in node.args[:1] if isinstance(argument, ast.Constant))


def head(module):
    return module.split(".")[0]


def arrows(found):
    """(module, module it imports) inside the package, and (module, third-party module)."""
    inside, outside = set(), set()
    for name, path, tree in found:
        for target in imported(tree, name, path):
            if head(target) == "dembrick":
                inside.add((name, target.partition(".")[2]))
            elif head(target) not in sys.stdlib_module_names:
                outside.add((name, head(target)))
    return inside, outside


def rank(module):
    return RANK.get(head(module), TOP)


def wrong(inside, outside):
    """Arrows that break a rule, as text."""
    faults = []
    for name, target in sorted(inside):
        here, there = head(name), head(target)
        if here in TOGETHER and here == there:
            continue
        if here == "kernels" and there not in KERNELS_MAY:
            faults.append(f"{name} -> {target}: kernels know nothing of the package but _jit")
        if here == "theory" and there not in THEORY_MAY:
            faults.append(f"{name} -> {target}: theory imports errors and itself only")
        if there == "theory" and rank(name) < TOP:
            faults.append(f"{name} -> {target}: nothing below the top imports theory")
        if here != "theory" and rank(name) < TOP and rank(target) >= rank(name):
            faults.append(f"{name} -> {target}: not downward")
        if here == "" and there == "":
            faults.append("the package imports itself")
    for name, target in sorted(outside):
        here = head(name)
        if here == "theory" and target != "numpy":
            faults.append(f"{name} -> {target}: theory needs numpy only")
        if rank(name) < TOP and target not in ALLOWED_OUTSIDE[rank(name)]:
            faults.append(f"{name} -> {target}: not on this floor")
        if target == "scipy":
            faults.append(f"{name} -> scipy: the package does without")
    return faults


def test_every_arrow_points_down():
    inside, outside = arrows(modules())
    assert len(inside) > 50
    assert not wrong(inside, outside), "\n".join(wrong(inside, outside))


def test_every_ranked_module_exists():
    assert not [name for name in RANK if not (PACKAGE / f"{name}.py").exists() and not (PACKAGE / name).is_dir()]


def test_kernels_are_in_order():
    """vec3, skyline, band < laws, pressed < limit_surface < motion < contact < energy < forces < bracket < advance."""
    order = ["vec3", "skyline", "band", "laws", "pressed", "limit_surface", "gauge", "small_motion", "finite_motion"]
    order += ["contact", "energy", "guard", "forces", "tangent", "bracket", "record", "advance", "lanes", "bodies"]
    order += ["books", "point_joints", "convex_joints", "motion_record", "patches", "rubbing", "handing_over"]
    order += ["contact_springs", "touching", "dynamics", "dynamics_parallel", "certify", "batch", "recorded_motion"]
    inside, _ = arrows(modules())
    for name, target in inside:
        if head(name) == head(target) == "kernels" and "." in name:
            here, there = name.split(".")[1], target.split(".")[1]
            assert order.index(there) < order.index(here), f"{name} -> {target}"


def test_no_circle_at_the_top():
    inside, _ = arrows(modules())
    graph = {}
    for name, target in inside:
        if name and target and name != "__main__":
            graph.setdefault(name, set()).add(target)
    done, path = set(), []

    def visit(name):
        assert name not in path, " -> ".join([*path[path.index(name) :], name])
        if name not in done:
            path.append(name)
            for target in graph.get(name, ()):
                if target != name:
                    visit(target)
            path.pop()
            done.add(name)

    for name in list(graph):
        visit(name)


@pytest.mark.parametrize(
    "name, source",
    [
        ("replay", "from dembrick import theory"),
        ("simulation", "def f():\n    from dembrick.theory import limit_load"),
        ("joints", "import dembrick.replay"),
        ("kernels.laws", "from dembrick import model"),
        ("kernels.laws", "from ..simulation import State"),
        ("theory.equations", "from dembrick.kernels.laws import coulomb"),
        ("theory.equations", "from dembrick.state import Blocks"),
        ("theory.equations", "import scipy.optimize"),
        ("yield_point", "import importlib\nimportlib.import_module('dembrick.judge')"),
        ("assembly", "import h5py"),
        ("polygons", "from . import shapes"),
        ("polygons", "from .shapes import box"),
        ("plot", "import scipy"),
    ],
)
def test_a_wrong_arrow_is_found(name, source):
    path = PACKAGE.joinpath(*name.split(".")).with_suffix(".py")
    assert wrong(*arrows([(name, path, ast.parse(source))]))


def loaded_after(code, *arguments):
    """Top-level modules in memory after running ``code`` in a fresh interpreter."""
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}
    report = "\nimport sys; print('LOADED', *sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run(
        [sys.executable, "-c", code + report, *arguments], env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rpartition("LOADED")[2].split()), done.stdout


@pytest.mark.parametrize("argument", ["--help", "--version"])
def test_help_loads_nothing_heavy(argument):
    code = f"""
from dembrick.cli import main
try:
    code = main([{argument!r}])
except SystemExit as stop:
    code = stop.code
assert not code, code
"""
    loaded, text = loaded_after(code)
    assert "dembrick" in text.partition("LOADED")[0]
    assert not loaded & {"numpy", "numba", "h5py", "pyvista", "vtk", "matplotlib", "scipy", "meshio"}


def test_a_plain_run_loads_no_screens():
    loaded, _ = loaded_after("import dembrick.result, dembrick.history")
    assert {"numpy", "numba", "h5py"} <= loaded
    assert not loaded & {"pyvista", "vtk", "vtkmodules", "matplotlib", "meshio"}


def test_a_warm_run_does_not_prepare_to_compile():
    """Machine code that is there already is loaded without what numba needs to make some, to the same answer."""
    code = """
import sys
from dembrick.lab import lab_scenario
from dembrick.result import simulate
print(simulate(lab_scenario('set4a', 'concave')).yield_point.V, 'numba.np.linalg' in sys.modules)
"""
    (first, _), (V, prepared) = (loaded_after(code)[1].split()[:2] for _ in range(2))  # the first fills the cache
    assert V == first and prepared == "False"


def test_the_package_asks_for_no_scipy():
    """numba takes scipy up where it is installed; the package itself runs where it cannot be found."""
    code = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] == 'scipy':
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Refuse())
import dembrick
from dembrick import judge, lab, result, history
"""
    loaded, _ = loaded_after(code)
    assert "scipy" not in loaded
