"""Random impacts: blocks dropped flat, and rocking blocks, each against its closed form.

    python tools/drawn_impacts.py [--drops 60] [--rocks 60] [--seed 1]

A dropped block bounces with the given restitution. A block that rocks without slip keeps at every impact Housner's
share of its angular velocity, 1 - 1.5 sin^2 alpha; the velocities are found from the amplitudes before and after.
Prints deviations of more than 1 %, and counts; exits with 1 if there are any.
"""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, JointLaw, Material, Output, Scenario

G = 9.81
NEAR = 0.01
SLOW = 1.2e4  # least fall height over the penetration under the weight: the weight then has no effect on the impact
FORMULATIONS = ("concave", "convex", "corrected", "corrected-shear", "distributed")


def scene(block: Block, law: JointLaw, density: float, control: DynamicControl, output: Output) -> Scenario:
    """The block above a floor."""
    floor = Block("floor", "stone", (20.0, 20.0, 0.5), (0.0, 0.0, -0.25), fixed=True)
    return Scenario(
        title="impact", gravity=(0.0, 0.0, -G), joint=law, materials={"stone": Material(density)},
        blocks=(floor, block), control=control, output=output,
    )  # fmt: skip


def drop(size, density: float, law: JointLaw, height: float, speed: float, e: float, whole: bool) -> float:
    """Bounce speed over impact speed of a block of ``size`` (m) that falls flat from ``height`` (m) with the initial
    speed ``speed`` (m/s), from its rebound height. ``whole``: it lands at the end of a step."""
    down = (math.sqrt(speed**2 + 2.0 * G * height) - speed) / G
    strike = speed + G * down
    up = e * strike / G
    duration = 3.0 * down if whole and 3.0 * down > down + 1.2 * up else down + 1.3 * up
    block = Block("block", "stone", size, (0.3, 0.2, 0.5 * size[2] + height), velocity=(0.0, 0.0, -speed))
    output = Output(rows=2000, frames=2000)
    result = simulate(scene(block, law, density, DynamicControl(duration, e), output))
    z = height + result.frames["displacement"][:, 1, 2]
    after = result.frames["time"] > down + 0.3 * up
    return math.sqrt(2.0 * G * z[after].max()) / strike


def rock(b: float, slenderness: float, depth: float, part: float, e: float, law: JointLaw, impacts: int) -> list[float]:
    """Ratio of the angular velocities after and before each impact over Housner's ratio, for a block ``b`` wide (m)
    that starts upright and rocks up to ``part`` of its critical angle."""
    h = b * slenderness
    alpha, p2 = math.atan2(b, h), 3.0 * G / (2.0 * math.hypot(b, h))
    housner = 1.0 - 1.5 * math.sin(alpha) ** 2

    def speed(angle: float) -> float:
        return math.sqrt(2.0 * p2 * (math.cos(alpha - angle) - math.cos(alpha)))

    spin, amplitude, duration = speed(part * alpha), part, 0.0
    for k in range(impacts + 1):
        duration += (2.0 if k < impacts else 1.4) * math.acosh(1.0 / (1.0 - amplitude)) / math.sqrt(p2)
        lost = (speed(amplitude * alpha) * housner) ** 2 / (2.0 * p2)
        amplitude = 1.0 - math.acos(min(1.0, lost + math.cos(alpha))) / alpha
    block = Block(
        "block", "stone", (b, depth, h), (0.0, 0.0, 0.5 * h), velocity=(0.5 * spin * h, 0.0, 0.5 * spin * b),
        angular_velocity=(0.0, spin, 0.0),
    )  # fmt: skip
    output = Output(rows=4000, frames=4000)
    result = simulate(scene(block, law, 2000.0, DynamicControl(duration, e), output))
    q = result.frames["orientation"][:, 1]
    speeds = [speed(top) for top in amplitudes(2.0 * np.arctan2(q[:, 2], q[:, 0]), 0.02 * alpha)]
    return [after / before / housner for before, after in zip(speeds[:-1], speeds[1:], strict=True)]


def amplitudes(angle: np.ndarray, least: float) -> list[float]:
    """Successive amplitudes (rad) to alternate sides; the last one only if its maximum has been passed."""
    found, side, top = [], 1.0, 0.0
    for now in angle:
        if side * now < -least:
            found.append(top)
            side, top = -side, 0.0
        top = max(top, side * now)
    return [*found, top] if side * angle[-1] < top * (1.0 - 1e-6) else found


def drawn_drop(rng) -> tuple[str, list[float]]:
    """A random drop, and its bounce speed over the expected one."""
    size = tuple(float(x) for x in np.round(rng.uniform(0.08, 0.6, 3), 3))
    density, stiffness = float(rng.uniform(1400.0, 2800.0)), float(10.0 ** rng.uniform(9.0, 10.7))
    formulation, whole = str(rng.choice(FORMULATIONS)), bool(rng.integers(2))
    law = JointLaw(formulation, float(rng.uniform(0.3, 0.9)), stiffness, float(rng.uniform(0.2, 1.0)) * stiffness)
    height, speed = float(rng.uniform(0.01, 0.3)), float(rng.choice([0.0, rng.uniform(0.1, 1.5)]))
    height = max(height, SLOW * density * G * size[2] / stiffness)
    e = float(rng.uniform(0.5, 1.0))
    about = f"drop {size} m, {formulation}, e {e:.3f}, k_n {stiffness:.3g}, {height:.3f} m, {speed:.2f} m/s, {whole}"
    return about, [drop(size, density, law, height, speed, e, whole) / e]


def drawn_rock(rng) -> tuple[str, list[float]]:
    """A random rocking block, and its velocities after the impacts over Housner's."""
    b, slenderness = float(rng.uniform(0.1, 1.0)), float(rng.uniform(3.0, 8.0))
    part, e = float(rng.uniform(0.1, 0.9)), float(rng.uniform(0.14, 0.5))
    # friction that the impulse requires for no slip, plus 10 %
    least = 3.0 * slenderness / (1.0 + 4.0 * slenderness**2)
    friction = float(rng.uniform(1.1 * least, 1.0))
    stiffness = float(10.0 ** rng.uniform(9.7, 10.7))
    law = JointLaw("concave", friction, stiffness, float(rng.uniform(0.2, 1.0)) * stiffness)
    about = (
        f"rock b {b:.3f} m, h/b {slenderness:.2f}, {part:.2f} alpha, e {e:.3f}, mu {friction:.2f}, k_n {stiffness:.2g}"
    )
    return about, rock(b, slenderness, float(rng.uniform(0.5, 2.0)) * b, part, e, law, 3)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drops", type=int, default=60)
    parser.add_argument("--rocks", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    outside = 0
    for name, count, draw in (("drops", asked.drops, drawn_drop), ("rocking blocks", asked.rocks, drawn_rock)):
        worst, impacts = 0.0, 0
        for k in range(count):
            about, found = draw(np.random.default_rng([asked.seed, len(name), k]))
            off = max((abs(x - 1.0) for x in found), default=math.inf)  # no impact at all is an error too
            worst, impacts = max(worst, off), impacts + len(found)
            if off > NEAR:
                outside += 1
                print(f"{k}: {about}: {', '.join(f'{x:.4f}' for x in found)}", flush=True)
        print(f"{count} {name}, {impacts} impacts: the worst is {100.0 * worst:.2f} % off", flush=True)
    print(f"{outside} outside {100.0 * NEAR:g} %")
    return 1 if outside else 0


if __name__ == "__main__":
    sys.exit(main())
