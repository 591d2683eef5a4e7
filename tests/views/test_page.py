"""The page of a run: what it holds, that nothing in a history can act in it, and that it works in a real browser."""

import base64
import json
import re

import numpy as np
import pytest

import dembrick
from dembrick import history
from dembrick.cli import main
from dembrick.errors import HistoryError, OutputError
from dembrick.scenario import shipped
from dembrick.views import page
from dembrick.views.motion.joints import JointMotion
from dembrick.views.page import content
from helpers import browser as browsers
from helpers import history_cases as cases

EVIL = '</script><script>document.title="hacked"</script><img src=x onerror="document.title=1">&lt;$title ${data}'
POINT = {"V": 216.0, "V_lower": 215.0, "V_upper": 217.0, "bracket": "certified", "M_T": 16.2, "N": 467.0}
POINT |= {"V_1": 0.0, "V_2": 216.0, "torsion_centre": [-0.12, 0.0], "mechanism": "torsion-shear"}
RESULTS = {"title": "Set 4a", "formulation": "concave", "yield_point": POINT, "theory": {"V": 216.05, "error": -2e-4}}


def written(
    path, results=RESULTS, scenario=cases.SCENARIO, frames=4, rows=40, assembly=None, status="yield", control=None
):
    assembly = assembly or cases.assembly()
    n_joint, n_jack = len(assembly.joints), len(assembly.actuators.names)
    record = cases.moving_record if control is cases.MOTION else cases.record
    shifted = {"joint_shift": np.zeros((frames, n_joint, 2))} if control is cases.MOTION else {}
    with history.HistoryWriter(path, scenario, assembly, {}, control=control) as writer:
        if rows:
            writer.append(record(0, rows, n_joint, n_jack))
        if frames:
            writer.append_frames(*cases.frames(0, frames, len(assembly.names)), **shifted)
        writer.finish(status, results)
    return path


