"""Consistent figures: a colour and a mark per formulation, legends with what differs, suitable units."""

from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.legend import Legend

import dembrick
from dembrick import history
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.runs.study import sweep
from dembrick.scenario.regimes import OF_ACTUATORS
from dembrick.views import page, plot, summary
from dembrick.views.plot import style
from dembrick.views.plot.studies import unit_of
from helpers import history_cases as cases
from helpers.one_joint import scene, single
from helpers.scenario_text import block, header

G = (-9.8, -5.0)
PANELS = {"concave": None, "convex": 80.0}  # formulation and measured V (N)
TITLE = "Granite blocks, jack at 0.12 m"


def result(formulation, title=TITLE, size=100.0, path="run.h5", travel=1e-4):
    """A made-up run up to ``size`` (N), with the attributes that figures read."""
    rows = {"time": np.arange(3.0), "load": size * np.arange(3.0) / 2.0, "displacement": travel * np.arange(3.0) / 2.0}
    point = {"V": 0.9 * size, "V_lower": 0.89 * size, "V_upper": 0.91 * size, "bracket": "certified"}
    results = {"title": title, "formulation": formulation, "yield_point": point}
    return SimpleNamespace(rows=rows, curve=OF_ACTUATORS, results=results, path=path)


def legend(figure):
    return [text.get_text() for text in legend_parts(figure)[0]]


def legend_parts(figure):
    """The texts and the handles of all legends of a figure."""
    return [[own for one in figure.legends for own in parts(one)] for parts in (Legend.get_texts, Legend.get_lines)]


def test_a_formulation_has_its_colour_whatever_stands_beside_it():
    for names in (["concave", "convex"], ["corrected", "concave", "distributed"], ["corrected-shear"]):
        lines = plot.force_displacement([result(name) for name in names]).axes[0].lines
        assert [line.get_color() for line in lines] == [style.FORMULATION[name][0] for name in names]
        for name in set(names) - {"distributed"}:  # its domain depends on its points
            (line,) = plot.domains(joint=(0.3, 0.2, 0.6, 467.0), formulations=[name], experiments={}).axes[0].lines
            assert line.get_color() == style.FORMULATION[name][0]


def test_runs_of_one_formulation_are_told_apart_by_shade_and_dashes():
    runs = [result("convex", path=f"{name}.h5") for name in "abc"]
    lines = plot.force_displacement([*runs, result("concave")]).axes[0].lines
    colours = [line.get_color() for line in lines]
    assert len(set(colours)) == 4 and colours[0] == style.FORMULATION["convex"][0]
    assert not set(colours[1:3]) & {own[0] for own in style.FORMULATION.values()}
    assert len({line.get_linestyle() for line in lines[:3]}) == 3


def test_two_runs_of_one_formulation_differ_in_grey_print():
    """Their luminance differs by a quarter of the scale at least: dashes that overlap look like a full line."""
    lines = plot.force_displacement([result("convex", path=f"{name}.h5") for name in "ab"]).axes[0].lines
    first, second = (np.array([0.299, 0.587, 0.114]) @ to_rgb(line.get_color()) for line in lines)
    assert abs(first - second) > 0.25


def test_a_legend_is_as_wide_as_its_figure_at_most():
    """Its last columns go to another row, where they were cut at the edge."""
    figure = style.new_figure((4.0, 3.0))
    axes = figure.add_subplot()
    for i in range(4):
        axes.plot([0.0, 1.0], [0.0, 1.0], label=f"{i}: a rather long description")
    style.legend(figure, axes, True, columns=4)
    (drawn,) = figure.legends
    assert drawn.get_window_extent().width <= figure.bbox.width and len(drawn.get_texts()) == 4


