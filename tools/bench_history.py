"""Cost of keeping a record: memory of a run with many blocks and frames, and share of the run time.

    python tools/bench_history.py memory [--blocks 10000] [--frames 10000]
    python tools/bench_history.py share [--blocks 900] [--frames 1000]

Pairs of blocks stand side by side, and one is pushed at a constant rate. There are half as many contacts as blocks,
which is few, so the share of the record is an upper estimate. ``memory`` runs once and prints the greatest memory of
the process before and during the run. ``share`` prints the processor time of whole runs, writing included, with and
without a record, the best of several that alternate.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from contextlib import suppress

from dembrick.errors import NotConvergedError
from dembrick.history import read
from dembrick.runs.simulate import simulate
from dembrick.scenario import model
from dembrick.scenario.blocks import Block

USUAL = model.Output().channels


def pairs(blocks: int, steps: int, frames: int, channels=USUAL) -> model.Scenario:
    """``blocks`` blocks in pairs, one on top of the other; the last one is pushed for about ``steps`` steps."""
    n = blocks // 2
    placed = []
    for i in range(n):
        x, y = 0.4 * (i % 100), 0.3 * (i // 100)
        placed.append(Block(f"lower {i}", "tuff", (0.3, 0.2, 0.1), (x, y, -0.05), fixed=True))
        placed.append(Block(f"upper {i}", "tuff", (0.3, 0.2, 0.1), (x, y, 0.05)))
    x, y, _ = placed[-1].position
    time_step = 8.9e-5  # s, approximately, for these blocks and stiffnesses
    return model.Scenario(
        title=f"{n} pairs of blocks",
        gravity=(0.0, 0.0, -9.81),
        joint=model.JointLaw("concave", 0.64, 1e10, 4e9),
        materials={"tuff": model.Material(1500.0)},
        blocks=tuple(placed),
        control=model.DisplacementControl(1e-5, 1e-5 * steps * time_step),
        actuators=(model.Actuator("jack", f"upper {n - 1}", (x + 0.075, y, 0.0), (0.0, 1.0, 0.0)),),
        output=model.Output(channels, rows=max(frames, 1000), frames=frames),
    )


def megabytes() -> float:
    """Greatest memory (MB) of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(scenario: model.Scenario, path: str | None = None) -> float:
    """Processor time (s) of a run; a short push may find no limit load, which does not matter here."""
    began = time.process_time()
    with suppress(NotConvergedError):
        simulate(scenario, path, force=True, record=path is not None)
    return time.process_time() - began


def memory(blocks: int, frames: int) -> None:
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
        run(pairs(blocks, 500, 1))  # loads everything that such a scene needs; no record
        before = megabytes()
        path = os.path.join(folder, "run.h5")
        seconds = run(pairs(blocks, frames, frames), path)
        with read(path) as file:
            print(f"{blocks} blocks, {file.n_frames} frames, {file.n_row} rows")
        frame = 8 * (1 + 16 * blocks)
        print(f"memory before {before:.0f} MB, most {megabytes():.0f} MB; a frame has {frame / 1e6:.2f} MB")
        print(f"file {os.path.getsize(path) / 1e9:.2f} GB of {frames * frame / 1e9:.2f} GB of numbers, {seconds:.0f} s")


def share(blocks: int, frames: int, steps: int, rounds: int) -> None:
    kinds = {"no record": None, "no frames": ("joints", "energy"), "frames": USUAL, "all": model.CHANNELS}
    best = dict.fromkeys(kinds, float("inf"))
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
        for _ in range(rounds + 1):  # the first round compiles
            for name, channels in kinds.items():
                path = os.path.join(folder, "run.h5") if channels else None
                best[name] = min(best[name], run(pairs(blocks, steps, frames, channels or ()), path))
    base = best["no record"]
    for name, seconds in best.items():
        print(f"{name:10} {seconds:.3f} s ({100 * (seconds / base - 1):+.1f} %)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["memory", "share"])
    parser.add_argument("--blocks", type=int)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--steps", type=int, default=20_000, help="steps of the loop (share)")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    if options.what == "memory":
        memory(options.blocks or 10_000, options.frames or 10_000)
    else:
        share(options.blocks or 900, options.frames or 1000, options.steps, options.rounds)


if __name__ == "__main__":
    main()
