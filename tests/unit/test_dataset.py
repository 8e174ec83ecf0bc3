"""Data sets: slicing, merging, trends, decimation and gaps leave the samples and their times what they are."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import dlsim, dlti

from amb_core.data.experiments import (
    Experiment,
    IdentificationData,
    advance_inputs,
    decimate,
    detrend,
    merge,
    restore,
    split_at_invalid,
)
from amb_core.ground.errors import IdentificationError
from amb_core.loop.records import LoopRecord

SAMPLE_TIME = 1e-4


def record(steps: int = 400, first_step: int = 100) -> LoopRecord:
    """Samples that tell every step and signal apart."""
    step = np.arange(first_step, first_step + steps, dtype=np.float64)
    signals = [np.column_stack([step + 0.1 * number, -step - 0.1 * number]) for number in range(3)]
    return LoopRecord(first_step, SAMPLE_TIME, *signals)


def data(steps: int = 400, first_step: int = 100) -> IdentificationData:
    return IdentificationData.from_record(record(steps, first_step), "run 1")


def spans(data: IdentificationData) -> list[tuple[int, int]]:
    return [(item.first_step, item.stop) for item in data.experiments]


def test_a_record_of_the_loop_becomes_an_experiment_and_comes_back() -> None:
    dataset = data()
    assert (dataset.input_names, dataset.input_units) == (("i_x", "i_y"), ("A", "A"))
    assert (dataset.output_names, dataset.output_units) == (("x", "y"), ("m", "m"))
    assert np.array_equal(dataset.experiments[0].inputs, record().current)
    assert dataset.record().identical_to(record())
    assert dataset.time() == pytest.approx(record().time, rel=1e-15)


@pytest.mark.parametrize("of", [np.float64, np.float32, np.int64, object])
def test_masked_and_missing_samples_are_no_measured_values(of: type) -> None:
    values = np.ma.masked_equal(np.array([[1.0], [999.0], [3.0]]).astype(of), 999.0)
    part = IdentificationData.from_arrays(values, values, SAMPLE_TIME, reference=values).experiments[0]
    for signal in (part.inputs, part.outputs, part.reference, Experiment(values, values).inputs):
        np.testing.assert_array_equal(signal, [[1.0], [np.nan], [3.0]])
    missing = IdentificationData.from_arrays([1.0, None, 3.0], values, SAMPLE_TIME).experiments[0]
    np.testing.assert_array_equal(missing.inputs, [[1.0], [np.nan], [3.0]])


@pytest.mark.parametrize(
    "values",
    [
        np.ones(3) + 1j,
        np.zeros(3, "M8[s]"),
        np.zeros(3, "m8[s]"),
        ["1", "2", "3"],
        np.array(["1", 2.0, 3.0], dtype=object),
        [[1.0, 2.0], [3.0]],
        None,
        3.0,
    ],
    ids=["complex", "dates", "durations", "texts", "texts among numbers", "ragged", "none", "a single number"],
)
def test_samples_that_are_no_real_numbers_are_refused_in_one_line(values: Any) -> None:
    good = np.ones(3)
    for make in (
        lambda: IdentificationData.from_arrays(values, good, SAMPLE_TIME),
        lambda: IdentificationData.from_arrays(good, values, SAMPLE_TIME),
        lambda: Experiment(values, np.ones((3, 1))),
    ):
        with pytest.raises(IdentificationError, match=r"^(in|out)puts.* is not allowed; allowed: .* real numbers$"):
            make()


def test_names_and_units_are_texts_of_any_sequence() -> None:
    of = functools.partial(IdentificationData.from_arrays, np.ones((3, 2)), [1, 2, 3], SAMPLE_TIME)
    for names in (["a", "b"], ("a", "b"), np.array(["a", "b"]), iter(["a", "b"]), {"a": 1, "b": 2}.keys()):
        assert of(input_names=names).input_names == ("a", "b")
    single = of(output_names="y", output_units="m")
    assert (single.output_names, single.output_units) == (("y",), ("m",))
    assert single.select(inputs="u2").input_names == ("u2",)


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        (lambda of: of(input_names=[1, 2]), "input_names = [1, 2] is not allowed; allowed: a text for each"),
        (lambda of: of(input_units=[None, None]), "input_units = [None, None] is not allowed; allowed: a text"),
        (lambda of: of(input_names=3), "input_names = 3 is not allowed"),
        (lambda of: of(sample_time=None), "sample_time = None is not allowed; allowed: a number"),
        (lambda of: of(sample_time="0.1"), "sample_time = '0.1' is not allowed; allowed: a number"),
        (lambda of: of(sample_time=np.ones(2)), "sample_time = array([1., 1.]) is not allowed; allowed: a number"),
        (lambda of: of(first_step=1.5), "first_step = 1.5 is not allowed; allowed: a whole number"),
        (lambda of: of().split("a"), "share = 'a' is not allowed; allowed: a number"),
        (lambda of: of().between("0", 1.0), "start = '0' is not allowed; allowed: a number"),
        (lambda of: of().window(0.5, 2), "first_step = 0.5 is not allowed; allowed: a whole number"),
        (lambda of: of().subset([5]), "there is no experiment 5; allowed: 0 to 0"),
        (lambda of: of().time(3), "there is no experiment 3; allowed: 0 to 0"),
        (lambda of: of().record("a"), "the index of an experiment = 'a' is not allowed; allowed: a whole number"),
    ],
)
def test_values_of_another_type_are_refused_in_one_line(call: Callable[..., object], problem: str) -> None:
    def of(sample_time: Any = SAMPLE_TIME, **options: Any) -> IdentificationData:
        return IdentificationData.from_arrays(np.ones((3, 2)), np.ones((3, 2)), sample_time, **options)

    with pytest.raises(IdentificationError, match=f"^{re.escape(problem)}"):
        call(of)


def test_slices_by_step_and_by_time_are_the_same() -> None:
    window = data().window(150, 250)
    assert spans(window) == [(150, 250)]
    assert window.record().identical_to(record().window(150, 100))
    assert window.between(0.015, 0.025).record().identical_to(window.record())
    assert spans(data().between(150.4 * SAMPLE_TIME, 1.0)) == [(151, 500)]


def test_slices_cover_all_experiments_and_leave_out_those_without_samples() -> None:
    parts = merge([data(100, 0), data(100, 200), data(100, 400)])
    assert spans(parts.window(50, 250)) == [(50, 100), (200, 250)]
    assert spans(parts.subset([2, 0])) == [(400, 500), (0, 100)]
    with pytest.raises(IdentificationError, match="no samples from step 100 to 199; the experiments have 0 to 99, 200"):
        parts.window(100, 200)


@given(share=st.floats(0.01, 0.99))
def test_the_parts_of_a_split_make_up_the_whole(share: float) -> None:
    whole = merge([data(70, 0), data(130, 200)])
    first, second = whole.split(share)
    assert first.samples == round(share * 200)
    joined = [np.vstack([item.inputs for part in (first, second) for item in part.experiments])]
    assert np.array_equal(joined[0], np.vstack([item.inputs for item in whole.experiments]))


@pytest.mark.parametrize("share", [1.0, float("nan")])
def test_a_split_without_samples_is_refused(share: float) -> None:
    with pytest.raises(IdentificationError, match="leaves a part without samples"):
        data().split(share)


def test_signals_are_chosen_by_name() -> None:
    chosen = detrend(data()).select(inputs=["i_y"], outputs=["y", "x"])
    assert (chosen.input_names, chosen.output_names) == (("i_y",), ("y", "x"))
    assert np.array_equal(restore(chosen).experiments[0].outputs, record().position[:, ::-1])
    with pytest.raises(IdentificationError, match="there is no input 'i_z'; there are i_x, i_y"):
        data().select(inputs=["i_z"])


def test_gaps_lie_between_experiments_of_one_run() -> None:
    parts = merge([data(100, 0), data(100, 150), IdentificationData.from_record(record(50, 400), "run 2")])
    (gap,) = parts.gaps
    assert (gap.source, gap.first_step, gap.stop, gap.steps) == ("run 1", 100, 150, 50)


def other(**changes: object) -> IdentificationData:
    values: dict[str, object] = {
        "experiments": data().experiments,
        "sample_time": SAMPLE_TIME,
        "input_names": ("i_x", "i_y"),
        "output_units": ("m", "m"),
    }
    return IdentificationData(**(values | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sample_time": 2e-4}, "data set 2 has the sample time 0.0002 s, the first 0.0001 s"),
        ({"input_names": ("a", "b")}, "data set 2 has the input names a, b, the first i_x, i_y"),
        ({"output_units": ("um", "um")}, "data set 2 has the output units um, um, the first m, m"),
    ],
)
def test_data_that_do_not_belong_together_are_not_merged(changes: dict[str, object], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        merge([data(), other(**changes)])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: other(sample_time=0.0), "'sample_time' = 0.0 s is not allowed"),
        (lambda: other(sample_time=np.nan), "'sample_time' = nan s is not allowed"),
        (lambda: other(input_names=("x", "i_y")), "must all be different"),
        (lambda: other(input_names=("i",), input_units=("A",)), "experiment 0 has 2 inputs; 1 are named"),
        (lambda: other(output_units=("m",)), "2 outputs need as many units, not 1"),
        (lambda: other(experiments=()), "at least one experiment"),
        (lambda: merge([]), "no data to merge"),
        (lambda: Experiment(np.zeros((3, 2)), np.zeros((4, 2))), r"inputs \(3, 2\) and outputs \(4, 2\)"),
        (lambda: Experiment(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((3, 1))), r"reference \(3, 1\)"),
        (lambda: Experiment(np.zeros((0, 2)), np.zeros((0, 2))), "at least one sample"),
        (lambda: Experiment(np.zeros((3, 1)), np.zeros((3, 1)), input_trend=np.zeros((2, 2))), "input_trend has shape"),
        (lambda: data().between(0.0, np.inf), "must be finite"),
    ],
)
def test_parts_that_do_not_fit_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        make()


def test_data_without_reference_or_other_signals_are_no_record_of_the_loop() -> None:
    with pytest.raises(IdentificationError, match="lack"):
        IdentificationData.from_arrays(np.zeros((5, 2)), np.zeros((5, 2)), 1e-4).record()
    with pytest.raises(
        IdentificationError, match=r"as many inputs in A as outputs in m; these data have u1 and y1 \[um\]"
    ):
        signal = np.zeros(5)
        IdentificationData.from_arrays(signal, signal, 1e-4, reference=signal, output_units=["um"]).record()


# -- trends


@pytest.mark.parametrize("common", [False, True])
@pytest.mark.parametrize("kind", ["mean", "linear"])
def test_detrending_can_be_undone(kind: str, common: bool) -> None:
    parts = merge([data(100, 0), data(100, 150)])
    twice = detrend(detrend(parts, "mean"), kind, common=common)  # type: ignore[arg-type]
    for before, after in zip(parts.experiments, restore(twice).experiments, strict=True):
        np.testing.assert_allclose(after.signals, before.signals, atol=1e-9)


def test_each_experiment_has_its_own_mean_unless_it_is_common() -> None:
    parts = merge([data(100, 0), data(100, 150)])
    own, common = detrend(parts), detrend(parts, common=True)
    assert [item.inputs[:, 0].mean() for item in own.experiments] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert [item.inputs[:, 0].mean() for item in common.experiments] == pytest.approx([-75.0, 75.0])
    whole = np.vstack([item.inputs for item in parts.experiments]).mean(axis=0)
    assert own.input_offset == pytest.approx(whole)
    assert common.input_offset == pytest.approx(whole)


def test_a_line_is_removed_with_slope_per_second_and_slicing_keeps_it() -> None:
    flat = detrend(data(), "linear")
    assert np.abs(flat.experiments[0].signals).max() < 1e-9
    assert flat.experiments[0].output_trend[1] == pytest.approx([1.0 / SAMPLE_TIME, -1.0 / SAMPLE_TIME])
    part = flat.window(200, 210)
    assert part.output_offset == pytest.approx(record().window(200, 10).position.mean(axis=0))
    np.testing.assert_allclose(restore(part).record().position, record().window(200, 10).position)


def test_other_trends_and_invalid_samples_are_refused() -> None:
    with pytest.raises(IdentificationError, match="detrending by 'cubic' is not allowed; allowed: mean, linear"):
        detrend(data(), "cubic")  # type: ignore[arg-type]
    for function in (detrend, lambda invalid: decimate(invalid, 2)):
        with pytest.raises(IdentificationError, match="split_at_invalid"):
            function(with_invalid(10))


# -- decimation


def tone(frequency: float, steps: int = 5_000, first_step: int = 3) -> IdentificationData:
    time = np.arange(first_step, first_step + steps) * SAMPLE_TIME
    signal = np.sin(2.0 * np.pi * frequency * time)
    return IdentificationData.from_arrays(signal, 2.0 * signal, SAMPLE_TIME, reference=signal, first_step=first_step)


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_decimation_passes_slow_signals_without_phase_and_keeps_their_times(factor: int) -> None:
    nyquist = 0.5 / SAMPLE_TIME / factor
    slow = decimate(tone(0.7 * nyquist), factor)
    assert slow.sample_time == pytest.approx(factor * SAMPLE_TIME)
    expected = np.sin(2.0 * np.pi * 0.7 * nyquist * slow.time())
    np.testing.assert_allclose(slow.experiments[0].inputs[:, 0], expected, atol=2e-4)
    np.testing.assert_allclose(slow.experiments[0].outputs[:, 0], 2.0 * expected, atol=4e-4)


@pytest.mark.parametrize("factor", [2, 5, 10])
def test_decimation_lets_nothing_fold_back(factor: int) -> None:
    nyquist = 0.5 / SAMPLE_TIME / factor
    assert np.abs(decimate(tone(1.05 * nyquist), factor).experiments[0].inputs).max() < 2e-4


def test_decimation_leaves_trends_alone() -> None:
    decimated = decimate(detrend(data(4_000), "linear"), 5)
    original = record(4_000)
    rows = np.searchsorted(original.time, decimated.time() - 1e-9)
    np.testing.assert_allclose(restore(decimated).record().position, original.position[rows], rtol=1e-9)


@pytest.mark.parametrize("factor", [0, 1, 2.5, 1_001])
def test_factors_that_are_not_allowed_are_named(factor: float) -> None:
    with pytest.raises(IdentificationError, match=f"factor {factor} is not allowed; allowed: integers from 2 to 1000"):
        decimate(data(), factor)  # type: ignore[arg-type]


def test_an_experiment_too_short_for_the_filter_is_named() -> None:
    with pytest.raises(IdentificationError, match="experiment 0 has 400 samples; decimation by 10 needs 5"):
        decimate(data(), 10)


# -- invalid samples, dead time


def with_invalid(*rows: int) -> IdentificationData:
    signals = record().position.copy()
    signals[list(rows), 0] = np.nan
    return IdentificationData.from_record(LoopRecord(100, SAMPLE_TIME, record().reference, signals, record().current))


def test_invalid_samples_split_an_experiment() -> None:
    parts = split_at_invalid(with_invalid(0, 50, 51, 60, 399))
    assert spans(parts) == [(101, 150), (152, 160), (161, 499)]
    assert [gap.steps for gap in parts.gaps] == [2, 1]
    assert spans(split_at_invalid(with_invalid(50, 60), shortest=10)) == [(100, 150), (161, 500)]
    with pytest.raises(IdentificationError, match="no stretch of 1000 finite samples is left"):
        split_at_invalid(data(), shortest=1_000)


def test_advanced_inputs_take_dead_time_out() -> None:
    u = np.random.default_rng(0).normal(size=(300, 2))
    y = np.column_stack([np.roll(u[:, 0], 3), np.roll(u[:, 1], -1)])
    moved = advance_inputs(IdentificationData.from_arrays(u, y, SAMPLE_TIME), [3, -1])
    assert spans(moved) == [(3, 299)]
    np.testing.assert_array_equal(moved.experiments[0].inputs, moved.experiments[0].outputs)


def test_advanced_inputs_keep_their_trend() -> None:
    moved = advance_inputs(detrend(data(), "linear"), [3, 0])
    np.testing.assert_allclose(restore(moved).experiments[0].inputs[:, 0], record().current[:-3, 0])


def test_dead_times_that_do_not_fit_are_refused() -> None:
    with pytest.raises(IdentificationError, match="2 inputs need as many numbers of steps, not 1"):
        advance_inputs(data(), [1])
    with pytest.raises(IdentificationError, match="experiment 0 has 400 samples; more than 400"):
        advance_inputs(data(), [400, 0])


def test_a_linear_relation_survives_decimation() -> None:
    """The same filter runs over inputs and outputs, so the model that made the data still fits where it is slow."""
    rng = np.random.default_rng(1)
    slow = np.repeat(rng.normal(size=500), 40)
    system = dlti([0.02], [1.0, -0.98], dt=SAMPLE_TIME)
    _, y = dlsim(system, slow)
    decimated = decimate(IdentificationData.from_arrays(slow, y, SAMPLE_TIME), 4).experiments[0]
    rows = np.arange(1, decimated.steps)
    coefficients, *_ = np.linalg.lstsq(
        np.column_stack([decimated.outputs[rows - 1], decimated.inputs[rows - 1], decimated.inputs[rows]]),
        decimated.outputs[rows],
        rcond=None,
    )
    assert coefficients[0, 0] == pytest.approx(0.98**4, abs=2e-3)
