"""Excitations without a random part: sine sweep, square wave and sum of tones.

With axes `all`, all of them carry the same signal. The data then do not determine a linear model of several inputs.
Therefore these kinds excite the axes in turn by default.
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Context, Decimal
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from amb_core.excitation.signal import Excitation, Sampler
from amb_core.ground.parameters import choice, quantity, required

HIGHEST_AMPLITUDE = 1e-3  # m, larger than any air gap of such bearings
HIGHEST_FREQUENCY = 50e3  # Hz, Nyquist frequency of the highest controller sample rate

HIGHEST_TONES = 1_000  # the controller needs a minute or two to make 600 s of them
FEW_TONES = 16  # that are made while the loop runs, about 20 us each for a block of samples

# Absorbs rounding of `frequency * step / sample_rate`, which would delay an edge that falls on a sample by one sample.
EDGE_TOLERANCE = 1e-9

# np.log and np.expm1 differ in the last place between processors, and a million cycles make that a large phase. Decimal
# rounds alike on all of them; it is slow, so a power is made of one for its block and one for its place in the block.
SAME_EVERYWHERE = Context(prec=40)
BLOCK = 256


class Sweep(Excitation):
    """Sine of constant amplitude with a frequency that runs from start to end (either may be the higher).

    The phase is 2 pi times the integral of the frequency, zero at the first sample. With T the span of the signal the
    frequency is f_0 + (f_1 - f_0) t/T (linear) or f_0 (f_1/f_0)^(t/T) (logarithmic).
    """

    kind: ClassVar[str] = "sweep"

    amplitude: float = required("m", "peak amplitude", 1e-9, HIGHEST_AMPLITUDE)
    frequency_start: float = quantity(11.0, "Hz", "frequency at the first sample", 1e-3, HIGHEST_FREQUENCY)
    frequency_end: float = quantity(400.0, "Hz", "frequency reached at the end", 1e-3, HIGHEST_FREQUENCY)
    spacing: Literal["linear", "logarithmic"] = choice("linear", "how the frequency runs over time")

    @property
    def highest_frequency(self) -> float:
        """The higher end of the sweep (Hz)."""
        return max(self.frequency_start, self.frequency_end)

    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2) -> Sampler:
        """The sweep over `steps` samples.

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
        logarithmic = self.spacing == "logarithmic" and self.frequency_start != self.frequency_end
        cycles = self._logarithmic(steps, sample_rate) if logarithmic else self._linear(steps, sample_rate)
        return lambda first, stop: self.amplitude * np.sin(2.0 * np.pi * cycles(np.arange(first, stop)))

    def _linear(self, steps: int, sample_rate: float) -> Callable[[NDArray[np.int_]], NDArray[np.float64]]:
        """Cycles since the first sample, of samples by their indices."""
        change = (self.frequency_end - self.frequency_start) / (2.0 * (steps / sample_rate))

        def cycles(indices: NDArray[np.int_]) -> NDArray[np.float64]:
            time = indices / sample_rate
            return self.frequency_start * time + change * time**2

        return cycles

    def _logarithmic(self, steps: int, sample_rate: float) -> Callable[[NDArray[np.int_]], NDArray[np.float64]]:
        """The same; f_0 T / g (exp(g n / steps) - 1) with g = ln(f_1 / f_0)."""
        exact = SAME_EVERYWHERE
        growth = exact.ln(exact.divide(Decimal(self.frequency_end), Decimal(self.frequency_start)))
        scale = self.frequency_start * (steps / sample_rate) / float(growth)

        def grown(index: int) -> float:
            return float(exact.subtract(exact.exp(exact.divide(exact.multiply(growth, index), steps)), 1))

        in_block = np.array([grown(index) for index in range(min(BLOCK, steps))])

        def cycles(indices: NDArray[np.int_]) -> NDArray[np.float64]:
            blocks, places = np.divmod(indices, BLOCK)
            first, last = int(blocks[0]), int(blocks[-1])
            before = np.array([grown(block * BLOCK) for block in range(first, last + 1)])[blocks - first]
            within = in_block[places]
            return scale * (before + within + before * within)

        return cycles

    def instantaneous_frequency(self, steps: int, sample_rate: float) -> NDArray[np.float64]:
        """Instantaneous frequency (Hz), shape (steps,).

        Parameters
        ----------
        steps : int
            Number of samples.
        sample_rate : float
            Controller sample rate (Hz).

        Returns
        -------
        ndarray, shape (steps,)
            Frequencies (Hz).
        """
        fraction = np.arange(steps) / steps
        start, end = self.frequency_start, self.frequency_end
        if self.spacing == "linear":
            return start + (end - start) * fraction
        return start * (end / start) ** fraction


