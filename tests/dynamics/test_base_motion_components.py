"""Supports that shake in two and three directions, against closed forms of a block that slides on them."""

import math

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import BaseMotionControl, Sine
from dembrick.scenario.files import inputs_of
from dembrick.scenario.model import Block, Output
from helpers.stone_scenes import law, of_stone

G = 9.81
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def sliding(control, friction):
    """A block on a floor, its joint so stiff that its elastic displacement is negligible beside the slip."""
    return of_stone(
        law("concave", friction, 1e11),
        control,
        (
            Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
            Block("block", "stone", (0.4, 0.4, 0.1), (0.0, 0.0, 0.05)),
        ),
        output=Output(("frames",), rows=50, frames=50),
    )


def way(control, friction):
    """Displacement (3,) of the block relative to its floor at the end (m)."""
    return simulate(sliding(control, friction)).frames["displacement"][-1, 1]


def record(path, seconds=1.2, **columns):
    """A CSV of accelerations in g at every millisecond; ``columns``: functions of time."""
    time = np.arange(0.0, seconds, 1e-3)
    titles = ", ".join(["time [s]", *(f"{name} [g]" for name in columns)])
    values = np.column_stack([time, *(curve(time) for curve in columns.values())])
    path.write_text(titles + "\n" + "\n".join(", ".join(f"{value:.12g}" for value in row) for row in values) + "\n")
    return str(path)


@pytest.mark.parametrize("vertical, expected", [(0.0, 0.147150), (0.3, 0.1035936), (-0.3, 0.1977696)])
def test_a_pulse_with_a_vertical_part(tmp_path, vertical, expected):
    """A = 0.5 g for 0.2 s with a constant a_z: N = m (g + a_z); A_1 = A - mu (g + a_z) gives a slip of A_1 t^2 / 2 +
    (A_1 t)^2 / (2 mu g)."""

    def pulse(size):
        return lambda t: np.where(t < 0.2 - 1e-9, size, 0.0)

    file = record(tmp_path / "both.csv", across=pulse(0.5), up=pulse(vertical))
    control = BaseMotionControl(0.9, (X, Z), file=file, columns=("time", "across", "up"))
    # the record is linear between samples, so the pulse ends half a millisecond later, which is 1 % of the slip
    lasts, mu = 0.2 - 0.5e-3, 0.2
    beyond = 0.5 * G - mu * (1.0 + vertical) * G
    exact = 0.5 * beyond * 0.2**2 + (beyond * 0.2) ** 2 / (2.0 * mu * G)
    assert exact == pytest.approx(expected, rel=1e-6)
    held = 0.5 * beyond * lasts**2 + (beyond * lasts) ** 2 / (2.0 * mu * G)
    assert -way(control, mu)[0] == pytest.approx(held, rel=5e-3)


@pytest.mark.parametrize(
    "sine, cosine, expected",
    [(0.0, 0.0, -0.0019270), (0.2, 0.0, 0.0918147), (0.0, 0.2, -0.0010574), (-0.2, 0.0, -0.0971288)],
)
def test_a_vertical_part_in_phase_makes_a_block_drift(tmp_path, sine, cosine, expected):
    """0.5 g along x at 2 Hz, friction 0.3, 2 s from rest: the block ends where an independent integration puts it, to
    0.3 mm of slips of some 0.1 m."""
    unit, turn = G / 9.80665, 4.0 * np.pi
    file = record(
        tmp_path / "both.csv",
        2.1,
        across=lambda t: 0.5 * unit * np.sin(turn * t),
        up=lambda t: unit * (sine * np.sin(turn * t) + cosine * np.cos(turn * t)),
    )
    control = BaseMotionControl(2.0, (X, Z), file=file, columns=("time", "across", "up"))
    assert way(control, 0.3)[0] == pytest.approx(expected, abs=3e-4)


@pytest.mark.parametrize("friction, moves", [(0.431, True), (0.437, False)])
def test_three_components_move_a_block_beyond_their_threshold(tmp_path, friction, moves):
    """The block slides if hypot(a_x, a_y) > mu (g + a_z): (.3, .25, -.1) g at mu = .433903, with g = 9.80665 m/s2 in
    the record. The accelerations grow slowly, so that the springs do not swing."""
    found = math.hypot(0.3, 0.25) / (G / 9.80665 - 0.1)
    assert math.hypot(0.3, 0.25) / 0.9 == pytest.approx(0.433903, rel=1e-6)
    columns = {
        name: (lambda t, a=a: a * np.minimum(t / 0.3, 1.0)) for name, a in {"a": 0.3, "b": 0.25, "c": -0.1}.items()
    }
    file = record(tmp_path / "three.csv", 1.1, **columns)
    control = BaseMotionControl(1.0, (X, Y, Z), file=file, columns=("time", "a", "b", "c"))
    slid = np.linalg.norm(way(control, friction * found / (math.hypot(0.3, 0.25) / 0.9))[:2])
    assert (slid > 1e-3) == moves and (slid < 1e-5) != moves


