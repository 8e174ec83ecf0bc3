"""`amb commission` and `amb rig up` as a user types them, on an emulated rig."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.graph.packages import find_executable
from amb_core.ground.files.parameter_files import RIG_NODES
from amb_core.linear.model import StateSpaceModel
from amb_core.recording import Recording
from amb_core.rig.link import AmbUdpLink, TargetState
from tests.graph.rig import PATIENT, config, free_port
from tests.served_emulator import ServedEmulator
from tests.unit.test_target_link import Listener, levitated

GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "commission-a-rig.md"
PARAMETERS, WRONG_SIGN = re.findall(r"^```yaml\n(.*?)^```$", GUIDE.read_text(), re.DOTALL | re.MULTILINE)

TIMEOUT = 540.0
LENIENT = ("--clock-drift", "1e7", "--most-missed", "1000000000", "--round-trip", "10", "--lost-share", "1")
"""What a machine that is slower than real time decides."""
SHORT = ("--observation", "0.5", "--sweep-duration", "4", "--multisine-duration", "3")


def parameters(folder: Path, addition: str = "", machine: Path | None = None, ideal: bool = True) -> Path:
    """The file of the guide, for an emulator slower than real time on a port of its own; ideal: no backup bearing."""
    port = free_port()
    content = yaml.safe_load(PARAMETERS)
    if machine is not None:
        described = yaml.safe_load(machine.read_text())
        described["/amb/simulator"]["ros__parameters"] |= content["/amb/simulator"]["ros__parameters"]
        content |= described
    emulator: dict[str, Any] = {
        "port": port,
        "real_time_factor": 0.4,
        "limits": {"missed_steps": 1e9, "host_time": 1e3},
        "plant_waits": True,
        "ideal": ideal,
    }
    if addition:
        emulator |= yaml.safe_load(addition)["/amb/target_emulator"]["ros__parameters"]
    content["/amb/target_emulator"] = {"ros__parameters": emulator}
    content["/amb/hardware_bridge"]["ros__parameters"]["link"] |= {"port": port} | PATIENT
    path = folder / "rig.yaml"
    path.write_text(re.sub(r": y$", ': "y"', yaml.safe_dump(content), flags=re.MULTILINE))  # a bare y is a bool in ROS
    return path


def commission(
    folder: Path, domain: int, path: Path, *durations: str, emulator: bool = True
) -> tuple[int, str, dict[str, Any]]:
    """Exit code, output and protocol."""
    command = [str(find_executable("amb_bringup", "amb")), "commission", "--yes", "--params", str(path)]
    command += ["--emulator"] * emulator
    command += ["--out", str(folder / "out"), *LENIENT, *(durations or SHORT), "--no-report"]
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "COLUMNS": "400"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=TIMEOUT)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stdout, json.loads((folder / "out" / "protocol.json").read_text())


@pytest.mark.timeout(600)
def test_it_leads_from_the_connection_to_the_identified_plant(tmp_path: Path, domain: int) -> None:
    code, said, protocol = commission(tmp_path, domain, parameters(tmp_path, ideal=False))
    results = {step["name"]: step["result"] for step in protocol["steps"]}
    skipped = {"emergency stop": "skipped", "map": "skipped"}
    done = (
        "wiring",
        "first lift",
        "connection",
        "sensors",
        "levitation",
        "polarity",
        "sweep",
        "identification",
        "protection",
        "landing",
    )
    assert results == dict.fromkeys(done, "passed") | skipped, said
    assert (code, protocol["result"]) == (0, "passed")
    values = {check["what"]: check["value"] for step in protocol["steps"] for check in step["checks"]}
    assert values["natural frequency of x"] == pytest.approx(62.7, rel=0.02)
    assert values["control current at rest of y"] == pytest.approx(1.363, abs=0.02)
    assert values["unstable poles of the plant"] == 2
    assert values["target"] == "off"
    assert len(protocol["about"]["SHA-256 of it"]) == 64
    out = tmp_path / "out"
    assert "No step failed. Skipped: emergency stop, map." in (out / "protocol.html").read_text()
    assert StateSpaceModel.load(out / "model.json").order >= 4  # of each axis two at least
    recording = Recording.read(out / "bag")
    assert not recording.truncated
    kinds = [item.kind for item in recording.excitations(recording.runs[-1])]
    assert [kind for kind in kinds if kind != "stop"] == ["square", "tones", "sweep", "multisine"]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_so_it_does_on_a_flexible_machine_of_four_axes(tmp_path: Path, domain: int) -> None:
    code, said, protocol = commission(
        tmp_path, domain, parameters(tmp_path, machine=config("flexible")), "--observation", "0.5", "--no-wiring"
    )
    results = {step["name"]: step["result"] for step in protocol["steps"]}
    assert {name for name, result in results.items() if result == "skipped"} == {"emergency stop", "map"}, said
    assert (code, protocol["result"]) == (0, "passed"), said
    values = {check["what"]: check["value"] for step in protocol["steps"] for check in step["checks"]}
    assert values["natural frequency of x_b"] == pytest.approx(65.3, rel=0.02)
    assert values["unstable poles of the plant"] == 4
    model = StateSpaceModel.load(tmp_path / "out" / "model.json")
    assert model.output_names == ("x_a", "y_a", "x_b", "y_b")


def test_a_sensor_with_the_wrong_sign_is_named_before_the_first_lift_off(tmp_path: Path, domain: int) -> None:
    code, said, protocol = commission(tmp_path, domain, parameters(tmp_path, WRONG_SIGN, ideal=False))
    results = {step["name"]: step for step in protocol["steps"]}
    assert code == 3
    assert results["wiring"]["result"] == "failed", said
    assert "reversed of y" in results["wiring"]["reason"]
    assert {step["result"] for name, step in results.items() if name != "wiring"} == {"skipped"}
    assert "the currents were off" in results["landing"]["reason"]


@pytest.mark.parametrize(("option", "first"), [("--wiring", "wiring"), ("--no-wiring", "connection")])
def test_a_rotor_that_another_host_levitates_is_refused_and_left_as_it_is(
    tmp_path: Path, domain: int, option: str, first: str
) -> None:
    with ServedEmulator() as served:
        other, listener = AmbUdpLink(port=served.port, timeout=60.0, silence=60.0), Listener()
        levitated(other, listener)
        path = tmp_path / "rig.yaml"
        content = yaml.safe_load(PARAMETERS)
        content["/amb/hardware_bridge"]["ros__parameters"]["link"] |= {"port": served.port} | PATIENT
        path.write_text(yaml.safe_dump(content))
        code, said, protocol = commission(tmp_path, domain, path, *SHORT, option, emulator=False)
        results = {step["name"]: step for step in protocol["steps"]}
        assert code == 3, said
        assert results[first]["reason"] == "the rotor is levitated already; land it first"
        assert results["landing"]["reason"] == "another host levitates the rotor; it is left as it is"
        assert other.status().state is TargetState.LEVITATED
        listener.wait_for_step(other.status().step + 2_000)
        assert other.count.samples.lost == 0, "its telemetry was taken away"
        assert not (tmp_path / "out" / "bag").exists()
        other.close()


def test_without_that_step_it_is_named_by_how_the_rotor_runs_away(tmp_path: Path, domain: int) -> None:
    code, said, protocol = commission(tmp_path, domain, parameters(tmp_path, WRONG_SIGN), *SHORT, "--no-wiring")
    results = {step["name"]: step for step in protocol["steps"]}
    assert code == 3
    assert results["levitation"]["result"] == "failed", said
    assert (
        "y ran upwards, so it was not the weight; its sensor or its coils have the wrong sign"
        in (results["levitation"]["reason"])
    )
    assert [results[name]["result"] for name in ("polarity", "sweep", "identification")] == ["skipped"] * 3
    assert results["landing"]["result"] == "passed"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_lands_when_it_is_interrupted(tmp_path: Path, domain: int, number: signal.Signals) -> None:
    command = [str(find_executable("amb_bringup", "amb")), "commission", "--emulator", "--yes", "--no-report"]
    command += [
        "--params",
        str(parameters(tmp_path)),
        "--out",
        str(tmp_path / "out"),
        *LENIENT,
        "--observation",
        "0.5",
        "--no-wiring",
    ]
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, start_new_session=True
    )
    assert process.stdout is not None
    next(line for line in process.stdout if line.startswith("Polarity"))
    process.send_signal(number)
    rest, _ = process.communicate(timeout=TIMEOUT)
    assert "Traceback" not in rest, rest
    assert process.returncode == 130, rest
    steps = {step["name"]: step for step in json.loads((tmp_path / "out" / "protocol.json").read_text())["steps"]}
    assert steps["polarity"]["reason"] == "interrupted"
    assert steps["landing"]["result"] == "passed"
    assert steps["landing"]["checks"][0]["value"] == "off"


def test_rig_up_shows_what_to_call_next_and_refuses_what_needs_a_simulator(tmp_path: Path, domain: int) -> None:
    amb = str(find_executable("amb_bringup", "amb"))
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        [amb, "rig", "up", "--emulator", "--params", str(parameters(tmp_path))],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment, start_new_session=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        ready = next(line for line in process.stdout if line.startswith("amb: ready"))
        assert "5 nodes; not connected to the target yet" in ready
        for _ in ("amb rig connect", "amb rig levitate"):
            hint = process.stdout.readline().strip()
            answer = subprocess.run(hint, shell=True, capture_output=True, text=True, timeout=TIMEOUT, env=environment)
            assert answer.returncode == 0, answer.stderr
        assert "levitated: run" in answer.stdout
        with AmbClient(domain_id=domain, nodes=RIG_NODES) as client:
            with pytest.raises(ClientError, match="/amb/simulator/run needs a simulator; this graph has a rig"):
                client.run(100)
            with pytest.raises(ClientError, match="the running machine 'point_mass' is a rig"):
                client.build_map()
    finally:
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=TIMEOUT)
    assert "Traceback" not in rest, rest
    assert process.returncode == 0, rest
