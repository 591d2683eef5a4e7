"""Paths in the deformed geometry of joints that crush: up to the limit, and through the fall, as the joint's law says.

Points at the corners bear f_c A / 4 each: if N > f_c A / 2, the two at the toe are crushed at the limit, where N is
b / 2 (f_c A / N - 1) from the middle.
"""

import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.scenario_text import block, header, jack

B, D = 0.3, 0.5  # m, of the bed
LOADED = 3.0  # N over the weight of the blocks


def weight(height):
    """Of the blocks (N)."""
    return 2000.0 * 9.81 * B * D * height


def column(control, share, floor, heights, e=0.0, formulation="concave", more="", kn=2e9):
    """Blocks on a floor of their width, with a load on top that has N at ``e`` (m); N is that share of f_c A."""
    height = sum(heights)
    N = LOADED * weight(height)
    keys = f"compressive_strength = {N / (B * D) / share}\n"
    text = header(formulation, 0.9, kn, keys=keys)
    text += block("floor", (0.0, 0.0, -0.5 * floor), (B, D, floor), "fixed = true")
    base = 0.0
    for number, h in enumerate(heights):
        text += block(f"block {number}", (0.0, 0.0, base + 0.5 * h), (B, D, h))
        base += h
    push = f"force = [0.0, 0.0, {-(LOADED - 1.0) * weight(height)}]\n"
    arm = e * LOADED / (LOADED - 1.0)
    text += f'[[loads]]\nblock = "block {len(heights) - 1}"\n{push}point = [{arm}, 0.0, {height}]\n{more}'
    return toml.loads(f"{text}[control]\n{control}large_displacements = true\n", "crushing.toml")


@pytest.mark.parametrize("share", [0.7, 0.8, 0.95])
@pytest.mark.parametrize("floor", [0.06, 0.2, 1.0])
@pytest.mark.parametrize("heights", [(0.15,), (0.5,), (0.3, 0.2), (0.2, 0.2, 0.2)])
def test_a_toe_that_crushes_ends_in_an_answer(share, floor, heights):
    """However thin the floor: the toe sinks in until the block has come down. It was a refusal as soon as it had turned
    by .2, where a new contact took over, which took what is crushed for an overlap."""
    limit = 0.5 * B * (1.0 / share - 1.0)
    for part, says in ((0.97, "stands"), (1.03, "falls")):
        found = simulate(column('kind = "statics"\n', share, floor, heights, part * limit), record=False)
        assert found.status == says


@pytest.mark.parametrize("formulation", ["corrected", "distributed"])
def test_points_inside_the_edge_that_crush(formulation):
    """A load near the edge is beyond what rows of points bear whose toe is crushed."""
    for e, says in ((0.02, "stands"), (0.09, "falls")):
        scene = column('kind = "statics"\n', 0.8, 0.1, (0.3,), e, formulation)
        assert simulate(scene, record=False).status == says


@pytest.mark.parametrize("formulation", ["concave", "corrected", "distributed"])
@pytest.mark.parametrize("kn", [3e7, 1e8, 2e9])
def test_a_fall_that_is_over_before_one_looks(formulation, kn):
    """A load at .3 b on a bed that .88 of f_c crushes is far beyond any limit, as is that at .02 b below it. 256 steps
    of a soft bed last longer than the block takes to fall through the thin floor, which was a motion that diverged."""
    for e, says in ((0.02, "stands"), (0.3, "falls")):
        scene = column('kind = "statics"\n', 0.88, 0.06, (0.1,), e * B, formulation, kn=kn)
        assert simulate(scene, record=False).status == says


PUSHES = {  # each with the height of what acts (m)
    "pushover": ('kind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n', 0.2),
    "yield": ('kind = "yield"\n', 0.3),
    "displacement": ('kind = "displacement"\nrate = 1e-3\ntravel = 5e-3\n', 0.3),
}


@pytest.mark.parametrize("kind", PUSHES)
@pytest.mark.parametrize("share, heights", [(0.57, (0.2, 0.2)), (0.8, (0.4,))])
def test_a_push_over_a_toe_that_crushes(kind, share, heights):
    """V h = N b / 2 (f_c A / N - 1), less what leaning takes, on a floor so thin that the fall goes deep into it."""
    control, arm = PUSHES[kind]
    jacks = "" if kind == "pushover" else jack(f"block {len(heights) - 1}", (0.0, 0.0, arm))
    found = simulate(column(control, share, 0.05, heights, 0.0, more=jacks, kn=1e9), record=False)
    V = LOADED * weight(0.4) * 0.5 * B * (1.0 / share - 1.0) / arm
    V /= weight(0.4) if kind == "pushover" else 1.0
    point = found.yield_point
    assert point.V_peak == pytest.approx(V, rel=2e-3)
    if kind != "displacement":
        assert point.V_upper - point.V_lower <= 1.01e-3 * point.V_upper