class Square(Excitation):
    """Square wave between +amplitude and -amplitude, starting with +amplitude (paper, section 4)."""

    kind: ClassVar[str] = "square"

    amplitude: float = required("m", "peak amplitude", 1e-9, HIGHEST_AMPLITUDE)
    frequency: float = quantity(5.0, "Hz", "fundamental frequency", 1e-3, HIGHEST_FREQUENCY)

    @property
    def highest_frequency(self) -> float:
        """The fundamental (Hz); the harmonics of a sampled square wave always fold back."""
        return self.frequency

    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2) -> Sampler:
        """The square wave.

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

        def samples(first: int, stop: int) -> NDArray[np.float64]:
            half_periods = np.floor(2.0 * self.frequency * np.arange(first, stop) / sample_rate + EDGE_TOLERANCE)
            return np.where(half_periods % 2 == 0, self.amplitude, -self.amplitude)

        return samples


class Tones(Excitation):
    """Sum of sines, tone i being amplitudes[i] * sin(2 pi frequencies[i] t + phases[i])."""

    kind: ClassVar[str] = "tones"

    frequencies: tuple[float, ...] = Field(description="frequency of each tone", json_schema_extra={"unit": "Hz"})
    amplitudes: tuple[float, ...] = Field(description="peak amplitude of each tone", json_schema_extra={"unit": "m"})
    phases: tuple[float, ...] = Field(
        (), description="phase of each tone at the first sample; empty: all zero", json_schema_extra={"unit": "rad"}
    )

    @model_validator(mode="after")
    def _tones_fit_together(self) -> Self:
        if not self.frequencies:
            raise ValueError("tones: give at least one frequency in 'frequencies' (Hz)")
        if len(self.frequencies) > HIGHEST_TONES:
            raise ValueError(f"tones: {len(self.frequencies)} frequencies; allowed: {HIGHEST_TONES} at most")
        if len(self.amplitudes) != len(self.frequencies):
            raise ValueError(
                f"tones: {len(self.frequencies)} frequencies but {len(self.amplitudes)} amplitudes; give one per tone"
            )
        if self.phases and len(self.phases) != len(self.frequencies):
            raise ValueError(
                f"tones: {len(self.frequencies)} frequencies but {len(self.phases)} phases; give one per tone or none"
            )
        for frequency in self.frequencies:
            if not 1e-3 <= frequency <= HIGHEST_FREQUENCY:
                raise ValueError(
                    f"tones: frequency {frequency:g} Hz is not allowed; allowed: 0.001 to {HIGHEST_FREQUENCY:g} Hz"
                )
        for amplitude in self.amplitudes:
            if amplitude < 0.0:
                raise ValueError(f"tones: amplitude {amplitude:g} m is not allowed; it must not be negative")
        if not 1e-9 <= sum(self.amplitudes) <= HIGHEST_AMPLITUDE:
            raise ValueError(
                f"tones: the amplitudes sum up to {sum(self.amplitudes):g} m; allowed: 1e-09 to {HIGHEST_AMPLITUDE:g} m"
            )
        return self

    @property
    def highest_frequency(self) -> float:
        """Frequency of the highest tone (Hz)."""
        return max(self.frequencies)

    @property
    def by_sample(self) -> bool:
        """Whether there are few tones, so that their sum is quickly made."""
        return len(self.frequencies) <= FEW_TONES

    def sampler(self, steps: int, sample_rate: float, axis: int, axes: int = 2) -> Sampler:
        """The sum.

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
        phases = self.phases or (0.0,) * len(self.frequencies)

        def samples(first: int, stop: int) -> NDArray[np.float64]:
            time = np.arange(first, stop) / sample_rate
            signal = np.zeros(stop - first)
            for frequency, amplitude, phase in zip(self.frequencies, self.amplitudes, phases, strict=True):
                signal += amplitude * np.sin(2.0 * np.pi * frequency * time + phase)
            return signal

        return samples

    def instantaneous_frequency(self, steps: int, sample_rate: float) -> NDArray[np.float64] | None:
        """Frequency of a single tone (Hz), shape (steps,); a sum of several has none.

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
        return np.full(steps, self.frequencies[0]) if len(self.frequencies) == 1 else None
