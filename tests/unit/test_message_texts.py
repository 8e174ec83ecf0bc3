"""Answers of services with texts or contents that ROS does not carry: the caller gets an answer in every case."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest
from lifecycle_msgs.srv import ChangeState
from rclpy.serialization import deserialize_message, serialize_message

from amb_msgs.srv import Identify
from amb_ros.deferred_answers import answer_by
from amb_ros.message_texts import with_plain_texts


def arrived(message: Any) -> Any:
    """The message as its receiver has it."""
    return deserialize_message(serialize_message(message), type(message))


def test_texts_that_ros_does_not_carry_arrive_with_escapes_and_all_others_as_they_are() -> None:
    answer = Identify.Response(message="unit \ud800", verdict="cut\0here", warnings=["a\udcff", "\x1b[2J µ"])
    answer.model.method, answer.model.input_names = "rig\udcff", ["\ud800"]
    answer.model.a = [1.0, 2.0]
    got = arrived(with_plain_texts(answer))
    assert (got.message, got.verdict) == (r"unit \ud800", r"cut\x00here")
    assert got.warnings == [r"a\udcff", "\x1b[2J µ"]
    assert (got.model.method, got.model.input_names) == (r"rig\udcff", [r"\ud800"])
    assert list(got.model.a) == [1.0, 2.0]


class Sender:
    """A service of a node that serializes what it sends, as rclpy does."""

    def __init__(self) -> None:
        self.srv_name = "identify"
        self.sent: list[Any] = []
        self.callback: Any = None
        self.node: Any = SimpleNamespace(
            context=SimpleNamespace(ok=lambda: True),
            get_logger=lambda: logging.getLogger("test"),
            get_fully_qualified_name=lambda: "/amb/identifier",
        )

    def send_response(self, response: Any, _header: Any) -> None:
        self.sent.append(arrived(response))

    def ask(self, work: Any, response: Any) -> Any:
        answer_by(self.node, self, work, None)
        self.send_response(self.callback(None, response), SimpleNamespace(sequence_number=1))
        (answer,) = self.sent
        return answer


@pytest.mark.parametrize("text", ["\ud800", "rig \udcff.mcap"])
def test_a_text_that_ros_does_not_carry_is_answered(text: str) -> None:
    answer = Sender().ask(lambda _, response: _with(response, message=text), Identify.Response())
    assert answer.message == text.encode(errors="backslashreplace").decode()


def test_an_answer_that_cannot_be_sent_is_answered_with_the_reason() -> None:
    def work(_: Any, response: Any) -> Any:
        response.success = True
        response.model._order = 2**70  # past the check of the setter, as without field checks
        return response

    answer = Sender().ask(work, Identify.Response())
    assert not answer.success
    assert "internal error in /amb/identifier: its answer cannot be sent: " in answer.message


def test_an_answer_without_a_text_that_cannot_be_sent_is_answered_too() -> None:
    answer = Sender().ask(lambda _, response: _with(response, _success=None), ChangeState.Response())
    assert not answer.success


def _with(response: Any, **values: Any) -> Any:
    for name, value in values.items():
        setattr(response, name, value)
    return response
