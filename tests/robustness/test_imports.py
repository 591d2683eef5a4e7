"""Which module may import which: imports follow one order of layers, wherever in a module they stand."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import dembrick
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate

PACKAGE = Path(dembrick.__file__).parent

# A package imports only from those named before it. In addition, kernels import only _jit; within them statics and
# dynamics use math and joint, never each other; theory imports only errors; only views, runs and cli import theory.
PACKAGES = ["geometry", "scenario", "assembly", "kernels", "theory", "simulation", "history", "views", "runs", "cli"]
COMPILER = {
    "_jit",
    "_numba",
    "_numba_check",
    "_numba_public",
    "_kernel_cache",
    "_kernel_sources",
    "_packaged_kernels",
    "_pointer_law",
    "_ahead",
}
GROUND = {"", "errors"} | COMPILER
OUTSIDE = {  # third-party modules that a package may import; packages not named here: any but scipy
    "geometry": {
        "numpy",
        "meshio",
        "pyvista",
    },  # in mesh_file and cad_file, imported only if a scene has a mesh or a model
    "scenario": {"numpy"},
    "assembly": {"numpy"},
    "kernels": {"numpy"},
    "theory": {"numpy"},
    "simulation": {"numpy"},
    "history": {"numpy", "h5py"},
}
OPTIONAL = {  # imported only inside functions or for type checkers
    "simulation.limit_analysis.solver": {"clarabel", "scipy"},
    "scenario.model": {"typing_extensions"},
    "history.reader": {"pandas", "xarray"},
    "history.tables": {"pandas", "xarray"},
}


def modules():
    """(dotted name without that of the package, path, syntax tree) of every module."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        yield name, path, ast.parse(path.read_text(encoding="utf-8"))


def imported(tree, name, path):
    """Absolute dotted names of all imports in a module; names imported from a package count as its modules."""
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
    """(module, imported module) inside the package, and (module, third-party module)."""
    inside, outside = set(), set()
    for name, path, tree in found:
        for target in imported(tree, name, path):
            if head(target) == "dembrick":
                inside.add((name, target.partition(".")[2]))
            elif head(target) not in sys.stdlib_module_names:
                outside.add((name, head(target)))
    return inside, outside


def wrong(inside, outside):
    """Imports that break a rule, as text."""
    faults = []
    for name, target in sorted(inside):
        here, there = head(name), head(target)
        if here not in PACKAGES or here == there != "kernels" or there in GROUND - COMPILER:
            continue
        if here == there == "kernels":
            forbidden = {"math": {"joint", "statics", "dynamics"}, "joint": {"statics", "dynamics"}}
            forbidden |= {"statics": {"dynamics"}, "dynamics": {"statics"}}
            ok = target.split(".")[1] not in forbidden.get(name.split(".")[1], ())
        elif here == "kernels" or there in COMPILER:
            ok = there == "_jit" if here == "kernels" else here in ("simulation", "runs", "cli")
        elif here == "theory":
            ok = False
        elif there == "theory":
            ok = here in ("views", "runs", "cli")
        else:
            ok = there not in PACKAGES or PACKAGES.index(there) < PACKAGES.index(here)
        if not ok:
            faults.append(f"{name} -> {target}: not a package that {here} may see")
    for name, target in sorted(outside):
        if target in OPTIONAL.get(name, ()):
            continue
        if target == "scipy" or target not in OUTSIDE.get(head(name), {target}):
            faults.append(f"{name} -> {target}: {head(name)} does without")
    return faults


class WithoutTypes(ast.NodeTransformer):
    """A tree without the bodies of ``if TYPE_CHECKING``: imports for annotations, never executed in a run."""

    def visit_If(self, node):
        return None if getattr(node.test, "id", "") == "TYPE_CHECKING" else self.generic_visit(node)


