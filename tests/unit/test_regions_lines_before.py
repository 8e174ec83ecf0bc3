"""What turns, hums or rings is neither drift nor slow oscillation, and hides neither."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from amb_core.excitation import excitation_from_request, generate
from amb_core.loop.records import LoopRecord
from amb_core.regions import Region, RegionParameters, classify
from amb_core.regions.linear_mode import unexplained_amplitude
from amb_core.regions.steady_lines import SteadyLines, find_lines
from tests.synthetic_telemetry import Loop

RATE = 10_000.0
REST = 8_000  # steps
STOP = 26_000  # step at which an excitation ends
TIME = np.arange(60_000) / RATE


def record(added: NDArray[np.float64], kind: str = "sweep", rest: int = REST) -> LoopRecord:
    """A loop without dynamics, at rest, then excited on y, with 50 nm of noise and something added to y."""
    request: dict[str, object] = {"amplitude": 10e-6, "duration": (len(added) - rest) / RATE, "axes": "y"}
    if kind == "sweep":
        request |= {"frequency_start": 10.0, "frequency_end": 1_500.0}
    reference, position = np.zeros((2, len(added), 2))
    reference[rest:] = generate(excitation_from_request(kind, request), RATE).samples
    position += np.random.default_rng(4).normal(scale=0.05e-6, size=position.shape) + 0.1 * reference
    position[:, 1] += added - 40e-6
    return LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))


def stopped(kind: str, added: NDArray[np.float64]) -> LoopRecord:
    """The same, excited until `STOP` only."""
    excited = record(added[:STOP], kind)
    rest = np.random.default_rng(5).normal(scale=0.05e-6, size=(len(added) - STOP, 2)) - [0.0, 40e-6]
    rest[:, 1] += added[STOP:]
    reference = np.vstack([excited.reference, np.zeros_like(rest)])
    position = np.vstack([excited.position, rest])
    return LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))


def line(frequency: float, amplitude: float) -> NDArray[np.float64]:
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME + 0.7)


def since(start: float) -> NDArray[np.float64]:
    return np.maximum(TIME - start, 0.0)


# -- lines that were there before


@pytest.mark.parametrize(("frequency", "amplitude"), [(50.0, 2e-6), (15.9, 3e-6), (30.0, 10e-6), (100.0, 5e-6)])
def test_hum_and_unbalance_leave_region_a(frequency: float, amplitude: float) -> None:
    classification = classify(record(line(frequency, amplitude) + line(2.0 * frequency, 0.2 * amplitude)))
    assert classification.axis_onsets == {"x": {}, "y": {}}
    state = classification.states[-1].axis("y")
    assert state.steady_frequency == pytest.approx(frequency, abs=0.1)
    assert state.steady_amplitude == pytest.approx(amplitude, rel=0.1)


def test_a_drift_beside_hum_is_found_where_it_begins() -> None:
    classification = classify(record(line(50.0, 5e-6) - 5e-6 * since(3.0)))
    assert classification.onsets[Region.B].time == pytest.approx(3.0, abs=0.03)
    assert Region.C not in classification.onsets


def test_a_line_that_sets_in_is_an_oscillation_with_or_without_input() -> None:
    starts = np.where(TIME > 4.0, line(40.0, 3e-6), 0.0)
    assert classify(record(starts)).onsets[Region.C].time == pytest.approx(4.0, abs=0.05)
    assert classify(record(starts, rest=50_000)).onsets[Region.C].time == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize("kind", ["sweep", "square", "multisine"])
@pytest.mark.parametrize("after", [0.0, 0.3, 1.0, 1.9])
def test_a_line_that_sets_in_after_an_excitation_is_an_oscillation(kind: str, after: float) -> None:
    classification = classify(stopped(kind, np.where(STOP / RATE + after < TIME, line(40.0, 3e-6), 0.0)))
    assert classification.axis_onsets["x"] == {}
    assert classification.axis_onsets["y"][Region.C].time >= STOP / RATE
    assert classification.states[-1].region is Region.C


def test_a_line_from_before_the_excitation_is_none_after_it() -> None:
    classification = classify(stopped("square", line(40.0, 3e-6)))
    assert classification.onsets == {} and classification.states[-1].axis("y").steady_frequency == pytest.approx(
        40.0, abs=0.1
    )


def test_an_oscillation_hides_no_drift() -> None:
    classification = classify(record(np.where(TIME > 3.0, line(40.0, 3e-6), 0.0) - 20e-6 * since(4.0)))
    state = classification.states[-1].axis("y")
    assert state.region is Region.C
    assert state.drift.time == pytest.approx(4.0, abs=0.05)
    assert state.oscillation.time == pytest.approx(3.0, abs=0.05)
    assert classification.axis_onsets["y"][Region.B] == state.drift


def test_a_known_running_speed_needs_no_rest() -> None:
    turning = record(line(25.0, 3e-6), rest=0)
    assert Region.C in classify(turning).onsets
    assert classify(turning, RegionParameters(running_speed=2.0 * math.pi * 25.0)).onsets == {}


def test_lines_are_found_with_their_frequencies_and_amplitudes() -> None:
    time = np.arange(-599, 1) / 1_000.0
    wanted = 3e-6 * np.cos(2.0 * np.pi * 15.9 * time + 1.0) + 1e-6 * np.cos(2.0 * np.pi * 50.0 * time)
    noise = np.random.default_rng(1).normal(scale=0.2e-6, size=600)
    frequency, amplitude = find_lines(wanted + noise - 60e-6, 1_000.0, 195.0, 1e-7)
    assert frequency == pytest.approx([15.9, 50.0], abs=0.05)
    assert np.abs(amplitude) == pytest.approx([3e-6, 1e-6], rel=0.05)
    assert np.angle(amplitude) == pytest.approx([1.0, 0.0], abs=0.06)


def test_noise_has_no_lines() -> None:
    random = np.random.default_rng(2)
    assert all(len(find_lines(random.normal(size=400), 1_000.0, 195.0, 0.0)[0]) == 0 for _ in range(50))


def test_a_line_whose_frequency_changes_is_followed() -> None:
    lines = SteadyLines(200, 10, 1_000.0)
    lines.adopt(np.array([20.0]), np.array([1e-6 + 0j]))
    angle = 0.0
    for _ in range(1_000):
        lines.proceed()
        angle += 2.0 * np.pi * 20.3 * 0.01
        lines.correct(1e-6 * np.array([np.cos(angle), -np.sin(angle)]), 0.0, steady_input=True)
    assert lines.frequency == pytest.approx([20.3], abs=0.01)


# -- slow oscillations of any frequency


@pytest.mark.parametrize("frequency", [1.5, 3.0, 8.0, 12.0, 60.0])
def test_slow_oscillations_are_found_down_to_a_hertz(frequency: float) -> None:
    starts = np.where(TIME > 1.5, 3e-6 * np.sin(2.0 * np.pi * frequency * since(1.5)), 0.0)
    classification = classify(record(starts))
    assert classification.axis_onsets["y"][Region.C].time == pytest.approx(1.5, abs=0.6 / frequency + 0.05)
    state = classification.states[-1].axis("y")
    assert state.oscillation is not None


# -- modes


@pytest.mark.parametrize("kind", ["sweep", "prbs", "multisine"])
@pytest.mark.parametrize("natural", [15.0, 25.0, 80.0])
def test_a_lightly_damped_linear_mode_is_no_oscillation(kind: str, natural: float) -> None:
    angular = 2.0 * np.pi * natural
    mode = Loop._discrete([angular**2], angular, 0.01)
    quiet = record(np.zeros(60_000), kind)
    ringing = lfilter(*mode, quiet.reference[:, 1])
    assert Region.C not in classify(record(0.5 * ringing, kind)).axis_onsets["y"]


def test_a_mode_explains_its_ringing_and_not_a_line_that_sets_in() -> None:
    angular = 2.0 * np.pi * 20.0
    time = np.arange(4_000) / 1_000.0
    reference = np.where((time > 1.0) & (time < 1.05), 1e-5, 0.0)
    ring = np.exp(-0.01 * angular * time) * np.sin(angular * time)
    ringing = 0.05 * angular * np.convolve(reference, ring)[:4_000]
    own = np.where(time > 2.0, ringing.std() * np.sin(angular * time), 0.0)
    assert unexplained_amplitude(reference, ringing, 20.0, 5.0, 1_000.0) < 0.1 * ringing[3_000:].std()
    assert unexplained_amplitude(reference, own, 20.0, 5.0, 1_000.0) > 0.5 * ringing.std()


@pytest.mark.parametrize(
    ("tone", "slow"), [(500.0, 20.0), (500.0, 100.0), (625.0, 125.0), (1_000.0, 31.7), (2_500.0, 20.0)]
)
def test_an_input_locked_to_the_sample_rate_explains_no_slow_line(tone: float, slow: float) -> None:
    time = TIME[:30_000]
    reference = np.zeros((len(time), 2))
    reference[:, 1] = 5e-6 * np.sin(2.0 * np.pi * tone * time)
    position = np.random.default_rng(6).normal(scale=0.05e-6, size=reference.shape)
    position += 0.4 * np.roll(reference, 3, axis=0)
    position[:, 1] += np.where(time >= 1.0, 10e-6 * np.sin(2.0 * np.pi * slow * (time - 1.0)), 0.0) - 68e-6
    onsets = classify(LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))).onsets
    assert onsets[Region.C].time == pytest.approx(1.0, abs=0.04)


@pytest.mark.parametrize("scale", [0.0, 1e-14, 1e-3])
def test_an_input_too_weak_for_any_mode_explains_nothing(scale: float) -> None:
    time = np.arange(4_000) / 1_000.0
    reference = scale * 1e-6 * np.sin(2.0 * np.pi * 20.0 * time)  # a line as steady as the one in question
    position = 1e-6 * np.sin(2.0 * np.pi * 20.0 * time + 1.0)
    assert unexplained_amplitude(reference, position, 20.0, 5.0, 1_000.0) > 0.8e-6
    assert unexplained_amplitude(position / 50.0, position, 20.0, 5.0, 1_000.0) < 0.1e-6


# -- distortion


def test_the_state_shows_the_distortion_of_the_response_to_a_sine() -> None:
    phase = 2.0 * np.pi * 200.0 * TIME
    reference, position = np.zeros((2, len(TIME), 2))
    reference[:, 1] = 10e-6 * np.sin(phase)
    position[:, 1] = 5e-6 * (np.sin(phase + 0.3) + 0.04 * np.cos(2.0 * phase) + 0.02 * np.sin(3.0 * phase))
    position += np.random.default_rng(5).normal(scale=0.02e-6, size=position.shape)
    state = classify(LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))).states[-1]
    assert state.axis("y").region is Region.A
    assert state.axis("y").even_distortion == pytest.approx(0.04, abs=0.003)
    assert state.axis("y").odd_distortion == pytest.approx(0.02, abs=0.003)
    assert math.isnan(state.axis("x").even_distortion)
