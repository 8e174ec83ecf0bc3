"""The service `identifier/certify`: certificates of the last identification and of files, as `amb certify` has them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.client import AmbClient, ClientError
from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.state_space_model import model_from_message
from amb_core.robustness import RobustnessSettings
from amb_msgs.srv import Certify, GetModel
from tests.graph.identifier_loop import FIRST_STEP, PAPER, STEPS, Loop, linear_loop
from tests.unit.test_recording_report import write_bag

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

FEW = 60.0  # frequencies of the curves, for quick answers
NUMBERS = ("peak_sensitivity", "peak_complementary", "gain_margin_up", "phase_margin", "delay_margin", "disk_margin")


@pytest.fixture(scope="module")
def record() -> LoopRecord:
    return linear_loop(STEPS)


@pytest.fixture
def loop(share: Callable[..., Any]) -> Loop:
    return share(Loop, lambda made: made.process.poll() is None)


@pytest.fixture
def model(loop: Loop, record: LoopRecord, tmp_path: Path) -> Path:
    """The file of the last model."""
    path = tmp_path / "model.json"
    model_from_message(loop.model(record)).save(path)
    return path


def test_the_request_has_the_settings_of_the_certificate_with_their_defaults() -> None:
    request = Certify.Request()
    settings = RobustnessSettings().model_dump()
    assert {name: getattr(request, name) for name in settings} == settings


def test_without_a_model_the_answer_says_so(graph: Graph) -> None:
    loop = Loop(graph)
    answer = loop.certify()
    assert not answer.success
    assert "no model has been identified yet" in answer.message


def test_the_last_identification_gets_margins_bounds_and_a_verdict(loop: Loop, record: LoopRecord) -> None:
    loop.model(record)
    answer = loop.certify(frequencies=FEW)
    assert answer.success, answer.message
    assert answer.axes == ["x", "y"]
    for name in NUMBERS:
        assert len(getattr(answer, name)) == 2
    assert (np.array(answer.sensitivity_bound) >= np.array(answer.peak_sensitivity)).all()
    assert len(answer.zone_bound) == 2
    assert answer.mu_lower <= answer.mu_upper
    written = json.loads(answer.certificate)
    assert written["certified"] == answer.certified == (not answer.reasons)
    assert written["statement"] == answer.statement
    assert written["verdict"] == answer.verdict == answer.message
    assert any("samples of the identification" in text for text in answer.warnings)
    assert {name.split()[0] for name in written["inputs"]} == {"model", "data", "controller"}


def test_the_answer_is_that_of_the_command(loop: Loop, record: LoopRecord, model: Path, tmp_path: Path) -> None:
    bag, out, by_command = write_bag(tmp_path / "bag", excited(record)), tmp_path / "node", tmp_path / "command"
    files = {"model": str(model), "bag": str(bag), "controller": PAPER}
    answer = loop.certify(**files, frequencies=FEW, out=str(out), machine="blower 3")
    assert answer.success, answer.message
    assert Path(answer.page) == out / "certificate.html"
    words = ["certify", model, "--bag", bag, "--controller", PAPER, "--frequencies", FEW, "--out", by_command]
    words += ["--machine", "blower 3"]
    CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    ours, theirs = (json.loads((place / "certificate.json").read_text()) for place in (out, by_command))
    for one in (ours, theirs):
        one.pop("made")  # at different times
    assert ours == theirs


def excited(record: LoopRecord) -> LoopRecord:
    return record.window(FIRST_STEP, record.steps - FIRST_STEP)


def test_a_model_without_data_is_not_certified_and_the_reason_is_that_of_the_command(loop: Loop, model: Path) -> None:
    answer = loop.certify(model=str(model), controller=PAPER, frequencies=FEW)
    assert answer.success
    assert not answer.certified
    assert "the model was not validated" in answer.verdict
    assert answer.peak_sensitivity
    assert not answer.sensitivity_bound
    assert math.isnan(answer.nu_gap)


def test_an_unstable_loop_ends_at_that_check(loop: Loop, record: LoopRecord) -> None:
    loop.model(record)
    answer = loop.certify(controller="pd:100,0.1", frequencies=FEW)
    assert answer.success
    assert not answer.certified
    assert "the closed loop of model and controller is not stable" in answer.verdict
    assert not answer.axes
    assert math.isnan(answer.mu_upper)


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        ({"bag": "/nowhere"}, "bag /nowhere: there is no such file or folder"),
        ({"actuator": math.nan}, "actuator"),
        ({"confidence": 1.5}, "confidence"),
        ({"needed_zone": "D"}, "needed_zone"),
        ({"zone_a": 5.0, "zone_b": 4.0}, "must rise"),
        ({"on_telemetry": True, "validation_bag": "/tmp"}, "give one of the two"),
        ({"first_step": 3}, "set on_telemetry"),
        ({"controller": "nobody"}, "nobody"),
        ({"out": "/proc/certificate"}, "cannot be"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_an_impossible_request_is_refused_with_the_reason(
    loop: Loop, record: LoopRecord, request_: dict[str, Any], reason: str
) -> None:
    loop.model(record)
    answer = loop.certify(**{"frequencies": FEW, **request_})
    assert not answer.success
    assert reason in answer.message
    assert "\n" not in answer.message


def test_the_node_answers_while_it_certifies(loop: Loop, record: LoopRecord) -> None:
    loop.model(record)
    client = loop.graph.node.create_client(Certify, "/amb/identifier/certify")
    loop.graph.wait_until(client.service_is_ready, "the service")
    ends = [client.call_async(Certify.Request()) for _ in range(3)]
    assert loop.graph.call(GetModel, "/amb/identifier/get_model").success
    assert not all(end.done() for end in ends)
    loop.graph.wait_until(lambda: all(end.done() for end in ends), "the certificates")
    assert all(end.result().success for end in ends)


def test_the_client_certifies_on_another_experiment(loop: Loop, record: LoopRecord, tmp_path: Path) -> None:
    loop.model(record)
    loop.publish(linear_loop(STEPS, seed=2))
    with AmbClient(domain_id=loop.graph.domain) as amb:
        answer = amb.certify(
            PAPER, on_telemetry=True, experiment_controller=PAPER, out=tmp_path / "out", frequencies=FEW
        )
        with pytest.raises(ClientError, match="unknown setting 'sensors'"):
            amb.certify(sensors=0.1)
    assert not any("samples of the identification" in text for text in answer.warnings)
    assert Path(answer.page).is_file()
