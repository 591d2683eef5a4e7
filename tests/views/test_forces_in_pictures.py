"""Forces of joints and new contacts in pictures, and a camera view that includes them."""

import numpy as np
import pytest

from dembrick import history
from dembrick.geometry.shapes import box
from dembrick.scenario.model import CHANNELS
from dembrick.views.motion.joints import JointMotion
from dembrick.views.render import scene
from helpers import history_cases as cases
from helpers.scenes import drawn, in_picture, rodrigues

pytest.importorskip("pyvista")


def test_forces_of_joints(run, drawing):
    """The resultant on the upper block is drawn at the centre of pressure on its face, in proportion to its size."""
    with drawn(run, forces=True, magnification=1.0) as found:
        arrows = found.arrows.of_joints
        N, V_1, V_2, _, M_1, M_2, _ = JointMotion(run).at([3]).resultants[0][0]
        # the axes turn with the upper block, to which the polygon is fixed, projected on the plane of the lower one
        axis, middle = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([0.0, 0.0, 0.05])
        t1 = rodrigues(np.array([[1.0, 0.0, 0.0]]), axis, 0.03)[0] * [1.0, 1.0, 0.0]
        t1 /= np.linalg.norm(t1)
        axes = np.array([t1, np.cross([0.0, 0.0, 1.0], t1), [0.0, 0.0, 1.0]])
        force, at = np.array([-V_1, -V_2, N]) @ axes, np.array([M_2, -M_1, 0.0]) / N
        np.testing.assert_allclose(arrows["vector"][0], force)
        at *= min(1.0, np.hypot(0.15, 0.1) / np.linalg.norm(at))
        place = middle + run.frame("displacement", 3)[1] + rodrigues((at - middle)[None], axis, 0.03)[0]
        np.testing.assert_allclose(arrows.points[0], place, atol=1e-12)
        assert arrows["length"][0] == pytest.approx(0.6 * 0.3)
        assert f"green: joint forces, the longest {np.sqrt(V_1**2 + V_2**2 + N**2):.4g} N" in found._text.input
        # blocks are translucent: the bar too has the colour of two faces on white
        colour, bar = found._meshes[0], next(iter(found._plotter.scalar_bars.values())).GetLookupTable()
        solid = np.array(next(a for a in found._plotter.actors.values() if a.mapper.dataset is colour).mapper.
                         lookup_table.GetTableValue(255)[:3])  # fmt: skip
        np.testing.assert_allclose(bar.GetTableValue(255)[:3], 1.0 - (1.0 - 0.65**2) * (1.0 - solid), atol=0.01)


