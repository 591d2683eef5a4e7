"""Figures hold the numbers of their histories, and are written whole or not at all."""

import history_cases as cases
import numpy as np
import pytest

from dembrick import history, plot
from dembrick.errors import HistoryError, OutputError, ScenarioError

POINT = {"V": 216.0, "V_lower": 215.0, "V_upper": 218.0, "bracket": "certified", "V_1": 0.0, "V_2": 216.0}
POINT |= {"M_T": 16.2, "N": 467.0, "torsion_centre": [-0.12, 0.0]}
RESULTS = {"title": "Set 4a: one force", "formulation": "concave", "yield_point": POINT}


@pytest.fixture
def run(tmp_path):
    with history.HistoryWriter(tmp_path / "run.h5", cases.SCENARIO, cases.assembly(), {}) as writer:
        writer.append(cases.record(0, 40))
        writer.append_frames(*cases.frames(0, 4))
        writer.finish("yield", RESULTS)
    with history.read(tmp_path / "run.h5") as found:
        yield found


def texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_the_curve_is_that_of_the_history_in_micrometres(run):
    figure = plot.force_displacement([run, run], labels=["one", "two"], references={"theory": 216.05})
    line = figure.axes[0].lines[0]
    np.testing.assert_allclose(line.get_xdata(), 1e6 * run.displacement, rtol=1e-12)
    np.testing.assert_array_equal(line.get_ydata(), run.load)
    assert texts(figure) == ["one", "two", "theory: 216.05 N"]
    assert figure.axes[0].lines[2].get_ydata()[0] == 216.05


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
    convex = next(line for line in ax.lines if line.get_label() == "convex")
    assert convex.get_ydata().max() == pytest.approx(0.64 * 467 * 0.09681061, rel=1e-7)


def test_interaction_is_normalised_by_the_formulation(run):
    figure = plot.interaction([run], approximations=["parabola"])
    marker = next(c for c in figure.axes[0].containers if c.get_label() == "DEM concave")
    assert marker[0].get_xdata()[0] == pytest.approx(216 / (0.64 * 467))
    assert marker[0].get_ydata()[0] == pytest.approx(16.2 / (0.64 * 467 * np.hypot(0.15, 0.1)))
    assert "concave = corrected" in texts(figure)


def test_layout_shows_the_eccentricity_and_edges(run):
    shown = [text.get_text() for text in plot.layout([run, run]).axes[1].texts]
    assert "e = 0.075 m\n= 0.25 a" in shown and "a = 0.3 m" in shown and "b = 0.2 m" in shown and "C" in shown


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
        plot.save(figure, tmp_path / "nowhere" / "figure.png")
    with pytest.raises(ScenarioError, match="2 labels for 1 histories"):
        plot.force_displacement([run], labels=["a", "b"])
    with pytest.raises(ScenarioError, match="needs a joint"):
        plot.domains([])
    with pytest.raises(ScenarioError, match="M_T is missing"):
        plot.domains([{"formulation": "convex", "V_1": 0.0, "V_2": 1.0, "N": 1.0}])


def test_no_energies_is_said(tmp_path):
    with history.HistoryWriter(tmp_path / "bare.h5", cases.SCENARIO, cases.assembly(), {}) as writer:
        writer.append(cases.record(0, 3, energies=()))
        writer.finish("yield", {})
    with history.read(tmp_path / "bare.h5") as bare, pytest.raises(HistoryError, match="no energies"):
        plot.energies(bare)
