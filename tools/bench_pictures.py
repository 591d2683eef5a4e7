"""Cost of viewing a run: exports and movies of walls with invented motion.

    python tools/bench_pictures.py [--blocks 1000] [--frames 1000] [--movie-blocks 100] [--rounds 3] [--keep DIR]

A running-bond wall leans over and turns, course by course, while its joints carry the weight above and a growing
shear. Every row is a fresh command-line process; the best of the rounds is shown: wall-clock time, processor time,
greatest memory, and size of the output. Wall-clock times need a quiet machine.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from dembrick import history
from dembrick.assembly import build as assemblies
from dembrick.scenario import toml as scenarios
from dembrick.scenario.controls import DynamicControl
from dembrick.simulation.channels import NEW_CONTACTS, energies

WALL = """
title = "A wall of {blocks} blocks a course and {courses} courses, leaning over"
gravity = [0.0, 0.0, -9.81]
joint = {{ formulation = "{formulation}", friction = 0.64, normal_stiffness = 1.0e10, shear_stiffness = 4.0e9 }}
materials.stone.density = 2000.0
control = {{ kind = "tilt", axis = [1.0, 0.0, 0.0], rate = 1.0, displacement = 0.02 }}
[[walls]]
name = "wall"
material = "stone"
block = [0.3, 0.2, 0.1]
courses = {courses}
blocks = {blocks}
base = 0.1
"""
WALLS = {  # exports: formulation and channels
    "blocks only": ("convex", ("frames", "velocity")),
    "convex joints": ("convex", ("joints", "frames")),
    "four-point joints": ("concave", ("joints", "frames", "velocity", "contacts")),
}
CHUNK = 20  # frames written at a time


def made_up(path: Path, n_block: int, n_frame: int, formulation: str, channels: tuple[str, ...]) -> None:
    """Write the history of a wall of about ``n_block`` blocks."""
    side = max(2, round(math.sqrt(n_block)))
    text = WALL.format(blocks=max(2, round(n_block / side)), courses=side, formulation=formulation)
    assembly = assemblies.assemble(scenarios.loads(text))
    place, mass = assembly.position, assembly.mass
    height = (place[:, 2] - place[:, 2].min()) / np.ptp(place[:, 2])
    joints = list(assembly.joints)
    a = np.array([joint.block_a for joint in joints])
    above = np.array([mass[place[:, 2] > place[i, 2]].sum() for i in range(len(mass))]) * 9.81 / len(mass) * side
    points = sum(0 if p is None else len(p.area) for p in assembly.contact_points)
    with history.HistoryWriter(path, text, assembly, {}, channels=channels, control=DynamicControl(1.0)) as writer:
        for start in range(0, n_frame, CHUNK):
            t = np.arange(start, min(start + CHUNK, n_frame)) / n_frame
            joint = np.zeros((len(t), len(joints), 7))
            joint[..., 0] = 10.0 + above[a]
            joint[..., 2] = 0.6 * t[:, None] * joint[..., 0]
            joint[..., 3] = 0.02 * t[:, None] * joint[..., 0] * np.sin(np.arange(len(joints)))
            names = ("time", "load", "displacement", "unbalanced", "lower", "upper", "new_contacts")
            rows = dict.fromkeys(names, t)
            none, supports = np.zeros((len(t), 0)), int(np.count_nonzero(assembly.fixed))
            rows |= {"energy": dict.fromkeys(energies(real_time=True), t)}
            rows |= {"reaction": np.zeros((len(t), supports, 6))}
            writer.append(rows | {"actuator_displacement": none, "actuator_force": none, "joint": joint})
            angle = 0.5 * t[:, None] ** 2 * height * ~assembly.fixed
            shift = np.zeros((len(t), len(mass), 3))
            shift[..., 1] = angle * place[:, 2]
            turn = np.zeros((len(t), len(mass), 4))
            turn[..., 0], turn[..., 1] = np.cos(angle / 2), -np.sin(angle / 2)
            more = {"joint_shift": np.zeros((len(t), len(joints), 2))}
            if "velocity" in channels:
                more |= {"velocity": shift, "spin": shift}
            if "contacts" in channels:
                more["contact_force"] = np.tile([0.0, 1.0, 25.0], (len(t), points, 1))
                arms = [points.normal_arm for points in assembly.contact_points if points is not None]
                more["contact_arm"] = np.tile(np.concatenate([np.zeros((0, 2)), *arms]), (len(t), 1, 1))
                more["contact_area"] = np.tile(assembly.contact_points.area, (len(t), 1))
                more["new_contacts"] = {"count": np.zeros(len(t), int)} | {
                    name: np.zeros((0, *channel.shape)) for name, channel in NEW_CONTACTS.items()
                }
            writer.append_frames(t, shift, turn, **more)
        writer.finish("completed", {})
    print(f"# {path.name}: {len(mass)} blocks, {len(joints)} joints, {points} contact points, {n_frame} frames")


def measured(arguments: list[str]) -> tuple[float, float, float]:
    """Wall-clock time (s), processor time (s) and greatest memory (MB) of a command."""
    began = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "dembrick", *arguments], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"dembrick {' '.join(arguments)} failed")
    return time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def row(name: str, command: list[str], target: Path, rounds: int) -> None:
    """Measure a command ``rounds`` times, and remove its output."""
    best, size = np.full(3, np.inf), 0
    for _ in range(rounds):
        best = np.minimum(best, measured(command))
        written = list(target.parent.glob(f"{target.stem}*{target.suffix}"))
        size = sum(path.stat().st_size for path in written)
        for path in written:
            path.unlink()
    print(f"{name:44} {best[0]:7.2f} s  {best[1]:7.2f} s  {best[2]:6.0f} MB  {size / 1e6:8.1f} MB", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blocks", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--movie-blocks", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="dembrick-bench-") as folder:
        folder = Path(folder)
        print(f"{'':44} {'clock':>9}  {'processor':>9}  {'memory':>9}  {'written':>11}")
        for name, (formulation, channels) in WALLS.items():
            path, target = folder / "wall.h5", folder / "out.vtkhdf"
            made_up(path, options.blocks, options.frames, formulation, channels)
            row(f"export, {name}", ["export", str(path), "--to", str(target), "--quiet"], target, options.rounds)
            path.unlink()
        path = folder / "small.h5"
        made_up(path, options.movie_blocks, 100, "convex", ("joints", "frames"))
        for ending in ("gif", "mp4"):
            target = folder / f"out.{ending}"
            command = ["render", str(path), "--to", str(target), "--magnify", "1"]
            row(f"100 frames as {ending}", command, target, options.rounds)


if __name__ == "__main__":
    main()
