"""The streaming classifier: its states do not depend on blocks, gaps restart it, and regions are told apart."""

from __future__ import annotations

import math
from itertools import cycle

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from amb_core.excitation import Sweep, generate
from amb_core.ground.errors import ParameterError, RegionError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.regions import Region, RegionClassifier, RegionParameters, RegionState, classify
from amb_core.regions.stretches import stretches

RATE = 10_000.0
PARAMETERS = RegionParameters(backup_bearing_radius=250e-6)


def telemetry(
    y: NDArray[np.float64], reference_y: NDArray[np.float64] | None = None, first_step: int = 0
) -> LoopRecord:
    """Telemetry with a position and reference on y (m), a little noise on both axes."""
    noise = np.random.default_rng(3).normal(scale=0.05e-6, size=(len(y), 2))
    reference = np.zeros((len(y), 2))
    if reference_y is not None:
        reference[:, 1] = reference_y
    return LoopRecord(
        first_step, 1.0 / RATE, reference, noise + np.stack([np.zeros_like(y), y], axis=1), np.zeros_like(noise)
    )


def seconds(duration: float) -> NDArray[np.float64]:
    return np.arange(round(duration * RATE)) / RATE


def tone(frequency: float, amplitude: float, time: NDArray[np.float64]) -> NDArray[np.float64]:
    return amplitude * np.sin(2.0 * np.pi * frequency * time)


@pytest.fixture(scope="module")
def eventful() -> LoopRecord:
    """A tone of 1 kHz from 0.3 s, a drift from 1 s, a slow oscillation from 1.7 s, contact from 2.6 s to 2.7 s."""
    time = seconds(3.5)
    reference = np.where(time >= 0.3, tone(1_000.0, 20e-6, time), 0.0)
    y = -60e-6 - 30e-6 * np.clip(time - 1.0, 0.0, 1.0) + np.where(time >= 1.7, tone(60.0, 10e-6, time), 0.0)
    y[26_050:27_000] = -260e-6
    return telemetry(y + 0.05 * reference, reference)


# -- streaming


@pytest.mark.parametrize("sizes", [(100,), (1, 1, 1, 397), (7, 250, 1, 33), (4_096,)])
def test_states_do_not_depend_on_the_block_size(eventful: LoopRecord, sizes: tuple[int, ...]) -> None:
    classifier = RegionClassifier(PARAMETERS, 1.0 / RATE)
    states: list[RegionState] = []
    start = 0
    for size in cycle(sizes):
        size = min(size, eventful.steps - start)
        if size == 0:
            break
        states += classifier.feed(eventful.window(start, size))
        start += size
    expected = classify(eventful, PARAMETERS).states
    assert [repr(state) for state in states] == [repr(state) for state in expected]  # repr: NaN is like NaN


def test_states_come_a_hundred_times_a_second(eventful: LoopRecord) -> None:
    steps = [state.step for state in classify(eventful).states]
    assert [step for step in steps if step % 100 == 99] == list(range(99, eventful.steps, 100))


def test_grid_does_not_depend_on_the_first_step() -> None:
    states = RegionClassifier(PARAMETERS, 1.0 / RATE).feed(telemetry(np.zeros(1_000), first_step=1_234))
    assert [state.step for state in states] == list(range(1_299, 2_200, 100))


def test_a_gap_restarts_the_classification(eventful: LoopRecord) -> None:
    classifier = RegionClassifier(PARAMETERS, 1.0 / RATE)
    before = classifier.feed(eventful.window(0, 24_000))[-1]
    assert before.region is Region.C
    after = classifier.feed(eventful.window(24_500, 1_000))[-1]
    assert classifier.gaps == [(24_000, 24_500)]
    assert (after.region, after.settled, after.since.step) == (Region.A, False, 24_500)


def test_an_earlier_step_is_another_start(eventful: LoopRecord) -> None:
    classifier = RegionClassifier(PARAMETERS, 1.0 / RATE)
    classifier.feed(eventful.window(15_000, 9_000))
    again = classifier.feed(eventful.window(0, 20_000))
    assert classifier.gaps == []
    assert repr(again) == repr(classify(eventful.window(0, 20_000), PARAMETERS).states)