def test_an_energy_has_its_colour_in_every_panel_and_stands_in_the_legend(tmp_path):
    """The first run has no friction and no crushing, the second no springs that let go."""
    kinds = (cases.CONSTANT_RATE, {"friction", "crushing"}), (cases.MOTION, {"released"})
    runs = []
    for control, without in kinds:
        rows = cases.record(0, 5) if control is cases.CONSTANT_RATE else cases.moving_record(0, 5)
        rows["energy"] = {name: 0.0 * own if name in without else own for name, own in rows["energy"].items()}
        runs.append(cases.written(tmp_path / f"{control.kind}.h5", rows, control=control))
    figure = plot.energies(runs)
    looks = [{line.get_label(): (line.get_color(), line.get_linestyle()) for line in own.lines} for own in figure.axes]
    both = set(looks[0]) & set(looks[1])
    assert "dashpots" in both and all(looks[0][name] == looks[1][name] for name in both)
    named = {text.get_text(): handle for text, handle in zip(*legend_parts(figure), strict=True)}
    for name, look in (looks[0] | looks[1]).items():
        assert (named[name].get_color(), named[name].get_linestyle()) == look
    assert len({*looks[0].values(), *looks[1].values()}) == len(named) > len(style.CYCLE)
    for run in runs:
        run.close()


def test_the_legend_of_several_panels_has_all_that_is_in_any_of_them():
    panels = [plot.CurvePanel(name, [result(name)], [name], measured) for name, measured in PANELS.items()]
    assert legend(plot.curve_panels(panels)) == ["concave", "convex", "experiment (measured V)"]


def test_the_page_has_the_colours_of_the_figures():
    css = page._own("style.css")
    light = css.split("@media")[0]
    for name, (colour, _, _) in style.FORMULATION.items():
        variable = css.split(f"\n.{name} {{ stroke: var(")[1].split(")")[0]
        assert f"{variable}: {colour.lower()};" in light


def test_a_legend_says_what_differs_and_the_title_what_is_shared():
    figure = plot.force_displacement([result(name) for name in ("concave", "convex")])
    assert figure.axes[0].get_title() == TITLE
    assert legend(figure) == ["concave", "convex", "bands: brackets of the limits"]
    figure = plot.force_displacement([result("convex", f"Test: N = {n} kN, slow") for n in (1, 2)])
    assert figure.axes[0].get_title() == "Test: slow, convex"
    assert [text for text in legend(figure) if "band" not in text] == ["N = 1 kN", "N = 2 kN"]
    same = [result("convex", path=f"/somewhere/{name}.h5") for name in ("soft", "stiff")]
    assert [text for text in legend(plot.force_displacement(same)) if "band" not in text] == ["soft", "stiff"]


@pytest.mark.parametrize("size, unit, factor", [(9000.0, "N", 1.0), (19347.0, "kN", 1e-3), (2e7, "MN", 1e-6)])
def test_large_loads_are_drawn_in_kilonewtons(size, unit, factor):
    figure = plot.force_displacement(result("convex", size=size), references={"theory": size})
    axes = figure.axes[0]
    assert axes.get_ylabel() == f"load V [{unit}]"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), factor * size * np.arange(3.0) / 2.0)
    (band,) = axes.patches
    assert (band.get_y(), band.get_height()) == pytest.approx((0.89 * factor * size, 0.02 * factor * size))
    assert legend(figure)[-1] == f"theory: {factor * size:.5g} {unit}"
    assert all(f" {unit}" in text for text in legend(figure)[1:])


@pytest.mark.parametrize("travel, unit", [(1e-4, "µm"), (9.36e-3, "mm"), (4e-4, "mm"), (3.0, "m")])
def test_travels_are_drawn_in_the_unit_that_suits_them(travel, unit):
    assert plot.force_displacement(result("convex", travel=travel)).axes[0].get_xlabel().endswith(f"[{unit}]")


def test_loads_in_words():
    assert [summary.load_text(value) for value in (216.0, 1.935e4, -5.5e7)] == ["216 N", "19.35 kN", "-55 MN"]


# --- components of control points ---

