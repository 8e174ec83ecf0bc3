"""Wrong options are refused before anything is read, computed or started."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.client.experiment import Experiment
from amb_bringup.experiments.experiment_session import require_playable
from amb_core.excitation import excitation_from_request
from amb_core.ground.errors import AmbError, ExcitationError

NOWHERE = "no_such_bag"
PAPER_MAP = Path(__file__).parent / "data" / "paper_map.json"


def refusal(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert isinstance(result.exception, AmbError), result.output
    return str(result.exception)


@pytest.mark.parametrize(
    ("option", "value", "reason"),
    [("--method", "subspace", "pem, ssarx"), ("--focus", "control", "prediction"), ("--drift", "some", "prefilter")],
)
def test_a_wrong_word_is_refused_before_the_data_are_read(option: str, value: str, reason: str) -> None:
    """There are no data: a message on them would mean that they were asked for first."""
    message = refusal("identify", NOWHERE, option, value)
    assert value in message and reason in message


@pytest.mark.parametrize(
    "command", [("identify", NOWHERE), ("validate", "no_model.json", NOWHERE), ("report", NOWHERE)]
)
def test_a_place_that_cannot_be_written_is_refused_before_the_data_are_read(command: tuple[str, ...]) -> None:
    """Nobody, not even root, can make a file in /proc."""
    ending = {"identify": "model.json", "report": "report.html"}
    out = Path("/proc") / ending.get(command[0], "") if command[0] in ending else Path("/proc/self/fdinfo")
    assert "cannot be written to" in refusal(*command, "--out", out, "--overwrite")


@pytest.mark.parametrize(
    "command",
    [
        ("commission", "--yes", "--emulator"),
        ("rig", "up", "--emulator"),
        ("rig", "demo"),
        ("experiment", "multisine", "--amplitude", "1um", "--rig", "--emulator"),
    ],
)
@pytest.mark.parametrize("address", ["192.0.2.7", "serial:/dev/ttyACM0"])
def test_an_emulated_target_beside_a_link_to_a_rig_is_refused(
    command: tuple[str, ...], address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "rig.yaml"
    path.write_text(f"/amb/hardware_bridge:\n  ros__parameters:\n    link: {{address: '{address}'}}\n")
    assert f"link.address = '{address}' is not allowed with an emulated target" in refusal(*command, "--params", path)


@pytest.mark.parametrize("given", [("sweep", "--frequency-start"), ("square", "--frequency"), ("square", "--duration")])
def test_a_zero_is_not_taken_for_the_default(given: tuple[str, str], tmp_path: Path) -> None:
    kind, option = given
    name = option[2:].replace("-", "_")
    for command in (
        ("experiment", kind, "--amplitude", "1um"),
        ("excitation", "check", kind, "--amplitude", "1um", "--map", PAPER_MAP),
        *([("excitation", "design", kind, "--map", PAPER_MAP)] if kind == "square" else []),
    ):
        assert f"'{name}' = 0.0 is not allowed" in refusal(*command, option, "0", "--out", tmp_path / "out")


@pytest.mark.parametrize("command", [("check", "prbs", "--amplitude", "1um"), ("design", "prbs")])
def test_a_check_or_design_for_a_machine_of_other_axes_is_refused(command: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("/amb/simulator: {ros__parameters: {rotor: {model: rigid}}}\n")
    message = refusal("excitation", *command, "--map", PAPER_MAP, "--params", path, "--out", tmp_path / "out")
    assert message.startswith("the machine has the axes x_a, y_a, x_b, y_b; a check or design")


def test_an_excitation_that_the_simulator_would_refuse_is_refused_without_it() -> None:
    band = {"amplitude": 1e-6, "duration": 1.0, "frequency_end": 50e3}
    too_high = Experiment("one", excitation_from_request("multisine", band))
    with pytest.raises(ExcitationError, match="above the Nyquist frequency 5000 Hz"):
        require_playable([too_high], None)
    require_playable([Experiment("one", excitation_from_request("multisine", band | {"frequency_end": 5e3}))], None)
