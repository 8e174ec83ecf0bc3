"""Excitations with a random part that is determined by a seed: multisine, PRBS and band-limited white noise.

Each axis has its own random part. With axes `all`, the default here, all are excited at once by independent signals, so
that the data determine a model of all inputs.

Sources: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012,
chapter 5 (multisine, noise); L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 13.3 (PRBS).
"""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from amb_core.excitation.axes import ALL, AXES_DESCRIPTION, MODES, ORTHOGONAL, turns
from amb_core.excitation.deterministic import EDGE_TOLERANCE, HIGHEST_AMPLITUDE, HIGHEST_FREQUENCY
from amb_core.excitation.phases import optimised_phases, schroeder_phases
from amb_core.excitation.signal import Excitation, Sampler
from amb_core.ground.errors import ExcitationError
from amb_core.ground.parameters import choice, quantity, required, switch

_GROUP = 4  # consecutive odd lines, of which one is left out

_ALIKE = 1e-9  # of the peak, by which samples differ that are taken as equal
_LEFT_OUT_SEED = 0  # of the lot that draws these, the same in every signal


class _Seeded(Excitation):
    """Common part of the kinds with a random part."""

    amplitude: float = required("m", "peak amplitude", 1e-9, HIGHEST_AMPLITUDE)
    axes: str = choice(ALL, AXES_DESCRIPTION)
    seed: int = quantity(0, "-", "seed of the random number generator", 0, 2**32 - 1)


