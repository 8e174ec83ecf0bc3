"""Common part of all excitations: parameters, signal on one axis, and the order in which axes are excited."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation.axes import AXES_DESCRIPTION, ORTHOGONAL, Part, parts_of
from amb_core.ground.errors import ExcitationError
from amb_core.ground.given_values import number, require_kind
from amb_core.ground.parameters import Parameters, choice, required
from amb_core.loop.machine import HIGHEST_SAMPLE_RATE, ONE_BEARING, Machine

Sampler = Callable[[int, int], NDArray[np.float64]]
"""Samples of the signal on one axis (m) from `first` up to `stop` (exclusive), shape (stop - first,)."""


class Excitation(Parameters):
    """Parameters of one kind of excitation; each kind is a subclass."""

    kind: ClassVar[str]
    has_lines: ClassVar[bool] = False  # a spectrum of lines, whose phases orthogonal experiments may turn

    duration: float = required("s", "duration of the whole signal", 1e-3, 600.0)
    axes: str = choice("in_turn", AXES_DESCRIPTION)

    @property
    @abstractmethod
    def highest_frequency(self) -> float:
        """Frequency that must not lie above the Nyquist frequency (Hz)."""

    @property
    def by_sample(self) -> bool:
        """Whether each part of the signal can be computed quickly on its own, so that samples need not be kept."""
        return True

    @abstractmethod
    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2) -> Sampler:
        """Make the signal on one axis; kinds with a random part draw another realisation on each axis.

        Parameters
        ----------
        steps : int
            Number of samples of the signal on this axis.
        sample_rate : float
            Controller sample rate (Hz).
        axis : int
            Index of the axis.
        axes : int, optional
            Number of axes of the machine.

        Returns
        -------
        Sampler
            Makes the samples (m), shape (stop - first,), from a first one up to, not including, another.
        """

    def instantaneous_frequency(self, steps: int, sample_rate: float) -> NDArray[np.float64] | None:
        """Instantaneous frequency of each sample of `waveform` (Hz), shape (steps,), or None for kinds without one.

        Parameters
        ----------
        steps : int
            Number of samples.
        sample_rate : float
            Controller sample rate (Hz).

        Returns
        -------
        ndarray or None, shape (steps,)
            Frequencies (Hz).
        """
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
    samples : ndarray, shape (steps, axes)
        Added to the reference position, a column for each axis of the machine (m); read-only.
    frequency : ndarray, shape (steps,), or None
        Instantaneous frequency (Hz); None if the kind has none; read-only.
    machine : Machine
        The machine for which it was made.
    """

    kind: str
    parameters: Excitation
    sample_time: float
    samples: NDArray[np.float64]
    frequency: NDArray[np.float64] | None
    machine: Machine = ONE_BEARING

    @property
    def steps(self) -> int:
        """Number of samples."""
        return len(self.samples)


def steps_of(excitation: Excitation, sample_rate: float, machine: Machine | None = None) -> int:
    """Number of samples of an excitation, round(duration * sample_rate).

    Parameters
    ----------
    excitation : Excitation
        Parameters of one kind.
    sample_rate : float
        Controller sample rate f_s (Hz).
    machine : Machine, optional
        By default one bearing with axes x and y.

    Returns
    -------
    int
        Number of controller steps.

    Raises
    ------
    ExcitationError
        If a frequency lies above the Nyquist frequency, the machine lacks an axis, or an excited axis has no sample.
    """
    return excitation_parts(excitation, sample_rate, machine)[-1].stop


def excitation_parts(excitation: Excitation, sample_rate: float, machine: Machine | None = None) -> list[Part]:
    """The parts of an excitation on a machine; parameters and errors as of `steps_of`."""
    require_kind(
        "excitation", excitation, Excitation, "an Excitation, as excitation_from_settings makes one", ExcitationError
    )
    require_kind("machine", machine, (Machine, type(None)), "a Machine, or None for one bearing", ExcitationError)
    sample_rate = number("sample_rate", sample_rate, ExcitationError)
    if not 0.0 < sample_rate <= HIGHEST_SAMPLE_RATE:  # not NaN
        raise ExcitationError(
            f"sample rate {sample_rate!r} Hz is not allowed; allowed: more than 0, up to {HIGHEST_SAMPLE_RATE:g} Hz"
        )
    nyquist = sample_rate / 2.0
    if excitation.highest_frequency > nyquist:
        raise ExcitationError(
            f"{excitation.kind}: frequency {excitation.highest_frequency:g} Hz is above the Nyquist frequency "
            f"{nyquist:g} Hz of the sample rate {sample_rate:g} Hz"
        )
    if excitation.axes == ORTHOGONAL and not excitation.has_lines:
        raise ExcitationError(
            f"{excitation.kind}: axes = '{ORTHOGONAL}' is not allowed; only multisines have such axes"
        )
    try:
        parts = parts_of(excitation.axes, round(excitation.duration * sample_rate), machine)
    except ExcitationError as problem:
        raise ExcitationError(f"{excitation.kind}: {problem}") from None
    if any(part.stop <= part.first for part in parts):
        raise ExcitationError(
            f"{excitation.kind}: duration {excitation.duration:g} s is too short for the sample rate "
            f"{sample_rate:g} Hz; each excited axis needs at least one sample"
        )
    return parts


def experiments_of(excitation: Excitation, sample_rate: float, machine: Machine | None = None) -> list[tuple[int, int]]:
    """First and stop step of each experiment of a signal, in order; parameters and errors as of `steps_of`.

    Signals `in_turn` and `orthogonal` have one for each axis of the machine, all others one.

    Parameters
    ----------
    excitation : Excitation
        Parameters of one kind.
    sample_rate : float
        Controller sample rate (Hz).
    machine : Machine, optional
        By default one bearing with axes x and y.

    Returns
    -------
    list of (int, int)
        First step, and step after the last.

    Raises
    ------
    ExcitationError
        As for `steps_of`.
    """
    parts = excitation_parts(excitation, sample_rate, machine)
    return list(dict.fromkeys((part.first, part.stop) for part in parts))


def excited_spans(signal: ExcitationSignal) -> list[tuple[int, int, int]]:
    """Excited axis (its number), first and stop step of each span in which it is excited without interruption."""
    spans: dict[int, list[tuple[int, int, int]]] = {}
    for part in parts_of(signal.parameters.axes, signal.steps, signal.machine):
        for axis, _ in part.factors:
            before = spans.setdefault(axis, [])
            joins = bool(before) and before[-1][2] == part.first
            first = before.pop()[1] if joins else part.first
            before.append((axis, first, part.stop))
    return [span for axis in sorted(spans) for span in spans[axis]]
