"""The live page without a graph: who may read it and give orders, and what messages become."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log

from amb_bringup.view.guard import Guard, is_loopback
from amb_bringup.view.hub import Hub
from amb_bringup.view.orders import Orders, forms
from amb_bringup.view.picture import KEPT_LINES, KEPT_NODES, SILENCE, Picture
from amb_bringup.view.samples import FRAME, Seen
from amb_bringup.view.server import ViewError, ViewServer
from amb_core.excitation import KINDS
from amb_core.ground.errors import AmbError
from amb_msgs.msg import AxisSamples, BridgeState, LoopSamples, RegionState, SimulatorState


@pytest.mark.parametrize(
    ("host", "known"),
    [("127.0.0.1:8642", True), ("localhost", True), ("[::1]:1", True), ("evil.example:8642", False), ("", False),
     ("127.0.0.1.evil.example", False), ("10.0.0.7:8642", False)],
)  # fmt: skip
def test_a_server_on_the_loopback_interface_answers_to_its_own_names_only(host: str, known: bool) -> None:
    assert Guard("127.0.0.1").knows_host(host) is known


def test_a_server_open_to_the_network_answers_to_addresses_but_not_to_names_of_others() -> None:
    guard = Guard("0.0.0.0")
    assert guard.knows_host("10.0.0.7:8642")
    assert not guard.knows_host("evil.example:8642")


@pytest.mark.parametrize(
    "origin", [None, "", "null", "http://evil.example", "https://localhost:8642", "http://localhost:8643"]
)
def test_a_page_of_another_origin_is_refused(origin: str | None) -> None:
    assert not Guard("127.0.0.1").knows_origin(origin, "localhost:8642")
    assert Guard("127.0.0.1").knows_origin("http://localhost:8642", "localhost:8642")


def test_only_the_token_opens_the_orders_and_none_does_on_a_read_only_server() -> None:
    guard = Guard("127.0.0.1")
    assert guard.opens(guard.token)
    for token in ("", None, 7, [guard.token], guard.token[:-1], "\udcff"):
        assert not guard.opens(token)
    assert not Guard("127.0.0.1", read_only=True).opens("")
    assert Guard("127.0.0.1").token != guard.token


def test_loopback_addresses_are_known() -> None:
    assert is_loopback("127.0.0.1") and is_loopback("::1") and is_loopback("localhost")
    assert not is_loopback("0.0.0.0") and not is_loopback("example.org")


def test_a_port_in_use_is_named_with_what_to_do() -> None:
    first = ViewServer("127.0.0.1", 0, True, Picture())
    with pytest.raises(ViewError, match=rf"port {first.port} of 127.0.0.1 is in use; .* --port"):
        ViewServer("127.0.0.1", first.port, True, Picture())


def test_no_name_of_a_file_reaches_the_file_system() -> None:
    from amb_bringup.view.server import PageFile

    assert {"index.html", "main.js", "style.css"} <= set(PageFile.FILES)
    assert all("/" not in name for name in PageFile.FILES)


@pytest.mark.parametrize("order", ["format", "__init__", None, 7, ["run"], {}])
def test_an_unknown_order_is_refused_with_the_known_ones(order: object) -> None:
    with pytest.raises(AmbError, match=r"unknown order .* allowed: start_excitation"):
        Orders(lambda: 0).lane(order)


ENDING = ("stop_excitation", "stop_recording", "pause", "land", "off")
OTHERS = (
    "start_excitation", "start_recording", "run", "reset", "levitate", "reset_trip", "build_map", "identify", "certify",
)  # fmt: skip


def test_what_ends_something_waits_for_no_other_order() -> None:
    orders = Orders(lambda: 0)
    with pytest.raises(AmbError, match="allowed: ") as refusal:
        orders.lane("")
    known = str(refusal.value).partition("allowed: ")[2].split(", ")
    assert set(known) == {*ENDING, *OTHERS}, "a new order is one that ends something, or not"
    for ending in ENDING:
        assert [other for other in known if orders.lane(other) is orders.lane(ending)] == [ending]
    orders.close()


@pytest.mark.parametrize(("complete", "ends"), [(True, "2 amplitudes"), (False, "max_sweeps are done")])
def test_a_map_that_is_not_resolved_is_named_so(monkeypatch: pytest.MonkeyPatch, complete: bool, ends: str) -> None:
    region_map = SimpleNamespace(amplitudes=[1e-5, 2e-5], complete=complete)
    client = SimpleNamespace(use_run=lambda run: None, build_map=lambda progress: region_map)
    monkeypatch.setattr("amb_bringup.view.orders.AmbClient", lambda timeout: client)
    assert Orders(lambda: 0).carry_out("build_map", {}, lambda _text: None).endswith(ends)


@pytest.mark.parametrize("order", [41, -1, 2.0, True, "every"])
def test_an_order_that_no_model_has_is_refused_with_those_that_one_may_have(
    monkeypatch: pytest.MonkeyPatch, order: object
) -> None:
    monkeypatch.setattr("amb_bringup.view.orders.AmbClient", lambda timeout: SimpleNamespace(use_run=lambda run: None))
    with pytest.raises(AmbError, match=r"order = .* is not allowed; allowed: auto, or 0 \(default\) to 40$"):
        Orders(lambda: 0).carry_out("identify", {"order": order}, lambda _text: None)


def test_the_form_of_every_excitation_has_its_declared_settings() -> None:
    shown = json.loads(json.dumps(forms()))["excitations"]
    assert set(shown) == set(KINDS)
    for name, kind in KINDS.items():
        assert [field["name"] for field in shown[name]] == list(kind.model_fields)


def telemetry(*axes: tuple[str, list[float]], run: int = 1) -> LoopSamples:
    parts = [AxisSamples(name=name, reference=values, position=values, current=values) for name, values in axes]
    return LoopSamples(run=run, first_step=0, sample_time=1e-4, axes=parts)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (telemetry(), "at least one axis"),
        (telemetry(("x", [0.0]), ("x", [0.0])), "names"),
        (telemetry(*((f"axis_{number}", [0.0]) for number in range(40))), "40 axes; allowed: 1 to 16"),
        (telemetry(("x", [0.0]), ("y", [0.0, 1.0])), "same length"),
    ],
)
def test_telemetry_that_is_not_in_order_is_refused_once(message: LoopSamples, reason: str) -> None:
    picture = Picture()
    for _ in range(3):
        picture.take("telemetry", message, 0)
    assert len(picture.log) == 1
    assert reason in picture.log[0]["text"]


def test_a_picture_of_any_region_is_json() -> None:
    picture = Picture()
    picture.take("region", RegionState(region=1, radius=math.nan), 0)
    picture.take("region", RegionState(region=99), 0)  # refused
    picture.update()
    assert json.loads(json.dumps(picture.sections, allow_nan=False))["region"]["region"] == "B"


@dataclass(eq=False)
class Reader:
    """A page that keeps what it gets."""

    seen: Seen = field(default_factory=Seen)
    known: dict[str, int] = field(default_factory=dict)
    line: int = 0
    messages: list[str | bytes] = field(default_factory=list)

    def ready(self) -> bool:
        return True

    def send(self, message: str | bytes) -> None:
        self.messages.append(message)


def test_the_layout_of_a_run_reaches_a_page_before_its_first_samples() -> None:
    picture, page = Picture(), Reader()
    hub = Hub(picture)
    hub.pages.add(page)
    for run in range(1, 4):  # at another tick each time, and each run over before the next one
        picture.take("telemetry", telemetry(("x", [1e-6] * 1000), run=run), 0)
        hub.tick()
    epochs = []
    for message in page.messages:
        if isinstance(message, str):
            layout = json.loads(message)["sections"].get("layout", {"epoch": None})
            epochs.append(layout["epoch"])
        else:
            assert struct.unpack_from("<2I", message) == (FRAME, epochs[-1])
    assert len(set(epochs)) == 3


def test_log_and_nodes_are_bounded_and_long_texts_cut() -> None:
    picture = Picture()
    for number in range(2 * KEPT_LINES):
        picture.take("/rosout", Log(level=20, name=f"node {number}", msg=100_000 * "a"), 0)
        status = DiagnosticStatus(name=f"node {number}", level=b"\x09")
        picture.take("/diagnostics", DiagnosticArray(status=[status]), 0)
    picture.update()
    assert len(picture.log) == KEPT_LINES
    assert len(picture.sections["nodes"]) == KEPT_NODES
    assert max(len(line["text"]) for line in picture.log) < 1000


def test_what_a_silent_node_told_is_named_as_of_before_while_others_report() -> None:
    now = 0.0
    picture = Picture(lambda: now)

    def hear(*names: str) -> list[str]:
        status = [DiagnosticStatus(name=name, message="running") for name in names]
        picture.take("/diagnostics", DiagnosticArray(status=status), 0)
        picture.update()
        return list(picture.sections["away"])

    picture.take("hardware_bridge/state", BridgeState(mode=BridgeState.LEVITATED, run=1), 0)
    assert picture.sections["plant"]["what"] == "rig"
    names = ("amb/hardware_bridge", "amb/region_monitor", "amb/excitation_generator", "amb/recorder")
    assert hear(*names) == []
    now = 2.0 * SILENCE
    assert hear(*names[1:]) == ["plant"]
    assert hear(*names) == []
    now = 4.0 * SILENCE
    assert hear(names[0], names[3]) == ["region", "excitation"]
    assert picture.sections["graph"]["alive"]


def test_nodes_of_other_namespaces_say_nothing_of_the_graph() -> None:
    now = 0.0
    picture = Picture(lambda: now, "rig1")

    def hear(*names: str) -> tuple[list[str], bool]:
        status = [DiagnosticStatus(name=name, message="running") for name in names]
        picture.take("/diagnostics", DiagnosticArray(status=status), 0)
        picture.update()
        return list(picture.sections["away"]), picture.sections["graph"]["alive"]

    picture.take("simulator/state", SimulatorState(run=1), 0)
    assert hear("rig2/simulator") == ([], False)
    assert hear("rig1/simulator", "rig1/recorder") == ([], True)
    now = 2.0 * SILENCE
    assert hear("rig2/simulator", "rig1/recorder") == (["plant"], True)
    now = 4.0 * SILENCE
    assert hear("rig1/inner/simulator", "rig2/simulator") == (["plant"], False)
    assert set(picture.sections["nodes"]) == {
        "rig1/inner/simulator",
        "rig1/recorder",
        "rig1/simulator",
        "rig2/simulator",
    }


def test_a_graph_whose_nodes_are_silent_counts_as_away_until_one_reports() -> None:
    now = 0.0
    picture = Picture(lambda: now)
    report = DiagnosticArray(status=[DiagnosticStatus(name="amb/simulator", message="running")])

    def state() -> tuple[bool, bool]:
        picture.update()
        return picture.sections["graph"]["known"], picture.sections["graph"]["alive"]

    assert state() == (False, False)
    picture.take("/diagnostics", report, 0)
    assert state() == (True, True)
    now = 2.0 * SILENCE
    assert state() == (True, False)
    picture.take("/diagnostics", report, 0)
    assert state() == (True, True)
