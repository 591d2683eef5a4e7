"""Annotations of pictures: scale bar, names, line of thrust, hinges, loads, reactions, angle; runs side by side."""

import math

import numpy as np
import pytest

from dembrick import cli, history
from dembrick.errors import HistoryError, ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.views import render
from dembrick.views.motion import hinges
from dembrick.views.motion.blocks import moving_blocks
from dembrick.views.motion.frames import frame_number
from dembrick.views.motion.joints import JointMotion
from dembrick.views.motion.magnification import round_down
from dembrick.views.motion.table import joint_table, reaction_table
from dembrick.views.render import annotations, scene, screen
from helpers.scenario_text import block, header

pyvista = pytest.importorskip("pyvista")

EDGE, COUNT = 0.2, 3  # edge (m) and number of cubes in a column
COLUMN = (
    header(title="column", normal_stiffness=1e11)
    + f"""
[[stacks]]
name = "column"
material = "stone"
blocks = {COUNT}
box = [{EDGE}, {EDGE}, {EDGE}]
base = 0.1
[control]
kind = "tilt"
axis = [0.0, 1.0, 0.0]
"""
)


@pytest.fixture(scope="module")
def column(tmp_path_factory):
    path = tmp_path_factory.mktemp("column") / "column.h5"
    simulate(toml.loads(COLUMN), path)
    with history.read(path) as found:
        yield found


@pytest.fixture(autouse=True)
def closed_at_the_end():
    yield
    pyvista.close_all()


def drawn(run, frames=(-1,), size=(400, 300), **look):
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
    return scene.Scene(plotter, run, render.Look(**look), [range(run.n_frames)[frame] for frame in frames])


def test_the_line_of_thrust_of_a_column_leaves_it_at_the_hinge(column, drawing):
    """Under the weight W and W tan(angle) the thrust is z tan(angle) off the axis of a column, z below its middle."""
    found = drawn(column, view="front", thrust=True, magnification=0.0)
    slope = float(column.load[-1])
    assert slope == pytest.approx(1.0 / COUNT, rel=2e-3)
    line = found.thrust._line
    heights = EDGE * np.arange(COUNT)
    above = 0.5 * (COUNT * EDGE - heights)  # height of the centroid of the cubes on a joint above it
    order = np.argsort(line.points[:, 2])
    np.testing.assert_allclose(line.points[order, 2], heights, atol=1e-6)
    np.testing.assert_allclose(np.abs(line.points[order, 0]), slope * above, atol=1e-4)
    pairs = {tuple(sorted(order.tolist().index(j) for j in pair)) for pair in line.lines.reshape(-1, 3)[:, 1:].tolist()}
    assert pairs == {(0, 1), (1, 2)}  # through the two lower cubes; the top one has only one joint
    assert found.thrust.hinges == [int(order[0])] and "1 hinge" in found._text.input


def test_hinges_drawn_at_a_collapse_are_those_of_the_result(column, drawing, monkeypatch):
    """Hinges named in a result are drawn even if they carry no force, where the faces of the joint are closest."""
    names = column.block_names
    named = [f"{names[joint['block_b']]} / {names[joint['block_a']]}" for joint in column.joints]
    first = drawn(column, frames=(1,), thrust=True).thrust.hinges
    monkeypatch.setitem(column.__dict__, "results", {"collapse": {"hinges": named[:2]}})
    found = drawn(column, thrust=True, magnification=0.0)
    assert found.thrust.hinges == [0, 1] and "2 hinges" in found._text.input
    assert drawn(column, frames=(1,), thrust=True).thrust.hinges == first  # by the forces, before collapse
    joints = JointMotion(column)
    low = int(np.argmin(joints.origin[:, 2]))
    edge = hinges.closed_edges(joints, column.n_frames - 1)[low] @ joints.axes[low, :2]
    toe = joints.at([column.n_frames - 1]).pressure_centre[0, low] @ joints.axes[low, :2]
    np.testing.assert_allclose(edge, [math.copysign(EDGE / 2.0, toe[0]), 0.0, 0.0], atol=1e-9)


