"""The slip of a joint that touches in part is that of the part that touches: of contact points by every law, and of
convex joints, in both engines. Truth: the motion of the corners of the joint, from frames."""

import dataclasses

import numpy as np
import pytest

import dembrick
from dembrick import history
from dembrick.simulation.dynamics.paths import load_path
from dembrick.views.motion.joints import JointMotion
from helpers.custom_laws import COULOMB
from helpers.scenario_text import block, header, jack

pytestmark = pytest.mark.usefixtures("few")

FIXED = "fixed = true"
SUPPORTS = block("left", (-0.4, 0.0, -0.1), (0.2, 0.2, 0.2), FIXED) + block(
    "right", (0.4, 0.0, -0.1), (0.2, 0.2, 0.2), FIXED
)
BEAM = SUPPORTS + block("beam", (0.0, 0.0, 0.05), (1.0, 0.2, 0.1))
TURNS = '[control]\nkind = "settlement"\nsupports = ["right"]\nrotation = { axis = [0.0, 1.0, 0.0], angle = 3.0 }'
BRICK = block("lower", (0.0, 0.0, -0.05), more=FIXED) + block("upper", (0.0, 0.0, 0.1), (0.3, 0.2, 0.2))


def recorded(text, path, law=None):
    """The history of a scenario."""
    scenario = dembrick.loads(text)
    scenario = dataclasses.replace(scenario, output=dataclasses.replace(scenario.output, channels=("frames", "joints")))
    dembrick.simulate(scenario, path, law=law)
    return history.read(path)


def of_corners(found, joint):
    """Slip of b over a (f, k) m at the corners of a joint in all frames, elastic part included, along its path."""
    corners = found.joints[joint]["polygon"]
    motion = JointMotion(found).at(range(found.n_frames)).relative
    steps = np.diff(motion.slip(joint, corners), axis=0)
    return np.linalg.norm(steps, axis=2).sum(axis=0)


@pytest.mark.parametrize("formulation", ["convex", "concave", "corrected", "distributed"])
def test_a_beam_slips_on_the_support_that_it_is_pulled_off(formulation, tmp_path, monkeypatch):
    """The right one turns by 3 degrees: the beam lifts from the left one but for one edge, which slips by 5.4 mm."""
    monkeypatch.setattr(load_path, "EQUILIBRIA", 20)
    with recorded(header(formulation, normal_stiffness=1e10) + BEAM + TURNS, tmp_path / "beam.h5") as found:
        slip = found.joint("slip")[:, 0]
        assert slip[-1] == pytest.approx(of_corners(found, 0).mean(), rel=2e-3) and slip[-1] > 5e-3
        assert (np.diff(slip) >= 0.0).all()


@pytest.mark.parametrize("law", ["dry", "bonded", "custom"])
def test_it_does_so_by_any_law_in_real_time(law, tmp_path):
    keys = "residual_friction = 0.5" if law == "bonded" else ""
    text = header(keys=keys) + BEAM + TURNS.replace("3.0", "1.0") + "\nquasi_static = false\nrate = 0.05"
    with recorded(text, tmp_path / "beam.h5", COULOMB if law == "custom" else None) as found:
        slip = found.joint("slip")[:, 0]
        assert slip[-1] == pytest.approx(of_corners(found, 0).mean(), rel=0.05) and slip[-1] > 1e-3
        assert (np.diff(slip) >= 0.0).all()


RATE, DEFORMED = "rate = 1e-3", "large_displacements = true"


@pytest.mark.parametrize(
    "way, law", [(RATE, "dry"), (RATE, "bonded"), (RATE, "custom"), (DEFORMED, "dry"), (DEFORMED, "bonded")]
)
def test_a_brick_that_is_pushed_high_up_slips_on_what_presses(way, law, tmp_path):
    """N acts more than b / 6 from the middle, so a part of the joint is open. Forward, back and forward again."""
    keys = "points = [8, 2]" + ("\nresidual_friction = 0.35" if law == "bonded" else "")
    control = f'[control]\nkind = "displacement"\nprotocol = [2e-4, 0.0, 2e-4]\n{way}\n'
    text = header("distributed", 0.4, 1e10, keys=keys) + BRICK + jack("upper", (0.0, 0.0, 0.15)) + control
    with recorded(text, tmp_path / "brick.h5", COULOMB if law == "custom" else None) as found:
        slip, moments, normal = (found.joint(name)[:, 0] for name in ("slip", "M_2", "N"))
        assert (np.abs(moments) > 0.051 * normal).sum() > 20
        assert slip[-1] == pytest.approx(of_corners(found, 0).mean(), rel=0.01) and slip[-1] > 5.5e-4
        assert (np.diff(slip) >= 0.0).all()