def test_samples_that_are_not_finite_are_named(eventful: LoopRecord) -> None:
    position = eventful.position.copy()
    position[1_234, 1] = math.nan
    bad = LoopRecord(0, 1.0 / RATE, eventful.reference, position, eventful.current)
    classifier = RegionClassifier(PARAMETERS, 1.0 / RATE)
    classifier.feed(bad.window(0, 1_000))
    with pytest.raises(RegionError, match="position y is nan at step 1234; samples must be finite"):
        classifier.feed(bad.window(1_000, 1_000))
    classifier.feed(bad.window(2_000, 1_000))
    assert classifier.gaps == [(1_000, 2_000)]


def test_another_sample_time_is_refused() -> None:
    with pytest.raises(RegionError, match=r"sample time is 0.0002 s at step 0; the classifier was made for 0.0001 s"):
        RegionClassifier(PARAMETERS, 1e-4).feed(LoopRecord(0, 2e-4, *np.zeros((3, 10, 2))))


def test_an_update_interval_needs_ten_samples() -> None:
    assert RegionParameters().for_sample_time(1e-3) == RegionParameters()
    with pytest.raises(RegionError, match="must hold at least 10 samples"):
        RegionClassifier(RegionParameters(update_interval=0.002), 1e-3)


def test_below_1_khz_the_defaults_are_those_of_a_slower_loop() -> None:
    used = RegionClassifier(RegionParameters(drift_threshold=1e-5), 4e-3).parameters
    assert used == RegionParameters(
        update_interval=0.04,
        settling_time=0.4,
        trend_window=0.96,
        oscillation_window=0.8,
        hold_time=0.8,
        slow_frequency=37.5,
        drift_threshold=1e-5,
    )
    assert used.for_sample_time(4e-3) == used
    with pytest.raises(ParameterError, match="oscillation_window"):
        RegionClassifier(RegionParameters(oscillation_window=0.25), 4e-3)
    with pytest.raises(RegionError, match="not classified at 50 Hz; the sample rate must be at least 100 Hz"):
        RegionClassifier(RegionParameters(), 0.02)


@pytest.mark.parametrize("shift", [0.0, 1e-5])
def test_a_slow_loop_drifts_at_its_own_time_scale(shift: float) -> None:
    """At 250 Hz the same samples as at 1 kHz are the same regions, in times that are four times as long."""
    time = np.arange(8_000) * 1e-3
    reference = np.column_stack([2e-5 * np.sign(np.sin(2.0 * np.pi * 7.3 * time)), np.zeros_like(time)])
    position = reference + np.column_stack([shift * (time > 4.0) * (time - 4.0), np.zeros_like(time)])
    fast, slow = (
        RegionClassifier(RegionParameters(), period).feed(LoopRecord(0, period, reference, position, 0.0 * position))
        for period in (1e-3, 4e-3)
    )
    assert [(state.step, state.region) for state in slow] == [(state.step, state.region) for state in fast]
    assert (max(state.region.name for state in slow) == "B") == (shift > 0.0)


@pytest.mark.parametrize("values", [{"slow_frequency": 200.0}, {"slow_frequency": 20.0}])
def test_slow_band_must_fit_interval_and_window(values: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match="slow_frequency"):
        validate(RegionParameters, values)


@pytest.mark.parametrize(
    "values",
    [
        {"update_interval": 0.03, "slow_frequency": 50.0},
        {"update_interval": 0.03, "slow_frequency": 50.0, "trend_window": 0.5},
    ],
)
def test_windows_must_hold_enough_updates(values: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match=r"window = .* must be at least"):
        validate(RegionParameters, values)


def test_the_shortest_trend_window_suits_every_sample_rate() -> None:
    """At 1.6 kHz an update is 12.5 ms long: 0.12 s hold fewer updates than the shortest test needs."""
    steps = np.arange(4_000)
    y = (
        1e-8 * np.random.default_rng(1).standard_normal((4_000, 2))
        + 20e-6 * np.maximum(steps / 1600.0 - 1.5, 0.0)[:, None]
    )
    record = LoopRecord(0, 1.0 / 1600.0, np.zeros_like(y), y, np.zeros_like(y))
    onset = classify(record, RegionParameters(trend_window=0.12)).onsets[Region.B]
    assert onset.time == pytest.approx(1.5, abs=0.05)