@pytest.fixture(scope="module")
def found():
    """`arrows` of all modules, and those inside the package that a run follows; every module is parsed once."""
    inside, outside, followed = set(), set(), set()
    for name, path, tree in modules():
        for whole, part in zip((inside, outside), arrows([(name, path, tree)]), strict=True):
            whole |= part
        followed |= arrows([(name, path, WithoutTypes().visit(tree))])[0]
    return inside, outside, followed


def test_every_arrow_points_down(found):
    inside, outside, _ = found
    assert len(inside) > 50
    assert not wrong(inside, outside), "\n".join(wrong(inside, outside))


def test_packages_import_nothing_by_themselves():
    """This keeps ``--help`` fast and prevents hidden import cycles in an ``__init__``."""
    for package in ("geometry", "scenario", "assembly", "kernels", "simulation", "runs"):
        path = PACKAGE / package / "__init__.py"
        if path.exists():
            body = ast.parse(path.read_text(encoding="utf-8")).body
            assert len(body) == 1 and 3 <= len(ast.get_docstring(ast.Module(body, [])).splitlines()) <= 10, package


def test_no_circle_at_the_top(found):
    graph = {}
    for name, target in found[2]:
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
        ("simulation.statics.newton", "from dembrick import theory"),
        ("simulation.statics.newton", "def f():\n    from dembrick.theory import limit_load"),
        ("assembly.joints", "import dembrick.simulation.session"),
        ("kernels.joint.point_law", "from dembrick.scenario import model"),
        ("kernels.joint.point_law", "from ...simulation import session"),
        ("kernels.joint.point_law", "from dembrick.kernels.statics import loop"),
        ("kernels.math.vectors", "from dembrick.kernels.joint import point_law"),
        ("kernels.statics.loop", "from dembrick.kernels.dynamics import loop"),
        ("kernels.dynamics.loop", "from dembrick.kernels.statics import loop"),
        ("theory.equations", "from dembrick.kernels.joint.point_law import coulomb"),
        ("theory.equations", "from dembrick.geometry import polygons"),
        ("theory.equations", "import scipy.optimize"),
        ("simulation.session", "import importlib\nimportlib.import_module('dembrick.runs.outcomes.result')"),
        ("assembly.build", "import h5py"),
        ("geometry.polygons", "from dembrick._jit import jit"),
        ("views.plot.curves", "from dembrick.runs import result"),
        ("views.plot.curves", "import scipy"),
    ],
)
def test_a_wrong_arrow_is_found(name, source):
    path = PACKAGE.joinpath(*name.split(".")).with_suffix(".py")
    assert wrong(*arrows([(name, path, ast.parse(source))]))


def loaded_after(code, *arguments):
    """Top-level modules loaded after running ``code`` in a fresh interpreter."""
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
    loaded, _ = loaded_after("import dembrick.runs.simulate, dembrick.history")
    assert {"numpy", "numba", "h5py"} <= loaded
    assert not loaded & {"pyvista", "vtk", "vtkmodules", "matplotlib", "meshio"}


def test_a_warm_run_does_not_prepare_to_compile():
    """Existing machine code is loaded without numba's compiler, and the answer is the same."""
    code = """
import sys
from dembrick.runs.lab import lab_scenario
from dembrick.runs.simulate import simulate
print(simulate(lab_scenario('set4a', 'concave')).yield_point.V, 'numba.np.linalg' in sys.modules)
"""
    first = simulate(lab_scenario("set4a", "concave")).yield_point.V  # fills the cache
    V, prepared = loaded_after(code)[1].split()[:2]
    assert float(V) == first and prepared == "False"


def test_the_package_asks_for_no_scipy():
    """numba uses scipy if it is installed; the package itself runs without it."""
    code = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] == 'scipy':
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Refuse())
import dembrick
from dembrick import history
from dembrick.runs import lab, simulate, theory_check
"""
    loaded, _ = loaded_after(code)
    assert "scipy" not in loaded