def data_of(text):
    (found,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    return json.loads(found)


def unpacked(text, kind="<f4"):
    return np.frombuffer(base64.b64decode(text), kind)


@pytest.fixture(scope="module")
def lab_page(tmp_path_factory):
    """A real run, the constant-rate test of set 4b with corner points, and its page."""
    folder = tmp_path_factory.mktemp("page")
    scenario = dembrick.load(shipped.folder() / "set4b_curve.toml")
    text = dembrick.dumps(scenario).replace('"convex"', '"concave"')
    run = dembrick.simulate(dembrick.loads(text), folder / "run.h5")
    page.write(folder / "run.h5", folder / "page.html")
    return run, folder / "page.html"


@pytest.fixture(scope="module")
def chromium():
    executable = browsers.find()
    if executable is None:
        pytest.skip("no Chromium on this machine: install the package chromium, or name one in $CHROMIUM")
    window = browsers.Browser(executable)
    yield window
    window.close()


# --- what is in the file ---


def test_motion_is_that_of_the_history(tmp_path):
    path = written(tmp_path / "run.h5")
    with history.read(path) as run:
        data = data_of(page.document(run))
        shown = unpacked(data["blocks"]["displacement"]).reshape(4, 2, 3)
        turned = unpacked(data["blocks"]["rotation"]).reshape(4, 2, 3)
        for k in range(4):
            np.testing.assert_allclose(shown[k], run.frame_displacement(k), rtol=1e-6)
            np.testing.assert_allclose(turned[k, 1], 0.01 * k * np.array([1.0, 2.0, -2.0]) / 3.0, rtol=1e-6)
        assert data["time"] == pytest.approx(run.frame_time)
        corners = unpacked(data["blocks"]["vertices"]).reshape(-1, 3)
        np.testing.assert_allclose(corners, np.vstack([run.block_vertices(0), run.block_vertices(1)]), rtol=1e-6)
        assert data["blocks"]["fixed"] == [True, False]
        assert data["load"] == pytest.approx(run.load[[0, 10, 20, 30]])
        (jack,) = data["actuators"]
        assert jack["point"] == pytest.approx([0.075, 0.0, 0.0]) and jack["direction"] == [0.0, 1.0, 0.0]
        assert jack["block"] == 1 and jack["out"] == pytest.approx([0.1, 0.1])
        # the farthest corner, by Rodrigues' formula
        axis, body = np.array([1.0, 2.0, -2.0]) / 3.0, run.block_vertices(1)
        moved = (
            body * np.cos(0.03)
            + np.cross(axis, body) * np.sin(0.03)
            + np.outer(body @ axis, axis) * (1.0 - np.cos(0.03))
        )
        moved += run.frame_displacement(3)[1] - body
        assert data["most"] == pytest.approx(np.linalg.norm(moved, axis=1).max(), rel=1e-9)


def test_faces_name_corners_through_all_blocks(tmp_path):
    with history.read(written(tmp_path / "run.h5", assembly=cases.mixed_assembly())) as run:
        data = data_of(page.document(run))
    faces, at, found = unpacked(data["blocks"]["faces"], "<u4").tolist(), 0, []
    while at < len(faces):
        found.append(tuple(faces[at + 1 : at + 1 + faces[at]]))
        at += 1 + faces[at]
    assert found[:6] == list(cases.FACES) and len(found) == 6 + 6 + 5
    assert found[12:] == [tuple(16 + corner for corner in face) for face in cases.wedge().faces]


def test_diagrams_follow_the_record(tmp_path):
    with history.read(written(tmp_path / "run.h5")) as run:
        data = data_of(page.document(run))
        line = data["curve"]["lines"][0]
        assert line["x"] == pytest.approx(1e6 * run.displacement) and line["y"] == pytest.approx(run.load)
        assert data["curve"]["band"] == [215.0, 217.0] and "216.0 ± 1.0 N" in data["curve"]["bandName"]
        # frames are 10 rows apart
        assert data["curve"]["y"] == pytest.approx(run.load[[0, 10, 20, 30]])
        *sections, path = data["path"]["lines"]
        # N grows from row to row, so all is over the strength mu N of its moment: the joint is open in the first row,
        # and four equal points, pressed in the middle, resist a torsion at their distance from O
        assert [line["look"] for line in sections] == ["own", "exact"]
        size = np.hypot(run.joint("V_1")[:, 0], run.joint("V_2")[:, 0])
        direction = np.array([run.joint("V_1")[-1, 0], run.joint("V_2")[-1, 0]]) / size[-1]
        along = np.column_stack([run.joint("V_1")[:, 0], run.joint("V_2")[:, 0]]) @ direction
        N, radius = run.joint("N")[:, 0], 0.93 * np.hypot(0.15, 0.1)
        assert N[0] == 0.0 and path["x"] == pytest.approx(along[1:] / (0.64 * N[1:]), rel=1e-6)
        assert path["y"] == pytest.approx(run.joint("M_T")[1:, 0] / (0.64 * N[1:] * radius), rel=1e-6)


def test_many_frames_are_thinned_to_a_bounded_size(tmp_path, monkeypatch):
    monkeypatch.setattr(content, "MOST_BYTES", 24 * 2 * 10)
    with history.read(written(tmp_path / "run.h5", frames=100, rows=5)) as run:
        chosen = content.chosen_frames(run)
        assert chosen.number.tolist() == [0, 11, 22, 33, 44, 55, 66, 77, 88, 99]
        assert "10 of 100 recorded frames" in page.document(run)


def test_a_run_that_diverged_is_shown_up_to_there(tmp_path):
    with history.HistoryWriter(tmp_path / "run.h5", cases.SCENARIO, cases.assembly(), {}) as writer:
        writer.append(cases.record(0, 9))
        time, displacement, orientation = cases.frames(0, 5)
        displacement[3:] = np.nan
        writer.append_frames(time, displacement, orientation)
        writer.finish("failed", {"error": "the run diverged", "yield_point": None})
    with history.read(tmp_path / "run.h5") as run:
        text = page.document(run)
    assert len(data_of(text)["time"]) == 3 and "the run diverged" in text


def test_key_results_stand_in_the_page_with_error_bars(lab_page):
    run, path = lab_page
    text = path.read_text(encoding="utf-8")
    point = run.yield_point
    (shown,) = re.findall(r'<th scope="row">limit load V</th><td>([\d.]+) ± ([\d.]+) N', text)
    assert float(shown[0]) == pytest.approx(point.V, abs=point.half_width)
    assert float(shown[1]) == pytest.approx(point.half_width, rel=0.06)
    assert "certified" in text and run.scenario.title in text
    told = re.sub(r'"[A-Za-z0-9+/]{16,}=*"', "", text.replace("http://www.w3.org/2000/svg", ""))  # no packed numbers
    assert not re.findall(r"(?:https?:)?//[a-z]", told), "an outside address"


def test_torsion_centre_moves_from_the_elastic_to_the_plastic_one(lab_page):
    """Elastic: at -(sum k r^2 / sum k) / e = -c^2 / e, with four corners at c and the force at e = 0.135 m."""
    run, path = lab_page
    data = data_of(path.read_text(encoding="utf-8"))
    x = np.array([place[0] for place in data["centre"]["places"] if place])
    assert x[1] == pytest.approx(-(0.15**2 + 0.1**2) / 0.135, rel=1e-4)
    assert x[-1] == pytest.approx(run.yield_point.torsion_centre[0], rel=2e-2)


def test_torsion_centres_are_those_between_the_frames_shown(lab_page, monkeypatch):
    run, _ = lab_page
    monkeypatch.setattr(content, "MOST_FRAMES", 7)
    with history.read(run.history) as found:
        data, motion = data_of(page.document(found)), JointMotion(found)
        frames = content.chosen_frames(found).number.tolist()
        assert len(frames) == 7 and max(np.diff(frames)) > 1
        places = data["centre"]["places"]
        assert places[0] is None and len(places) == 7
        for k, since, place in zip(frames[1:], frames[:-1], places[1:], strict=True):
            # the joint lies in the plane z = 0 about the middle of the scene
            assert place == pytest.approx([*motion.torsion_centre(k, since)[0], 0.0], rel=1e-9, abs=1e-12)


# --- a history from elsewhere ---


def evil_history(path):
    assembly = cases.assembly()
    assembly.names = (EVIL, "<!--")
    assembly.joints[0].law.formulation = "concave"
    assembly.actuators.names = (EVIL,)
    point = POINT | {"mechanism": EVIL, "bracket": EVIL, "V_peak": EVIL, "joint": [EVIL, EVIL]}
    results = {"title": EVIL, "formulation": EVIL, "yield_point": point, "theory": [EVIL], "error": EVIL}
    return written(path, results | {"wall": EVIL, "steps": 1e999, "collapse": {"mechanism": EVIL}}, EVIL, status=EVIL,
                   assembly=assembly)  # fmt: skip


def test_text_of_a_history_is_escaped(tmp_path):
    path = evil_history(tmp_path / "evil.h5")
    page.write(path, tmp_path / "evil.html")
    text = (tmp_path / "evil.html").read_text(encoding="utf-8")
    assert text.count("<script") == text.count("</script") == 2
    assert "<img" not in text and "<!--" not in text
    assert "$title ${data}" in text  # shown as it is, not filled in
    data_of(text)


@pytest.mark.parametrize(
    "results",
    [{}, {"yield_point": [1]}, {"yield_point": {"V": "x", "torsion_centre": [None, 1]}}, {"yield_point": {"V": 1e999}}],
)
def test_results_of_any_kind_give_a_page(tmp_path, results):
    with history.read(written(tmp_path / "run.h5", results)) as run:
        data_of(page.document(run))


def test_what_cannot_be_shown_is_said(tmp_path):
    with pytest.raises(OutputError, match=r"end in \.html"):
        page.write(written(tmp_path / "run.h5"), tmp_path / "page.xml")
    with pytest.raises(OutputError, match="does not exist"):
        page.write(tmp_path / "run.h5", tmp_path / "nowhere" / "page.html")
    with pytest.raises(HistoryError, match="no frames"):
        page.write(written(tmp_path / "bare.h5", frames=0), tmp_path / "page.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bare.h5", "run.h5"]


def test_scenes_without_jacks_or_rows(tmp_path):
    moving = written(tmp_path / "run.h5", {}, assembly=cases.mixed_assembly(), control=cases.MOTION)
    with history.read(moving) as run:
        data = data_of(page.document(run))
    assert data["curve"]["title"] == "Displacement over time" and data["actuators"] == [] and data["load"] is None
    with history.read(written(tmp_path / "bare.h5", {}, rows=0)) as run:
        data = data_of(page.document(run))
    assert data["path"] is None and data["curve"]["y"][-1] > 0.0


def test_the_command_writes_it(tmp_path, capsys):
    path = written(tmp_path / "run.h5")
    assert main(["render", str(path), "--to", str(tmp_path / "page.html")]) == 0
    assert "page.html" in capsys.readouterr().out
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


# --- in a browser ---


def set_range(window, name, value):
    window.run(
        f"(() => {{ const s = document.getElementById('{name}'); s.value = {value};"
        "s.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )
    window.settle()


def marker(window, name):
    return window.run(
        f"(() => {{ const m = document.querySelector('#{name} .now');"
        "return [Number(m.getAttribute('cx')), Number(m.getAttribute('cy'))]; })()"
    )


def click(window, x, y, kind="mousePressed", button="left"):
    for event in ("mouseMoved", "mousePressed", "mouseReleased") if kind == "mousePressed" else (kind,):
        pressed = {} if event == "mouseMoved" else {"button": button, "clickCount": 1}
        window.call("Input.dispatchMouseEvent", type=event, x=x, y=y, **pressed)
    window.settle()


@pytest.fixture
def opened(chromium, lab_page):
    chromium.size(1280, 900)
    chromium.open(lab_page[1])
    yield chromium
    assert chromium.problems == []


def test_the_blocks_are_drawn_and_nothing_is_fetched(opened, lab_page):
    pixels = opened.pixels("#view")
    background = pixels[2, 2]
    drawn = (np.abs(pixels - background).max(axis=2) > 30).mean()
    assert 0.15 < drawn < 0.9 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200
    assert opened.run("document.getElementById('no-view').hidden")
    assert opened.requests == [lab_page[1].as_uri()]


def test_the_slider_moves_the_block_and_both_markers(opened):
    last = opened.pixels("#view")
    end = marker(opened, "curve"), marker(opened, "path")
    set_range(opened, "time", 0)
    first = opened.pixels("#view")
    start = marker(opened, "curve"), marker(opened, "path")
    assert (np.abs(last - first).max(axis=2) > 30).mean() > 0.02
    for before, after in zip(start, end, strict=True):
        assert after[0] > before[0] + 50 and after[1] < before[1] - 50  # right and up
    assert opened.run("document.getElementById('time').getAttribute('aria-valuetext')").startswith("frame 1 of")
    set_range(opened, "time", 0)
    assert (opened.pixels("#view") == first).all()


def test_the_marker_stands_where_the_record_says(opened, lab_page):
    data = data_of(lab_page[1].read_text(encoding="utf-8"))
    axes = opened.run(
        "[...document.querySelectorAll('#path text')].map(t => [t.textContent, Number(t.getAttribute('x')),"
        "Number(t.getAttribute('y')), t.getAttribute('text-anchor')])"
    )
    across = [(float(text), x) for text, x, _, anchor in axes if anchor == "middle" and re.fullmatch(r"[\d.]+", text)]
    up = [(float(text), y - 4.0) for text, _, y, anchor in axes if anchor == "end"]
    for frame in (0, 3, len(data["time"]) - 1):
        set_range(opened, "time", frame)
        x, y = marker(opened, "path")
        assert x == pytest.approx(
            np.polyval(np.polyfit(*zip(*across, strict=True), 1), data["path"]["x"][frame]), abs=0.1
        )
        assert y == pytest.approx(np.polyval(np.polyfit(*zip(*up, strict=True), 1), data["path"]["y"][frame]), abs=0.1)


@pytest.mark.parametrize("diagram", ["curve", "path"])
def test_pointing_at_a_diagram_moves_everything(opened, diagram):
    set_range(opened, "time", 0)
    first = opened.pixels("#view")
    start = [marker(opened, name) for name in ("curve", "path")]
    box = opened.box(f"#{diagram} svg")
    set_range(opened, "time", 12)
    wanted = [marker(opened, name) for name in ("curve", "path")]
    x, y = wanted[("curve", "path").index(diagram)]
    set_range(opened, "time", 0)
    click(opened, box["x"] + x, box["y"] + y, kind="mouseMoved")  # hovering is enough
    assert opened.run("Number(document.getElementById('time').value)") == 12
    assert [marker(opened, name) for name in ("curve", "path")] == wanted != start
    assert (opened.pixels("#view") != first).any()
    set_range(opened, "time", 0)
    click(opened, box["x"] + x + 0.3, box["y"] + y)
    assert opened.run("Number(document.getElementById('time').value)") == 12


def choose(window, name, value):
    window.run(
        f"(() => {{ const s = document.getElementById('{name}'); s.value = '{value}';"
        "s.dispatchEvent(new Event('change', {bubbles: true})); })()"
    )
    window.settle()


def test_colours_are_chosen(opened):
    """Of a joint at its limit both blocks are at the end of the scale; without a colour nothing is yellow."""
    options = opened.run("[...document.getElementById('colour').options].map(o => o.textContent)")
    assert options == ["displacement", "utilisation", "slip", "none"]
    views = {}
    for i, name in enumerate(options):
        choose(opened, "colour", i)
        pixels = opened.pixels("#view")
        views[name] = ((pixels[..., 0] - pixels[..., 2]) > 90).mean()
    assert views["utilisation"] > 1.2 * views["displacement"] > 0.0 and views["none"] < 0.01  # the arrow is left
    assert opened.run("document.getElementById('ramp').hidden")
    choose(opened, "colour", 1)
    assert opened.run("document.getElementById('scale-high').textContent").startswith("1: slides")


def test_the_record_can_be_taken_away(opened, lab_page):
    """As CSV in SI units, whose numbers are those of the history."""
    text = opened.run(
        "(() => { let taken; const before = URL.createObjectURL;"
        "URL.createObjectURL = (blob) => { taken = blob; return '#'; };"
        "document.getElementById('download').click(); URL.createObjectURL = before; return taken.text(); })()"
    )
    header, *lines = text.strip().splitlines()
    assert header.startswith("time [s],load V [N],driven displacement [m],N of lower/upper [N],V_1 of lower/upper [N]")
    table = np.array([[float(x) for x in line.split(",")] for line in lines])
    run = lab_page[0]
    assert len(table) <= content.choices.MOST_ROWS + 1
    rows = np.searchsorted(run.rows["time"], table[:, 0])
    np.testing.assert_array_equal(table[:, 1], run.rows["load"][rows])
    np.testing.assert_array_equal(table[:, 3], run.rows["joint"][rows, 0, 0])
    assert table[:, 1].max() == run.rows["load"].max()


def test_joints_are_chosen(chromium, tmp_path):
    """The second diagram is that of the joint asked for, and so is what is taken away."""
    page.write(written(tmp_path / "three.h5", assembly=cases.mixed_assembly()), tmp_path / "three.html")
    data = data_of((tmp_path / "three.html").read_text(encoding="utf-8"))
    assert len(data["joints"]) == 2 and data["joints"][0]["chart"] is None
    with history.read(tmp_path / "three.h5") as found:
        for joint in data["joints"]:
            a, _, b = joint["name"].partition("/")
            number = next(
                i for i, own in enumerate(found.joints)
                if [found.block_names[own[k]] for k in ("block_a", "block_b")] == [a, b]
            )  # fmt: skip
            np.testing.assert_array_equal(unpacked(joint["columns"][0]["values"], "<f8"), found.joint("N")[:, number])
    chromium.open(tmp_path / "three.html")
    before = chromium.run("document.getElementById('path-title').textContent")
    choose(chromium, "joint", 1)
    after = chromium.run("document.getElementById('path-title').textContent")
    assert data["joints"][0]["name"] in before and data["joints"][1]["name"] in after
    choose(chromium, "joint", 0)
    assert chromium.run("document.getElementById('path-title').textContent") == before
    assert chromium.run("document.querySelectorAll('#path svg').length") == 1 and chromium.problems == []


@pytest.mark.parametrize("width", [380, 1280])
def test_no_label_of_a_diagram_is_cut(chromium, tmp_path, width):
    """The longest names there are stay inside their diagram, on a phone too."""
    written(tmp_path / "moving.h5", control=cases.MOTION, status="completed", results={})
    page.write(tmp_path / "moving.h5", tmp_path / "moving.html")
    chromium.size(width, 900)
    chromium.open(tmp_path / "moving.html")
    texts = chromium.run("[...document.querySelectorAll('#curve text')].map(t => t.textContent).join(' ')")
    assert "displacement of the block that moved furthest [" in texts
    out = chromium.run(
        "[...document.querySelectorAll('.chart svg')].flatMap(svg => { const b = svg.getBoundingClientRect();"
        "return [...svg.querySelectorAll('text')].map(t => t.getBoundingClientRect()).filter(t => t.left < b.left - 1"
        "|| t.right > b.right + 1 || t.top < b.top - 1 || t.bottom > b.bottom + 1).length; })"
    )
    assert out == [0] * len(out)


def test_magnification_views_and_play(opened):
    full = opened.pixels("#view")
    set_range(opened, "magnification", 0)
    assert opened.run("document.getElementById('times').textContent") == "true scale"
    true = opened.pixels("#view")
    assert (true != full).any()
    opened.run("document.querySelector('[data-view=top]').click()")
    opened.settle()
    assert (opened.pixels("#view") != true).any()
    set_range(opened, "time", 0)
    opened.run("document.getElementById('play').click()")
    assert opened.run("document.getElementById('play').getAttribute('aria-pressed')") == "true"
    moving = "new Promise(done => { const look = () => Number(document.getElementById('time').value) > 1 ? done(1)"
    assert opened.run(moving + ": requestAnimationFrame(look); look(); })") == 1
    opened.run("document.getElementById('play').click()")
    stopped = opened.run("document.getElementById('time').value")
    opened.settle()
    assert opened.run("document.getElementById('time').value") == stopped


def test_the_keyboard_is_enough(opened):
    """Tab reaches every control; arrows move the slider and turn the view."""
    reached = []
    for _ in range(12):
        for kind in ("keyDown", "keyUp"):
            opened.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        reached.append(opened.run("document.activeElement.id || document.activeElement.dataset.view"))
    assert {"view", "iso", "play", "time", "magnification"} <= set(reached)
    before = opened.pixels("#view")
    opened.run("document.getElementById('view').focus()")
    arrow = {"key": "ArrowLeft", "code": "ArrowLeft", "windowsVirtualKeyCode": 37}
    opened.call("Input.dispatchKeyEvent", type="keyDown", **arrow)
    opened.settle()
    assert (opened.pixels("#view") != before).any()
    opened.run("document.getElementById('time').focus()")
    opened.call("Input.dispatchKeyEvent", type="keyDown", **arrow)
    opened.settle()
    frames = opened.run("Number(document.getElementById('time').max)")
    assert opened.run("Number(document.getElementById('time').value)") == frames - 1


@pytest.mark.parametrize("width, dark", [(1280, False), (380, True)])
def test_nothing_sticks_out_and_text_can_be_read(chromium, lab_page, width, dark):
    chromium.size(width, 800, dark)
    chromium.open(lab_page[1])
    assert chromium.run("document.documentElement.scrollWidth") <= width
    ink, back = chromium.run(
        "['color', 'backgroundColor'].map(name => getComputedStyle(document.body)[name].match(/\\d+/g).map(Number))"
    )

    def light(colour):
        share = np.array(colour[:3]) / 255.0
        linear = np.where(share <= 0.03928, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    low, high = sorted((light(ink), light(back)))
    assert (high + 0.05) / (low + 0.05) > 7.0 and (light(back) < 0.1) == dark
    assert chromium.problems == []


def test_a_history_cannot_act_in_its_page(chromium, tmp_path):
    page.write(evil_history(tmp_path / "evil.h5"), tmp_path / "evil.html")
    chromium.open(tmp_path / "evil.html")
    assert chromium.run("document.title") == EVIL.replace("&lt;", "&lt;")
    assert chromium.run("document.querySelectorAll('img').length + document.querySelectorAll('script').length") == 2
    assert chromium.run("document.querySelector('pre').textContent") == EVIL
    assert chromium.problems == []
    # and were one thing to slip through, the page's policy would stop it
    chromium.run(
        "(() => { const s = document.createElement('script'); s.textContent = 'document.title = \"hacked\"';"
        "document.body.append(s); })()"
    )
    assert chromium.run("document.title") != "hacked" and "Content Security Policy" in chromium.problems[0]


def test_without_webgl_a_sentence_stands_in(lab_page, tmp_path):
    executable = browsers.find()
    if executable is None:
        pytest.skip("no Chromium on this machine: install the package chromium, or name one in $CHROMIUM")
    window = browsers.Browser(executable, flags=("--disable-3d-apis",))
    try:
        window.size(1280, 900)
        window.open(lab_page[1])
        assert "no WebGL" in window.run("document.getElementById('no-view').textContent")
        assert not window.run("document.getElementById('no-view').hidden")
        start = marker(window, "curve")
        set_range(window, "time", 0)
        assert marker(window, "curve") != start
    finally:
        window.close()
