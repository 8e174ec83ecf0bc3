"""Common part of all excitations: parameters, signal on one axis, and the order in which axes are excited."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from amb_core.errors import ExcitationError
from amb_core.parameters import Parameters, choice

Axes = Literal["x", "y", "both", "in_turn"]

Sampler = Callable[[int, int], NDArray[np.float64]]
"""Samples of the signal on one axis (m) from `first` up to `stop` (exclusive), shape (stop - first,)."""

AXES_DESCRIPTION = "axes that are excited; in_turn: x for the first half of the duration, then y"


def required(unit: str, description: str, minimum: float, maximum: float) -> Any:
    """Declare a number that has no default, with its unit and closed range."""
    return Field(ge=minimum, le=maximum, description=description, json_schema_extra={"unit": unit})


class Excitation(Parameters):
    """Parameters of one kind of excitation; each kind is a subclass."""

    kind: ClassVar[str]

    duration: float = required("s", "duration of the whole signal", 1e-3, 600.0)
    axes: Axes = choice("in_turn", AXES_DESCRIPTION)

    @property
    @abstractmethod
    def highest_frequency(self) -> float:
        """Frequency that must not lie above the Nyquist frequency (Hz)."""

    @property
    def by_sample(self) -> bool:
        """Whether each part of the signal can be computed quickly on its own, so that samples need not be kept."""
        return True

    @abstractmethod
    def sampler(self, steps: int, sample_rate: float, axis: int) -> Sampler:
        """Make the signal on one axis, of `steps` samples.

        `axis` is 0 for x and 1 for y: kinds with a random part draw another realisation on each axis.
        """

    def instantaneous_frequency(self, steps: int, sample_rate: float) -> NDArray[np.float64] | None:
        """Instantaneous frequency of each sample of `waveform` (Hz), shape (steps,), or None for kinds without one."""
        return None


@dataclass(frozen=True)
class ExcitationSignal:
    """An excitation as samples.

    Attributes
    ----------
    kind : str
        Kind of the excitation.
    parameters : Excitation
        The settings from which it was made.
    sample_time : float
        Sample time for which it was made (s).
    samples : ndarray, shape (steps, 2)
        Added to the reference position, axes x and y (m); read-only.
    frequency : ndarray, shape (steps,), or None
        Instantaneous frequency (Hz); None if the kind has none; read-only.
    """

    kind: str
    parameters: Excitation
    sample_time: float
    samples: NDArray[np.float64]
    frequency: NDArray[np.float64] | None

    @property
    def steps(self) -> int:
        """Number of samples."""
        return len(self.samples)


def steps_of(excitation: Excitation, sample_rate: float) -> int:
    """Number of samples of an excitation, round(duration * sample_rate).

    Raises
    ------
    ExcitationError
        If a frequency lies above the Nyquist frequency, or an excited axis has no sample.
    """
    if not (math.isfinite(sample_rate) and sample_rate > 0.0):
        raise ExcitationError(f"sample rate {sample_rate!r} Hz is not allowed; it must be positive and finite")
    nyquist = sample_rate / 2.0
    if excitation.highest_frequency > nyquist:
        raise ExcitationError(
            f"{excitation.kind}: frequency {excitation.highest_frequency:g} Hz is above the Nyquist frequency "
            f"{nyquist:g} Hz of the sample rate {sample_rate:g} Hz"
        )
    steps = round(excitation.duration * sample_rate)
    if any(last <= first for _, first, last in excited_spans(excitation.axes, steps)):
        raise ExcitationError(
            f"{excitation.kind}: duration {excitation.duration:g} s is too short for the sample rate "
            f"{sample_rate:g} Hz; each excited axis needs at least one sample"
        )
    return steps


def excited_spans(axes: Axes, steps: int) -> list[tuple[int, int, int]]:
    """Excited axis (0 for x, 1 for y), first step and stop step (exclusive) of each span, for a number of steps."""
    half = steps // 2
    return {
        "x": [(0, 0, steps)],
        "y": [(1, 0, steps)],
        "both": [(0, 0, steps), (1, 0, steps)],
        "in_turn": [(0, 0, half), (1, half, steps)],
    }[axes]