def test_forces_ride_on_the_blocks_that_are_drawn(tmp_path, drawing):
    """The force of a joint moves with the magnified block to which its polygon is fixed, the third of three."""
    assembly = cases.mixed_assembly()
    assembly.orientation[2] = [1.0, 0.0, 0.0, 0.0]
    written = cases.written(
        tmp_path / "run.h5", cases.record(0, 31, 2, 0), cases.frames(0, 4, 3), assembly, control=cases.CONSTANT_RATE
    )
    with written as three, drawn(three, forces=True, magnification=10.0) as found:
        N, V_1, V_2, _, M_1, M_2, _ = JointMotion(three).at([3]).resultants[0][1]
        at = np.array([M_2, -M_1, 0.0]) / N
        at *= min(1.0, np.hypot(0.15, 0.1) / np.linalg.norm(at))
        axis, middle = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([0.4, 1000.0, 0.2])
        arm = rodrigues((np.array([0.0, 0.0, 0.1]) + at - middle)[None], axis, 10.0 * 0.03)[0]
        expected = middle + 10.0 * three.frame("displacement", 3)[2] + arm
        np.testing.assert_allclose(found.arrows.of_joints.points[1], expected, rtol=0, atol=1e-10)
        force = rodrigues(np.array([[-V_1, -V_2, N]]), axis, 0.03)[0]
        np.testing.assert_allclose(found.arrows.of_joints["vector"][1], force, rtol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_forces_of_new_contacts(tmp_path, drawing, factor):
    """Each new contact of a frame has an arrow that moves with the drawn second block; spare arrows have no length."""
    with cases.open_writer(tmp_path / "run.h5", channels=CHANNELS, control=cases.MOTION) as writer:
        writer.append(cases.moving_record(0, 5))
        still = {"joint_shift": np.zeros((4, 1, 2)), "contact_arm": np.zeros((4, 4, 2))}
        still |= {"contact_area": np.ones((4, 4))}
        met = cases.new_contacts(0, 4)
        writer.append_frames(*cases.frames(0, 4), **cases.motion(0, 4), **still, new_contacts=met)
        writer.finish("completed", {})
    axis, middle = np.array([1.0, 2.0, -2.0]) / 3.0, np.array([0.0, 0.0, 0.05])
    with history.read(tmp_path / "run.h5") as found, drawn(
        found, frames=(1, 2, 3), forces=True, magnification=factor
    ) as shown:  # fmt: skip
        for frame in (3, 1, 2):
            shown.show(frame)
            arrows, met = shown.arrows.of_new_contacts, cases.new_contacts(frame, frame + 1)
            moved = found.frame("displacement", frame)[1]
            # back to the initial position of the block, then forward by the magnified motion
            start = rodrigues(met["point"] - middle - moved, axis, -0.01 * frame)
            place = middle + factor * moved + rodrigues(start, axis, factor * 0.01 * frame)
            np.testing.assert_allclose(arrows.points[:frame], place, atol=1e-5)
            np.testing.assert_allclose(arrows["vector"][:frame], met["force"])
            size = np.linalg.norm(met["force"], axis=1)
            np.testing.assert_allclose(arrows["length"][:frame] / size, arrows["length"][0] / size[0])
            assert len(arrows["length"]) == 3 and not arrows["length"][frame:].any() and arrows["length"][0] > 0.0
        assert "purple: those of new contacts" in shown._text.input
    with cases.without_new_contacts(tmp_path / "less.h5") as found, drawn(found, forces=True) as shown:
        assert "forces of new contacts were not recorded" in shown._text.input


def test_an_impact_leaves_the_other_forces_to_be_seen(tmp_path, drawing):
    """A force of a hundred times the weight in one frame of seven is drawn shortened, and the legend says so."""
    rows = cases.record(0, 7)
    rows["joint"][..., 0, :] = [10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    rows["joint"][4, 0, 0] = 1000.0
    with cases.written(tmp_path / "run.h5", rows, (rows["time"], *cases.frames(0, 7)[1:])) as found:
        with drawn(found, frames=range(7), forces=True) as shown:
            longest, less = shown.arrows.length(10.0), shown.arrows.length(5.0)
            assert less == pytest.approx(longest / 2.0) and "the longest 10 N or more" in shown._text.input
            for frame, length in ((4, longest), (5, longest)):
                shown.show(frame)
                assert shown.arrows.of_joints["length"][0] == pytest.approx(length)
        assert shown.shades(30).shape == (128, 30, 3) and len(np.unique(shown.shades(2).reshape(-1, 3), axis=0)) == 16
        with drawn(found, frames=(4,), forces=True) as shown:
            assert shown._text.input.endswith("the longest 1000 N")


def test_torsion_centre_is_marked_where_it_is(run, drawing):
    centre = JointMotion(run).torsion_centre(3)[0]
    with drawn(run) as found:
        if np.linalg.norm(centre) > 0.6 or np.isnan(centre).any():
            assert not found._rod["length"][0] and "torsion centre" not in found._text.input
        else:
            np.testing.assert_allclose(found._rod.points[0, :2], centre)
        found.show(0)
        assert not found._rod["length"][0] and "blue" not in found._text.input


@pytest.mark.parametrize("view", ["front", "side"])
def test_the_arrows_of_the_forces_fit_too(tmp_path, view, drawing):
    """Arrows are scaled to the size of the movable blocks, whatever the size of their supports, and fit the picture."""
    assembly = cases.assembly()
    assembly.shapes = (box((3.0, 2.0, 0.1)), assembly.shapes[1])
    rows = cases.record(0, 5)
    rows["joint"][..., :3] = (1.0, 0.0, 0.0)
    rows["joint"][-1, 0, :3] = (100.0, 0.0, 0.0)
    rows["joint"][..., 4:6] = 0.0
    poses = (np.linspace(0.0, rows["time"][-1], 4), *cases.frames(0, 4)[1:])
    written = cases.written(tmp_path / "run.h5", rows, poses, assembly)
    with written as wide, drawn(wide, forces=True, view=view, magnification=0.0) as found:
        assert found.arrows.of_joints["length"][0] == pytest.approx(0.6 * 0.3)
        middle = np.array([0.0, 0.0, 0.09])
        y = in_picture(found._plotter, np.array([middle, -middle]))[1]
        assert scene._BOTTOM - 1e-9 <= y[1] < y[0] <= scene._TOP + 1e-9
