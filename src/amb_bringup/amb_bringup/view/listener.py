"""Listens to the topics of a graph in a thread of its own, and hands the messages over in a queue of bounded length."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.executors import ExternalShutdownException

from amb_bringup.client.connection import GraphConnection
from amb_msgs.msg import (
    BridgeState,
    Excitation,
    ExcitationStatus,
    LoopSamples,
    Machine,
    RegionMap,
    RegionState,
    SimulatorState,
    StateSpaceModel,
    Trip,
)
from amb_ros import topics
from amb_ros.diagnostics import TOPIC as DIAGNOSTICS
from amb_ros.qos import EVERY_STATE, LATCHED
from amb_ros.subscriptions import create_display_subscription, create_subscription

LOG = "/rosout"
KEPT_MESSAGES = 2000  # a server that stalls for longer than their span shows a gap
TELEMETRY_DEPTH = 100
DIAGNOSTICS_DEPTH = 100

STATES = {
    topics.MACHINE: (Machine, LATCHED),
    topics.SIMULATOR_STATE: (SimulatorState, LATCHED),
    topics.BRIDGE_STATE: (BridgeState, LATCHED),
    topics.REGION: (RegionState, LATCHED),
    topics.REGION_MAP: (RegionMap, LATCHED),
    topics.EXCITATION: (Excitation, LATCHED),
    topics.EXCITATION_STATUS: (ExcitationStatus, LATCHED),
    topics.MODEL: (StateSpaceModel, LATCHED),
    topics.TRIP: (Trip, EVERY_STATE),
    LOG: (Log, EVERY_STATE),
}


class GraphListener:
    """Subscriptions of the live page.

    Parameters
    ----------
    namespace : str
        Namespace of the nodes.

    Attributes
    ----------
    messages : deque of tuple
        Topic, message and time of publication (ns since the epoch; 0 if not known), oldest first. The reader removes
        them; the oldest are lost when nobody does.
    """

    def __init__(self, namespace: str = topics.NAMESPACE) -> None:
        self.messages: deque[tuple[str, Any, int]] = deque(maxlen=KEPT_MESSAGES)
        self._connection = GraphConnection(namespace, 10.0, None, ())
        node = self._connection.node
        create_display_subscription(node, LoopSamples, topics.TELEMETRY, self._taker(topics.TELEMETRY), TELEMETRY_DEPTH)
        for topic, (message_type, qos) in STATES.items():
            create_subscription(node, message_type, topic, self._taker(topic), qos)
        node.create_subscription(DiagnosticArray, DIAGNOSTICS, self._taker(DIAGNOSTICS), DIAGNOSTICS_DEPTH)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="listener")
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._ending.set()
        self._thread.join()

    def _taker(self, topic: str) -> Callable[..., None]:
        def take(message: Any, published: int = 0) -> None:
            self.messages.append((topic, message, published))

        # rclpy would take the second argument for a request for the message's info
        return take if topic == topics.TELEMETRY else lambda message: take(message)

    def _listen(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._ending.is_set():
                self._connection.spin_once(0.1)
        self._connection.close()  # in the thread that spins
