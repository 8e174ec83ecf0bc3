"""A connection to the nodes of a graph: services and actions as plain calls, with timeouts and clear errors."""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType, TracebackType
from typing import Any, Self

import rclpy
from action_msgs.msg import GoalStatus
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.validate_namespace import validate_namespace

from amb_bringup.client.errors import ClientError, NoAnswerError
from amb_bringup.client.messages import filled
from amb_core.ground.given_values import number, refusal, texts, whole_number
from amb_ros import interruptions, middleware
from amb_ros.domain import LAST_DOMAIN, require_domain
from amb_ros.leaving import leave_graph_and_go_on
from amb_ros.rejections import RejectionListener
from amb_ros.requests import PendingRequest

UNKNOWN = "; it may have been carried out: look at the state of the node before you ask again"
RESULT_PERIOD = 4.0  # s until the result of a goal is asked for again; less than the 10 s for which rclpy keeps results
REASON_TIMEOUT = 5.0  # s; longest wait for the published reason of a rejection
_NONE: Mapping[str, Any] = MappingProxyType({})


class GraphConnection:
    """Calls services and actions of the nodes of one graph, from one thread at a time.

    Parameters
    ----------
    namespace : str
        Namespace of the nodes.
    timeout : float
        Longest wall-clock wait for a node to appear, to answer or, while running, to advance (s).
    domain_id : int, optional
        DDS domain of the graph, 0 to 232; ROS_DOMAIN_ID by default.
    nodes : sequence of str
        The nodes of the graph, relative to the namespace.

    Attributes
    ----------
    node : Node
        The node behind the calls, for the user's own subscriptions; its callbacks run during calls and `wait_until`.

    Raises
    ------
    ClientError
        By every method, if a node is missing, does not answer within the timeout, or refuses; for arguments that are
        not allowed; and while another thread is in a call of this connection.
    """

    def __init__(self, namespace: str, timeout: float, domain_id: int | None, nodes: Sequence[str]) -> None:
        self.timeout = seconds("timeout", timeout)
        self._nodes = texts("nodes", nodes, ClientError)
        _check_namespace(namespace)
        domain_id = checked_domain(domain_id)
        self._context = Context()
        middleware.configure()
        with interruptions.held_back():
            rclpy.init(context=self._context, domain_id=domain_id)
            # It logs nothing, and several connections of one process would share one publisher of the log.
            self.node = Node(
                "amb_client",
                namespace=namespace,
                context=self._context,
                start_parameter_services=False,
                enable_rosout=False,
            )
            self._executor = EventsExecutor(context=self._context)
            self._executor.add_node(self.node)
        # Also for a client that is never closed: an open connection can crash the interpreter while it ends.
        self._leave = weakref.finalize(self, _leave, self._executor, self.node, self._context)
        self._in_call = threading.RLock()
        self._spinning = False
        self._clients: dict[str, Any] = {}
        self._rejections: dict[str, RejectionListener] = {}  # by action

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph, within 5 s also if the middleware hangs."""
        self._leave()

    def require_open(self) -> None:
        """Refuse to go on after `close`.

        Raises
        ------
        ClientError
            If the client is closed.
        """
        if not self._leave.alive:
            raise ClientError("this client is closed; open another")

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other threads out until the end of a call, which may consist of several.

        Yields
        ------
        None
            In the call.

        Raises
        ------
        ClientError
            If another thread is in a call, or if this one is called from a callback, in the middle of another call.
        """
        if not self._in_call.acquire(blocking=False):
            raise ClientError("this client is in a call of another thread; allowed: one client per thread")
        try:
            if self._spinning:
                raise ClientError(
                    "this client is called from a callback, in the middle of another call; note what has arrived, and "
                    "call once that call has ended"
                )
            yield
        finally:
            self._in_call.release()

    def wait_for_nodes(self, check: Callable[[], None] = lambda: None, timeout: float | None = None) -> None:
        """Wait until all nodes of the graph are available.

        Parameters
        ----------
        check : callable, optional
            Called while waiting; may raise an error, which ends the wait.
        timeout : float, optional
            Longest wait for each (s); that of the connection by default.
        """
        self.require_open()
        for name in self._nodes:
            client = self.node.create_client(GetParameters, f"{name}/get_parameters")

            def ready(client: Any = client) -> bool:
                check()
                return bool(client.service_is_ready())

            self.wait_until(ready, timeout, f"node {name} did not appear; is it running?")
            self.node.destroy_client(client)

    def wait_until(
        self, condition: Callable[[], bool], timeout: float | None = None, complaint: str = "timed out"
    ) -> None:
        """Process messages until a condition holds.

        Parameters
        ----------
        condition : callable
            Returns whether it holds.
        timeout : float, optional
            Longest wait (s); that of the connection by default.
        complaint : str, optional
            Text of the error after it.

        Raises
        ------
        ClientError
            If the condition does not hold in time.
        """
        deadline = time.monotonic() + (self.timeout if timeout is None else seconds("timeout", timeout))
        with self.alone():
            while not condition():
                if time.monotonic() > deadline:
                    raise ClientError(complaint)
                self.spin_once(0.05)

    def node_names(self) -> set[str]:
        """Nodes that run in the namespace of this connection; those of other graphs in its domain are left out.

        Returns
        -------
        set of str
            Their names, without the namespace.
        """
        return set(self._running())

    def doubled_nodes(self) -> list[str]:
        """Nodes of the graph that run more than once: requests to them reach all.

        Returns
        -------
        list of str
            Their names, without the namespace.
        """
        running = self._running()
        return [name for name in self._nodes if running[name] > 1]

    def _running(self) -> Counter[str]:
        """How many nodes of each name run in the namespace."""
        self.require_open()
        space = self.node.get_namespace()
        return Counter(name for name, other in self.node.get_node_names_and_namespaces() if other == space)

    def spin_once(self, timeout: float = 0.1) -> None:
        """Process the next message.

        Parameters
        ----------
        timeout : float, optional
            Longest wait for it (s).
        """
        self.require_open()
        with self.alone(), interruptions.held_back():
            self._spinning = True
            try:
                self._executor.spin_once(timeout_sec=timeout)
            finally:
                self._spinning = False

    def process_arrived(self) -> None:
        """Process all messages that have arrived, without waiting for others."""
        self.require_open()
        marker = self._executor.create_task(lambda: None)  # the queue is in the order of arrival
        self.wait_until(marker.done)

    def call(
        self,
        service: Any,
        name: str,
        named: Mapping[str, Any] = _NONE,
        /,
        *,
        timeout: float | None = None,
        repeat_after: float = math.inf,
        **fields: Any,
    ) -> Any:
        """Call a service.

        Parameters
        ----------
        service : type
            Type of the service.
        name : str
            Its name, relative to the namespace.
        named : mapping of str to object, optional
            Fields of the request that are named like an argument of this method, such as timeout; none by default.
        timeout : float, optional
            Longest wait for the answer (s); that of the connection by default.
        repeat_after : float, optional
            Time without an answer after which the request is sent again, because it is idempotent (s); twice as long
            every time. Others are sent once: the node may have carried out what it has not answered.
        **fields : object
            Fields of the request, numbers and texts of Python or NumPy.

        Returns
        -------
        service response
            The answer, of the type of the service.

        Raises
        ------
        NoAnswerError
            If the answer does not come in time.
        ClientError
            If the node is missing or refuses the request, or a value does not fit its field.
        """
        self.require_open()
        wait = self.timeout if timeout is None else seconds("timeout", timeout)
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service, name)
        client = self._clients[name]
        full_name = self.node.resolve_service_name(name)
        request = filled(service.Request, full_name, {**named, **fields})
        self.wait_until(client.service_is_ready, self.timeout, f"no service {full_name}; is the node running?")
        pending = PendingRequest(client, request, repeat_after)
        try:
            self.wait_until(lambda: pending.answer() is not None, wait)
            answer = pending.answer()
        except ClientError:
            unknown = "" if math.isfinite(repeat_after) else UNKNOWN
            raise NoAnswerError(f"no answer from {full_name} within {wait:g} s{unknown}") from None
        finally:
            pending.forget()
        if not answer.success:
            raise ClientError(f"{full_name}: {answer.message}")
        return answer

    def act(
        self,
        action: Any,
        name: str,
        /,
        on_feedback: Callable[[Any], None],
        cancelled: Callable[[], bool],
        **fields: Any,
    ) -> Any:
        """Send a goal to an action and wait for its result without a time limit, or until its node has ended.

        Parameters
        ----------
        action : type
            Type of the action.
        name : str
            Its name, relative to the namespace.
        on_feedback : callable
            Called with every feedback message.
        cancelled : callable
            Called while waiting; when it returns true the goal is cancelled. The result may then be without `success`.
        **fields : object
            Fields of the goal, likewise.

        Returns
        -------
        action result
            The result, of the type of the action.

        Raises
        ------
        ClientError
            If the action is missing, refuses the goal or fails, its node ends, or a value does not fit its field.
        """
        self.require_open()
        if name not in self._clients:
            self._clients[name] = ActionClient(self.node, action, name)
            self._rejections[name] = RejectionListener(self.node, name)
        client = self._clients[name]
        full_name = self.node.resolve_service_name(name)
        goal = filled(action.Goal, full_name, fields)
        self.wait_until(client.server_is_ready, complaint=f"no action {full_name}; is the node running?")
        self._rejections[name].forget(goal)
        accepted = client.send_goal_async(goal, on_feedback)
        self.wait_until(accepted.done, complaint=f"no answer from {full_name} within {self.timeout:g} s{UNKNOWN}")
        handle = accepted.result()
        if not handle.accepted:
            raise ClientError(f"{full_name}: {self._reason(name, goal)}")
        asked = [handle.get_result_async()]
        ask_again = time.monotonic() + RESULT_PERIOD
        cancelling = False
        while (ended := next((future for future in asked if future.done()), None)) is None:
            if not client.server_is_ready():
                raise ClientError(f"{full_name}: its node has ended")
            if not cancelling and cancelled():
                handle.cancel_goal_async()
                cancelling = True
            if time.monotonic() > ask_again:  # the answer may be lost, or the node has been started again
                asked.append(handle.get_result_async())
                ask_again = time.monotonic() + RESULT_PERIOD
            self.spin_once()
        if ended.result().status == GoalStatus.STATUS_UNKNOWN:
            raise ClientError(f"{full_name}: its node has been started again, and does not know the goal any more")
        result = ended.result().result
        if not result.success and not cancelling:
            raise ClientError(f"{full_name}: {result.message}")
        return result

    def _reason(self, name: str, goal: Any) -> str:
        """Why an action has rejected a goal; its node publishes that before the rejection, on a separate topic."""
        heard = self._rejections[name]
        try:
            self.wait_until(lambda: heard.reason(goal) is not None, REASON_TIMEOUT)
        except ClientError:
            return "the goal was rejected; see the log of its node"
        return str(heard.reason(goal))


