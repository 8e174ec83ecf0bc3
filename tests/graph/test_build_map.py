"""Region maps as an action of the region monitor, and the preview of excitations on them."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.action import ActionClient

from amb_bringup.client import AmbClient, ClientError
from amb_core.recording.messages.region_map import region_map_from_message
from amb_core.regions import Region
from amb_core.regions.region_map import MapProgress
from amb_core.regions.region_map import RegionMap as CoreMap
from amb_msgs.action import BuildMap
from amb_msgs.msg import RegionMap, RegionState
from amb_msgs.srv import PreviewExcitation
from amb_ros.qos import LATCHED
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

MONITOR = "amb_ident_node.region_monitor"
PAPER_MAP = Path(__file__).parents[1] / "unit" / "data" / "paper_map.json"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/GoalStatus
SMALL_MAP = {
    "amplitude_low": 50e-6,
    "amplitude_high": 80e-6,
    "frequency_start": 100.0,
    "frequency_end": 500.0,
    "duration": 1.0,
    "rest": 0.3,
    "initial_sweeps": 2,
    "max_sweeps": 3,
}


class MapBuilder:
    """A region monitor and an excitation generator, with a cache of their own."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.maps: list[RegionMap] = []
        graph.environment["XDG_CACHE_HOME"] = str(graph.folder / "cache")
        graph.node.create_subscription(RegionMap, "/amb/region_map", self.maps.append, LATCHED)
        self.process = graph.start(MONITOR, parameters={"parameter_timeout": 0.1})
        graph.start("amb_controller_node.excitation_generator", parameters={"parameter_timeout": 0.1})
        self.action = ActionClient(graph.node, BuildMap, "/amb/region_monitor/build_map")
        graph.wait_until(self.action.server_is_ready, "the monitor")
        self.parameter_file = graph.folder / "heavy.yaml"
        self.parameter_file.write_text(
            "/amb/simulator: {ros__parameters: {rotor.mass: 6.5, autostart: true}}\n"
            "/amb/pd_controller: {ros__parameters: {proportional_gain: 21000.0, telemetry_block: 10}}\n"
        )

    def send(self, **goal: Any) -> tuple[Any, list[Any]]:
        """Send a goal; its handle, and the feedback as it comes."""
        feedback: list[Any] = []
        wanted = BuildMap.Goal(**{"parameter_file": str(self.parameter_file)} | goal)
        handle = self.graph.send_goal(self.action, wanted, lambda message: feedback.append(message.feedback))
        return handle, feedback

    def preview(self, **request: Any) -> Any:
        return self.graph.call(PreviewExcitation, "/amb/excitation_generator/preview", **request)


@pytest.fixture
def builder(share: Callable[..., Any]) -> MapBuilder:
    return share(MapBuilder, lambda made: made.process.poll() is None)


def test_without_a_map_the_preview_names_who_builds_one(graph: Graph) -> None:
    graph.start("amb_controller_node.excitation_generator")
    request = {"kind": "square", "amplitude": 1e-6, "duration": 1.0}
    refused = graph.call(PreviewExcitation, "/amb/excitation_generator/preview", **request)
    assert "no region map received on /amb/region_map; call region_monitor/build_map first" in refused.message


def test_a_map_is_built_with_feedback_and_serves_the_preview(builder: MapBuilder) -> None:
    file = builder.graph.folder / "map.json"
    handle, feedback = builder.send(path=str(file), **SMALL_MAP)
    status, result = builder.graph.result_of(handle)
    assert (status, result.success) == (SUCCEEDED, True), result.message
    assert result.path == str(file)
    assert result.message == "3 sweeps, boundaries not resolved, max_sweeps = 3 are done"
    assert not result.map.complete, "computed, which is a success, and not resolved"
    built = region_map_from_message(result.map)
    assert len(built.sweeps) == 3
    assert built.provenance["plant"]["rotor"]["mass"] == 6.5
    assert built.provenance["controller"]["proportional_gain"] == 21_000.0
    assert repr(built) == repr(CoreMap.load(file)), "the message and the file hold the same map"
    assert all(Region.D in sweep.boundaries for sweep in built.sweeps)
    assert [report.done for report in feedback] == sorted(report.done for report in feedback)
    assert feedback[-1].done == feedback[-1].total == 3
    assert list(feedback[-1].map.frequency_d) == list(result.map.frequency_d)
    builder.graph.wait_until(lambda: builder.maps, "the map on its topic")
    assert builder.maps[-1].amplitude == result.map.amplitude

    for region_map in ("", str(file)):
        small = builder.preview(kind="square", amplitude=1e-6, duration=1.0, axes="x", map=region_map)
        assert small.success, small.message
        assert sum(small.power_x) == pytest.approx(1.0)
        assert (small.region_y, list(small.power_y)) == (RegionState.A, [0.0] * 4)
        assert small.crest_factor_x == pytest.approx(1.0, abs=0.01)
        assert any("node /amb/pd_controller did not report its parameters" in note for note in small.notes)
    large = builder.preview(kind="sweep", amplitude=70e-6, duration=5.0, frequency_end=450.0, axes="y")
    assert large.success, large.message
    assert large.region == large.region_y == RegionState.D
    assert large.power_y[RegionState.D] > 0.1
    assert "/nowhere" in builder.preview(kind="square", amplitude=1e-6, duration=1.0, map="/nowhere").message


