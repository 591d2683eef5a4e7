"""One module uses private parts of numba; if one is missing, kernels compiled by public means answer the same."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import dembrick
from dembrick import _jit, _numba, _numba_check

PACKAGE = Path(dembrick.__file__).parent


def test_this_numba_has_every_private_part():
    """If this fails, numba has moved a private part: adapt `_numba`, or rely on `_numba_public`."""
    assert _numba_check.moved() == []
    assert _jit.WHY_PUBLIC == ""
    codegen = _numba.cpu_target.target_context.codegen()
    assert _numba_check.moved_from(codegen, _numba_check.USED_OF_CODEGEN) == []


def test_what_moved_is_named():
    gone = ["numba.core.codegen.JITCodeLibrary._no_such", "numba.no_such.module", "numba.core.NoSuch.name"]
    assert _numba_check.moved(["numba.core.cgutils.if_unlikely", *gone]) == gone
    assert _numba_check.moved_from(numba, ("config.OPT", "config._no_such")) == ["config._no_such"]
    assert _numba_check.refusal(names=gone[:1]) == f"numba {numba.__version__} has no {gone[0]}"


def test_a_version_that_nobody_tried_is_used_by_public_means_unless_asked(monkeypatch):
    monkeypatch.delenv(_numba_check.SWITCH, raising=False)
    assert _numba_check.refusal("0.62.0") == _numba_check.refusal("0.68.1") == ""
    assert _numba_check.refusal("0.69.0rc1") == "numba 0.69.0rc1 was not tried, 0.68 is the last that was"
    monkeypatch.setenv(_numba_check.SWITCH, "private")
    assert _numba_check.refusal("0.69.0rc1") == ""
    monkeypatch.setenv(_numba_check.SWITCH, "public")
    assert _numba_check.refusal() == "DEMBRICK_NUMBA is public"


def private_names(path):
    """Undocumented modules of numba that a source file imports from."""
    text = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)) if "numba." in text else ():
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
        yield from (name for name in names if name.startswith("numba.") and name != "numba.extending")


def test_no_other_module_takes_private_parts_of_numba():
    found = {path.name for path in PACKAGE.rglob("*.py") if [*private_names(path)]}
    assert found == {"_numba.py"}


KERNELS = """
import sys
{before}
import numpy as np
from dembrick import _jit
from dembrick._jit import address, call_at, entry, jit, prefetch, ready
from dembrick.kernels.joint.limit_surface import solve_symmetric

@jit
def square(x):
    return x * x

@entry
def weigh(values, scale, one, other):
    values[0] = scale * square(values[1]) + one + other
    return 7

@entry
def loop(place, values):
    prefetch(values, 1, 0)
    return call_at(place, values, 2.0, 3.0, 0.5)

values = np.array([0.0, 1.5])
place = address(weigh, values, 2.0, 3.0, 0.5)
status = ready(loop, place, values)(place, values)
solved = solve_symmetric(4.0, 1.0, 3.0, 0.5, 0.2, 2.0, 1.0, 2.0, 3.0)
print(status, values[0], *solved, _jit.WHY_PUBLIC, sep="|")
"""
GONE = "import numba.core.codegen\ndel numba.core.codegen.CPUCodeLibrary._unserialize"


def python(code, cache):
    """Start a script in its own process with its own kernel cache."""
    environment = {**os.environ, "DEMBRICK_CACHE_DIR": str(cache)}
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code], env=environment, stdin=pipe, stdout=pipe, text=True)


def printed(process):
    """Words that a script printed until it ended."""
    found, _ = process.communicate(timeout=300)
    assert process.returncode == 0
    return found.split("|")


def kernels(cache, before="", end=""):
    """Answers of kernels in another process, and its reason for compiling by public means."""
    return printed(python(KERNELS.format(before=before) + end, cache))


def test_kernels_answer_by_public_means_what_they_answer_by_private_ones(tmp_path):
    *private, reason = kernels(tmp_path)
    assert float(private[1]) == 2.0 * 1.5**2 + 3.5 and private[0] == "7" and reason == "\n"
    *public, reason = kernels(tmp_path, GONE)
    assert reason == f"numba {numba.__version__} has no numba.core.codegen.JITCodeLibrary._unserialize\n"
    assert [float(value) for value in public] == pytest.approx([float(value) for value in private], rel=1e-14)


KEPT = "\nprint(sum(solve_symmetric.stats.cache_hits.values()), flush=True)\nsys.stdin.readline()"


def test_one_process_at_a_time_keeps_what_it_compiles_by_public_means(tmp_path, monkeypatch):
    """Processes that write numba's own cache at once would mix up entries; so one writes, and others use it later."""
    monkeypatch.setenv(_numba_check.SWITCH, "public")
    first = python(KERNELS.format(before="") + KEPT, tmp_path)
    first.stdout.readline()
    assert first.stdout.readline() == "0\n"
    (folder,) = tmp_path.glob("*/public-*")
    kept = sorted(folder.rglob("*.nbc"))
    assert kept
    for hits in ("0", "1"):  # while the first process runs, and after it
        assert kernels(tmp_path, end=KEPT)[-1].split()[-1] == hits
        assert sorted(folder.rglob("*.nbc")) == kept
        if first.poll() is None:
            first.communicate("\n")


KEY_NUMBERS = ("yield_point", "steps", "displacement", "unbalanced", "reactions", "energy")


@pytest.mark.slow
def test_scenes_answer_the_same_by_public_means(tmp_path):
    """One scene of each engine; the first run takes more than a minute."""
    answers = {}
    for mode in ("private", "public"):
        environment = {**os.environ, _numba_check.SWITCH: mode}
        for scene in ("set4a", "newmark_pulse"):
            out = str(tmp_path / f"{scene}_{mode}.h5")
            command = [sys.executable, "-m", "dembrick", "run", scene, "--json", "--out", out]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            found = json.loads(done.stdout)
            answers[scene, mode] = {key: found[key] for key in KEY_NUMBERS if key in found}
    for scene in ("set4a", "newmark_pulse"):
        assert answers[scene, "public"] == answers[scene, "private"]