def test_the_picture_of_a_table_tells_its_angle(column, drawing):
    angle = math.degrees(math.atan(float(column.load[-1])))
    assert f"table at {angle:.4g} deg, load factor {float(column.load[-1]):.4g}" in drawn(column)._text.input


def test_the_picture_of_a_load_without_a_limit_says_so(column, drawing, monkeypatch):
    assert "no limit" not in drawn(column)._text.input
    monkeypatch.setitem(column.__dict__, "results", {"unlimited": True})
    assert "\nno limit: blocks overlap by the elastic deformation of their joints" in drawn(column)._text.input


def test_the_scale_bar_is_as_long_as_it_says(column, drawing):
    """The length of the bar in pixels is that of its label at the scale of the camera, also after zooming."""
    found = drawn(column, size=(1200, 900), view="front", magnification=0.0, color="none")
    shown = found.pixels().astype(int)
    bar, whole = found.bar, 2.0 * found._plotter.camera.parallel_scale * 4.0 / 3.0
    assert bar.length in (0.05, 0.1, 0.2) and bar._text.input == annotations.length_text(bar.length)
    rows = slice(round(900 * (1.0 - 0.055)) - 3, round(900 * (1.0 - 0.055)) + 4)
    dark = np.flatnonzero((shown[rows, 960:].sum(axis=2) < 200).any(axis=0))
    assert dark[-1] - dark[0] == pytest.approx(bar.length / whole * 1200, abs=4)
    before = bar.length
    found._plotter.camera.parallel_scale *= 10.0  # zoom the window out
    found.pixels()
    assert bar.length == pytest.approx(10.0 * before)


@pytest.mark.parametrize("longest, text", [(4.9, "2 m"), (0.5, "50 cm"), (0.0021, "2 mm"), (1.5e-4, "100 µm")])
def test_lengths_are_round(longest, text):
    assert annotations.length_text(round_down(longest)) == text


def test_names_stand_at_blocks_and_joints(column, drawing):
    found = drawn(column, names="all", magnification=0.0)
    (blocks, _), (joints, _) = found._names.named
    moving = moving_blocks(column, column.n_frames - 1)  # without the base
    at = dict(zip([column.block_names[i] for i in moving], blocks.points, strict=True))
    for name, place in at.items():  # stacked blocks of 0.2 m
        np.testing.assert_allclose(place, [0.0, 0.0, 0.2 * int(name.rpartition(".")[2]) - 0.1], atol=1e-6)
    lowest = 0.2 * min(moving)  # of the joints of moving blocks
    np.testing.assert_allclose(joints.points[:, 2].min(), lowest, atol=1e-6)
    assert "column.2" in at and len(joints.points) == round((0.4 - lowest) / 0.2) + 1
    without, named = drawn(column, magnification=0.0).pixels(), found.pixels()
    assert (without != named).any(axis=2).sum() > 200
    with pytest.raises(ScenarioError, match="names = 'walls' is unknown; use one of none, blocks, joints, all"):
        drawn(column, names="walls")


