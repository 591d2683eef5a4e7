"""The response spectrum against closed forms of the oscillator."""

import json

import numpy as np
import pytest

from dembrick import cli, theory
from dembrick.errors import ScenarioError
from dembrick.views import plot

G = 9.80665


def test_a_step_of_the_ground_is_felt_twice():
    """A lasting acceleration a moves an undamped oscillator to 2 a / omega^2, a damped one to (1 + exp(-pi xi / sqrt(1
    - xi^2))) a / omega^2."""
    periods = np.array([0.1, 0.5, 1.3])
    w = 2.0 * np.pi / periods
    for damping in (0.0, 0.05, 0.3):
        found = theory.response_spectrum([0.0, 5.0, 10.0], [3.0, 3.0, 3.0], periods, damping)
        over = np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
        # undamped, the end of the step may leave a free motion of up to twice as much
        limit = 3.0 * (1.0 + over) / w**2
        if damping:
            np.testing.assert_allclose(found.displacement, limit, rtol=4e-3)
        else:
            assert (found.displacement >= (1.0 - 4e-3) * limit).all()


def test_resonance_grows_by_half_a_cycle_each_time():
    """u = a (sin wt - wt cos wt) / (2 w^2): after n cycles |u| = n pi a / w^2."""
    T, cycles, a = 0.5, 6, 2.0
    w = 2.0 * np.pi / T
    t = np.linspace(0.0, cycles * T, 6001)
    found = theory.response_spectrum(t, a * np.sin(w * t), [T], 0.0)
    assert found.displacement[0] == pytest.approx(cycles * np.pi * a / w**2, rel=5e-3)


def test_stiff_oscillators_follow_and_soft_ones_stay():
    """At short periods the pseudo-acceleration is the ground's peak, at long ones the displacement is the ground's."""
    t = np.linspace(0.0, 1.0, 1001)
    ground = 4.0 * np.sin(2.0 * np.pi * t)
    found = theory.response_spectrum(t, ground, [0.02], 0.05)
    assert found.pseudo_acceleration[0] == pytest.approx(4.0, rel=0.02)
    soft = theory.response_spectrum(t, ground, [1e4], 0.0)
    assert soft.displacement[0] == pytest.approx(4.0 / (2.0 * np.pi), rel=1e-3)  # the ground's own in a full sine


def test_the_step_of_the_record_does_not_matter():
    t = np.arange(0.0, 4.0, 0.02)
    a = np.sin(9.0 * t) * np.exp(-t)
    fine = np.linspace(0.0, t[-1], 20 * (len(t) - 1) + 1)
    periods = np.array([0.06, 0.3, 1.1])
    coarse = theory.response_spectrum(t, a, periods)
    np.testing.assert_allclose(theory.response_spectrum(fine, np.interp(fine, t, a), periods).displacement,
                               coarse.displacement, rtol=4e-3)  # fmt: skip


def test_the_command_draws_a_record_in_g(tmp_path, capsys):
    t = np.linspace(0.0, 3.0, 1501)
    lines = [f"{x:.4f},{0.3 * np.sin(4.0 * np.pi * x):.6f}" for x in t]
    (tmp_path / "quake.csv").write_text("time [s],acceleration [g]\n" + "\n".join(lines) + "\n", encoding="utf-8")
    target = tmp_path / "s.svg"
    command = ["plot", str(tmp_path / "quake.csv"), "--kind", "spectrum", "--to", str(target), "--json"]
    assert cli.main(command) == 0 and json.loads(capsys.readouterr().out) == {"figure": str(target)}
    axes = plot.spectra(tmp_path / "quake.csv", damping=0.0).axes[0]
    assert axes.get_xlabel() == "period T [s]" and axes.get_ylabel() == "pseudo-acceleration [g]"
    line = axes.lines[0].get_xydata()
    resonant = line[np.argmax(line[:, 1])]
    assert resonant[0] == pytest.approx(0.5, rel=0.06) and resonant[1] == pytest.approx(6 * np.pi * 0.3, rel=0.05)
    found = plot.read_spectrum(tmp_path / "quake.csv", 0.0, [0.5])
    assert found.pseudo_acceleration[0] / G == pytest.approx(6 * np.pi * 0.3, rel=5e-3)


def test_what_is_no_record_is_refused(tmp_path):
    (tmp_path / "back.csv").write_text("time [s],acceleration [g]\n0,0\n0.2,1\n0.1,1\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"back.csv, line 4: time goes back"):
        plot.read_spectrum(tmp_path / "back.csv")
    for damping in (-0.1, 1.0, float("nan")):
        with pytest.raises(ScenarioError, match="is out of range: 0 to less than 1 of critical"):
            theory.response_spectrum([0.0, 1.0], [1.0, 1.0], [0.5], damping)
    with pytest.raises(ScenarioError, match="periods of a spectrum"):
        theory.response_spectrum([0.0, 1.0], [1.0, 1.0], [0.0])
