"""What is attacked: every service, action, subscribed topic and parameter of the nodes, as the graph shows them.

Requests that are valid but for one field come from `valid_messages`; what is not in that table gets random fields.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.node import Node

from amb_bringup.graph.packages import share_folder
from amb_core.recording.messages.region_map import fill_region_map
from amb_core.regions.region_map import RegionMap
from amb_msgs import msg
from tests.fuzz.hostile import interface

PAPER_MAP = Path(__file__).parents[1] / "unit" / "data" / "paper_map.json"
PAPER_FILE = share_folder("amb_bringup") / "config" / "paper.yaml"

Kind = Literal["service", "action", "topic", "parameters"]


@dataclass(frozen=True)
class Target:
    """A door of the graph.

    Attributes
    ----------
    kind : str
        What it is.
    name : str
        Full name.
    type : type
        Of the service, action or message.
    nodes : tuple of str
        The nodes behind it, without their namespace.
    """

    kind: Kind
    name: str
    type: Any
    nodes: tuple[str, ...]

    @property
    def weight(self) -> float:
        """How often it is chosen, compared with others: what rclpy adds to every node is one door in six nodes."""
        return 0.2 if self.kind == "service" and not self.type.__module__.startswith("amb_msgs") else 1.0

    @property
    def message_type(self) -> Any:
        """What is sent to it."""
        return {"topic": lambda: self.type, "action": lambda: self.type.Goal}.get(
            self.kind, lambda: self.type.Request
        )()


def find_targets(node: Node, names: tuple[str, ...], namespace: str) -> list[Target]:
    """The doors of nodes in a namespace that this node has discovered so far, in order of their names.

    Raises
    ------
    NodeNameNonExistentError
        If one of the nodes has not been discovered yet; it may answer requests before.
    """
    targets: dict[str, Target] = {}
    topics: dict[str, tuple[Any, list[str]]] = {"/clock": (interface("rosgraph_msgs/msg/Clock"), [])}
    for name in names:
        for service, (kind, *_) in node.get_service_names_and_types_by_node(name, namespace):
            targets |= {target.name: target for target in _services(service, kind, name)}
        for action, (kind, *_) in get_action_server_names_and_types_by_node(node, name, namespace):
            targets |= {target.name: target for target in _actions(action, interface(kind), name)}
        for topic, (kind, *_) in node.get_subscriber_names_and_types_by_node(name, namespace):
            topics.setdefault(topic, (interface(kind), []))[1].append(name)
    for topic, (message_type, listeners) in topics.items():
        targets[topic] = Target("topic", topic, message_type, tuple(sorted(listeners)))
    return [targets[name] for name in sorted(targets)]


def _services(service: str, kind: str, node: str) -> Iterator[Target]:
    if "/_action/" not in service:
        service_type = interface(kind)
        sets = service_type in (SetParameters, SetParametersAtomically)
        yield Target("parameters" if sets else "service", service, service_type, (node,))


def _actions(action: str, action_type: Any, node: str) -> Iterator[Target]:
    yield Target("action", action, action_type, (node,))
    for name, service_type in (
        ("send_goal", action_type.Impl.SendGoalService),
        ("get_result", action_type.Impl.GetResultService),
        ("cancel_goal", action_type.Impl.CancelGoalService),
    ):
        yield Target("service", f"{action}/_action/{name}", service_type, (node,))


def valid_messages(run: int, step: int) -> dict[str, list[dict[str, Any]]]:
    """Fields of messages that the graph takes, by name relative to the namespace, for its present run and step."""
    wave = [1e-6 * (number % 7) for number in range(100)]
    samples = [msg.AxisSamples(name=axis, reference=wave, position=wave, current=wave) for axis in "xy"]
    excitation = {"amplitude": 1e-6, "axes": "both", "duration": 0.1, "frequency_start": 10.0, "frequency_end": 100.0}
    kinds = [
        {"kind": "sweep", "spacing": "linear", **excitation},
        {"kind": "square", "amplitude": 1e-6, "axes": "in_turn", "duration": 0.1, "frequency": 50.0},
        {"kind": "multisine", "phasing": "schroeder", **excitation},
        {"kind": "prbs", "amplitude": 1e-6, "axes": "x", "duration": 0.1, "frequency": 1_000.0},
        {"kind": "white_noise", **excitation},
        {"kind": "tones", "axes": "y", "duration": 0.1, "frequencies": [10.0, 20.0], "amplitudes": [1e-6, 1e-6]},
    ]
    return {
        "simulator/run": [{"steps": 20}],
        "simulator/reset": [{"parameter_file": str(PAPER_FILE)}, {}],
        "excitation_generator/start": kinds,
        "excitation_generator/preview": [{**kind, "map": str(PAPER_MAP)} for kind in kinds] + kinds[:1],
        "recorder/start": [{"uri": "bag"}],
        "recorder/stop": [{"wait_for_run": run, "wait_for_step": step, "timeout": 0.1}],
        "identifier/identify": [{"order": 2, "method": "ssarx", "controller": "paper"}],
        "identifier/validate": [{"controller": "paper"}],
        "identifier/certify": [{"controller": "paper", "frequencies": 50.0}, {"on_telemetry": True}],
        # Too large for the clearance, which is found out after everything else: no goal starts a cluster.
        "region_monitor/build_map": [{"amplitude_high": 300e-6, "parameter_file": str(PAPER_FILE)}],
        "position": [
            {"run": 7, "step": number, "time": 1e-4 * number, "position": [1e-6, 1e-6]} for number in range(3)
        ],
        "current_reference": [{"run": run, "step": step, "current": [0.1, 0.1]}],
        "telemetry": [{"run": run, "first_step": step, "sample_time": 1e-4, "axes": samples}],
        "excitation": [
            {"run": run, "id": 3, "kind": "waveform", "first_step": -1, "sample_time": 1e-4}
            | {"steps": 100, "axes": [msg.AxisReference(name=axis, reference=wave) for axis in "xy"]},
            {"run": run, "id": 4, "kind": "square", "first_step": -1, "sample_time": 1e-4, "steps": 1_000}
            | {"description": json.dumps({"amplitude": 1e-6, "axes": "x", "duration": 0.1, "frequency": 50.0})},
        ],
        "excitation_status": [{"run": run, "id": 3, "accepted": True, "first_step": step, "steps": 100}],
        "simulator/state": [{"run": run, "step": step, "mode": 1, "sample_time": 1e-4}],
        "region_map": [_map_fields()],
    }


def _map_fields() -> dict[str, Any]:
    message = fill_region_map(msg.RegionMap(), RegionMap.load(PAPER_MAP))
    return {name: getattr(message, name) for name in message.get_fields_and_field_types()}


def tame(name: str, message: Any) -> None:
    """Bound, in place, what a request may legitimately take: long waits, orders and clusters are no findings."""
    change = _TAMED.get(name)
    if change is not None:
        change(message)


def _tame_start(message: Any) -> None:
    """Keep bags in the folder of the campaign: a recorder that may write anywhere does."""
    if not os.path.lexists(message.uri):
        message.uri = message.uri.lstrip("/~.")


def _tame_stop(message: Any) -> None:
    if 0.0 <= message.timeout <= 3600.0:
        message.timeout = min(message.timeout or 0.1, 0.2)


def _tame_identify(message: Any) -> None:
    if message.order <= 30:
        message.order = min(message.order, 3)
    if message.method in ("", "pem"):
        message.method = "ssarx"
    message.auto_order = message.auto_order and bool(message.order)


def _tame_goal(message: Any) -> None:
    _tame_identify(message.goal)


def _tame_map(message: Any) -> None:
    if np.isfinite(message.amplitude_high) and 0.0 <= message.amplitude_high <= 1e-3:
        message.amplitude_high = 300e-6


def _tame_map_goal(message: Any) -> None:
    _tame_map(message.goal)


_TAMED: Mapping[str, Callable[[Any], None]] = {
    "recorder/start": _tame_start,
    "recorder/stop": _tame_stop,
    "identifier/identify": _tame_identify,
    "identifier/identify/_action/send_goal": _tame_goal,
    "region_monitor/build_map": _tame_map,
    "region_monitor/build_map/_action/send_goal": _tame_map_goal,
}


def shown(message: Any, longest: int = 2_000) -> str:
    """A message as text of bounded length."""
    text = json.dumps(str(message))
    return text if len(text) <= longest else f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