def test_two_runs_stand_side_by_side_to_one_scale(column, tmp_path, drawing, capsys):
    """A column half as high is drawn beside it with half the pixels, the same colours, and different labels."""
    text = COLUMN.replace(f"blocks = {COUNT}", "blocks = 1")
    simulate(toml.loads(text), tmp_path / "cube.h5")
    with history.read(tmp_path / "cube.h5") as cube:
        with render._scenes([column, cube], render.Look("front"), [[column.n_frames - 1], [cube.n_frames - 1]],
                            (400, 300), smooth=False) as (first, second):  # fmt: skip
            assert first._plotter.camera.parallel_scale == second._plotter.camera.parallel_scale
            assert first.bar.length == second.bar.length and first._factor == second._factor
            assert first._scale == second._scale
            assert first._text.input.startswith("column: ") and second._text.input.startswith("cube: ")
        path = tmp_path / "both.png"
        assert cli.main(["render", column.path, cube.path, "--to", str(path), "--size", "200", "150"]) == 0
        image = pyvista.read(path)
        assert image.dimensions[:2] == (400, 150)
        movie = ["render", column.path, cube.path, "--to", str(tmp_path / "both.gif"), "--count", "3"]
        assert cli.main([*movie, "--size", "160", "120"]) == 0
        frames = render.frames_side_by_side([column, cube], 5)
        assert len(frames[0]) == len(frames[1]) and frames[0][-1] == column.n_frames - 1
        assert cli.main(["render", column.path, cube.path, "--to", str(tmp_path / "both.html")]) == 2
        assert "a page shows one run" in capsys.readouterr().err


def test_where_there_is_no_line_of_thrust_that_is_said(tmp_path, drawing):
    text = COLUMN.replace(f"blocks = {COUNT}", "blocks = 1")
    simulate(toml.loads(text), tmp_path / "cube.h5")
    with (
        history.read(tmp_path / "cube.h5") as cube,
        pytest.raises(HistoryError, match="no block has exactly two joints"),
    ):
        drawn(cube, thrust=True)


