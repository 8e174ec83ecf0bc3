"""The second before a trip, as a port must keep it: of a trip that a lowered range of the sensors causes, at rest.

Its rows are compared with the telemetry of the same steps: rows of other steps can look as if they were right.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from amb_core.rig.link import commands
from amb_core.rig.link.answers import TelemetryBlock, Trip
from amb_core.rig.link.conformance.exchange import Exchange, Received
from amb_core.rig.link.layout import Code, TargetState

Arrays = NDArray[np.float64]

MOVED = 1e-6  # m: reference of the later rows; earlier ones have 0
PAUSE = 0.05  # s at each reference
FRAME = 20  # samples of telemetry
NOTHING = 1e-15  # m: no sensor shows less all the time


def check_record(target: Exchange) -> Iterator[str]:
    """What is wrong with the rows; nothing for a target that keeps none, which it need not.

    Parameters
    ----------
    target : Exchange
        Exchange with the target.

    Yields
    ------
    str
        What the port does wrong.
    """
    axes, limits = target.session.axes, target.description.limits
    known = target.command(commands.record(0)).code is not Code.UNKNOWN
    if not known or target.command(commands.fault_reset()).code is not Code.DONE:  # locked after a trip of before
        return
    telemetry = _moved(target, axes)
    target.command(commands.limits(replace(limits, sensor_range=NOTHING)))
    trip = _first_trip(target)
    if trip is not None:
        yield from _rows(target, trip, telemetry)
    for command in (
        commands.limits(limits), commands.fault_reset(), commands.nominal_reference((0.0,) * axes),
    ):  # fmt: skip
        target.command(command)
    if target.command(commands.record(0)).code is not Code.WRONG_STATE:
        yield "FAULT_RESET does not forget the second before a trip"


def _moved(target: Exchange, axes: int) -> list[TelemetryBlock]:
    """Telemetry while the reference moves."""
    target.command(commands.stream(FRAME))
    heard: list[Received] = []
    for place in (0.0, MOVED):
        move = commands.nominal_reference((place,) * axes)
        target.send(target.writer.write(move))
        heard += target.listen(PAUSE)
        target.command(move)  # where the first was lost
    target.command(commands.stream(0))
    return [one.answer for one in heard if isinstance(one.answer, TelemetryBlock)]


def _first_trip(target: Exchange) -> Trip | None:
    """The trip; None where all positions are exactly 0, and nothing trips."""
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        if trips := target.command(commands.heartbeat()).status.trips:
            return trips[0]
    return None


def _rows(target: Exchange, trip: Trip, telemetry: list[TelemetryBlock]) -> Iterator[str]:
    blocks: list[TelemetryBlock] = []
    rows = -1
    while rows < 0 or sum(block.steps for block in blocks) < rows:
        reply = target.command(commands.record(sum(block.steps for block in blocks)))
        if reply.code is Code.WRONG_STATE and not blocks:
            return  # it has no memory for it
        if reply.code is not Code.DONE or reply.record is None or not reply.record.samples.steps:
            yield f"RECORD: code {reply.code.name}, no rows after {sum(block.steps for block in blocks)} of {rows}"
            return
        rows = reply.record.rows
        blocks.append(reply.record.samples)
    first = blocks[0].first_step
    steps = np.concatenate([np.arange(block.first_step, block.first_step + block.steps) for block in blocks])
    if not np.array_equal(steps, np.arange(first, first + rows)) or first + rows != trip.step:
        yield f"RECORD: {rows} rows from step {first} onwards; the trip is at step {trip.step}"
    reference, position, current = (
        np.concatenate([getattr(block, name) for block in blocks]) for name in ("reference", "position", "current")
    )
    states = np.concatenate([block.status for block in blocks if block.status is not None]) & 7
    if set(states.tolist()) != {TargetState.OFF}:
        yield "RECORD: rows with another state than OFF, which was that before the trip"
    if (np.diff(reference, axis=0) < 0.0).any() or not np.array_equal(
        reference[-1], np.full(reference.shape[1], MOVED, np.float32)
    ):
        yield "RECORD: references that are not those of the steps before the trip, in their order"
    elif not all(_agree(block, first, reference, position) for block in telemetry):
        yield "RECORD: rows that are not those of the telemetry of the same steps"
    if current.any() or np.isnan(position).any():
        yield "RECORD: currents while the amplifiers are off, or positions that are none"


def _agree(block: TelemetryBlock, first: int, reference: Arrays, position: Arrays) -> bool:
    """Whether telemetry has the values of the rows, which begin at a step, as far as both have the same steps."""
    low, high = max(block.first_step, first), min(block.first_step + block.steps, first + len(reference))
    if low >= high:
        return True
    sent, kept = slice(low - block.first_step, high - block.first_step), slice(low - first, high - first)
    return np.array_equal(block.reference[sent], reference[kept]) and np.array_equal(
        block.position[sent], position[kept], equal_nan=True
    )
