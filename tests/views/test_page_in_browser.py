"""The page of a run in a real browser."""

import re

import numpy as np
import pytest

from dembrick import history
from dembrick.views import page
from dembrick.views.page import content
from helpers import browser as browsers
from helpers import history_cases as cases
from helpers.pages import EVIL, data_of, evil_history, unpacked, written


@pytest.fixture(scope="module")
def chromium():
    executable = browsers.find()
    if executable is None:
        pytest.skip("no Chromium on this machine: install the package chromium, or name one in $CHROMIUM")
    window = browsers.Browser(executable)
    yield window
    window.close()


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


def click(window, x, y, kind="mousePressed"):
    for event in ("mouseMoved", "mousePressed", "mouseReleased") if kind == "mousePressed" else (kind,):
        pressed = {} if event == "mouseMoved" else {"button": "left", "clickCount": 1}
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
    """Both blocks of a joint at its limit have the last colour of the scale; without colours nothing is yellow."""
    options = opened.run("[...document.getElementById('colour').options].map(o => o.textContent)")
    assert options == ["displacement", "utilisation", "slip", "none"]
    views = {}
    for i, name in enumerate(options):
        choose(opened, "colour", i)
        pixels = opened.pixels("#view")
        views[name] = ((pixels[..., 0] - pixels[..., 2]) > 90).mean()
    assert views["utilisation"] > 1.2 * views["displacement"] > 0.0 and views["none"] < 0.01  # only the arrow remains
    assert opened.run("document.getElementById('ramp').hidden")
    choose(opened, "colour", 1)
    assert opened.run("document.getElementById('scale-high').textContent").startswith("1: slides")


def test_the_record_can_be_taken_away(opened, lab_page):
    """The downloaded CSV is in SI units and has the numbers of the history."""
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
    """The second diagram and the data for download are those of the selected joint."""
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
    """The longest labels stay inside their diagram, also on the width of a phone."""
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


def test_a_single_frame_has_no_time_to_choose(chromium, tmp_path):
    for frames, hidden in ((1, True), (2, False)):
        page.write(written(tmp_path / f"{frames}.h5", frames=frames), tmp_path / f"{frames}.html")
        chromium.open(tmp_path / f"{frames}.html")
        assert "Equilibrium" in chromium.run("document.getElementById('time').parentElement.textContent")
        for part in ("play", "time"):
            shown = chromium.run(f"document.getElementById('{part}').getBoundingClientRect().width > 0")
            assert shown is not hidden, (part, frames)
    assert chromium.problems == []


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
    # the security policy of the page also blocks a script that is inserted
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


def test_a_block_that_turns_on_and_on_never_spins_back(chromium, tmp_path):
    """A block turns about an axis in steps of 20 degrees, beyond a whole turn: half way between frames it has turned by
    10 more. Magnified five times, its rotation is continuous."""
    frames, axis = 25, np.array([0.6, 0.0, 0.8])
    angle = np.radians(20.0) * np.arange(frames)
    turned = np.concatenate([np.cos(angle / 2)[:, None], np.sin(angle / 2)[:, None] * axis], axis=1)
    orientation = np.stack([np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)), turned], axis=1)
    poses = 1e-4 * np.arange(frames), np.zeros((frames, 2, 3)), orientation
    with cases.written(tmp_path / "run.h5", cases.record(0, 5), poses, status="yield") as run:
        (tmp_path / "page.html").write_text(page.document(run))
    chromium.open(tmp_path / "page.html")
    found = chromium.run(
        "(() => { const data = JSON.parse(document.getElementById('data').textContent).blocks;"
        "const read = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);"
        "const rotation = read(data.rotation), displacement = read(data.displacement);"
        f"const scene = {{frames: {frames}, blocks: 2, rotation, displacement}};"
        f"const at = Array.from({{length: 10 * {frames - 1} + 1}}, (_, i) => i / 10);"
        "return [1, 5].map((times) => at.map((f) => { const m = motionAt(scene, f, 1, new Float64Array(6));"
        "return [...turn(times * m[3], times * m[4], times * m[5], new Float64Array(9))]; })); })()"
    )
    true, magnified = np.array(found).reshape(2, -1, 3, 3) + np.eye(3)
    expected = np.radians(2.0) * np.arange(len(true))
    aside = np.cross(axis, np.eye(3)).T  # the cross product with the axis, as a matrix
    rotation = [np.eye(3) + np.sin(a) * aside + (1.0 - np.cos(a)) * aside @ aside for a in expected]
    np.testing.assert_allclose(true, rotation, atol=1e-6)
    steps = np.einsum("kij,kij->k", magnified[1:], magnified[:-1])
    assert np.degrees(np.arccos(np.clip(0.5 * (steps - 1.0), -1.0, 1.0))).max() < 10.0 + 1e-3
    assert chromium.problems == []
