"""Combined torsion, shear and bending of the laboratory's joint: the loss of strength by bending in each formulation.

    python tools/bending_study.py [--out FOLDER] [--tolerance T]

Prints three tables and draws ``bending.png``:

1. Torsion strength under bending, that is eccentric normal force, by theory and by replays in one batch.
2. The paper's reduced-area correction and similar ones against the no-tension linear pressure, over all directions of
   shear and torsion: by how much each is unsafe or safe.
3. The four laboratory tests with the lateral drift of the free block prevented by frictionless rollers.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from dembrick import simulate, theory
from dembrick.runs.lab import lab_scenario
from dembrick.scenario.model import Block, JointLaw, JointOverride
from dembrick.simulation.statics import batch
from dembrick.simulation.statics.yield_domain import actuators_for, directions

A, B, MU, N = 0.3, 0.2, 0.64, 467.0  # the laboratory's joint
RECTANGLE = theory.polygons.rectangle(A, B)
V_0, C_T = MU * N, float(theory.equations.torsion_parameter(A, B))
LAWS = (
    ("concave", "full"),
    ("corrected", "full"),
    ("corrected-shear", "full"),
    ("convex", "full"),
    ("convex", "effective"),
    ("convex", "linear"),
    ("distributed", "full"),
)
TRUTH = ("convex", "linear")
BENT = (0.0, 0.1, 1 / 6, 0.25, 0.35, 0.45)  # eccentricity over the side of the joint
AXES = {"e_y/b": (0.0, B), "e_x/a": (A, 0.0)}
SPREAD = 400  # number of directions of (V_1, V_2, M_T)
POINTS = (24, 16)  # lattice of the distributed formulation


def label(law) -> str:
    """Name of a law as readers know it."""
    return law[0] if law[0] != "convex" else f"convex, {law[1]}"


def by_theory(law):
    """The theoretical formulation of the joint with a law."""
    if law[0] == "distributed":
        points = batch.contact_points(batch.face(RECTANGLE, _law(law)), 1e-3)
        return theory.point_formulation(points.normal_arm, points.area, MU, name="distributed")
    return theory.rectangle_formulation(law[0], A, B, MU, pressure=law[1])


def _law(law) -> JointLaw:
    return JointLaw(law[0], MU, 1.0, 1.0, points=POINTS if law[0] == "distributed" else None, pressure=law[1])


def limits_by_theory(law, eccentricity, load):
    """Limit multipliers of ``load`` (n, 3) by theory; zero if the joint tips over under N alone."""
    try:
        return theory.limit_loads(by_theory(law).law(N, eccentricity), load).V
    except theory.formulations.ScenarioError:
        return np.zeros(len(load))


def limits_by_replay(law, eccentricity, load, tolerance):
    """Limit multipliers by replays; zero if the block falls under the dead load."""
    point, direction, weight = actuators_for(load, 0.5 * C_T)
    cases = batch.Cases.on(
        RECTANGLE, law[0], friction=MU, normal_force=N, eccentricity=eccentricity, actuator_point=point,
        actuator_direction=direction, actuator_weight=weight, pressure=law[1], points=_law(law).points,
        tolerance=tolerance,
    )  # fmt: skip
    found = batch.find_limit_loads(cases)
    assert np.isin(found.status, ["yield", "no equilibrium"]).all(), (
        law,
        eccentricity,
        set(found.status),
    )
    return np.where(found.status == "yield", found.V, 0.0)


def torsion_table(tolerance: float) -> dict:
    """M_T / (V_0 c_T) under bending about either axis; prints it, with the greatest error of the replays."""
    couple = np.array([[0.0, 0.0, 1.0]])
    found = {}
    worst = 0.0
    for name, edge in AXES.items():
        print(f"\nM_T / (V_0 c_T) under N at {name} (replay)\n{'':20}" + "".join(f"{e:9.3f}" for e in BENT))
        for law in LAWS:
            row = []
            for e in BENT:
                centre = (e * edge[0], e * edge[1])
                V, expected = (
                    limits_by_replay(law, centre, couple, tolerance)[0],
                    limits_by_theory(law, centre, couple)[0],
                )
                worst = max(worst, abs(V / expected - 1.0) if expected else abs(V))
                row.append(V / (V_0 * C_T))
            found[name, law] = row
            print(f"{label(law):20}" + "".join(f"{m:9.4f}" if m else f"{'tips':>9}" for m in row))
    print(f"greatest difference between replay and theory: {worst:.1e}")
    return found


def judgement(tolerance: float) -> dict:
    """Deviation of each law from the linear pressure over all directions and three cases of bending; prints it."""
    load = directions(SPREAD, "all") * [1.0, 1.0, C_T]
    found: dict = {}
    worst = 0.0
    for e in BENT:
        ways = [(0.0, e * B), (e * A, 0.0), (0.5 * e * A, 0.5 * e * B)]
        for way in ways:
            truth = limits_by_replay(TRUTH, way, load, tolerance)
            for law in LAWS:
                V = truth if law == TRUTH else limits_by_replay(law, way, load, tolerance)
                expected = limits_by_theory(law, way, load)
                if expected.any():
                    worst = max(worst, float(np.abs(V / expected - 1.0).max()))
                found.setdefault((law, e), []).append(V / truth - 1.0)
    print(f"\nV over that of the linear pressure, less 1 [%], over {SPREAD} directions of (V_1, V_2, M_T)")
    print("and N at e along b, along a, and half of either along both: most unsafe / most safe")
    print(f"{'e/edge':20}" + "".join(f"{e:16.3f}" for e in BENT))
    for law in LAWS:
        cells = []
        for e in BENT:
            ratio = 100.0 * np.concatenate(found[law, e])
            cells.append(f"{max(ratio.max(), 0.0):+7.1f} /{min(ratio.min(), 0.0):+7.1f}")
        print(f"{label(law):20}" + "".join(f"{cell:>16}" for cell in cells))
    print(f"greatest difference between replay and theory: {worst:.1e}")
    return found


def held(scenario):
    """The same test with rollers on both faces across x, at mid-height: no friction, no drift in x."""
    side, stiff = 0.002, JointLaw("convex", 0.0, 1e13, 1e13)
    upper = next(block for block in scenario.blocks if not block.fixed)
    blocks, overrides = list(scenario.blocks), []
    for sign, name in ((1.0, "right roller"), (-1.0, "left roller")):
        x = upper.position[0] + sign * 0.5 * (upper.box[0] + side)
        position = (x, upper.position[1], upper.position[2])
        blocks.append(Block(name, upper.material, (side, side, side), position, fixed=True))
        overrides.append(JointOverride((upper.name, name), stiff))
    return dataclasses.replace(scenario, blocks=tuple(blocks), joints=tuple(overrides))


def held_by_theory(law, eccentricity: float, height: float) -> float:
    """V of a single force along y with slip along x prevented at O: the reaction R bends the joint as V does.

    Newton's iteration on the slip twist (0, v, 1), V and R: the point of the limit surface whose normal is the twist,
    at the pressure under V and R, must equal (R, V, V e).
    """
    joint = by_theory(law)

    def residual(z):
        v, V, R = z * [A, V_0, V_0]
        force = joint.law(N, (R * height / N, V * height / N)).gradient(np.array([0.0, v, 1.0]))
        return (force - [R, V, V * eccentricity]) / [V_0, V_0, V_0 * A]

    z = np.array([1.0, 0.7, 0.0])
    for _ in range(60):
        r = residual(z)
        if np.abs(r).max() < 1e-10:
            return float(z[1] * V_0)
        slope = np.stack([(residual(z + h) - residual(z - h)) / 2e-6 for h in 1e-6 * np.eye(3)], axis=1)
        step = np.linalg.solve(slope, -r)
        z = z + step * min(1.0, 0.2 / np.abs(step).max())
    return float("nan")


def drift_table(tolerance: float) -> None:
    """Print V of the laboratory tests at mid-height with free and with prevented drift."""
    print("\nV [N] at mid-height, drift in x free and held (difference in %), held by theory")
    for law in LAWS[:-1]:
        cells = []
        for name in ("2a", "2b", "4a", "4b"):
            base = lab_scenario(f"set{name}_mid", law[0], tolerance)
            base = dataclasses.replace(base, joint=dataclasses.replace(base.joint, pressure=law[1]))
            free, stopped = (simulate(s, record=False).yield_point for s in (base, held(base)))
            cell = f"{free.V:9.2f}{stopped.V:9.2f} ({100 * (stopped.V / free.V - 1):+.2f})"
            if name.startswith("4"):  # a couple causes no overturning, hence no drift
                eccentricity, height = base.actuators[0].point[0], base.actuators[0].point[2]
                cell += f"{held_by_theory(law, eccentricity, height):9.2f}"
            cells.append(cell)
        print(f"{label(law):20}" + "  ".join(cells), flush=True)


def figure(folder: Path, table: dict) -> None:
    """Draw torsion over bending about both axes, and torsion over shear under an eccentricity of a third."""
    from dembrick.views.plot import layout, style  # noqa: F401

    looks = {
        LAWS[0]: (*style.FORMULATION["concave"],),
        LAWS[1]: (*style.FORMULATION["corrected"],),
        LAWS[2]: (*style.FORMULATION["corrected-shear"],),
        LAWS[3]: (style.BLUE, (0, (1, 1.5)), "o"),
        LAWS[4]: (style.SKY, (0, (6, 2)), "X"),
        LAWS[5]: (style.BLUE, "-", "o"),
        LAWS[6]: (*style.FORMULATION["distributed"],),
    }
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with style.settings():
        drawing, axes = plt.subplots(1, 3, figsize=(9.6, 3.6), layout="constrained")
        fine = np.concatenate([np.linspace(0.0, 0.49, 50), [0.4995]])
        couple = np.array([[0.0, 0.0, 1.0]])
        for ax, (name, edge) in zip(axes, AXES.items(), strict=False):
            for law, (colour, line, marker) in looks.items():
                V = [limits_by_theory(law, (e * edge[0], e * edge[1]), couple)[0] / (V_0 * C_T) for e in fine]
                if law[0] != "distributed":
                    shown = np.where(np.array(V) > 0.0, V, np.nan)
                    ax.plot(fine, shown, color=colour, ls=line)
                replay = [(e, m) for e, m in zip(BENT, table[name, law], strict=True) if m]
                ax.plot(*np.array(replay).T, color=colour, ls="none", marker=marker, ms=4.5, mfc="white", mew=1.0)
            ax.axvline(1 / 6, color=style.GREY, lw=0.6, ls=":")
            ax.text(1 / 6, 0.04, " joint opens", color=style.GREY, fontsize=7.5)
            first, second = name.split("/")
            ax.set_xlabel(rf"${first} / {second}$ [-]")
            ax.set_ylabel(r"$M_T / (V_0\, c_T)$ [-]")
            ax.set(xlim=(0.0, 0.5), ylim=(0.0, 2.0))
        axes[0].set_title("torsion, N bent along b")
        axes[1].set_title("torsion, N bent along a")
        angle = np.linspace(0.0, 0.5 * np.pi, 61)
        load = np.stack([0 * angle, np.cos(angle), C_T * np.sin(angle)], axis=1)
        few = load[::10]
        for law, (colour, line, marker) in looks.items():
            V = limits_by_theory(law, (0.0, B / 3), load)
            if not V.any():
                continue
            if law[0] != "distributed":
                axes[2].plot(V * load[:, 1] / V_0, V * load[:, 2] / (V_0 * C_T), color=colour, ls=line)
            W = limits_by_replay(law, (0.0, B / 3), few, 1e-3)
            axes[2].plot(
                W * few[:, 1] / V_0, W * few[:, 2] / (V_0 * C_T), color=colour, ls="none", marker=marker, ms=4.5,
                mfc="white", mew=1.0,
            )  # fmt: skip
        axes[2].set(xlim=(0.0, 1.05), ylim=(0.0, 2.0), title=r"torsion and shear along b, $e_y = b/3$")
        axes[2].set_xlabel(r"$V / V_0$ [-]")
        axes[2].set_ylabel(r"$M_T / (V_0\, c_T)$ [-]")
        handles = [
            plt.Line2D([], [], color=colour, ls=line if law[0] != "distributed" else "none", marker=marker, ms=4.5,
                       mfc="white", label=label(law))
            for law, (colour, line, marker) in looks.items()
        ]  # fmt: skip
        drawing.legend(handles=handles, loc="outside lower center", ncols=7)
        drawing.savefig(folder / "bending.png", dpi=150)


def main() -> None:
    """Print the tables and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder of the figure")
    parser.add_argument("--tolerance", type=float, default=1e-3, help="of the replays")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    table = torsion_table(options.tolerance)
    judgement(options.tolerance)
    drift_table(options.tolerance)
    figure(options.out, table)


if __name__ == "__main__":
    main()
