"""Distortion and coherence of recordings: of loops whose nonlinearity is known, and of the simulated bearing."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis import read
from amb_core.data.experiments import IdentificationData, write_data
from amb_core.data.experiments.checks import Severity, check_distortion, check_region
from amb_core.excitation import excitation_from_request, generate
from amb_core.ground.errors import SpectrumError
from amb_core.identification import identify
from amb_core.identification.validation import validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.recording import BagWriter, Recording
from amb_core.regions import Region
from amb_core.regions.distortion import (
    DistortionSettings,
    find_evidence,
    lines_of,
    measure_coherence,
    measure_recorded,
    reference_of,
    simulate_distortion,
)
from amb_core.report.figures import plot
from amb_core.report.figures.style import region_label
from amb_core.report.pages.recording import recording_report
from tests.bag_messages import TELEMETRY, definition, telemetry

Signal = NDArray[np.float64]

RATE = 2_000.0
COUPLING = np.array([[1.0, 0.3], [-0.2, 0.8]])
SETTINGS = DistortionSettings(rms=2e-6, frequency_start=1.0, frequency_end=200.0, period=1.0)
LINES = lines_of(SETTINGS, RATE)
REST = np.zeros((700, 2))


def respond(reference: Signal, square: float = 0.0, cube: float = 0.0, noise: float = 0.0, seed: int = 0) -> LoopRecord:
    """A well damped loop of second order and 60 Hz with coupled axes, whose y is bent: square in 1/m, cube in 1/m^2."""
    position = lfilter(*butter(2, 60.0, fs=RATE), np.roll(reference, 3, axis=0) @ COUPLING.T, axis=0)
    y = position[:, 1]
    position[:, 1] = y + square * y**2 + cube * y**3
    position = position + noise * np.random.default_rng(seed).normal(size=position.shape)
    return LoopRecord(0, 1.0 / RATE, reference, position, 2e6 * (reference - position))


def multisine(*realisations: int, periods: int = 3, between: Signal = REST) -> Signal:
    parts = [np.tile(reference_of(SETTINGS, LINES, number, 0), (periods, 1)) for number in realisations]
    return np.vstack([REST, *(np.vstack([part, between]) for part in parts)])


def excitation(kind: str, repeat: int = 1, **values: object) -> Signal:
    samples = generate(excitation_from_request(kind, values), RATE).samples
    return np.vstack([REST, *[samples] * repeat, REST])


def true_share(square: float) -> float:
    """Power of square y^2 without its mean over that of y, as a ratio of rms, over many realisations."""
    y = np.vstack([respond(multisine(number, periods=1)).position[-2700:-700, 1:] for number in range(10, 30)])
    return float(square * np.std(y**2) / np.std(y))


@pytest.mark.parametrize("between", [REST, REST[:0]])
def test_realisations_in_one_recording_are_found_and_give_the_robust_method(between: Signal) -> None:
    distortion = measure_recorded([respond(multisine(0, 1, 2, 3, between=between), square=4e4)])
    assert (distortion.method, distortion.experiments, distortion.periods, distortion.period) == ("robust", 4, 2, 1.0)
    assert distortion.ratio[0] < 1e-6, "x is linear"
    assert distortion.ratio[1] == pytest.approx(true_share(4e4), rel=0.15)
    assert distortion.even_ratio[1] == pytest.approx(distortion.ratio[1]), "a square is of even order"
    assert distortion.odd_ratio[1] < 0.02 * distortion.ratio[1]
    np.testing.assert_array_equal(np.round(distortion.frequency), LINES.excited)
    b, a = butter(2, 60.0, fs=RATE)
    z = np.exp(-2j * np.pi * distortion.frequency / RATE)
    expected = COUPLING * ((np.polyval(b[::-1], z) / np.polyval(a[::-1], z)) * z**3)[:, None, None]
    np.testing.assert_allclose(distortion.closed_loop[:, 0], expected[:, 0], atol=1e-6)


def test_one_realisation_with_lines_left_out_gives_the_fast_method() -> None:
    square = measure_recorded([respond(multisine(0), square=4e4)])
    assert (square.method, square.experiments) == ("fast", 1)
    assert square.ratio[0] < 1e-6
    assert square.ratio[1] == pytest.approx(true_share(4e4), rel=0.3)
    cube = measure_recorded([respond(multisine(0), cube=3e10)])
    robust = measure_recorded([respond(multisine(*range(6)), cube=3e10)])
    assert cube.even_ratio[1] < 1e-6
    assert cube.odd_ratio[1] == pytest.approx(robust.odd_ratio[1], rel=0.3)


def test_the_fast_response_is_that_of_the_robust_method_within_its_deviation() -> None:
    fast, robust = (measure_recorded([respond(multisine(*range(count)), noise=1e-8, seed=count)]) for count in (1, 6))
    inner = slice(8, 60)
    error = np.abs(fast.closed_loop - robust.closed_loop)[inner]
    assert np.median(error / fast.deviation[inner]) < 2.0
    assert np.median(error) < 0.01


@pytest.mark.parametrize("count", [1, 4])
def test_noise_and_the_transient_of_the_first_period_are_not_taken_for_distortion(count: int) -> None:
    distortion = measure_recorded([respond(multisine(*range(count), periods=2), noise=4e-8, seed=count)])
    assert distortion.periods == 2
    assert np.all(distortion.ratio < 0.03), distortion.summary


@pytest.mark.parametrize("periods", [2, 4])
@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("square", [0.0, 4e4])
def test_a_steady_drift_changes_neither_distortion_nor_noise_nor_response(
    square: float, count: int, periods: int
) -> None:
    still = respond(multisine(*range(count), periods=periods), square=square, noise=2e-8)
    drift = 0.4e-6 * still.time[:, None]  # m, at 0.4 um/s
    drifting = replace(still, position=still.position + drift, current=still.current - 2e6 * drift)
    expected, measured = (measure_recorded([record]) for record in (still, drifting))
    np.testing.assert_allclose(measured.ratio, expected.ratio, atol=1e-6)
    np.testing.assert_allclose(measured.noise, expected.noise, atol=1e-15)
    np.testing.assert_allclose(measured.closed_loop, expected.closed_loop, atol=1e-9)
    np.testing.assert_allclose(measured.plant, expected.plant, rtol=1e-6)


def test_a_drift_that_bends_counts_as_noise() -> None:
    still = respond(multisine(0, periods=4), noise=2e-8)
    drift = 1e-6 * (1.0 - np.exp(-still.time[:, None] / 1.3))  # m, of a record of 4.7 s
    drifting = replace(still, position=still.position + drift, current=still.current - 2e6 * drift)
    expected, measured = (measure_recorded([record]) for record in (still, drifting))
    assert np.all(measured.noise_ratio > 1.2 * expected.noise_ratio)
    assert np.all(measured.ratio < 1e-3), "2 % with the slope of the drift"


def test_the_same_realisation_again_is_not_another_one() -> None:
    distortion = measure_recorded([respond(multisine(0, 0, 0, 0), square=4e4)])
    assert (distortion.method, distortion.experiments) == ("fast", 1)


def test_the_excitation_that_nodes_play_is_such_a_signal() -> None:
    settings = {"amplitude": 6e-6, "duration": 3.0, "periods": 3, "odd": True, "frequency_end": 200.0}
    parts = [excitation("multisine", seed=seed, **settings) for seed in range(3)]
    assert measure_recorded([respond(parts[0], square=4e4)]).method == "fast"
    robust = measure_recorded([respond(np.vstack(parts), square=4e4)])
    assert (robust.method, robust.experiments) == ("robust", 3)
    assert robust.ratio[1] == pytest.approx(true_share(4e4), rel=0.25)
    assert measure_recorded([respond(excitation("multisine", axes="y", **settings), square=4e4)]).ratio[1] > 0.02


def test_an_axis_that_is_not_excited_has_no_number() -> None:
    settings = {"amplitude": 6e-6, "duration": 3.0, "periods": 3, "odd": True, "frequency_end": 200.0}
    distortion = measure_recorded([respond(excitation("multisine", axes="y", **settings), square=4e4)])
    assert np.isnan(distortion.ratio[0]) and np.isfinite(distortion.ratio[1])
    assert "x not excited" in distortion.summary and " on x" not in distortion.brief
    assert distortion.as_dict()["x"]["distortion_percent"] is None


def test_squares_show_even_order_alone_and_say_so() -> None:
    squares = excitation("square", amplitude=5e-6, duration=4.0, frequency=10.0)
    distortion = measure_recorded([respond(squares, square=4e4)])
    assert not distortion.complete and distortion.even_ratio[1] > 0.01 and np.isnan(distortion.odd_ratio[1])
    assert "with that of odd order hidden" in distortion.summary and "with that of odd order hidden" in distortion.brief
    assert measure_recorded([respond(squares)]).ratio[1] < 1e-6


NOT_PERMITTED = {
    "sweep": ({"duration": 8.0, "frequency_start": 5.0, "frequency_end": 200.0}, "repeats no period"),
    "prbs": ({"duration": 4.0}, "repeats no period"),
    "white_noise": ({"duration": 4.0}, "repeats no period"),
    "multisine": ({"duration": 4.0}, "repeats no period"),
}


@pytest.mark.parametrize("kind", NOT_PERMITTED)
def test_other_recordings_are_refused_with_what_is_needed_and_show_their_coherence(kind: str) -> None:
    settings, reason = NOT_PERMITTED[kind]
    record = respond(excitation(kind, amplitude=3e-6, **settings), square=4e4)
    with pytest.raises(SpectrumError, match=rf"{reason}.*needed: two whole periods or more of a multisine"):
        measure_recorded([record])
    evidence = find_evidence([record])
    assert evidence.distortion is None and evidence.coherence is not None
    assert evidence.coherence.ratio[0] < 0.01 < evidence.coherence.ratio[1]
    assert "noise and distortion together" in evidence.brief and "distortion alone not measured" in evidence.brief


def test_a_period_of_every_line_repeated_does_not_pass_for_free_of_distortion() -> None:
    record = respond(excitation("multisine", 3, amplitude=6e-6, duration=2.0, frequency_end=200.0), square=4e4)
    with pytest.raises(SpectrumError, match="every line of the band is excited, so distortion hides"):
        measure_recorded([record])
    evidence = find_evidence([record]).coherence
    assert evidence is not None and evidence.ratio[1] > 0.02


@pytest.mark.parametrize("seed", range(3))
def test_random_steps_that_repeat_by_chance_are_no_period(seed: int) -> None:
    """Of 600 random signs, each held for 0.05 s, some four come twice in a row: 2 periods of 0.2 s."""
    signs = np.random.default_rng(seed).choice([-1e-6, 1e-6], (600, 1))
    record = respond(np.repeat(signs, 100, axis=0) * [1.0, 0.0], noise=1e-9)
    evidence = find_evidence([record])
    assert evidence.distortion is None
    assert "repeats no period" in evidence.problem
    assert evidence.coherence is not None
    assert np.nanmax(evidence.coherence.ratio) < 0.05


def test_a_short_binary_sequence_that_repeats_often_is_a_period() -> None:
    signs = np.random.default_rng(1).choice([-1e-6, 1e-6], (31, 2))
    distortion = measure_recorded([respond(np.tile(np.repeat(signs, 20, axis=0), (periods, 1))) for periods in (4, 5)])
    assert distortion.period == pytest.approx(31 * 20 / RATE)


def test_what_else_is_not_permitted_is_said() -> None:
    tones = excitation("tones", duration=3.0, frequencies=[20.0, 45.0], amplitudes=[2e-6, 2e-6])
    with pytest.raises(SpectrumError, match=r"has 2 lines in its period of 0\.2 s, a multisine has 8 or more"):
        measure_recorded([respond(tones)])
    mixed = np.vstack([multisine(0, 1), 3.0 * multisine(2, 3)])
    with pytest.raises(SpectrumError, match=r"rms is 2\.83 um in one realisation and 8\.49 um in another"):
        measure_recorded([respond(mixed)])
    with pytest.raises(SpectrumError, match="the reference does not move"):
        measure_coherence([respond(np.zeros((4_000, 2)))])


@pytest.mark.parametrize("value", [0.0, -60e-6])
@pytest.mark.parametrize("signal", ["multisine", "prbs"])
def test_a_dead_or_stuck_position_is_refused_by_its_axis(signal: str, value: float) -> None:
    record = respond(multisine(0) if signal == "multisine" else excitation("prbs", amplitude=3e-6, duration=4.0))
    stuck = replace(record, position=record.position * [1.0, 0.0] + [0.0, value])
    evidence = find_evidence([stuck])
    assert not evidence.measured
    refused = "the position does not move on y while the reference does: a dead or stuck sensor; needed: "
    assert evidence.coherence_problem.startswith(refused)
    assert signal == "prbs" or evidence.problem.startswith(refused)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("steps", [0, 1, 2, 3])
def test_a_record_without_a_spectrum_is_refused_in_one_line(steps: int) -> None:
    whole = respond(multisine(0))
    reference, position, current = (
        part[1_000 : 1_000 + steps] for part in (whole.reference, whole.position, whole.current)
    )
    record = LoopRecord(1_000, 1.0 / RATE, reference, position, current)
    evidence = find_evidence([record])
    assert not evidence.measured and "repeats no period" in evidence.problem
    assert f"steps in the record: {steps}; needed: 3 or more" in evidence.coherence_problem or steps == 3
    assert find_evidence([record, whole]).measured, "another record has one"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("reference", "position"), [(1e-200, 1e-200), (1e-200, 1.0), (1.0, 1e-200)])
def test_signals_whose_power_is_no_number_stand_still(reference: float, position: float) -> None:
    record = respond(multisine(0))
    tiny = replace(record, reference=reference * record.reference, position=position * record.position)
    evidence = find_evidence([tiny])
    assert not evidence.measured
    assert "not move" in evidence.coherence_problem


@pytest.mark.parametrize("noise", [0.0, 1e-7, 1e-6, 1e-5])
def test_coherence_has_no_bias_from_the_number_of_lines(noise: float) -> None:
    reference = excitation("white_noise", amplitude=3e-6, duration=6.0, frequency_end=200.0)
    clean, noisy = respond(reference), respond(reference, noise=noise)
    band = int(200.0 / RATE * len(reference)) * 2 / len(reference)
    expected = noise * np.sqrt(band) / np.std(clean.position, axis=0)
    coherence = measure_coherence([noisy])
    np.testing.assert_allclose(coherence.ratio, expected, rtol=0.2, atol=2e-3)
    if noise == 1e-5:
        assert np.all(coherence.coherence[coherence.frequency > 150.0].mean(axis=0) < 0.1), (
            "hardly any motion there but noise"
        )


def test_the_chart_of_a_coherence_has_its_numbers() -> None:
    chart = plot(measure_coherence([respond(excitation("prbs", amplitude=3e-6, duration=4.0), square=4e4)]))
    assert [panel.title.split(":")[0] for panel in chart.panels] == ["x", "y"]
    described = r"Coherence over frequency, from N to N Hz; lowest: N on x at N Hz, N on y at N Hz\."
    assert re.fullmatch(described.replace("N", r"[\d.]+"), chart.alt), chart.alt
    assert chart.figure().axes


def write_bag(folder: Path, record: LoopRecord) -> Path:
    """A bag with one message of telemetry."""
    with BagWriter(folder) as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        bag.write("/amb/telemetry", telemetry(record), 0)
    return folder


BEARING = DistortionSettings(rms=3e-6, frequency_start=5.0, frequency_end=400.0, period=0.2, realisations=3)


@cache
def simulated_bearing() -> LoopRecord:
    """The paper's bearing under three realisations, each of three periods, one after the other."""
    lines = lines_of(BEARING, 10_000.0)
    parts = [np.tile(reference_of(BEARING, lines, number, 0), (3, 1)) for number in range(3)]
    excitation = np.vstack(parts)
    plant, controller = PlantParameters(), ControllerParameters()
    return simulate(Plant(plant), PdController(controller), 4_000 + len(excitation), excitation, 4_000)


