"""A swept sine finds narrow resonances, dwells at them, and says where it could not have found one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData
from amb_core.linear import LinearSystem
from amb_core.robustness import Feedback, SweepSettings, measured_sensitivity
from amb_core.robustness.feedback import law_from_positions
from amb_core.robustness.sharp_peaks import SharpMode
from amb_core.robustness.sweep import (
    HIDDEN,
    dwells,
    hidden_in_sensitivity,
    highest_that_matters,
    looked_band,
    modes_of,
    sweep_remarks,
)
from tests.benchmarks.robust.hidden_modes import LAW, STEP, rotor, swept

SETTINGS = SweepSettings(sweep_amplitude=4e-6, sweep_duration=6.0, sweep_start=200.0, sweep_end=2_000.0)
HERTZ, DAMPING = 928.0, 0.001


@pytest.fixture(scope="module")
def loop():
    return rotor(HERTZ, DAMPING, 0.02)


@pytest.fixture(scope="module")
def truth(loop) -> Feedback:
    plant = LinearSystem(loop.a, loop.b, loop.c, np.zeros((2, 2)), STEP)
    return Feedback(plant, law_from_positions(LAW, 2), ("x", "y"))


@pytest.fixture(scope="module")
def first(loop) -> IdentificationData:
    return swept(loop, SETTINGS.excitation, np.random.default_rng(1))


def test_a_mode_of_damping_one_in_a_thousand_is_found_and_dwelt_at_weakly(first) -> None:
    chosen = dwells(first, LAW, SETTINGS)
    assert any(one.frequency_start < HERTZ < one.frequency_end for one in chosen)
    assert all(one.amplitude <= SETTINGS.sweep_amplitude for one in chosen)
    assert all(one.frequency_end < 1.2 * one.frequency_start for one in chosen if one.frequency_start > 0.9 * HERTZ)


def test_after_the_dwell_its_peak_is_known_to_02_db_and_01_percent(loop, truth, first) -> None:
    random = np.random.default_rng(2)
    further = [part for one in dwells(first, LAW, SETTINGS) for part in swept(loop, one, random).experiments]
    data = replace(first, experiments=(*first.experiments, *further))
    modes = modes_of(data, LAW)
    measured = measured_sensitivity(data, LAW, modes)
    fine = HERTZ * np.linspace(0.99, 1.01, 2_001)
    true = np.abs(truth.output_sensitivity.response(fine)[:, 0, 0])
    near = (measured.frequency > fine[0]) & (measured.frequency < fine[-1])
    own = np.where(near, np.abs(measured.own[:, 0]), 0.0)
    place = int(own.argmax())
    assert own[place] == pytest.approx(true.max(), rel=0.023)
    assert measured.frequency[place] == pytest.approx(fine[true.argmax()], rel=1e-3)
    assert measured.deviation[place, 0] < 0.0115 * own[place]


def test_a_loop_without_narrow_modes_is_not_dwelt_at() -> None:
    calm = swept(rotor(600.0, 0.5, 1e-4), SETTINGS.excitation, np.random.default_rng(3))
    assert dwells(calm, LAW, SETTINGS) == []


BROAD = SweepSettings(sweep_amplitude=4e-6, sweep_duration=10.0, sweep_start=15.0, sweep_end=500.0)


@pytest.fixture(scope="module")
def broad():
    """A loop that damps a bending mode of 45.5 Hz well: its largest S, 2.8, is at 35.4 Hz, with a damping of 0.06."""
    return rotor(45.5, 0.001, 0.183)


def test_the_highest_sensitivity_is_dwelt_at_until_it_is_known_to_005_db(broad) -> None:
    random = np.random.default_rng(6)
    data = swept(broad, BROAD.excitation, random)
    chosen = dwells(data, LAW, BROAD, [])
    assert sum(one.frequency_start < 35.4 < one.frequency_end for one in chosen) == 1
    further = [part for one in chosen for part in swept(broad, one, random).experiments]
    data = replace(data, experiments=(*data.experiments, *further))
    measured = measured_sensitivity(data, LAW, [])
    place = int(np.abs(measured.own[:, 0]).argmax())
    plant = LinearSystem(broad.a, broad.b, broad.c, np.zeros((2, 2)), STEP)
    true = Feedback(plant, law_from_positions(LAW, 2), ("x", "y")).output_sensitivity
    fine = np.abs(true.response(np.linspace(30.0, 40.0, 1_001))[:, 0, 0])
    assert np.abs(measured.own[place, 0]) == pytest.approx(fine.max(), rel=0.023)
    assert measured.deviation[place, 0] < 0.008 * abs(measured.own[place, 0])
    assert dwells(data, LAW, BROAD, []) == []


def test_dwells_stay_in_the_band_of_the_sweep(loop) -> None:
    whole = SETTINGS.model_copy(update={"sweep_end": 4_990.0})
    data = swept(loop, whole.excitation, np.random.default_rng(8))
    high = SharpMode(4_600.0, 0.02, 50.0, 0.3)
    chosen = dwells(data, LAW, whole, [high, SharpMode(4_995.0, 0.002, 50.0, 0.3)])
    assert max(one.frequency_end for one in chosen) == 4_990.0
    assert all(one.frequency_start > 200.0 for one in chosen)


def test_a_broad_resonance_does_not_bend_the_values_about_it() -> None:
    loop = rotor(142.4, 0.0015, 0.142)
    data = swept(loop, BROAD.excitation, np.random.default_rng(7))
    without = measured_sensitivity(data, LAW, [])
    with_mode = measured_sensitivity(data, LAW, [SharpMode(144.7, 0.045, 19.0, 0.74)])
    assert np.array_equal(with_mode.frequency, without.frequency)
    assert np.array_equal(with_mode.own, without.own)


def test_the_band_says_where_a_sweep_is_too_fast_or_ends_too_early(truth, first) -> None:
    low, high = looked_band(first)
    assert low == pytest.approx(200.0, rel=0.1)  # 3 s on each axis resolve damping 0.001 from 167 Hz onwards
    assert high == pytest.approx(2_000.0, rel=0.1)
    assert not any("too fast" in text or "looked for" in text for text in sweep_remarks(first, truth, LAW))
    short = replace(first, experiments=tuple(_cut(part) for part in first.experiments))
    assert highest_that_matters(truth) > 400.0
    fast, *_, early = sweep_remarks(short, truth, LAW)
    assert "passes modes of damping 0.001 too fast below" in fast
    assert "nothing was looked for" in early


def test_a_weak_sweep_names_where_modes_could_hide_in_its_noise(loop, truth) -> None:
    weak = SETTINGS.model_copy(update={"sweep_amplitude": 0.05e-6})
    data = swept(loop, weak.excitation, np.random.default_rng(4))
    assert any("could hide in the noise" in text for text in sweep_remarks(data, truth, LAW))
    heights = [hidden_in_sensitivity(one, LAW, np.array([500.0]), DAMPING)[0] for one in (data, _strong(loop))]
    assert heights[0] > HIDDEN > heights[1]


def _strong(loop) -> IdentificationData:
    strong = SETTINGS.model_copy(update={"sweep_amplitude": 20e-6, "sweep_duration": 10.0})
    return swept(loop, strong.excitation, np.random.default_rng(5))


def _cut(part):
    """The first half second of an experiment."""
    steps = 5_000
    return replace(part, inputs=part.inputs[:steps], outputs=part.outputs[:steps], reference=part.reference[:steps])
