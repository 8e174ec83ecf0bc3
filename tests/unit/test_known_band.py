"""What data show of the error of a model and leave open, and the frequencies of which a certificate speaks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from amb_core.identification import IdentificationData, estimate_uncertainty
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.robustness import RobustnessSettings, feedback_of
from amb_core.robustness.assessment import assess_known, assess_loop
from amb_core.robustness.checks import assumption_check, band_checks
from amb_core.robustness.error_band import ErrorBand, error_band
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.known_band import KnownBand, known_band
from tests.benchmarks.robust.misfit_plants import MisfitPlant, draw, named_model

LAW = ControllerParameters()
SETTINGS = RobustnessSettings(frequencies=100.0, mode_damping=0.01)
EXCITED = {"amplitude": 10e-6, "duration": 1.2, "frequency_start": 2.0, "axes": "all"}


@pytest.fixture(scope="module")
def record(bearing) -> LoopRecord:
    return bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=4_500.0, **EXCITED)


@pytest.fixture(scope="module")
def true(bearing) -> StateSpaceModel:
    """The bearing with a predictor that is stable."""
    return replace(bearing.model, k=bearing.kalman_gain(2e-9, 0.01))


def band_of(model: StateSpaceModel, record: LoopRecord, feedback: Feedback | None = None) -> ErrorBand:
    """The band of the error of a model, or of its product with the action of a loop."""
    action = None if feedback is None else feedback.action
    band = error_band(model, [IdentificationData.from_record(record)], SETTINGS.mode_damping, action=action)
    assert band is not None
    return band


def known_of(model: StateSpaceModel, record: LoopRecord, settings: RobustnessSettings = SETTINGS) -> KnownBand:
    """What a record makes known of the loop of a model."""
    feedback = feedback_of(model, LAW)
    return known_band(feedback, band_of(model, record, feedback), settings)


def with_filter(plant: MisfitPlant) -> StateSpaceModel:
    """The true model of a plant, with a predictor that is stable."""
    loop, model = plant.loop, named_model(plant)
    forces = loop.b[:, plant.axes :] * loop.force_noise
    seen, sensors = 1e6 * loop.c, (1e6 * loop.sensor_noise) ** 2 * np.eye(plant.axes)  # in um
    spread = solve_discrete_are(loop.a.T, seen.T, forces @ forces.T + 1e-30 * np.eye(len(loop.a)), sensors)
    gain = loop.a @ spread @ seen.T @ np.linalg.inv(seen @ spread @ seen.T + sensors)
    return replace(model, k=1e6 * gain)


def test_the_band_of_the_true_model_holds_no_error_and_shows_none(record, true) -> None:
    band = band_of(true, record)
    here = (band.frequency > 50.0) & (band.frequency < 4_000.0)
    assert np.mean(band.shown[here] < band.open[here]) > 0.99


@pytest.mark.parametrize("frequency", [150.0, 900.0])
def test_the_band_holds_the_error_of_a_model_that_lacks_a_mode(record, true, frequency: float) -> None:
    """The model has the mode and the bearing does not: the same error with the other sign."""
    wrong = with_mode(true, frequency, 0.01, 0.2)
    band = band_of(wrong, record)
    here = (band.frequency > 0.7 * frequency) & (band.frequency < 1.4 * frequency)
    error = np.linalg.norm(wrong.response(band.frequency) - true.response(band.frequency), 2, axis=(1, 2))
    assert np.all(error[here] <= (band.shown + band.open)[here])
    assert band.frequency[np.argmax(band.shown * band.frequency**2 * here)] == pytest.approx(frequency, rel=0.05)


def test_the_band_holds_the_error_of_a_bearing_that_has_changed_since_the_first_record() -> None:
    """A third of the lines are of another running speed: their error is no mean with the two thirds that have none."""
    plant = draw("another speed", 4, axes=1)
    before = replace(plant, other=None)
    records = [plant.record(40_000, 0), plant.record(20_000, 1, now=True)]
    assert all(one is not None for one in records)
    band = error_band(with_filter(before), [IdentificationData.from_record(one) for one in records if one], 0.005)
    assert band is not None
    error = np.abs(plant.true.response(band.frequency) - before.true.response(band.frequency))[:, 0, 0]
    assert np.all(error <= band.shown + band.open)


def test_at_a_resonance_of_the_plant_the_data_show_what_its_loop_needs() -> None:
    """Currents in the direction of the mode are small there: they say little of the response, and little is needed."""
    plant = draw("honest", 238)
    model, record = with_filter(plant), plant.record(80_000, 2 * 238)
    assert record is not None
    feedback, data = feedback_of(model, plant.mild), [IdentificationData.from_record(record)]
    alone, product = (error_band(model, data, 0.001, action=action) for action in (None, feedback.action))
    assert alone is not None and product is not None
    open_ = alone.open * np.linalg.norm(feedback.action(alone.frequency), 2, axis=(1, 2))
    here = (alone.frequency > 300.0) & (alone.frequency < 400.0)
    assert np.max(open_[here]) > 3.0 * np.max(product.open[here])
    assert np.all(product.open[here] < 1.05 * open_[here])


def test_nothing_is_known_above_the_excitation_and_nothing_stated_if_modes_may_be_large(bearing, true) -> None:
    record = bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=500.0, **EXCITED)
    feedback = feedback_of(true, LAW)
    band = band_of(true, record, feedback)
    large = known_band(feedback, band, replaced(mode_gain=1.0))
    assert 300.0 < large.high < 700.0
    assert not large.whole
    assert not large.holds(np.array([2.0 * large.high])).any()
    without = known_band(feedback, band, replaced(mode_gain=0.0))
    assert without.reaches_up
    for count in range(40, 60):  # wherever the ends of the band lie between the frequencies that are asked for
        assert np.isfinite(without.error(feedback, np.geomspace(0.5 * without.low, 5_000.0, count))[0]).all()


def test_slow_modes_below_the_band_are_excluded_by_the_loop_or_by_noise(bearing, true) -> None:
    long = EXCITED | {"duration": 4.0, "frequency_end": 4_500.0}
    feedback = feedback_of(true, LAW)
    band = band_of(true, bearing.experiment(2e-9, "multisine", force=0.01, **long), feedback)
    for ring_down, tolerated in ((0.01, True), (1.0, False)):
        settings = replaced(mode_ring_down=ring_down)
        unexplained = known_band(feedback, band, settings, noise_explained=False)
        assert (unexplained.slower < 1.0) == tolerated
        assert unexplained.reaches_down == tolerated
        assert known_band(feedback, band, settings).reaches_down


def test_a_gap_in_the_band_does_not_hide_what_the_data_say_below_it(bearing, true) -> None:
    """Such as a resonance of the plant about which they leave more open: below it they say as much as without it."""
    record = bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=2_000.0, **EXCITED)
    feedback = feedback_of(true, LAW)
    seen = band_of(true, record, feedback)
    at = seen.frequency
    left_open = np.select([at < 5.0, at < 18.0, at < 20.0, at < 24.0], [seen.open, 0.01, 0.6, 0.2], seen.open)
    band = replace(seen, shown=np.zeros_like(seen.shown), open=left_open)
    known = known_band(feedback, band, SETTINGS)
    assert 20.0 <= known.low < 21.0 and known.reaches_down
    below = np.array([7.0, 9.0, 12.0, 15.0, 24.0])
    error, action = known.error(feedback, below)
    assert error[:3] == pytest.approx(0.01)
    assert np.allclose(action[:3], feedback.action(below[:3]))
    worst = assess_known(feedback, SETTINGS, estimate_uncertainty(true, IdentificationData.from_record(record)), known)
    assert worst[0].bounds is not None
    curve = worst[0].bounds.axes[0].sensitivity.curve
    inside = (worst[0].bounds.frequency > 6.0) & (worst[0].bounds.frequency < 15.0)
    assert np.all(curve[inside] < 1.05 * worst[0].axes[0].sensitivity.value)


def test_slow_modes_are_no_larger_than_the_data_leave_open(bearing, true) -> None:
    """Data from 2 Hz on that say too little for a bound up to 20 Hz, and enough for stability."""
    record = bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=2_000.0, **EXCITED)
    feedback = feedback_of(true, LAW)
    seen = band_of(true, record, feedback)
    assert seen.frequency[0] < 3.0
    for left_open, tolerated in ((0.6, True), (1.2, False)):
        band = replace(
            seen, shown=np.zeros_like(seen.shown), open=np.where(seen.frequency < 20.0, left_open, seen.open)
        )
        known = known_band(feedback, band, replaced(mode_gain=0.05, mode_damping=0.001), noise_explained=False)
        assert known.low == pytest.approx(20.0, rel=0.01)
        assert (known.slower < 1.0, known.reaches_down) == (tolerated, tolerated)
        below = np.array([2.0 * seen.frequency[0], 19.0])
        assert (known.error(feedback, below)[0] <= left_open).all()
        if tolerated:
            assert known.error(feedback, below)[0].max() > 0.5  # more than at the lower end


def test_below_a_band_whose_noise_is_not_explained_the_error_is_finite_on_any_grid(bearing, true) -> None:
    """The data say nothing below 20 Hz: neither of a cell that reaches into the band nor of its lower end."""
    record = bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=2_000.0, **EXCITED)
    feedback = feedback_of(true, LAW)
    seen = band_of(true, record, feedback)
    band = replace(seen, open=np.where(seen.frequency < 20.0, np.inf, seen.open))
    known = known_band(feedback, band, replaced(mode_gain=1e-3), noise_explained=False)
    assert known.reaches_down
    for count in range(40, 60):
        assert np.isfinite(known.error(feedback, np.geomspace(0.5 * known.low, known.high, count))[0]).all()


def test_bounds_count_what_the_data_leave_open_and_the_verdict_names_the_band(record, true) -> None:
    feedback, uncertainty = feedback_of(true, LAW), estimate_uncertainty(true, IdentificationData.from_record(record))
    known = known_of(true, record, replaced(mode_gain=100.0))
    alone, counted = (assess_loop(feedback, SETTINGS, uncertainty, band).bounds for band in (None, known))
    assert alone is not None and counted is not None
    for narrow, wide in zip(alone.axes, counted.axes, strict=True):
        assert wide.sensitivity.value > narrow.sensitivity.value
    assert counted.frequency[-1] <= known.high
    *_, covered = band_checks(assess_loop(feedback, SETTINGS, uncertainty, known), known)
    assert not covered.passed
    assert "no statement" in covered.finding


def test_milder_assumptions_never_state_less(bearing, true) -> None:
    """Modes that just leave the loop stable leave its sensitivity open: the data's own band is stated all the same."""
    record = bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=900.0, **EXCITED)
    feedback, uncertainty = feedback_of(true, LAW), estimate_uncertainty(true, IdentificationData.from_record(record))
    band = band_of(true, record, feedback)
    least, most = (known_band(feedback, band, replaced(mode_gain=gain)) for gain in (0.0, 1.0))
    assert least.beyond < 0.9 < 1.0 < most.beyond
    just_stable = (0.98 - least.beyond) / (most.beyond - least.beyond)  # of the gain, in which it is linear
    inside, mild = (replaced(mode_gain=gain) for gain in (1.0, just_stable))
    stated, _ = assess_known(feedback, inside, uncertainty, most)
    known = known_band(feedback, band, mild)
    assert known.reaches_up
    assessment, said = assess_known(feedback, mild, uncertainty, known)
    assert not said.reaches_up
    assert stated.bounds is not None and assessment.bounds is not None
    for axis, before in zip(assessment.bounds.axes, stated.bounds.axes, strict=True):
        assert axis.sensitivity.value == pytest.approx(before.sensitivity.value)
    # So it is where any sensitivity is allowed, and the assumed perturbations alone are too much above the data.
    anywhere = replaced(mode_gain=just_stable, zone_a=1e9, zone_b=1e9, zone_c=1e9)
    assessment, said = assess_known(feedback, anywhere, uncertainty, known)
    assert not said.reaches_up
    assert assessment.bounds is not None and assessment.bounds.all_signals is not None
    assert assessment.bounds.all_signals.value < 1.0
    texts = [check.finding for check in band_checks(assessment, said)]
    assert any("of what the loop tolerates there, too much for its bounds" in text for text in texts)


