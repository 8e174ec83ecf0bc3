"""Campbell diagram by identification: settings that follow the machine, the command, and what it keeps and reports."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import AmbError, ParameterError, PlantError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, RotorParameters
from amb_core.rig.running_speeds import SpeedSettings, SpeedTask, identify_over_speeds
from amb_core.rig.running_speeds.speed_run import run_speed

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"
POINT_MASS = PlantParameters(rotor=RotorParameters(gravity=0.0))
QUICK = SpeedSettings(period=0.1, frequency_start=10.0, settling=0.05)


def test_settings_follow_the_machine_unless_they_are_given():
    machine = Plant(POINT_MASS).machine
    by_default = SpeedSettings().multisine(POINT_MASS, machine)
    assert (by_default.amplitude, by_default.frequency_end, by_default.duration) == (1.5e-6, 600.0, 2.0)
    given = SpeedSettings(frequency_end=1200.0, amplitude=1e-6, period=0.1).multisine(POINT_MASS, machine)
    assert (given.amplitude, given.frequency_end, given.duration) == (1e-6, 1200.0, 0.4)
    assert SpeedSettings(frequency_end=1200.0).multisine(POINT_MASS, machine).amplitude == pytest.approx(0.75e-6)
    assert SpeedSettings().model_order(POINT_MASS) == 6
    assert SpeedSettings(order=8).model_order(POINT_MASS) == 8


def test_an_empty_band_is_refused():
    with pytest.raises(ValueError, match="the band 50 Hz to 20 Hz is empty"):
        SpeedSettings(frequency_start=50.0, frequency_end=20.0)


def test_a_model_survives_the_cache_without_loss():
    task = SpeedTask(QUICK, POINT_MASS, ControllerParameters())
    model = task.run()
    kept = SpeedTask.from_json(json.loads(json.dumps(SpeedTask.to_json(model))))
    assert np.array_equal(kept.a, model.a)
    assert np.array_equal(kept.fit, model.fit)
    with pytest.raises(ValueError, match="expected the fields"):
        SpeedTask.from_json({})


def test_few_samples_give_a_model_of_the_order_that_they_determine():
    """80 samples: order 6 of a point mass takes 84."""
    plant = validate(PlantParameters, {"rotor.gravity": 0.0, "integration.sample_rate": 2000.0})
    controller = ControllerParameters(sample_rate=2000.0, derivative_gain=45.0)
    settings = SpeedSettings(period=0.02, periods=1, frequency_start=50.0)
    assert settings.model_order(plant) == 6
    assert 1 <= run_speed(SpeedTask(settings, plant, controller)).order < 6


def test_tasks_differ_by_running_speed_alone():
    keys = {
        SpeedTask(QUICK, PlantParameters(rotor=RotorParameters(running_speed=speed)), ControllerParameters()).key()
        for speed in (0.0, 50.0, 50.0)
    }
    assert len(keys) == 2


@pytest.mark.parametrize("speeds", [[], [10.0, 5.0]])
def test_speeds_must_ascend(speeds):
    with pytest.raises(PlantError, match="needed: at least one, ascending"):
        identify_over_speeds(POINT_MASS, ControllerParameters(), speeds)


def test_a_wrong_list_of_speeds_is_refused():
    result = CliRunner().invoke(app, ["campbell", "--at", "0,fast"])
    assert isinstance(result.exception, ParameterError)
    assert "--at 0,fast: must be running speeds in rpm" in str(result.exception)


def test_the_command_draws_and_lists_identified_over_computed_modes(tmp_path):
    """One bearing with a point mass: both modes of the loop within 0.5 %."""
    arguments = [
        "campbell",
        "--at",
        "3000",
        "--order",
        "4",
        "--period",
        "0.1",
        "--frequency-start",
        "10",
        "--set",
        "rotor.gravity=0",
    ]
    arguments += ["--workers", "1", "--cache", str(tmp_path / "cache"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    out = tmp_path / "out"
    assert {"campbell.png", "campbell.html", "modes.csv", "summary.json"} < {path.name for path in out.iterdir()}
    summary = json.loads((out / "summary.json").read_text())
    assert [entry["rpm"] for entry in summary["speeds"]] == [3000.0]
    assert summary["largest_frequency_error_percent"] < 0.5
    assert all(len(entry["modes"]) == 2 and not entry["missing"] for entry in summary["speeds"])
    rows = list(csv.DictReader((out / "modes.csv").open()))
    assert {row["rpm"] for row in rows} == {"3000.0"}
    assert len(list((tmp_path / "cache").iterdir())) == 1


@pytest.mark.slow
def test_speeds_without_a_model_are_reported_with_the_reason(tmp_path):
    """A multisine beyond the backup bearing: the rotor delevitates at every speed."""
    settings = SpeedSettings(amplitude=900e-6, frequency_end=100.0, period=0.1, frequency_start=10.0)
    with pytest.raises(PlantError, match=r"no running speed gives a model; at 0 rpm: .*delevitates"):
        identify_over_speeds(POINT_MASS, ControllerParameters(), [0.0], settings, cache=tmp_path, workers=1)


def test_a_cancelled_run_returns_nothing(tmp_path):
    diagram = identify_over_speeds(
        POINT_MASS, ControllerParameters(), [0.0], QUICK, cache=tmp_path, workers=1, cancelled=lambda: True
    )
    assert diagram is None


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("name", "within"), [("rig", 1.0), ("flexible", 1.0)])
def test_modes_of_machines_are_identified_at_speed(name, within, tmp_path):
    """Rigid modes within a percent, bending within half a percent; every computed mode is found."""
    arguments = ["campbell", "--at", "6000", "--params", str(CONFIG / f"{name}.yaml"), "--workers", "1"]
    result = CliRunner().invoke(app, [*arguments, "--cache", str(tmp_path / "cache"), "--out", str(tmp_path)])
    if isinstance(result.exception, AmbError):
        raise result.exception
    assert result.exit_code == 0, result.output
    (entry,) = json.loads((tmp_path / "summary.json").read_text())["speeds"]
    assert entry["missing"] == []
    assert entry["largest_frequency_error_percent"] < within
    bending = [abs(mode["frequency_error_percent"]) for mode in entry["modes"] if mode["kind"] == "bending"]
    assert max(bending, default=0.0) < 0.5
    assert all(mode["computed_whirl"] == mode["identified_whirl"] for mode in entry["modes"] if mode["kind"] in
               ("nutation", "precession", "bending"))  # fmt: skip