FREE = header(friction=0.3, title="a block in the air")
FREE += block("ground", (0.0, 0.0, -0.05), (0.6, 0.4, 0.1), "fixed = true")
FREE += block("block", (0.0, 0.0, 2.0), (0.2, 0.2, 0.1), "velocity = [-0.5, 0.0, 3.0]")
FREE += '[[control_points]]\nname = "top"\nblock = "block"\npoint = [0.0, 0.0, 2.05]\n'
FREE += '[control]\nkind = "dynamic"\nduration = 0.5\n'


@pytest.fixture(scope="module")
def flying(tmp_path_factory):
    path = tmp_path_factory.mktemp("flying") / "flying.h5"
    dembrick.simulate(dembrick.loads(FREE), path)
    with history.read(path) as run:
        yield run


def test_components_of_points_have_their_signs(flying):
    """A block thrown left and upwards follows a parabola; the component y, which stays 0, is left out."""
    lines = {line.get_label(): line.get_xydata() for line in plot.control_points(flying).axes[0].lines}
    assert list(lines) == ["top, $u_x$", "top, $u_z$"]
    t = flying.time
    scale = 1e3  # mm
    np.testing.assert_allclose(lines["top, $u_x$"][:, 1], scale * -0.5 * (t - t[0]), atol=1e-6 * scale)
    rise = 3.0 * (t - t[0]) - 0.5 * 9.81 * (t - t[0]) ** 2
    np.testing.assert_allclose(lines["top, $u_z$"][:, 1], scale * rise, atol=2e-3 * scale)


def test_components_are_chosen(flying):
    lines = {
        line.get_label(): line.get_ydata() for line in plot.control_points(flying, components=["length"]).axes[0].lines
    }
    assert list(lines) == ["top, |u|"] and lines["top, |u|"].min() >= 0.0
    with pytest.raises(ScenarioError, match="component 'w' is unknown; use any of x, y, z, length"):
        plot.control_points(flying, components=["w"])


# --- studies ---