def test_an_assumed_damping_that_the_model_contradicts_is_refused(record, true) -> None:
    light = with_mode(true, 600.0, 0.005, 0.3)
    uncertainty = estimate_uncertainty(light, IdentificationData.from_record(record))
    known = known_of(true, record)
    sure = replace(uncertainty, root=1e-6 * uncertainty.root)
    check = assumption_check(feedback_of(light, LAW), sure, known, SETTINGS)
    assert not check.passed
    assert "the mode at 600 Hz has 0.005" in check.finding


def test_a_mode_of_the_model_that_the_data_do_not_show_contradicts_nothing(record, true) -> None:
    """An order too high by two gives such a mode: hardly damped, and far below what the data leave open."""
    light = with_mode(true, 600.0, 0.005, 1e-7)
    uncertainty = estimate_uncertainty(light, IdentificationData.from_record(record))
    sure = replace(uncertainty, root=1e-6 * uncertainty.root)
    assert assumption_check(feedback_of(light, LAW), sure, known_of(true, record), SETTINGS).passed


def test_an_assumed_damping_that_a_mode_contradicts_which_the_model_lacks_is_refused(record, true) -> None:
    """Fitted by modes of the assumed damping, a narrower one looks lower than it is."""
    wrong = with_mode(true, 2_000.0, 0.001, 0.3)
    band = band_of(wrong, record)
    uncertainty = estimate_uncertainty(true, IdentificationData.from_record(record))
    known = replace(known_of(true, record), band=band)
    check = assumption_check(feedback_of(true, LAW), uncertainty, known, SETTINGS)
    assert not check.passed
    assert "the mode that the model lacks at" in check.finding


