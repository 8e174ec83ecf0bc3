"""What a port of AMB-UDP must do, check by check, with the rotor at rest: nothing is levitated.

Each check returns what is wrong; nothing if all is right. Reference: docs/reference/target-protocol.md.
"""

from __future__ import annotations

import math
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from amb_core.ground.errors import TargetError
from amb_core.rig.link import commands
from amb_core.rig.link.answers import Reply, TargetStatus, TelemetryBlock
from amb_core.rig.link.commands import Command
from amb_core.rig.link.conformance.exchange import Exchange, Received
from amb_core.rig.link.conformance.record import check_record
from amb_core.rig.link.conformance.wrong_commands import wrong_commands
from amb_core.rig.link.frames import Refusal, encode, hello, seal, tag
from amb_core.rig.link.layout import (
    CHECKSUM,
    HEADER,
    LARGEST_FRAME,
    TAG,
    Code,
    FrameType,
    TargetState,
    UploadKind,
)  # fmt: skip
from amb_core.rig.link.upload import Upload

_RATE = 0.01  # relative error of rates
_TRIES = 3  # of the timing
_STATUS_WITHIN = 0.25  # s of the target's own time, of the 0.1 s in which it comes
Check = Callable[[Exchange], Iterator[str]]


@dataclass(frozen=True)
class Complaint:
    """Something that a port does wrong: the check that found it, and what it is.

    Attributes
    ----------
    check : str
        Name of the check that found it.
    text : str
        What the port does wrong.
    """

    check: str
    text: str


def check_target(target: Exchange) -> list[Complaint]:
    """Run all checks; the rotor stays at rest.

    Parameters
    ----------
    target : Exchange
        Exchange with the target.

    Returns
    -------
    list of Complaint
        What the target does wrong; empty if nothing.

    Raises
    ------
    TargetError
        If the target cannot be reached, or is levitated.
    """
    if wrong := target.find():
        return [Complaint("description", wrong)]
    try:
        status = target.command(commands.heartbeat()).status
    except TargetError as problem:
        return [Complaint("reply", str(problem))]
    if status.currents_on:
        raise TargetError(f"the target is {status.state.name.lower()}; it is checked with the rotor at rest")
    complaints = []
    for name, check in CHECKS.items():
        try:
            complaints += [Complaint(name, text) for text in check(target)]
        except TargetError as problem:
            complaints.append(Complaint(name, str(problem)))
    return complaints


def _code(target: Exchange, what: str, command: Command, *wanted: Code) -> Iterator[str]:
    code = target.command(command).code
    if code not in wanted:
        yield f"{what}: code {code.name}; expected: {' or '.join(one.name for one in wanted)}"


def _challenge(target: Exchange) -> Iterator[str]:
    for length, answered in ((1151, False), (1152, True), (1400, True)):
        payload = bytes(8) + bytes(range(16)) + bytes(length - 24)
        target.send(encode(FrameType.HELLO, payload))
        heard = [one for one in _heard(target) if one.datagram[5:6] == bytes([FrameType.DESCRIPTION])]
        if bool(heard) != answered:
            yield f"HELLO with {length} bytes: {'answered' if heard else 'not answered'}"
        if heard and heard[0].datagram[HEADER.size : HEADER.size + 16] != bytes(range(16)):
            yield "DESCRIPTION does not repeat the challenge"
        if heard and len(heard[0].datagram) > HEADER.size + length + CHECKSUM:
            yield "DESCRIPTION is longer than the HELLO that it answers"
    old = bytearray(hello())
    old[4] = 1
    target.send(_closed(old))
    if not any(one.datagram[5:6] == bytes([FrameType.DESCRIPTION]) for one in _heard(target)):
        yield "HELLO of another version is not answered, so no host can name the difference"


def _heard(target: Exchange) -> list[Received]:
    """Everything until the reply to a heartbeat."""
    between, _ = target.answers_before_heartbeat(target.writer.write(commands.heartbeat()))
    return [one for one in between if not isinstance(one.answer, Reply)]


def _closed(frame: bytearray) -> bytes:
    """A frame with its checksum made right."""
    frame[-CHECKSUM:] = struct.pack("<I", zlib.crc32(bytes(frame[:-CHECKSUM])))
    return bytes(frame)


