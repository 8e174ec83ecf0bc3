"""A managed (lifecycle) node that outlives wrong requests, and whose transitions may take their time.

rclpy 7.1.6 ends the whole process at a transition that the present state does not allow. Here such a request is
answered with success=false, and the log says what is allowed. Transitions run in a worker: topics and services go on.
A request to leave ends an activation that takes its time: who wants the rotor down does not wait until it is up.
There is no transition from `active` to an error: a node that falls into one deactivates itself and keeps the reason.
"""

from __future__ import annotations

import threading
import traceback
from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from amb_core.ground.errors import AmbError, bounded, one_line
from amb_core.ground.plain_text import plain_text
from amb_ros.alarms import RecentProblem
from amb_ros.deferred_answers import answer_by
from amb_ros.rclpy_inside import call

ACTIVATE, DEACTIVATE, SHUTDOWN = "activate", "deactivate", "shutdown"
LONGEST_LABEL = 50  # characters of a request that are repeated in the log


class CalledOffError(AmbError):
    """An activation is given up, since the node has been asked to leave meanwhile: no failure."""


class ManagedNode(LifecycleNode):
    """A managed node; a subclass gives what its transitions do, as methods that raise `AmbError` where they cannot.

    Attributes
    ----------
    worker : ThreadPoolExecutor
        Runs the transitions, and whatever must not run at the same time.
    problem : str
        Why the last transition failed or was called off; empty while one is under way, and after one that did not fail.
    failure : RecentProblem
        Transitions that failed, those that were called off apart.
    called_off : threading.Event
        Set while an activation must not begin or go on, since the node has been asked to leave meanwhile.
    refusal : str
        Why the last request was refused, since the present state does not allow it; empty after one that is allowed.
    """

    def __init__(self, name: str, **arguments: Any) -> None:
        self.worker = ThreadPoolExecutor(1, thread_name_prefix=name)
        self.problem = self.refusal = ""
        self.failure = RecentProblem()
        self.called_off = threading.Event()
        self._has_called_off = False  # the last transition: what follows is the request that has done so
        super().__init__(name, **arguments)
        answer_by(self, self._service_of(ChangeState, "change_state"), self._on_change, self.worker, self._note_leaving)

    # -- what a node gives

    @abstractmethod
    def configure(self) -> None:
        """From unconfigured to inactive."""

    @abstractmethod
    def activate(self) -> None:
        """From inactive to active."""

    @abstractmethod
    def deactivate(self) -> None:
        """From active to inactive."""

    @abstractmethod
    def clean_up(self) -> None:
        """From inactive to unconfigured, and at shutdown."""

    def holds_on(self) -> bool:
        """Whether a node that is not active has something to deactivate nevertheless, such as a rotor that is up."""
        return False

    def report_transition(self) -> None:
        """Publish `problem` and `refusal`, before the caller of a transition gets its answer, which has no text."""

    # -- transitions

    @property
    def state_label(self) -> str:
        """The present state: unconfigured, inactive, active, finalized, or that of a transition."""
        return str(self._present_state().label)

    def fall_back(self) -> Future[None]:
        """Deactivate the node if it is active, because of an error that its subclass has kept."""
        return self.worker.submit(self._fall_back)

    def _fall_back(self) -> None:
        if self.context.ok() and self._present_state().id == State.PRIMARY_STATE_ACTIVE:
            self.trigger_deactivate()

    # rclpy has no public attribute for state and transitions; the node's own services give them.
    def _service_of(self, service_type: Any, name: str) -> Any:
        full = self.resolve_service_name(f"~/{name}")
        return next(item for item in self.services if item.srv_type is service_type and item.service_name == full)

    def _present_state(self) -> State:
        service = self._service_of(GetState, "get_state")
        state: State = call(service, GetState.Request(), GetState.Response()).current_state
        return state

    def _allowed(self) -> dict[str, int]:
        """Numbers of the transitions that the present state allows, by their labels."""
        kind = GetAvailableTransitions
        answer = call(self._service_of(kind, "get_available_transitions"), kind.Request(), kind.Response())
        return {item.transition.label: item.transition.id for item in answer.available_transitions}

    def _note_leaving(self, request: Any) -> tuple[()]:
        """The latest request decides whether the node is to be active."""
        asked = _name_of(request.transition)
        if asked in (DEACTIVATE, SHUTDOWN):
            self.called_off.set()
        elif asked == ACTIVATE:
            self.called_off.clear()
        return ()

    def _on_change(self, request: Any, response: Any) -> Any:
        try:
            response.success = self._change(request.transition)
        except Exception:  # in every case the caller gets an answer and the node keeps running
            self.get_logger().error(plain_text(traceback.format_exc()))
            response.success = False
        self.report_transition()
        return response

    def _change(self, asked: Any) -> bool:
        """Do a transition, asked for by its label or number, if the present state allows it."""
        allowed = self._allowed()
        label = asked.label or next((name for name, number in allowed.items() if number == asked.id), "")
        triggers: dict[str, Callable[[], Any]] = {
            "configure": self.trigger_configure,
            ACTIVATE: self.trigger_activate,
            DEACTIVATE: self.trigger_deactivate,
            "cleanup": self.trigger_cleanup,
            SHUTDOWN: self.trigger_shutdown,
        }
        name = bounded(_name_of(asked), LONGEST_LABEL)
        called_off, self._has_called_off = self._has_called_off, False
        holds_on = name == DEACTIVATE and DEACTIVATE not in allowed and self.holds_on()
        if holds_on or (called_off and name in (DEACTIVATE, SHUTDOWN)):  # by a node that is not active
            done = self._done(DEACTIVATE, self.deactivate) == TransitionCallbackReturn.SUCCESS
            if name == DEACTIVATE or not done:
                self.refusal = ""
                return done
        if label not in allowed or label not in triggers:
            possible = ", ".join(name for name in triggers if name in allowed) or "none, the node has been shut down"
            self.refusal = f"{name} is not allowed while {self.state_label}; allowed: {possible}"
            self.get_logger().error(self.refusal)
            return False
        self.get_logger().info(f"{label}: asked for")
        self.refusal = ""
        first = [DEACTIVATE] if label == SHUTDOWN and DEACTIVATE in allowed else []
        return all(triggers[name]() == TransitionCallbackReturn.SUCCESS for name in [*first, label])

    def _done(self, name: str, work: Callable[[], None]) -> TransitionCallbackReturn:
        self.problem = ""
        try:
            work()
        except CalledOffError as reason:
            self.problem = f"{name}: {one_line(reason)}"
            self.get_logger().info(self.problem)
            return TransitionCallbackReturn.FAILURE
        except AmbError as problem:
            self.problem = f"{name}: {one_line(problem)}"
        except Exception as problem:
            self.get_logger().error(plain_text(traceback.format_exc()))
            self.problem = bounded(f"{name}: internal error: {problem!r}; see the log")
        else:
            self.get_logger().info(f"{name}: done")
            return TransitionCallbackReturn.SUCCESS
        self.failure.note(self.problem)
        self.get_logger().error(self.problem)
        return TransitionCallbackReturn.FAILURE

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; a failure leaves the node unconfigured."""
        return self._done("configure", self.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; a failure leaves the node inactive."""
        done = self._done(ACTIVATE, self.activate)
        self._has_called_off = done != TransitionCallbackReturn.SUCCESS and self.called_off.is_set()
        return done

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate; a failure leaves the node active, so that it can be asked again."""
        return self._done(DEACTIVATE, self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        return self._done("cleanup", self.clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up; the node is finalized in every case. One that is active has been deactivated before."""
        self._done("cleanup", self.clean_up)
        return TransitionCallbackReturn.SUCCESS


def _name_of(transition: Any) -> str:
    """What a request asks for, by its label or number."""
    return str(transition.label) or _NAMES.get(transition.id, f"transition {transition.id}")


_NAMES = {
    Transition.TRANSITION_CONFIGURE: "configure",
    Transition.TRANSITION_CLEANUP: "cleanup",
    Transition.TRANSITION_ACTIVATE: ACTIVATE,
    Transition.TRANSITION_DEACTIVATE: DEACTIVATE,
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: SHUTDOWN,
    Transition.TRANSITION_INACTIVE_SHUTDOWN: SHUTDOWN,
    Transition.TRANSITION_ACTIVE_SHUTDOWN: SHUTDOWN,
}
