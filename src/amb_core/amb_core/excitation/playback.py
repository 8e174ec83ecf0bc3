"""Excitations as samples: all at once, or window by window to save the memory of a node.

Both ways evaluate the same windows of the signal, so the samples are the same bit for bit. Long signals that a
transform makes as a whole are kept in a temporary file.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation.seeded import Multisine
from amb_core.excitation.signal import Excitation, ExcitationSignal, Sampler, excitation_parts
from amb_core.ground.errors import ExcitationError
from amb_core.ground.given_values import whole_number
from amb_core.loop.machine import ONE_BEARING, Machine

WINDOW = 1024
"""Samples made at a time; takes about 50 us while the loop runs."""
HIGHEST_IN_MEMORY = 500_000
"""Samples per axis up to which a signal is kept in memory, 4 MB: reading them is cheaper than making them."""
RESOLUTION = 1e-12
"""Of a checksum (m): far above what rounding adds up to in 600 s (below 1e-13 m), far below any other difference."""


class Playback:
    """The samples of an excitation, window by window; holds few of them in memory.

    Parameters
    ----------
    excitation : Excitation
        Parameters of one kind.
    sample_rate : float
        Controller sample rate f_s (Hz).
    machine : Machine, optional
        Its axes are excited; by default one bearing with axes x and y.
    cancelled : callable, optional
        Called between windows; when it returns true, making the samples ends with an error.

    Attributes
    ----------
    steps : int
        Number of samples.
    checksum : int
        Weighted sum of all samples, see `Checksum`.

    Raises
    ------
    ExcitationError
        As `generate`; also if it was cancelled, or the temporary file cannot be written.
    """

    def __init__(
        self,
        excitation: Excitation,
        sample_rate: float,
        machine: Machine | None = None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        self._parts = _Parts(
            excitation, sample_rate, ONE_BEARING if machine is None else machine, partial(_kept, excitation, cancelled)
        )
        self.steps = self._parts.steps
        checksum = Checksum()
        for _, samples in self._parts.windows():
            if cancelled():
                raise ExcitationError("cancelled while its samples were made")
            checksum.add(samples)
        self.checksum = checksum.value

    def window(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """The window with the sample of an index: index of its first sample, and its samples (m), shape (n, axes).

        Parameters
        ----------
        index : int
            Index of a sample.

        Returns
        -------
        (int, ndarray), shape (n, axes)
            Index of the first sample, and the samples (m).
        """
        return self._parts.window(index)


def generate(excitation: Excitation, sample_rate: float, machine: Machine | None = None) -> ExcitationSignal:
    """Make the samples of an excitation: round(duration * sample_rate) of them, the same ones every time.

    With axes `in_turn` the signal has 1 / n of the duration and is played from its start on each of n axes in their
    order, so that the responses to the axes can be separated (remaining samples go to the last).

    Parameters
    ----------
    excitation : Excitation
        Parameters of one kind.
    sample_rate : float
        Controller sample rate f_s (Hz).
    machine : Machine, optional
        Its axes are excited; by default one bearing with axes x and y.

    Returns
    -------
    ExcitationSignal
        The samples of every axis.

    Raises
    ------
    ExcitationError
        If a frequency lies above the Nyquist frequency, the signal has no sample, no line of a band can be excited, or
        the machine lacks the axes.
    """
    machine = ONE_BEARING if machine is None else machine
    parts = _Parts(excitation, sample_rate, machine, lambda sampler, _steps, _in_memory: sampler)
    samples = np.empty((parts.steps, len(machine.axes)))
    for first, window in parts.windows():
        samples[first : first + len(window)] = window
    frequency = instantaneous_frequency(excitation, sample_rate, machine)
    for signal in (samples, frequency):
        if signal is not None:
            signal.flags.writeable = False
    return ExcitationSignal(excitation.kind, excitation, 1.0 / sample_rate, samples, frequency, machine)


def instantaneous_frequency(
    excitation: Excitation, sample_rate: float, machine: Machine | None = None
) -> NDArray[np.float64] | None:
    """Instantaneous frequency of each sample (Hz), shape (steps,); None for a signal that has none.

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
    ndarray or None, shape (steps,)
        Frequencies (Hz).

    Raises
    ------
    ExcitationError
        If the signal cannot be made at this sample rate (Hz), or the machine lacks its axes.
    """
    parts = excitation_parts(excitation, sample_rate, machine)
    frequency = np.zeros(parts[-1].stop)
    for first, stop in dict.fromkeys((part.first, part.stop) for part in parts):
        instantaneous = excitation.instantaneous_frequency(stop - first, sample_rate)
        if instantaneous is None:
            return None
        frequency[first:stop] = instantaneous
    return frequency


class Checksum:
    """Checksum of samples that two processors may round differently in the last place.

    It is their sum, weighted by fixed pseudo-random numbers from -1 to 1, in units of `RESOLUTION`. Rounding moves it
    by one unit at most. Samples that really differ, such as those of another seed, move it by many.
    """

    def __init__(self) -> None:
        self._sum = 0.0
        self._values = 0

    def add(self, samples: NDArray[np.float64]) -> None:
        """Add the samples of the next steps (m), shape (n, axes)."""
        values = np.ravel(samples)
        numbers = np.arange(self._values, self._values + values.size, dtype=np.uint64)
        # Multiples of the golden ratio, modulo 1 (Knuth: multiplicative hashing).
        weights = (numbers * np.uint64(2654435769) % np.uint64(2**32)).astype(np.float64) / 2.0**31 - 1.0
        self._sum += float(weights @ values)
        self._values += values.size

    @property
    def value(self) -> int:
        """The checksum of the samples so far, 0 to 2^32 - 1."""
        return round(self._sum / RESOLUTION) % 2**32


def checksum_of(samples: NDArray[np.float64]) -> int:
    """Checksum of samples (m), shape (n, axes), that are there as a whole; see `Checksum`."""
    checksum = Checksum()
    checksum.add(samples)
    return checksum.value


def same_samples(checksum: int, other: int) -> bool:
    """Whether two checksums are those of the same samples, apart from rounding."""
    return (checksum - other + 1) % 2**32 <= 2


class _Parts:
    """The parts of a signal: what is played on which axes over which steps.

    Windows start with the part to which they belong, so that every part is always evaluated in the same blocks: the
    rounding of vectorised functions may depend on where a block begins. Parts of one realisation and length, such as
    those of orthogonal experiments, share its samples.
    """

    def __init__(
        self,
        excitation: Excitation,
        sample_rate: float,
        machine: Machine,
        keep: Callable[[Sampler, int, bool], Sampler],
    ) -> None:
        parts = excitation_parts(excitation, sample_rate, machine)
        self.steps, self._axes = parts[-1].stop, len(machine.axes)
        signals = dict.fromkeys((part.realisation, part.turn, part.stop - part.first) for part in parts)
        in_memory = sum(steps for *_, steps in signals) <= HIGHEST_IN_MEMORY * min(len(signals), self._axes)
        samplers: dict[tuple[int, float, int], Sampler] = {}
        for realisation, turn, steps in signals:
            # No reference to the sampler of a whole signal remains here, so its memory is released.
            samplers[realisation, turn, steps] = keep(
                _sampler(excitation, steps, sample_rate, realisation, self._axes, turn), steps, in_memory
            )
        self._parts = [(part, samplers[part.realisation, part.turn, part.stop - part.first]) for part in parts]

    def window(self, index: int) -> tuple[int, NDArray[np.float64]]:
        index = whole_number("index", index, ExcitationError)
        if not 0 <= index < self.steps:
            raise IndexError(f"sample {index} asked for; there are {self.steps}")
        present = [(part, sampler) for part, sampler in self._parts if part.first <= index < part.stop]
        first, stop = present[0][0].first, present[0][0].stop
        start = index - (index - first) % WINDOW
        samples = np.zeros((min(WINDOW, stop - start), self._axes))
        for part, sampler in present:
            signal = sampler(start - first, start - first + len(samples))
            for axis, factor in part.factors:
                samples[:, axis] = factor * signal
        return start, samples

    def windows(self) -> Iterator[tuple[int, NDArray[np.float64]]]:
        index = 0
        while index < self.steps:
            first, samples = self.window(index)
            yield first, samples
            index = first + len(samples)


def _sampler(
    excitation: Excitation, steps: int, sample_rate: float, realisation: int, axes: int, turn: float
) -> Sampler:
    if isinstance(excitation, Multisine):
        return excitation.sampler(steps, sample_rate, realisation, axes, turn)
    return excitation.sampler(steps, sample_rate, realisation, axes)


def _kept(
    excitation: Excitation, cancelled: Callable[[], bool], sampler: Sampler, steps: int, in_memory: bool
) -> Sampler:
    """A sampler that is fast for every window, and keeps little in memory."""
    if not in_memory:
        return sampler if excitation.by_sample else _in_a_file(sampler, steps, cancelled)
    signal = np.concatenate([sampler(first, min(first + WINDOW, steps)) for first in range(0, steps, WINDOW)])
    return lambda first, stop: signal[first:stop]


def _in_a_file(sampler: Sampler, steps: int, cancelled: Callable[[], bool]) -> Sampler:
    """The same samples from a file without a name: it is removed with the process, however that ends."""
    try:
        file = tempfile.TemporaryFile(prefix="amb_excitation_")  # noqa: SIM115 (closed with the sampler)
        for first in range(0, steps, WINDOW):
            if cancelled():
                raise ExcitationError("cancelled while its samples were made")
            file.write(sampler(first, min(first + WINDOW, steps)).tobytes())
        file.flush()
    except OSError as problem:
        raise ExcitationError(
            f"its {8 * steps / 1e6:.0f} MB of samples cannot be kept in a temporary file in {tempfile.gettempdir()}: "
            f"{problem.strerror}"
        ) from None

    def samples(first: int, stop: int) -> NDArray[np.float64]:
        return np.frombuffer(os.pread(file.fileno(), 8 * (stop - first), 8 * first))

    return samples