def test_the_preview_takes_the_phases_of_a_multisine(builder: MapBuilder) -> None:
    asked = {"kind": "multisine", "amplitude": 1e-6, "duration": 1.0, "map": str(PAPER_MAP)}
    random = builder.preview(**asked)
    low = builder.preview(**asked, phasing="schroeder", interleaved=True)
    assert low.success, low.message
    assert max(low.crest_factor_x, low.crest_factor_y) < 2.0 < random.crest_factor_x
    odd = builder.preview(**asked, odd=True, periods=2)
    assert odd.success, odd.message
    assert "periods" in builder.preview(**asked, periods=1_000_000).message
    assert "allowed: one of random, schroeder, optimised" in builder.preview(**asked, phasing="best").message


def test_a_cancelled_map_keeps_its_finished_sweeps(builder: MapBuilder) -> None:
    handle, feedback = builder.send(**SMALL_MAP | {"amplitude_low": 30e-6, "initial_sweeps": 40, "max_sweeps": 40})
    builder.graph.wait_until(lambda: feedback and feedback[-1].done, "the first sweep")
    builder.graph.cancel(handle)
    status, result = builder.graph.result_of(handle)
    assert (status, result.success) == (CANCELED, False)
    assert "cancelled after" in result.message
    kept = len(result.map.amplitude)
    assert 0 < kept < 40
    assert not result.map.complete

    seen: list[MapProgress] = []
    with AmbClient(domain_id=builder.graph.domain, timeout=TIMEOUT) as amb:
        again = amb.build_map(
            builder.parameter_file,
            progress=seen.append,
            cancelled=lambda: any(report.reused >= kept for report in seen),
            **SMALL_MAP | {"amplitude_low": 30e-6, "initial_sweeps": 40, "max_sweeps": 40},
        )
    assert kept <= len(again.sweeps) < 40
    assert not again.complete
    assert seen[-1].map is not None


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ({"amplitude_low": -1.0}, "'amplitude_low' = -1.0 is not allowed"),
        ({"amplitude_low": 9e-5, "amplitude_high": 2e-5}, "amplitude_low = 9e-05 m must be below"),
        ({"spacing": "square"}, "'spacing' = 'square' is not allowed; allowed: one of linear, logarithmic"),
        ({"path": "/nowhere/map.json"}, "path = '/nowhere/map.json' is not allowed"),
        ({"path": "x" * 5_000}, "is not allowed; allowed: a file in a folder that exists"),
        ({"path": "/dev/full"}, "path = '/dev/full' is not allowed"),
        ({"parameter_file": "/nowhere.yaml"}, "parameter file /nowhere.yaml"),
    ],
)
def test_a_bad_goal_is_rejected_and_the_client_knows_why(
    builder: MapBuilder, goal: dict[str, Any], reason: str
) -> None:
    assert not builder.send(**{"parameter_file": str(builder.parameter_file)} | goal)[0].accepted
    with (
        AmbClient(domain_id=int(builder.graph.environment["ROS_DOMAIN_ID"])) as amb,
        pytest.raises(ClientError) as caught,
    ):
        amb.build_map(**goal)
    assert "/amb/region_monitor/build_map: " in str(caught.value)
    assert reason in str(caught.value)
    assert "internal error" not in str(caught.value)


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ({"frequency_end": 6_000.0}, "above the Nyquist frequency"),
        ({"amplitude_high": 300e-6}, "exceeds the clearance"),
    ],
)
def test_a_goal_that_does_not_fit_the_loop_is_aborted_with_the_reason(
    builder: MapBuilder, goal: dict[str, Any], reason: str
) -> None:
    status, result = builder.graph.result_of(builder.send(**goal)[0])
    assert (status, result.success) == (ABORTED, False)
    assert reason in result.message
    assert "internal error" not in result.message


def test_a_map_of_a_loop_that_does_not_run_is_refused(builder: MapBuilder) -> None:
    builder.parameter_file, file = "", builder.parameter_file
    status, result = builder.graph.result_of(builder.send()[0])
    builder.parameter_file = file
    assert status == ABORTED
    assert "node /amb/simulator did not report its parameters within 0.1 s; is it running?" in result.message


def test_a_signal_ends_the_node_in_the_middle_of_a_map(builder: MapBuilder) -> None:
    _, feedback = builder.send(**SMALL_MAP | {"amplitude_low": 20e-6, "initial_sweeps": 40, "max_sweeps": 40})
    builder.graph.wait_until(lambda: feedback, "the start of the map")
    code, errors = builder.graph.stop(builder.process, signal.SIGINT)
    assert code == 0, errors
    assert "Traceback" not in errors
