"""Excitations as samples: all at once, or window by window to save the memory of a node.

Both ways evaluate the same windows of the signal, so the samples are the same bit for bit. Long signals that a
transform makes as a whole are kept in a temporary file.
"""

from __future__ import annotations

import os
import tempfile
import zlib
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import ExcitationError
from amb_core.excitation.signal import Excitation, ExcitationSignal, Sampler, excited_spans, steps_of

WINDOW = 1024
"""Samples made at a time; takes about 50 us while the loop runs."""
HIGHEST_IN_MEMORY = 500_000
"""Samples per axis up to which a signal is kept in memory, 4 MB: reading them is cheaper than making them."""


class Playback:
    """The samples of an excitation, window by window; holds few of them in memory.

    Parameters
    ----------
    excitation : Excitation
        Parameters of one kind.
    sample_rate : float
        Controller sample rate f_s (Hz).
    cancelled : callable, optional
        Called between windows; when it returns true, making the samples ends with an error.

    Attributes
    ----------
    steps : int
        Number of samples.
    checksum : int
        CRC-32 of all samples, see `checksum_of`.

    Raises
    ------
    ExcitationError
        As `generate`; also if it was cancelled, or the temporary file cannot be written.
    """

    def __init__(
        self, excitation: Excitation, sample_rate: float, cancelled: Callable[[], bool] = lambda: False
    ) -> None:
        self._parts = _Parts(excitation, sample_rate, cancelled, _kept)
        self.steps = self._parts.steps
        self.checksum = 0
        for _, samples in self._parts.windows():
            if cancelled():
                raise ExcitationError("cancelled while its samples were made")
            self.checksum = checksum_of(samples, self.checksum)

    def window(self, index: int) -> tuple[int, NDArray[np.float64]]:
        """The window with the sample of an index: index of its first sample, and its samples (m), shape (n, 2)."""
        return self._parts.window(index)


def generate(excitation: Excitation, sample_rate: float) -> ExcitationSignal:
    """Make the samples of an excitation: round(duration * sample_rate) of them, the same ones every time.

    With axes `in_turn` the signal has half the duration and is played from its start first on x, then on y, so that
    the responses to the axes can be separated (an odd sample goes to y).

    Parameters
    ----------
    excitation : Excitation
        Parameters of one kind.
    sample_rate : float
        Controller sample rate f_s (Hz).

    Raises
    ------
    ExcitationError
        If a frequency lies above the Nyquist frequency, the signal has no sample, or no line of a band can be excited.
    """
    parts = _Parts(excitation, sample_rate, lambda: False, lambda _excitation, sampler, _steps, _cancelled: sampler)
    samples = np.empty((parts.steps, 2))
    for first, window in parts.windows():
        samples[first : first + len(window)] = window
    frequency = instantaneous_frequency(excitation, sample_rate)
    for signal in (samples, frequency):
        if signal is not None:
            signal.flags.writeable = False
    return ExcitationSignal(excitation.kind, excitation, 1.0 / sample_rate, samples, frequency)


def instantaneous_frequency(excitation: Excitation, sample_rate: float) -> NDArray[np.float64] | None:
    """Instantaneous frequency of each sample (Hz), shape (steps,); None for a signal that has none.

    Raises
    ------
    ExcitationError
        If the signal cannot be made at this sample rate (Hz).
    """
    frequency = np.zeros(steps_of(excitation, sample_rate))
    for _, first, last in excited_spans(excitation.axes, len(frequency)):
        instantaneous = excitation.instantaneous_frequency(last - first, sample_rate)
        if instantaneous is None:
            return None
        frequency[first:last] = instantaneous
    return frequency


def checksum_of(samples: NDArray[np.float64], before: int = 0) -> int:
    """CRC-32, as in zlib, of samples of shape (n, 2) as little-endian float64, x and y of each step in turn.

    `before` is the checksum of the preceding samples.
    """
    return zlib.crc32(np.ascontiguousarray(samples, dtype="<f8").tobytes(), before)


class _Parts:
    """The parts of a signal: what is played on which axis over which steps.

    Windows start with the part to which they belong, so that every part is always evaluated in the same blocks: the
    rounding of vectorised functions may depend on where a block begins.
    """

    def __init__(
        self,
        excitation: Excitation,
        sample_rate: float,
        cancelled: Callable[[], bool],
        keep: Callable[[Excitation, Sampler, int, Callable[[], bool]], Sampler],
    ) -> None:
        self.steps = steps_of(excitation, sample_rate)
        self._parts = []
        for axis, first, last in excited_spans(excitation.axes, self.steps):
            steps = last - first
            # No reference to the sampler of a whole signal remains here, so its memory is released.
            kept = keep(excitation, excitation.sampler(steps, sample_rate, axis), steps, cancelled)
            self._parts.append((axis, first, last, kept))

    def window(self, index: int) -> tuple[int, NDArray[np.float64]]:
        if not 0 <= index < self.steps:
            raise IndexError(f"sample {index} asked for; there are {self.steps}")
        first, last = next((first, last) for _, first, last, _ in self._parts if first <= index < last)
        start = index - (index - first) % WINDOW
        samples = np.zeros((min(WINDOW, last - start), 2))
        for axis, first, last, sampler in self._parts:
            if first <= index < last:
                samples[:, axis] = sampler(start - first, start - first + len(samples))
        return start, samples

    def windows(self) -> Iterator[tuple[int, NDArray[np.float64]]]:
        index = 0
        while index < self.steps:
            first, samples = self.window(index)
            yield first, samples
            index = first + len(samples)


def _kept(excitation: Excitation, sampler: Sampler, steps: int, cancelled: Callable[[], bool]) -> Sampler:
    """A sampler that is fast for every window, and keeps little in memory."""
    if steps > HIGHEST_IN_MEMORY:
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