def test_three_components_pull_along_their_sum(tmp_path):
    """(.3, .25, -.1) g at mu = .3: a_rel = 1.182227 m/s2 along (-.768221, -.640184); at mu = .44 nothing moves."""
    file = record(
        tmp_path / "three.csv",
        a=lambda t: np.full_like(t, 0.3),
        b=lambda t: np.full_like(t, 0.25),
        c=lambda t: np.full_like(t, -0.1),
    )
    control = BaseMotionControl(0.4, (X, Y, Z), file=file, columns=("time", "a", "b", "c"))
    slid = way(control, 0.3)[:2]
    np.testing.assert_allclose(slid, 0.5 * 1.182227 * 0.4**2 * np.array([-0.768221, -0.640184]), rtol=5e-3)
    assert np.linalg.norm(way(control, 0.44)[:2]) < 1e-5


def test_files_of_their_own_scaled_and_in_other_units(tmp_path):
    """PEER records, one per direction and multiplied by ``scale``, give the same motion as one CSV of both."""
    time = np.arange(0.0, 0.6, 2e-3)
    across, up = np.sin(9.0 * time), 0.4 * np.cos(7.0 * time)
    files = []
    for name, values in (("across", across), ("up", up)):
        lines = "\n".join("  ".join(f"{value:.7E}" for value in values[i : i + 5]) for i in range(0, len(values), 5))
        head = f"PEER\n{name}\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS= {len(values)}, DT= .0020 SEC\n"
        path = tmp_path / f"{name}.AT2"
        path.write_text(head + lines + "\n")
        files.append(str(path))
    rows = np.column_stack([time, 0.5 * 980.665 * across, 0.5 * 980.665 * up])
    text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
    both = tmp_path / "both.csv"
    both.write_text("time [s],one [cm/s2],two [cm/s2]\n" + text + "\n")
    apart = BaseMotionControl(0.5, (X, Z), file=tuple(files), scale=0.5)
    together = BaseMotionControl(0.5, (X, Z), file=str(both), columns=("time", "one", "two"))
    first, second = way(apart, 0.25), way(together, 0.25)
    assert abs(first[0]) > 1e-3
    np.testing.assert_allclose(first, second, rtol=1e-4, atol=1e-8)
    assert inputs_of(sliding(apart, 0.25)) == files


def test_scale_is_a_factor_of_the_amplitude():
    base = {"duration": 0.4, "direction": X}
    doubled = way(BaseMotionControl(sine=Sine(2.0, 3.0), scale=2.0, **base), 0.2)
    np.testing.assert_array_equal(doubled, way(BaseMotionControl(sine=Sine(4.0, 3.0), **base), 0.2))


def test_written_in_a_file_it_reads_back(tmp_path):
    file = record(tmp_path / "both.csv", across=np.sin, up=np.cos)
    control = BaseMotionControl(0.5, (X, Z), file=file, columns=("time", "across", "up"), scale=0.3)
    assert toml.loads(toml.text_of(sliding(control, 0.5))).control == control
    files = BaseMotionControl(0.5, (X, Z), file=(file, file), columns=("time", "up"))
    assert toml.loads(toml.text_of(sliding(files, 0.5))).control == files


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: BaseMotionControl(1.0, (X, Z), file="a.csv"), "needs a column of time, and one for each direction"),
        (lambda: BaseMotionControl(1.0, (X, Z), file=("a.csv",)), "it must name one file for each direction"),
        (lambda: BaseMotionControl(1.0, (X, Z), sine=Sine(1.0, 1.0)), "a sine or a pulse has one direction"),
        (lambda: BaseMotionControl(1.0, (X, Y, Z, X), file="a.csv"), "one to three directions"),
        (lambda: BaseMotionControl(1.0, (X, (0, 0, 0)), file="a.csv"), "its length must be greater than 0"),
        (lambda: BaseMotionControl(1.0, X, sine=Sine(1.0, 1.0), scale=math.nan), "scale"),
    ],
)
def test_components_that_are_refused(make, message):
    with pytest.raises(ScenarioError, match=message):
        make()
