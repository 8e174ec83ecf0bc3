"""Checks of data: each finds what it is for, says where and what to do, and stays silent on good data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from amb_core.data.experiments import DataReport, Finding, IdentificationData, Severity, check_data, detrend, merge
from amb_core.data.experiments.checks import (
    check_amount,
    check_clipping,
    check_delay,
    check_excitation,
    check_feedback,
    check_finite,
    check_gaps,
    check_inputs,
    check_offsets,
    check_region,
    check_sample_time,
)
from amb_core.ground.errors import IdentificationError
from amb_core.loop.records import LoopRecord

SAMPLE_TIME = 1e-3
INFO, WARNING, ERROR = Severity


def response(u: np.ndarray, delay: int = 1) -> np.ndarray:
    """Two outputs of a damped plant with coupling, with some noise."""
    noise = np.random.default_rng(1).normal(scale=0.05, size=u.shape)
    late = np.vstack([np.zeros((delay, 2)), u[: len(u) - delay]])
    return lfilter([1.0, 0.4], [1.0, -1.4, 0.7], late @ [[1.0, 0.3], [0.0, 1.0]], axis=0) + noise


def white(steps: int = 3_000) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(steps, 2))


def open_loop(u: np.ndarray | None = None, delay: int = 1, **options: object) -> IdentificationData:
    u = white() if u is None else u
    return IdentificationData.from_arrays(u, response(u, delay), SAMPLE_TIME, **options)  # type: ignore[arg-type]


def closed_loop(steps: int = 3_000, gain: float = 0.3) -> IdentificationData:
    """An integrator under a proportional controller that answers within the sample, excited by squares."""
    rng = np.random.default_rng(2)
    reference = np.sign(np.sin(0.02 * np.arange(steps)))[:, None] * [1.0, 1.0]
    reference[:, 1] = np.sign(np.sin(0.031 * np.arange(steps)))
    state, u, y = np.zeros(2), np.empty((steps, 2)), np.empty((steps, 2))
    for step in range(steps):
        y[step] = state + rng.normal(scale=0.02, size=2)
        u[step] = gain * (reference[step] - y[step])
        state = state + u[step] + rng.normal(scale=0.02, size=2)
    return IdentificationData.from_arrays(u, y, SAMPLE_TIME, reference=reference)


def assert_finding(finding: Finding, severity: Severity, *parts: str) -> None:
    assert finding.severity is severity, finding
    for part in parts:
        assert part in str(finding)


def changed(
    data: IdentificationData, inputs: np.ndarray | None = None, outputs: np.ndarray | None = None
) -> IdentificationData:
    item = data.experiments[0]
    return IdentificationData.from_arrays(
        item.inputs if inputs is None else inputs, item.outputs if outputs is None else outputs, SAMPLE_TIME
    )


def test_good_data_raise_no_warning_and_every_check_reports() -> None:
    report = check_data(open_loop(), order=4)
    assert not report.errors
    assert not report.warnings
    assert [finding.check for finding in report.findings] == [
        "finite", "gaps", "sample time", "roles", "amount", "inputs", "excitation", "clipping", "quantised", "frozen",
        "repeated", "outliers", "missing", "offsets", "drift", "feedback", "delay", "region", "distortion",
    ]  # fmt: skip
    report.refuse_errors()
    assert len(str(report).splitlines()) == 20
    assert str(report).startswith(
        "1 experiment, 3000 samples of 0.001 s; inputs u1, u2; outputs y1, y2\ninfo    finite"
    )


def test_errors_refuse_in_one_line_with_advice() -> None:
    u = white()
    u[:, 1] = 2.0
    report = check_data(open_loop(u))
    with pytest.raises(
        IdentificationError, match="inputs: u2: constant; excite every input, or leave it out"
    ) as refusal:
        report.refuse_errors()
    assert "\n" not in str(refusal.value)


def test_an_order_below_one_is_refused() -> None:
    with pytest.raises(IdentificationError, match="order 0 is not allowed; it must be 1 or more"):
        check_data(open_loop(), order=0)


# -- samples


def test_values_that_are_not_finite_are_found_and_the_rest_is_judged() -> None:
    y = open_loop().experiments[0].outputs.copy()
    y[1_000, 1] = np.nan
    y[2_000, 0] = np.inf
    data = changed(open_loop(), outputs=y)
    assert_finding(check_finite(data), ERROR, "2 of 3000 samples", "y2, first at step 1000 of exp", "split_at_invalid")
    report = check_data(data, order=4)
    assert [finding.check for finding in report.errors] == ["finite"]
    assert report.finding("inputs").severity is INFO
    nothing_left = check_data(changed(open_loop(), outputs=np.full_like(y, np.nan)))
    assert [finding.check for finding in nothing_left.findings] == ["finite", "gaps", "sample time", "roles"]


def test_gaps_are_listed_and_short_ones_counted() -> None:
    data = open_loop()
    parts = merge([data.window(0, 1_000), data.window(1_010, 2_000), data.window(2_500, 3_000)])
    what = "2 gaps of 510 samples in all, 1 of them shorter than 100"
    assert_finding(check_gaps(parts), WARNING, "steps 1000 to 1009, steps 2000 to 2499", what)
    assert_finding(check_gaps(data), INFO)


def test_another_sample_time_than_the_controllers_is_refused() -> None:
    assert_finding(check_sample_time(open_loop(), 1e-3), INFO)
    assert_finding(check_sample_time(open_loop(), 5e-3), ERROR, "0.001 s, but 0.005 s is expected", "decimate by 5")
    assert_finding(check_sample_time(open_loop(), 1e-4), ERROR, "take data at the rate of the controller")


def test_outputs_that_are_held_are_noticed() -> None:
    y = open_loop().experiments[0].outputs
    held = changed(open_loop(), outputs=np.repeat(y[::4], 4, axis=0))
    assert_finding(
        check_sample_time(held), WARNING, "75 % of the samples repeat", "held for 4 samples", "keep every 4."
    )
    squares = changed(open_loop(), inputs=np.repeat(white()[::4], 4, axis=0))
    assert_finding(check_sample_time(squares), INFO)


@pytest.mark.parametrize("level", [1.0, 2.5])
def test_flat_tops_are_found_on_either_side(level: float) -> None:
    data = open_loop()
    u, y = data.experiments[0].inputs, lfilter([0.1], [1.0, -0.9], 5.0 * white(), axis=0)
    cut = check_clipping(changed(data, outputs=np.minimum(y, level)))
    assert_finding(cut, WARNING, "y1", "y2", "at a flat top", "reduce the excitation, or leave them out")
    cut = check_clipping(changed(data, inputs=np.maximum(lfilter([0.1], [1.0, -0.9], 5.0 * u, axis=0), -level)))
    assert_finding(cut, WARNING, "u1", "recorded behind the limit are still the true ones")


def test_a_known_limit_is_judged_with_its_offset() -> None:
    data = detrend(changed(open_loop(), inputs=np.clip(white() + 1.0, -3.0, 3.0)))
    share = 100.0 * np.mean(white()[:, 0] + 1.0 >= 3.0)
    assert_finding(
        check_clipping(data, {"u1": 3.0, "u2": 9.0}), WARNING, f"clipped samples: u1 {share:.2g} % at the limit"
    )


@given(resolution=st.floats(1e-3, 0.3), frequency=st.floats(0.001, 0.2))
@settings(max_examples=20, deadline=None)
def test_quantised_signals_and_signals_of_levels_are_not_called_clipped(resolution: float, frequency: float) -> None:
    sine = np.sin(2.0 * np.pi * frequency * np.arange(2_000))[:, None] * [1.0, 0.7]
    rounded = resolution * np.round(sine / resolution)
    assert check_clipping(IdentificationData.from_arrays(np.sign(sine), rounded, SAMPLE_TIME)).severity is INFO


def test_drift_and_different_operating_points_are_found() -> None:
    data = open_loop()
    ramp = np.linspace(0.0, 30.0, data.samples)
    drifting = changed(data, outputs=data.experiments[0].outputs + np.outer(ramp, [1.0, 0.0]))
    assert_finding(check_offsets(drifting), WARNING, "offsets", "y1: a straight line", "detrend(data, 'linear')")
    assert_finding(check_offsets(detrend(drifting, "linear")), INFO)
    other = changed(data, inputs=white() + 50.0)
    assert_finding(check_offsets(merge([data, other])), WARNING, "u1, u2", "different operating points")
    assert_finding(check_offsets(detrend(merge([data, other]))), INFO, "operating point u1 24.99")


# -- excitation


def test_too_few_samples_for_the_order_are_refused_and_few_are_warned_of() -> None:
    data = open_loop()
    assert_finding(check_amount(data.window(0, 100), 10), ERROR, "100 samples are too few for order 10; at least 134")
    assert_finding(check_amount(data.window(0, 134), 10), WARNING, "134 samples of 2 outputs for 60 parameters", "300")
    assert_finding(check_amount(data.window(0, 300), 10), INFO)
    assert_finding(check_amount(data.window(0, 100), 4), WARNING)
    short = merge([data, data.window(0, 20), data.window(50, 60)])
    assert_finding(
        check_amount(short, 10), WARNING, "2 of 3 experiments have fewer than 27 samples", "experiment 1 ..."
    )


def test_constant_and_collinear_inputs_are_refused() -> None:
    u = white()
    still, same, alike = u.copy(), u.copy(), u.copy()
    still[:, 0] = 3.0
    same[:, 1] = 2.0 * u[:, 0] + 5.0
    alike[:, 1] = u[:, 0] + 0.02 * u[:, 1]
    assert_finding(check_inputs(open_loop(still)), ERROR, "u1: constant")
    assert_finding(check_inputs(open_loop(same)), ERROR, "u1, u2: one is a sum", "one after another")
    assert_finding(check_inputs(open_loop(alike)), WARNING, "u1, u2: nearly", "but for 1 %")
    assert_finding(check_inputs(open_loop(u)), INFO)


def test_of_a_constant_input_only_that_is_said_not_how_little_it_excites() -> None:
    still = open_loop(np.column_stack([white()[:, 0], np.full(3_000, 2.0)]))
    assert_finding(check_excitation(still, 10), INFO, "not checked: constant inputs u2")
    assert [finding.check for finding in check_data(still).errors] == ["inputs"]


def test_no_order_is_advised_where_the_inputs_excite_none() -> None:
    u = white()[:, :1]
    copies = check_excitation(open_loop(np.hstack([u, u])), 2)
    assert copies.severity is ERROR and copies.advice == "excite a wider band (squares, PRBS, multisine)"


def test_what_a_command_can_do_is_advised_as_its_option() -> None:
    """What only Python can is named as such."""
    invalid = open_loop(np.where(np.arange(3_000)[:, None] == 7, np.nan, white()))
    assert_finding(check_finite(invalid), ERROR, "--repair split (in Python: split_at_invalid)")
    still = open_loop(np.column_stack([white()[:, 0], np.full(3_000, 2.0)]))
    assert_finding(check_inputs(still), ERROR, "leave it out of --inputs (in Python: select)")
    assert_finding(check_delay(open_loop(delay=0), feedback=False), WARNING, "identify with --feedthrough (in Python")


def test_an_axis_whose_reference_does_not_move_is_warned_of() -> None:
    assert_finding(check_inputs(closed_loop()), INFO)
    one_axis = IdentificationData.from_record(loop_record(steps=2_000))
    assert_finding(check_inputs(one_axis), WARNING, "y: the reference does not move", "excite every axis")
    assert_finding(check_inputs(detrend(one_axis)), WARNING, "y: the reference does not move")


def test_a_limit_of_no_signal_is_refused() -> None:
    with pytest.raises(IdentificationError, match="no signal 'i_z' to have a limit; there are u1, u2, y1, y2"):
        check_data(open_loop(), limits={"i_z": 3.0})


def tones(frequencies: list[float]) -> IdentificationData:
    time = 2.0 * np.pi * np.arange(3_000)
    u = np.column_stack([sum(np.sin(f * time + shift * k) for k, f in enumerate(frequencies)) for shift in (1.0, 2.0)])
    return open_loop(np.asarray(u))


def test_the_order_of_persistent_excitation_counts_two_for_each_tone() -> None:
    """Two inputs of the same k tones, without offset, are persistently exciting of order k."""
    assert_finding(check_excitation(tones([0.1, 0.23, 0.31]), 4), ERROR, "of order 3 only; order 4 needs 4 to 8")
    six = check_excitation(tones([0.05, 0.1, 0.17, 0.23, 0.31, 0.4]), 4)
    assert_finding(six, WARNING, "of order 6 only; order 4 needs 4 to 8", "or ask for order 3")
    assert_finding(check_excitation(open_loop(), 10), INFO, "of order 20 or more")
    assert_finding(check_excitation(open_loop(white(30)), 10), INFO, "too few samples")


# -- dynamics


def test_feedback_is_seen_in_closed_loop_and_not_in_open_loop() -> None:
    assert_finding(
        check_feedback(closed_loop()), INFO, "y1 to u1, y2 to u2: inputs respond to the outputs", "use ssarx or pem"
    )
    assert check_feedback(open_loop()).where == ""
    slow = np.repeat(white(100), 30, axis=0)
    assert check_feedback(open_loop(slow)).where == ""
    assert_finding(check_feedback(open_loop(white(30))), INFO, "not checked: too few samples")


def test_false_alarms_of_feedback_are_as_rare_as_stated() -> None:
    """Level 1 %: of 100 records in open loop up to 5 alarms are expected in all but 1 of 2000 such trials."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(100):
        u = lfilter([1.0], [1.0, -0.8], rng.normal(size=(400, 1)), axis=0)
        y = lfilter([0.0, 1.0], [1.0, -1.4, 0.7], u, axis=0) + lfilter([1.0], [1.0, -0.5], rng.normal(size=(400, 1)))
        alarms += bool(check_feedback(IdentificationData.from_arrays(u, y, SAMPLE_TIME)).where)
    assert alarms <= 5


