"""Figures and pages of limits without an upper bound, and the ends of their colour scales."""

import numpy as np
import pytest

from dembrick.views import plot, summary
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices
from dembrick.views.page import content
from dembrick.views.plot import subject


@pytest.mark.parametrize("upper", [4e4, None])
@pytest.mark.parametrize("own_axes", [False, True])
def test_an_open_bracket_is_a_line_at_what_the_limit_has_at_least(run, monkeypatch, upper, own_axes):
    """An upper bound that is missing or huge leaves the axis at the range of the curve."""
    bare = plot.force_displacement([run], bracket=False).axes[0].get_ylim()
    most = float(np.abs(run.load).max())
    point = {"V": 0.9 * most, "V_lower": 0.9 * most, "V_upper": upper, "bracket": "open"}
    monkeypatch.setitem(run.__dict__, "results", {"title": "open", "yield_point": point})
    given = plot.force_displacement([run], bracket=False).axes[0] if own_axes else None
    axes = given or plot.force_displacement([run]).axes[0]
    if own_axes:
        assert plot.force_displacement([run], ax=axes) is axes.figure
    assert not axes.patches and axes.get_ylim() == pytest.approx(bare, rel=0.05)
    (line,) = (line for line in axes.lines if "no upper bound" in line.get_label())
    assert np.unique(line.get_ydata()) == pytest.approx([0.9 * most])
    arrows = [note for note in axes.texts if note.arrow_patch is not None]
    assert arrows and [note.xy[1] for note in arrows] == pytest.approx([0.9 * most] * len(arrows))
    assert all(note.xyann[1] > 0.0 for note in arrows)  # upwards
    chart = content.collect(run)["curve"]
    assert chart["band"] is None
    assert [level["y"] for level in chart["levels"] if "no upper bound" in level["name"]] == pytest.approx([0.9 * most])


def test_a_bound_of_limit_analysis_is_in_the_unit_of_the_load():
    """In kN, and in degrees of a table."""
    point = {"V": 6e4, "V_lower": 5e4, "V_upper": 1e6, "bracket": "open"}
    results = {"yield_point": point, "path": {"associative": {"upper": 61000.0}}}
    said = subject.Diagram("load V", "N", "displacement").limit(results)[2]
    assert said == "60 kN (at the end, at most 61 kN by limit analysis; the limit is at least 50 kN)"
    point = {"V": 1.0, "V_lower": 0.0, "bracket": "open"}
    tilted = {"yield_point": point, "collapse": {"associative": {"upper": 3**0.5}}}
    said = subject.Diagram("table angle", "deg", "displacement", tilts=True).limit(tilted)[2]
    assert said == "45 deg (at the end, at most 60 deg by limit analysis; the limit is at least 0 deg)"


def test_a_closed_bracket_stays_a_band(run, monkeypatch):
    point = {"V": 2.0, "V_lower": 1.9, "V_upper": 2.1, "bracket": "certified"}
    monkeypatch.setitem(run.__dict__, "results", {"title": "closed", "yield_point": point})
    figure = plot.force_displacement([run]).axes[0]
    assert len(figure.patches) == 1 and not figure.texts
    assert content.collect(run)["curve"]["band"] == pytest.approx([1.9, 2.1])


def test_colours_of_a_page_reach_up_to_what_it_shows_first(run, monkeypatch):
    """The scale ends at the limit, the second of four frames; the fall after it would leave a single colour there."""
    at = float(run.frame_time[1])
    V = float(np.interp(at, run.time, run.load))
    monkeypatch.setitem(run.__dict__, "searches_limit", True)
    monkeypatch.setitem(run.__dict__, "results", {"yield_point": {"V": V, "limit_at": at}})
    body, block, _ = all_vertices(run)
    moved = np.linalg.norm(CarriedPoints(run, body, block).moved(Poses.read(run, 0, run.n_frames)), axis=2).max(axis=1)
    data = content.collect(run)
    assert data["shown"] == 1 and moved[-1] > 1.5 * moved[1] > 0.0
    assert data["most"] == pytest.approx(moved[1])
    assert data["mostText"] == f"{summary.length(moved[1])} and more (a corner)" == data["colours"][0]["text"]
    slip = next(colour for colour in data["colours"] if colour["name"] == "slip")
    rows = np.abs(run.time[:, None] - run.frame_time[:2]).argmin(axis=0)
    assert slip["most"] == pytest.approx(run.joint("slip")[rows].max())


def test_reactions_that_limit_analysis_allowed_are_lines_with_their_numbers(run, monkeypatch):
    """An unbounded end has no line, several runs share one label, and the axis includes every line."""
    allowed = {"least": 0.5, "greatest": 3.0 * float(np.abs(run.load).max())}
    monkeypatch.setitem(run.__dict__, "results", {"title": "spread", "settlement": {"limit_analysis": allowed}})
    axes = plot.force_displacement([run]).axes[0]
    lines = {line.get_label(): np.unique(line.get_ydata()) for line in axes.lines}
    words = "by limit analysis, before the supports moved"
    for which, value in allowed.items():
        (drawn,) = (at for name, at in lines.items() if name == f"{which} {words}: {summary.load_text(value)}")
        assert drawn == pytest.approx([value])
    assert axes.get_ylim()[1] > allowed["greatest"]
    levels = {level["look"]: level for level in content.collect(run)["curve"]["levels"]}
    assert {look: level["y"] for look, level in levels.items()} == pytest.approx(allowed)
    assert levels["least"]["name"] == f"least {words}: 0.5 N"
    both = [line.get_label() for line in plot.force_displacement([run, run]).axes[0].lines]
    assert [name for name in both if words in name] == [f"least {words}", f"greatest {words}"]
    allowed["greatest"] = None
    names = [line.get_label() for line in plot.force_displacement([run]).axes[0].lines]
    assert [name for name in names if words in name] == [f"least {words}: 0.5 N"]
    bare = plot.force_displacement([run], bracket=False).axes[0].lines
    assert not any(words in str(line.get_label()) for line in bare)