def test_other_sample_rates() -> None:
    time = np.arange(6_000) / 2_000.0
    reference = np.zeros((6_000, 2))
    reference[:, 0] = 10e-6 * np.sin(2.0 * np.pi * 500.0 * time)
    position = 0.1 * reference
    position[:, 0] -= 20e-6 * np.maximum(time - 1.5, 0.0)
    onset = classify(LoopRecord(0, 1.0 / 2_000.0, reference, position, np.zeros_like(position))).onsets[Region.B]
    assert onset.time == pytest.approx(1.5, abs=0.02)
    assert onset.input_frequency == pytest.approx(500.0, rel=1e-6)


# -- what is told apart


@pytest.mark.parametrize("lost", [0, 9_000])
def test_a_state_is_settled_once_a_drift_or_an_oscillation_could_have_been_found(lost: int) -> None:
    """From the start, and after a gap of 100 steps in quiet telemetry."""
    time = seconds(1.7)
    since = np.maximum(time - lost / RATE, 0.0)
    first = {}
    for name, motion in (("A", 0.0 * time), ("B", -200e-6 * since), ("C", (since > 0.0) * tone(60.0, 10e-6, time))):
        record = telemetry(motion + 2e-6 * np.sin(2.0 * np.pi * 500.0 * time), tone(500.0, 5e-6, time))
        classifier = RegionClassifier(PARAMETERS, 1.0 / RATE)
        if lost:
            classifier.feed(record.window(0, lost))
        states = classifier.feed(record.window(lost + 100 if lost else 0, 7_000))
        first[name] = next(state.step for state in states if state.region.name == name and state.settled)
        assert not any(state.settled for state in states if state.step < first[name]), name
    assert 0.55 * RATE < first["A"] - lost <= 0.65 * RATE
    assert first["B"] == first["C"] == first["A"], "the shortest tests are complete, and these are unmistakable"


@pytest.mark.parametrize("duration", [0.4, 0.5, 0.55])
def test_a_record_that_is_too_short_for_b_is_not_called_region_a(duration: float) -> None:
    time = seconds(duration)
    drifting = telemetry(-68e-6 - 300e-6 * time + tone(500.0, 2e-6, time), tone(500.0, 5e-6, time))
    classification = classify(drifting)
    assert classification.onsets == {} and stretches(classification.states) == []


def test_regions_follow_one_another(eventful: LoopRecord) -> None:
    classification = classify(eventful, PARAMETERS)
    assert {region: onset.time for region, onset in classification.axis_onsets["y"].items()} == pytest.approx(
        {Region.B: 1.0, Region.C: 1.7, Region.D: 2.605}, abs=0.02
    )
    assert classification.onsets == classification.axis_onsets["y"]
    assert classification.axis_onsets["x"] == {Region.D: classification.onsets[Region.D]}


def test_delevitation_is_told_at_its_step(eventful: LoopRecord) -> None:
    states = classify(eventful, PARAMETERS).states
    first = next(state for state in states if state.region is Region.D)
    assert first.step == first.since.step == 26_050
    assert first.axis("x").region is Region.D
    left = next(state for state in states if state.step > first.step and state.region is not Region.D)
    assert left.step == pytest.approx(27_000 + PARAMETERS.hold_time * RATE, abs=201)


def test_a_touch_of_the_backup_bearing_keeps_what_was_before() -> None:
    time = seconds(4.0)
    y = 40e-6 * np.clip(time - 1.0, 0.0, 1.0)
    y[24_000:25_000] = 260e-6
    states = classify(telemetry(y), PARAMETERS).states
    assert states[-1].region is Region.A and states[-1].settled
    assert states[-1].since.time == pytest.approx(2.5 + PARAMETERS.hold_time, abs=0.02)
    parts = stretches(states)
    assert [part.region.name for part in parts] == ["A", "B", "D", "A"]
    assert [part.first_step / RATE for part in parts] == pytest.approx([0.0, 1.0, 2.4, 2.7], abs=0.03)


