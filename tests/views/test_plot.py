"""Figures show the numbers of their histories, and are written completely or not at all."""

import dataclasses
import json
import sys

import numpy as np
import pytest
from matplotlib.patches import Rectangle

import dembrick
from dembrick import cli, history, theory
from dembrick.errors import HistoryError, OutputError, ScenarioError
from dembrick.scenario import shipped
from dembrick.views import plot
from dembrick.views.plot import subject
from helpers import history_cases as cases
from helpers.scenario_text import block, header

joint_plane_module = sys.modules["dembrick.views.plot.joint_plane"]  # in the package this name is the function

POINT = {"V": 216.0, "V_lower": 215.0, "V_upper": 218.0, "bracket": "certified", "V_1": 0.0, "V_2": 216.0}
POINT |= {"M_T": 16.2, "N": 467.0, "torsion_centre": [-0.12, 0.0]}
RESULTS = {"title": "Set 4a: one force", "formulation": "concave", "yield_point": POINT}


@pytest.fixture
def run(tmp_path):
    rows, poses = cases.record(0, 40), cases.frames(0, 4)
    rows["joint"][..., 4:6] = 0.0  # N acts in the middle
    with cases.written(tmp_path / "run.h5", rows, poses, status="yield", results=RESULTS) as found:
        yield found


def texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_the_curve_is_that_of_the_history_in_micrometres(run):
    figure = plot.force_displacement([run, run], labels=["one", "two"], references={"theory": 216.05})
    line = figure.axes[0].lines[0]
    np.testing.assert_allclose(line.get_xdata(), 1e6 * run.displacement, rtol=1e-12)
    np.testing.assert_array_equal(line.get_ydata(), run.load)
    assert texts(figure) == ["one", "two", "bands: brackets of the limits", "theory: 216.05 N"]
    assert figure.axes[0].lines[2].get_ydata()[0] == 216.05
    bands = [own for own in figure.axes[0].patches if isinstance(own, Rectangle)]  # other patches belong to the legend
    for band in bands:  # the bracket
        assert (band.get_y(), band.get_y() + band.get_height()) == pytest.approx((215.0, 218.0))
    assert len(bands) == 2


def test_axes_of_the_user_are_drawn_in(run):
    from matplotlib.figure import Figure

    own = Figure()
    ax = own.add_subplot()
    assert plot.force_displacement(run, ax=ax) is own
    assert ax.get_legend() is not None


def test_points_come_from_the_file(run):
    (row,) = plot.domain_points([run])
    assert (row["a"], row["b"], row["friction"]) == (pytest.approx(0.3), pytest.approx(0.2), 0.64)
    assert (row["V_2"], row["M_T"], row["load_height"], row["formulation"]) == (216.0, 16.2, 0.0, "concave")


def test_domains_mark_simulated_and_measured_points(run):
    figure = plot.domains([run])
    ax = figure.axes[0]
    marker = next(c for c in ax.containers if c.get_label() == "DEM concave")
    assert (marker[0].get_xdata()[0], marker[0].get_ydata()[0]) == (216.0, 16.2)
    bar = marker[2][0].get_segments()[0]
    np.testing.assert_allclose(bar[:, 0], [215.0, 218.0])
    lab = next(line for line in ax.lines if line.get_label() == "experiment")
    np.testing.assert_allclose(lab.get_xdata(), [0.0, 0.0, 216.0, 166.0])
    np.testing.assert_allclose(lab.get_ydata(), [0.27 * 108, 0.15 * 205, 0.075 * 216, 0.135 * 166])
    assert marker[0].get_zorder() > lab.get_zorder()  # in the same place, and smaller
    convex = next(line for line in ax.lines if line.get_label() == "convex")
    assert convex.get_ydata().max() == pytest.approx(0.64 * 467 * 0.09681061, rel=1e-7)
    assert convex.get_xdata().max() == pytest.approx(0.64 * 467, rel=1e-12)