def test_modes_of_the_assumed_damping_contradict_nothing(record, true) -> None:
    """Neither one that the model lacks, nor a model whose mode is a little off: their difference is narrower."""
    light, off = with_mode(true, 2_000.0, 0.01, 0.3), with_mode(true, 2_000.0, 0.015, 0.3)
    assert not len(band_of(light, record).narrower)
    assert not len(band_of(off, record).narrower)
    assert not len(band_of(true, record).narrower)


def test_a_mode_of_the_model_above_the_data_that_may_be_unstable_leaves_the_bounds_in_their_band(bearing, true) -> None:
    """The data do not show it, so the models that they leave open have it stable and unstable: nothing relies on it."""
    record = bearing.experiment(2e-9, "multisine", force=0.01, frequency_end=500.0, **EXCITED)
    model = with_mode(true, 3_000.0, 0.001, 1e-4)
    feedback, data = feedback_of(model, LAW), IdentificationData.from_record(record)
    known = known_band(feedback, band_of(model, record, feedback), replaced(mode_gain=1.0))
    uncertainty = estimate_uncertainty(model, data)
    bounds = assess_loop(feedback, SETTINGS, uncertainty, known).bounds
    usual = assess_loop(feedback_of(true, LAW), SETTINGS, estimate_uncertainty(true, data), known).bounds
    assert bounds is not None and usual is not None
    assert any(axis.unstable_above for axis in bounds.axes)
    assert not any(axis.unstable_above for axis in usual.axes)
    for axis, expected in zip(bounds.axes, usual.axes, strict=True):
        assert axis.sensitivity.value == pytest.approx(expected.sensitivity.value, rel=0.05)
        assert axis.replayed <= axis.sensitivity.value


