"""Reads and checks the messages of the topic excitation for a controller: each one gets an answer of one line."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import Excitation as ExcitationParameters
from amb_core.excitation import excitation_from_definition
from amb_core.excitation.deterministic import HIGHEST_AMPLITUDE
from amb_core.excitation.playback import checksum_of, same_samples
from amb_core.excitation.signal import steps_of
from amb_core.ground.errors import ExcitationError, MessageError, one_line
from amb_core.loop.machine import Machine
from amb_msgs.msg import Excitation, ExcitationStatus
from amb_ros.serialized import deserialized

STOP = "stop"
WAVEFORM = "waveform"
HIGHEST_SIZE = 16 * Excitation.HIGHEST_INLINE_STEPS + 2**20  # bytes; 1 MiB for texts
HIGHEST_STEP = 2**63 - 1
LONGEST_ANSWER = 400  # characters


@dataclass(frozen=True)
class Checked:
    """The content of a checked message.

    Attributes
    ----------
    steps : int
        Number of samples; 0 for a stop.
    checksum : int
        That of the sender; 0 if none.
    excitation : Excitation or None
        Definition from which its samples are made.
    samples : ndarray, shape (n, axes)
        Samples in the message (m); empty with a definition and for a stop.
    """

    steps: int
    checksum: int
    excitation: ExcitationParameters | None
    samples: NDArray[np.float64]


def read(data: bytes) -> Excitation | ExcitationStatus:
    """The message in serialized form, or the answer to one that is too large or cannot be read."""
    if len(data) > HIGHEST_SIZE:
        problem = f"{len(data)} bytes; allowed: {HIGHEST_SIZE}, samples of {Excitation.HIGHEST_INLINE_STEPS} steps"
    else:
        try:
            return deserialized(data, Excitation)
        except MessageError as error:
            problem = str(error)
    run, number = _address(data)
    return ExcitationStatus(run=run, id=number, message=one_line(problem, LONGEST_ANSWER))


def resolve(message: Excitation, run: int, step: int) -> None:
    """Put in the present run and step where a message leaves them open, as requests to services do.

    Run 0 is the present run. A stop whose first step has passed, such as one that gives none, is one from the next
    step on.
    """
    message.run = message.run or run
    if message.kind == STOP and message.run == run and 0 <= message.first_step <= step:
        message.first_step = Excitation.FROM_NEXT_STEP


def require_samples(stated: int, computed: int) -> None:
    """Raise ExcitationError if the samples made from a definition are not those of its sender, by their checksums."""
    if stated and not same_samples(stated, computed):
        raise ExcitationError(
            f"the samples made from its description have checksum {computed}, those of the sender {stated}; does it "
            "run another version of amb_core?"
        )


def length(message: Excitation) -> int:
    """Samples that a message itself holds for each axis."""
    return len(message.axes[0].reference) if message.axes else 0


def check(message: Excitation, machine: Machine, run: int, step: int) -> Checked:
    """The content of a message; everything is checked except samples made from a definition.

    Parameters
    ----------
    message : Excitation
        The message.
    machine : Machine
        Gives axes and sample rate.
    run, step : int
        Present run and last step answered in it.

    Raises
    ------
    ExcitationError
        If it cannot be applied; one line.
    """
    axes, sample_rate = machine.axis_names, machine.sample_rate
    try:
        _check_place(message, run, step)
        if message.kind == STOP:
            if message.steps or message.axes:
                raise ExcitationError(f"a stop has no samples, but this has {message.steps or length(message)}")
            return Checked(0, 0, None, np.zeros((0, len(axes))))
        if not abs(message.sample_time * sample_rate - 1.0) <= 1e-9:
            raise ExcitationError(
                f"made for a sample time of {message.sample_time:g} s; the controller runs at {1.0 / sample_rate:g} s"
            )
        if message.kind == WAVEFORM or message.axes:
            return _inline(message, axes)
        excitation = excitation_from_definition(message.kind, message.description)
        steps = steps_of(excitation, sample_rate, machine)
        if message.steps != steps:
            raise ExcitationError(f"steps = {message.steps}, but its description makes {steps}")
        return Checked(steps, message.checksum, excitation, np.zeros((0, len(axes))))
    except ExcitationError as problem:
        raise ExcitationError(one_line(problem, LONGEST_ANSWER)) from None


def _check_place(message: Excitation, run: int, step: int) -> None:
    for axis in message.axes:
        if len(axis.reference) != length(message):
            first = message.axes[0].name
            raise ExcitationError(f"{length(message)} samples on {first} but {len(axis.reference)} on {axis.name}")
    if not message.run and message.kind != STOP:
        raise ExcitationError(
            "run = 0 is the present run, but there is none yet; start the loop first, or give the run"
        )
    if message.run < run:
        raise ExcitationError(f"meant for run {message.run}; the present run is {run}")
    if message.first_step < Excitation.FROM_NEXT_STEP:
        raise ExcitationError(
            f"first_step = {message.first_step}; allowed: a future step, or {Excitation.FROM_NEXT_STEP}"
        )
    if message.run == run and Excitation.FROM_NEXT_STEP < message.first_step <= step:
        raise ExcitationError(f"first_step = {message.first_step} is in the past; allowed: {step + 1} or later")
    if message.first_step + message.steps > HIGHEST_STEP:
        raise ExcitationError(
            f"first_step = {message.first_step} with steps = {message.steps} exceeds the last allowed step "
            f"{HIGHEST_STEP}"
        )


def _inline(message: Excitation, axes: Sequence[str]) -> Checked:
    steps = length(message)
    if not steps:
        raise ExcitationError(f"a {WAVEFORM} without samples; give an axis with its reference, or end it by a {STOP}")
    names = [axis.name for axis in message.axes]
    for name in names:
        if name not in axes or names.count(name) > 1:
            problem = "is given twice" if name in axes else "is not an axis of this machine"
            raise ExcitationError(f"axis {name!r} {problem}; allowed: {', '.join(axes)}, each once")
    if steps > Excitation.HIGHEST_INLINE_STEPS:
        raise ExcitationError(f"samples of {steps} steps; allowed: {Excitation.HIGHEST_INLINE_STEPS}")
    if message.steps not in (0, steps):
        raise ExcitationError(f"steps = {message.steps}, but it has samples of {steps}")
    samples = np.zeros((steps, len(axes)))
    for part in message.axes:
        samples[:, axes.index(part.name)] = part.reference
    wrong = ~(np.abs(samples) <= HIGHEST_AMPLITUDE)  # NaN as well
    if wrong.any():
        index, axis = np.argwhere(wrong)[0]
        raise ExcitationError(
            f"reference[{index}] of axis {axes[axis]} = {samples[index, axis]:g} m is not allowed; "
            f"allowed: {-HIGHEST_AMPLITUDE:g} to {HIGHEST_AMPLITUDE:g} m"
        )
    checksum = checksum_of(samples)
    if message.checksum and not same_samples(message.checksum, checksum):
        raise ExcitationError(f"its samples have checksum {checksum}, not {message.checksum} as it states")
    return Checked(steps, checksum, None, samples)


def _address(data: bytes) -> tuple[int, int]:
    """Run and id of a serialized Excitation (CDR, little endian) that cannot be read completely; 0 if unreadable."""
    try:
        (frame,) = struct.unpack_from("<I", data, 12)
        run = 4 + -(-(12 + frame) // 8) * 8  # after the CDR header, stamp and frame_id; members are aligned
        run, number = struct.unpack_from("<QI", data, run)
    except struct.error:
        return 0, 0
    return run, number
