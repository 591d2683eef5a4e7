"""The laboratory tests and tables of the paper, as printed; SI units.

Source: "Formulating the Torsion Strength of Dry-Stacked Stone Blocks by Comparing Convex and Concave Contact
Formulations and Experimental Results", Tables 1 to 3. Two dry tuff blocks of 0.3 x 0.2 x 0.1 m, joint 0.3 x 0.2 m under
467 N; horizontal forces along y in the mid-plane of the upper block. The paper does not state the friction: 0.64 was
inferred from the analytical columns of Table 3, which it reproduces within 0.6 N.
"""

from __future__ import annotations

from typing import NamedTuple

FRICTION = 0.64
MID_HEIGHT = 0.05  # m, height of the jacks above the joint


class LabSet(NamedTuple):
    """One set of tests: arm or eccentricity over a, measured V, and the printed V of two formulations (N)."""

    name: str
    loading: str  # "couple" of two jacks, or "single" jack
    arm_over_a: float  # arm of the couple, or eccentricity of the single force
    experiment: float
    printed: dict[str, float]


SETS = {
    "2a": LabSet("2a", "couple", 0.9, 108.0, {"convex": 107.0, "concave": 200.0}),
    "2b": LabSet("2b", "couple", 0.5, 205.0, {"convex": 193.0, "concave": 359.0}),
    "4a": LabSet("4a", "single", 0.25, 216.0, {"convex": 216.0, "concave": 254.0}),
    "4b": LabSet("4b", "single", 0.45, 166.0, {"convex": 162.0, "concave": 212.0}),
}


class PrintedJoint(NamedTuple):
    """A row of Table 1: torsion strength (N m) of a joint a x 0.3 m under 1 kN, friction 0.7."""

    scenario: str
    a_over_b: float
    convex: float
    concave: float


TABLE_1 = (
    PrintedJoint("table1_025", 0.25, 55.69, 108.23),
    PrintedJoint("table1_05", 0.5, 62.29, 117.39),
    PrintedJoint("table1_1", 1.0, 80.35, 148.49),
    PrintedJoint("table1_15", 1.5, 101.65, 189.29),
    PrintedJoint("table1_2", 2.0, 124.58, 234.79),
)