def test_delevitation_counts_from_the_centre_in_any_direction() -> None:
    position = np.full((500, 2), 180e-6)
    zeros = np.zeros_like(position)
    assert classify(LoopRecord(0, 1e-4, zeros, position, zeros), PARAMETERS).onsets[Region.D].step == 0
    assert classify(LoopRecord(0, 1e-4, zeros, position * 0.97, zeros), PARAMETERS).onsets == {}


def test_delevitation_is_judged_only_where_the_clearance_is_known(eventful: LoopRecord) -> None:
    unknown = classify(eventful)
    assert Region.D not in unknown.onsets
    assert unknown.judged.absent() == "no B or C"
    assert unknown.judged.reservations == ("D not judged: the clearance is not known",)
    for no_clearance in (0.0, -1e-4, math.nan):
        assert classify(eventful, clearance={"x": no_clearance}).judged.contact == {"x": False, "y": False}
    known = classify(eventful, clearance={"x": 250e-6, "y": 250e-6})
    assert known.onsets[Region.D].step == 26_050 and known.judged.complete()


def slow_response(kind: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A reference that the loop follows throughout, and the position, for 4 s."""
    time, random = seconds(4.0), np.random.default_rng(3)
    tones = {"sine": (20.0,), "multisine": np.arange(2.0, 200.0, 0.25)}[kind]
    reference = sum(np.sin(2.0 * np.pi * one * time + random.uniform(0.0, 2.0 * np.pi)) for one in tones)
    reference = 10e-6 * reference / np.abs(reference).max()
    return reference, 0.95 * reference + 0.05e-6 * random.standard_normal(len(time))


@pytest.mark.parametrize("kind", ["sine", "multisine"])
def test_where_the_loop_follows_its_input_b_is_said_to_be_not_judged(kind: str) -> None:
    reference, followed = slow_response(kind)
    jumping = followed + 20e-6 * (seconds(4.0) > 2.0)
    classification = classify(telemetry(jumping, reference), PARAMETERS)
    judged = classification.judged
    assert Region.B not in classification.onsets, "the exclusion is part of the algorithm"
    assert judged.absent("y") == "no C or D" and not judged.complete()
    (said,) = judged.reservations
    assert said.startswith("B not judged in ")
    assert said.endswith("(y): the response is at 0.7 of the input or more (resonant)")


def test_where_the_loop_resonates_for_a_part_b_is_judged_in_the_rest() -> None:
    time = seconds(4.0)
    amplitude = np.where(time < 2.0, 0.95, 0.3)
    judged = classify(telemetry(amplitude * tone(40.0, 10e-6, time), tone(40.0, 10e-6, time)), PARAMETERS).judged
    assert judged.without_drift_test("y") == pytest.approx(0.5, abs=0.1)


def test_features_of_a_slow_oscillation() -> None:
    time = seconds(1.5)
    reference = tone(1_000.0, 20e-6, time)
    state = classify(telemetry(-50e-6 + 0.1 * reference + tone(63.0, 4e-6, time), reference)).states[-1].axis("y")
    assert state.region is Region.C
    assert state.oscillation_amplitude == pytest.approx(4e-6, rel=0.05)
    assert state.oscillation_frequency == pytest.approx(63.0, abs=2.5)
    assert state.bias == pytest.approx(-50e-6, abs=2e-6)
    assert state.input_frequency == pytest.approx(1_000.0, rel=1e-6)
    assert state.input_amplitude == pytest.approx(20e-6, rel=1e-6)
    assert state.response_amplitude == pytest.approx(2e-6, rel=0.1)  # the oscillation leaks into an interval


def test_features_of_a_drift() -> None:
    time = seconds(1.5)
    reference = tone(1_000.0, 20e-6, time)
    state = classify(telemetry(-50e-6 - 30e-6 * time, reference)).states[-1].axis("y")
    assert state.region is Region.B
    assert state.trend == pytest.approx(-30e-6, rel=0.02)
    assert state.trend_significance > 1.0


def test_an_oscillation_must_be_slower_than_the_input() -> None:
    time = seconds(1.5)
    reference = tone(150.0, 20e-6, time)
    assert classify(telemetry(reference + tone(100.0, 10e-6, time), reference)).onsets == {}
    assert Region.C in classify(telemetry(reference + tone(45.0, 10e-6, time), reference)).onsets


@pytest.mark.parametrize("frequency", [3_320.0, 2_490.0, 1_995.0])
def test_beating_of_a_steady_tone_is_no_slow_oscillation(frequency: float) -> None:
    time = seconds(1.5)
    order = round(RATE / frequency)
    reference = tone(frequency, 20e-6, time)
    beat = tone(order * frequency - RATE, 10e-6, time)
    classification = classify(telemetry(beat, reference))
    assert classification.onsets == {}
    assert classification.states[-1].axis("y").sampling_beat
    sets_in_without_input = classify(telemetry(np.where(time > 0.7, beat, 0.0)))
    assert Region.C in sets_in_without_input.onsets


def test_a_slow_oscillation_under_a_sine_at_a_tenth_of_the_rate_is_found() -> None:
    """Its tenth harmonic folds to zero: that moves the bias, and is no slow line."""
    time = seconds(5.0)
    reference = tone(1_000.0, 20e-6, time)
    onsets = classify(telemetry(np.where(time > 1.5, tone(8.0, 10e-6, time), 0.0), reference)).onsets
    assert onsets[Region.C].time == pytest.approx(1.5, abs=0.3)


def test_slow_content_of_the_input_is_no_oscillation() -> None:
    time = seconds(2.0)
    reference = tone(40.0, 10e-6, time) + tone(3_000.0, 20e-6, time)
    assert classify(telemetry(tone(40.0, 13e-6, time - 0.002), reference)).onsets == {}


@pytest.mark.parametrize("frequency", [20.0, 22.0, 33.0])
def test_harmonics_of_a_square_are_no_slow_oscillation(frequency: float) -> None:
    time = seconds(1.5)
    reference = 20e-6 * np.sign(tone(frequency, 1.0, time + 1e-6))
    classification = classify(telemetry(tone(2.0 * frequency, 10e-6, time), reference))
    assert classification.onsets == {}
    assert classification.states[-1].axis("y").oscillation_amplitude == pytest.approx(10e-6, rel=0.1)
    another = np.where(time > 0.7, tone(1.5 * frequency, 10e-6, time), 0.0)
    assert Region.C in classify(telemetry(another, reference)).onsets


@pytest.mark.parametrize("frequency", [0.4, 1.0, 5.0])
def test_a_slow_square_is_no_drift(frequency: float) -> None:
    time = seconds(8.0)
    reference = np.where(time >= 0.5, 20e-6 * np.sign(tone(frequency, 1.0, time - 0.5 + 1e-6)), 0.0)
    b, a, _ = cont2discrete(([390.0, 390.0**2], [1.0, 390.0, 390.0**2]), 1.0 / RATE)
    classification = classify(telemetry(-60e-6 + 1.3 * lfilter(b.ravel(), a, reference), reference))
    assert classification.onsets == {}


def test_telemetry_may_begin_within_an_excitation() -> None:
    time = seconds(2.0)
    reference = 30e-6 + tone(700.0, 20e-6, time + 0.0003)
    classification = classify(telemetry(0.1 * reference - 20e-6 * np.maximum(time - 1.2, 0.0), reference))
    assert classification.onsets[Region.B].time == pytest.approx(1.2, abs=0.02)


def test_an_axis_without_input_of_its_own_answers_the_other() -> None:
    time = seconds(1.5)
    reference = tone(500.0, 20e-6, time)
    classification = classify(telemetry(0.2 * reference, reference)).states[-1]
    assert classification.axis("x").input_frequency == classification.axis("y").input_frequency


def test_a_jump_of_the_bias_is_drift() -> None:
    time = seconds(2.0)
    classification = classify(telemetry(np.where(time >= 1.2, 40e-6, 0.0), tone(1_000.0, 20e-6, time)))
    assert set(classification.onsets) == {Region.B}
    assert classification.onsets[Region.B].time == pytest.approx(1.2, abs=0.05)


def test_a_bias_that_comes_back_leaves_region_b() -> None:
    time = seconds(4.0)
    y = 20e-6 * np.clip(np.minimum(time - 1.0, 2.5 - time) / 0.5, 0.0, 1.0)
    states = classify(telemetry(y, tone(1_000.0, 20e-6, time))).states
    assert max(state.region for state in states) is Region.B
    assert states[-1].region is Region.A
    assert states[-1].since.time > 2.4


def test_frequency_of_a_sweep_is_tracked() -> None:
    sweep = generate(Sweep(amplitude=10e-6, duration=5.0, frequency_start=50.0, frequency_end=4_900.0, axes="y"), RATE)
    states = classify(telemetry(np.zeros(sweep.steps), sweep.samples[:, 1])).states
    assert sweep.frequency is not None
    for state in states[10:]:
        # told for the middle of an interval or two in the past
        assert state.axis("y").input_frequency == pytest.approx(sweep.frequency[state.step - 50], rel=0.05)


# -- on the simulated bearing


def sweep_of_bearing(amplitude: float, controller: ControllerParameters | None = None, **plant: float) -> LoopRecord:
    """The sweep that the paper states for Fig. 5, 10 Hz to 5 kHz in 20 s on y, after a second at rest."""
    sweep = Sweep(amplitude=amplitude, duration=20.0, frequency_start=10.0, frequency_end=5_000.0, axes="y")
    bearing = Plant(validate(PlantParameters, plant))
    return simulate(
        bearing, PdController(controller or ControllerParameters()), 210_000, generate(sweep, RATE).samples, 10_000
    )


def test_100_um_delevitates_by_ordinary_resonance() -> None:
    onsets = classify(sweep_of_bearing(100e-6), delevitated=True).onsets
    assert set(onsets) == {Region.D}
    assert onsets[Region.D].resonance
    assert onsets[Region.D].input_frequency == pytest.approx(39.0, abs=5.0)


def test_150_um_delevitates_before_the_sweep_is_told_to_be_one() -> None:
    record = sweep_of_bearing(150e-6)
    frequency = np.clip(10.0 + 249.5 * (record.time - 1.0), 0.0, None)
    onsets = classify(record, delevitated=True, frequency=frequency).onsets
    assert set(onsets) == {Region.D}
    assert onsets[Region.D].resonance
    assert onsets[Region.D].input_frequency == pytest.approx(21.0, abs=3.0)


def test_known_frequencies_must_fit_the_record(eventful: LoopRecord) -> None:
    with pytest.raises(RegionError, match=r"frequency has shape \(3,\); the record has 35000 samples"):
        classify(eventful, frequency=np.zeros(3))


def test_50_um_drifts_and_delevitates() -> None:
    onsets = classify(sweep_of_bearing(50e-6), delevitated=True).onsets
    assert set(onsets) == {Region.B, Region.D}
    assert 100.0 < onsets[Region.B].input_frequency < 0.6 * onsets[Region.D].input_frequency
    assert not onsets[Region.D].resonance


@pytest.mark.slow
def test_boundaries_are_ordered_and_fall_with_amplitude() -> None:
    every = [classify(sweep_of_bearing(a * 1e-6), delevitated=True).onsets for a in (10.0, 15.0, 25.0, 35.0, 50.0)]
    for onsets in every:
        in_order = [onsets[region].input_frequency for region in sorted(onsets)]
        assert in_order == sorted(in_order)
    for region in (Region.B, Region.D):
        along = [onsets[region].input_frequency for onsets in every]
        assert along == sorted(along, reverse=True)


@pytest.mark.slow
def test_without_gravity_there_is_no_drift_before_the_centre_becomes_unstable() -> None:
    onsets = classify(sweep_of_bearing(50e-6, **{"rotor.gravity": 0.0}), delevitated=True).onsets
    assert onsets[Region.B].input_frequency > 380.0


@pytest.mark.slow
def test_derivative_on_measurement_shows_beats_only() -> None:
    record = sweep_of_bearing(50e-6, ControllerParameters(derivative_on="measurement"))
    classification = classify(record)
    assert classification.onsets == {}
    beats = [state.axis("y").input_frequency for state in classification.states if state.axis("y").sampling_beat]
    assert any(abs(frequency - RATE / 3.0) < 20.0 for frequency in beats)
    assert any(abs(frequency - RATE / 2.5) < 20.0 for frequency in beats)
