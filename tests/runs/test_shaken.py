"""The outcome of a shaken structure in one word, with its drift, residual displacement and peak tie forces."""

import json
from html import escape

import numpy as np
import pytest

import dembrick
from dembrick import cli, history
from dembrick.views import page
from dembrick.views.motion_numbers import OF_MOTION, OF_WORK
from dembrick.views.number_lines import evaluate
from dembrick.views.summary import plain
from helpers.key_lines import key_lines, lines_of, words
from helpers.scenario_text import block, header

GROUND = block("ground", (0.0, 0.0, -0.05), (4.0, 2.0, 0.1), "fixed = true")
PULSE = '[control]\nkind = "base-motion"\ndirection = [1.0, 0.0, 0.0]\n'


def column(amplitude, duration=1.0, friction=0.9):
    """A stone 0.2 m wide and 0.8 m high, which rocks above 0.25 g."""
    text = header(friction=friction, title="stone") + GROUND + block("stone", (0.0, 0.0, 0.4), (0.2, 0.2, 0.8))
    return text + PULSE + f"pulse = {{ amplitude = {amplitude}, duration = 0.4 }}\nduration = {duration}\n"


def ran(text, path):
    result = dembrick.simulate(dembrick.loads(text), path)
    return result, result.as_dict()


def test_a_stone_that_the_ground_throws_over_fell(tmp_path):
    result, told = ran(column(8.0, duration=1.5), tmp_path / "run.h5")
    assert told["outcome"] == "fell" and told["fallen"] == ["stone"]
    assert key_lines(result)["outcome"] == "outcome fell"
    assert told["drift"]["value"] == pytest.approx(told["greatest_displacement"]["stone"] / 0.4, rel=1e-12)
    assert told["drift"]["value"] > 0.5


def test_a_stone_that_stays_stood_and_has_slid(tmp_path, capsys):
    """Under a pulse a for t it slides v^2 (1 / mu g - 1 / a) / 2 relative to the ground, with v = a t (Newmark)."""
    a, t, mu, g = 3.0, 0.4, 0.15, 9.81
    text = column(a, friction=mu)
    text = text.replace("[0.2, 0.2, 0.8]", "[0.8, 0.8, 0.2]").replace("[0.0, 0.0, 0.4]", "[0.0, 0.0, 0.1]")
    text = text.replace("duration = 1.0", "duration = 1.4")
    result, told = ran(text, tmp_path / "run.h5")
    slid = 0.5 * (a * t) ** 2 * (1.0 / (mu * g) - 1.0 / a)
    assert told["outcome"] == "stood"
    assert told["residual_displacement"] == pytest.approx(slid, rel=5e-3)
    assert told["drift"] == {"value": pytest.approx(slid / 0.1, rel=5e-3), "block": "stone"}
    assert "residual displacement" in key_lines(result)
    assert key_lines(result)["drift"].startswith(f"drift {100 * told['drift']['value']:.3g} %")
    with history.read(tmp_path / "run.h5") as run:
        shown = page.results_table(run.results)
    assert "outcome" in shown and "stood" in shown and "residual displacement" in shown
    capsys.readouterr()
    assert cli.main(["info", str(tmp_path / "run.h5")]) == 0
    info, numbers = capsys.readouterr().out, evaluate({**OF_MOTION, **OF_WORK}, told)
    assert len(numbers) >= 9
    for number in numbers:  # declared once, shown everywhere
        assert lines_of([number])[number.name] in words(result.text()) and plain(f"{number.value}") in info
        assert number.name in info
        assert escape(number.name) in shown and escape(number.value) in shown
    (tmp_path / "stone.toml").write_text(text)
    assert cli.main(["run", str(tmp_path / "stone.toml"), "--out", str(tmp_path / "again.h5"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outcome"] == "stood"


def test_what_still_moves_when_the_run_ends_stood_so_far(tmp_path):
    """A rocking stone at a run's end in mid-motion: its speed is that of the centroid plus spin times half diagonal."""
    result, told = ran(column(4.0, duration=0.45), tmp_path / "run.h5")
    bodies = result.run.motion.state.bodies
    speed = np.linalg.norm(bodies.velocity[1]) + np.linalg.norm(bodies.spin[1]) * np.sqrt(0.2**2 + 0.2**2 + 0.8**2) / 2
    assert told["outcome"] == "stood" and told["speed_at_the_end"] == pytest.approx(speed, rel=1e-12) and speed > 0.05
    (moved,) = np.linalg.norm(result.displacement[1:], axis=1)
    assert told["residual_displacement"] is None and told["displacement"] == moved > 0.01
    assert "residual displacement" not in result.text()
    assert key_lines(result)["displacement at the end"].rpartition("(")[2].startswith("of the centroid of stone; ")
    assert f"stood (so far: blocks still move at {speed:.2g} m/s; give a longer duration)" in result.text()
    rest, told = ran(column(0.1, duration=1.0), tmp_path / "rest.h5")
    assert "displacement at the end" not in rest.text() and "residual displacement" in rest.text()
    assert told["outcome"] == "stood" and told["speed_at_the_end"] == 0.0 and "so far" not in rest.text()


TIED = """
[[ties]]
between = [{ block = "ground", point = [-1.0, 0.0, 0.0] }, { block = "stone", point = [-0.4, 0.0, 0.1] }]
stiffness = 1.0e6
"""


def test_peaks_of_ties_are_those_of_the_record(tmp_path):
    text = (
        column(3.0, friction=0.15)
        .replace("[0.2, 0.2, 0.8]", "[0.8, 0.8, 0.2]")
        .replace("[0.0, 0.0, 0.4]", "[0.0, 0.0, 0.1]")
    )
    text = text.replace("[control]", TIED + "[control]").replace("amplitude = 3.0", "amplitude = -3.0")
    result, told = ran(text, tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as run:
        peak = float(run.series("tension").max())
    (tie,) = told["ties"]
    assert tie["peak"] == pytest.approx(peak, rel=1e-9) and peak > 10.0 > tie["tension"] - peak
    assert f"{tie['peak']:.6g} N at most" in result.text()
    assert np.isfinite(peak)


def test_other_runs_say_no_outcome(tmp_path):
    text = header(friction=0.5, title="free") + GROUND + block("stone", (0.0, 0.0, 0.1), (0.2, 0.2, 0.2))
    _, told = ran(text + '[control]\nkind = "dynamic"\nduration = 0.05\n', tmp_path / "run.h5")
    assert "outcome" not in told and "drift" not in told
