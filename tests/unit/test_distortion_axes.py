"""Distortion and coherence of machines of any number of axes: of loops whose nonlinearity is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import hadamard
from scipy.signal import butter, lfilter

from amb_core.ground.errors import SpectrumError
from amb_core.loop.records import LoopRecord
from amb_core.regions.distortion import DistortionSettings, find_evidence, lines_of, measure_coherence, measure_recorded
from amb_core.report.figures import plot

Signal = NDArray[np.float64]

RATE = 2_000.0
AXES = ("x_a", "y_a", "x_b", "y_b")
SETTINGS = DistortionSettings(rms=2e-6, frequency_start=1.0, frequency_end=200.0, period=1.0)
LINES = lines_of(SETTINGS, RATE)
COUPLING = np.eye(4) + 0.2 * np.random.default_rng(3).normal(size=(4, 4))
REST = np.zeros((700, 4))
SQUARE = 4e4  # 1/m


def respond(reference: Signal, square: float = 0.0, noise: float = 0.0, axes: tuple[str, ...] = AXES) -> LoopRecord:
    """A well damped loop of 60 Hz with four coupled axes, of which the second one is bent by a square (1/m)."""
    position = lfilter(*butter(2, 60.0, fs=RATE), np.roll(reference, 3, axis=0) @ COUPLING.T, axis=0)
    position[:, 1] += square * position[:, 1] ** 2
    position = position + noise * np.random.default_rng(1).normal(size=position.shape)
    return LoopRecord(0, 1.0 / RATE, reference, position, 2e6 * (reference - position), axes=axes)


def realisation(seed: int) -> Signal:
    """One period of independent random-phase multisines on the four axes (m)."""
    spectrum = np.zeros((LINES.steps // 2 + 1, 4), dtype=complex)
    spectrum[LINES.excited] = np.exp(2j * np.pi * np.random.default_rng(seed).random((len(LINES.excited), 4)))
    signal = np.fft.irfft(spectrum, LINES.steps, axis=0)
    return 2e-6 * signal / np.sqrt(np.mean(signal**2, axis=0))


def played(*parts: Signal) -> Signal:
    return np.vstack([REST, *(np.vstack([np.tile(part, (3, 1)), REST]) for part in parts)])


def true_share() -> float:
    """Power of the square without its mean over that of the linear motion, as a ratio of rms."""
    y = np.vstack([respond(played(realisation(seed))).position[700:6_700, 1:2] for seed in range(20, 40)])
    return float(SQUARE * np.std(y**2) / np.std(y))


def test_several_realisations_show_the_distortion_of_the_axis_that_is_bent() -> None:
    distortion = measure_recorded([respond(played(*(realisation(seed) for seed in range(7))), SQUARE)])
    assert (distortion.method, distortion.experiments, distortion.axes) == ("robust", 7, AXES)
    assert distortion.ratio[1] == pytest.approx(true_share(), rel=0.15)
    assert np.all(distortion.ratio[[0, 2, 3]] < 1e-6), "the other axes are linear"
    assert distortion.plant.shape[1:] == (4, 4)
    assert list(distortion.as_dict()) == list(AXES)
    assert "on y_a" in distortion.brief


def test_orthogonal_experiments_of_one_multisine_are_separated_by_the_lines_left_out() -> None:
    signs = hadamard(4)
    distortion = measure_recorded([respond(played(*(row * realisation(0)[:, :1] for row in signs)), SQUARE)])
    assert (distortion.method, distortion.experiments) == ("fast", 4)
    b, a = butter(2, 60.0, fs=RATE)
    z = np.exp(-2j * np.pi * distortion.frequency / RATE)
    expected = COUPLING[0] * ((np.polyval(b[::-1], z) / np.polyval(a[::-1], z)) * z**3)[:, None]
    np.testing.assert_allclose(distortion.closed_loop[:, 0], expected, atol=1e-6)
    assert distortion.ratio[1] > 0.02 and distortion.ratio[0] < 1e-6


def test_axes_that_move_only_together_as_in_a_rigid_mode_have_a_distortion_but_no_response_each() -> None:
    tilt = np.array([1.0, 0.0, -1.0, 0.0])
    distortion = measure_recorded([respond(played(*(tilt * realisation(seed)[:, :1] for seed in range(4))), SQUARE)])
    assert distortion.method == "robust", "one direction moves, in four realisations"
    assert np.isfinite(distortion.ratio[[0, 2]]).all() and np.isnan(distortion.ratio[[1, 3]]).all()
    assert np.all(distortion.ratio[[0, 2]] < 1e-6)
    assert np.isnan(distortion.closed_loop).all() and np.isnan(distortion.plant).all()


def test_coherence_of_four_axes_is_the_share_of_noise() -> None:
    noise = 2e-8
    coherence = measure_coherence([respond(realisation(0)[np.arange(20 * LINES.steps) % LINES.steps], noise=noise)])
    assert coherence.axes == AXES and coherence.coherence.shape[1] == 4
    silent = respond(realisation(0)[np.arange(20 * LINES.steps) % LINES.steps]).position
    in_band = noise * np.sqrt(coherence.frequency[-1] / (0.5 * RATE))
    np.testing.assert_allclose(coherence.ratio, in_band / silent.std(axis=0), rtol=0.25)


@pytest.mark.parametrize("square", [0.0, SQUARE])
def test_noise_of_a_continuous_signal_and_distortion_are_told_apart_from_the_linear_response(square: float) -> None:
    reference = np.random.default_rng(7).normal(size=(20_000, 4)) * 4e-6
    evidence = find_evidence([respond(lfilter(*butter(2, 150.0, fs=RATE), reference, axis=0), square)])
    assert evidence.distortion is None and evidence.coherence is not None
    assert np.all(evidence.coherence.ratio[[0, 2, 3]] < 0.01)
    assert (evidence.coherence.ratio[1] > 0.02) == bool(square)
    assert evidence.best_fit.shape == (4,)


def test_figures_have_a_panel_for_each_axis() -> None:
    evidence = find_evidence([respond(played(*(realisation(seed) for seed in range(6))), SQUARE)])
    assert evidence.distortion is not None and evidence.coherence is not None
    for result in (evidence.distortion, evidence.coherence):
        assert len(plot(result).panels) == 4


def test_records_of_different_machines_are_refused() -> None:
    one, other = respond(realisation(0)), respond(realisation(0), axes=("x", "y", "z", "w"))
    with pytest.raises(SpectrumError, match="different machines: axes x_a, y_a, x_b, y_b and x, y, z, w"):
        measure_coherence([one, other])
