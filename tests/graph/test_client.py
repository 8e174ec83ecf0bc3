"""The graph as users start it, from the launch files, driven through AmbClient."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rclpy.action import ActionServer

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.graph.launcher import Graph, launch_file
from amb_bringup.graph.packages import share_folder
from amb_controller_node.parameters import GeneratorParameters, PdControllerParameters
from amb_core.ground.parameters import load_parameters
from amb_core.recording import Recording
from amb_core.regions import Region
from amb_msgs.action import BuildMap
from amb_msgs.srv import Certify
from amb_sim_node.parameters import SimulatorParameters
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.action.server import ServerGoalHandle

    from tests.graph.conftest import Graph as GraphOfTests

SETTLING = 1_000
STEPS = 6_000
UPDATE = 100  # steps; of the region monitor, by default


@pytest.mark.parametrize(
    ("node", "parameters"),
    [
        ("simulator", SimulatorParameters),
        ("pd_controller", PdControllerParameters),
        ("excitation_generator", GeneratorParameters),
    ],
)
def test_parameter_file_of_the_paper_holds_the_defaults(node, parameters):
    assert load_parameters(parameters, share_folder("amb_bringup") / "config" / "paper.yaml", node) == parameters()


@contextlib.contextmanager
def launched(name: str, log: Path, own_domain: Callable[[], Any]) -> Iterator[tuple[Graph, AmbClient]]:
    with own_domain() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(log)}
        with (
            Graph.from_launch_file(launch_file(name), env=environment) as graph,
            AmbClient(domain_id=domain, timeout=TIMEOUT) as client,
        ):
            yield graph, client


@pytest.fixture(scope="module", params=["bearing", "composed"])
def placement(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def amb(
    placement: str,
    keep: Callable[..., Any],
    tmp_path_factory: pytest.TempPathFactory,
    own_domain: Callable[[], Any],
) -> AmbClient:
    """A client of a graph that runs, shared among the tests."""

    def opened() -> Any:
        return launched(placement, tmp_path_factory.mktemp("log"), own_domain)

    _, client = keep((launched, placement), opened, lambda kept: not kept[0].ended() and kept[1].reset())
    return client


def test_experiment_is_recorded_and_identified_live_and_from_its_bag(amb: AmbClient, tmp_path: Path):
    bag = amb.start_recording(str(tmp_path / "bag"))
    run = amb.reset()
    excited = amb.start_excitation(
        "square", first_step=SETTLING, amplitude=20e-6, duration=0.5, frequency=10.0, axes="in_turn"
    )
    assert (excited.run, excited.first_step, excited.steps) == (run, SETTLING, STEPS - SETTLING)
    seen: list[int] = []
    end = amb.run(STEPS, seen.append)
    assert (end.run, end.step, end.delevitated) == (run, STEPS, False)
    assert seen[-1] == STEPS
    assert amb.stop_recording(run, STEPS) == bag
    live = amb.identify(order=6, method="n4sid")
    recorded = amb.identify(bag=bag, order=6, method="n4sid")
    np.testing.assert_array_equal(live.a, recorded.a)
    np.testing.assert_array_equal(amb.get_model().a, recorded.a)
    assert live.samples == STEPS - SETTLING
    assert amb.wait_for_region(Region.A).step < STEPS
    content = Recording.read(bag)
    assert content.telemetry(run).steps == STEPS
    assert content.parameters()["/amb/pd_controller"]["proportional_gain"] == 20_000.0
    assert [excitation.first_step for excitation in content.excitations(run)][-1] == SETTLING


def test_the_region_is_that_at_the_end_of_the_present_run(amb: AmbClient):
    for _ in range(2):
        amb.reset()
        for end in (3_000, 6_000):
            amb.run(3_000)
            assert end - UPDATE < amb.region_state().step < end


def test_a_run_that_another_client_resets_is_an_error_that_names_both_runs(amb: AmbClient):
    run = amb.reset()
    later: list[int] = []
    with AmbClient(domain_id=amb.node.context.get_domain_id(), timeout=TIMEOUT) as other:

        def reset(step: int) -> None:
            if step > 0 and not later:
                later.append(other.reset())

        with pytest.raises(ClientError) as caught:
            amb.run(10_000_000, reset)
    assert f"run {run} was ended by a reset or a restart of the simulator; the present run is {later[0]}" == str(
        caught.value
    )
    assert amb.run(100).run == later[0]


def test_reset_takes_a_parameter_file_of_the_caller(amb: AmbClient, tmp_path: Path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    text = (share_folder("amb_bringup") / "config" / "paper.yaml").read_text()
    Path("strong.yaml").write_text(text.replace("bias_current: 3.0 ", "bias_current: 5.0 "))
    Path("wrong.yaml").write_text(text.replace("bias_current: 3.0 ", "bias_current: 30.0 "))
    before = amb.reset()
    run = amb.reset("strong.yaml")
    assert run > before
    end = amb.run(500)
    assert (end.run, end.step, end.delevitated) == (run, 500, False)
    with pytest.raises(ClientError) as caught:
        amb.reset("wrong.yaml")
    assert f"parameter file {tmp_path / 'wrong.yaml'}" in str(caught.value)
    assert "bias_current = 30 A must not exceed current_limit" in str(caught.value)
    amb.reset(share_folder("amb_bringup") / "config" / "paper.yaml")


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda amb: amb.run(0), "steps = 0 is not allowed"),
        (lambda amb: amb.start_excitation("square", amplitude=-1.0, duration=1.0), "'amplitude' = -1.0 is not allowed"),
        (lambda amb: amb.start_excitation("square", amplitud=1e-6), "unknown setting 'amplitud'; allowed:"),
        (
            lambda amb: amb.identify(bag="/nowhere"),
            "identifier/identify: bag /nowhere: there is no such file or folder",
        ),
        (lambda amb: amb.identify(order=41), "identifier/identify: order 41 is not allowed; allowed: 1 to 40"),
        (lambda amb: amb.preview_excitation("sweep", amplitud=1e-6), "unknown setting 'amplitud'; allowed:"),
        (lambda amb: amb.preview_excitation("square", amplitude=1e-6, duration=1.0), "no region map received"),
        (lambda amb: amb.build_map(amplitude_low=-1.0), "'amplitude_low' = -1.0 is not allowed"),
        (lambda amb: amb.build_map(parameter_file="/nowhere"), "/nowhere"),
        (lambda amb: amb.wait_for_region(Region.C, timeout=0.1), "did not enter region C"),
        (lambda amb: amb.stop_recording(), "recorder/stop"),
    ],
)
def test_refusals_are_errors_with_the_reason(amb: AmbClient, call, reason):
    with pytest.raises(ClientError) as caught:
        call(amb)
    assert reason in str(caught.value)


def test_numbers_reach_a_service_and_an_action_as_they_are(graph: GraphOfTests) -> None:
    received: list[Any] = []

    def certify(request: Certify.Request, response: Certify.Response) -> Certify.Response:
        received.append((request.extra_delay, request.zone_a, request.mode_gain))
        response.success = True
        return response

    def build(goal: ServerGoalHandle) -> BuildMap.Result:
        received.append((goal.request.amplitude_low, goal.request.initial_sweeps))
        goal.succeed()
        return BuildMap.Result(message="no map")

    graph.node.create_service(Certify, "/amb/identifier/certify", certify)
    server = ActionServer(graph.node, BuildMap, "/amb/region_monitor/build_map", build)
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as client:
        assert not Certify.Request()._check_fields  # as for users
        client.certify("paper", extra_delay=1, zone_a=np.int64(4), mode_gain=np.float32(0.5))
        with pytest.raises(ClientError, match=r"/amb/identifier/certify: extra_delay = '1' is not allowed; allowed: a"):
            client.certify("paper", extra_delay="1")
        with pytest.raises(ClientError, match="no map"):
            client.build_map(amplitude_low=np.float32(0.5), initial_sweeps=np.int64(3))
    server.destroy()
    assert received == [(1.0, 4.0, 0.5), (0.5, 3)]


def test_missing_graph_is_an_error_that_names_the_service_and_so_is_a_closed_client(domain: int):
    with (
        AmbClient(domain_id=domain, timeout=0.3) as client,
        pytest.raises(ClientError, match="no service /amb/simulator/reset; is the node running"),
    ):
        client.reset()
    for call in (client.pause, client.identify, client.region_state, client.wait_for_nodes, client.spin_once):
        with pytest.raises(ClientError, match="this client is closed"):
            call()
