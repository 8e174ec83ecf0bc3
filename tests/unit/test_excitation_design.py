"""Excitation design: order that identification accepts, trials in simulation, the largest amplitude within limits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.experiments.checks import Severity, check_amount
from amb_core.data.experiments.checks import check_excitation as identification_check
from amb_core.designs.excitation import (
    Limits,
    Trial,
    TrialBench,
    check_excitation,
    design_excitation,
    excited_order,
)
from amb_core.designs.excitation.excited_order import HIGHEST_ORDER
from amb_core.designs.excitation.limits import Use
from amb_core.designs.excitation.linear_response import LinearLoop
from amb_core.designs.excitation.search import largest_within
from amb_core.excitation import ExcitationSignal, excitation_from_request, generate
from amb_core.ground.errors import AmbError, ExcitationError
from amb_core.ground.parameters import validate
from amb_core.identification import IdentificationData, identify, nrmse_fit, simulate_closed_loop
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import RegionMap

RATE = 10_000.0
MAP_FILE = Path(__file__).parent / "data" / "paper_map.json"
MAP = RegionMap.load(MAP_FILE)


def signal(kind: str, **values: Any) -> ExcitationSignal:
    return generate(excitation_from_request(kind, {"amplitude": 10e-6, "duration": 2.0, **values}), RATE)


# -- the order that identification accepts


def linear_order(model_order: int | None = None, **values: Any) -> int:
    excitation = signal("multisine", **values)
    response = LinearLoop(Plant(PlantParameters()), ControllerParameters()).respond(excitation.samples)
    return excited_order(response.current, response.position, 1.0 / RATE, model_order).order


def test_a_narrow_band_does_not_excite_a_high_order_however_many_lines_it_has() -> None:
    # 1556 lines of 11 to 400 Hz in 4 s; at 10 kHz and without noise their lags are nearly collinear.
    assert linear_order(frequency_end=400.0, duration=4.0) < 10
    assert linear_order(frequency_end=3_000.0, duration=4.0) >= 10


@pytest.mark.parametrize("frequency_end", [400.0, 2_000.0])
def test_design_and_identification_agree_on_the_order(bench: TrialBench, frequency_end: float) -> None:
    excitation = signal("multisine", amplitude=1e-6, duration=1.0, frequency_end=frequency_end)
    record = bench.run(excitation).record.window(10_000, excitation.steps)
    order = excited_order(record.current, record.position, record.sample_time).order
    data = IdentificationData.from_record(record)
    assert identification_check(data, order).severity < Severity.ERROR
    assert order == HIGHEST_ORDER or identification_check(data, order + 2).severity is Severity.ERROR


@pytest.mark.parametrize("steps", [60, 200])
def test_no_order_is_promised_for_which_the_samples_are_too_few(steps: int) -> None:
    current, position = np.random.default_rng(1).normal(size=(2, steps, 2))
    excited = excited_order(current, position, 1.0 / RATE)
    data = IdentificationData.from_arrays(current, position, 1.0 / RATE)
    assert check_amount(data, excited.order).severity < Severity.ERROR
    assert check_amount(data, excited.order + 1).severity is Severity.ERROR
    assert str(excited) == f"up to {excited.order}"


# -- trials


@pytest.fixture(scope="module")
def bench() -> TrialBench:
    return TrialBench(PlantParameters(), ControllerParameters())


def test_a_small_signal_runs_in_region_a_and_leaves_the_bias_where_it_is(bench: TrialBench) -> None:
    trial = bench.run(signal("multisine", amplitude=15e-6, duration=1.0))
    assert trial.region == trial.classified == Region.A
    assert np.all(np.abs(trial.bias_shift) < 0.5e-6)


def test_a_steady_signal_that_moves_the_bias_is_in_b_although_nothing_drifts(bench: TrialBench) -> None:
    trial = bench.run(signal("multisine", amplitude=70e-6, duration=1.0))
    assert (trial.region, trial.classified) == (Region.B, Region.A)
    assert trial.bias_shift[1] < -2e-6  # the rotor sinks: the negative stiffness grows with the current
    assert abs(trial.bias_shift[0]) < 1e-6  # along x there is no load


def test_the_linear_answer_to_a_reference_with_a_mean_value_is_no_shift(bench: TrialBench) -> None:
    # Half a period of 0.5 Hz: a step of 10 um, which the loop answers by 13 um.
    trial = bench.run(signal("square", frequency=0.5, duration=1.0, axes="x"))
    assert trial.record.position[-1, 0] == pytest.approx(13e-6, abs=1e-6)
    assert abs(trial.bias_shift[0]) < 0.5e-6


def test_a_rotor_that_falls_is_in_d(bench: TrialBench) -> None:
    trial = bench.run(signal("white_noise", amplitude=60e-6, duration=0.5))
    assert trial.region == Region.D
    assert np.isnan(trial.bias_shift).all()


def test_the_deviation_grows_with_the_amplitude_and_is_far_larger_along_the_weight(bench: TrialBench) -> None:
    small, large = (
        bench.run(signal("multisine", amplitude=amplitude, duration=1.0)).measures for amplitude in (10e-6, 20e-6)
    )
    assert large[1].deviation == pytest.approx(2.0 * small[1].deviation, rel=0.2)  # of even order
    assert large[1].deviation > 3.0 * large[0].deviation
    assert large[1].fit < small[1].fit < small[0].fit


def test_noise_of_the_sensors_is_no_deviation() -> None:
    excitation = signal("multisine", amplitude=2e-6, duration=1.0)
    quiet, noisy = (
        TrialBench(validate(PlantParameters, {"sensor.noise": noise}), ControllerParameters(), rest=0.5).run(excitation)
        for noise in (0.0, 0.05e-6)
    )
    for without, with_noise in zip(quiet.measures, noisy.measures, strict=True):
        assert with_noise.deviation == pytest.approx(without.deviation, abs=0.02)  # the noise is 5 % of the response


def test_a_rotor_that_falls_has_no_measures(bench: TrialBench) -> None:
    assert bench.run(signal("white_noise", amplitude=60e-6, duration=0.5)).measures == ()


def test_a_signal_at_another_rate_and_a_bearing_without_x_are_refused(bench: TrialBench) -> None:
    slow = generate(excitation_from_request("square", {"amplitude": 1e-6, "duration": 1.0}), 5_000.0)
    with pytest.raises(ExcitationError, match="sampled at 5000 Hz, the loop at 10000 Hz"):
        bench.run(slow)
    along_y = TrialBench(
        validate(PlantParameters, {"magnetic_circuit.actuators": "differential"}), ControllerParameters()
    )
    with pytest.raises(ExcitationError, match=r"axes = 'in_turn' is not allowed: .* pull along y only"):
        along_y.run(signal("square"))


# -- design


@pytest.mark.parametrize(
    ("kind", "values", "options", "message"),
    [
        ("sweep", {}, {}, "kind 'sweep' is not designed; allowed: square, multisine, prbs"),
        (
            "square",
            {"amplitude": 1e-6},
            {},
            "amplitude = 1e-06 m: the amplitude is what the design finds; leave it out",
        ),
        ("square", {}, {"margin": 0.0}, "margin = 0.0 is not allowed; it must be above 0, and 1 at most"),
        ("square", {}, {"tolerance": 2.0}, "tolerance = 2.0 is not allowed"),
        ("square", {}, {"model_order": 0}, "model_order = 0 is not allowed; it must be 1 or more"),
        ("square", {"axes": "both"}, {}, "x and y carry the same signal, so their effects cannot be separated"),
        ("square", {"axes": "z"}, {}, "axes = 'z' is not allowed; allowed: x, y, bearing_a"),
        ("multisine", {"frequency_end": 6_000.0}, {}, "frequency 6000 Hz is above the Nyquist frequency 5000 Hz"),
        (
            "multisine",
            {},
            {"model_order": 10},
            "identification would accept models of 6 states at most from its recording, not a model with 10 states",
        ),
    ],
)
def test_designs_that_cannot_be_are_refused_before_anything_is_simulated(
    kind: str, values: dict[str, Any], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ExcitationError, match=message):
        design_excitation(kind, {"duration": 1.0, **values}, MAP, **options)


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize(
    ("kind", "values"),
    [("square", {}), ("multisine", {}), ("multisine", {"axes": "y", "frequency_end": 1_000.0}), ("prbs", {})],
)
def test_the_designed_signal_is_within_the_limits_and_a_larger_one_is_not(
    bench: TrialBench, kind: str, values: dict[str, Any]
) -> None:
    designed = design_excitation(kind, {"duration": 1.0, **values}, MAP, tolerance=0.05)
    assert designed.verdict in repr(designed)
    assert f"<td>{1e6 * designed.amplitude:.5g} um</td>" in designed._repr_html_()
    assert designed.amplitude == pytest.approx(0.9 * designed.largest_amplitude)
    assert designed.largest_amplitude < designed.beyond_amplitude <= 1.05 * designed.largest_amplitude
    assert designed.trial.region == bench.run(designed.signal).region == Region.A
    assert len(designed.certificate.trials) == (1 if kind == "square" else 4)
    for measure in designed.certificate.worst:
        assert measure.deviation <= 0.05
        assert measure.fit >= 90.0
        assert max(measure.clipped, measure.slewed) <= 0.01
    assert (designed.distortion is not None) == (kind == "multisine")
    assert designed.distortion is None or designed.distortion.ratio.max() <= 0.05
    assert "limit" in designed.limited_by or "least" in designed.limited_by
    assert designed.limited_by in designed.verdict


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_limit_of_distortion_is_the_users() -> None:
    narrow, wide = (
        design_excitation(
            "multisine", {"duration": 1.0}, None, ControllerParameters(), PlantParameters(), tolerance=0.1,
            limits=Limits(distortion_limit=limit, least_fit=0.0),
        )
        for limit in (0.02, 0.04)
    )  # fmt: skip
    assert wide.amplitude == pytest.approx(2.0 * narrow.amplitude, rel=0.2)  # the distortion is of even order


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_model_from_the_designed_signal_predicts_a_smaller_motion(bench: TrialBench) -> None:
    # Noise on every rig determines the high orders; without any, identification refuses order 10 from this band.
    plant = validate(PlantParameters, {"sensor.noise": 0.01e-6})
    designed = design_excitation(
        "multisine", {"duration": 2.0}, None, ControllerParameters(), plant, model_order=10, tolerance=0.1
    )
    model = identify(excited_part(designed.trial, designed.signal), 10, controller=ControllerParameters()).model
    smaller = signal("multisine", amplitude=0.3 * designed.amplitude, duration=1.0, seed=7)
    recorded = excited_part(bench.run(smaller), smaller)
    simulated = simulate_closed_loop(model, ControllerParameters(), recorded.reference)
    predicted = simulated.position - simulated.position.mean(axis=0)
    assert nrmse_fit(recorded.position - recorded.position.mean(axis=0), predicted).min() >= 95.0


def excited_part(trial: Trial, excitation: ExcitationSignal) -> LoopRecord:
    return trial.record.window(trial.record.steps - excitation.steps, excitation.steps)


# -- the search


def test_the_search_finds_where_a_power_law_reaches_the_limit() -> None:
    tried: list[float] = []

    def use_of(amplitude: float) -> Use:
        tried.append(amplitude)
        return Use((amplitude / 3e-6) ** 1.5, f"{amplitude}")

    low, high, exceeded = largest_within(use_of, 1e-7, 1e-3, 0.02)
    assert low <= 3e-6 < high <= 1.02 * low
    assert exceeded == Use((high / 3e-6) ** 1.5, f"{high}")
    assert len(tried) < 10


def test_the_search_finds_a_limit_of_which_only_the_side_is_known() -> None:
    low, high, _ = largest_within(lambda amplitude: Use(np.inf if amplitude > 5e-6 else 0.0, ""), 1e-6, 1e-3, 0.02)
    assert low <= 5e-6 < high <= 1.02 * low


def test_the_search_ends_at_the_highest_amplitude() -> None:
    assert largest_within(lambda _: Use(0.1, ""), 1e-6, 1e-4, 0.02) == (1e-4, np.inf, None)


def test_a_limit_that_no_amplitude_keeps_is_not_put_down_to_nonlinearity() -> None:
    with pytest.raises(
        ExcitationError, match=r"no amplitude .* deviation: 7 %\. It is about the same at .*the linearised"
    ):
        largest_within(lambda _: Use(1.4, "deviation: 7 %"), 1e-6, 1e-4, 0.02)


# -- the command


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["excitation", *arguments])
    if isinstance(result.exception, AmbError):
        return 1, str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def test_check_writes_summary_and_figures(tmp_path: Path) -> None:
    code, output = run(
        "check", "white_noise", "--amplitude", "25e-6", "--map", str(MAP_FILE), "--out", str(tmp_path / "new")
    )
    assert code == 0, output
    summary = json.loads((tmp_path / "new" / "summary.json").read_text())
    checked = check_excitation(signal("white_noise", amplitude=25e-6, duration=4.0), MAP)
    assert summary["check"]["verdict"] == checked.verdict
    assert summary["check"]["predicted"] == "B"
    assert summary["parameters"]["amplitude"] == 25e-6
    assert {path.name for path in (tmp_path / "new").iterdir()} >= {"overlay.html", "overlay.png"}


def test_check_simulates_on_request(tmp_path: Path) -> None:
    code, output = run(
        "check", "square", "--amplitude", "20e-6", "--duration", "1", "--simulate",
        "--map", str(MAP_FILE), "--out", str(tmp_path),
    )  # fmt: skip
    assert code == 0, output
    assert "simulation: region A" in output
    assert json.loads((tmp_path / "summary.json").read_text())["trial"]["region"] == "A"


def test_a_signal_in_region_a_that_is_beyond_the_limits_of_a_design_is_told(tmp_path: Path) -> None:
    """40 um stay in A, yet the rotor's motion deviates from the linear response by more than the 5 % of a design."""
    code, output = run(
        "check", "multisine", "--amplitude", "40e-6", "--duration", "1", "--simulate",
        "--map", str(MAP_FILE), "--out", str(tmp_path),
    )  # fmt: skip
    assert code == 0, output
    assert "simulation: region A" in output
    assert "beyond the limits of a design: " in output
    summary = json.loads((tmp_path / "summary.json").read_text())["trial"]
    assert summary["region"] == "A"
    assert summary["beyond_limits"] is not None


