"""amb_msgs/Excitation: a signal on the reference, as a definition from which each node makes the samples."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import (
    KINDS,
    Excitation,
    definition_of,
    excitation_from_definition,
    instantaneous_frequency,
)
from amb_core.excitation.playback import Playback
from amb_core.ground.errors import ExcitationError
from amb_core.loop.machine import Machine

M = TypeVar("M", bound=Any)

EXCITATION = "amb_msgs/msg/Excitation"


def frequency_from_message(message: Any, machine: Machine | None = None) -> NDArray[np.float64]:
    """Instantaneous frequency of each sample of an Excitation message (Hz), shape (steps,); empty where none is known.

    A message of version 0.1 contains it; for later ones it follows from the definition, with the axes of a machine (by
    default one bearing).
    """
    if hasattr(message, "frequency"):
        return np.asarray(message.frequency, dtype=np.float64)
    # A user-defined waveform has kind waveform, in version 0.1 also that of a kind with samples of its own.
    inline = bool(len(message.reference_x)) if hasattr(message, "reference_x") else bool(message.axes)
    if inline or message.kind not in KINDS:  # a user-defined waveform, or a stop
        return np.zeros(0)
    try:
        excitation = excitation_from_definition(str(message.kind), str(message.description))
        frequency = instantaneous_frequency(excitation, 1.0 / message.sample_time, machine)
    except (ExcitationError, ZeroDivisionError):  # of a later version, or also refused by the controller
        return np.zeros(0)
    return np.zeros(0) if frequency is None else frequency


def fill_excitation(
    message: M,
    excitation: Excitation,
    run: int,
    first_step: int,
    sample_rate: float,
    machine: Machine | None = None,
) -> M:
    """Set the fields of an Excitation message to a definition, with number and checksum of its samples.

    For these, the samples are made at a sample rate (Hz) for a machine (by default one bearing), and not kept.
    """
    playback = Playback(excitation, sample_rate, machine)
    message.run, message.first_step, message.sample_time = run, first_step, 1.0 / sample_rate
    message.kind, message.description = excitation.kind, definition_of(excitation)
    message.steps, message.checksum = playback.steps, playback.checksum
    return message