@pytest.mark.parametrize("delay", [1, 2])
def test_the_delay_is_found_in_open_loop(delay: int) -> None:
    finding = check_delay(open_loop(delay=delay), feedback=False)
    assert_finding(finding, INFO, f"u1 to y1 {delay}, y2 {delay}; u2 to y1 none, y2 {delay}")


def test_dead_time_and_direct_feedthrough_say_how_to_move_the_inputs() -> None:
    assert_finding(check_delay(open_loop(delay=5), feedback=False), WARNING, "advance_inputs(data, [4, 4])")
    assert_finding(check_delay(open_loop(delay=0), feedback=False), WARNING, "D = 0", "advance_inputs(data, [-1, -1])")


def test_an_answer_that_noise_hides_is_not_taken_for_dead_time() -> None:
    u = np.cumsum(np.cumsum(white(), axis=0), axis=0)
    y = response(u) / response(u).std() + np.random.default_rng(4).normal(size=u.shape)
    assert check_delay(changed(open_loop(), inputs=u, outputs=y), feedback=False).severity is INFO or "no output" in (
        check_delay(changed(open_loop(), inputs=u, outputs=y), feedback=False).what
    )


def test_with_feedback_a_controller_that_answers_within_the_sample_is_no_feedthrough() -> None:
    data = closed_loop()
    assert_finding(check_delay(data, feedback=True), INFO, "u1 to y1 1, y2 none; u2 to y1 none, y2 1")
    assert check_data(data, 2).finding("delay").severity is INFO