class _Band(_Seeded):
    """Common part of the kinds with a flat spectrum in a band."""

    frequency_start: float = quantity(11.0, "Hz", "lower end of the band", 1e-3, HIGHEST_FREQUENCY)
    frequency_end: float = quantity(400.0, "Hz", "upper end of the band", 1e-3, HIGHEST_FREQUENCY)

    @model_validator(mode="after")
    def _band_is_not_empty(self) -> Self:
        if self.frequency_start >= self.frequency_end:
            raise ValueError(
                f"{self.kind}: the band {self.frequency_start:g} Hz to {self.frequency_end:g} Hz is empty; "
                "frequency_start must be below frequency_end"
            )
        return self

    @property
    def highest_frequency(self) -> float:
        """Upper end of the band (Hz)."""
        return self.frequency_end

    @property
    def by_sample(self) -> bool:
        """False: a transform makes all samples at once."""
        return False

    def random(self, axis: int) -> np.random.Generator:
        """Random numbers of one axis, the same ones every time.

        Parameters
        ----------
        axis : int
            Index of the axis.

        Returns
        -------
        Generator
            Seeded by `seed` and the axis.
        """
        return np.random.default_rng([self.seed, axis])

    def lines(self, steps: int, sample_rate: float) -> slice:
        """Lines of the discrete spectrum that lie in the band; without mean value and Nyquist frequency.

        Parameters
        ----------
        steps : int
            Number of samples of the signal.
        sample_rate : float
            Sample rate (Hz).

        Returns
        -------
        slice
            First line, and line after the last.

        Raises
        ------
        ExcitationError
            If there is none, because the signal is too short to resolve the band.
        """
        resolution = sample_rate / steps
        first = max(1, int(np.ceil(self.frequency_start / resolution - EDGE_TOLERANCE)))
        last = min((steps - 1) // 2, int(np.floor(self.frequency_end / resolution + EDGE_TOLERANCE)))
        if first > last:
            raise ExcitationError(
                f"{self.kind}: no multiple of {resolution:g} Hz (1 / duration per axis) lies in the band "
                f"{self.frequency_start:g} Hz to {self.frequency_end:g} Hz; lengthen the duration or widen the band"
            )
        return slice(first, last + 1)


class Multisine(_Band):
    """Multisine: sines of equal amplitude at every multiple of 1 / period in the band.

    The signal on an axis is one period, or `periods` equal ones. A discrete Fourier transform over it shows no leakage,
    and its resolution is the finest that the period allows. The highest magnitude is `amplitude`. With axes `in_turn`
    the signal on each of n axes has 1 / n of the duration. With axes `orthogonal` each of n experiments has 1 / n of
    it; all axes and experiments have lines of one amplitude, and `amplitude` is the highest magnitude of them all.

    With `odd`, which lines are left out depends on the band and the period, not on the seed: signals of several seeds
    are realisations of one kind, see `amb_core.regions.distortion`.

    Optimised phases are those of the experiments without a turn. Where the number of axes is no power of two, other
    orthogonal experiments turn all lines by the same angle, and their crest factor is higher.

    Random phases are uniform over the circle, drawn from the seed; optimised ones start from them. Schroeder's do not
    depend on it: x chirps upwards, y downwards; those of further pairs of axes start in other parts of their period.
    Signals without random phases start where they are closest to zero, so that the control law does not respond to a
    jump.
    """

    kind: ClassVar[str] = "multisine"
    has_lines: ClassVar[bool] = True

    phasing: Literal["random", "schroeder", "optimised"] = choice(
        "random",
        "how phases are chosen: random (crest factor 3 to 4), schroeder (a chirp, 1.7) or optimised (below 1.5; with "
        "axes orthogonal up to 2.7, unless their number is a power of two)",
    )
    interleaved: bool = switch(False, "of n axes each has every n-th line of the band: no line excites two axes")
    odd: bool = switch(False, "only odd lines, and one of every four of them is left out, so that distortions show")
    periods: int = quantity(1, "-", "number of equal periods (of each experiment); distortion needs 2 or more", 1, 1000)

    @model_validator(mode="after")
    def _lines_suit_the_axes(self) -> Self:
        if self.interleaved and self.axes in (ORTHOGONAL, *MODES):
            raise ValueError(
                f"{self.kind}: interleaved with axes = '{self.axes}' is not allowed: they excite several axes at each "
                "line; allowed axes: a list of axes, all, in_turn"
            )
        return self

    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2, turn: float = 0.0) -> Sampler:
        """All samples, made at once.

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
        turn : float, optional
            Added to the phases of all lines, over 2 pi (-).

        Returns
        -------
        Sampler
            Makes the samples (m), shape (stop - first,), from a first one up to, not including, another.

        Raises
        ------
        ExcitationError
            If the samples cannot hold the periods, or no line lies in the band.
        """
        if steps % self.periods:
            raise ExcitationError(
                f"{self.kind}: {steps} samples on an axis cannot hold {self.periods} equal periods; "
                "allowed: a duration that is a whole multiple of them"
            )
        period = steps // self.periods
        signal = self._period(period, sample_rate, axis, axes, turn)
        if self.axes == ORTHOGONAL:
            signal *= self.amplitude / _highest(self, period, sample_rate, axes)
        else:
            signal *= self.amplitude / np.max(np.abs(signal))
        signal = np.tile(signal, self.periods)
        return lambda first, stop: signal[first:stop]

    def _period(self, steps: int, sample_rate: float, axis: int, axes: int, turn: float) -> NDArray[np.float64]:
        """One period of lines of magnitude 1, shape (steps,)."""
        lines = self._excited(steps, sample_rate, axis, axes)
        spectrum = np.zeros(steps // 2 + 1, dtype=complex)
        spectrum[lines] = np.exp(1j * self._phases(lines, axis))
        signal: NDArray[np.float64] = np.fft.irfft(spectrum, steps)
        # The start is that without a turn: in all experiments the same.
        start = 0 if self.phasing == "random" else _start(np.abs(signal), axis // 2, -(-axes // 2))
        if turn:
            signal = np.fft.irfft(spectrum * np.exp(2j * np.pi * turn), steps)
        return np.roll(signal, -start) if start else signal

    def _excited(self, steps: int, sample_rate: float, axis: int, axes: int) -> NDArray[np.int_]:
        """Excited lines of a period of some steps."""
        band = self.lines(steps, sample_rate)
        lines = np.arange(band.start, band.stop)
        if self.odd:
            lines = lines[lines % 2 == 1]
            lot = np.random.default_rng(_LEFT_OUT_SEED)
            left_out = [lot.choice(lines[n : n + _GROUP]) for n in range(0, len(lines), _GROUP)]
            lines = np.setdiff1d(lines, left_out)
        if self.interleaved:
            lines = lines[axis::axes]
        if not len(lines):
            needed = f"interleaved needs {axes} lines"
            wish = "odd needs four odd lines" if self.odd else needed
            resolution = sample_rate / steps
            there = f"{band.start * resolution:g} Hz"
            if band.stop - band.start > 1:
                there += f" to {(band.stop - 1) * resolution:g} Hz in steps of {resolution:g} Hz"
            raise ExcitationError(
                f"{self.kind}: {wish} or more, but only {there} lies in the band; lengthen the duration or widen the "
                "band"
            )
        return lines

    def _phases(self, lines: NDArray[np.int_], axis: int) -> NDArray[np.float64]:
        if self.phasing == "schroeder":
            return -schroeder_phases(lines) if axis % 2 else schroeder_phases(lines)
        phases = self.random(axis).uniform(0.0, 2.0 * np.pi, len(lines))
        return phases if self.phasing == "random" else optimised_phases(lines, phases)


@lru_cache(maxsize=8)  # requested for each of the signals that share it
def _highest(multisine: Multisine, steps: int, sample_rate: float, axes: int) -> float:
    """Highest magnitude of a period of lines of magnitude 1, over all axes and orthogonal experiments."""
    periods = (
        multisine._period(steps, sample_rate, axis, axes, float(turn))
        for axis, of_axis in enumerate(turns(axes))
        for turn in np.unique(of_axis[of_axis != 0.5])  # half a turn is a sign
    )
    return max(float(np.max(np.abs(period))) for period in periods)


def _start(magnitude: NDArray[np.float64], part: int, parts: int) -> int:
    """Where a periodic signal is closest to zero, in one of several equal parts of its period.

    The first such sample: a signal of odd lines passes zero alike in both halves of its period, and which of them is
    closer by the last bit depends on the processor and its libraries.
    """
    first, stop = part * len(magnitude) // parts, (part + 1) * len(magnitude) // parts
    within = magnitude[first:stop]
    return first + int(np.argmax(within <= within.min() + _ALIKE * magnitude.max()))


class Prbs(_Seeded):
    """Pseudo-random binary sequence between +amplitude and -amplitude.

    A maximum length sequence from a random state of its shift register, each bit held for one period of the clock. Of n
    axes each takes another n-th of the bits, in order. The register is the shortest one without a repetition in these
    bits, so the axes share no pattern. The spectrum has its first zero at the clock rate and is flat to within 3 dB
    up to 0.44 of it.
    """

    kind: ClassVar[str] = "prbs"

    frequency: float = quantity(500.0, "Hz", "clock rate", 1e-3, HIGHEST_FREQUENCY)

    @property
    def highest_frequency(self) -> float:
        """Clock rate (Hz)."""
        return self.frequency

    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2) -> Sampler:
        """The sequence; its bits are kept, eight to a byte.

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
        from scipy.signal import max_len_seq  # takes a second to import, and not needed by other kinds

        def clock(first: int, stop: int) -> NDArray[np.int64]:
            return np.floor(self.frequency * np.arange(first, stop) / sample_rate + EDGE_TOLERANCE).astype(np.int64)

        count = int(clock(steps - 1, steps)[0]) + 1
        register = max(2, (axes * count).bit_length())
        start = int(np.random.default_rng(self.seed).integers(1, 2**register))
        state = [start >> position & 1 for position in range(register)]
        sequence, _ = max_len_seq(register, state=state, length=axes * count)
        own = np.packbits(sequence[axis * count : (axis + 1) * count])

        def samples(first: int, stop: int) -> NDArray[np.float64]:
            wanted = clock(first, stop)
            skipped = int(wanted[0]) // 8
            values = np.unpackbits(own[skipped : int(wanted[-1]) // 8 + 1])
            bits = values[wanted - 8 * skipped].astype(np.float64)
            return self.amplitude * (2.0 * bits - 1.0)

        return samples


class WhiteNoise(_Band):
    """Gaussian noise, flat in the band and zero outside; its rms on an axis is exactly `amplitude`."""

    kind: ClassVar[str] = "white_noise"

    amplitude: float = required("m", "rms amplitude", 1e-9, HIGHEST_AMPLITUDE)

    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2) -> Sampler:
        """All samples, made at once.

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
        lines = self.lines(steps, sample_rate)
        parts = self.random(axis).standard_normal((2, lines.stop - lines.start))
        spectrum = np.zeros(steps // 2 + 1, dtype=complex)
        spectrum[lines] = parts[0] + 1j * parts[1]
        signal: NDArray[np.float64] = np.fft.irfft(spectrum, steps)
        signal *= self.amplitude / np.sqrt(np.mean(signal**2))
        return lambda first, stop: signal[first:stop]