def test_a_bag_of_the_bearing_shows_what_its_simulation_does(tmp_path: Path) -> None:
    bag, out = write_bag(tmp_path / "bag", simulated_bearing()), tmp_path / "out"
    shown = CliRunner().invoke(app, ["distortion", str(bag), "--out", str(out)], catch_exceptions=False)
    assert shown.exit_code == 0, shown.output
    summary = json.loads((out / "summary.json").read_text())
    expected = simulate_distortion(PlantParameters(), ControllerParameters(), BEARING).as_dict()
    assert summary["method"] == "robust"
    distortion = summary["distortion"]["y"]
    assert distortion["distortion_percent"] == pytest.approx(expected["y"]["distortion_percent"], rel=0.25)
    assert distortion["even_percent"] > 10 * distortion["odd_percent"]
    assert summary["coherence"] is None and "too short for bands of 30 Hz" in summary["coherence_problem"]
    assert (out / "distortion.png").is_file()
    assert "robust method" in shown.output


def test_a_file_of_data_will_do_and_one_that_does_not_says_what_is_needed(tmp_path: Path) -> None:
    for name, reference in (("odd", multisine(0)), ("still", np.zeros((5_000, 2)))):
        write_data(IdentificationData.from_record(respond(reference, square=4e4)), tmp_path / f"{name}.npz")
    good = CliRunner().invoke(app, ["distortion", str(tmp_path / "odd.npz"), "--out", str(tmp_path / "out")])
    assert good.exit_code == 0, good.output
    bad = CliRunner().invoke(app, ["distortion", str(tmp_path / "still.npz"), "--out", str(tmp_path / "none")])
    assert isinstance(bad.exception, SpectrumError)
    assert "needed: two whole periods" in str(bad.exception) and "does not move" in str(bad.exception)
    assert not (tmp_path / "none").exists()


