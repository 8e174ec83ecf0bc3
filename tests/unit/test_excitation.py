"""Excitations: what each kind of signal is, and how a request for one is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amb_core.excitation import KINDS, Excitation, excitation_from_request, excitation_from_settings, generate
from amb_core.ground.errors import ExcitationError

RATE = 10_000.0
SEEDED = ("multisine", "prbs", "white_noise")


def make(kind: str, **values: Any) -> Excitation:
    """Excitation of 50 um and 1 s, if not told otherwise."""
    size: dict[str, Any] = {"amplitude": 50e-6}
    if kind == "tones":
        size = {"frequencies": [20.0, 50.0], "amplitudes": [10e-6, 40e-6]}
    return excitation_from_request(kind, {"duration": 1.0, **size, **values})


kinds = st.sampled_from(list(KINDS))
axes = st.sampled_from(["x", "y", "both", "in_turn"])
durations = st.floats(0.3, 1.5)
amplitudes = st.floats(1e-6, 1e-3)
seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=60, deadline=None)
@given(kind=kinds, axes=axes, duration=durations, rate=st.floats(1_000.0, 20_000.0))
def test_signal_has_one_sample_per_step_on_the_asked_axes_only(
    kind: str, axes: str, duration: float, rate: float
) -> None:
    signal = generate(make(kind, axes=axes, duration=duration), rate)
    steps = round(duration * rate)
    assert signal.samples.shape == (steps, 2)
    assert signal.sample_time == 1.0 / rate
    assert np.all(np.isfinite(signal.samples))
    half = steps // 2
    silent = {"x": [(0, steps, 1)], "y": [(0, steps, 0)], "both": [], "in_turn": [(0, half, 1), (half, steps, 0)]}
    for first, last, axis in silent[axes]:
        assert not signal.samples[first:last, axis].any()


@settings(max_examples=40, deadline=None)
@given(kind=st.sampled_from(["sweep", "square", "multisine", "prbs"]), amplitude=amplitudes, axes=axes, seed=seeds)
def test_amplitude_is_the_peak(kind: str, amplitude: float, axes: str, seed: int) -> None:
    values = {"seed": seed} if kind in SEEDED else {}
    signal = generate(make(kind, amplitude=amplitude, axes=axes, **values), RATE)
    for axis in np.flatnonzero(signal.samples.any(axis=0)):
        # A sampled sine may miss its crest, by less than 1 % at 25 samples a period.
        assert np.max(np.abs(signal.samples[:, axis])) == pytest.approx(amplitude, rel=1e-2)
        assert np.max(np.abs(signal.samples[:, axis])) <= amplitude * (1.0 + 1e-12)


@settings(max_examples=30, deadline=None)
@given(kind=st.sampled_from(SEEDED), seed=seeds)
def test_a_seed_fixes_the_signal_and_another_seed_changes_it(kind: str, seed: int) -> None:
    signal = generate(make(kind, seed=seed), RATE)
    assert signal.samples.tobytes() == generate(make(kind, seed=seed), RATE).samples.tobytes()
    assert not np.array_equal(signal.samples, generate(make(kind, seed=(seed + 1) % 2**32), RATE).samples)


@settings(max_examples=20, deadline=None)
@given(kind=st.sampled_from(SEEDED), seed=seeds)
def test_seeded_kinds_excite_both_axes_by_uncorrelated_signals(kind: str, seed: int) -> None:
    samples = generate(make(kind, seed=seed, duration=10.0), RATE).samples
    # Standard deviation of the estimate is 1/sqrt(2 * bandwidth * duration), about 0.011 to 0.014; six of them.
    assert abs(np.corrcoef(samples.T)[0, 1]) < 0.09


@pytest.mark.parametrize("kind", ["sweep", "square", "tones"])
def test_deterministic_kinds_put_the_same_signal_on_both_axes(kind: str) -> None:
    samples = generate(make(kind, axes="both"), RATE).samples
    assert np.array_equal(samples[:, 0], samples[:, 1])


def test_samples_cannot_be_changed() -> None:
    signal = generate(make("sweep"), RATE)
    with pytest.raises(ValueError, match="read-only"):
        signal.samples[0, 0] = 1.0


@settings(max_examples=30, deadline=None)
@given(start=st.floats(1.0, 1_000.0), end=st.floats(1.0, 1_000.0), spacing=st.sampled_from(["linear", "logarithmic"]))
def test_phase_of_a_sweep_is_the_integral_of_its_frequency(start: float, end: float, spacing: str) -> None:
    sweep = make("sweep", frequency_start=start, frequency_end=end, spacing=spacing, axes="x")
    signal = generate(sweep, 100_000.0)
    assert signal.frequency is not None
    assert signal.frequency[0] == pytest.approx(start)
    assert signal.frequency[-1] == pytest.approx(end, abs=0.1)  # one sample before the end
    trapezoids = (signal.frequency[1:] + signal.frequency[:-1]) / 2.0 * signal.sample_time
    phase = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(trapezoids)])
    # The trapezoidal rule is exact for linear spacing; for logarithmic its error is of the order of 1e-9 cycles.
    assert np.max(np.abs(signal.samples[:, 0] - 50e-6 * np.sin(phase))) < 50e-6 * 1e-6


def test_a_logarithmic_sweep_is_at_the_geometric_mean_half_way() -> None:
    frequency = generate(
        make("sweep", frequency_start=10.0, frequency_end=1_000.0, spacing="logarithmic", axes="y"), RATE
    ).frequency
    assert frequency is not None
    assert frequency[len(frequency) // 2] == pytest.approx(100.0)


def test_a_sweep_in_turn_runs_through_the_whole_band_on_each_axis() -> None:
    signal = generate(make("sweep", frequency_start=10.0, frequency_end=100.0, axes="in_turn", duration=2.0), RATE)
    assert np.array_equal(signal.samples[:10_000, 0], signal.samples[10_000:, 1])
    assert signal.frequency is not None
    assert signal.frequency[0] == signal.frequency[10_000] == 10.0


def test_the_papers_square_wave_goes_first_on_x_then_on_y_and_starts_high() -> None:
    samples = generate(excitation_from_request("square", {"amplitude": 50e-6, "duration": 4.0}), RATE).samples
    assert set(np.unique(samples)) == {-50e-6, 0.0, 50e-6}
    assert np.all(samples[:1_000] == [50e-6, 0.0])
    assert np.all(samples[1_000:2_000] == [-50e-6, 0.0])
    assert np.all(samples[20_000:21_000] == [0.0, 50e-6])


@settings(max_examples=40, deadline=None)
@given(half_period=st.integers(1, 700))
def test_edges_of_a_square_wave_fall_on_their_samples(half_period: int) -> None:
    samples = generate(make("square", frequency=RATE / (2 * half_period), axes="x"), RATE).samples[:, 0]
    expected = np.where((np.arange(len(samples)) // half_period) % 2 == 0, 50e-6, -50e-6)
    assert np.array_equal(samples, expected)


@pytest.mark.parametrize("steps", [10_000, 10_001])
def test_a_multisine_has_equal_lines_in_its_band_and_none_outside(steps: int) -> None:
    multisine = make("multisine", frequency_start=20.0, frequency_end=300.0, seed=7, duration=steps / RATE)
    magnitude = np.abs(np.fft.rfft(generate(multisine, RATE).samples[:, 0]))
    frequency = np.fft.rfftfreq(steps, 1.0 / RATE)
    inside = (frequency >= 20.0 - 1e-6) & (frequency <= 300.0 + 1e-6)
    assert np.ptp(magnitude[inside]) < 1e-9 * magnitude[inside].max()
    assert magnitude[~inside].max() < 1e-9 * magnitude[inside].max()


def test_prbs_holds_each_bit_for_one_clock_period_and_is_balanced() -> None:
    samples = generate(make("prbs", frequency=500.0, duration=10.0), RATE).samples
    bits = samples.reshape(-1, 20, 2)
    assert np.all(bits == bits[:, :1])
    # 5000 bits: the standard deviation of the mean is 1.4 % of the amplitude.
    assert np.all(np.abs(samples.mean(axis=0)) < 0.06 * 50e-6)


def test_white_noise_has_the_asked_rms_and_band() -> None:
    noise = make("white_noise", amplitude=10e-6, frequency_start=50.0, frequency_end=200.0, seed=3)
    samples = generate(noise, RATE).samples
    assert np.sqrt(np.mean(samples**2, axis=0)) == pytest.approx([10e-6, 10e-6], rel=1e-12)
    power = np.abs(np.fft.rfft(samples, axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1.0 / RATE)
    outside = (frequency < 49.9) | (frequency > 200.1)
    assert power[outside].sum() < 1e-20 * power.sum()


def test_tones_are_the_sum_of_their_sines() -> None:
    tones = excitation_from_request(
        "tones",
        {"duration": 0.5, "axes": "x", "frequencies": [20.0, 200.0], "amplitudes": [4e-5, 1e-5], "phases": [0.0, 1.0]},
    )
    time = np.arange(5_000) / RATE
    expected = 4e-5 * np.sin(2 * np.pi * 20.0 * time) + 1e-5 * np.sin(2 * np.pi * 200.0 * time + 1.0)
    assert generate(tones, RATE).samples[:, 0] == pytest.approx(expected, abs=1e-17)


def test_zero_and_empty_fields_take_the_defaults_of_the_kind() -> None:
    request = {
        "axes": "",
        "amplitude": 50e-6,
        "duration": 4.0,
        "frequency": 0.0,
        "frequency_start": 0.0,
        "frequency_end": 0.0,
        "spacing": "",
        "frequencies": np.array([]),
        "amplitudes": [],
        "phases": [],
        "seed": 0,
    }
    with pytest.raises(ExcitationError, match="square does not use 'frequency_start' = 0"):
        excitation_from_settings("square", request)
    assert excitation_from_request("square", request) == KINDS["square"](amplitude=50e-6, duration=4.0)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (
            "noise",
            {},
            "unknown kind of excitation 'noise'; allowed: sweep, square, multisine, prbs, white_noise, tones",
        ),
        ("square", {"amplitude": 0.0}, "square has no default for 'amplitude'"),
        ("square", {"amplitude": 2e-3}, "'amplitude' = 0.002 is not allowed; allowed: 1e-09 to 0.001 m"),
        ("square", {"amplitude": -50e-6}, "'amplitude' = -5e-05 is not allowed"),
        ("square", {"amplitude": float("nan")}, "'amplitude' = nan is not allowed"),
        ("sweep", {"frequency_end": float("inf")}, "'frequency_end' = inf is not allowed"),
        ("sweep", {"frequency_start": -1.0}, "'frequency_start' = -1.0 is not allowed"),
        ("sweep", {"spacing": "cubic"}, "'spacing' = 'cubic' is not allowed; allowed: one of linear, logarithmic"),
        ("square", {"duration": 1e9}, r"'duration' = 1000000000.0 is not allowed; allowed: 0.001 to 600 s"),
        ("square", {"frequency_start": 5.0}, "square does not use 'frequency_start' = 5.0; square uses"),
        ("square", {"seed": 1}, "square does not use 'seed' = 1"),
        ("square", {"frequenzy": 5.0}, "unknown field 'frequenzy' = 5.0"),
        ("multisine", {"frequency_start": 500.0}, "the band 500 Hz to 400 Hz is empty"),
        ("tones", {"frequencies": []}, "tones has no default for 'frequencies'"),
        ("tones", {"amplitudes": [1e-5]}, "2 frequencies but 1 amplitudes"),
        ("tones", {"phases": [1.0]}, "2 frequencies but 1 phases"),
        ("tones", {"frequencies": [10.0, float("nan")]}, "'frequencies' = .10.0, nan. is not allowed"),
        ("tones", {"frequencies": [10.0, -5.0]}, "frequency -5 Hz is not allowed"),
        ("tones", {"amplitudes": [1e-5, -1e-5]}, "amplitude -1e-05 m is not allowed"),
        ("tones", {"amplitudes": [1e-3, 1e-3]}, "sum up to 0.002 m"),
        ("tones", {"amplitude": 1e-5}, "tones does not use 'amplitude'"),
    ],
)
def test_a_bad_request_is_refused_with_its_reason(kind: str, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ExcitationError, match=message) as refusal:
        make(kind, **values)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("sweep", {"frequency_end": 5_001.0}),
        ("square", {"frequency": 5_001.0}),
        ("multisine", {"frequency_end": 5_001.0}),
        ("prbs", {"frequency": 5_001.0}),
        ("white_noise", {"frequency_end": 5_001.0}),
        ("tones", {"frequencies": [10.0, 5_001.0]}),
    ],
)
def test_a_frequency_above_nyquist_is_refused(kind: str, values: dict[str, Any]) -> None:
    with pytest.raises(ExcitationError, match="5001 Hz is above the Nyquist frequency 5000 Hz"):
        generate(make(kind, **values), RATE)


def test_a_sweep_up_to_the_nyquist_frequency_is_allowed() -> None:
    assert generate(make("sweep", frequency_start=10.0, frequency_end=5_000.0, axes="y"), RATE).steps == 10_000


def test_a_band_without_a_line_is_refused() -> None:
    with pytest.raises(ExcitationError, match=r"no multiple of 1 Hz .* lies in the band 10.2 Hz to 10.8 Hz"):
        generate(make("multisine", frequency_start=10.2, frequency_end=10.8), RATE)


def test_a_signal_without_a_sample_on_each_axis_is_refused() -> None:
    with pytest.raises(ExcitationError, match=r"duration 0\.001 s is too short"):
        generate(make("square", duration=1e-3), 1_000.0)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_an_impossible_sample_rate_is_refused(rate: float) -> None:
    with pytest.raises(ExcitationError, match="sample rate"):
        generate(make("square"), rate)
