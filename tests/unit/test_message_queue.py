"""The queue of a recorder: its size is bounded, and what does not fit is counted."""

from __future__ import annotations

from amb_ident_node.message_queue import OVERHEAD, Loss, MessageQueue, Waiting, describe_losses

SIZE = 1000  # B, of each message
CAPACITY = 20 * SIZE


def block(number: int) -> Waiting:
    return Waiting("/telemetry", bytes(SIZE - OVERHEAD), number, steps=100)


def state(number: int) -> Waiting:
    return Waiting("/state", bytes(SIZE - OVERHEAD), number)


def queue() -> MessageQueue:
    return MessageQueue(CAPACITY, essential=["/state"])


def test_messages_come_out_as_they_went_in() -> None:
    waiting = queue()
    assert all(waiting.put(block(number)) for number in range(5))
    assert [waiting.pop().received for _ in range(len(waiting))] == list(range(5))
    assert waiting.size == 0
    assert waiting.dropped == {}


def test_the_size_is_bounded_and_what_does_not_fit_is_counted() -> None:
    waiting = queue()
    accepted = [waiting.put(block(number)) for number in range(30)]
    assert accepted == [True] * 18 + [False] * 12
    assert waiting.size == 18 * SIZE
    assert waiting.dropped == {"/telemetry": Loss(12, 1200)}
    assert describe_losses(waiting.dropped) == "12 messages of /telemetry (1200 steps)"


def test_a_full_queue_still_takes_what_explains_the_streams() -> None:
    waiting = queue()
    for number in range(30):
        waiting.put(block(number))
    assert [waiting.put(state(number)) for number in range(3)] == [True, True, False]
    assert waiting.dropped["/state"] == Loss(1, 0)


def test_after_an_overflow_streams_wait_until_half_of_the_queue_is_empty() -> None:
    waiting = queue()
    for number in range(20):
        waiting.put(block(number))
    while waiting.size > CAPACITY / 2:
        assert not waiting.put(block(50))
        waiting.pop()
    waiting.pop()
    assert waiting.put(block(60))


def test_what_is_dropped_at_the_end_is_counted() -> None:
    waiting = queue()
    for number in range(3):
        waiting.put(block(number))
    waiting.drop_all()
    assert (len(waiting), waiting.size) == (0, 0)
    assert waiting.dropped == {"/telemetry": Loss(3, 300)}
