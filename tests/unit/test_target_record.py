"""The second before a trip, which the C target keeps by itself: whole, read with the key only, and without delay."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.rig.link import (
    Code,
    Command,
    CommandWriter,
    FrameType,
    Limits,
    ReferenceTarget,
    Reply,
    Session,
    TargetState,
    TelemetryBlock,
    TripReason,
    commands,
    excitation_upload,
)
from amb_core.rig.link.layout import LARGEST_FRAME
from tests.target_rig import HOST, NONCE, Rig, library, machine

SECOND = 10_000  # steps


def read(rig: Rig) -> list[TelemetryBlock]:
    """All rows that the target keeps."""
    blocks: list[TelemetryBlock] = []
    while True:
        part = rig.command(commands.record(sum(block.steps for block in blocks))).record
        assert part is not None
        if not part.samples.steps:
            return blocks
        blocks.append(part.samples)


def run(rig: Rig, steps: int, seed: int = 1) -> NDArray[np.float64]:
    """So many steps with small noise, a sign of life among them; the measured positions."""
    positions = np.random.default_rng(seed).normal(0.0, 1e-6, (steps, rig.session.axes))
    for number, position in enumerate(positions):
        rig.step(position)
        if number % 100 == 0:
            rig.command(commands.heartbeat())
    return positions


def trip(rig: Rig) -> int:
    """A sensor that fails; the step of the trip."""
    rig.step(np.full(rig.session.axes, math.nan))
    (latched,) = rig.status().trips
    return latched.step


def test_the_second_before_a_trip_is_whole_although_no_telemetry_was_sent() -> None:
    rig = Rig()
    rig.levitate()
    positions = run(rig, SECOND + 1_234)
    step = trip(rig)
    blocks = read(rig)
    assert blocks[0].first_step == step - SECOND
    assert sum(block.steps for block in blocks) == SECOND
    np.testing.assert_array_equal(
        np.concatenate([block.position for block in blocks]), positions[-SECOND:].astype(np.float32)
    )
    states = np.concatenate([block.status for block in blocks if block.status is not None]) & 7
    assert set(states.tolist()) <= {TargetState.LEVITATING, TargetState.LEVITATED}


def test_its_rows_are_those_of_telemetry() -> None:
    rig = Rig()
    rig.command(commands.stream(10, 4))
    rig.levitate()
    run(rig, 20)
    rig.command(commands.heartbeat())
    sent: list[TelemetryBlock] = []
    for number in range(30):
        rig.step((1e-6 * number, -1e-6))
        sent += [answer for answer in rig.answers() if isinstance(answer, TelemetryBlock)]
    trip(rig)
    kept = read(rig)
    first = kept[0].first_step
    for block in sent:
        rows = slice(block.first_step - first, block.first_step - first + block.steps)
        for name in ("reference", "position", "current", "status"):
            whole = np.concatenate([getattr(part, name) for part in kept])
            np.testing.assert_array_equal(whole[rows], getattr(block, name))
    assert sum(block.steps for block in sent) >= 30


def test_a_short_run_is_kept_from_its_first_step() -> None:
    rig = Rig()
    rig.levitate()
    run(rig, 100)
    step = trip(rig)
    blocks = read(rig)
    assert (blocks[0].first_step, sum(block.steps for block in blocks)) == (0, step)


@pytest.mark.parametrize("axes", [2, 16])
def test_replies_are_full_and_fit_into_a_frame(axes: int) -> None:
    rig = Rig(axes)
    rig.levitate()
    run(rig, 400)
    trip(rig)
    frame = rig.writer.write(commands.record(0))
    rig.target.feed(frame, HOST)
    ((answer, _),) = rig.target.take()
    row = 4 * (3 * axes + 1)
    assert LARGEST_FRAME - row < len(answer) <= LARGEST_FRAME


def test_what_is_kept_stands_still() -> None:
    rig = Rig()
    rig.levitate()
    run(rig, 300)
    trip(rig)
    before = read(rig)
    run(rig, 500, seed=2)
    after = read(rig)
    np.testing.assert_array_equal(
        np.concatenate([block.position for block in before]), np.concatenate([block.position for block in after])
    )


def test_a_reset_forgets_it_and_the_next_trip_has_a_record_of_its_own() -> None:
    rig = Rig()
    rig.levitate()
    run(rig, 300)
    trip(rig)
    rig.command(commands.fault_reset())
    assert rig.command(commands.record(0)).code is Code.WRONG_STATE
    rig.levitate()
    positions = run(rig, 50, seed=3)
    step = trip(rig)
    blocks = read(rig)
    assert blocks[-1].first_step + blocks[-1].steps == step
    kept = np.concatenate([block.position for block in blocks])
    np.testing.assert_array_equal(kept[-50:], positions.astype(np.float32))


def silent_host(rig: Rig) -> int:
    """A trip that leaves the loop closed: an excitation that plays while no command comes; its step."""
    rig.upload(excitation_upload(1, np.full((5_000, 2), 1e-6)))
    rig.command(commands.arm(1, rig.target.steps))
    rig.noise(400, alive=False)
    (latched,) = rig.status().trips
    assert (latched.reason, rig.status().state) == (TripReason.HOST_SILENT, TargetState.LEVITATED)
    return latched.step


def test_a_trip_that_leaves_the_loop_closed_is_kept_until_it_has_been_read() -> None:
    rig = Rig(2, Limits(settle_time=1e-4))
    rig.levitate()
    run(rig, 300)
    step = silent_host(rig)
    blocks = read(rig)
    assert blocks[-1].first_step + blocks[-1].steps == step
    assert rig.command(commands.forget_record()).code is Code.DONE
    run(rig, 200, seed=4)
    rig.step((math.nan, 0.0))
    failed = rig.status().trips[-1]
    kept = read(rig)
    assert failed.reason is TripReason.SENSOR_RANGE
    assert kept[-1].first_step + kept[-1].steps == failed.step


@pytest.mark.parametrize(("seconds", "second"), [(9.0, False), (10.1, True)])
def test_where_nobody_reads_it_the_second_before_the_next_trip_replaces_it(seconds: float, second: bool) -> None:
    rig = Rig(2, Limits(settle_time=1e-4))
    rig.levitate()
    run(rig, 300)
    first = silent_host(rig)
    run(rig, round(seconds * 1e4))
    rig.step((math.nan, 0.0))
    failed = rig.status().trips[-1].step
    blocks = read(rig)
    assert blocks[-1].first_step + blocks[-1].steps == (failed if second else first)


def test_without_the_key_nobody_reads_or_forgets_it() -> None:
    rig = Rig()
    rig.levitate()
    run(rig, 300)
    trip(rig)
    kept = read(rig)
    stranger = CommandWriter(Session(rig.session.nonce, 2, 0, bytes(32)), rig.writer.counter)
    for command in (commands.record(0), commands.forget_record()):
        assert rig.send(stranger.write(command)) == []
    assert rig.status().forged == 2
    assert sum(block.steps for block in read(rig)) == sum(block.steps for block in kept)


def test_an_old_frame_does_not_make_it_forget() -> None:
    rig = Rig()
    rig.levitate()
    run(rig, 300)
    trip(rig)
    forget = rig.writer.write(commands.forget_record())
    rig.send(forget)
    rig.command(commands.fault_reset())
    rig.step((1e-6, 0.0))
    rig.step((math.nan, 0.0))
    assert rig.send(forget) == []
    assert sum(block.steps for block in read(rig)) > 0


def test_a_repeated_reply_has_no_rows() -> None:
    rig = Rig()
    rig.levitate()
    trip(rig)
    frame = rig.writer.write(commands.record(0))
    first, again = rig.send(frame), rig.send(frame)
    records = [reply.record for reply in (*first, *again) if isinstance(reply, Reply)]
    assert [part is None for part in records] == [False, True]


@pytest.mark.parametrize("body", [(0, 2), (1, 1), (4, 0), (0xFFFFFFFF, 0), (0xFFFFFFFF, 0xFFFFFFFF)])
def test_rows_that_are_not_there_are_refused(body: tuple[int, int]) -> None:
    rig = Rig()
    rig.levitate()
    trip(rig)
    first, what = (number.to_bytes(4, "little") for number in body)
    assert rig.command(Command(FrameType.RECORD, first + what)).code is Code.BAD_VALUE


def test_a_target_without_memory_for_it_keeps_none_and_says_so() -> None:
    rig = Rig()
    rig.target = ReferenceTarget(library(), machine(2), key=rig.key, nonce=NONCE, record_steps=0)
    rig.connect()
    rig.levitate()
    trip(rig)
    assert rig.command(commands.record(0)).code is Code.WRONG_STATE


def test_the_largest_counter_does_not_make_a_target_deaf() -> None:
    """A host with the key and a fault in its counting."""
    rig = Rig()
    for counter in ((1 << 64) - 2, (1 << 63), (1 << 32) + rig.writer.counter):
        mistaken = CommandWriter(rig.session, counter)
        assert rig.send(mistaken.write(commands.heartbeat())) == []
    assert rig.command(commands.heartbeat()).code is Code.DONE
    assert rig.status().replayed == 3


def test_counters_may_still_be_left_out() -> None:
    rig = Rig()
    rig.writer.catch_up(rig.writer.counter + (1 << 32) - 2)
    assert rig.command(commands.heartbeat()).code is Code.DONE