@pytest.mark.parametrize("command", ["check", "design"])
def test_a_missing_map_is_told_with_the_way_to_make_one(tmp_path: Path, command: str) -> None:
    code, message = run(command, "square", "--map", str(tmp_path / "map.json"))
    assert code == 1
    assert message.endswith("map.json: there is no such file; `amb map` makes one (results/map/map.json)")


def test_a_file_that_is_no_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text("[]")
    code, message = run("check", "square", "--map", str(tmp_path / "map.json"))
    assert code == 1
    assert "is no region map" in message


def test_a_folder_that_cannot_be_made_is_told_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    code, message = run("design", "square", "--map", str(MAP_FILE), "--out", str(tmp_path / "file" / "out"))
    assert code == 1
    assert "cannot be made: Not a directory" in message


def test_check_without_simulation_does_not_speak_of_linearity(tmp_path: Path) -> None:
    code, output = run("check", "square", "--amplitude", "20e-6", "--map", str(MAP_FILE), "--out", str(tmp_path))
    assert code == 0, output
    assert "not simulated: the map knows regions, not distortion" in output
    assert "linear" not in output


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_design_writes_what_it_found(tmp_path: Path) -> None:
    code, output = run(
        "design", "multisine", "--duration", "1", "--tolerance", "0.1", "--map", str(MAP_FILE), "--out", str(tmp_path)
    )
    assert code == 0, output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["trial"]["region"] == "A"
    assert summary["parameters"]["phasing"] == "optimised"
    assert summary["amplitude"] == pytest.approx(0.9 * summary["largest_amplitude"], rel=1e-3)
    assert max(summary["distortion_upper_percent"].values()) <= 5.0
    assert summary["limited_by"] in summary["verdict"]
    # One answer: the prediction of the map is a number, and no advice to change the amplitude stands beside it.
    assert "check" not in summary
    assert "multiply" not in output and "multiplied" not in output
