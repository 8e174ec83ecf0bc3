"""The paced loop: as fast as its real-time factor allows, every late step counted, the same samples."""

from __future__ import annotations

import time

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from amb_msgs.srv import RunSteps
from tests.graph.bearing import Bearing
from tests.graph.conftest import Graph

FACTOR = 0.05  # 2 ms for each step: two processes answer in time now and then on any machine
STEPS = 300
REAL_TIME = {"real_time.priority": 1, "real_time.lock_memory": True}


def test_a_paced_loop_takes_its_time_counts_every_step_and_gives_the_same_samples(graph: Graph) -> None:
    graph.start("amb_sim_node.simulator", parameters={"real_time_factor": FACTOR})
    graph.start("amb_controller_node.pd_controller")
    bearing = Bearing(graph)
    run = bearing.reset()
    began = time.monotonic()
    bearing.run(STEPS)
    record = bearing.record(run, STEPS)
    assert time.monotonic() - began >= (STEPS - 1) * 1e-4 / FACTOR
    assert record.identical_to(simulate(Plant(), PdController(ControllerParameters()), STEPS))
    graph.wait_until(lambda: _values(bearing).get("steps paced") == str(STEPS - 1))
    assert 0 <= int(_values(bearing)["deadlines missed"]) < STEPS
    lateness = [float(_values(bearing)[f"lateness {name} (us)"]) for name in ("p50", "p99", "p99.99", "max")]
    assert lateness == sorted(lateness)
    assert lateness[-1] > 0.0


def test_a_run_has_a_pace_of_its_own_and_the_next_one_that_of_the_parameter(graph: Graph) -> None:
    graph.start("amb_sim_node.simulator")
    graph.start("amb_controller_node.pd_controller")
    bearing = Bearing(graph)
    run = bearing.reset()
    began = time.monotonic()
    bearing.run(STEPS, real_time_factor=FACTOR)
    bearing.wait_for_step(run, STEPS)
    assert time.monotonic() - began >= (STEPS - 1) * 1e-4 / FACTOR
    graph.wait_until(lambda: _values(bearing).get("steps paced") == str(STEPS - 1))
    bearing.run(STEPS)
    bearing.wait_for_step(run, 2 * STEPS)
    graph.wait_until(lambda: "steps paced" not in _values(bearing))
    assert bearing.record(run, 2 * STEPS).identical_to(
        simulate(Plant(), PdController(ControllerParameters()), 2 * STEPS)
    )
    for wrong in (-1.0, 1e-9, 1e9, float("nan")):
        answer = graph.call(RunSteps, "/amb/simulator/run", steps=1, real_time_factor=wrong)
        assert not answer.success
        assert "allowed: 0, or 0.002 to 100" in answer.message


def _values(bearing: Bearing) -> dict[str, str]:
    """What the simulator's last report says."""
    reports = [status for status in bearing.diagnostics if status.name == "amb/simulator"]
    return {item.key: item.value for item in reports[-1].values} if reports else {}


def test_a_simulator_with_real_time_options_runs_and_ends_whether_the_machine_allows_them_or_not(graph: Graph) -> None:
    simulator = graph.start("amb_sim_node.simulator", parameters=REAL_TIME)
    graph.start("amb_controller_node.pd_controller")
    bearing = Bearing(graph)
    run = bearing.reset()
    bearing.run(STEPS)
    assert bearing.record(run, STEPS).identical_to(simulate(Plant(), PdController(ControllerParameters()), STEPS))
    code, said = graph.stop(simulator)
    assert code == 0
    assert not said or "not permitted on this machine; to allow it: " in said
