"""Where the linear controller of an experiment comes from: a file, a parameter file, or the bag."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis import read
from amb_core.data.controller_choice import named_controller
from amb_core.data.experiments import write_data
from amb_core.ground.errors import AmbError, ParameterError
from amb_core.identification import IdentificationData, StateSpaceModel, identify
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.recording import Recording
from amb_core.recording.messages.state_space_model import fill_model
from tests.bag_messages import PARAMETERS, TELEMETRY, TYPES, telemetry
from tests.lqg_loop import SAMPLE_TIME, linear_law, rotor

MODEL = "amb_msgs/msg/StateSpaceModel"
LIMIT = 2.5  # A


@pytest.fixture(scope="module")
def law() -> StateSpaceModel:
    return rotor(2).lqg()


@pytest.fixture(scope="module")
def record(law: StateSpaceModel) -> LoopRecord:
    return rotor(2).record(linear_law(law, 2, LIMIT), 4_000)


@pytest.fixture
def file(law: StateSpaceModel, tmp_path: Path) -> Path:
    law.save(tmp_path / "lqg.json")
    return tmp_path / "lqg.json"


def parameters(node: str, **values: object) -> bytes:
    """A serialized ParameterEvent with parameters of a node."""
    kinds = {float: (3, "double_value"), str: (4, "string_value"), int: (2, "integer_value")}
    own = []
    for name, value in values.items():
        kind, place = kinds[type(value)]
        content: dict[str, Any] = {
            "type": kind, "bool_value": False, "integer_value": 0, "double_value": 0.0, "string_value": "",
            "byte_array_value": np.zeros(0, np.uint8), "bool_array_value": np.zeros(0, bool),
            "integer_array_value": np.zeros(0, np.int64), "double_array_value": np.zeros(0),
            "string_array_value": [], place: value,
        }  # fmt: skip
        own.append(
            TYPES.types["rcl_interfaces/msg/Parameter"](
                name, TYPES.types["rcl_interfaces/msg/ParameterValue"](**content)
            )
        )
    stamp = TYPES.types["builtin_interfaces/msg/Time"](0, 0)
    return bytes(TYPES.serialize_cdr(TYPES.types[PARAMETERS](stamp, f"/amb/{node}", own, [], []), PARAMETERS))


def published(model: StateSpaceModel) -> bytes:
    """A serialized StateSpaceModel."""
    header = TYPES.types["std_msgs/msg/Header"](TYPES.types["builtin_interfaces/msg/Time"](0, 0), "")
    message = TYPES.types[MODEL].__new__(TYPES.types[MODEL])
    for name in TYPES.types[MODEL].__dataclass_fields__:
        object.__setattr__(message, name, 0)
    message.header = header
    fill_model(message, model)
    for name in (
        "a",
        "b",
        "c",
        "d",
        "k",
        "innovation_covariance",
        "input_offset",
        "output_offset",
        "initial_state",
        "fit",
        "fingerprint",
        "search",
    ):
        setattr(message, name, np.asarray(getattr(message, name)))
    return bytes(TYPES.serialize_cdr(message, MODEL))


def bag(folder: Path, messages: list[tuple[str, str, bytes]]) -> Path:
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for number, (topic, kind, content) in enumerate(messages):
            connection = next((known for known in writer.connections if known.topic == topic), None)
            connection = connection or writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connection, number, content)
    return folder


def test_a_bag_with_a_published_controller_is_identified(
    law: StateSpaceModel, record: LoopRecord, tmp_path: Path
) -> None:
    """The topic has the type of the identified model, which is on another topic of the same bag."""
    another = rotor(2).model
    folder = bag(
        tmp_path / "bag",
        [
            ("/amb/telemetry", TELEMETRY, telemetry(record)),
            ("/amb/model", MODEL, published(another)),
            ("/amb/controller", MODEL, published(law)),
            (
                "/parameter_events",
                PARAMETERS,
                parameters("state_space_controller", current_limit=LIMIT, controller_file=""),
            ),
        ],
    )
    loop = read(folder)
    assert loop.controller == LinearControl(law, LinearControllerParameters(current_limit=LIMIT))
    assert identify(loop.data, 6, "ssarx", loop.controller).model.fit.min() > 95.0


def test_a_run_has_the_controller_that_was_published_before_it(
    law: StateSpaceModel, record: LoopRecord, tmp_path: Path
) -> None:
    laws = {1: law, 2: rotor(2).model}
    messages = [
        message
        for run, model in laws.items()
        for message in (
            ("/amb/controller", MODEL, published(model)),
            ("/amb/telemetry", TELEMETRY, telemetry(record, run)),
        )
    ]
    recording = Recording.read(bag(tmp_path / "bag", messages))
    for run, model in [*laws.items(), (None, laws[2])]:
        np.testing.assert_array_equal(recording.published_controller(run).a, model.a)


def test_a_bag_names_the_file_of_its_controller(record: LoopRecord, file: Path, tmp_path: Path) -> None:
    own = parameters("state_space_controller", current_limit=LIMIT, controller_file=str(file))
    folder = bag(
        tmp_path / "bag",
        [("/amb/telemetry", TELEMETRY, telemetry(record)), ("/parameter_events", PARAMETERS, own)],
    )
    controller = read(folder).controller
    assert isinstance(controller, LinearControl) and controller.current_limit == LIMIT
    moved = file.rename(tmp_path / "moved.json")
    with pytest.raises(ParameterError, match=r"^controller model .*lqg.json"):
        read(folder)
    # Named by the user, it keeps the limit of the recording.
    assert read(folder, controller=str(moved)).controller == controller


def test_a_bag_of_two_controllers_does_not_show_which_of_them_ran(
    record: LoopRecord, file: Path, tmp_path: Path
) -> None:
    both = [
        parameters("state_space_controller", current_limit=LIMIT, controller_file=str(file)),
        parameters("pd_controller", current_limit=3.0, proportional_gain=2e4),
    ]
    folder = bag(
        tmp_path / "bag",
        [("/amb/telemetry", TELEMETRY, telemetry(record)), *(("/parameter_events", PARAMETERS, own) for own in both)],
    )
    assert read(folder).controller is None


def test_a_parameter_file_names_a_linear_controller_or_has_a_pd_one(file: Path, tmp_path: Path) -> None:
    path = tmp_path / "loop.yaml"
    linear = f"/amb/state_space_controller:\n  ros__parameters: {{controller_file: {file.name}, current_limit: 2.0}}\n"
    path.write_text(linear)
    law = named_controller(str(path), sample_rate=1.0 / SAMPLE_TIME)
    assert isinstance(law, LinearControl) and law.current_limit == 2.0
    path.write_text(linear + "/amb/pd_controller:\n  ros__parameters: {proportional_gain: 15000.0}\n")
    with pytest.raises(
        ParameterError, match=r"has two controllers, pd_controller and state_space_controller; name the"
    ):
        named_controller(str(path))
    path.write_text("/amb/pd_controller:\n  ros__parameters: {proportional_gain: 15000.0}\n")
    assert named_controller(str(path)).current_limit == 3.0


def amb(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "160"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output


@pytest.mark.parametrize("ending", ["csv", "mat", "npz"])
def test_data_files_are_identified_and_validated_with_the_file_of_the_controller(
    record: LoopRecord, file: Path, tmp_path: Path, ending: str
) -> None:
    data = tmp_path / f"data.{ending}"
    write_data(IdentificationData.from_record(record), data)
    model, results = tmp_path / "model.json", tmp_path / "results.json"
    options = ("--controller", file, "--order", 6, "--method", "ssarx")
    amb("identify", data, *options, "--out", model, "--results", results)
    summary = json.loads(results.read_text())
    assert summary["closed_loop_stable"] and min(summary["fit"].values()) > 95.0
    report = amb("validate", model, data, "--controller", file)
    assert "validated" in report and "does not compute" not in report


def test_what_is_no_controller_of_the_data_is_refused_in_one_line(
    record: LoopRecord, file: Path, tmp_path: Path
) -> None:
    data = tmp_path / "data.npz"
    write_data(IdentificationData.from_record(record), data)
    rotor(4).lqg().save(tmp_path / "four.json")
    (tmp_path / "slow.json").write_text(file.read_text().replace("0.0001", "0.0002"))
    (tmp_path / "text.json").write_text("{}")
    for name, message in (
        (
            "four.json",
            "^the controller has 4 inputs and 4 outputs, the machine 2 axes; allowed: 2 outputs, and 2 inputs",
        ),
        (
            "slow.json",
            "^the controller is made for 5000 Hz, the data are sampled at 10000 Hz; give the controller with",
        ),
        ("text.json", "^controller model .*text.json: lacks A, B, C, D, Ts"),
        ("nowhere.json", "^controller model .*nowhere.json: "),
        (
            "controller.txt",
            r"^controller = '.*' is not allowed; allowed: paper, pd:K_P,K_D in A/m and A s/m .*, a ROS parameter file ",
        ),
    ):
        with pytest.raises(AmbError, match=message) as caught:
            amb("identify", data, "--controller", tmp_path / name, "--order", 6)
        assert "\n" not in str(caught.value)
