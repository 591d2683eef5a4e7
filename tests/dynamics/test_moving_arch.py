"""An arch in motion, tilted and shaken, against the exact motion of its mechanism on four hinges."""

import math

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario import toml as scenarios
from helpers.four_hinges import FourHinges
from helpers.places import SCENARIOS

GRAVITY = 9.81
ARCH = FourHinges(radius=1.0, thickness=0.15, voussoirs=7, embrace=157.5)


def shaken(*changes):
    """Time and displacement (f, 7, 3) of the stones relative to the base of an arch on a shaken base."""
    result = simulate(scenarios.load(SCENARIOS / "arch_shaken.toml", changes))
    names = result.assembly.names
    moved = result.frames["displacement"]
    stones = [names.index(f"arch.{k}") for k in range(1, 8)]
    return result.frames["time"], moved[:, stones] - moved[:, [names.index("arch.left")]]


def mechanism(amplitude, times):
    """Displacement (t, 7) of the centroids, complex, on a base shaken by ``amplitude`` times g at 1 Hz towards -x."""
    fine = np.linspace(0.0, times[-1], 1 + math.ceil(times[-1] / 5e-4))
    turns = ARCH.turns(lambda t: GRAVITY * (amplitude * math.sin(2.0 * math.pi * t) - 1j), fine)
    assert np.nanmax(abs(turns)) < 0.1
    turns[np.isnan(turns)] = 0.0  # closed again
    at_rest = ARCH.place(0.0)[0]
    return np.array([ARCH.place(q)[0] - at_rest for q in np.interp(times, fine, turns)])


def test_the_hinges_are_those_of_limit_analysis():
    assert ARCH.load_factor == pytest.approx(0.3700, abs=5e-5)
    assert math.degrees(math.atan(ARCH.load_factor)) == pytest.approx(20.30, abs=5e-3)


def test_a_shaken_arch_rocks_on_its_four_hinges():
    """Every stone follows the mechanism, horizontally and vertically, once it has moved 0.5 mm."""
    times, moved = shaken()
    expected = mechanism(0.45, times)
    late = np.flatnonzero(abs(expected[:, 3]) > 5e-4)
    assert len(late) > 20 and times[late[0]] < 0.24
    for axis, part in ((0, expected.real), (2, expected.imag)):
        largest = abs(part[late]).max(axis=1, keepdims=True)
        assert (abs(moved[late][..., axis] - part[late]) < 0.016 * largest).all()
    end = np.interp(0.4, times, moved[:, 3, 0])
    assert end == pytest.approx(np.interp(0.4, times, expected[:, 3].real), rel=4e-3)
    assert abs(moved[..., 1]).max() < 1e-9


@pytest.mark.parametrize(("amplitude", "opens"), [(0.365, False), (0.38, True)])
def test_an_arch_opens_when_its_base_is_accelerated_by_its_load_factor(amplitude, opens):
    """Below 0.3700 g the arch deforms only elastically; above it the hinges open as those of the mechanism."""
    times, moved = shaken(f"control.sine.amplitude={amplitude * GRAVITY}")
    expected = abs(mechanism(amplitude, times)[:, 3])
    crown = np.linalg.norm(moved[:, 3], axis=1)
    if opens:
        assert crown.max() == pytest.approx(expected.max(), rel=0.1) and expected.max() > 1e-4
    else:
        assert crown.max() < 1e-5 and expected.max() == 0.0


def test_an_arch_falls_off_its_table_as_its_mechanism_does():
    """In real time: the hinges open at 20.30 deg, and at 1 deg/s a stone has moved 20 mm a little later."""
    result = simulate(scenarios.load(SCENARIOS / "oppenheim.toml", ["control.quasi_static=false", "control.rate=1.0"]))
    times = np.arange(20.0, 23.0, 1e-3)

    def pull(t):
        return GRAVITY * complex(math.sin(math.radians(t)), -math.cos(math.radians(t)))

    turns = ARCH.turns(pull, times)
    at_rest = ARCH.place(0.0)[0]
    done = ~np.isnan(turns)
    farthest = np.array([abs(ARCH.place(q)[0] - at_rest).max() for q in turns[done]])
    angle = float(np.interp(0.02, farthest, times[done]))
    assert 20.9 < angle < 21.0
    assert result.status == "collapse"
    assert result.collapse["angle"] == pytest.approx(angle, rel=1e-3)