def seconds(name: str, value: float) -> float:
    """A time to wait (s), 0 or more; ClientError for anything else."""
    time_to_wait = number(name, value, ClientError)
    if not time_to_wait >= 0.0:
        raise refusal(name, value, "0 s or more", ClientError)
    return time_to_wait


def checked_domain(domain: int | None) -> int | None:
    """A DDS domain, None for that of ROS_DOMAIN_ID; ClientError for one that ends the process."""
    if domain is not None:
        chosen = whole_number("domain_id", domain, ClientError)
        if not 0 <= chosen <= LAST_DOMAIN:
            raise refusal("domain_id", domain, f"0 to {LAST_DOMAIN}", ClientError)
        return chosen
    require_domain(ClientError)
    return None


def _check_namespace(namespace: str) -> None:
    """Raise ClientError for what is no namespace of nodes."""
    try:
        if not isinstance(namespace, str):
            raise TypeError
        validate_namespace("/" + namespace.removeprefix("/"))
    except (TypeError, InvalidNamespaceException):
        raise refusal(
            "namespace", namespace, "letters, digits and _ between slashes, such as /amb", ClientError
        ) from None


def _leave(executor: Executor, node: Node, context: Context) -> None:
    with interruptions.held_back():
        leave_graph_and_go_on(context, executor, node)
