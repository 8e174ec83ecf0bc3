"""The analysis of the subharmonic test on synthetic records: products, lines, and whether a state is steady."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from amb_core.ground.errors import ParameterError, SpectrumError
from amb_core.ground.parameters import validate
from amb_core.loop.records import LoopRecord
from amb_core.regions.subharmonics import SubharmonicSettings, SurfaceSettings, analyse
from amb_core.regions.subharmonics.products import products_by_bin
from amb_core.regions.subharmonics.summary import spectrum_summary

RATE = 10_000.0
UM = 1e-6
PAPER = SubharmonicSettings()
SHIFTED = PAPER.shifted()


def record(y: np.ndarray, first_step: int = 0) -> LoopRecord:
    position = np.stack([np.zeros_like(y), y], axis=1)
    return LoopRecord(first_step, 1.0 / RATE, np.zeros_like(position), position, np.zeros_like(position))


def time(seconds: float) -> np.ndarray:
    return np.arange(round(seconds * RATE)) / RATE


def sine(t: np.ndarray, frequency: float, amplitude: float, phase: float = 0.0) -> np.ndarray:
    return amplitude * np.cos(2.0 * np.pi * frequency * t + phase)


@given(
    st.tuples(*[st.integers(1, 4999)] * 3),
    st.integers(2, 6),
)
def test_every_product_lies_on_the_bin_that_its_folded_frequency_gives(
    periods: tuple[int, int, int], order: int
) -> None:
    by_bin = products_by_bin(periods, 10_000, order)
    assert all(
        p.a * periods[0] + p.b * periods[1] + p.c * periods[2] - p.folds * 10_000 == place and 0 <= place <= 5_000
        for place, products in by_bin.items()
        for p in products
    )
    count = sum(len(products) for products in by_bin.values())
    points = (
        (2 * order + 1) * (2 * order**2 + 2 * order + 3) // 3
    )  # integer points with abs(a) + abs(b) + abs(c) <= order
    assert count == (points - 1) // 2


def test_products_of_the_papers_tones_coincide_and_the_shift_parts_them() -> None:
    commensurate = products_by_bin((200, 300, 3000), 10_000, 12)
    labels = [product.label for product in commensurate[100]]
    assert labels[:3] == ["f2 - f1", "2f1 - f2", "fs - 3f2 - 3f3"]
    shifted = products_by_bin((201, 299, 3007), 10_000, 9)
    assert all(len(products) == 1 for products in shifted.values())
    assert 0 not in shifted


def test_an_absent_inducing_tone_has_no_products() -> None:
    assert all(
        product.c == 0 for products in products_by_bin((200, 300, 0), 10_000, 6).values() for product in products
    )


@pytest.mark.parametrize("settings", [PAPER, SHIFTED], ids=["commensurate", "shifted"])
def test_planted_lines_are_found_exactly(settings: SubharmonicSettings) -> None:
    f1, f2, f3 = settings.frequencies
    planted = {(1, 0, 0): 3.4 * UM, (-1, 1, 0): 0.6 * UM, (0, 0, -3): 0.25 * UM}
    t = time(4.0)
    y = np.full_like(t, -70 * UM)
    for (a, b, c), amplitude in planted.items():
        y += sine(t, a * f1 + b * f2 + c * f3, amplitude, 0.3)
    spectrum = analyse(record(y), settings, 0)
    assert spectrum.state == "steady"
    assert spectrum.bias == pytest.approx(-70 * UM, abs=1e-15)
    for multiples, amplitude in planted.items():
        line = spectrum.line(*multiples)
        assert line is not None
        assert abs(line.amplitude) == pytest.approx(amplitude, rel=1e-9)
    assert spectrum.off_lines < 1e-15
    assert spectrum.slow is not None
    assert spectrum.slow.amplitude < 1e-15


def test_a_slow_folded_product_is_told_from_a_slow_motion_of_the_loops_own() -> None:
    t = time(3.0)
    folded = analyse(record(sine(t, 70.0, 2 * UM)), SHIFTED, 0).slow
    assert folded is not None
    assert folded.forced
    assert folded.product is not None
    assert folded.product.label == "10f3 - 3fs"
    assert folded.product.folds == 3

    # The paper's tones are multiples of 100 Hz, so no product lies at 40 Hz: a subharmonic of the loop's own making.
    subharmonic = analyse(record(sine(t, 40.0, 2 * UM)), PAPER, 0)
    assert subharmonic.slow is not None
    assert not subharmonic.slow.forced
    assert subharmonic.own == pytest.approx(2 * UM / np.sqrt(2.0), rel=1e-9)

    spectrum = analyse(record(sine(t, 7.0 / 3.0, 0.1 * UM)), PAPER, 0)
    assert spectrum.state == "steady"  # its lines and bias are; the motion beside them is told as such
    assert spectrum.slow is not None
    assert not spectrum.slow.forced
    assert spectrum.slow.product is None
    assert spectrum.slow.frequency == pytest.approx(7.0 / 3.0)
    assert spectrum.own == pytest.approx(0.1 * UM / np.sqrt(2.0), rel=1e-9)


@pytest.mark.parametrize("axes", [("y",), ("x", "y"), ("y", "x"), ("z", "x_a", "y_a", "y_b")])
def test_the_axis_is_chosen_by_its_name(axes: tuple[str, ...]) -> None:
    t = time(3.0)
    column = next(place for place, name in enumerate(axes) if name.startswith("y"))
    position = np.zeros((len(t), len(axes)))
    position[:, column] = sine(t, 100.0, UM)
    spectrum = analyse(LoopRecord(0, 1.0 / RATE, 0.0 * position, position, 0.0 * position, axes), PAPER, 0)
    line = spectrum.line(-1, 1)
    assert line is not None
    assert abs(line.amplitude) == pytest.approx(UM, rel=1e-9)


def test_a_record_without_the_axis_is_refused_with_its_axes() -> None:
    signal = np.zeros((30_000, 2))
    with pytest.raises(SpectrumError, match=r"axis = 'y' is requested; axes of the record: x, z"):
        analyse(LoopRecord(0, 1.0 / RATE, signal, signal, signal, ("x", "z")), PAPER, 0)


def test_the_steady_state_begins_when_the_transient_has_died_away() -> None:
    t = time(12.0)
    y = sine(t, 200.0, 3 * UM) * (1.0 - np.exp(-t))
    spectrum = analyse(record(y), PAPER, 0)
    assert spectrum.state == "steady"
    # The block means of e^-t differ by (1 - 1/e)(1 - e^-2) e^-t0 3 um over three blocks, which is 0.05 um at 3.5 s.
    assert spectrum.first_step == 4 * RATE
    assert spectrum.line_change <= PAPER.line_tolerance


def test_a_transient_longer_than_the_record_is_not_steady() -> None:
    t = time(6.0)
    spectrum = analyse(record(sine(t, 200.0, 3 * UM) * (1.0 - np.exp(-t / 4.0))), PAPER, 0)
    assert spectrum.state == "unsettled"
    assert spectrum.first_step == 3 * RATE
    assert "tolerance 0.05 um" in spectrum.reason


def test_a_bias_that_moves_one_way_is_drifting() -> None:
    t = time(6.0)
    spectrum = analyse(record(sine(t, 200.0, 3 * UM) - 0.2 * UM * t), PAPER, 0)
    assert spectrum.state == "drifting"
    assert spectrum.bias_change == pytest.approx(0.4 * UM, rel=1e-2)


def test_a_phase_that_wanders_is_not_steady_though_the_amplitude_stays() -> None:
    t = time(6.0)
    assert analyse(record(sine(t, 100.05, 1 * UM)), PAPER, 0).state == "unsettled"


def test_measurement_noise_does_not_hide_a_steady_state() -> None:
    t = time(3.0)
    noise = np.random.default_rng(0).normal(0.0, 0.2 * UM, len(t))
    spectrum = analyse(record(sine(t, 100.0, 1 * UM) + noise), PAPER, 0)
    assert spectrum.state == "steady"
    line = spectrum.line(-1, 1)
    assert line is not None
    assert abs(line.amplitude) == pytest.approx(1 * UM, abs=5 * 0.2 * UM * np.sqrt(2.0 / len(t)))
    assert spectrum.own == pytest.approx(0.2 * UM, rel=0.2)


def test_records_that_begin_late_keep_their_steps() -> None:
    y = sine(time(4.0), 200.0, 3 * UM)
    spectrum = analyse(record(y, first_step=5000), PAPER, 10_000)
    assert spectrum.first_step == 10_000
    assert spectrum.block_time[0] == 1.0


def test_a_record_that_ends_in_touch_down_has_what_blocks_there_are() -> None:
    short = analyse(record(sine(time(0.4), 200.0, 3 * UM)), PAPER, 0, delevitated=True)
    assert (short.state, short.steps, short.slow, short.lines) == ("delevitated", 0, None, ())
    assert len(short.frequency) == 0
    before = analyse(record(sine(time(0.4), 200.0, 3 * UM)), PAPER, 10_000, delevitated=True)
    assert "0.6 s before the tones had their full amplitude" in before.reason
    longer = analyse(record(sine(time(1.4), 200.0, 3 * UM)), PAPER, 0, delevitated=True)
    assert longer.steps == RATE
    assert spectrum_summary(short)["bias"] is None


@pytest.mark.parametrize(
    ("settings", "sample_time", "first_step", "y", "message"),
    [
        (PAPER, 1e-4, 0, np.full(30_000, np.nan), "position y at step 0 is not finite"),
        (PAPER, 1e-4, 0, np.zeros(29_999), "hold 2 blocks of 1 s; the test for a steady state needs 3"),
        (PAPER, 1e-4, -1, np.zeros(30_000), "the record begins at step 0, after the tones"),
        (PAPER, 1.0 / 6000.0, 0, np.zeros(30_000), "below the Nyquist frequency, 3000 Hz"),
        (PAPER, 3.3e-5, 0, np.zeros(300_000), "a whole number of samples"),
    ],
    ids=["not finite", "short", "begins late", "Nyquist", "part of a sample"],
)
def test_records_that_do_not_suit_are_refused(
    settings: SubharmonicSettings, sample_time: float, first_step: int, y: np.ndarray, message: str
) -> None:
    zeros = np.zeros((len(y), 2))
    position = np.stack([zeros[:, 0], y], axis=1)
    with pytest.raises(SpectrumError, match=message):
        analyse(LoopRecord(0, sample_time, zeros, position, zeros), settings, first_step)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"frequency_2": 200.0}, "two tones have the same frequency: frequency_1 = 200 Hz, frequency_2 = 200 Hz"),
        ({"inducing_frequency": 3000.5}, "3000.5 periods in block_duration = 1 s; allowed: whole periods"),
        ({"longest_run": 2.0}, "must hold agreeing_blocks = 3 blocks, 3 s"),
        ({"inducing_amplitude": -1e-6}, "parameter 'inducing_amplitude' = -1e-06 is not allowed"),
        ({"axis": "z"}, "one of x, y"),
    ],
)
def test_settings_that_do_not_fit_together_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        validate(SubharmonicSettings, values)


def test_a_shift_that_makes_tones_equal_is_refused() -> None:
    with pytest.raises(ParameterError, match="same frequency"):
        SubharmonicSettings(offset_1=50.0, offset_2=-50.0).shifted()


def test_an_absent_tone_may_have_any_frequency() -> None:
    SubharmonicSettings(inducing_amplitude=0.0, inducing_frequency=200.0)


@pytest.mark.parametrize(
    "values",
    [{"amplitude_low": 60e-6}, {"frequency_low": 5000.0}, {"amplitude_count": 1}, {"frequency_high": 500.0}],
)
def test_surfaces_whose_ranges_do_not_ascend_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match="do not fit together"):
        validate(SurfaceSettings, values)