def replaced(**values: float) -> RobustnessSettings:
    return SETTINGS.model_copy(update=values)


def with_mode(model: StateSpaceModel, frequency: float, damping: float, share: float) -> StateSpaceModel:
    """A model with a mode between the first input and output, of a gain relative to that of the mass."""
    rate = 2.0 * np.pi * frequency * model.sample_time * (-damping + 1j * np.sqrt(1.0 - damping**2))
    pole = np.exp(rate)
    mode = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]])
    n, mass = model.order, abs(model.response([frequency])[0, 0, 0])
    a = np.block([[model.a, np.zeros((n, 2))], [np.zeros((2, n)), mode]])
    b = np.vstack([model.b, [[share * mass * abs(rate), 0.0], [0.0, 0.0]]])
    c = np.hstack([model.c, [[1.0, 0.0], [0.0, 0.0]]])
    return replace(model, a=a, b=b, c=c, k=np.vstack([model.k, np.zeros((2, 2))]), initial_state=np.zeros(n + 2))


def test_a_band_without_a_frequency_of_the_grid_has_bounds_at_its_ends(record, true) -> None:
    feedback, uncertainty = feedback_of(true, LAW), estimate_uncertainty(true, IdentificationData.from_record(record))
    known = known_of(true, record)
    narrow = replace(known, low=300.0, high=300.1, reaches_down=False, reaches_up=False)
    bounds = assess_loop(feedback, SETTINGS, uncertainty, narrow).bounds
    assert bounds is not None
    assert bounds.frequency == pytest.approx([300.0, 300.1])
