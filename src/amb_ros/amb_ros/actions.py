"""Actions that always end with a result: bad goals are rejected, errors abort with a reason, workers do long work."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future

from amb_core.ground.errors import AmbError, bounded, one_line
from amb_core.ground.plain_text import plain_text
from amb_ros.message_texts import with_plain_texts
from amb_ros.rejections import RejectionPublisher

Callback = Callable[[Any, Callable[[Any], None], Callable[[], bool]], Any]
Check = Callable[[Any], None]


def create_action(
    node: Node, action_type: Any, name: str, callback: Callback, worker: Executor, check: Check
) -> ActionServer:
    """Offer an action whose result has the fields `success` and `message`.

    A goal is accepted unless `check` refuses it. Every request to cancel is accepted; a goal that waits for others ends
    at once. The worker decides the order of the goals.

    Parameters
    ----------
    node : Node
        The node.
    action_type, name
        As for `rclpy.action.ActionServer`.
    callback : callable
        Called in the worker with the goal, a function that publishes a feedback message, and one that returns whether
        the goal was cancelled; returns the result. A result without `success` counts as cancelled if that was
        requested, otherwise as aborted. An exception of the callback becomes such a result with a message: the text of
        an `AmbError` unchanged, anything else as an internal error, with its traceback in the log.
    worker : concurrent.futures.Executor
        Runs the callback, which may block.
    check : callable
        Called in the executor with every goal before it is accepted, for quick checks. An `AmbError` that it raises
        rejects the goal; its text is logged and published (see `amb_ros.rejections`).
    """
    goals = _Goals(node, action_type, callback, worker, check, RejectionPublisher(node, name))
    return ActionServer(
        node,
        action_type,
        name,
        goals.execute,
        goal_callback=goals.judge,
        cancel_callback=goals.cancel,
    )


@dataclass(frozen=True)
class _Goals:
    """Handles the goals of an action."""

    node: Node
    action_type: Any
    callback: Callback
    worker: Executor
    check: Check
    rejections: RejectionPublisher
    waiting: dict[bytes, Callable[[], None]] = field(default_factory=dict)
    """By the number of a goal, what ends one that has not begun."""

    def judge(self, goal: Any) -> GoalResponse:
        """Accept a goal, or reject it and publish why."""
        try:
            self.check(goal)
        except AmbError as problem:
            self.rejections.publish(goal, one_line(problem))
            return GoalResponse.REJECT
        except Exception as problem:  # in every case the caller gets an answer and the node keeps running
            self.rejections.publish(goal, self._internal_error(problem))
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    async def execute(self, goal: ServerGoalHandle) -> Any:
        """The result of a goal, once the worker has finished, or it has been cancelled before the worker was free."""
        finished: Future = Future(executor=self.node.executor)
        work = self.worker.submit(self._work, goal, finished)
        self.waiting[_number(goal)] = lambda: self._finish(finished, None) if work.cancel() else None
        result = await finished
        del self.waiting[_number(goal)]
        if result is None:
            goal.canceled()
            return self.action_type.Result(message="cancelled before it began")
        return result

    def cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        """Accept; a goal that waits for the worker ends at once."""
        if call_off := self.waiting.get(_number(goal)):
            call_off()
        return CancelResponse.ACCEPT

    def _work(self, goal: ServerGoalHandle, finished: Future) -> None:
        try:
            result = self._outcome(goal)
        except Exception:
            if self.node.context.ok():
                raise
            return  # the node was shut down meanwhile, and nobody waits any more
        self._finish(finished, result)

    def _finish(self, finished: Future, result: Any) -> None:
        finished.set_result(result)
        # EventsExecutor resumes a coroutine only after another event. This triggers one.
        if self.node.executor is not None:
            self.node.executor.create_task(lambda: None)

    def _outcome(self, goal: ServerGoalHandle) -> Any:
        result = self._result(goal)
        if result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return result

    def _result(self, goal: ServerGoalHandle) -> Any:
        def publish_feedback(message: Any) -> None:
            if self.node.context.ok():
                goal.publish_feedback(message)

        try:
            result = with_plain_texts(self.callback(goal.request, publish_feedback, lambda: goal.is_cancel_requested))
            serialize_message(result)  # what cannot be sent would end the executor, which sends it
            return result
        except AmbError as problem:
            return self.action_type.Result(message=one_line(problem))
        except Exception as problem:  # in every case the caller gets a result and the node keeps running
            return self.action_type.Result(message=self._internal_error(problem))

    def _internal_error(self, problem: Exception) -> str:
        self.node.get_logger().error(plain_text(traceback.format_exc()))
        return bounded(f"internal error in {self.node.get_fully_qualified_name()}: {problem!r}; see its log")


def _number(goal: ServerGoalHandle) -> bytes:
    return bytes(goal.goal_id.uuid)