def test_egl_is_asked_for_on_linux_only(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    monkeypatch.setattr(screen, "_works", lambda off, trial: True)
    for platform, asked in (("darwin", False), ("win32", False), ("linux", True)):
        monkeypatch.setattr("sys.platform", platform)
        screen.require_drawing.cache_clear()
        screen.require_drawing()
        assert ("VTK_DEFAULT_OPENGL_WINDOW" in screen.os.environ) == asked, platform
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW")
    screen.require_drawing.cache_clear()


DAM = (
    header(title="dam", normal_stiffness=1e10)
    + """
[[stacks]]
name = "dam"
material = "stone"
blocks = 6
box = [0.6, 1.0, 0.2]
base = 0.2
[[pressures]]
block = "dam"
direction = [-1.0, 0.0, 0.0]
surface = 1.2
weight = 9810.0
actuator = true
[control]
kind = "yield"
"""
)


def test_a_driven_pressure_presses_on_its_faces_by_what_it_is(tmp_path, drawing):
    """Water on a dam presses on the k-th course from the top with 2 k - 1 parts; on the first, two thirds down."""
    simulate(toml.loads(DAM), tmp_path / "dam.h5")
    with history.read(tmp_path / "dam.h5") as run:
        scene = drawn(run, view="front", magnification=0.0)
        found = scene._loads.driven
        tail, vector, length = found.arrows.points, found.arrows["vector"], found.arrows["length"]
        assert "orange: driven pressure" in scene._text.input
    height = 0.2
    np.testing.assert_allclose(length / length[-1], [11, 9, 7, 5, 3, 1], rtol=1e-9)
    np.testing.assert_allclose(vector, np.outer(length, [1.0, 0.0, 0.0]), atol=1e-12)
    for k, tip in zip(range(6, 0, -1), tail + vector, strict=True):
        depth = height * 2.0 / 3.0 * (k**3 - (k - 1) ** 3) / (k**2 - (k - 1) ** 2)
        np.testing.assert_allclose(tip, [-0.3, 0.0, 1.2 - depth], atol=1e-9)


def test_reactions_are_drawn_along_their_lines_of_action(tmp_path, drawing):
    """A beam rests on the right edges of its two supports after one has moved out and down: the lines of the arrows
    pass through these edges, and their lengths are proportional to the reactions."""
    text = header(title="beam", normal_stiffness=1e11)
    for name, x in (("left", -0.5), ("right", 0.3)):
        text += block(name, (x, 0.0, -0.1), (0.3, 0.2, 0.2), "fixed = true")
    text += block("beam", (0.0, 0.0, 0.1), (1.2, 0.2, 0.2))
    text += '[control]\nkind = "settlement"\nsupports = ["right"]\ndisplacement = [0.1, 0.0, -0.02]\n'
    simulate(toml.loads(text), tmp_path / "beam.h5")
    with history.read(tmp_path / "beam.h5") as run:
        found = drawn(run, view="front", reactions=True, magnification=1.0)
        arrows = found._reactions._arrows
        colours = [
            actor.GetProperty().GetColor()
            for actor in found._plotter.renderer.actors.values()
            if actor.IsA("vtkActor") and actor.GetMapper().GetInput() is arrows
        ]
        force, table = run.reaction[-1, :, :3], reaction_table(run)
    size = np.linalg.norm(force, axis=1)
    length = arrows["length"]
    np.testing.assert_allclose(length / length.max(), size / size.max(), rtol=1e-9)
    for k, (x, top) in enumerate(((-0.5, 0.0), (0.4, -0.02))):
        way = arrows["vector"][k] / length[k]
        np.testing.assert_allclose(way, force[k] / size[k], atol=1e-12)
        tip = arrows.points[k] + arrows["vector"][k]
        corners = [(x + i, j, top + k) for i in (-0.15, 0.15) for j in (-0.1, 0.1) for k in (-0.2, 0.0)]
        assert ((np.array(corners) - tip) @ way).min() == pytest.approx(0.0, abs=1e-9)  # the support is beyond the tip
        assert (tip + (top - tip[2]) / way[2] * way)[0] == pytest.approx(x + 0.15, abs=1e-3)
    assert f"dark: reactions, the longest {size.max():.4g} N" in found._text.input
    assert len(colours) == 1 and max(colours[0]) < 0.3  # dark, as magenta is the colour of ties
    assert [row["F_z"] for row in table] == force[:, 2].tolist() and table[1]["support"] == "right"


def test_a_fall_is_told_from_an_equilibrium(tmp_path, drawing):
    """A floor turns until its block overturns: the last frames are labelled as a fall, not as an equilibrium."""
    text = (
        header(title="turn")
        + block("floor", (0.0, 0.0, -0.1), (1.0, 1.0, 0.2), "fixed = true")
        + block("block", (0.0, 0.0, 0.25), (0.2, 0.4, 0.5))
        + """
[control]
kind = "settlement"
supports = ["floor"]
rotation = { axis = [0.0, 1.0, 0.0], angle = 30.0, point = [0.0, 0.0, 0.0] }
tolerance = 0.05
"""
    )
    simulate(toml.loads(text), tmp_path / "turn.h5")
    with history.read(tmp_path / "turn.h5") as run:
        last = int(run.time[-1])
        found = drawn(run, frames=(last, -1), view="front")
        assert f"\nfalling after equilibrium {last}, " in found._text.input
        found.show(last)
        assert f"\nequilibrium {last}, reaction along the motion " in found._text.input
        rows, joints = joint_table(run), JointMotion(run)
        assert rows[0]["N"] == pytest.approx(2000.0 * 9.81 * 0.04 * math.cos(math.radians(30.0)), rel=0.2)
        assert rows == joint_table(run, last) and joints.at([last]).resultants[0][0, 0] == rows[0]["N"]
        assert not joints.at([-1]).resultants[0][:, :6].any()
        assert rows[0]["utilisation"] > 0.9 and joint_table(run, -1)[0]["N"] == 0.0
        assert joint_table(run, time=last + 1.0)[0]["N"] == rows[0]["N"]
        assert not drawn(run, frames=(last, -1), view="front", reactions=True)._reactions._arrows["length"][0]
        for look, shown in (({}, "falling after"), ({"color": "utilisation"}, "equilibrium")):
            assert frame_number(run, in_rows=render.Look(**look).needs_forces) == (
                run.n_frames - 1 if shown[0] == "f" else last
            )