def test_commands_name_a_dead_sensor_instead_of_region_a(tmp_path: Path) -> None:
    record = respond(multisine(0))
    bag = write_bag(tmp_path / "bag", replace(record, position=record.position * [1.0, 0.0]))
    refused = CliRunner().invoke(app, ["distortion", str(bag), "--out", str(tmp_path / "none")])
    assert isinstance(refused.exception, SpectrumError) and "does not move on y" in str(refused.exception)
    shown = CliRunner().invoke(app, ["regions", str(bag), "--out", str(tmp_path / "out")], catch_exceptions=False)
    said = " ".join(shown.stdout.split())
    last = record.steps - 1
    assert f"position y steps 0 to {last}: unchanged while its axis moves; a dead or stuck sensor shows no" in said
    assert "distortion not measured" in said
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["frozen"] == [f"y steps 0 to {last}"]
    report = recording_report(Recording.read(bag), order=8)
    assert f"Position y steps 0 to {last}: unchanged while its axis moves; a dead or stuck sensor" in report.lead
    assert "egion A" not in report.lead
    finding = check_region(IdentificationData.from_record(replace(record, position=record.position * [1.0, 0.0])))
    assert finding.text == f"y steps 0 to {last}: not checked: a dead or stuck sensor shows no region"


def recorded_bearing(folder: Path, amplitude: float) -> Path:
    """A bag of the paper's bearing under a multisine of 1 Hz to 2 kHz (peak amplitude in m)."""
    settings = {"amplitude": amplitude, "duration": 2.0, "frequency_start": 1.0, "frequency_end": 2_000.0}
    samples = generate(excitation_from_request("multisine", settings), 10_000.0).samples
    bearing, law = Plant(PlantParameters()), PdController(ControllerParameters())
    record = simulate(bearing, law, 3_000 + len(samples), samples, 3_000)
    return write_bag(folder / "bag", record.window(3_000, len(samples)))  # the rotor has settled


