"""Supports that shake and loads that change with time, by curves and by files."""

import dataclasses
import math
import re

import numpy as np
import pytest

from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Pulse, Sine
from dembrick.scenario.model import Load
from dembrick.simulation.dynamics.time_histories import (
    linear,
    must_end_at_rest,
    pulse_velocity,
    read_samples,
    records_of,
    sampled_velocity,
    sine_velocity,
    with_baseline,
)
from helpers.resting_blocks import block_on_floor

HEADINGS = {
    "acceleration": "time [s], acceleration [m/s2]",
    "velocity": "time [s], velocity [m/s]",
    "displacement": "time [s], displacement [m]",
    "factor": "time [s], factor [1]",
}


def write(path, time, value, quantity="acceleration"):
    lines = [HEADINGS[quantity], *(f"{float(t)!r}, {float(v)!r}" for t, v in zip(time, value, strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path.name


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
def test_a_file_shakes_as_the_curve_that_it_samples(quantity, folder):
    shape, time = (
        Sine({"acceleration": 4.0, "velocity": 0.6, "displacement": 0.1}[quantity], 1.0, 0.3),
        np.linspace(0, 1, 1001),
    )
    file = write(folder / "base.csv", time, shape.amplitude * np.sin(2.0 * math.pi * time + 0.3), quantity)
    common = {"duration": 0.8, "direction": (0.0, 1.0, 0.0), "quantity": quantity}
    by_curve = simulate(block_on_floor(BaseMotionControl(sine=shape, **common)))
    by_file = simulate(block_on_floor(BaseMotionControl(file=file, **common)))
    np.testing.assert_allclose(by_file.displacement, by_curve.displacement, rtol=3e-5, atol=1e-10)
    assert 0.01 < by_curve.run.furthest[1] < 1.0


def test_curves_of_supports_are_consistent():
    """Acceleration, velocity and displacement of the same motion give the same velocity."""
    t = np.linspace(0.0, 2.0, 50)
    omega = 2.0 * math.pi * 0.7
    shapes = {"displacement": (0.1, 0.2), "velocity": (0.1 * omega, 0.2 + math.pi / 2),
              "acceleration": (-0.1 * omega**2, 0.2)}  # fmt: skip
    gained = {q: sine_velocity(Sine(a, 0.7, p), q)(t) for q, (a, p) in shapes.items()}
    for values in gained.values():
        np.testing.assert_allclose(values - values[0], gained["velocity"] - gained["velocity"][0], atol=1e-12)
    pulse = pulse_velocity(Pulse(2.0, 0.5, 0.1), "acceleration")
    np.testing.assert_allclose(pulse(np.array([0.0, 0.1, 0.35, 0.6, 5.0])), [0.0, 0.0, 0.5, 1.0, 1.0])


def test_spline_of_a_cubic(tmp_path):
    """The natural spline is exact for a straight line, and close inside a smooth curve."""
    time = np.linspace(0.0, 1.0, 201)
    write(tmp_path / "line.csv", time, 3.0 * time, "displacement")
    slope = sampled_velocity(read_samples(tmp_path / "line.csv", 1.0, "displacement"), "displacement")
    np.testing.assert_allclose(slope(np.array([0.0, 0.123, 0.99])), 3.0, rtol=1e-12)
    write(tmp_path / "sine.csv", time, np.sin(3.0 * time), "displacement")
    slope = sampled_velocity(read_samples(tmp_path / "sine.csv", 1.0, "displacement"), "displacement")
    np.testing.assert_allclose(slope(np.array([0.3, 0.456])), 3.0 * np.cos(3.0 * np.array([0.3, 0.456])), rtol=1e-6)


BAD_FILES = {
    "gap": (
        "0,0\n0.01,1\n0.02,1\n0.05,1\n0.06,1\n",
        "line 5: time leaves a gap of 0.03 s (the usual step is 0.01 s); add the missing samples",
    ),
    "jump": ("0,0\n0.01,1\n0.01,2\n0.02,1\n", "line 4: time does not advance; give a jump as two samples"),
    "backwards": ("0,0\n0.01,1\n0.005,1\n0.06,1\n", "line 4: time goes back"),
    "text": ("0,0\n0.01,much\n", "line 3: 'much' in column 'a' is not a finite number"),
    "not a number": ("0,0\n0.01,nan\n", "line 3: 'nan' in column 'a' is not a finite number"),
    "too short for a load": ("0,0\n0.01,1\n0.02,1\n", "covers 0 to 0.02 s, but the run lasts from 0 to 1 s"),
    "empty": ("", "at least 2 lines"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_histories_that_are_refused(name, tmp_path):
    text, message = BAD_FILES[name]
    (tmp_path / "base.csv").write_text("t [s],a [m/s2]\n" + text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=re.escape(message)):
        read_samples(tmp_path / "base.csv", 1.0, "acceleration")


def test_a_history_finer_than_the_time_step_is_refused(folder):
    time = np.arange(0.0, 0.011, 1e-6)
    file = write(folder / "base.csv", time, np.zeros(len(time)))
    with pytest.raises(ScenarioError, match=r"base.csv: its step of 1e-06 s is shorter than the time step"):
        simulate(block_on_floor(BaseMotionControl(0.01, (1.0, 0.0, 0.0), file=file)))
    with pytest.raises(ScenarioError, match="there.csv: there is no such file"):
        simulate(block_on_floor(BaseMotionControl(0.01, (1.0, 0.0, 0.0), file="there.csv")))


def test_a_load_history_pushes(folder):
    """A force that a file doubles half way: the acceleration is F/m less friction."""
    file = write(folder / "push.csv", [0.0, 0.1, 0.2, 0.3], [1.0, 1.0, 1.0, 1.0], "factor")
    push = Load("block", (12.0 * 4.0, 0.0, 0.0), history=file)
    result = simulate(block_on_floor(DynamicControl(0.25), (push,)))
    time = result.run.motion.time
    assert result.displacement[1, 0] == pytest.approx(0.5 * (4.0 - 1.962) * time**2, rel=2e-3)


def test_a_load_history_is_told_by_its_corners(folder):
    """A factor grows for T = 0.04 s, then stays constant until the end of the run, with no sample between: the block,
    which begins to slide where the force is mu m g, has the velocity (integral of the force less friction) / m."""
    file = write(folder / "ramp.csv", [0.0, 0.04, 0.3], [0.0, 1.0, 1.0], "factor")
    result = simulate(block_on_floor(DynamicControl(0.25), (Load("block", (12.0 * 4.0, 0.0, 0.0), history=file),)))
    a, friction, grows, time = 4.0, 1.962, 0.04, result.run.motion.time
    goes = grows * friction / a  # when it begins to slide
    rest = time - grows
    gained = 0.5 * (a - friction) * (grows - goes)
    moved = (a - friction) * (grows - goes) ** 2 / 6.0 + gained * rest + 0.5 * (a - friction) * rest**2
    assert result.displacement[1, 0] == pytest.approx(moved, rel=3e-4)


def test_a_factor_may_have_unequal_steps_and_a_motion_may_not(tmp_path):
    for quantity in ("velocity", "displacement"):
        write(tmp_path / "corners.csv", [0.0, 0.1, 2.0, 2.1], [0.0, 1.0, 1.0, 0.0], quantity)
        with pytest.raises(ScenarioError, match=r"line 4: time leaves a gap of 1.9 s .*; add the missing samples"):
            read_samples(tmp_path / "corners.csv", 2.1, quantity)
    write(tmp_path / "corners.csv", [0.0, 0.1, 2.0, 2.1], [0.0, 1.0, -0.9, 0.0], "factor")
    factor = linear(read_samples(tmp_path / "corners.csv", 2.1, "factor"))
    np.testing.assert_allclose(factor(np.array([0.05, 0.1, 1.0, 2.05])), [0.5, 1.0, 0.1, -0.45], rtol=1e-12)


def test_a_record_that_has_ended_is_zero(tmp_path):
    """A half sine for 0.5 s in a run of 2 s: the supports keep the velocity that it gave them."""
    time = np.linspace(0.0, 0.5, 501)
    write(tmp_path / "half.csv", time, np.sin(2.0 * np.pi * time))
    samples = read_samples(tmp_path / "half.csv", 2.0, "acceleration", may_end=True)
    velocity = sampled_velocity(samples, "acceleration")
    np.testing.assert_allclose(velocity(np.array([0.5, 0.7, 2.0])), 1.0 / np.pi, rtol=1e-5)
    for quantity in ("velocity", "displacement"):
        write(tmp_path / "swing.csv", time, np.sin(2.0 * np.pi * time) ** 4, quantity)
        samples = read_samples(tmp_path / "swing.csv", 2.0, quantity, may_end=True)
        must_end_at_rest(samples, quantity)
        after = sampled_velocity(samples, quantity)(np.array([0.6, 2.0]))
        np.testing.assert_array_equal(after, 0.0)


def test_supports_do_not_stop_all_at_once_at_the_end_of_a_record(folder):
    time = np.linspace(0.0, 0.2, 201)
    file = write(folder / "ramp.csv", time, 3.0 * time, "velocity")
    control = BaseMotionControl(0.4, (1.0, 0.0, 0.0), file=file, quantity="velocity")
    with pytest.raises(
        ScenarioError, match=r"the supports move at 0.6 m/s at the end of the history, 0.2 s, and would stop abruptly"
    ):
        simulate(block_on_floor(control))


def test_a_baseline_lets_the_supports_end_where_they_began(tmp_path):
    """A full sine has a displacement only; with an offset it has a velocity too. The correction removes both, and
    leaves a record that needs none as it is."""
    time = np.linspace(0.0, 2.0, 2001)
    write(tmp_path / "drift.csv", time, np.sin(2.0 * np.pi * time) + 0.05)
    corrected = with_baseline(read_samples(tmp_path / "drift.csv", 2.0, "acceleration"))
    velocity = sampled_velocity(corrected, "acceleration")
    fine = np.linspace(0.0, 2.0, 200_001)
    assert abs(velocity(np.array([2.0]))[0]) < 1e-12
    assert abs(np.trapezoid(velocity(fine), fine)) < 1e-8
    line = np.polyfit(time, np.sin(2.0 * np.pi * time) + 0.05 - corrected.value, 1)
    # of sin: V = 0, D = 1 / pi after 2 s; of the offset: V = 0.1, D = 0.1
    moved, gained = 1.0 / np.pi + 0.1, 0.1
    np.testing.assert_allclose(
        line, [(6.0 * gained - 6.0 * moved) / 4.0, (3.0 * moved - 2.0 * gained) / 2.0], atol=1e-5
    )
    again = with_baseline(corrected)
    np.testing.assert_allclose(again.value, corrected.value, atol=1e-10)


def test_a_block_that_sticks_comes_back_with_its_baseline(folder):
    """Relative to the supports it is at rest, so only their recorded acceleration shows it: its integral is zero."""
    time = np.linspace(0.0, 0.5, 501)
    file = write(folder / "base.csv", time, 0.5 * np.sin(2.0 * np.pi * time) + 0.2)
    for baseline, left in ((True, 0.0), (False, 0.5 / np.pi + 0.1)):
        control = BaseMotionControl(0.8, (1.0, 0.0, 0.0), file=file, baseline=baseline)
        rows = simulate(block_on_floor(control)).rows
        gained = float(np.trapezoid(rows["load"], rows["time"]))
        assert gained == pytest.approx(left, abs=2e-3)
    with pytest.raises(ScenarioError, match="only accelerations of a file can be corrected"):
        BaseMotionControl(0.8, (1.0, 0.0, 0.0), file=file, baseline=True, quantity="velocity")


def test_a_block_beside_shaken_supports_falls_freely():
    """z = g t^2 / 2, to half a step."""
    scenario = block_on_floor(BaseMotionControl(0.4, direction=(1.0, 0.0, 0.0), sine=Sine(1e-9, 1.0)))
    aside = dataclasses.replace(scenario.blocks[1], position=(9.0, 0.0, 3.0))
    result = simulate(dataclasses.replace(scenario, blocks=(scenario.blocks[0], aside)), record=False)
    assert result.run.motion.displacement[1, 2] == pytest.approx(-0.5 * 9.81 * 0.4**2, rel=1e-6)


def test_a_sine_that_no_step_follows_is_refused():
    fast = BaseMotionControl(0.1, direction=(1.0, 0.0, 0.0), sine=Sine(1.0, 50000.0))
    with pytest.raises(ScenarioError, match=r"control.sine.frequency = 50000 Hz has a period of 2e-05 s"):
        simulate(block_on_floor(fast))


@pytest.mark.parametrize(
    ("quantity", "peak", "told"),
    [
        ("acceleration", 0.28 * 9.80665, "301 samples, 3 s, peak 0.28 g"),
        ("acceleration", 1.4 * 9.80665, "peak 1.4 g"),
        ("acceleration", 1.6 * 9.80665, "peak 1.6 g: are its units"),
        ("velocity", 0.4, "peak 0.4 m/s"),
        ("velocity", 40.0, "peak 40 m/s: are its units"),
        ("displacement", 0.1, "peak 0.1 m"),
    ],
)
def test_a_record_is_told_with_its_peak_and_a_warning_if_no_earthquake_has_it(quantity, peak, told, folder, capsys):
    time = np.linspace(0.0, 3.0, 301)
    # half of it by the factor of the control; the peak is at one sample, and negative
    file = write(folder / "base.csv", time, np.where(time == time[100], -2.0 * peak, 0.0), quantity)
    control = BaseMotionControl(duration=3.0, direction=(1.0, 0.0, 0.0), file=file, quantity=quantity, scale=-0.5)
    (record,) = records_of(block_on_floor(control))
    said, _, doubt = told.partition(":")
    assert str(record) == f"base.csv: 301 samples, 3 s, {said.rpartition('s, ')[2]}"
    assert bool(record.warning) == bool(doubt) and doubt in (record.warning or "")


def test_check_tells_records(folder, capsys):
    write(folder / "base.csv", np.linspace(0.0, 3.0, 301), np.full(301, 20.0))
    control = BaseMotionControl(duration=3.0, direction=(1.0, 0.0, 0.0), file="base.csv")
    (folder / "mine.toml").write_text(scenarios.dumps(block_on_floor(control)))
    assert main(["check", "mine.toml"]) == 0
    out, err = capsys.readouterr()
    assert "record        base.csv: 301 samples, 3 s, peak 2.04 g" in out
    assert "warning: the peak of the record base.csv is 2.04 g" in err