def test_an_input_without_effect_is_named() -> None:
    u = white()
    u[:, 0] = 0.0
    silent = changed(open_loop(), outputs=response(u))
    assert_finding(check_delay(silent, feedback=False), WARNING, "u1: no output responds to it within 20 samples")


# -- region


def loop_record(drift: float = 0.0, amplitude: float = 10e-6, steps: int = 15_000) -> LoopRecord:
    """A linear answer to a sine of 100 Hz at 10 kHz, whose bias drifts from the middle on (m/s)."""
    time = np.arange(steps) * 1e-4
    reference = np.column_stack([amplitude * np.sin(2.0 * np.pi * 100.0 * time), np.zeros(steps)])
    position = 0.4 * np.vstack([np.zeros((5, 2)), reference[:-5]])
    position[:, 0] += drift * np.maximum(time - 1.0, 0.0)
    position += np.random.default_rng(5).normal(scale=1e-8, size=position.shape)
    return LoopRecord(0, 1e-4, reference, position, reference - position)


@pytest.mark.slow
def test_a_region_other_than_a_is_warned_of_with_the_steps_to_keep() -> None:
    assert_finding(check_region(of_known_clearance(loop_record())), INFO, "region A throughout")
    drifting = check_region(of_known_clearance(loop_record(drift=30e-6)))
    assert_finding(drifting, WARNING, "region B (the bias drifts) from step", "at 100 Hz", "keep the steps before")
    touching = of_known_clearance(loop_record(amplitude=700e-6, steps=6_000))
    assert_finding(check_region(detrend(touching)), WARNING, "region D (delevitated)")
    micrometres = replace(loop_record(), position=1e6 * loop_record().position)
    advice = check_region(of_known_clearance(micrometres)).advice
    assert advice == (
        "no linear model holds outside region A, but no step is in it: check the units, and that positions count from "
        "the centre of the bearing, or excite less"
    )