@pytest.fixture(scope="module")
def mixed_up(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """In region A, and too strongly and too fast excited for a linear model."""
    return recorded_bearing(tmp_path_factory.mktemp("mixed_up"), 8.9e-6)


@pytest.fixture(scope="module")
def gentle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same at a tenth of the amplitude."""
    return recorded_bearing(tmp_path_factory.mktemp("gentle"), 0.89e-6)


def test_a_report_on_region_a_states_the_distortion_and_nothing_of_linear(mixed_up: Path) -> None:
    recording = Recording.read(mixed_up)
    recording.clearance = 250e-6
    report = recording_report(recording, order=8)  # without a model, which takes long
    assert re.search(r"Region A all the time; noise and distortion together .* % on x, [4-9]\d % on y", report.lead)
    assert "linear" not in report.lead
    assert [section.heading for section in report.sections][:3] == ["Regions", "Distortion", "Motion"]


def test_region_a_is_named_by_what_it_says() -> None:
    assert region_label(Region.A) == "A steady bias"


def test_validation_and_data_check_name_distortion_as_the_limit_of_the_fit(mixed_up: Path, gentle: Path) -> None:
    data = read(mixed_up).data
    finding = check_distortion(data)
    assert finding.severity is Severity.WARNING
    assert re.search(r"a linear loop fits to about [3-6]\d % at most", finding.advice)
    for source in (mixed_up, gentle):
        validation = validate(identify(read(source).data, 8, method="ssarx").model, data, ControllerParameters())
        assert validation.fit[1] < 65.0, (
            "not even the model of these data follows, though its controller is limited too"
        )
    text = " ".join(validation.report().split())
    assert "may not be linear" in text and "Excite less" in text
    assert "noise and distortion together" in validation.summary
    assert validation.as_dict()["distortion"]["coherence"]["y"]["coherence"] < 0.9


def test_options_of_the_simulation_are_refused_with_a_recording_and_the_other_way_round(tmp_path: Path) -> None:
    for words, reason in (
        (["bag", "--rms", "1e-6"], "--rms is for the simulation only"),
        (["bag", "--set", "rotor.gravity=0"], "--params or --set is for the simulation only"),
        (["--run", "3"], "--run is for a recording only"),
    ):
        result = CliRunner().invoke(app, ["distortion", *words, "--out", str(tmp_path)])
        assert isinstance(result.exception, SpectrumError) and str(result.exception) == reason