def test_interaction_is_normalised_by_the_formulation(run):
    figure = plot.interaction([run], approximations=["parabola"])
    marker = next(c for c in figure.axes[0].containers if c.get_label() == "DEM concave")
    assert marker[0].get_xdata()[0] == pytest.approx(216 / (0.64 * 467))
    assert marker[0].get_ydata()[0] == pytest.approx(16.2 / (0.64 * 467 * np.hypot(0.15, 0.1)))
    assert "concave = corrected" in texts(figure)
    for name in ("convex", "concave = corrected"):
        line = next(line for line in figure.axes[0].lines if line.get_label() == name)
        assert (line.get_xdata().max(), line.get_ydata().max()) == pytest.approx((1.0, 1.0), rel=1e-12)


def test_layout_shows_the_eccentricity_and_edges(run):
    shown = [text.get_text() for text in plot.layout([run, run]).axes[1].texts]
    assert "e = 0.075 m\n= 0.25 a" in shown and "a = 0.3 m" in shown and "b = 0.2 m" in shown and "C" in shown
    cross = next(line for line in plot.layout(run).axes[0].lines if line.get_marker() == "x")
    assert cross.get_xydata()[0] == pytest.approx([-0.12, 0.0], rel=1e-12)


def test_other_series(run):
    np.testing.assert_array_equal(plot.unbalanced(run).axes[0].lines[0].get_ydata(), run.unbalanced)
    np.testing.assert_array_equal(plot.energies(run).axes[0].lines[1].get_ydata(), run.energy[run.energy_names[1]])