def of_known_clearance(record: LoopRecord) -> IdentificationData:
    return replace(IdentificationData.from_record(record), clearance=dict.fromkeys(record.axes, 250e-6))


def test_without_a_clearance_delevitation_is_not_judged() -> None:
    far = replace(loop_record(), position=loop_record().position + 300e-6)
    finding = check_region(IdentificationData.from_record(far))
    assert_finding(finding, INFO, "no B or C found; D not judged: the clearance is not known")


def test_where_the_loop_follows_its_input_the_check_does_not_say_region_a() -> None:
    record = loop_record()
    followed = replace(record, position=record.position + 0.55 * record.reference)
    finding = check_region(of_known_clearance(followed))
    assert_finding(finding, INFO, "no C or D found; B not judged in", "(x): the response is at 0.7 of the input")


def test_what_cannot_be_judged_says_why() -> None:
    assert_finding(check_region(open_loop()), INFO, "not checked: a record of the loop needs the reference")
    short = IdentificationData.from_record(loop_record(steps=2_000))
    assert_finding(check_region(short), INFO, "not checked: the record is too short for B and C")
    long = of_known_clearance(loop_record())
    both = check_region(replace(long, experiments=(*short.experiments, *long.experiments)))
    assert_finding(both, INFO, "region A throughout, but too short for B and C: experiments 0")


# -- any data


@given(
    steps=st.integers(1, 300),
    kinds=st.lists(
        st.sampled_from(["white", "constant", "zero", "huge", "tiny", "nan", "copy"]), min_size=4, max_size=4
    ),
    order=st.integers(1, 12),
    seed=st.integers(0, 10),
)
@settings(max_examples=15, deadline=None)
def test_no_data_make_the_checks_fail(steps: int, kinds: list[str], order: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = rng.normal(size=steps)
    makers = {
        "white": lambda: rng.normal(size=steps),
        "constant": lambda: np.full(steps, 7.0),
        "zero": lambda: np.zeros(steps),
        "huge": lambda: 1e200 * rng.normal(size=steps),
        "tiny": lambda: 1e-200 * rng.normal(size=steps),
        "nan": lambda: np.where(rng.random(steps) < 0.05, np.nan, first),
        "copy": lambda: first,
    }
    signals = np.column_stack([makers[kind]() for kind in kinds])
    report = check_data(IdentificationData.from_arrays(signals[:, :2], signals[:, 2:], SAMPLE_TIME), order)
    assert isinstance(report, DataReport)
    assert all(np.isfinite(finding.severity) and finding.what for finding in report.findings)