def _description(target: Exchange) -> Iterator[str]:
    before = target.description
    if target.find() == "" and target.description.nonce != before.nonce:
        yield "the nonce changes from one HELLO to the next, without a boot"
    if target.description.counter < before.counter:
        yield "the counter in DESCRIPTION goes back"
    for axis, clearance in before.page:
        if not (clearance > 0.0 and axis.current_limit > 0.0 and abs(math.hypot(*axis.direction) - 1.0) < 1e-3):
            yield f"axis {axis.name}: clearance, largest current or direction is impossible"


def _hostile(target: Exchange) -> Iterator[str]:
    """Frames that are counted and dropped."""
    writer, session = target.writer, target.session
    genuine = bytearray(seal(session, FrameType.FAULT_RESET, writer.counter + 1000, b""))
    damaged, other, forged, version = (bytearray(genuine) for _ in range(4))
    damaged[-1] ^= 1
    other[8] ^= 1
    forged[-CHECKSUM - TAG] ^= 1
    late = bytearray(genuine)
    late[-CHECKSUM - 1] ^= 1
    version[4] = 99
    old = seal(session, FrameType.HEARTBEAT, 1, b"")
    frames = (
        ("a frame with a wrong checksum", bytes(damaged), "bad"),
        ("a frame of another session", _closed(other), "bad"),
        ("a frame of another version", _closed(version), "bad"),
        ("a frame that is cut short", bytes(genuine[:40]), "bad"),
        ("a frame longer than Ethernet carries", bytes(genuine) + bytes(LARGEST_FRAME), "bad"),
        ("a frame of a target", encode(FrameType.REPLY, bytes(64), session.number), "bad"),
        ("a command with a wrong tag", _closed(forged), "forged"),
        ("a command whose tag is wrong in its last byte", _closed(late), "forged"),
        ("a command with an old counter", old, "replayed"),
    )
    for what, frame, count in frames:
        before = target.command(commands.heartbeat()).status
        between, after = target.answers_before_heartbeat(frame)
        if any(isinstance(one.answer, Reply) for one in between):
            yield f"{what} is answered"
        if getattr(after, count) != getattr(before, count) + 1:
            yield f"{what} is not counted as {count}"
        if after.counter != target.writer.counter:
            yield f"{what} changes the counter"


def _repeated(target: Exchange) -> Iterator[str]:
    """The latest command again: its reply again, without its extra part; nothing is executed."""
    frame = target.writer.write(commands.clock(7))
    first = target.reply_to(frame, target.writer.counter)
    again = target.reply_to(frame, target.writer.counter)
    if first is None or first.clock is None or first.clock[0] != 7:
        yield "the reply to CLOCK does not repeat the time of the host"
    if again is None:
        yield "the latest command, sent again, has no reply: a reply that is lost is lost for ever"
    elif again.clock is not None:
        yield "the latest command, sent again, is executed again"
    with_gap = seal(target.session, FrameType.HEARTBEAT, target.writer.counter + 10, b"")
    target.writer.catch_up(target.writer.counter + 10)
    if target.reply_to(with_gap, target.writer.counter) is None:
        yield "a counter that leaves some out is refused"


def _refusals(target: Exchange) -> Iterator[str]:
    """Commands that are genuine, and wrong; some right ones between them restore what they could have changed."""
    for what, command, wanted in wrong_commands(target):
        yield from _code(target, what, command, *wanted)
    yield from _unknown_type(target)


def _unknown_type(target: Exchange) -> Iterator[str]:
    """A genuine frame of a type that the protocol does not have."""
    counter = target.writer.counter + 1
    target.writer.catch_up(counter)
    unknown = bytearray(seal(target.session, FrameType.CURRENT, counter, b""))
    unknown[5] = 0x2A
    end = len(unknown) - CHECKSUM - TAG
    unknown[end:-CHECKSUM] = tag(target.session, bytes(unknown[:end]))
    target.send(_closed(unknown))
    until = time.monotonic() + target.patience
    while (received := target.receive(until)) is not None:
        body = received.datagram[HEADER.size + 8 :]
        if received.datagram[5:6] == bytes([FrameType.REPLY]) and len(body) > 1 and body[0] == 0x2A:  # not cut
            if body[1] != Code.UNKNOWN:
                yield f"an unknown type: code {body[1]}; expected: UNKNOWN"
            return
    yield "an unknown type that is genuine has no reply"


