"""Excitation design: persistence of excitation, trials in simulation, and the largest amplitude in region A."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.errors import AmbError, ExcitationError
from amb_core.excitation import ExcitationSignal, excitation_from_request, generate
from amb_core.excitation_design import TrialBench, check_excitation, design_excitation, persistence
from amb_core.loop.control import ControllerParameters
from amb_core.parameters import validate
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import RegionMap

RATE = 10_000.0
MAP_FILE = Path(__file__).parent / "data" / "paper_map.json"
MAP = RegionMap.load(MAP_FILE)


def signal(kind: str, **values: Any) -> ExcitationSignal:
    return generate(excitation_from_request(kind, {"amplitude": 10e-6, "duration": 2.0, **values}), RATE)


# -- persistence of excitation


@pytest.mark.parametrize(
    ("values", "lines", "order"),
    [
        # 11 to 20 Hz in steps of 0.5 Hz are 19 lines; each counts twice, and serves one axis where both share it.
        ({"axes": "y"}, (19,), 38),
        ({"axes": "both"}, (19, 19), 19),
        ({"axes": "both", "interleaved": True}, (10, 9), 18),
        ({"axes": "in_turn"}, (10, 10), 20),  # half the time, half the lines
    ],
)
def test_a_multisine_excites_persistently_of_twice_the_number_of_its_lines(
    values: dict[str, Any], lines: tuple[int, ...], order: int
) -> None:
    found = persistence(signal("multisine", frequency_start=11.0, frequency_end=20.0, **values), model_order=9)
    assert (found.lines, found.order, found.wanted) == (lines, order, 18)
    assert found.sufficient


def test_the_same_signal_on_both_axes_cannot_tell_them_apart() -> None:
    assert persistence(signal("square", axes="both"), 1).order == 0
    assert not persistence(signal("square", axes="both"), 1).sufficient


def test_a_square_wave_has_fifty_lines_of_one_percent_or_more() -> None:
    assert persistence(signal("square", duration=4.0), 10).lines == (50, 50)


@pytest.mark.parametrize(("frequency", "lines"), [(5.0, 50), (1250.0, 2)])
def test_a_square_that_ends_within_a_period_has_no_more_lines_than_one_of_whole_periods(
    frequency: float, lines: int
) -> None:
    assert persistence(signal("square", frequency=frequency, duration=4.1007), 10).lines == (lines, lines)


def test_a_square_without_an_edge_determines_nothing() -> None:
    assert persistence(signal("square", duration=0.01), 1).order == 0


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
        (
            "square",
            {"duration": 0.01},
            {},
            "square: persistently exciting of order 0, but a model with 10 states needs",
        ),
        ("square", {"axes": "z"}, {}, "'axes' = 'z' is not allowed; allowed: one of x, y, both, in_turn"),
        ("multisine", {"frequency_end": 6_000.0}, {}, "frequency 6000 Hz is above the Nyquist frequency 5000 Hz"),
        (
            "multisine",
            {"frequency_end": 12.0},
            {},
            "persistently exciting of order 2, but a model with 10 states needs 20; lengthen the duration or widen",
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
    [("square", {}), ("multisine", {}), ("multisine", {"axes": "y", "frequency_end": 2_000.0}), ("prbs", {})],
)
def test_the_designed_signal_is_in_a_and_a_larger_one_is_not(
    bench: TrialBench, kind: str, values: dict[str, Any]
) -> None:
    designed = design_excitation(kind, {"duration": 2.0, **values}, MAP, margin=0.9, tolerance=0.05)
    fields = designed.signal.parameters.model_dump()
    assert designed.amplitude == pytest.approx(0.9 * designed.largest_amplitude)
    assert bench.run(designed.signal).region == designed.trial.region == Region.A
    larger = excitation_from_request(kind, {**fields, "amplitude": 1.06 * designed.largest_amplitude})
    assert bench.run(generate(larger, RATE)).region > Region.A
    assert designed.largest_amplitude < designed.beyond_amplitude <= 1.05 * designed.largest_amplitude
    assert designed.persistence.sufficient
    # What the map says is near what the simulation finds: docs/excitation.md has the numbers.
    assert 0.6 < designed.predicted_amplitude / designed.largest_amplitude < 1.8


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
    found = check_excitation(signal("white_noise", amplitude=25e-6, duration=4.0), MAP)
    assert summary["check"]["verdict"] == found.verdict
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


@pytest.mark.slow
def test_design_writes_what_it_found(tmp_path: Path) -> None:
    code, output = run(
        "design", "multisine", "--duration", "1", "--tolerance", "0.1", "--map", str(MAP_FILE), "--out", str(tmp_path)
    )
    assert code == 0, output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["trial"]["region"] == "A"
    assert summary["parameters"]["phasing"] == "optimised"
    assert summary["check"]["axes"]["y"]["crest_factor"] < 1.5
    assert summary["amplitude_um"] == pytest.approx(0.9 * summary["largest_amplitude_um"], rel=1e-3)
