"""The hardware bridge in mode host: a controller node closes the loop of an emulated rig over topics."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from amb_bringup.demos.demo_run import controller_of, plant_of
from amb_core.excitation import Square, generate
from amb_core.loop.control import PdController
from amb_core.plant.simulation import simulate
from amb_msgs.msg import BridgeState, CurrentReference, Trip
from amb_ros.qos import STREAM
from tests.fuzz.hostile import DELIVERED
from tests.graph.conftest import Graph
from tests.graph.processes import NodeProcess
from tests.graph.rig import Rig, config
from tests.unit.test_link_example import write_example

CONTROLLER, GENERATOR = "amb_controller_node.pd_controller", "amb_controller_node.excitation_generator"
SQUARE = Square(amplitude=10e-6, duration=0.1, frequency=20.0, axes="in_turn")
LOCK_STEP = {"host_patience": 60.0}
"""An emulator whose time stands still until the host has answered: nothing depends on how fast that is."""
MISSED = 500.0
"""Steps without its host that a rig allows; at 0.02 of real time, a machine that holds it up for 2 s costs fewer."""


def host_rig(graph: Graph, *arguments: str, emulator: dict[str, float], **bridge: str) -> Rig:
    """Emulator, bridge in mode host, and the ordinary controller node."""
    rig = Rig(graph, *arguments, emulator=emulator, bridge={"mode": "host", **bridge})
    rig.controller = start_controller(graph, *arguments)
    return rig


def start_controller(graph: Graph, *arguments: str) -> NodeProcess:
    controller = graph.start(CONTROLLER, *arguments)
    graph.wait_until(lambda: graph.node.count_subscribers("/amb/position"), "the controller")
    return controller


@pytest.mark.parametrize("machine", ["paper", "rig"])
def test_its_telemetry_is_that_of_the_loop_without_ros_bit_for_bit(graph: Graph, machine: str) -> None:
    file = config(machine)
    rig = host_rig(graph, "--params-file", str(file), emulator=LOCK_STEP)
    graph.start(GENERATOR)
    run = rig.levitate()
    rig.wait_for_step(1_000)  # samples that were lost while off, when nobody waits for the host, are counted by now
    lost = rig.state.lost
    answer = rig.excite(SQUARE)
    assert answer.success, answer.message
    steps = answer.first_step + answer.steps + 100
    record = rig.record(run, steps)
    plant, controller = plant_of(file), controller_of(file)
    samples = generate(SQUARE, plant.machine.sample_rate, plant.machine).samples
    law = PdController(controller, len(plant.machine.axes))
    assert record.identical_to(simulate(plant, law, steps, samples, answer.first_step))
    assert rig.state.lost == lost
    assert rig.change("deactivate"), rig.state.problem
    assert (rig.state.mode, rig.trips) == (BridgeState.OFF, [])


@pytest.mark.parametrize(
    ("without_host", "reason", "mode"),
    [("off", Trip.WATCHDOG, BridgeState.TRIPPED), ("land", Trip.HOST_SILENT, BridgeState.OFF)],
)
def test_without_its_controller_node_the_rig_trips_or_lands_as_configured(
    graph: Graph, without_host: str, reason: int, mode: int
) -> None:
    rig = host_rig(
        graph,
        emulator={
            "host_patience": 8.0,  # longer than a loaded machine holds up a process
            "real_time_factor": 0.02,
            "limits.missed_steps": MISSED,
            "limits.settle_time": 0.05,
        },
        without_host=without_host,
    )
    rig.levitate()
    rig.wait_for_step(1_000)  # the rotor rests, and a current that holds lets it drift slowly
    rig.controller.send_signal(signal.SIGKILL)
    rig.controller.wait_for_end(60.0)
    graph.wait_until(lambda: rig.trips, "the trip")
    assert rig.trips[0].reason == reason
    assert rig.trips[0].value >= MISSED
    graph.wait_until(lambda: rig.state.mode == mode, "the end of the levitation")
    before = [value for block in rig.trips[0].before for axis in block.axes for value in axis.position]
    assert before
    assert max(map(abs, before[-100:])) < 100e-6  # held where it was until the trip


def test_without_a_controller_node_it_does_not_levitate(graph: Graph) -> None:
    rig = Rig(graph, emulator=LOCK_STEP, bridge={"mode": "host"})
    assert rig.change("configure")
    assert not rig.change("activate")
    graph.wait_until(lambda: "start a controller node, such as pd_controller" in rig.state.problem, "the reason")
    assert (rig.state.mode, rig.trips) == (BridgeState.OFF, [])
    start_controller(graph)
    assert rig.change("activate"), rig.state.problem


def test_currents_that_are_none_are_reported_and_the_rig_stays_up(graph: Graph) -> None:
    rig = host_rig(graph, emulator=LOCK_STEP)
    run = rig.levitate()
    publisher = graph.node.create_publisher(CurrentReference, "/amb/current_reference", STREAM)
    reports: list[DiagnosticStatus] = []
    graph.node.create_subscription(DiagnosticArray, "/diagnostics", lambda array: reports.extend(array.status), 100)
    graph.wait_until(publisher.get_subscription_count, "the bridge")

    def reported(reason: str) -> bool:
        return any(status.name == "amb/hardware_bridge" and reason in status.message for status in reports)

    for data in DELIVERED:
        publisher.publish(data)
    graph.wait_until(
        lambda: reported("on current_reference refused, the last: the message cannot be read"), "a warning"
    )
    step = rig.state.step
    for count in (1, 100_000):
        publisher.publish(CurrentReference(run=run, step=step + 10_000, current=[0.0] * count))
    graph.wait_until(lambda: reported("has 100000 values; allowed: 2"), "a warning")
    rig.wait_for_step(rig.state.step + 500)
    assert (rig.state.mode, rig.state.run, rig.trips) == (BridgeState.LEVITATED, run, [])


def test_a_link_that_takes_no_currents_is_refused_in_one_line(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_example(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    rig = Rig(graph, kind="vendor", bridge={"mode": "host"})
    assert not rig.change("configure")
    graph.wait_until(
        lambda: "mode = 'host' is not allowed with link.kind = 'vendor'" in rig.state.problem,
        "the reason",
    )
