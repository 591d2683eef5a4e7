"""Fuzz test with random bad input: no traceback, no hang, and only the documented exit codes are allowed.

    python tools/fuzz.py --count 2000 --seed 1

Scenarios, CSV files, meshes, histories, studies and arguments are damaged like by typing errors or disk faults, and
given to the command line in this process; each must end within 30 s with exit code 0, 1, 2, 3 or 4. Counts by kind of
input and code are printed, and the input of every failure is kept in ``--keep``. Exit code 1 if there is a failure.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import random
import signal
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

from dembrick.cli import main

LONGEST = 30  # s
CODES = {0, 1, 2, 3, 4}
SCENARIO = """title = "fuzz"
gravity = [0.0, 0.0, -9.81]
[joint]
formulation = "concave"
friction = 0.6
normal_stiffness = 1.0e9
shear_stiffness = 4.0e8
[materials.stone]
density = 2000.0
[[blocks]]
name = "floor"
material = "stone"
box = [1.0, 1.0, 0.1]
position = [0.0, 0.0, -0.05]
fixed = true
[[blocks]]
name = "upper"
material = "stone"
box = [0.3, 0.2, 0.1]
position = [0.0, 0.0, 0.05]
"""
YIELD = """[[actuators]]
name = "jack"
block = "upper"
point = [0.05, 0.0, 0.0]
direction = [0.0, 1.0, 0.0]
[control]
kind = "yield"
"""
SHAKEN = '[control]\nkind = "base-motion"\nduration = 0.01\ndirection = [1.0, 0.0, 0.0]\nfile = "record.csv"\n'
RECORD = "time [s], acceleration [g]\n" + "".join(f"{0.005 * i:.3f}, {0.1 * (-1) ** i}\n" for i in range(8))
MESHED = SCENARIO.replace("box = [0.3, 0.2, 0.1]\nposition = [0.0, 0.0, 0.05]", 'mesh = "block.%s"')
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n.1 0 0\n0 .1 0\n0 0 .1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n"
    "3 0 3 2\n"
)
OBJ = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
STL = "solid s\n facet normal 0 0 0\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0\n"
STL += "  endloop\n endfacet\nendsolid s\n"
MSH = (
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 .1 0 0\n3 0 .1 0\n4 0 0 .1\n$EndNodes\n$Elements\n1\n"
)
MSH += "1 4 2 0 1 1 2 3 4\n$EndElements\n"
STUDY = 'base = "base.toml"\n[grid]\n"joint.friction" = [0.5, 0.6]\n[draws]\ncount = 2\nseed = 1\n[draws.of]\n'
STUDY += '"joint.normal_stiffness" = { distribution = "uniform", lower = 1e9, upper = 2e9 }\n'
WORDS = [
    "nan",
    "-inf",
    "1e400",
    "0",
    "-1",
    "''",
    "[]",
    "{}",
    "true",
    "9" * 400,
    "1e-310",
    "\x1b[31m",
    "\u202e",
    "../x",
    "$x$",
]
WORDS += ["/dev/zero", '"', "[", "]]", "=", "\n", "\0", ",", ";", "\t", "#", "1_0", "µ", "\ud7ff", "0x10", "1979-05-27"]


class Slow(BaseException):
    """Raised for an input that takes longer than `LONGEST`."""


def damaged(draw: random.Random, text: str) -> bytes:
    """A text with a few tokens, characters, lines or bytes changed, doubled, swapped or cut off."""
    for _ in range(draw.randint(1, 3)):
        how, at = draw.randrange(7), draw.randrange(max(1, len(text)))
        lines = text.split("\n")
        k, j = draw.randrange(len(lines)), draw.randrange(len(lines))
        if how == 0:
            text = text[:at] + draw.choice(WORDS) + text[at:]
        elif how == 1:
            text = text[:at] + text[at + draw.randint(1, 8) :]
        elif how == 2:
            text = "\n".join([*lines[:k], *lines[k + 1 :]])
        elif how == 3:
            text = "\n".join([*lines[:k], lines[j], *lines[k:]])
        elif how == 4:
            words = lines[k].split(" ")
            words[draw.randrange(len(words))] = draw.choice(WORDS)
            text = "\n".join([*lines[:k], " ".join(words), *lines[k + 1 :]])
        elif how == 5:
            text = text[:at]
        else:
            text = text.replace(*draw.sample(["0.", "1", "=", "[", "]", "stone", "upper", ",", "\n"], 2), 1)
    data = text.encode("utf-8", "surrogatepass")
    if draw.random() < 0.1:
        data = flipped(draw, data)
    return data


def flipped(draw: random.Random, data: bytes) -> bytes:
    """Bytes with some changed, or with the end cut off."""
    changed = bytearray(data)
    for _ in range(draw.choice([1, 1, 3, 20])):
        if changed:
            changed[draw.randrange(len(changed))] = draw.randrange(256)
    return bytes(changed[: draw.randrange(len(changed))] if changed and draw.random() < 0.2 else changed)


def toml_case(draw: random.Random, _history: bytes) -> list[str]:
    Path("mine.toml").write_bytes(damaged(draw, SCENARIO + YIELD))
    return [draw.choice(["check", "check", "run"]), "mine.toml"]


def csv_case(draw: random.Random, _history: bytes) -> list[str]:
    Path("record.csv").write_bytes(damaged(draw, RECORD))
    Path("mine.toml").write_text(SCENARIO + SHAKEN)
    return ["check", "mine.toml"]


def mesh_case(draw: random.Random, _history: bytes) -> list[str]:
    ending, text = draw.choice([("ply", PLY), ("obj", OBJ), ("stl", STL), ("msh", MSH)])
    Path(f"block.{ending}").write_bytes(damaged(draw, text))
    Path("mine.toml").write_text(MESHED % ending + YIELD)
    return ["check", "mine.toml"]


def history_case(draw: random.Random, history: bytes) -> list[str]:
    Path("run.h5").write_bytes(flipped(draw, history))
    verbs = [
        ["info"],
        ["joints"],
        ["yield"],
        ["restart"],
        ["export", "--to", "out.csv"],
        ["export", "--to", "o.vtkhdf"],
    ]
    verb, *more = draw.choice(verbs)
    return [verb, "run.h5", *more]


def study_case(draw: random.Random, _history: bytes) -> list[str]:
    Path("base.toml").write_text(SCENARIO + YIELD)
    Path("study.toml").write_bytes(damaged(draw, STUDY))
    return ["sweep", "study.toml", "--jobs", "1"]


def argument_case(draw: random.Random, history: bytes) -> list[str]:
    Path("mine.toml").write_text(SCENARIO + YIELD)
    Path("run.h5").write_bytes(history)
    words = ["mine.toml", "run.h5", "--set", "joint.friction=", "--out", "--json", "--frame", "--csv", "--to", "--kind"]
    verb = draw.choice(["check", "run", "info", "joints", "yield", "domain", "sweep", "fit", "export", "restart"])
    given = [draw.choice([*words, *WORDS]).replace("\0", "") for _ in range(draw.randint(0, 5))]
    return [verb, *given]


PARTS = {"toml": toml_case, "csv": csv_case, "mesh": mesh_case, "hdf5": history_case, "study": study_case,
         "arguments": argument_case}  # fmt: skip


def outcome(words: list[str]) -> tuple[str, str]:
    """Exit code of the command line, or the failure by which it must never end; and the traceback of the failure."""

    def stop(*_):
        raise Slow

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            code = main(words)
    except SystemExit as ended:  # argparse
        code = ended.code
    except Slow:
        return "hang", ""
    except BaseException:
        return "traceback", traceback.format_exc()
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return (str(code), "") if code in CODES else (f"exit code {code}", "")


def fuzz(count: int, seed: int, keep: Path | None = None) -> dict[str, Counter]:
    """Counts of outcomes by kind of input; every failure is kept in a folder of its own."""
    found = {part: Counter() for part in PARTS}
    home = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            Path("mine.toml").write_text(SCENARIO + YIELD)
            with contextlib.redirect_stdout(io.StringIO()):
                main(["warmup", "--quiet"])  # compiling may take longer than a case is allowed to
                main(["run", "mine.toml", "--out", "whole.h5"])
            history = Path("whole.h5").read_bytes()
            for number in range(count):
                part = list(PARTS)[number % len(PARTS)]
                draw = random.Random(f"{seed} {number}")
                for left in os.listdir():
                    if os.path.isfile(left):
                        os.unlink(left)
                words = PARTS[part](draw, history)
                how, trace = outcome(words)
                found[part][how] += 1
                if how not in map(str, CODES):
                    print(f"{how}: case {number}: {words}\n{trace}", file=sys.stderr)
                    _keep(keep, number)
        finally:
            os.chdir(home)
    return found


def _keep(keep: Path | None, number: int) -> None:
    if keep is not None:
        place = keep / f"case_{number}"
        place.mkdir(parents=True, exist_ok=True)
        for name in os.listdir():
            if os.path.isfile(name):
                (place / name).write_bytes(Path(name).read_bytes())


def run() -> int:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000, help="cases in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the inputs that fail")
    options = parser.parse_args()
    found = fuzz(options.count, options.seed, options.keep and options.keep.resolve())
    for part, counts in found.items():
        told = ", ".join(f"{how}: {n}" for how, n in sorted(counts.items()))
        print(f"{part:10} {sum(counts.values()):5} cases  {told}")
    wrong = sum(n for counts in found.values() for how, n in counts.items() if how not in map(str, CODES))
    print(f"{'all':10} {sum(sum(counts.values()) for counts in found.values()):5} cases, {wrong} failures")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(run())
