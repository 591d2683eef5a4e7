"""Draw the README's pictures of joints, paths and the web page from fresh runs, into docs/images/.

    python tools/readme_figures.py [--out docs/images]
    python tools/readme_figures.py --pack docs/images/curves.png ...

``joint.png``: set 4a pushed at a constant rate, with contact points at the corners and with the exact limit surface;
``path.png``: the same on their yield domains; ``page.png``: the web page of one of them in a headless Chromium (left
out with a message if there is none); ``wall.png``: the README's wall on a tilting table at its limit, and
``collapse.png``: a wall after its collapse, which takes a minute and a half (both left out if this machine cannot draw
off screen). ``granite_loops.png``, which takes a minute: the granite wall under cyclic loading with measurements.
``curves.png`` and ``fig5_domains.png`` are those of ``dembrick lab``.
``--pack`` draws nothing: it rewrites PNG files of other tools with 256 colours, at their own resolution; they look the
same and take a third of the space in a repository.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import dembrick  # noqa: E402
from dembrick import history  # noqa: E402
from dembrick.errors import MissingDependency  # noqa: E402
from dembrick.views import page, plot, render  # noqa: E402
from helpers import browser as browsers  # noqa: E402

DOTS_PER_INCH = 150  # sufficient for screens, and small files in the repository
WINDOW = (1180, 790)
PICTURE = (1000, 700)
GRANITE = (36.0, 39.0), (-43.3, -40.1)  # kN: measured peak forces of four cycles, each way


def pushed(formulation: str, folder: Path) -> Path:
    """A history of set 4a at a constant rate, contact forces included."""
    scenario = dembrick.load(ROOT / "scenarios" / "set4a_curve.toml")
    output = dataclasses.replace(scenario.output, channels=("joints", "energy", "frames", "contacts"))
    law = dataclasses.replace(scenario.joint, formulation=formulation)
    path = folder / f"{formulation}.h5"
    dembrick.simulate(dataclasses.replace(scenario, joint=law, output=output), path)
    return path


def granite_loops(out: Path) -> None:
    """Draw the loops of the granite wall under 104.8 kN, the measured curve of a monotonic test, and measured peaks."""
    found = dembrick.simulate(dembrick.load("granite_cycles"))
    measured = plot.read_measured(ROOT / "scenarios" / "validation" / "granite_104.8.csv", "one way")
    figure = plot.force_displacement([found], ["simulated, two cycles"], measured=[measured])
    axes = figure.axes[0]
    for low, high in GRANITE:
        axes.axhspan(low, high, color="0.8", zorder=0)
    axes.set_ylim(-46.0, 42.0)
    for height in (sum(way) / 2 for way in GRANITE):
        axes.annotate("measured peaks of four cycles", (-28, height), va="center", fontsize="small")
    figure.savefig(out / "granite_loops.png", dpi=DOTS_PER_INCH)
    pack(out / "granite_loops.png")


def pack(path: Path) -> None:
    """Rewrite a PNG with a palette of 256 colours."""
    from PIL import Image

    with Image.open(path) as picture:
        flat = Image.new("RGB", picture.size, "white")
        flat.paste(picture, mask=picture.getchannel("A") if picture.mode == "RGBA" else None)
    flat.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path, f"{path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images", help="folder of the pictures")
    parser.add_argument("--pack", type=Path, nargs="+", metavar="FILE.png", help="only make these files smaller")
    options = parser.parse_args()
    if options.pack:
        for path in options.pack:
            pack(path)
        return
    out = options.out
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [pushed(formulation, folder) for formulation in ("concave", "convex")]
        runs = [history.read(path) for path in paths]
        for picture, figure in (("joint", plot.joint_stages(runs)), ("path", plot.load_path(runs))):
            figure.savefig(out / f"{picture}.png", dpi=DOTS_PER_INCH)
            pack(out / f"{picture}.png")
        for run in runs:
            run.close()
        granite_loops(out)
        try:
            dembrick.simulate(ROOT / "scenarios" / "wall_door.toml", folder / "wall.h5")
            with history.read(folder / "wall.h5") as run:
                print(render.picture(run, out / "wall.png", size=PICTURE, view="front"))
            dembrick.simulate(ROOT / "scenarios" / "wall_collapse.toml", folder / "collapse.h5")
            with history.read(folder / "collapse.h5") as run:
                print(render.picture(run, out / "collapse.png", magnification=1.0, size=PICTURE))
        except MissingDependency as error:
            print(f"wall.png and collapse.png are left out: {error}")
        if browsers.find() is None:
            print("page.png is left out: there is no Chromium on this machine")
            return
        page.write(paths[0], folder / "page.html")
        window = browsers.Browser(browsers.find())
        try:
            window.size(*WINDOW)
            window.open(folder / "page.html")
            shot = {"x": 0, "y": 0, "width": WINDOW[0], "height": WINDOW[1]}
            (out / "page.png").write_bytes(window.picture_of(shot))
            print(out / "page.png")
        finally:
            window.close()


if __name__ == "__main__":
    main()