def table_of(tmp_path, head, rows):
    (tmp_path / "table.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return plot.read_study(tmp_path / "table.csv")


def test_a_study_of_a_tilt_is_drawn_in_degrees(tmp_path):
    head = "case,joint.friction,status,V,V_lower,V_upper,collapse_angle,collapse_load_factor"
    V = [0.25, 0.35]
    rows = [
        f"{i},{0.4 + 0.2 * i},collapse,{v},{v - 0.01},{v + 0.01},{np.degrees(np.arctan(v))},{v}"
        for i, v in enumerate(V)
    ]
    axes = plot.study(table_of(tmp_path, head, rows)).axes[0]
    assert axes.get_ylabel() == r"table angle $\theta$ at the limit [deg]" and axes.get_xlabel() == "joint.friction [-]"
    line, _, (bars,) = axes.containers[0]
    np.testing.assert_allclose(line.get_ydata().astype(float), np.degrees(np.arctan(V)))
    ends = [np.degrees(np.arctan([v - 0.01, v + 0.01])) for v in V]
    np.testing.assert_allclose([segment[:, 1].astype(float) for segment in bars.get_segments()], ends)


@pytest.mark.parametrize("over, count", [("joint.friction", 2), ("joint.formulation", 12)], ids=["lines", "a cloud"])
def test_formulations_of_a_study_have_their_colours(tmp_path, over, count):
    """A legend names lines; the axis labels clouds."""
    head = "case,joint.formulation,joint.friction,status,V,V_lower,V_upper,collapse_angle,collapse_load_factor"
    names = ("concave", "convex", "corrected")
    cases = enumerate((name, 0.5 + 0.01 * i) for name in names for i in range(count))
    rows = [f"{i},{name},{mu},yield,{100 * mu},,,," for i, (name, mu) in cases]
    axes = plot.study(table_of(tmp_path, head, rows), over=[over]).axes[0]
    assert [own[0].get_color() for own in axes.containers] == [style.FORMULATION[name][0] for name in names]
    assert [len(own[0].get_xdata()) for own in axes.containers] == [count] * 3
    assert axes.get_ylabel() == "V [N]" and (axes.get_legend() is not None) == (over == "joint.friction")


@pytest.mark.parametrize(
    "key, unit",
    [
        ("joint.friction", "-"),
        ("joint.normal_stiffness", "Pa/m"),
        ("arches.arch.thickness", "m"),
        ("materials.stone.density", "kg/m3"),
        ("control.pulse.duration", "s"),
        ("control.sine.amplitude", ""),  # of a quantity that is not known
        ("loads.push.sine.amplitude", "-"),
        ("gravity.2", "m/s2"),
        ("gravity", "m/s2"),
        ("joint.formulation", ""),
        ("nothing.here", ""),
    ],
)
def test_keys_have_their_units(key, unit):
    assert unit_of(key) == unit


@pytest.mark.parametrize("quantity, unit", [("", "m/s2"), ("velocity", "m/s"), ("displacement", "m")])
def test_amplitudes_of_a_base_motion_have_the_unit_of_its_quantity(tmp_path, quantity, unit):
    text = header("convex", 0.5, 1e8) + block("floor", (0, 0, -0.1), (4, 4, 0.2), "fixed = true")
    text += block("stone", (0, 0, 0.05), (0.4, 0.4, 0.1))
    text += '[control]\nkind = "base-motion"\nduration = 0.01\ndirection = [1.0, 0.0, 0.0]\n'
    text += "sine = { amplitude = 1.0, frequency = 5.0 }\n" + (f'quantity = "{quantity}"\n' if quantity else "")
    (tmp_path / "base.toml").write_text(text)
    grid = '"control.sine.amplitude" = [1e-3, 2e-3]'
    (tmp_path / "study.toml").write_text(f'base = "base.toml"\n[grid]\n{grid}\n')
    sweep(tmp_path / "study.toml", tmp_path / "found")
    (axes,) = plot.study(plot.read_study(tmp_path / "found")).axes
    assert axes.get_xlabel() == f"control.sine.amplitude [{unit}]"


def test_loads_of_a_study_are_in_the_unit_of_its_cases(tmp_path):
    head = "case,joint.friction,status,V,V_lower,V_peak,load_unit,V_1"
    for told, V, others in (("N", "V [N]", "N"), ("1", "load factor V [-]", "-")):
        table = table_of(tmp_path, head, [f"{i},0.{i + 3},yield,5,5,5,{told},100" for i in (0, 1)])
        assert plot.study(table).axes[0].get_ylabel() == V
        for answer in ("V_lower", "V_peak"):
            label = plot.study(table, answer).axes[0].get_ylabel()
            assert label.endswith(f"[{others}]")
        assert plot.study(table, "V_1").axes[0].get_ylabel() == "V 1 [N]"


def test_open_brackets_have_arrows_and_no_bar_is_told_that_is_not_there(tmp_path):
    head = "case,joint.friction,status,V,V_lower,V_upper,bracket,path_dependent,digits_open"
    ends = {"open": "10,", "indicator": "9,11"}
    for bracket, said in (
        ("open", "depends on the load path"),
        ("indicator", "depends on the load path; bar: what was found"),
    ):
        rows = [f"{i},0.{i + 3},completed,10,{ends[bracket]},{bracket},true,false" for i in (0, 1)]
        axes = plot.study(table_of(tmp_path, head, rows)).axes[0]
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        arrows = [own for own in axes.texts if own.arrow_patch is not None]
        assert (labels, len(arrows)) == (([said, "no upper bound"], 2) if bracket == "open" else ([said], 0))


def test_keys_in_the_legend_of_a_study_are_told_apart(tmp_path):
    head = "case,gravity.2,blocks.0.density,blocks.1.density,status,V"
    rows = [f"{i},{g},{a},{b},yield,{i}" for i, (g, a, b) in enumerate((g, a, b) for g in G for a in (1, 2) for b in G)]
    table = table_of(tmp_path, head, rows)
    labels = [own.get_label() for own in plot.study(table, over=["blocks.1.density"]).axes[0].containers]
    assert labels[0] == "gravity.2 -9.8, density 1" and len(set(labels)) == 4
    labels = [own.get_label() for own in plot.study(table, over=["gravity.2"]).axes[0].containers]
    assert labels[0] == "blocks.0.density 1, blocks.1.density -9.8"


def test_a_settled_figure_is_the_one_that_saving_lays_out(tmp_path):
    """The saved files are equal to the last byte, and the settled figure has no layout engine any more."""
    for name, settled in (("own.png", False), ("settled.png", True)):
        figure = plot.force_displacement([result("convex"), result("concave")])
        if settled:
            style.settle(figure)
            assert figure.get_layout_engine() is None
        plot.save(figure, tmp_path / name)
    assert (tmp_path / "own.png").read_bytes() == (tmp_path / "settled.png").read_bytes()


def test_a_study_is_drawn_under_its_title(tmp_path):
    head, rows = "case,joint.friction,status,V", ["0,0.5,yield,200", "1,0.6,yield,240"]
    assert plot.study(table_of(tmp_path, head, rows)).get_suptitle() == ""  # a table without its study
    (tmp_path / "table.h5").write_bytes(b"no table")
    assert plot.study(table_of(tmp_path, head, rows)).get_suptitle() == ""
    with h5py.File(tmp_path / "table.h5", "w") as file:
        file.attrs["title"] = "Two frictions, $x$"
    assert plot.study(table_of(tmp_path, head, rows)).get_suptitle() == r"Two frictions, \$x\$"


# --- titles ---


def test_titles_do_not_break_at_equals_signs_or_before_units():
    title = "My dry wall on a tilting table; joint wall.base/wall.1.8, N = 1177 N"
    for width in range(20, 70):
        lines = style.wrapped(title, width).split("\n")
        assert " ".join(lines) == title and "N = 1177 N" in lines[-1], width
        assert all(len(line) <= width for line in lines if " " in line)
    assert style.wrapped("set of 10 blocks", 10) == "set of 10\nblocks"


def test_a_layout_says_what_its_letters_are(pushed_in_plan):
    with history.read(pushed_in_plan) as found:
        assert plot.layout([found]).get_supxlabel() == "O: centroid of the joint, C: torsion centre"
        assert plot.layout([found], torsion_centre=False).get_supxlabel() == ""


@pytest.mark.parametrize("point, direction", [
    ((0.0, 0.1), (0.0, 1.0)), ((0.0, -0.1), (0.0, -1.0)), ((0.15, 0.0), (1.0, 0.0)), ((-0.15, 0.0), (-1.0, 0.0)),
    ((0.05, 0.1), (0.6, 0.8)),
])  # fmt: skip
def test_a_jack_that_pulls_outwards_is_in_its_layout(point, direction):
    """The arrow, which is left out where its tip is outside the axes, and the letter beside it, in the figure."""
    figure = plot.layout(scene(jacks=single(point, direction=(*direction, 0.0))))
    figure.draw_without_rendering()
    (axes,) = figure.axes
    tips = [own for own in axes.texts if own.arrow_patch is not None and own.arrow_patch.get_linewidth() > 1.0]
    letter = next(own for own in axes.texts if own.get_text() == "V")
    assert len(tips) == 1 and axes.viewLim.contains(*tips[0].xy)
    assert tips[0].xy == pytest.approx(np.array(point) + 0.126 * np.array(direction), rel=1e-9)
    box = letter.get_window_extent()
    assert figure.bbox.contains(box.x0, box.y0) and figure.bbox.contains(box.x1, box.y1)
    others = [own.get_window_extent() for own in axes.texts if own.get_text() not in ("", "V")]
    assert not box.count_overlaps(others)


@pytest.fixture(scope="module")
def pushed_in_plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "run.h5"
    simulate(scene(jacks=single((0.075, 0.0))), path)
    return path