def _uploads(target: Exchange) -> Iterator[str]:
    """An excitation in three chunks, in another order and twice, a wrong checksum, and one that is too large."""
    axes, limits = target.session.axes, target.description.limits
    steps = 3000 // (8 * axes) + 1
    content = struct.pack("<d", 0.0) * (steps * axes)
    upload = Upload(7, UploadKind.EXCITATION, content, 0, 0, steps)
    yield from _code(target, "BEGIN", upload.begin, Code.DONE)
    order = [2, 0, 0] if upload.chunks > 2 else [upload.chunks - 1]
    for chunk in order:
        target.send(target.writer.write(upload.chunk(chunk)))
    reply = target.command(upload.bitmap)
    wanted = tuple(chunk for chunk in range(upload.chunks) if chunk not in order)
    if reply.missing != wanted:
        yield f"BITMAP: chunks {reply.missing} are missing; expected: {wanted}"
    yield from _code(target, "COMMIT of an upload with a hole", upload.commit, Code.INCOMPLETE)
    for chunk in wanted:
        target.send(target.writer.write(upload.chunk(chunk)))
    yield from _committed(target, "COMMIT of a whole upload", upload, Code.DONE)
    if not target.command(commands.heartbeat()).status.upload_ready:
        yield "the status does not show the upload as ready"
    begin = bytearray(upload.begin.body)
    begin[16] ^= 1
    wrong = Command(FrameType.BEGIN, bytes(begin))
    yield from _code(target, "BEGIN", wrong, Code.DONE)
    for chunk in range(upload.chunks):
        target.send(target.writer.write(upload.chunk(chunk)))
    yield from _committed(target, "COMMIT with a wrong checksum", upload, Code.CHECKSUM)
    beyond = struct.pack("<d", 2.0 * limits.excitation_amplitude) * axes
    large = Upload(8, UploadKind.EXCITATION, beyond, 0, 0, 1)
    yield from _code(target, "BEGIN", large.begin, Code.DONE)
    target.send(target.writer.write(large.chunk(0)))
    yield from _committed(target, "COMMIT beyond the amplitude", large, Code.BEYOND_LIMIT)
    huge = struct.pack("<BBHHHIIII", 1, 0, 0, 0, 0, 9, 0xFFFFFFF8 // (8 * axes) * 8 * axes, 0,
                       0xFFFFFFF8 // (8 * axes))  # fmt: skip
    yield from _code(target, "BEGIN of 4 GiB", Command(FrameType.BEGIN, huge), Code.TOO_LARGE)


def _committed(target: Exchange, what: str, upload: Upload, wanted: Code) -> Iterator[str]:
    until = time.monotonic() + target.patience
    while (code := target.command(upload.commit).code) is Code.BUSY and time.monotonic() < until:
        pass
    if code is not wanted:
        yield f"{what}: code {code.name}; expected: {wanted.name}"


def _telemetry(target: Exchange) -> Iterator[str]:
    """Samples in every format, without gaps and in order; a status every 100 ms, and nothing after STREAM 0."""
    axes, coils = target.session.axes, target.session.coils
    for options in range(8):
        width = 8 if options & 1 else 4
        row = width * (3 * axes + (coils if options & 2 else 0) + (1 if options & 4 else 0))
        rows = min((LARGEST_FRAME - HEADER.size - 8 - CHECKSUM) // row, 50)
        yield from _code(target, f"STREAM with options {options}", commands.stream(rows, options), Code.DONE)
        heard = target.listen(0.05)
        if not any(isinstance(one.answer, TelemetryBlock | Refusal) for one in heard):  # a port that waits for its turn
            heard += target.listen(target.patience)
        blocks = [one.answer for one in heard if isinstance(one.answer, TelemetryBlock)]
        wrong = [one.answer.reason for one in heard if isinstance(one.answer, Refusal)]
        if wrong:
            yield f"telemetry with options {options}: {wrong[0]}"
            continue
        if not blocks:
            yield f"telemetry with options {options}: none comes"
            continue
        yield from _blocks(blocks, rows, options)
        if options in (0, 7):
            yield from _status(target, heard)
    yield from _code(target, "STREAM of nothing", commands.stream(0), Code.DONE)
    if any(isinstance(one.answer, TelemetryBlock) for one in target.listen(0.1)):
        yield "telemetry goes on after STREAM of 0 samples"


def _status(target: Exchange, heard: list[Received]) -> Iterator[str]:
    """Go on listening until a status has come, or telemetry without a lost frame is so long that it had to come."""
    until, time_heard = time.monotonic() + target.patience, 0.0
    while not any(isinstance(one.answer, TargetStatus) for one in heard):
        time_heard = _longest_whole(heard) / target.description.sample_rate
        if time_heard >= _STATUS_WITHIN or time.monotonic() > until:
            yield f"no STATUS within {1e3 * time_heard:.0f} ms of telemetry"
            return
        heard = heard + target.listen(0.05)


def _longest_whole(heard: list[Received]) -> int:
    """Steps of the longest stretch of telemetry in which no frame was lost on the way."""
    blocks = [one.answer for one in heard if isinstance(one.answer, TelemetryBlock)]
    longest, first = 0, blocks[0]
    for before, later in pairwise(blocks):
        first = first if later.sequence == before.sequence + 1 else later
        longest = max(longest, later.first_step - first.first_step)
    return longest


def _blocks(blocks: list[TelemetryBlock], rows: int, options: int) -> Iterator[str]:
    steps = [block.first_step for block in blocks]
    if any(block.steps != rows for block in blocks):
        yield f"telemetry with options {options}: {blocks[0].steps} samples a frame; asked for: {rows}"
    if any(later <= before for before, later in pairwise(steps)):
        yield f"telemetry with options {options}: steps that do not rise"
    elif any((later - before) % rows for before, later in pairwise(steps)):
        yield f"telemetry with options {options}: steps that are no multiple of a frame apart"
    sequences = [block.sequence for block in blocks]
    if any(later <= before for before, later in pairwise(sequences)):
        yield "the sequence number of frames does not rise"
    for block in blocks:
        if abs(block.current).max() > 0.0:
            yield f"telemetry with options {options}: control currents while the amplifiers are off"
            break
    for block in blocks:
        if block.status is not None and any(
            word & 7 not in (TargetState.OFF, TargetState.TRIPPED) for word in block.status
        ):
            yield f"telemetry with options {options}: a status word of another state than OFF"
            break


def _host_loop(target: Exchange) -> Iterator[str]:
    """CURRENT has no reply, and does nothing while the amplifiers are off."""
    status = target.command(commands.heartbeat()).status
    frame = commands.current(target.session, status.step, (0.0,) * target.session.axes)
    between, after = target.answers_before_heartbeat(frame)
    if any(isinstance(one.answer, Reply) for one in between):
        yield "CURRENT is answered"
    if after.currents_on:
        yield "CURRENT switches the amplifiers on"
    _, again = target.answers_before_heartbeat(frame)
    if again.replayed != after.replayed + 1:
        yield "CURRENT for the same step again is not counted as replayed"


def _faults(target: Exchange) -> Iterator[str]:
    reply = target.command(commands.fault_reset())
    if reply.code not in (Code.DONE, Code.LOCKED):
        yield f"FAULT_RESET: code {reply.code.name}; expected: DONE, or LOCKED after a trip by displacement"
    if reply.code is Code.DONE and (reply.status.trips or reply.status.state is not TargetState.OFF):
        yield "FAULT_RESET leaves trips, or another state than OFF"


def _timing(target: Exchange) -> Iterator[str]:
    """Steps against the clock of the target, and that against the host's; again where a busy machine held them up."""
    complaint = ""
    for _ in range(_TRIES):
        complaint = _off_time(target)
        if not complaint:
            return
    yield complaint


def _off_time(target: Exchange) -> str:
    """What is wrong with the steps and the clock within a second; empty if nothing is."""
    first, began = target.command(commands.clock(1)), time.monotonic()
    time.sleep(1.0)
    second, ended = target.command(commands.clock(2)), time.monotonic()
    if first.clock is None or second.clock is None:
        return "the reply to CLOCK has no times"
    host, clock = ended - began, 1e-9 * (second.clock[1] - first.clock[1])
    if not abs(clock / host - 1.0) < 0.1:
        return f"its clock advances {clock:.4g} s in {host:.4g} s of the host: board_time is in ns"
    missed = second.status.missed - first.status.missed
    made = (second.status.step - first.status.step) / clock
    low, high = (target.description.sample_rate * (1.0 + sign * _RATE) for sign in (-1.0, 1.0))
    if made > high or made + missed / clock < low:  # a target may make the steps that it has missed, or leave them out
        return f"{made:.6g} control steps a second by its own clock; described: {target.description.sample_rate:.6g}"
    return ""


CHECKS: dict[str, Check] = {
    "challenge": _challenge,
    "description": _description,
    "hostile frames": _hostile,
    "repetition": _repeated,
    "refusals": _refusals,
    "uploads": _uploads,
    "telemetry": _telemetry,
    "loop by the host": _host_loop,
    "faults": _faults,
    "record": check_record,
    "timing": _timing,
}
"""All checks by name, in the order in which they are run."""