@pytest.mark.parametrize("ending, start", [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_files_are_written(run, tmp_path, ending, start):
    path = tmp_path / f"figure{ending}"
    assert plot.save(plot.unbalanced(run), path) == str(path)
    assert path.read_bytes().startswith(start)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([path.name, "run.h5"])


def test_errors_name_the_remedy(run, tmp_path):
    figure = plot.unbalanced(run)
    with pytest.raises(OutputError, match=r"\.png, \.svg, \.pdf"):
        plot.save(figure, tmp_path / "figure.bmp")
    with pytest.raises(OutputError, match="does not exist"):
        plot.save(figure, tmp_path / "nowhere" / "no" / "figure.png")
    with pytest.raises(ScenarioError, match="2 labels for 1 histories"):
        plot.force_displacement([run], labels=["a", "b"])
    with pytest.raises(ScenarioError, match="needs a joint"):
        plot.domains([])
    with pytest.raises(ScenarioError, match="M_T is missing"):
        plot.domains([{"formulation": "convex", "V_1": 0.0, "V_2": 1.0, "N": 1.0}])


def test_no_energies_is_said(tmp_path):
    written = cases.written(tmp_path / "bare.h5", cases.record(0, 3), channels=("joints",))
    with written as bare, pytest.raises(HistoryError, match="no energies"):
        plot.energies(bare)


# --- joints of real runs ---


@pytest.fixture(scope="module", params=["concave", "convex", "effective"])
def pushed(request, tmp_path_factory):
    """Set 4a at a constant rate, V at e = 0.075 m: corner points with recorded forces, the exact surface, and the
    effective pressure under a load at mid-height."""
    name = "set4a_mid_curve" if request.param == "effective" else "set4a_curve"
    scenario = dembrick.load(shipped.folder() / f"{name}.toml")
    law = {"pressure": "effective"} if request.param == "effective" else {"formulation": request.param}
    law = dataclasses.replace(scenario.joint, **law)
    output = dataclasses.replace(scenario.output, channels=("joints", "energy", "frames", "contacts"))
    scenario = dataclasses.replace(scenario, joint=law, output=output)
    path = tmp_path_factory.mktemp("plot") / "run.h5"
    result = dembrick.simulate(scenario, path)
    with history.read(path) as found:
        yield request.param, found, result


def moment(stage):
    return float((stage.points[:, 0] * stage.friction[:, 1] - stage.points[:, 1] * stage.friction[:, 0]).sum())


def test_a_joint_turns_about_its_elastic_centre_first(pushed):
    """The elastic centre is at -J / (A e), with J / A of four corners at c or of the whole area."""
    kind, run, _ = pushed
    stage = plot.joint_plane(run)[0]
    square = 0.15**2 + 0.1**2 if kind == "concave" else (0.3**2 + 0.2**2) / 12.0
    np.testing.assert_allclose(stage.centre, [-square / 0.075, 0.0], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(stage.load, 0.5 * run.load[-1], rtol=0.1)
    for later in plot.joint_plane(run)[1:]:  # the movement since the last stage is a rotation about its own centre
        across = np.array([[0.0, -1.0], [1.0, 0.0]]) @ (later.points - later.centre).T
        angle = (later.movement.T * across).sum() / (across * across).sum()
        np.testing.assert_allclose(later.movement, angle * across.T, rtol=1e-3, atol=1e-3 * abs(later.movement).max())
    turned = stage.movement[:, 1] / (stage.points[:, 0] - stage.centre[0])
    np.testing.assert_allclose(turned, turned[0], rtol=1e-4)  # a plane rotation about it
    # rotation M_T over the elastic stiffness ks A c^2, or ks J
    assert turned.mean() == pytest.approx(0.075 * stage.load / (4.0e9 * 0.06 * square), rel=2e-3)


def test_a_joint_slides_about_the_centre_of_the_limit_surface(pushed):
    kind, run, result = pushed
    stages = plot.joint_plane(run)
    assert stages[-1].utilisation == pytest.approx(1.0, abs=1e-6) and stages[0].utilisation < 0.6
    own, carried = run.joints[0], subject.carried_by(run, 0)
    law = subject.limit_surface(own, carried)
    centre = theory.limit_load(law, [carried["V_1"], carried["V_2"], carried["M_T"]]).torsion_centre
    # the movement of a whole stage at the end of the run, not one increment
    np.testing.assert_allclose(stages[-1].centre, centre, rtol=2e-2 if kind != "concave" else 0.3, atol=1e-3)
    (last,) = plot.joint_plane(run, frames=[run.n_frames - 1])
    assert last.frame == run.n_frames - 1 and (last.movement != stages[-1].movement).any()


def test_recorded_friction_balances_the_load(pushed):
    kind, run, _ = pushed
    if kind != "concave":
        pytest.skip("only points have forces")
    for stage in plot.joint_plane(run):
        np.testing.assert_allclose(stage.friction.sum(axis=0), [0.0, -stage.load], rtol=1e-6, atol=2e-3)
        assert moment(stage) == pytest.approx(-0.075 * stage.load, rel=1e-5)
        assert np.linalg.norm(stage.friction, axis=1).max() <= stage.limit * (1.0 + 1e-9)
    assert stage.limit == pytest.approx(0.64 * 467 / 4, rel=1e-6)


def test_friction_that_was_not_recorded_is_that_of_the_limit_surface(pushed, monkeypatch):
    kind, run, _ = pushed
    read = history.History.frame_values
    without = lambda self, name, *span: None if name == "contact_force" else read(self, name, *span)  # noqa: E731
    monkeypatch.setattr(history.History, "frame_values", without)
    monkeypatch.setattr(joint_plane_module, "_GRID", 120)
    first, *_, last = plot.joint_plane(run)
    assert first.friction is None  # the joint sticks: the forces of its points are not known
    area = 1.0 if kind == "concave" else 0.06 / len(last.points)
    carried = subject.carried_by(run, 0)
    tolerance = {"concave": 1e-5, "convex": 3e-3, "effective": 1e-2}[kind]  # the edge of a strip cuts grid cells
    assert area * last.friction.sum(axis=0)[1] == pytest.approx(-carried["V_2"], rel=tolerance)
    assert area * moment(last) == pytest.approx(-carried["M_T"], rel=tolerance)
    if kind == "effective":  # the strip on the unloaded side carries nothing
        free = last.points[:, 1] < -0.1 + 2.0 * subject.pressure_centre(carried)[1]
        assert not last.friction[free].any() and last.friction[~free].any(axis=1).all()
    elif kind == "convex":
        assert last.limit == pytest.approx(0.64 * 467 / 0.06, rel=1e-6)
        assert np.linalg.norm(last.friction, axis=1) == pytest.approx(np.full(len(last.points), last.limit))


def test_a_path_ends_on_the_own_limit_surface(pushed):
    kind, run, result = pushed
    path = plot.joint_path(run)
    assert path.joint == "lower/upper" and path.direction == pytest.approx([0.0, 1.0], abs=1e-3)
    np.testing.assert_allclose(path.M_T, 0.075 * path.V, rtol=2e-3, atol=0.05)
    own, *others = path.sections
    assert own.formulation == {"effective": "convex, effective pressure"}.get(kind, kind)
    assert [section.formulation for section in others] == ([] if kind == "convex" else ["convex"])
    order = np.argsort(own.V)
    assert np.interp(path.V[-1], own.V[order], own.M_T[order]) == pytest.approx(path.M_T[-1], rel=1e-3)
    exact = path.sections[-1]
    assert (exact.V[0], exact.M_T[-1]) == pytest.approx((0.64 * 467, 0.64 * 467 * 0.09681061), rel=1e-6)


def test_figures_of_joints_say_what_they_show(pushed):
    kind, run, result = pushed
    figure = plot.joint_stages(run)
    assert figure.get_suptitle().endswith("joint lower/upper")
    narrow = plot.joint_stages(run, stages=1)
    narrow.draw_without_rendering()
    (legend,) = narrow.legends
    assert narrow.bbox.containsx(legend.get_window_extent().x0) and narrow.bbox.containsx(legend.get_window_extent().x1)
    titles = [ax.get_title() for ax in figure.axes]
    assert titles[0].startswith("V = 1") and "utilisation 1\n" in titles[-1]
    assert "torsion centre" in texts(figure) and "friction (longest: at its limit)" in texts(figure)
    assert figure.axes[0].get_ylabel().endswith("concave" if kind == "concave" else "convex")
    for arrows in (own for own in figure.axes[0].collections if own.get_label().startswith("movement")):
        longest = np.hypot(arrows.U, arrows.V).max()
        assert longest == pytest.approx((0.22 if kind == "concave" else 0.16) * np.hypot(0.15, 0.1), rel=1e-12)
    both = plot.joint_stages([run, run], ["one", "two"])
    assert [ax.get_ylabel() for ax in both.axes if ax.get_ylabel()] == ["one", "two"]
    assert len(both.axes) == 2 * len(figure.axes)
    with pytest.raises(ScenarioError, match="1 axes for"):
        plot.joint_stages(run, ax=figure.axes[0])
    found, drawn = plot.joint_path(run), {line.get_label(): line for line in plot.load_path(run, ["one"]).axes[0].lines}
    np.testing.assert_array_equal(drawn["one"].get_xydata(), np.stack([found.V, found.M_T], axis=1))
    name = {"convex": "convex, exact", "effective": "convex, effective pressure"}.get(kind, kind)
    own = np.stack([found.sections[0].V, found.sections[0].M_T], axis=1)
    np.testing.assert_array_equal(drawn[f"limit surface, {name}"].get_xydata(), own)
    point = result.as_dict()["yield_point"]
    star = drawn["yield point"].get_xydata()[0]
    assert star == pytest.approx([abs(point["V_2"]), abs(point["M_T"])], rel=1e-6)
    path = plot.load_path([run, run], ["one", "two"])
    assert {"one", "two", "yield point"} <= set(texts(path))
    assert path.axes[0].get_title() == "joint lower/upper, N = 467 N"


def test_a_path_is_that_of_the_joint_asked_for(tmp_path):
    with cases.written(tmp_path / "two.h5", cases.record(0, 5, 2, 0), blocks=cases.mixed_assembly()) as two:
        path = plot.joint_path(two, 1)
        shear = np.stack([two.joint("V_1")[:, 1], two.joint("V_2")[:, 1]], axis=1)
        np.testing.assert_allclose(path.V, shear @ path.direction, rtol=1e-12)
        np.testing.assert_array_equal(path.M_T, two.joint("M_T")[:, 1])
        assert (two.joint("M_T")[:, 0] != path.M_T).all()


def test_stages_and_joints_that_are_not_there(run, tmp_path):
    with pytest.raises(ScenarioError, match="its joints are lower/upper"):
        plot.joint_path(run, "upper/lid")
    with pytest.raises(ScenarioError, match="joint 3 is out of range"):
        plot.joint_path(run, "3")
    assert plot.joint_path(run, "0").joint == plot.joint_path(run, "lower/upper").joint
    with pytest.raises(ScenarioError, match="at least one"):
        plot.joint_plane(run, stages=0)
    with pytest.raises(ScenarioError, match="within 1 and 3"):
        plot.joint_plane(run, frames=[3, 2])
    written = cases.written(tmp_path / "bare.h5", cases.record(0, 3), channels=("joints", "energy"))
    with written as bare, pytest.raises(HistoryError, match="two frames"):
        plot.joint_plane(bare)


# --- measured curves ---


def curve_file(tmp_path, text):
    path = tmp_path / "lab.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "displacement [mm],force [kN]\n0,0\n0.5,0.2\n1.25,0.16\n",
        "# rig 2\n\nforce [N]; displacement [µm]\n0;0\n200;500\n160;1250\n",
        "\ufeffload [N]\tdisplacement [m]\n0\t0\n200,0\t0,0005\n160\t1.25e-3\n",
        '"displacement [um]","Force [N]"\n0,0\n500,2e2\n1250,160\n',
        "time [s];Displacement (mm);Force (kN)\r\n0;0;0\r\n1;0,5;0,2\r\n2;1,25;0,16\r\n;;\r\n",
    ],
)
def test_measured_curves_are_read_in_their_units(tmp_path, text):
    curve = plot.read_measured(curve_file(tmp_path, text))
    np.testing.assert_allclose(curve.displacement, [0.0, 5e-4, 1.25e-3], rtol=1e-12)
    np.testing.assert_allclose(curve.load, [0.0, 200.0, 160.0], rtol=1e-12)
    assert curve.name == "lab"


@pytest.mark.parametrize(
    "text, said",
    [
        ("0,0\n1,2\n", "the first line must name the columns and their units"),
        ("displacement,force\n0,0\n1,1\n", "'displacement' has no unit"),
        ("displacement [inch],force [N]\n0,0\n1,1\n", "'inch' .* m, cm, mm, um, µm"),
        ("displacement [mm],force [lbf]\n0,0\n1,1\n", "'lbf' .* N, kN"),
        ("displacement [mm],time [s]\n0,0\n1,1\n", "no column has a unit of force"),
        ("displacement [mm],displacement [m],force [N]\n0,0,0\n1,1,1\n", "all have a unit of displacement"),
        ("displacement [mm],force [N]\n0,0\n1,two\n", "line 3: 'two' in column 'force'"),
    ],
)
def test_measured_curves_that_are_none(tmp_path, text, said):
    with pytest.raises(ScenarioError, match=said):
        plot.read_measured(curve_file(tmp_path, text))


def test_measured_curves_lie_over_simulated_ones(run, tmp_path):
    curve = plot.read_measured(curve_file(tmp_path, "displacement [um],force [N]\n0,0\n0.2,120\n"), "rig 2")
    figure = plot.force_displacement(run, labels=["run"], measured=[curve])
    line = next(line for line in figure.axes[0].lines if line.get_label() == "measured: rig 2")
    np.testing.assert_allclose(line.get_xydata(), [[0.0, 0.0], [0.2, 120.0]], rtol=1e-12)


# --- the command ---


@pytest.mark.parametrize("kind", ["curve", "path", "joint", "energies", "unbalanced", "layout", "domain"])
def test_the_command_draws_every_kind(pushed, tmp_path, capsys, kind):
    _, run, _ = pushed
    target = tmp_path / f"{kind}.svg"
    assert cli.main(["plot", run.path, "--kind", kind, "--to", str(target), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"figure": str(target)}
    assert target.read_text(encoding="utf-8").count("<path") > 5


@pytest.mark.parametrize(
    "words, said",
    [
        (["--label", "one", "--label", "two"], "2 labels for 1 histories"),
        (["--lab", "none.csv"], "none.csv: there is no such file"),
        (["--kind", "path", "--lab", "none.csv"], "--lab belongs to --kind curve"),
        (["--joint", "a/b"], "--joint belongs to --kind path or joint, not to curve"),
        (["--stages", "3"], "--stages belongs to --kind joint, not to curve"),
        (["--damping", "0.02"], "--damping belongs to --kind spectrum, not to curve"),
        (["--kind", "path", "--joint", "a/b"], "has no joint 'a/b'"),
    ],
)
def test_the_command_says_what_is_wrong(run, capsys, words, said):
    assert cli.main(["plot", run.path, *words]) == 2
    assert said in capsys.readouterr().err


def test_names_from_anywhere_are_no_formulas(run, tmp_path):
    """Labels stay literal: matplotlib reads text in dollar signs as formulas and hides labels with a leading _."""
    figure = plot.force_displacement([run, run], labels=[r"$\nonsense{", "_hidden"], references={"$x$": 1.0})
    plot.save(figure, tmp_path / "figure.svg")
    assert texts(figure)[1] == " _hidden"
    written = (tmp_path / "figure.svg").read_text(encoding="utf-8")
    assert r"$\nonsense{" in written and "$x$: 1 N" in written


def test_several_energies_stand_side_by_side(run):
    figure = plot.energies([run, run], labels=["one", "two"])
    assert [ax.get_title() for ax in figure.axes] == ["one", "two"]
    with pytest.raises(ScenarioError, match="1 axes for 2 histories"):
        plot.energies([run, run], ax=figure.axes[0])


# --- motion in time -------

TILT = header(friction=0.3, title="a block on a table")
TILT += block("table", (0.0, 0.0, -0.05), (0.6, 0.4, 0.1), "fixed = true")
TILT += block("block", (0.0, 0.0, 0.05), (0.2, 0.2, 0.1)) + "[control]\n"


@pytest.fixture(scope="module")
def tilted(tmp_path_factory):
    path = tmp_path_factory.mktemp("tilt") / "tilt.h5"
    control = 'kind = "tilt"\naxis = [1.0, 0.0, 0.0]\nrate = 10.0\ndisplacement = 0.001\n'
    result = dembrick.simulate(dembrick.loads(TILT + control), path)
    with history.read(path) as run:
        yield result, run


def test_a_tilting_table_has_a_load_factor(tilted):
    result, run = tilted
    for source in (result, run):
        axes = plot.force_displacement(source).axes[0]
        assert axes.get_ylabel() == r"table angle $\theta$ [deg]" and axes.get_xlabel().startswith(
            "displacement of the"
        )
        line = axes.lines[0].get_xydata()
        np.testing.assert_allclose(line[:, 1], 10.0 * run.time, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(line[-1, 0], 1e3 * run.displacement[-1], rtol=1e-12)
    figure = plot.joint_stages(run)
    assert figure.axes[-1].get_title().startswith(r"$\theta$ = 18.2 deg")
    shown = result._repr_html_()
    assert "collapse angle" in shown and shown.rstrip().endswith("</svg>")


def test_curves_without_axes_in_common_are_not_overlaid(tilted, run, tmp_path):
    with pytest.raises(ScenarioError, match="driven in different ways"):
        plot.force_displacement([tilted[1], run])
    curve = plot.read_measured(curve_file(tmp_path, "displacement [um],force [N]\n0,0\n0.2,120\n"))
    with pytest.raises(ScenarioError, match="with runs that have actuators"):
        plot.force_displacement(tilted[1], measured=[curve])


def test_free_blocks_are_drawn_over_time(tilted):
    run = history.read(tilted[1].path)
    run.curve = cases.MOTION.curve
    axes = plot.force_displacement(run).axes[0]
    assert axes.get_xlabel() == "time [s]"
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), run.time)
    assert plot.joint_stages(run).axes[-1].get_title().startswith("at ")
