"""Slow oscillations that hide: several lines, lines between the bins of a narrow band, lines beside beats."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.loop.records import LoopRecord
from amb_core.regions import Region, classify
from amb_core.regions.several_lines import critical_shares, lines_explain
from amb_core.regions.slow_signal import line_table
from tests.unit.test_regions_classifier import RATE, seconds, telemetry, tone

SAMPLES, LOWEST = 200, 4  # of the short window, and its lowest bin


def oscillating(reference: NDArray[np.float64], *slow: float, amplitude: float = 20e-6) -> LoopRecord:
    """A position with slow lines of one amplitude (m) from 1.5 s onwards."""
    time = seconds(len(reference) / RATE)
    lines = sum(tone(frequency, amplitude, time) for frequency in slow)
    return telemetry(0.1 * reference + np.where(time > 1.5, lines, 0.0), reference)


@pytest.mark.parametrize("slow", [(33.0, 71.0), (33.0, 71.0, 97.0), (26.0, 47.0, 71.0, 97.0), (40.0, 52.0)])
def test_slow_lines_do_not_hide_each_other(slow: tuple[float, ...]) -> None:
    record = oscillating(tone(1_000.3, 20e-6, seconds(4.0)), *slow)
    assert classify(record).onsets[Region.C].time == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize(("frequency", "slow"), [(100.0, 31.9), (120.0, 26.0), (150.0, 46.4), (180.0, 31.0)])
def test_a_line_between_two_bins_of_a_narrow_band_is_found(frequency: float, slow: float) -> None:
    """Under a slow input the band has few bins, of which one line must hold nearly all of the power."""
    record = oscillating(tone(frequency, 20e-6, seconds(4.0)), slow, amplitude=10e-6)
    assert classify(record).onsets[Region.C].time == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize(("frequency", "slow"), [(627.1, 25.5), (621.3, 80.4), (796.7, 27.9)])
def test_a_line_beside_the_beats_of_a_fixed_sine_is_found(frequency: float, slow: float) -> None:
    """At 2 kHz, where about three harmonics fold into the slow band: beats that may change would explain the line."""
    time = np.arange(8_000) / 2_000.0
    reference = tone(frequency, 20e-6, time)[:, None]
    noise = 0.02e-6 * np.random.default_rng(3).standard_normal((8_000, 1))
    position = 0.1 * reference + noise + np.where(time > 1.5, tone(slow, 10e-6, time), 0.0)[:, None]
    record = LoopRecord(0, 1.0 / 2_000.0, reference, position, np.zeros_like(position), ("y",))
    assert classify(record).onsets[Region.C].time == pytest.approx(1.5, abs=0.1)


def test_what_a_slow_beat_leaves_in_the_band_is_no_oscillation() -> None:
    """The ninth harmonic folds to 2.6 Hz, and swings the bias: a parabola leaves lines of more than a micrometre."""
    time = seconds(4.0)
    beat = 60e-6 * np.tanh(10.0 * tone(9.0 * 1_111.4 - RATE, 1.0, time))
    assert Region.C not in classify(telemetry(beat, tone(1_111.4, 20e-6, time))).onsets


@pytest.mark.parametrize("highest", [8, 12, 30])
def test_noise_passes_the_test_of_several_lines_as_rarely_as_stated(highest: int) -> None:
    """Lines lie between bins, too, so that noise passes a few times as often; see the page on regions."""
    random, table, level = np.random.default_rng(0), line_table(SAMPLES, highest), 0.01
    shares = critical_shares(highest - LOWEST + 1, level)
    windows = random.standard_normal((2_000, SAMPLES))
    passed = sum(lines_explain(window, LOWEST, highest, table, shares) for window in windows)
    assert passed < 6.0 * level * len(windows)
