"""Multisines: phases for a low crest factor, and lines that tell the axes apart."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.excitation import Multisine, excitation_from_request, generate
from amb_core.excitation.phases import optimised_phases, schroeder_phases
from amb_core.ground.errors import ExcitationError

RATE = 10_000.0
BANDS = [(11.0, 400.0), (1.0, 60.0), (10.0, 1_000.0)]


def samples(**values: object) -> NDArray[np.float64]:
    return generate(Multisine.model_validate({"amplitude": 50e-6, "duration": 1.0, **values}), RATE).samples


def crest_factor(signal: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(signal)) / np.std(signal))


def excited_lines(signal: NDArray[np.float64]) -> NDArray[np.intp]:
    spectrum = np.abs(np.fft.rfft(signal))
    return np.flatnonzero(spectrum > 1e-6 * spectrum.max())


def test_the_default_is_the_random_phase_multisine_bit_for_bit() -> None:
    spectrum = np.zeros(5_001, dtype=complex)
    phases = np.random.default_rng([0, 1]).uniform(0.0, 2.0 * np.pi, 390)
    spectrum[11:401] = np.exp(1j * phases)
    signal = np.fft.irfft(spectrum, 10_000)
    signal *= 50e-6 / np.max(np.abs(signal))
    assert samples()[:, 1].tobytes() == signal.tobytes()


@pytest.mark.parametrize("band", BANDS)
def test_schroeders_phases_have_a_crest_factor_near_1_7(band: tuple[float, float]) -> None:
    signal = samples(phasing="schroeder", frequency_start=band[0], frequency_end=band[1])
    assert 1.5 < crest_factor(signal[:, 0]) < 2.0


@pytest.mark.parametrize("band", BANDS)
@pytest.mark.parametrize("seed", [0, 1])
def test_optimised_phases_have_a_crest_factor_below_1_5(band: tuple[float, float], seed: int) -> None:
    signal = samples(phasing="optimised", frequency_start=band[0], frequency_end=band[1], seed=seed)
    for axis in signal.T:
        assert 1.3 < crest_factor(axis) < 1.5


def test_clipping_takes_the_classic_31_lines_from_schroeders_phases_below_1_5() -> None:
    lines = np.arange(1, 32)
    spectrum = np.zeros(257, dtype=complex)
    factors = []
    for phases in (schroeder_phases(lines), optimised_phases(lines, schroeder_phases(lines))):
        spectrum[lines] = np.exp(1j * phases)
        factors.append(crest_factor(np.fft.irfft(spectrum, 512)))
    assert 1.6 < factors[0] < 1.8
    assert factors[1] < 1.5


@pytest.mark.parametrize("phasing", ["random", "schroeder", "optimised"])
@pytest.mark.parametrize("interleaved", [False, True])
def test_whatever_the_phases_every_line_has_the_same_amplitude(phasing: str, interleaved: bool) -> None:
    for axis in samples(phasing=phasing, interleaved=interleaved).T:
        lines = excited_lines(axis)
        amplitudes = np.abs(np.fft.rfft(axis))[lines]
        assert amplitudes == pytest.approx(amplitudes[0])


@pytest.mark.parametrize("axes", ["both", "in_turn"])
def test_interleaved_axes_share_no_line_and_leave_none_out(axes: str) -> None:
    signal = samples(interleaved=True, axes=axes, duration=2.0 if axes == "in_turn" else 1.0)
    x, y = (excited_lines(axis[axis != 0.0] if axes == "in_turn" else axis) for axis in signal.T)
    assert not set(x) & set(y)
    assert sorted([*x, *y]) == list(range(11, 401))


@pytest.mark.parametrize("phasing", ["schroeder", "optimised"])
def test_signals_with_chosen_phases_start_close_to_zero(phasing: str) -> None:
    # Closer than the largest step from a sample to the next, 2 pi 400 Hz / 10 kHz of the amplitude.
    assert np.all(np.abs(samples(phasing=phasing)[0]) < 0.25 * 50e-6)


def test_the_seed_changes_optimised_phases_but_not_schroeders() -> None:
    assert not np.array_equal(samples(phasing="optimised", seed=1), samples(phasing="optimised", seed=2))
    assert np.array_equal(samples(phasing="schroeder", seed=1), samples(phasing="schroeder", seed=2))


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (
            "multisine",
            {"phasing": "newman"},
            "'phasing' = 'newman' is not allowed; allowed: one of random, schroeder, opt",
        ),
        ("square", {"phasing": "optimised"}, "square does not use 'phasing'"),
        ("prbs", {"interleaved": True}, "prbs does not use 'interleaved'"),
    ],
)
def test_requests_that_make_no_sense_are_refused(kind: str, values: dict[str, object], message: str) -> None:
    with pytest.raises(ExcitationError, match=message):
        excitation_from_request(kind, {"amplitude": 1e-6, "duration": 1.0, **values})


def test_interleaving_needs_two_lines() -> None:
    with pytest.raises(ExcitationError, match="interleaved needs 2 lines or more, but only 20 Hz lies in the band"):
        samples(interleaved=True, duration=0.1, frequency_start=15.0, frequency_end=25.0)


def test_odd_leaves_out_one_of_every_four_odd_lines_the_same_ones_for_every_seed_and_axis() -> None:
    first, second = (samples(odd=True, seed=seed, frequency_start=1.0, frequency_end=399.0) for seed in (0, 5))
    lines = excited_lines(first[:, 0])
    assert set(lines % 2) == {1}
    assert len(lines) == 150
    for signal in (first[:, 1], *second.T):
        np.testing.assert_array_equal(excited_lines(signal), lines)
    assert not np.allclose(first, second)


def test_periods_repeat_the_multisine_of_a_period_bit_for_bit() -> None:
    three, one = samples(duration=3.0, periods=3), samples(duration=1.0)
    assert three.tobytes() == np.tile(one, (3, 1)).tobytes()
    in_turn = samples(duration=4.0, periods=2, axes="in_turn")
    np.testing.assert_array_equal(in_turn[:10_000, 0], in_turn[10_000:20_000, 0])


def test_periods_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ExcitationError, match="10000 samples on an axis cannot hold 3 equal periods"):
        samples(duration=1.0, periods=3)
    with pytest.raises(ExcitationError, match="odd needs four odd lines or more, but only 20 Hz lies in the band"):
        samples(odd=True, frequency_start=20.0, frequency_end=20.5)
